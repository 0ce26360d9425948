//! Laws of the session: every request is executed at most once, and everything is counted.

mod bench;
mod conversation;
mod endings;
mod halting;
mod lines;
mod telemetry;
