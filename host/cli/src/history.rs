//! `rcg history`

use std::fmt::Write as _;
use std::path::PathBuf;

use rcg::base::file_format::{CHART, TABLE};
use rcg::judge::chart::save_all;
use rcg::judge::history::{History, Over};
use rcg::store::whole_file::write_whole;
use serde_json::json;

use crate::Done;
use crate::combine::open;
use crate::failure::Failure;
use crate::output::{Output, to_write};

/// Control chart of a check standard that was measured again and again.
///
/// The value of each measurement is its f over that of all, over the directions that all have and know well. The mean line, lines
/// that warn (2 standard deviations) and call for action (3), the drift, and the measurements that break Western Electric's rules.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Two and more directories of measurements of one sample, with their times in session.json
    #[arg(value_name = "MEASUREMENT", required = true, num_args = 2..)]
    measurements: Vec<PathBuf>,
    /// What values are over: the mean of all, or the first in time
    #[arg(long, value_enum, default_value = "mean")]
    over: Reference,
    /// Also write the charts of all channels, one above the other (.svg, .pdf, .png)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Also write the table (.csv)
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Fail (exit 1) if a measurement breaks a rule; else that is a warning
    #[arg(long)]
    fail_on_action: bool,
}

/// What values are over, on the command line.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Reference {
    /// The mean of all
    Mean,
    /// The first in time
    First,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    if let Some(out) = &args.out {
        to_write(out, CHART)?;
    }
    if let Some(csv) = &args.csv {
        to_write(csv, TABLE)?;
    }
    let over = match args.over {
        Reference::Mean => Over::Mean,
        Reference::First => Over::First,
    };
    let history = History::of(open(&args.measurements.iter().collect::<Vec<_>>())?, over)?;
    if let Some(out) = &args.out {
        save_all(&history.charts("Control chart"), out)?;
    }
    if let Some(csv) = &args.csv {
        write_whole(csv, history.csv().as_bytes())?;
    }
    let value = json!({
        "history": history, "out_of_control": history.is_out_of_control(), "out": args.out, "csv": args.csv,
    });
    if args.fail_on_action && history.is_out_of_control() {
        if !output.is_json() {
            output.print(&value, || text(&history))?;
        }
        let sentence = history.warnings.first().cloned().unwrap_or_default();
        return Err(Failure::Partly(anyhow::anyhow!("{sentence}"), value));
    }
    output.print(&value, || text(&history))?;
    output.warn(&history.warnings);
    Ok(())
}

fn text(history: &History) -> String {
    let mut text = String::new();
    for (channel, lines) in history.lines.iter().enumerate() {
        let drift = lines
            .drift
            .map_or_else(|| "none".to_owned(), |drift| drift.to_string());
        writeln!(
            text,
            "{:6} mean {:.5}, standard deviation {:.3} % (noise {:.3} %), drift {drift}",
            history.colour(channel),
            lines.mean,
            100.0 * lines.standard_deviation,
            100.0 * lines.noise
        )
        .expect("strings take everything");
    }
    text.push_str("\nbegan                 days  f over that of ");
    text.push_str(if history.over == Over::First {
        "the first"
    } else {
        "the mean"
    });
    text.push_str(", by channel (± U, k = 2)\n");
    for (number, point) in history.points.iter().enumerate() {
        let both = point.values.iter().zip(&point.expanded_uncertainties);
        let values: Vec<String> = both
            .map(|(value, half)| format!("{value:.5} ± {half:.5}"))
            .collect();
        writeln!(
            text,
            "{}  {:7.2}  {}  {}",
            point.began,
            point.days,
            values.join(", "),
            point.name
        )
        .expect("strings take everything");
        for signal in history.signals.iter().filter(|signal| signal.number == number) {
            let (words, colour) = (signal.rule.words(), history.colour(signal.channel));
            let space = if colour.is_empty() { "" } else { ": " };
            writeln!(text, "  {colour}{space}{words}, at {:+.1}", signal.deviations)
                .expect("strings take everything");
        }
    }
    text
}
