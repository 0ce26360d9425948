//! The file `collection.sqlite`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, ErrorCode, OpenFlags, params_from_iter};

use super::CATALOGUE;
use crate::failure::Failure;

/// What SQLite files of ours bear ("RCGc"), so that no other is taken for one.
const APPLICATION: i64 = 0x5243_4763;
/// Version of the columns.
const VERSION: i64 = 1;
/// So long another process may write before this one gives up.
const PATIENCE: Duration = Duration::from_secs(30);

/// What the catalogue has of each measurement, and SQLite's type of it. What only this program looks at stands last.
pub(super) const COLUMNS: [(&str, &str); 25] = [
    ("path", "TEXT PRIMARY KEY NOT NULL"),
    ("sample", "TEXT NOT NULL"),
    ("rig", "TEXT NOT NULL"),
    ("date", "TEXT"),
    ("directions", "INTEGER NOT NULL"),
    ("image_size", "INTEGER NOT NULL"),
    ("coverage", "REAL"),
    ("error", "REAL"),
    ("sigma", "REAL"),
    ("albedo", "REAL"),
    ("albedo_sigma", "REAL"),
    ("albedo_theta_deg", "REAL"),
    ("reciprocity", "REAL"),
    ("model", "TEXT"),
    ("ax", "REAL"),
    ("ay", "REAL"),
    ("azimuth_deg", "REAL"),
    ("rd", "REAL"),
    ("strength", "REAL"),
    ("warnings", "INTEGER NOT NULL"),
    ("bytes", "INTEGER NOT NULL"),
    ("sha256", "TEXT NOT NULL"),
    ("added", "TEXT NOT NULL"),
    ("stamp", "TEXT NOT NULL"),
    ("thumbnail", "BLOB"),
];
/// How many of them are for people.
pub(super) const SHOWN: usize = 23;

/// A row: a value for each of [`COLUMNS`], in their order.
pub(super) type Row = Vec<Value>;

/// The catalogue of a collection.
pub(super) struct Catalogue {
    path: PathBuf,
    connection: Connection,
}

/// The names of the first `count` columns.
pub(super) fn names(count: usize) -> String {
    let names: Vec<&str> = COLUMNS[..count].iter().map(|(name, _)| *name).collect();
    names.join(", ")
}

impl Catalogue {
    /// Makes that of the collection in `dir`, whole or not at all.
    pub(super) fn create(dir: &Path) -> Result<PathBuf, Failure> {
        let path = dir.join(CATALOGUE);
        let taken = || {
            let place = path.display();
            Failure::input(format!("{place}: expected no collection yet, found one"))
        };
        if path.exists() {
            return Err(taken());
        }
        fs::create_dir_all(dir).map_err(|error| failed(dir, &error))?;
        let scratch = tempfile::tempdir_in(dir).map_err(|error| failed(dir, &error))?;
        let new = scratch.path().join(CATALOGUE);
        let columns = COLUMNS.map(|(name, kind)| format!("{name} {kind}"));
        let connection = Connection::open(&new).map_err(|error| refused(&path, &error))?;
        let made = connection.execute_batch(&format!(
            "PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION}; CREATE TABLE measurements ({});",
            columns.join(", ")
        ));
        made.map_err(|error| refused(&path, &error))?;
        drop(connection);
        // Unlike a new name, a link refuses what another process has made meanwhile.
        fs::hard_link(&new, &path).map_err(|error| match error.kind() {
            std::io::ErrorKind::AlreadyExists => taken(),
            _ => failed(&path, &error),
        })?;
        Ok(path)
    }

