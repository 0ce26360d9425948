//! The page, on the loopback address.
//!
//! # Design
//! `/` is the page, for whoever asks under the right name: it holds nothing. `/live` is a socket: its first message is the token, then state and
//! picture come whenever they change, each time once the page has said that it is done with what came before; so a slow page sees fewer
//! pictures, and nothing piles up. `/do` takes a wish. The instrument's thread knows nothing of pages.

use std::future::IntoFuture as _;
use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{DefaultBodyLimit, Path, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use rand::TryRng as _;
use rcg::base::progress::Progress as _;
use rcg::calibrate::live::{Picture, Table};
use serde_json::json;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, oneshot, watch};

use super::Args;
use super::guard::{Guard, Refusal};
use super::watch::Watch;
use super::wish::Wish;
use super::worker::{Asking, Told, Worker};
use crate::Done;
use crate::failure::Failure;
use crate::output::Output;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const PROGRAM: &str = include_str!("page.js");
/// What the page may do: nothing but talk to this server.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";
/// Bytes of a wish.
const LONGEST_WISH: usize = 4096;
/// Wishes that may wait.
const WISHES: usize = 64;
/// Pages at a time.
const PAGES: usize = 16;
/// How long a socket may take to say its token, and a page to say that it is done.
const TOKEN_WITHIN: Duration = Duration::from_secs(5);
const PAGE_WITHIN: Duration = Duration::from_mins(1);
/// How long a browser may take to be told the address.
const OPENED_WITHIN: Duration = Duration::from_secs(30);

/// What all requests share.
#[derive(Clone)]
struct Shared {
    guard: Guard,
    told: Told,
    asked: SyncSender<Asking>,
    pages: Arc<Semaphore>,
    report: Option<PathBuf>,
    /// Who has it may have the report, once.
    ticket: Arc<Mutex<Option<String>>>,
}

/// Serves the page until somebody ends the program.
pub(crate) fn run(args: &Args, table: Table, output: &Output) -> Done {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .enable_time()
        .build()?;
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, args.page_port.unwrap_or(0)));
    let listener = runtime.block_on(TcpListener::bind(address)).map_err(|error| {
        Failure::input(format!(
            "--page-port {}: expected a port that is free, found {error}",
            address.port()
        ))
    })?;
    let guard = Guard::new(listener.local_addr()?.port(), random()?);
    let url = guard.url();
    let (asked, wishes) = sync_channel(WISHES);
    let told = Told {
        state: watch::Sender::new(Arc::default()),
        picture: watch::Sender::new(Arc::new(Picture::default())),
    };
    let look_on = args.measurement.as_deref().map(Watch::new);
    let worker = Worker::new(table, wishes, told.clone(), (look_on, args.out.clone()));
    let is_open = args.exposure_ms.is_none();
    std::thread::Builder::new()
        .name("instrument".to_owned())
        .spawn(move || worker.run(is_open))?;
    let shared = Shared {
        guard,
        told,
        asked,
        pages: Arc::new(Semaphore::new(PAGES)),
        report: args.measurement.as_ref().map(|dir| dir.join("report.html")),
        ticket: Arc::default(),
    };
    output.print(&json!({ "url": url }), || format!("{url}\n"))?;
    output.remark("the page is open to whoever has this address, on this computer alone; Ctrl-C ends it");
    let opened = (!args.no_open).then(|| open(&url, output)).flatten();
    runtime.block_on(async move {
        tokio::spawn(async move {
            tokio::time::sleep(OPENED_WITHIN).await;
            drop(opened);
        });
        axum::serve(listener, router(shared)).into_future().await
    })?;
    Ok(())
}

/// Numbers that nobody can guess.
fn random() -> Result<[u64; 2], Failure> {
    let draw = || {
        rand::rngs::SysRng
            .try_next_u64()
            .map_err(|error| Failure::Failed(anyhow::anyhow!("{error}")))
    };
    Ok([draw()?, draw()?])
}

/// Opens a browser at `url`. The address, with its token, stands in a file that nobody else reads, and in no list of programs.
fn open(url: &str, output: &Output) -> Option<tempfile::NamedTempFile> {
    let opener = if cfg!(target_os = "macos") {
        "open"
    } else {
        "xdg-open"
    };
    let file = tempfile::Builder::new()
        .prefix("rcg-live-")
        .suffix(".html")
        .tempfile();
    let opened = file.and_then(|mut file| {
        write!(
            file,
            "<!doctype html><meta http-equiv=\"refresh\" content=\"0;url={url}\">"
        )?;
        let mut command = std::process::Command::new(opener);
        command.arg(file.path()).stdin(std::process::Stdio::null());
        command
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()?;
        Ok(file)
    });
    if opened.is_err() {
        output.remark("no browser could be opened: open the address in one");
    }
    opened.ok()
}

fn router(shared: Shared) -> Router {
    Router::new()
        .route("/", get(|| async { file("text/html; charset=utf-8", PAGE) }))
        .route(
            "/page.css",
            get(|| async { file("text/css; charset=utf-8", STYLE) }),
        )
        .route(
            "/page.js",
            get(|| async { file("text/javascript; charset=utf-8", PROGRAM) }),
        )
        .route("/live", get(live))
        .route("/do", post(wish))
        .route("/state", get(state))
        .route("/report", post(ticket))
        .route("/report/{ticket}", get(report))
        .layer(DefaultBodyLimit::max(LONGEST_WISH))
        .layer(middleware::from_fn_with_state(shared.clone(), guarded))
        .with_state(shared)
}

