//! Session and pulse engine together, and the lock around them.
//!
//! # Design
//! Main loop and interrupt both come to the one [`Controller`]. Each holds the lock for one small piece of
//! work at a time ([`Engine::turn`], a request, a message), so neither keeps the other, nor the UART's
//! interrupt, waiting for more than a fraction of a millisecond.
//!
//! Responses go to the link that the request came from, by the request's number; events to the link of the
//! last `Hello`. Messages stay with the session until the link has sent what was before them: the session knows
//! what to drop, and counts it.

use core::cell::RefCell;

use embassy_rp::bind_interrupts;
use embassy_rp::interrupt::{self, InterruptExt, typelevel};
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use heapless::Deque;
use rcg_firmware::control;
use rcg_firmware::kept::Kept;
use rcg_firmware::session::Session;
use rcg_firmware::stored;
use rcg_protocol::{
    Decoder, Event, Fault, FrameError, Request, Response, Seq, SessionId, State, ToDevice, ToHost, Unit,
    decode, encode,
};
use static_cell::{ConstStaticCell, StaticCell};

use crate::board::{self, engine::Engine};
use crate::board::{Clock, PulseParts};
use crate::links::{self, LinkId};

/// Requests of which it is remembered where they came from: more than a session keeps responses for.
const ROUTES: usize = 16;

static CONTROLLER: Mutex<CriticalSectionRawMutex, RefCell<Option<&'static mut Controller>>> =
    Mutex::new(RefCell::new(None));

/// Session, engine, and where messages go.
struct Controller {
    clock: Clock,
    session: &'static mut Session,
    engine: Engine,
    /// Who asked: session, number, link. The oldest is forgotten.
    routes: Deque<(SessionId, Seq, LinkId), ROUTES>,
    events_to: LinkId,
}

/// Puts the controller in place and lets the DMA interrupt it. To be called once.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(crate) fn install(clock: Clock, seed: u32, unit: Unit, kept: Kept, pulse: PulseParts) {
    static CELL: StaticCell<Controller> = StaticCell::new();
    // In its place from the start: on its way there it would pass over the stack, which has no room for it.
    static SESSION: ConstStaticCell<Session> = ConstStaticCell::new(Session::new(1_000_000, 0));
    let session = SESSION.take();
    session.boot(unit, kept, clock.hz(), seed);
    let controller = CELL.init_with(|| Controller {
        clock,
        session,
        engine: Engine::new(pulse, clock, kept),
        routes: Deque::new(),
        events_to: LinkId::Uart,
    });
    CONTROLLER.lock(|cell| cell.replace(Some(controller)));
    // SAFETY: the handler takes the lock like everybody else, and no code relies on this interrupt being off.
    unsafe { interrupt::DMA_IRQ_0.enable() };
}

/// Lets the schedule that is kept, if there is one, run as if a host had asked for it. To be called once, at boot; after another reset than
/// a power-up it is only told of.
#[unsafe(link_section = ".boot_text")]
#[inline(never)]
pub(crate) fn recall(clock: Clock, powered_up: bool) {
    let Some((stored, requests)) = board::schedule(clock.hz()) else {
        return;
    };
    with(|controller| controller.session.set_stored(Some(stored)));
    if !powered_up {
        return;
    }
    let made = stored::recall(requests, |request| {
        let made = with(|controller| {
            control::recall(&mut controller.engine, controller.session, clock.now(), request)
        });
        service();
        made.unwrap_or(Ok(()))
    });
    if made.is_ok() {
        defmt::info!("runs the schedule that is kept");
    } else {
        defmt::error!("the schedule that is kept is refused");
    }
}

/// Runs `work` on the controller, alone.
fn with<R>(work: impl FnOnce(&mut Controller) -> R) -> Option<R> {
    CONTROLLER.lock(|cell| cell.borrow_mut().as_deref_mut().map(work))
}

bind_interrupts!(
    /// The DMA's interrupt; [`crate::board`] has the others.
    struct Refill {
        DMA_IRQ_0 => RefillHandler;
    }
);

/// Refills the pulse engine when a block is through.
struct RefillHandler;

impl typelevel::Handler<typelevel::DMA_IRQ_0> for RefillHandler {
    unsafe fn on_interrupt() {
        service();
    }
}

/// Lets the engine do all that there is to do.
fn service() {
    while with(Controller::turn).unwrap_or(false) {}
}

