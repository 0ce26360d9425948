//! `rcg assemble`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rcg::assemble::Assembled;
use rcg::assemble::share::{Part, Share};
use rcg::capture::directory::Measurement;
use rcg::judge::differences::Differences;
use rcg::measure::again::{Again, assemble_again};
use rcg::measure::assemble_share;
use rcg::measure::report::{dynamic_range, quantile};

use crate::Done;
use crate::output::Output;

/// Turn the captured frames of a measurement into brdf.zarr.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the measurement
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// The brdf.zarr to write in place of the measurement's own one, which stays as it is
    #[arg(long, value_name = "OUT")]
    out: Option<PathBuf>,
    /// Take the calibration in this directory into account in place of the one that the measurement was begun with; its geometry must be
    /// the same, by which the patterns were lit
    #[arg(long, value_name = "DIR", requires = "out")]
    calibration: Option<PathBuf>,
    /// Fuse each pixel with what its surroundings say of it, where the image is smooth, or leave it as it is [default: as the measurement was
    /// begun]
    #[arg(long, value_name = "on|off", value_parser = ["on", "off"], requires = "out")]
    estimate: Option<String>,
    /// Keep every bit of f and its standard uncertainty [default: as the measurement was begun]
    #[arg(long)]
    lossless: bool,
    /// Make part K of N (whole chunks of incident directions) in a process of its own: in any order, at the same time, on any computer that has
    /// the disk; --finish puts the parts together
    #[arg(long, value_name = "K/N", conflicts_with = "finish")]
    part: Option<Part>,
    /// Put the parts together that were made with --part, once all are there; the result is that of one process to the bit
    #[arg(long)]
    finish: bool,
}

impl Args {
    fn share(&self) -> Share {
        match self.part {
            Some(part) => Share::Part(part),
            None if self.finish => Share::Finish,
            None => Share::Whole,
        }
    }
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(out) = &args.out {
        return again(args, out, output);
    }
    let mut measurement = match args.part {
        Some(_) => Measurement::open_together(&args.dir)?,
        None => Measurement::open_to_write(&args.dir)?,
    };
    measurement.plan.request.lossless |= args.lossless;
    if args.part.is_none() {
        output.log_into(measurement.dir());
    }
    let assembled = assemble_share(&measurement, args.share(), output)?;
    output.print(&assembled, || {
        args.text(&assembled, &measurement.path("brdf.zarr"))
    })?;
    warn(args, &assembled, output);
    Ok(())
}

/// Assembles elsewhere, perhaps with another calibration.
fn again(args: &Args, out: &Path, output: &Output) -> Done {
    let mut measurement = Measurement::open(&args.dir)?;
    let request = &mut measurement.plan.request;
    request.lossless |= args.lossless;
    if let Some(estimate) = &args.estimate {
        request.estimate = estimate == "on";
    }
    let again = assemble_again(
        &measurement,
        args.calibration.as_deref(),
        out,
        args.share(),
        output,
    )?;
    output.print(&again, || {
        let compared = if args.part.is_some() {
            String::new()
        } else {
            compared(&again)
        };
        args.text(&again.assembled, out) + &compared
    })?;
    warn(args, &again.assembled, output);
    Ok(())
}

fn warn(args: &Args, assembled: &Assembled, output: &Output) {
    if assembled.measured == 0 && args.part.is_none() {
        output.warn(&["nothing was measured: no sample has a value".to_owned()]);
    }
}

impl Args {
    fn text(&self, assembled: &Assembled, path: &Path) -> String {
        let of = self.part.map_or(String::new(), |part| format!("part {part} of "));
        format!(
            "{} incident directions, {} samples measured, {} saturated, dynamic range {}: {of}{}\n",
            assembled.directions,
            assembled.measured,
            assembled.saturated,
            dynamic_range(assembled.dynamic_range),
            path.display()
        )
    }
}

/// What was taken into account, and what that changed.
fn compared(again: &Again) -> String {
    let sum = |sum: &Option<String>| {
        sum.as_ref()
            .map_or("none".to_owned(), |sum| format!("SHA-256 {sum:.12}"))
    };
    let (taken, own) = (&again.calibration_sha256, &again.own_calibration_sha256);
    let before = if taken == own {
        "the measurement's own".to_owned()
    } else {
        format!("the measurement's own: {}", sum(own))
    };
    let mut text = format!("calibration: {} ({before})\n", sum(taken));
    match &again.differences {
        None => text.push_str("differences: none to state, the measurement has no result of its own\n"),
        Some(found) => {
            writeln!(text, "differences to {}", described(found)).expect("strings take everything");
        }
    }
    text
}

fn described(found: &Differences) -> String {
    let percent =
        |share: Option<f64>| share.map_or("none".to_owned(), |share| format!("{:.2} %", 100.0 * share));
    let largest = found.largest.filter(|largest| largest.sigmas > 0.0);
    let largest = largest.map_or_else(String::new, |largest| {
        let direction = |[theta, phi]: [f64; 2]| format!("({theta:.1}°, {phi:.1}°)");
        format!(
            "; the largest is {:.2} of its σ ({}) from {} to {}",
            largest.sigmas,
            percent(largest.relative),
            direction(largest.incident_deg),
            largest.outgoing_deg.map_or("the horizon".to_owned(), direction)
        )
    });
    format!(
        "its own result: median {}, sum × {}, {} beyond its uncertainty (k = 2){largest}; of {} pairs of directions {} came, {} went",
        quantile(found.median_relative),
        found
            .scale
            .map_or("none".to_owned(), |scale| format!("{scale:.5}")),
        percent(found.beyond_k2_share),
        found.pairs,
        percent(found.came_share),
        percent(found.went_share)
    )
}
