//! What arrays say of themselves in their attributes.

use serde_json::{Map, Value};

/// The attributes `units` and `long_name`, which every array has.
pub(super) fn described(units: &str, long_name: &str) -> Map<String, Value> {
    let mut attributes = Map::new();
    attributes.insert("units".into(), units.into());
    attributes.insert("long_name".into(), long_name.into());
    attributes
}

/// Adds the names of the codes in an array of codes (CF conventions 1.11, §3.5, `flag_values`).
pub(super) fn add_codes(attributes: &mut Map<String, Value>, codes: &[(u8, &str)]) {
    if codes.is_empty() {
        return;
    }
    let values: Vec<u8> = codes.iter().map(|&(code, _)| code).collect();
    // One word per code: blanks separate the words.
    let words: Vec<String> = codes.iter().map(|(_, word)| word.replace(' ', "_")).collect();
    attributes.insert("flag_values".into(), values.into());
    attributes.insert("flag_meanings".into(), words.join(" ").into());
}