async fn guarded(State(shared): State<Shared>, request: Request, next: Next) -> Response {
    match shared.guard.check(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    }
}

fn file(kind: &'static str, text: &'static str) -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, text)
}

/// Grants a wish.
async fn wish(
    State(shared): State<Shared>,
    headers: HeaderMap,
    body: Bytes,
) -> Result<&'static str, Refusal> {
    shared.guard.check_token(&headers)?;
    let bad = |sentence: String| (StatusCode::BAD_REQUEST, format!("{sentence}\n"));
    let wish = Wish::read(&body).map_err(bad)?;
    let (answer, answered) = oneshot::channel();
    let full = |_| bad("expected an instrument that keeps up, found too many wishes waiting".to_owned());
    shared.asked.try_send((wish, answer)).map_err(full)?;
    match answered.await {
        Ok(Ok(())) => Ok("done\n"),
        Ok(Err(sentence)) => Err(bad(sentence)),
        Err(_) => Err(bad(
            "expected an answer of the instrument, found that its thread has ended".to_owned(),
        )),
    }
}

/// The state, once.
async fn state(State(shared): State<Shared>, headers: HeaderMap) -> Result<Response, Refusal> {
    shared.guard.check_token(&headers)?;
    let state = shared.told.state.borrow().clone();
    let text = serde_json::to_string(&*state).unwrap_or_default();
    Ok(([(header::CONTENT_TYPE, "application/json")], text).into_response())
}

/// A place where the report may be fetched once, as a page of its own: a browser that opens a page says no token.
async fn ticket(State(shared): State<Shared>, headers: HeaderMap) -> Result<String, Refusal> {
    shared.guard.check_token(&headers)?;
    let [one, other] =
        random().map_err(|failure| (StatusCode::INTERNAL_SERVER_ERROR, format!("{failure}\n")))?;
    let ticket = format!("{one:016x}{other:016x}");
    *shared.ticket.lock().unwrap_or_else(PoisonError::into_inner) = Some(ticket.clone());
    Ok(format!("/report/{ticket}"))
}

/// The report of the measurement that is looked at.
async fn report(State(shared): State<Shared>, Path(ticket): Path<String>) -> Result<Response, Refusal> {
    let missing = || {
        (
            StatusCode::NOT_FOUND,
            "expected a measurement that is done, found no report.html\n".to_owned(),
        )
    };
    let is_known = {
        let mut known = shared.ticket.lock().unwrap_or_else(PoisonError::into_inner);
        known.take_if(|known| *known == ticket).is_some()
    };
    if !is_known {
        return Err((
            StatusCode::FORBIDDEN,
            "expected an address that the page opens, found another or an old one\n".to_owned(),
        ));
    }
    let path = shared.report.ok_or_else(missing)?;
    let text = std::fs::read_to_string(path).map_err(|_| missing())?;
    let policy =
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:";
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CACHE_CONTROL, "no-store"),
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    Ok((headers, text).into_response())
}

async fn live(State(shared): State<Shared>, upgrade: WebSocketUpgrade) -> Response {
    let Ok(page) = shared.pages.clone().try_acquire_owned() else {
        let sentence = format!("expected at most {PAGES} pages at a time, found more: close some\n");
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    };
    upgrade
        .max_message_size(LONGEST_WISH)
        .on_upgrade(move |socket| async move {
            follow(socket, shared).await;
            drop(page);
        })
}

/// Tells a page what changes, until it goes.
async fn follow(mut socket: WebSocket, shared: Shared) {
    let first = tokio::time::timeout(TOKEN_WITHIN, socket.recv()).await;
    let is_known = matches!(&first, Ok(Some(Ok(Message::Text(token)))) if shared.guard.is_token(token));
    if !is_known {
        // A sentence that a page can show.
        socket.send(Message::Text("\"token\"".into())).await.ok();
        return;
    }
    let (mut state, mut picture) = (shared.told.state.subscribe(), shared.told.picture.subscribe());
    state.mark_changed();
    picture.mark_changed();
    loop {
        tokio::select! {
            biased;
            changed = state.changed() => if changed.is_err() { return },
            changed = picture.changed() => if changed.is_err() { return },
            // A page that says something out of turn, or goes.
            said = socket.recv() => match said {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => continue,
            },
        }
        let text = serde_json::to_string(&**state.borrow_and_update()).unwrap_or_default();
        if socket.send(Message::Text(text.into())).await.is_err() {
            return;
        }
        if picture.has_changed().unwrap_or(false) {
            let bytes = packed(&picture.borrow_and_update());
            if socket.send(Message::Binary(bytes.into())).await.is_err() {
                return;
            }
        }
        match tokio::time::timeout(PAGE_WITHIN, socket.recv()).await {
            Ok(Some(Ok(Message::Text(_)))) => {}
            _ => return,
        }
    }
}

/// A picture as bytes: width and height (16 bit, little-endian), channels, step, then its values.
fn packed(picture: &Picture) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(8 + picture.bytes.len());
    for size in [
        picture.width_px,
        picture.height_px,
        picture.channels,
        picture.step,
    ] {
        bytes.extend((size as u16).to_le_bytes());
    }
    bytes.extend(&picture.bytes);
    bytes
}
