//! Every command in every state.

use rcg_firmware::sequencer::Sequencer;
use rcg_protocol::State::{Aborted, Armed, Done, Idle, Loaded, Running, Stopped};
use rcg_protocol::{Command, Fault, State};

use crate::{go, load_stream, load_table, play, steps, table};

const COMMANDS: [Command; 6] = [
    Command::Load,
    Command::Append,
    Command::Arm,
    Command::Start,
    Command::Stop,
    Command::Clear,
];

/// A situation, how to come into it, and what is legal there with the state that follows.
struct Situation {
    name: &'static str,
    state: State,
    enter: fn(&mut Sequencer),
    legal: &'static [(Command, State)],
}

const OVER_TABLE: &[(Command, State)] = &[
    (Command::Load, Idle),
    (Command::Arm, Armed),
    (Command::Clear, Idle),
];
const OVER_STREAM: &[(Command, State)] = &[(Command::Load, Idle), (Command::Clear, Idle)];

/// All states, with a table and with a stream. In each, `Append` sends steps 2 and 3.
const SITUATIONS: &[Situation] = &[
    Situation {
        name: "nothing loaded",
        state: Idle,
        enter: |_| {},
        legal: &[(Command::Load, Idle), (Command::Clear, Idle)],
    },
    Situation {
        name: "a table that the next steps complete",
        state: Idle,
        enter: |s| {
            s.load(table(4, 1)).unwrap();
            s.append(0, &steps(0, 2), false).unwrap();
        },
        legal: &[
            (Command::Load, Idle),
            (Command::Append, Loaded),
            (Command::Clear, Idle),
        ],
    },
    Situation {
        name: "a table that wants yet more steps",
        state: Idle,
        enter: |s| {
            s.load(table(5, 1)).unwrap();
            s.append(0, &steps(0, 2), false).unwrap();
        },
        legal: &[
            (Command::Load, Idle),
            (Command::Append, Idle),
            (Command::Clear, Idle),
        ],
    },
    Situation {
        name: "a whole table",
        state: Loaded,
        enter: load_table,
        legal: &[
            (Command::Load, Idle),
            (Command::Arm, Armed),
            (Command::Clear, Idle),
        ],
    },
    Situation {
        name: "an open stream",
        state: Loaded,
        enter: |s| load_stream(s, false),
        legal: &[
            (Command::Load, Idle),
            (Command::Append, Loaded),
            (Command::Arm, Armed),
            (Command::Clear, Idle),
        ],
    },
    Situation {
        name: "a whole stream",
        state: Loaded,
        enter: |s| load_stream(s, true),
        legal: &[
            (Command::Load, Idle),
            (Command::Arm, Armed),
            (Command::Clear, Idle),
        ],
    },
    Situation {
        name: "an armed table",
        state: Armed,
        enter: |s| {
            load_table(s);
            s.arm().unwrap();
        },
        legal: &[(Command::Start, Running)],
    },
    Situation {
        name: "an armed open stream",
        state: Armed,
        enter: |s| {
            load_stream(s, false);
            s.arm().unwrap();
        },
        legal: &[(Command::Append, Armed), (Command::Start, Running)],
    },
    Situation {
        name: "a running table",
        state: Running,
        enter: |s| {
            load_table(s);
            go(s);
        },
        legal: &[(Command::Stop, Running)],
    },
    Situation {
        name: "a running open stream",
        state: Running,
        enter: |s| {
            load_stream(s, false);
            go(s);
        },
        legal: &[(Command::Append, Running), (Command::Stop, Running)],
    },
    Situation {
        name: "a running whole stream",
        state: Running,
        enter: |s| {
            load_stream(s, true);
            go(s);
        },
        legal: &[(Command::Stop, Running)],
    },
    Situation {
        name: "a table that is done",
        state: Done,
        enter: |s| {
            load_table(s);
            go(s);
            play(s);
            s.drained();
        },
        legal: OVER_TABLE,
    },
    Situation {
        name: "a stream that is done",
        state: Done,
        enter: |s| {
            load_stream(s, true);
            go(s);
            play(s);
            s.drained();
        },
        legal: OVER_STREAM,
    },
    Situation {
        name: "a stopped table",
        state: Stopped,
        enter: |s| {
            load_table(s);
            go(s);
            s.stop().unwrap();
            s.drained();
        },
        legal: OVER_TABLE,
    },
    Situation {
        name: "a stopped stream",
        state: Stopped,
        enter: |s| {
            load_stream(s, false);
            go(s);
            s.stop().unwrap();
            s.drained();
        },
        legal: OVER_STREAM,
    },
    Situation {
        name: "an aborted table",
        state: Aborted,
        enter: |s| {
            load_table(s);
            go(s);
            assert!(s.abort());
        },
        legal: OVER_TABLE,
    },
    Situation {
        name: "an aborted stream",
        state: Aborted,
        enter: |s| {
            load_stream(s, false);
            go(s);
            assert!(s.abort());
        },
        legal: OVER_STREAM,
    },
    Situation {
        name: "a table whose engine failed",
        state: State::Fault,
        enter: |s| {
            load_table(s);
            go(s);
            assert!(s.fail(Fault::Engine));
        },
        legal: OVER_TABLE,
    },
    Situation {
        name: "a stream that ran dry",
        state: State::Fault,
        enter: |s| {
            load_stream(s, false);
            go(s);
            play(s);
            s.drained();
        },
        legal: OVER_STREAM,
    },
];

