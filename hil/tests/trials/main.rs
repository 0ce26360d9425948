//! Trials of the firmware binary on a device under test; see the README of this crate.
//!
//! Names are `device::topic::what`. Every figure is printed at the end and written to `target/hil-figures.json` and `.txt`.

mod camera_faults;
mod cameras;
mod chain;
mod image;
mod limits;
mod lines;
mod link;
mod runs;
mod safety;
mod steps;
mod stream;
mod strobes;
mod sync;
mod table;
mod timing;
#[cfg(feature = "window")]
mod window;

use std::fs;
use std::process::ExitCode;
use std::sync::Arc;

use libtest_mimic::{Arguments, Completion, Trial};
use rcg_hil::bench::{Bench, Need, Outcome};
use rcg_hil::dut::Dut;
use rcg_hil::figures::Figures;
use rcg_hil::places;

/// One trial of a device.
struct Spec {
    topic: &'static str,
    what: &'static str,
    needs: &'static [Need],
    work: fn(&mut Bench) -> Outcome,
}

/// Trials as `what: needs => function`, in the order in which they are listed.
macro_rules! trials {
    ($topic:literal: $($what:ident [$($need:ident)*]),* $(,)?) => {
        /// The trials of this topic.
        pub(crate) const TRIALS: &[crate::Spec] = &[$(crate::Spec {
            topic: $topic,
            what: stringify!($what),
            needs: &[$(rcg_hil::bench::Need::$need),*],
            work: $what,
        }),*];
    };
}
pub(crate) use trials;

impl Spec {
    fn of(&'static self, dut: &Dut, figures: &Arc<Figures>) -> Trial {
        let name = format!("{}::{}::{}", dut.name, self.topic, self.what);
        let lacks = self.needs.iter().find_map(|&need| dut.lacks(need));
        let reason = lacks.map(str::to_owned).or_else(|| dut.absent());
        let (dut, trial, figures) = (dut.clone(), name.clone(), Arc::clone(figures));
        Trial::ignorable_test(name, move || match reason {
            Some(reason) => Ok(Completion::ignored_with(reason)),
            None => Bench::run(&dut, &trial, &figures, self.work).map(|()| Completion::Completed),
        })
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let duts = match Dut::chosen() {
        Ok(duts) => duts,
        Err(error) => {
            eprintln!("HIL_DUT: {error}");
            return ExitCode::from(2);
        }
    };
    let figures = Arc::new(Figures::default());
    let topics = [
        timing::TRIALS,
        limits::TRIALS,
        lines::TRIALS,
        sync::TRIALS,
        strobes::TRIALS,
        safety::TRIALS,
        link::TRIALS,
        stream::TRIALS,
        chain::TRIALS,
        table::TRIALS,
        cameras::TRIALS,
        camera_faults::TRIALS,
        image::TRIALS,
    ];
    #[cfg(feature = "window")]
    let topics = topics.into_iter().chain([window::TRIALS]);
    let specs = topics.into_iter().flatten();
    let trials = specs.flat_map(|spec| {
        let duts = duts.iter().filter(|dut| dut.takes(spec.topic));
        duts.map(|dut| spec.of(dut, &figures))
    });
    let conclusion = libtest_mimic::run(&arguments, trials.collect());

    let table = figures.table();
    if !table.is_empty() {
        println!("{table}");
        let path = places::target().join("hil-figures");
        let written = fs::write(path.with_extension("txt"), &table)
            .and_then(|()| figures.write(&path.with_extension("json")));
        if let Err(error) = written {
            eprintln!("{}: {error}", path.display());
        }
    }
    conclusion.exit_code()
}
