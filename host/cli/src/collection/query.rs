//! `rcg collection query`

use std::fmt::Write as _;

use rcg::base::text::quoted;
use rusqlite::types::Value;
use serde_json::{Map, Value as Json, json};

use super::catalogue::{COLUMNS, Catalogue, Row, SHOWN, names, of, text_of};
use super::{Format, Query, clause};
use crate::Done;
use crate::output::Output;

pub(super) fn run(args: &Query, output: &Output) -> Done {
    let condition = clause::condition(args.condition.as_deref())?;
    let order = clause::order(&args.sort)?;
    let rows = Catalogue::open(&args.dir, false)?.rows(SHOWN, &condition, &order)?;
    if args.format == Format::Json || output.is_json() {
        let all: Vec<Json> = rows.iter().map(object).collect();
        let text = json!({ "measurements": all });
        return output.print(&text, || format!("{text:#}\n"));
    }
    output.print(&(), || match args.format {
        Format::Csv => csv(&rows),
        _ => text(&rows),
    })
}

/// A row as people and programs see it.
pub(super) fn object(row: &Row) -> Json {
    let value = |value: &Value| match value {
        Value::Integer(number) => json!(number),
        Value::Real(number) => json!(number),
        Value::Text(text) => json!(text),
        Value::Null | Value::Blob(_) => Json::Null,
    };
    let names = COLUMNS[..SHOWN].iter().map(|(name, _)| (*name).to_owned());
    Json::Object(names.zip(row.iter().map(value)).collect::<Map<_, _>>())
}

/// RFC 4180; what is not known is empty.
fn csv(rows: &[Row]) -> String {
    let field = |value: &Value| match value {
        Value::Integer(number) => number.to_string(),
        Value::Real(number) => number.to_string(),
        Value::Text(text) => quoted(text),
        Value::Null | Value::Blob(_) => String::new(),
    };
    let line = |row: &Row| row.iter().map(field).collect::<Vec<_>>().join(",") + "\n";
    names(SHOWN).replace(", ", ",") + "\n" + &rows.iter().map(line).collect::<String>()
}

fn text(rows: &[Row]) -> String {
    let widest = |name: &str| {
        let lengths = rows.iter().map(|row| text_of(row, name).chars().count());
        lengths.max().unwrap_or(0).max(name.len())
    };
    let widths = ["path", "sample", "rig"].map(widest);
    let mut text = format!(
        "{:p$}  {:s$}  {:r$}  {:20}  coverage   error   sigma  albedo  reciprocity\n",
        "path",
        "sample",
        "rig",
        "date",
        p = widths[0],
        s = widths[1],
        r = widths[2]
    );
    for row in rows {
        let number = |name: &str| match of(row, name) {
            Value::Real(number) => Some(*number),
            _ => None,
        };
        let percent = |name: &str| {
            number(name).map_or_else(|| "-".to_owned(), |share| format!("{:.2} %", 100.0 * share))
        };
        let albedo = number("albedo").map_or_else(|| "-".to_owned(), |albedo| format!("{albedo:.4}"));
        writeln!(
            text,
            "{:p$}  {:s$}  {:r$}  {:20}  {:>8}  {:>6}  {:>6}  {albedo:>6}  {:>11}",
            text_of(row, "path"),
            text_of(row, "sample"),
            text_of(row, "rig"),
            text_of(row, "date"),
            percent("coverage"),
            percent("error"),
            percent("sigma"),
            percent("reciprocity"),
            p = widths[0],
            s = widths[1],
            r = widths[2]
        )
        .expect("strings take everything");
    }
    text
}
