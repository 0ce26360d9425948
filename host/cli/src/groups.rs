//! Commands by what one wants to do.

use std::fmt::Write as _;

/// Headings and the names of the commands below them, each command once.
const GROUPS: [(&str, &[&str]); 6] = [
    (
        "Commands that measure",
        &[
            "measure", "plan", "patterns", "capture", "assemble", "combine", "fill", "turn",
        ],
    ),
    ("Commands that calibrate", &["calibrate", "standard", "map"]),
    (
        "Commands that ask a result",
        &[
            "value",
            "info",
            "evaluate",
            "compare",
            "budget",
            "reflectance",
            "fit",
            "history",
        ],
    ),
    (
        "Commands that show a result and hand it on",
        &["render", "plot", "report", "export", "collection"],
    ),
    (
        "Commands that study and simulate",
        &["study", "bench", "paper", "multiplex", "truth", "worlds"],
    ),
    (
        "Commands for the parts of an instrument, and for this program",
        &[
            "rig",
            "live",
            "controller",
            "camera",
            "projector",
            "completions",
            "man",
        ],
    ),
];

/// `command` with its subcommands in groups in its help.
pub(crate) fn grouped(command: clap::Command) -> clap::Command {
    let mut listed = String::new();
    let width = command
        .get_subcommands()
        .map(|below| below.get_name().len())
        .max()
        .unwrap_or(0);
    for (heading, names) in GROUPS {
        listed.push_str(heading);
        listed.push_str(":\n");
        for name in names {
            let about = command
                .find_subcommand(name)
                .and_then(clap::Command::get_about)
                .map(ToString::to_string)
                .unwrap_or_default();
            writeln!(listed, "  {name:width$}  {about}").expect("strings take everything");
        }
        listed.push('\n');
    }
    debug_assert_eq!(
        GROUPS.iter().map(|(_, names)| names.len()).sum::<usize>(),
        command.get_subcommands().count(),
        "every command stands in one group"
    );
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{listed}Options:\n{{options}}{{after-help}}\n"
    ))
}
