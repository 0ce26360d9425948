//! `rcg rig`

use rcg::capture::real;
use rcg::instrument::rig::Rig;
use serde_json::json;

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Look at the instrument that a rig file describes.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Whether trigger box, camera and projector are there and as the rig file says, and what to do where they are not
    Check,
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let Action::Check = args.action;
    let rig = Rig::load(rig)?;
    let findings = real::check(&rig);
    let lines: Vec<(&str, String)> = findings
        .iter()
        .map(|finding| match (&finding.found, &finding.missing) {
            (Some(found), _) => (finding.part, found.clone()),
            (None, missing) => (
                finding.part,
                format!("missing: {}", missing.as_deref().unwrap_or_default()),
            ),
        })
        .collect();
    output.print(&json!({ "rig": rig.name, "parts": findings }), || table(&lines))?;
    let missing = findings
        .iter()
        .filter(|finding| finding.missing.is_some())
        .count();
    if missing > 0 {
        return Err(Failure::Failed(anyhow::anyhow!(
            "rig {}: expected all of its {} parts, found that {missing} are not as they should be",
            rig.name,
            findings.len()
        )));
    }
    Ok(())
}
