//! What may stand behind `--where` and `--sort`.
//!
//! # Design
//! A condition is handed to SQLite as it is, once every word of it is known: a column that people see, a number, a quoted text, an operator. So it
//! can name no other table, begin no other statement and call nothing; that it makes sense as a whole SQLite says.

use super::catalogue::{COLUMNS, SHOWN, names};
use crate::failure::Failure;

/// Words of conditions that are no columns.
const WORDS: [&str; 8] = ["and", "or", "not", "is", "null", "like", "in", "between"];
/// Signs of conditions, the longer ones first.
const SIGNS: [&str; 16] = [
    "<>", "<=", ">=", "!=", "==", "||", "<", ">", "=", "(", ")", "+", "-", "*", "/", ",",
];
/// Bytes of the longest condition.
const LONGEST: usize = 10_000;

fn is_column(word: &str) -> bool {
    COLUMNS[..SHOWN].iter().any(|(name, _)| *name == word)
}

fn columns() -> String {
    names(SHOWN)
}

fn refused(expected: &str, found: &str) -> Failure {
    let found = rcg::base::text::shown(found);
    Failure::input(format!("--where: expected {expected}, found {found}"))
}

/// The length in bytes of the first part of `text`, which does not begin with a space.
fn part(text: &str) -> Result<usize, Failure> {
    let first = text.chars().next().unwrap_or(' ');
    let while_ = |is: fn(char) -> bool| text.find(|c| !is(c)).unwrap_or(text.len());
    if first.is_ascii_alphabetic() {
        let length = while_(|c| c.is_ascii_alphanumeric() || c == '_');
        let word = text[..length].to_ascii_lowercase();
        if is_column(&word) || WORDS.contains(&word.as_str()) {
            return Ok(length);
        }
        let expected = format!("a column ({}), a number, 'text' or an operator", columns());
        return Err(refused(&expected, &text[..length]));
    }
    if first.is_ascii_digit() || first == '.' {
        let length = while_(|c| c.is_ascii_alphanumeric() || c == '.');
        // The sign of an exponent belongs to the number.
        let length = match text[..length].strip_suffix(['e', 'E']) {
            Some(_) if text[length..].starts_with(['+', '-']) => {
                let digits = text[length + 1..].find(|c: char| !c.is_ascii_digit());
                digits.map_or(text.len(), |digits| length + 1 + digits)
            }
            _ => length,
        };
        return match text[..length].parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(length),
            _ => Err(refused("a number", &text[..length])),
        };
    }
    if first == '\'' {
        let end = text[1..].find('\'');
        return end
            .map(|end| end + 2)
            .ok_or_else(|| refused("a text between two '", text));
    }
    let sign = SIGNS.iter().find(|sign| text.starts_with(**sign));
    sign.map(|sign| sign.len())
        .ok_or_else(|| refused("a column, a number, 'text' or an operator", text))
}

/// The `condition` as SQLite may take it.
pub(super) fn condition(condition: Option<&str>) -> Result<String, Failure> {
    let Some(condition) = condition else {
        return Ok("1".to_owned());
    };
    if condition.trim().is_empty() || condition.len() > LONGEST {
        return Err(refused(
            &format!("a condition of at most {LONGEST} bytes such as albedo > 0.2"),
            condition,
        ));
    }
    // A minus begins no comment, as there is a space behind each part.
    let (mut rest, mut taken, mut depth) = (condition.trim_start(), String::new(), 0_usize);
    while !rest.is_empty() {
        let length = part(rest)?;
        let (this, behind) = rest.split_at(length);
        match this {
            "(" => depth += 1,
            ")" => {
                let before = depth.checked_sub(1);
                depth = before.ok_or_else(|| refused("a ( before each )", condition))?;
            }
            _ => {}
        }
        taken.push_str(this);
        taken.push(' ');
        rest = behind.trim_start();
    }
    if depth > 0 {
        return Err(refused("a ) for each (", condition));
    }
    Ok(format!("({taken})"))
}

/// The `order` as SQLite takes it.
pub(super) fn order(order: &str) -> Result<String, Failure> {
    let one = |text: &str| {
        let words: Vec<String> = text.split_whitespace().map(str::to_ascii_lowercase).collect();
        match &words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            [column] | [column, "asc"] if is_column(column) => Ok(format!("{column} NULLS LAST")),
            [column, "desc"] if is_column(column) => Ok(format!("{column} DESC NULLS LAST")),
            _ => Err(Failure::input(format!(
                "--sort: expected columns ({}), each perhaps with desc behind it, found {}",
                columns(),
                rcg::base::text::shown(text)
            ))),
        }
    };
    let mut all = order.split(',').map(one).collect::<Result<Vec<_>, _>>()?;
    // Rows that are alike otherwise have an order too.
    all.push("path".to_owned());
    Ok(all.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_condition_over_columns_is_refused() {
        for good in [
            "albedo > 0.2",
            "sample LIKE 'ward%' and (error<1e-2 or error is null)",
            "ax-ay<.1",
            "rd*-1 < -1.5e+3",
        ] {
            assert!(condition(Some(good)).is_ok(), "{good}");
        }
        let bad = [
            "",
            " ",
            "albeto > 1",
            "1; DROP TABLE measurements",
            "1) UNION SELECT 1 --",
            "path = 'a",
            "thumbnail is null",
            "\"path\" = 1",
            "load_extension('x')",
            "sqlite_version() > 1",
            "1e",
            "1e400",
            "0x1g",
            "(1",
            "1)",
            "[path]",
            "`path`",
            "?1",
            ":a",
            "@a",
            "$a",
            "stamp = 1",
            "exists (select 1)",
            "path like 'a' collate nocase",
            "é > 1",
            "1 /* */; vacuum",
        ];
        for bad in bad {
            assert!(condition(Some(bad)).is_err(), "{bad}");
        }
        assert_eq!(condition(Some("1--1")).unwrap(), "(1 - - 1 )");
    }

    #[test]
    fn what_is_no_order_is_refused() {
        assert_eq!(
            order("albedo desc, path").unwrap(),
            "albedo DESC NULLS LAST, path NULLS LAST, path"
        );
        for bad in [
            "",
            "albeto",
            "albedo desc desc",
            "albedo;",
            "1",
            "albedo,",
            "thumbnail",
            "path collate nocase",
        ] {
            assert!(order(bad).is_err(), "{bad}");
        }
    }
}
