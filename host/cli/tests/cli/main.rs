//! The `rcg` command as a user meets it: what it answers, how it refuses, and what it leaves behind.
//!
//! # Design
//! Every test runs the real binary as its own process in a directory of its own. Refusals are checked as a whole:
//! exit code, one sentence on stderr that names place, expected and found, nothing on stdout but the JSON object
//! that was asked for, nothing new on disk.

// Counts, and numbers that the command was given, come back exactly.
#![allow(clippy::float_cmp)]

mod adaptive;
mod answers;
mod bad_arguments;
mod bad_brdf;
mod bad_calibrations;
mod bad_lines;
mod bad_places;
mod bad_plans;
mod bad_rigs;
mod bad_samples;
mod bad_studies;
#[cfg(target_os = "linux")]
mod bad_trigger_box;
mod bad_values;
mod bands;
mod benches;
mod brackets;
mod budgets;
mod by_hand;
mod calibrated_first;
mod calibrations;
mod cameras;
#[cfg(feature = "collection")]
mod collections;
mod command;
mod commands;
mod directions;
mod estimates;
mod exports;
mod faults_on_purpose;
#[cfg(target_os = "linux")]
mod faulty_host;
mod fits;
mod further_lines;
mod grids;
mod identity;
mod judge;
#[cfg(unix)]
mod killed;
#[cfg(unix)]
mod killed_anywhere;
mod light;
mod lineage;
mod locks;
#[cfg(unix)]
mod matrix;
mod multiplexed;
mod no_data;
mod outputs;
mod parts;
mod pictures;
mod pipes;
mod real_rigs;
mod repeats;
mod spots;
mod studies;
mod tensor_file;
mod texts;
mod tree;
mod trigger_box;
mod turns;
mod values;
mod virtual_rig;
mod worlds;
