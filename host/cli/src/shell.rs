//! `rcg completions` and `rcg man`

use std::io::Write as _;
use std::path::PathBuf;

use rcg::store::whole_file::FileError;
use serde_json::json;

use crate::Done;
use crate::output::Output;

/// Completions of commands and options for a shell, on stdout.
///
/// For bash: `rcg completions bash > ~/.local/share/bash-completion/completions/rcg`.
#[derive(Debug, clap::Args)]
pub(crate) struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Manual pages, one for each command.
#[derive(Debug, clap::Args)]
pub(crate) struct Man {
    /// The directory to write them into
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Writes the completions of `command`.
pub(crate) fn completions(args: &Completions, mut command: clap::Command, output: &Output) -> Done {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "rcg", &mut script);
    if output.is_json() {
        let script = String::from_utf8_lossy(&script);
        return output.print(
            &json!({ "shell": args.shell.to_string(), "script": script }),
            String::new,
        );
    }
    // As it is: a shell obeys what a terminal must not.
    std::io::stdout().lock().write_all(&script)?;
    Ok(())
}

/// Writes the pages of `command`.
pub(crate) fn man(args: &Man, command: clap::Command, output: &Output) -> Done {
    std::fs::create_dir_all(&args.out).map_err(|error| FileError::at(&args.out, error))?;
    let failed = |error| FileError::at(&args.out, error);
    clap_mangen::generate_to(command, &args.out).map_err(failed)?;
    let mut pages: Vec<String> = std::fs::read_dir(&args.out)
        .map_err(failed)?
        .flatten()
        .map(|page| page.path().display().to_string())
        .filter(|page| page.ends_with(".1"))
        .collect();
    pages.sort();
    output.print(&json!({ "pages": pages }), || format!("{} pages\n", pages.len()))
}
