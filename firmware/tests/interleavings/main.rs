//! Law: whatever comes in between, the outputs rest when no run goes on, nothing is acted on twice, every run ends, every request is
//! answered in kind, and each trigger has its record or is counted as lost.
//!
//! # Design
//! A search through all that can happen to session, sequencer and what plays their steps: from each [`World`] it goes to all that can
//! follow, until none is new. What happens by itself (work of the box, time, the link) may always happen; a host, a camera, edges of
//! SYNC and mishaps have a budget, so that the search has an end. `RCG_FULL=1` gives them more.

mod engine;
mod world;

use std::collections::HashMap;

use rcg_protocol::{Extent, Micros, Pace, Program, Request, Start};

use engine::STEP;
use world::{Budget, Move, World, fingerprint};

/// Whether the long search is wanted.
fn is_full() -> bool {
    std::env::var_os("RCG_FULL").is_some()
}

/// A state on the way, and what is still to be tried from there.
struct Stop {
    world: Box<World>,
    sum: u64,
    moves: Vec<Move>,
    /// What happened last from there.
    taken: Option<Move>,
    /// Whether nothing happens by itself any more, as far as that was tried.
    rests: bool,
}

/// What was found.
#[derive(Debug, Default)]
struct Found {
    states: usize,
    rests: usize,
}

impl Stop {
    fn new(world: Box<World>, sum: u64, asks: &[Request]) -> Self {
        let mut moves = world.other_moves(asks);
        moves.extend(world.own_moves());
        Self {
            world,
            sum,
            moves,
            taken: None,
            rests: true,
        }
    }
}

/// Tries all that can happen from `world` on.
fn search(world: World, asks: &[Request]) -> Found {
    let mut found = Found::default();
    let sum = fingerprint(&world);
    // Whether a state is still on the way.
    let mut seen = HashMap::from([(sum, true)]);
    let mut way = vec![Stop::new(Box::new(world), sum, asks)];
    while let Some(stop) = way.last_mut() {
        let Some(step) = stop.moves.pop() else {
            found.rests += usize::from(stop.rests);
            if stop.rests
                && let Err(law) = stop
                    .world
                    .check_rest()
                    .and_then(|()| stop.world.clone().check_retry())
            {
                panic!("{law}{}", told(&way));
            }
            seen.insert(stop.sum, false);
            way.pop();
            continue;
        };
        stop.taken = Some(step.clone());
        let before = stop.sum;
        let mut next = stop.world.clone();
        if let Err(law) = next.take(&step) {
            panic!("{law}{}", told(&way));
        }
        let sum = fingerprint(&next);
        stop.rests &= sum == before || !step.is_own();
        match seen.get(&sum) {
            None => {
                seen.insert(sum, true);
                way.push(Stop::new(next, sum, asks));
            }
            Some(true) if sum != before => panic!("it goes on for ever{}", told(&way)),
            Some(_) => {}
        }
    }
    found.states = seen.len();
    found
}

/// What happened on the way.
fn told(way: &[Stop]) -> String {
    let taken = way.iter().filter_map(|stop| stop.taken.as_ref());
    taken.fold(String::new(), |told, step| format!("{told}\n  {step:?}"))
}

/// A table of so many cycles of two steps, and a host that has to be heard every five moments.
fn table(cycles: u32) -> Program {
    Program {
        dead_man: Micros(5000),
        ..Program::new(Extent::Table { steps: 2, cycles })
    }
}

fn append(last: bool) -> Request {
    Request::Append {
        first: 0, // where the schedule ends by then
        steps: [STEP].into_iter().collect(),
        last,
    }
}

/// Tries all that `budget` allows from `world` on, and once more of it in the long search.
fn explore(name: &str, world: World, budget: Budget, asks: &[Request]) {
    let more = u8::from(is_full());
    let budget = Budget {
        asks: budget.asks + more,
        ..budget
    };
    let found = search(world.with(budget), asks);
    println!("{name}: {} states, of which {} rest", found.states, found.rests);
    assert!(found.rests > 10 && found.states > 100, "{name}: {found:?}");
}

#[test]
fn commands_before_between_and_after_runs() {
    let asks = [
        Request::Arm,
        Request::Start,
        Request::Stop,
        Request::Abort,
        Request::Clear,
        Request::Load(table(1)),
        append(false),
        Request::Watch,
    ];
    let budget = Budget {
        asks: 3,
        ..Budget::default()
    };
    explore("commands", World::new(table(1), 2, false, None), budget, &asks);
}

#[test]
fn commands_and_strangers_while_a_table_is_played() {
    let asks = [
        Request::Arm,
        Request::Stop,
        Request::Abort,
        Request::Load(table(1)),
        Request::Status,
    ];
    let budget = Budget {
        asks: 1,
        strangers: 1,
        losses: 1,
        ..Budget::default()
    };
    let world = World::new(table(1), 2, false, None).started();
    explore("strangers", world, budget, &asks);
}

#[test]
fn a_camera_that_errs() {
    let budget = Budget {
        asks: 1,
        camera: 2,
        losses: 1,
        ..Budget::default()
    };
    let world = World::new(table(2), 2, false, None).started();
    explore("camera", world, budget, &[Request::Stop, Request::Abort]);
}

#[test]
fn a_stream_that_may_run_dry() {
    let asks = [append(false), append(true), Request::Stop, Request::Abort];
    let stream = Program {
        dead_man: Micros(5000),
        ..Program::new(Extent::Stream)
    };
    let budget = Budget {
        asks: 2,
        losses: 1,
        ..Budget::default()
    };
    let world = World::new(stream, 2, false, None).started();
    explore("stream", world, budget, &asks);
}

#[test]
fn steps_that_wait_for_sync() {
    for (start, pace) in [
        (Start::OnSync, Pace::EachOnSync),
        (Start::OnSync, Pace::FreeRunning),
    ] {
        let program = Program {
            start,
            pace,
            sync_timeout: Micros(2500),
            ..table(1)
        };
        let budget = Budget {
            asks: 1,
            syncs: 3,
            ..Budget::default()
        };
        let world = World::new(program, 2, false, None).started();
        explore("sync", world, budget, &[Request::Stop, Request::Abort]);
    }
}

#[test]
fn a_series_of_runs() {
    let asks = [
        Request::Stop,
        Request::Abort,
        Request::Arm,
        Request::Start,
        Request::Load(table(1)),
    ];
    let budget = Budget {
        asks: 1,
        losses: 1,
        ..Budget::default()
    };
    let world = World::new(table(1), 2, false, Some(Request::Repeat { runs: 3 })).started();
    explore("series", world, budget, &asks);
}

#[test]
fn a_link_that_is_slow_and_drops() {
    // Fewer than telemetry leaves to answers, as many, and nearly all.
    for waiting in [0, 11, 12, 14] {
        let budget = Budget {
            asks: 1,
            drops: 1,
            ..Budget::default()
        };
        let world = World::new(table(1), 2, false, None).started().slow(waiting);
        explore("link", world, budget, &[Request::Status, Request::Abort]);
    }
}
