//! `rcg collection`
//!
//! # Design
//! | file | does |
//! |---|---|
//! | `catalogue` | the file `collection.sqlite`: its columns, rows in and out |
//! | `entry` | what the catalogue has of a measurement |
//! | `content` | sizes, times and SHA-256 of a result: has it changed? |
//! | `clause` | what may stand behind `--where` and `--sort` |
//! | `add`, `status`, `query`, `page` | the commands |
//!
//! The catalogue holds nothing that the measurements do not hold: who loses it makes it again with `init` and `add`. A row is written in one
//! transaction, so that several processes may add at the same time, and a killed one leaves whole rows.

#[cfg(feature = "collection")]
mod add;
#[cfg(feature = "collection")]
mod catalogue;
#[cfg(feature = "collection")]
mod clause;
#[cfg(feature = "collection")]
mod content;
#[cfg(feature = "collection")]
mod entry;
#[cfg(feature = "collection")]
mod page;
#[cfg(feature = "collection")]
mod query;
#[cfg(feature = "collection")]
mod status;

use std::path::{Path, PathBuf};

use crate::Done;
use crate::failure::Failure;
use crate::fit::Kind;
use crate::output::Output;

/// Name of the catalogue in the folder of a collection.
const CATALOGUE: &str = "collection.sqlite";
/// What a program says that cannot.
const WITHOUT: &str = "collection: expected a program that was built with SQLite, found one without; build with `--features collection`";

/// Keep many measurements: a folder of them, with one catalogue that is searched, sorted and shown as a page.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Command {
    Init(Init),
    Add(Add),
    Status(Status),
    Query(Query),
    Page(Page),
}

/// Make a collection of a folder, new or with measurements in it.
#[derive(Debug, clap::Args)]
pub(crate) struct Init {
    /// The folder
    #[arg(value_name = "COLLECTION")]
    dir: PathBuf,
}

/// Add finished measurements to the catalogue, or what has changed of them; what is there unchanged stays.
#[derive(Debug, clap::Args)]
pub(crate) struct Add {
    /// The folder of the collection
    #[arg(value_name = "COLLECTION")]
    dir: PathBuf,
    /// Directories of finished measurements below that folder [default: all that are there; those that are not finished are told]
    #[arg(value_name = "MEASUREMENT")]
    measurements: Vec<PathBuf>,
    /// Model whose parameters are fitted for the catalogue
    #[arg(long, value_enum, default_value = "ggx")]
    model: Kind,
}

/// Count what is added, missing, changed since it was added, and not added yet.
#[derive(Debug, clap::Args)]
pub(crate) struct Status {
    /// The folder of the collection
    #[arg(value_name = "COLLECTION")]
    dir: PathBuf,
    /// Read every result and compare its SHA-256; else that is done where size or time of a file differ
    #[arg(long)]
    verify: bool,
}

/// List the measurements of a collection.
///
/// Columns: path (below the folder), sample, rig, date (UTC), directions, image_size (pixels a side), coverage (share of the pairs of directions with
/// θ ≤ 80°), error (median, relative, where the sample is known), sigma (standard uncertainty over f, median), albedo (directional, at the
/// incident angle albedo_theta_deg that is nearest to 45° of those that have one) and its standard uncertainty albedo_sigma, reciprocity
/// (residual, relative, median), model with ax, ay, azimuth_deg, rd and strength (means over the channels; only of a fit that is acceptable),
/// warnings (how many there are), bytes, sha256 (of the result), added (UTC). What is not known is NULL, and no comparison finds it.
#[derive(Debug, clap::Args)]
pub(crate) struct Query {
    /// The folder of the collection
    #[arg(value_name = "COLLECTION")]
    dir: PathBuf,
    /// Those alone for which this is true: columns, numbers, 'text', = <> < <= > >= + - * /, and, or, not, is null, like, in, between
    #[arg(long = "where", value_name = "CONDITION", allow_hyphen_values = true)]
    condition: Option<String>,
    /// In this order, such as 'albedo desc, path'; what is not known comes last
    #[arg(long, value_name = "COLUMN [desc],...", default_value = "path")]
    sort: String,
    /// As a table for people, as an object for programs (as --json does), or as a table for programs
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// How rows are printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// The main columns, for people
    Text,
    /// All columns
    Json,
    /// All columns
    Csv,
}

/// Write a page that shows the collection as a grid of spheres, sorted and filtered in the browser, each with a link to its report.
///
/// The page is one file; its links hold as long as it and the collection are not moved against each other.
#[derive(Debug, clap::Args)]
pub(crate) struct Page {
    /// The folder of the collection
    #[arg(value_name = "COLLECTION")]
    dir: PathBuf,
    /// The page to write (HTML)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[cfg(feature = "collection")]
pub(crate) fn run(command: &Command, output: &Output) -> Done {
    match command {
        Command::Init(args) => add::init(args, output),
        Command::Add(args) => add::run(args, output),
        Command::Status(args) => status::run(args, output),
        Command::Query(args) => query::run(args, output),
        Command::Page(args) => page::run(args, output),
    }
}

/// Whether `dir` is the folder of a collection.
pub(crate) fn is_at(dir: &Path) -> bool {
    dir.join(CATALOGUE).is_file()
}

/// Adds the finished measurement in `measurement` to the collection in `dir`.
#[cfg(feature = "collection")]
pub(crate) fn take(dir: &Path, measurement: &Path, output: &Output) -> Done {
    add::take(dir, measurement, output)
}

#[cfg(not(feature = "collection"))]
pub(crate) fn run(_: &Command, _: &Output) -> Done {
    Err(Failure::input(WITHOUT))
}

#[cfg(not(feature = "collection"))]
pub(crate) fn take(_: &Path, _: &Path, _: &Output) -> Done {
    Err(Failure::input(WITHOUT))
}

/// Refuses to add to a collection where this program cannot.
pub(crate) fn check(is_wanted: bool) -> Done {
    if is_wanted && !cfg!(feature = "collection") {
        return Err(Failure::input(WITHOUT));
    }
    Ok(())
}
