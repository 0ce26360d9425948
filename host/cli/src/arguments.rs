//! What can be wrong with any argument of any command, whatever it means.

use std::ffi::OsString;

use rcg::base::text::shown;

/// What is wrong with the first of `arguments` (without the program's name) that is no text or empty, in one sentence:
/// files and their contents name each other in UTF-8, and nothing has an empty name.
pub(crate) fn complaint(arguments: impl Iterator<Item = OsString>) -> Option<String> {
    let mut option: Option<String> = None;
    for (index, argument) in arguments.enumerate() {
        let place = option.take().unwrap_or_else(|| format!("argument {}", index + 1));
        let Some(text) = argument.to_str() else {
            let lossy = argument.to_string_lossy();
            let place = match lossy.split_once('=') {
                Some((name, _)) if name.starts_with("--") => name,
                _ => &place,
            };
            return Some(format!(
                "{place}: expected UTF-8 text, found {} with bytes that are none",
                shown(&lossy)
            ));
        };
        let place = match text.split_once('=') {
            Some((name, "")) if name.starts_with("--") => name,
            _ if text.is_empty() => &place,
            _ => {
                if text.starts_with("--") && !text.contains('=') {
                    option = Some(text.to_owned());
                }
                continue;
            }
        };
        return Some(format!("{place}: expected a value, found an empty one"));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(arguments: &[&str]) -> Option<String> {
        complaint(arguments.iter().map(OsString::from))
    }

    #[test]
    fn an_empty_argument_is_named_by_its_option_or_its_place() {
        let found = |place: &str| Some(format!("{place}: expected a value, found an empty one"));
        assert_eq!(of(&["plan", "--rig", ""]), found("--rig"));
        assert_eq!(of(&["plan", "--rig="]), found("--rig"));
        assert_eq!(of(&["value", ""]), found("argument 2"));
        assert_eq!(of(&["value", "ward:rd=", "--json", "x"]), None);
        assert_eq!(of(&["value", "--sample=ward:rd="]), None);
    }

    #[cfg(unix)]
    #[test]
    fn bytes_that_are_no_text_are_named_too() {
        use std::os::unix::ffi::OsStringExt as _;
        let bad = |start: &str| OsString::from_vec([start.as_bytes(), b"caf\xe9"].concat());
        for (arguments, place) in [
            (vec!["--out".into(), bad("")], "--out"),
            (vec!["plan".into(), bad("--out=")], "--out"),
            (vec!["value".into(), bad("")], "argument 2"),
        ] {
            let sentence = complaint(arguments.into_iter()).unwrap();
            assert!(
                sentence.starts_with(&format!("{place}: expected UTF-8 text, found `")),
                "{sentence}"
            );
        }
    }
}