    /// Opens that of the collection in `dir`, to write only if `writes`.
    pub(super) fn open(dir: &Path, writes: bool) -> Result<Self, Failure> {
        let path = dir.join(CATALOGUE);
        if !path.is_file() {
            let place = dir.display();
            return Err(Failure::input(format!(
                "{place}: expected a collection (with {CATALOGUE}), found none; `rcg collection init` makes one"
            )));
        }
        // To read, too: what a killed writer has left half is undone first. Reading alone is then the rule of the connection.
        let connection = Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_WRITE);
        let connection = connection.map_err(|error| refused(&path, &error))?;
        let catalogue = Self { path, connection };
        let number = |name: &str| -> Result<i64, Failure> {
            let found = catalogue
                .connection
                .pragma_query_value(None, name, |row| row.get(0));
            found.map_err(|error| catalogue.refused(&error))
        };
        catalogue
            .connection
            .busy_timeout(PATIENCE)
            .map_err(|error| catalogue.refused(&error))?;
        let found = (number("application_id")?, number("user_version")?);
        if found != (APPLICATION, VERSION) {
            return Err(Failure::input(format!(
                "{}: expected a catalogue of version {VERSION} of this program, found {}; move it away, then `rcg collection init` and `add` \
                 make it again",
                catalogue.path.display(),
                if found.0 == APPLICATION {
                    format!("version {}", found.1)
                } else {
                    "another SQLite file".to_owned()
                }
            )));
        }
        if !writes {
            let set = catalogue.connection.pragma_update(None, "query_only", true);
            set.map_err(|error| catalogue.refused(&error))?;
        }
        Ok(catalogue)
    }

    fn refused(&self, error: &rusqlite::Error) -> Failure {
        refused(&self.path, error)
    }

    /// Adds a row, in place of an older one of the same path.
    pub(super) fn put(&self, row: &Row) -> Result<(), Failure> {
        let marks = vec!["?"; COLUMNS.len()].join(", ");
        let statement = format!(
            "INSERT OR REPLACE INTO measurements ({}) VALUES ({marks})",
            names(COLUMNS.len())
        );
        let put = self.connection.execute(&statement, params_from_iter(row));
        put.map(|_| ()).map_err(|error| self.refused(&error))
    }

    /// The first `columns` of all rows for which `condition` is true, in this `order`.
    pub(super) fn rows(&self, columns: usize, condition: &str, order: &str) -> Result<Vec<Row>, Failure> {
        let statement = format!(
            "SELECT {} FROM measurements WHERE {condition} ORDER BY {order}",
            names(columns)
        );
        let read = || -> rusqlite::Result<Vec<Row>> {
            let mut statement = self.connection.prepare(&statement)?;
            let value = |value: ValueRef<'_>| Value::try_from(value);
            let row = |row: &rusqlite::Row<'_>| {
                (0..columns)
                    .map(|column| Ok(value(row.get_ref(column)?)?))
                    .collect()
            };
            statement.query_map([], row)?.collect()
        };
        read().map_err(|error| match error {
            // What is asked for, once all words of it are known.
            rusqlite::Error::SqlInputError { msg, .. } => Failure::input(format!(
                "--where: expected a condition as SQLite takes it, such as albedo > 0.2 and sample like 'ward%', found what it refuses: {msg}"
            )),
            error => self.refused(&error),
        })
    }

    /// All rows, in the order of their paths.
    pub(super) fn all(&self) -> Result<Vec<Row>, Failure> {
        self.rows(COLUMNS.len(), "1", "path")
    }
}

/// The value of the column `name` of a `row`.
pub(super) fn of<'a>(row: &'a Row, name: &str) -> &'a Value {
    let column = COLUMNS.iter().position(|(column, _)| *column == name);
    &row[column.expect("invariant: a column of the catalogue")]
}

/// As [`of`], of a column of text.
pub(super) fn text_of<'a>(row: &'a Row, name: &str) -> &'a str {
    match of(row, name) {
        Value::Text(text) => text,
        _ => "",
    }
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Failed(anyhow::anyhow!("{}: {error}", path.display()))
}

/// What SQLite says, in a sentence.
fn refused(path: &Path, error: &rusqlite::Error) -> Failure {
    let place = path.display();
    match error.sqlite_error_code() {
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => Failure::Failed(anyhow::anyhow!(
            "{place}: another process is writing there for more than {} s; try again",
            PATIENCE.as_secs()
        )),
        Some(ErrorCode::NotADatabase | ErrorCode::DatabaseCorrupt) => Failure::input(format!(
            "{place}: expected a catalogue of this program, found what is none ({error}); move it away, then `rcg collection init` and \
             `add` make it again"
        )),
        _ => Failure::Failed(anyhow::anyhow!("{place}: {error}")),
    }
}