fn apply(s: &mut Sequencer, command: Command) -> Result<(), Fault> {
    match command {
        Command::Load => s.load(table(3, 1)),
        Command::Append => s.append(2, &steps(2, 2), false),
        Command::Arm => s.arm().map(|_| ()),
        Command::Start => s.start(),
        Command::Stop => s.stop(),
        Command::Clear => s.clear(),
        Command::Watch | Command::Boot | Command::Keep | Command::Store => {
            unreachable!("these are the session's")
        }
    }
}

#[test]
fn every_command_in_every_state_does_what_the_table_says_or_is_refused_by_name() {
    for situation in SITUATIONS {
        for command in COMMANDS {
            let mut s = Sequencer::new();
            (situation.enter)(&mut s);
            assert_eq!(s.state(), situation.state, "{}", situation.name);
            let before = (s.run(), s.room(), s.steps_done(), s.fault());
            let result = apply(&mut s, command);
            let context = format!("{command} with {}", situation.name);
            if let Some(&(_, next)) = situation.legal.iter().find(|(legal, _)| *legal == command) {
                assert_eq!(result, Ok(()), "{context}");
                assert_eq!(s.state(), next, "{context}");
            } else {
                let state = situation.state;
                assert_eq!(result, Err(Fault::Refused { command, state }), "{context}");
                let after = (s.run(), s.room(), s.steps_done(), s.fault());
                assert_eq!((s.state(), after), (state, before), "{context}");
            }
        }
    }
}

#[test]
fn abort_and_failure_end_what_is_armed_or_running_and_nothing_else() {
    for situation in SITUATIONS {
        let live = matches!(situation.state, Armed | Running);
        let mut s = Sequencer::new();
        (situation.enter)(&mut s);
        let fault = s.fault();
        assert_eq!(s.abort(), live, "{}", situation.name);
        assert_eq!(s.state(), if live { Aborted } else { situation.state });
        assert_eq!(s.fault(), fault);
        assert!(s.next_step(|_| ()).is_none());

        let mut s = Sequencer::new();
        (situation.enter)(&mut s);
        assert_eq!(s.fail(Fault::HostLost), live, "{}", situation.name);
        if live {
            assert_eq!((s.state(), s.fault()), (State::Fault, Some(Fault::HostLost)));
        } else {
            assert_eq!((s.state(), s.fault()), (situation.state, fault));
        }
    }
}

#[test]
fn a_run_that_is_over_does_not_end_again() {
    for situation in SITUATIONS.iter().filter(|s| s.state != Running) {
        let mut s = Sequencer::new();
        (situation.enter)(&mut s);
        let fault = s.fault();
        assert_eq!(s.drained(), situation.state, "{}", situation.name);
        assert_eq!(s.fault(), fault);
    }
}
