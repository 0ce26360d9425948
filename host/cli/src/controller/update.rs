//! `rcg controller update`

use std::path::{Path, PathBuf};

use rcg::capture::update::{self, About, PATIENCE, Place, Uf2};
use serde_json::{Value, json};

use crate::Done;
use crate::failure::Failure;
use crate::output::{Output, table};

/// Give the trigger box another firmware, and see that it is back with it.
///
/// The box goes to its boot loader, whose drive takes the file; that a run goes on is a reason to refuse. One that is too old to go by
/// itself goes where its BOOTSEL button is held while it is plugged in. `cargo fw-uf2` makes the file.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The firmware, a UF2 file [default: the one that this program carries along, if it was built with one]
    #[arg(long, value_name = "UF2")]
    file: Option<PathBuf>,
    /// Folder at which the drive of the boot loader is, or will be [default: look for it]
    #[arg(long, value_name = "DIR")]
    volume: Option<PathBuf>,
}

/// What `RCG_UF2` named when this was built; empty if it named nothing.
static CARRIED: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/carried.uf2"));

impl Args {
    fn firmware(&self) -> Result<Uf2, Failure> {
        if let Some(file) = &self.file {
            return Ok(update::read(file)?);
        }
        if CARRIED.is_empty() {
            return Err(Failure::input(
                "--file: expected a UF2 file with firmware, as this program was built without one (RCG_UF2), found none",
            ));
        }
        Uf2::check(CARRIED.to_vec()).map_err(|error| {
            Failure::Failed(anyhow::anyhow!(
                "the firmware that this program carries along: {error}"
            ))
        })
    }

    fn volume(&self) -> Result<Option<PathBuf>, Failure> {
        let parent = self.volume.as_deref().map(Path::parent);
        // The folder itself may appear with the drive; what it is to be in is there.
        match parent {
            Some(Some(parent)) if !parent.as_os_str().is_empty() && !parent.is_dir() => {
                Err(Failure::input(format!(
                    "--volume: expected a folder at which a drive can appear, found none at {}",
                    parent.display()
                )))
            }
            _ => Ok(self.volume.clone()),
        }
    }
}

fn facts(about: About) -> Value {
    let (major, minor, patch) = about.version;
    json!({
        "firmware": format!("{major}.{minor}.{patch}"),
        "commit": (about.commit != 0).then(|| format!("{:08x}", about.commit)),
        "modified": about.modified,
    })
}

pub(super) fn run(args: &Args, port: &str, output: &Output) -> Done {
    let uf2 = args.firmware()?;
    let volume = args.volume()?;
    if port == "sim" {
        return Err(Failure::input(
            "--port: expected a trigger box that takes firmware, found the simulated one",
        ));
    }
    let place = Place {
        port: port.to_owned(),
        volume,
        patience: PATIENCE,
    };
    let updated = update::update(&uf2, &place)?;
    let away_s = updated.away.as_secs_f64();
    let value = json!({
        "port": port, "chip": uf2.chip().to_string(), "away_s": away_s,
        "before": updated.before.map(facts), "after": facts(updated.after),
    });
    output.print(&value, || {
        let before = updated
            .before
            .map_or_else(|| "unknown".to_owned(), |about| about.to_string());
        table(&[
            ("firmware before", before),
            ("firmware now", updated.after.to_string()),
            ("away for", format!("{away_s:.1} s")),
        ])
    })
}
