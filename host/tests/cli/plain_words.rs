//! Messages are made of words and numbers with their units, not of Rust's way of writing values.

use std::fs;
use std::path::Path;

use crate::tree::files;

#[test]
fn no_message_is_made_with_the_format_of_debugging() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut seen = 0;
    for name in files(&root)
        .into_keys()
        .filter(|name| name.extension().is_some_and(|ending| ending == "rs"))
    {
        if name
            .components()
            .any(|part| part.as_os_str().to_string_lossy().starts_with("tests"))
        {
            continue;
        }
        let source = fs::read_to_string(root.join(&name)).unwrap();
        // Tests stand last.
        let source = source.split("#[cfg(test)]\nmod tests {").next().unwrap();
        for (index, line) in source.lines().enumerate() {
            let is_debug = |(at, _)| {
                let inside = line[..at].rsplit('{').next().unwrap();
                inside.ends_with('?') && inside.contains(':') && !inside.contains(' ')
            };
            assert!(
                !line.match_indices('}').any(is_debug),
                "{}, line {}: {line}",
                name.display(),
                index + 1
            );
        }
        seen += 1;
    }
    assert!(seen > 100, "{seen}");
}
