//! The laws that hold after whatever has happened, and schedules to try them with.

use std::collections::BTreeSet;
use std::time::Duration;

use rcg::capture::device::{Device, DeviceError, Patience};
use rcg::capture::link::Link;
use rcg_firmware::pulse::WordFormat;
use rcg_protocol::{Extent, Program, Pulse, Request, RunId, Step, Ticks, ToDevice};

use crate::controller::Controller;
use crate::world::{MockLink, Peer};

/// The patience of these tests: shorter than the longest delay of a bad line, so that answers come too late.
pub const PATIENCE: Patience = Patience {
    timeout: Duration::from_millis(50),
    attempts: 8,
};

/// A client of a mocked controller.
pub type Client = Device<MockLink<Controller>>;

/// A table of these steps.
#[must_use]
pub const fn table(steps: usize, cycles: u32) -> Program {
    let steps = steps as u32;
    Program::new(Extent::Table { steps, cycles })
}

/// Steps of about a millisecond that all differ, and differ for every `seed`.
#[must_use]
pub fn steps(count: usize, seed: u64) -> Vec<Step> {
    (0..count as u64)
        .map(|n| Step {
            proj: Pulse::new(0, 500 + seed % 100_000),
            cam: Pulse::new(1000, 2000 + 3 * n),
            period: Ticks(125_000 + 3 * n),
        })
        .collect()
}

/// Calls `ask`, which sends at most `requests` requests, and holds its time on the link against its patience.
///
/// # Errors
/// What `ask` returns.
///
/// # Panics
/// If it took longer.
pub fn in_time<P: Peer, T>(
    device: &mut Device<MockLink<P>>,
    requests: u32,
    ask: impl FnOnce(&mut Device<MockLink<P>>) -> Result<T, DeviceError>,
) -> Result<T, DeviceError> {
    let began = device.link().now();
    let result = ask(device);
    let took = device.link().now().saturating_sub(began);
    let most = PATIENCE.timeout * PATIENCE.attempts * requests;
    assert!(took <= most, "took {took:?}, at most {most:?} was allowed");
    result
}

/// What must be true of any controller that one client has talked to over any line.
///
/// # Panics
/// If it is not.
pub fn check(link: &MockLink<Controller>) {
    check_shared(&[link]);
    let counters = link.peer_mut(|peer| *peer.session().counters());
    assert_eq!(
        u64::from(counters.frames + counters.corrupt),
        link.down().frames_arrived,
        "every frame that arrived is counted once, as good or as bad"
    );
}

/// What must be true of any controller that these clients have talked to.
///
/// # Panics
/// If it is not.
pub fn check_shared(links: &[&MockLink<Controller>]) {
    let sent: Vec<_> = links.iter().flat_map(|link| link.sent()).collect();
    links[0].peer_mut(|peer| {
        let counters = peer.session().counters();
        assert_eq!(
            counters.frames,
            counters.executed + counters.repeated + counters.stale
        );
        let journal = peer.journal();
        assert_eq!(journal.executed.len(), counters.executed as usize);
        let mut seen = BTreeSet::new();
        for message in &journal.executed {
            assert!(sent.contains(message), "nobody sent {message:?}");
            let key = (message.session, message.seq);
            let hello = hello_nonce(message).is_some();
            assert!(hello || seen.insert(key), "executed twice: {message:?}");
        }
        // A hello that comes again after another's takes over again; by itself it does not.
        let hellos: Vec<_> = journal.executed.iter().filter_map(hello_nonce).collect();
        assert!(
            hellos.windows(2).all(|pair| pair[0] != pair[1]),
            "a hello was executed twice"
        );
        for (n, message) in journal.executed.iter().enumerate() {
            let after = &journal.executed[n + 1..];
            let overtaken = after.iter().find(|later| {
                hello_nonce(later).is_none() && later.session == message.session && later.seq <= message.seq
            });
            assert!(
                overtaken.is_none(),
                "{overtaken:?} was executed after {message:?}"
            );
        }
        let run = peer.session().sequencer().run();
        assert_eq!(journal.primed, run, "every run was primed once");
        assert!(journal.fired <= journal.primed);
    });
}

const fn hello_nonce(message: &ToDevice) -> Option<u32> {
    match message.request {
        Request::Hello { nonce } => Some(nonce),
        _ => None,
    }
}

/// Holds what was played in `run` against the steps that should have been played, word by word.
///
/// # Panics
/// If they differ.
pub fn check_played(link: &MockLink<Controller>, run: RunId, program: &Program, steps: &[Step]) {
    let format = WordFormat::new(program.pace, program.polarity);
    let cycles = match program.extent {
        Extent::Table { cycles, .. } => cycles as usize,
        Extent::Stream => 1,
    };
    let wanted = steps.iter().cycle().take(steps.len() * cycles);
    link.peer_mut(|peer| {
        let played: Vec<_> = peer
            .journal()
            .played
            .iter()
            .filter(|(of, ..)| *of == run)
            .collect();
        assert_eq!(played.len(), steps.len() * cycles);
        for (n, (step, (_, id, words))) in wanted.zip(played).enumerate() {
            assert_eq!(id.0, n as u64);
            assert_eq!(
                *words,
                format.encode(step, 0).expect("the steps are valid"),
                "step {n}"
            );
        }
    });
}
