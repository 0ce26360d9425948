//! The whole chain from a known BRDF, by the library: what comes out is what was put in, within what is stated. One program, so that a
//! long test leaves no core idle.

mod budget;
mod fill;
mod high_dynamic_range;
mod off_sample;
mod uncertainty;
mod whole_chain;
