//! The table of faults: what comes of each, and which test shows it. `docs/faults.md` is this table.
//!
//! `RCG_WRITE=1 cargo test -p rcg-tests --test fault_matrix` writes that file anew.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// What comes of a fault.
#[derive(Clone, Copy)]
enum Comes {
    /// The same BRDF to the bit.
    Recovered,
    /// Outputs at rest, one sentence; `--resume` completes to the same bits.
    Stopped,
    /// One sentence; nothing that was there is changed.
    Refused,
    /// What the sentence says, and what nobody is told of.
    Partly(&'static str),
}

/// A fault.
struct Row {
    fault: &'static str,
    comes: Comes,
    /// How.
    how: &'static str,
    /// File from the root of the repository, and the test in it.
    tests: &'static [(&'static str, &'static str)],
}

const MIXED: (&str, &str) = (
    "tests/tests/mixed_faults.rs",
    "no_frame_is_taken_for_one_of_another_pattern",
);
const PAIRING: &str = "host/src/capture/pairing/tests.rs";
const CHAIN: &str = "tests/tests/physics/whole_chain.rs";
const KILLED: &str = "host/cli/tests/cli/killed.rs";
const SAFETY: &str = "hil/tests/trials/safety.rs";
const TABLE: &str = "hil/tests/trials/table.rs";
const DAMAGED: &str = "tests/tests/damaged_files.rs";
const HOST: &str = "host/cli/tests/cli/faulty_host.rs";

use Comes::{Partly, Recovered, Refused, Stopped};

const ROWS: &[Row] = &[
    Row {
        fault: "serial bytes lost, flipped, duplicated, delayed",
        comes: Recovered,
        how: "frames of the wire have a CRC-32; requests are repeated under their number and executed once; a lost record is an exposure \
              that is taken again",
        tests: &[
            ("tests/tests/at_most_once.rs", "any_commands_over_any_line"),
            (
                "tests/tests/telemetry.rs",
                "on_a_bad_line_what_comes_is_true_and_in_order_and_what_does_not_is_a_gap",
            ),
            (
                "protocol/tests/properties.rs",
                "any_single_flipped_bit_is_rejected",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "trigger box reset in mid-run",
        comes: Stopped,
        how: "its lines are pulled to rest; the host's session is unknown to it",
        tests: &[(SAFETY, "watchdog_bite"), (SAFETY, "outputs_rest_at_boot"), MIXED],
    },
    Row {
        fault: "trigger box unplugged",
        comes: Stopped,
        how: "the dead-man time ends its run, the host is told that the connection has ended",
        tests: &[
            (SAFETY, "pulled_cable"),
            (
                "tests/tests/disconnects.rs",
                "cuts_at_random_over_bad_lines_end_in_a_session_that_works",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "another box answers after replugging",
        comes: Recovered,
        how: "a session begins with who answers, and images depend on the schedule's times, not on the box",
        tests: &[
            (
                "tests/tests/wires.rs",
                "a_measurement_has_the_same_bits_behind_a_port",
            ),
            (
                "tests/tests/strangers.rs",
                "another_protocol_version_or_schema_is_named_and_asked_nothing_else",
            ),
        ],
    },
    Row {
        fault: "camera drops frames, ignores triggers, sends frames twice",
        comes: Recovered,
        how: "a frame belongs to a strobe by number and time-stamp; what is missing is taken again",
        tests: &[
            (
                CHAIN,
                "missed_triggers_dropped_and_doubled_frames_change_nothing_but_the_tally",
            ),
            (
                TABLE,
                "frames_that_are_lost_or_doubled_on_the_network_change_no_bit",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "camera sends frames out of order",
        comes: Recovered,
        how: "frames are taken in the order of their time-stamps",
        tests: &[
            (PAIRING, "frames_that_overtake_each_other_are_where_they_belong"),
            MIXED,
        ],
    },
    Row {
        fault: "camera exposes without a trigger",
        comes: Recovered,
        how: "a strobe that no trigger explains is told; where that word is lost, what does not fit is taken again",
        tests: &[
            (
                PAIRING,
                "doubles_orphans_and_spurious_exposures_are_counted_and_harmless",
            ),
            (
                PAIRING,
                "an_exposure_before_the_first_that_nobody_was_told_of_moves_no_frame",
            ),
            ("hil/tests/trials/strobes.rs", "spurious_strobes_are_named"),
            MIXED,
        ],
    },
    Row {
        fault: "camera dies",
        comes: Stopped,
        how: "the run is aborted",
        tests: &[
            (
                TABLE,
                "a_camera_that_dies_ends_the_run_and_a_resumed_one_completes_it",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "camera returns with another id base",
        comes: Recovered,
        how: "a run whose frames would fit other strobes as well, or leaves one over, counts as none and is taken again",
        tests: &[
            (PAIRING, "a_camera_that_counts_from_elsewhere_moves_no_frame"),
            ("hil/tests/gige/frames.rs", "ids_wrap_jump_and_begin_again"),
            MIXED,
        ],
    },
    Row {
        fault: "camera's clock drifts by 200 ppm",
        comes: Recovered,
        how: "pairing follows the drift",
        tests: &[
            (
                TABLE,
                "frames_that_are_lost_or_doubled_on_the_network_change_no_bit",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "camera's clock jumps",
        comes: Recovered,
        how: "number and time-stamp contradict each other: the run is taken again",
        tests: &[
            (PAIRING, "number_against_time_stamp_is_disputed"),
            (PAIRING, "a_jump_of_the_clock_at_a_lost_record_moves_no_frame"),
            (
                "host/src/capture/camera_clock.rs",
                "jumps_are_named_where_they_are_and_change_nothing_else",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "projector repeats or skips a frame",
        comes: Partly(
            "recovered where a picture makes an edge of SYNC (`window`, or a photodiode); a projector that is triggered, and skips a \
             trigger without an edge of its own at SYNC, is **not noticed**",
        ),
        how: "display and box must agree on the time between two pictures, else the exposure is taken again",
        tests: &[
            (
                "host/src/capture/led.rs",
                "frames_that_are_shown_again_or_left_out_are_told_apart",
            ),
            ("hil/tests/trials/sync.rs", "missing_vsync_is_flagged"),
        ],
    },
    Row {
        fault: "projector loses its patterns or hangs",
        comes: Stopped,
        how: "it is asked before each run; a DLPC900 is set to another mode and back once",
        tests: &[
            (
                "hil/src/dlpc900/tests/mod.rs",
                "a_unit_that_hangs_is_stopped_set_to_another_mode_and_back_once",
            ),
            (
                "hil/tests/trials/window.rs",
                "a_window_that_is_closed_or_not_seen_ends_the_run_and_a_resumed_one_completes_it",
            ),
            MIXED,
        ],
    },
    Row {
        fault: "disk full",
        comes: Stopped,
        how: "a segment is whole with its seal or not there",
        tests: &[
            (
                HOST,
                "a_disk_that_is_full_or_becomes_read_only_ends_the_run_and_a_resumed_one_completes_it",
            ),
            (
                "host/src/store/raw/tests/mod.rs",
                "a_disk_that_fills_up_is_told_and_never_mixes_old_and_new",
            ),
            ("host/src/store/brdf_file/tests/mod.rs", "a_full_disk_is_told"),
        ],
    },
    Row {
        fault: "disk slow",
        comes: Recovered,
        how: "three segments are in memory, then the box waits between two",
        tests: &[(
            "host/src/capture/ring.rs",
            "nothing_is_lost_or_turned_round_however_slow_either_side_is",
        )],
    },
    Row {
        fault: "disk read-only in mid-run",
        comes: Stopped,
        how: "as one that is full",
        tests: &[(
            HOST,
            "a_disk_that_is_full_or_becomes_read_only_ends_the_run_and_a_resumed_one_completes_it",
        )],
    },
    Row {
        fault: "disk removed, folder gone in mid-run",
        comes: Stopped,
        how: "what was captured went with it: the same command begins again",
        tests: &[(HOST, "a_folder_that_goes_in_mid_run_ends_it_in_a_sentence")],
    },
    Row {
        fault: "host stalls for 2 s",
        comes: Stopped,
        how: "one that is shorter than the box's dead-man time costs nothing; a longer one ends the run, which is told, and `--resume` completes it",
        tests: &[
            (SAFETY, "a_host_that_suspends"),
            ("hil/tests/trials/link.rs", "a_host_that_sleeps"),
            MIXED,
        ],
    },
    Row {
        fault: "host killed",
        comes: Stopped,
        how: "the dead-man time ends the box's run; files have their names when they are whole",
        tests: &[
            (KILLED, "killed_at_any_time_it_still_comes_to_the_same_bytes"),
            (
                "host/cli/tests/cli/killed_anywhere.rs",
                "whatever_is_killed_leaves_nothing_that_looks_whole_and_comes_to_the_same_bytes",
            ),
            (SAFETY, "silence_ends_the_run"),
        ],
    },
    Row {
        fault: "host's clock set back by an hour",
        comes: Recovered,
        how: "waiting goes by a clock that only runs forward; times are written down and decide nothing",
        tests: &[(HOST, "a_clock_that_is_set_back_changes_no_value")],
    },
    Row {
        fault: "two commands on one directory",
        comes: Refused,
        how: "the second is told which process writes there",
        tests: &[
            (
                "host/cli/tests/cli/locks.rs",
                "of_two_writers_one_is_refused_whichever_they_are",
            ),
            (
                "host/cli/tests/cli/parts.rs",
                "parts_keep_the_whole_out_and_the_whole_keeps_parts_out",
            ),
        ],
    },
    Row {
        fault: "two commands on one box",
        comes: Stopped,
        how: "the box serves the session that was opened last and tells the other; a serial port is opened by one alone",
        tests: &[
            (
                "tests/tests/takeover.rs",
                "a_second_client_takes_over_and_the_first_is_told",
            ),
            ("tests/tests/wires.rs", "a_box_that_is_still_busy_is_taken_over"),
            (
                "host/cli/tests/cli/bad_trigger_box.rs",
                "a_port_that_another_program_holds_is_not_called_absent",
            ),
        ],
    },
    Row {
        fault: "a file of the measurement cut short, altered in one bit, gone",
        comes: Partly("recovered where the frames tell what stood there, else refused by the file's name"),
        how: "sums of rig, plan and calibration in the manifest, a CRC-32C in each chunk, a seal over each segment, a sum over attributes",
        tests: &[
            (
                DAMAGED,
                "a_damaged_file_is_recovered_or_named_and_never_changes_a_value",
            ),
            (DAMAGED, "a_result_is_read_as_it_was_written_or_not_at_all"),
            (
                "host/src/store/raw/tests/mod.rs",
                "a_flipped_byte_anywhere_ends_the_whole_prefix_and_is_named",
            ),
        ],
    },
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The content of `docs/faults.md`.
fn page() -> String {
    let mut text = String::from(
        "# What goes wrong, and what comes of it\n\n\
         *Recovered*: the same BRDF to the bit. *Stopped*: outputs at rest, one sentence, and `--resume` completes to the same bits. *Refused*: one \
         sentence, and nothing has changed. Each row has a test; the table itself stands in `tests/tests/fault_matrix.rs`.\n\n\
         | fault | outcome | how | tests |\n|---|---|---|---|\n",
    );
    for row in ROWS {
        let comes = match row.comes {
            Recovered => "recovered",
            Stopped => "stopped",
            Refused => "refused",
            Partly(words) => words,
        };
        let tests: Vec<String> = row
            .tests
            .iter()
            .map(|(file, name)| format!("[{name}](../{file})"))
            .collect();
        let (fault, how, tests) = (row.fault, row.how, tests.join(", "));
        writeln!(text, "| {fault} | {comes} | {how} | {tests} |").unwrap();
    }
    text += "\nMany more at once: `RCG_EXPOSURES=1000000 cargo test --release -p rcg-tests --test mixed_faults -- --nocapture` simulates a million \
             exposures with all kinds mixed, `RCG_KILLS=1000 cargo test -p rcg-cli --test cli killed_anywhere -- --nocapture` kills a thousand \
             times, `RCG_FULL=1` damages every file in every way.\n";
    text
}

#[test]
fn every_fault_has_a_test_and_the_page_says_the_same() {
    for row in ROWS {
        assert!(!row.tests.is_empty(), "{}", row.fault);
        for (file, name) in row.tests {
            let source =
                fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
            assert!(
                source.contains(&format!("fn {name}(")),
                "{}: no test {name} in {file}",
                row.fault
            );
        }
    }
    let path = root().join("docs/faults.md");
    if std::env::var_os("RCG_WRITE").is_some() {
        fs::write(&path, page()).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == page(),
        "docs/faults.md is not the table: RCG_WRITE=1 writes it anew"
    );
}
