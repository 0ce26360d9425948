//! `rcg collection page`
//!
//! # Design
//! One file: the rows as JSON with their pictures, and a program (`page.js`) that draws, sorts and filters them. Names of samples and folders are
//! data to it, never markup.

use std::fmt::Write as _;
use std::path::{Component, Path};

use rcg::base::file_format::PAGE;
use rcg::store::whole_file::write_whole;
use rusqlite::types::Value;
use serde_json::{Value as Json, json};

use super::catalogue::{Catalogue, Row, of, text_of};
use super::{Page, query};
use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table, to_write};

const STYLE: &str = include_str!("page.css");
const PROGRAM: &str = include_str!("page.js");

/// From the folder of the page to that of the collection, with a / at its end unless it is the same.
fn way(page: &Path, collection: &Path) -> Result<String, Failure> {
    let resolved = |path: &Path| {
        path.canonicalize()
            .map_err(|error| Failure::Failed(anyhow::anyhow!("{}: {error}", path.display())))
    };
    let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty());
    let (from, to) = (resolved(folder.unwrap_or(Path::new(".")))?, resolved(collection)?);
    let common = from
        .components()
        .zip(to.components())
        .take_while(|(a, b)| a == b)
        .count();
    let up = from.components().skip(common).map(|_| "..".to_owned());
    let down = to.components().skip(common).filter_map(|part| match part {
        Component::Normal(name) => Some(escaped(&name.to_string_lossy())),
        _ => None,
    });
    Ok(up.chain(down).map(|part| part + "/").collect())
}

/// A path as a part of an address: what is neither a letter, a digit nor one of -._~/ by its bytes.
fn escaped(path: &str) -> String {
    path.bytes().fold(String::new(), |mut text, byte| {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
                text.push(char::from(byte));
            }
            _ => write!(text, "%{byte:02X}").expect("strings take everything"),
        }
        text
    })
}

fn shown(row: &Row, args: &Page, way: &str) -> Json {
    let mut facts = query::object(row);
    let path = text_of(row, "path");
    let report = args.dir.join(path).join("report.html");
    facts["report"] = if report.is_file() {
        // Else a name such as a:b would be one of a protocol.
        json!(format!("./{way}{}/report.html", escaped(path)))
    } else {
        Json::Null
    };
    facts["picture"] = match of(row, "thumbnail") {
        Value::Blob(png) => json!(base64(png)),
        _ => Json::Null,
    };
    facts
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    use base64::Engine as _;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

pub(super) fn run(args: &Page, output: &Output) -> Done {
    to_write(&args.out, PAGE)?;
    let rows = Catalogue::open(&args.dir, false)?.all()?;
    let way = way(&args.out, &args.dir)?;
    let facts: Vec<Json> = rows.iter().map(|row| shown(row, args, &way)).collect();
    let html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>RCG: collection</title>\n<style>\n{STYLE}</style>\n<h1>Collection</h1>\n<form id=\"asked\"></form>\n<p id=\"count\"></p>\n\
         <ul id=\"grid\"></ul>\n<script type=\"application/json\" id=\"facts\">{}</script>\n<script>\n{PROGRAM}</script>\n</html>\n",
        // A text may hold what would end the element, or begin another.
        Json::Array(facts).to_string().replace('<', "\\u003c")
    );
    write_whole(&args.out, html.as_bytes())?;
    let answer = json!({ "out": args.out, "measurements": rows.len(), "bytes": html.len() });
    output.print(&answer, || {
        table(&[
            ("written", args.out.display().to_string()),
            ("measurements", rows.len().to_string()),
            ("size", format!("{} bytes", html.len())),
        ])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_lead_from_the_page_to_the_collection() {
        let scratch = tempfile::tempdir().unwrap();
        let at = |name: &str| scratch.path().join(name);
        std::fs::create_dir_all(at("a b/c")).unwrap();
        std::fs::create_dir_all(at("d")).unwrap();
        let way = |page: &str| way(&at(page), &at("a b")).unwrap();
        assert_eq!(way("a b/x.html"), "");
        assert_eq!(way("a b/c/x.html"), "../");
        assert_eq!(way("x.html"), "a%20b/");
        assert_eq!(way("d/x.html"), "../a%20b/");
        assert_eq!(escaped("é#?%<\"'/1"), "%C3%A9%23%3F%25%3C%22%27/1");
    }
}
