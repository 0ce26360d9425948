//! `rcg combine`

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rcg::assemble::combine::{Combined, combine};
use rcg::judge::repeats::{Member, Repeat, RepeatError, Repeats, Scatter};

use crate::Done;
use crate::failure::Failure;
use crate::fill::brdf_of;
use crate::output::{Output, table};

/// Combine repeated measurements of one sample into their mean.
///
/// Directions, cells and channels are the same, and so is where φ = 0 lies. Noise averages out; what is wrong with a calibration or a
/// standard that repeats have in common does not. Where they scatter by more than they state, the uncertainty is as much larger.
/// Values that were filled in have no part. A measurement among three and more that is not as the others is refused.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Two and more brdf.zarr or directories of measurements
    #[arg(value_name = "BRDF", required = true, num_args = 2..)]
    brdfs: Vec<PathBuf>,
    /// The brdf.zarr to write
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    /// Leave out a measurement, named as among those given or by the last part of its path; may be repeated
    #[arg(long, value_name = "NAME")]
    without: Vec<String>,
    /// Take measurements that are not as the others too; the uncertainty becomes as much larger
    #[arg(long)]
    keep_outliers: bool,
}

pub(crate) fn run(args: &Args, output: &Output) -> Done {
    let taken = taken(&args.brdfs, &args.without)?;
    let repeats = open(&taken)?;
    let combined = combine(&repeats, &args.out, args.keep_outliers, output)?;
    output.print(&combined, || text(&combined))?;
    output.warn(&combined.repeats.warnings);
    Ok(())
}

/// Opens what users name.
pub(crate) fn open(paths: &[&PathBuf]) -> Result<Vec<Repeat>, RepeatError> {
    paths
        .iter()
        .map(|path| Repeat::open(&path.display().to_string(), &brdf_of(path)))
        .collect()
}

/// Those of `all` that are not named to be left `out`.
fn taken<'a>(all: &'a [PathBuf], out: &[String]) -> Result<Vec<&'a PathBuf>, Failure> {
    let is = |path: &Path, name: &str| {
        path == Path::new(name) || path.file_name().is_some_and(|last| last == name)
    };
    let given = || {
        all.iter()
            .map(|path| path.display().to_string())
            .collect::<Vec<_>>()
            .join(", ")
    };
    for name in out {
        let named = all.iter().filter(|path| is(path, name)).count();
        if named != 1 {
            let found = if named == 0 { "none" } else { "several" };
            return Err(Failure::input(format!(
                "--without {name}: expected the name of one of {}, found {found} of that name",
                given()
            )));
        }
    }
    let left: Vec<&PathBuf> = all
        .iter()
        .filter(|path| !out.iter().any(|name| is(path, name)))
        .collect();
    if left.len() < 2 {
        return Err(Failure::input(format!(
            "--without: expected at least 2 measurements to be left of {}, found {}",
            given(),
            left.len()
        )));
    }
    Ok(left)
}

pub(crate) fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "none".to_owned(), |share| format!("{:.3} %", 100.0 * share))
}

/// A departure by channel.
fn departures(member: &Member) -> String {
    let each = member.departures.iter().map(|one| {
        one.map_or_else(
            || "none".to_owned(),
            |one| {
                format!(
                    "{:+.3} ± {:.3} %",
                    100.0 * one.relative,
                    100.0 * one.standard_uncertainty
                )
            },
        )
    });
    each.collect::<Vec<_>>().join(", ")
}

fn text(combined: &Combined) -> String {
    let found = &combined.repeats;
    let which = |is_one: bool| {
        if is_one {
            "the same in all"
        } else {
            "not known to be the same in all"
        }
    };
    let counts: Vec<String> = (1..)
        .zip(&found.by_count)
        .filter(|(_, pairs)| **pairs > 0)
        .map(|(count, pairs)| format!("{pairs} by {count}"))
        .collect();
    let counts = if counts.is_empty() {
        "none".to_owned()
    } else {
        counts.join(", ")
    };
    let mut lines = vec![
        ("measurements", found.members.len().to_string()),
        ("pairs measured", counts),
        ("calibration", which(found.one_calibration).to_owned()),
        ("standard", which(found.one_standard).to_owned()),
    ];
    if found.drift.is_empty() {
        lines.push(("drift", "none: not all have a date, or all the same".to_owned()));
    }
    let names = ["drift, red", "drift, green", "drift, blue"];
    let names = if found.drift.len() > 1 {
        &names[..]
    } else {
        &["drift"]
    };
    for (name, drift) in names.iter().zip(&found.drift) {
        lines.push((name, drift.to_string()));
    }
    let mut text = table(&lines);
    text.push_str("\nmeasurement, against the mean of all (k = 1, without what they have in common)\n");
    for member in &found.members {
        let began = member.began.as_deref().unwrap_or("without a date");
        writeln!(text, "{}  {began}  {}", member.name, departures(member)).expect("strings take everything");
    }
    text.push_str(&scatter(found));
    for outlier in &found.outliers {
        let name = &found.members[outlier.number].name;
        writeln!(text, "outlier: {name}, {}", found.told(outlier)).expect("strings take everything");
    }
    text
}

/// The table of regions: of each the channel that scatters most against what it states.
fn scatter(found: &Repeats) -> String {
    let mut text = "\nregion                          mean f (1/sr)  stated σ   its noise  observed scatter  over noise\n".to_owned();
    for rows in found.scatter.chunk_by(|a, b| a.region == b.region) {
        let size = |one: &Scatter| one.ratio.or(one.scatter).unwrap_or(0.0);
        let worst = rows.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
        let Some(one) = worst else { continue };
        let ratio = one
            .ratio
            .map_or_else(|| "none".to_owned(), |ratio| format!("{ratio:.2}"));
        let larger = if rows.iter().any(|one| one.is_larger) {
            "  more than stated"
        } else {
            ""
        };
        writeln!(
            text,
            "{:30}  {:>13.4e}  {:>8}  {:>10}  {:>16}  {ratio:>10}{larger}",
            one.region.name(),
            one.mean,
            percent(one.standard_uncertainty),
            percent(one.noise),
            percent(one.scatter)
        )
        .expect("strings take everything");
    }
    text
}