/// Cuts frames out of the `bytes` that came in over `link`, and takes the requests that they hold.
pub(crate) fn cut(link: LinkId, decoder: &mut Decoder, mut bytes: &[u8]) {
    while let Some(frame) = decoder.frame(&mut bytes) {
        match frame {
            Ok(frame) => match decode(frame) {
                Ok(message) => receive(link, &message),
                Err(error) => receive_corrupt(link, error),
            },
            Err(error) => receive_corrupt(link, error),
        }
    }
}

/// Takes a request that came in over `link`.
fn receive(link: LinkId, message: &ToDevice) {
    // The answer shall tell how things stand now, and what is commanded shall be done before it is sent. But steps that
    // are appended are fetched when there is room for them: the DMA and the poll will tell.
    let telling = !matches!(message.request, Request::Append { .. } | Request::Ping(_));
    if telling {
        service();
    }
    with(|controller| controller.request(link, message));
    if telling {
        service();
    }
    send();
}

/// Takes a frame from `link` that is none.
fn receive_corrupt(link: LinkId, error: FrameError) {
    defmt::warn!("{}: {}", link, error);
    with(|controller| controller.session.corrupt_frame());
}

/// Tells the link of the next message that there is one.
fn send() {
    if let Some(link) = with(Controller::next_link).flatten() {
        links::wake(link);
    }
}

/// Makes the next message a frame at the start of `out`, which has room for [`rcg_protocol::MAX_FRAME`] bytes, if it
/// is one for `link`. Returns how long the frame is, zero if there is none, and how many step records are in it.
pub(crate) fn next_frame(link: LinkId, out: &mut [u8]) -> (usize, u32) {
    let (length, records) = with(|controller| controller.next_frame(link, out)).unwrap_or_default();
    if length == 0 {
        send(); // the next message may be for the other link
    }
    (length, records)
}

/// `records` step records were sent to nobody.
pub(crate) fn records_lost(records: u32) {
    with(|controller| controller.session.records_lost(records));
}

/// Lets time pass: engine, time-outs, messages to the links.
pub(crate) fn poll() {
    service();
    with(|controller| {
        let now = controller.clock.now();
        controller.session.poll(now);
        controller.engine.note_edges();
        controller.obey();
    });
    service();
    send();
}

/// Whether the box was asked to go to its boot loader, and has nothing else to do.
pub(crate) fn leaves() -> bool {
    with(|controller| controller.session.leaves(controller.clock.now())).unwrap_or(false)
}

/// The state, and the fault if it is one.
pub(crate) fn state() -> (State, Option<Fault>) {
    let seen = with(|controller| {
        let sequencer = controller.session.sequencer();
        (sequencer.state(), sequencer.fault())
    });
    seen.unwrap_or_default()
}

impl Controller {
    fn turn(&mut self) -> bool {
        control::turn(&mut self.engine, self.session)
    }

    fn request(&mut self, link: LinkId, message: &ToDevice) {
        let hello = matches!(message.request, Request::Hello { .. });
        let session = if hello { SessionId(0) } else { message.session };
        if hello {
            self.events_to = link;
        }
        if self.routes.is_full() {
            self.routes.pop_front();
        }
        self.routes.push_back((session, message.seq, link)).ok(); // there is room now
        control::request(&mut self.engine, self.session, self.clock.now(), message);
    }

    /// Carries out what the session commands the engine.
    fn obey(&mut self) {
        control::obey(&mut self.engine, self.session);
    }

    /// The link that the next message goes to.
    fn next_link(&mut self) -> Option<LinkId> {
        self.session.message().map(|message| self.route(message))
    }

    fn next_frame(&mut self, link: LinkId, out: &mut [u8]) -> (usize, u32) {
        match self.session.message() {
            Some(message) if self.route(message) == link => {
                let length = encode(message, out).expect("MAX_FRAME holds every message").len();
                let records = match message {
                    ToHost::Event(Event::Records { records, .. }) => records.len() as u32,
                    _ => 0,
                };
                self.session.message_sent();
                (length, records)
            }
            _ => (0, 0),
        }
    }

    /// The link that `message` goes to.
    fn route(&self, message: &ToHost) -> LinkId {
        match message {
            ToHost::Event(_) => self.events_to,
            ToHost::Response(Response { session, seq, .. }) => {
                let mut newest_first = self.routes.iter().rev();
                newest_first
                    .find(|(asked_in, asked, _)| asked_in == session && asked == seq)
                    .map_or(self.events_to, |&(.., link)| link)
            }
        }
    }
}
