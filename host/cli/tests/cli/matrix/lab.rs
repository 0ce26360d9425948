//! Files that all cases of the matrix share.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use rcg::instrument::bands::{Bands, MadeBy};
use rcg::instrument::rig::Rig;

use super::TILTS;
use super::features::{Case, FILE};
use crate::command::{is_full, run, text};
use crate::tensor_file::{bytes, material};

/// The files that cases share, made once.
pub(super) struct Lab {
    pub(super) folder: PathBuf,
}

impl Lab {
    pub(super) fn open() -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("matrix");
        fs::remove_dir_all(&folder).ok();
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("material.bsdf"), bytes(&material(0.2))).unwrap();
        // Some in the hole, some beside the wire; no symmetry.
        let list: String = (0..14)
            .map(|at| {
                format!(
                    "{} {}\n",
                    20.0 + 4.3 * f64::from(at),
                    137.5 * f64::from(at) % 360.0
                )
            })
            .collect::<Vec<_>>()
            .concat();
        fs::write(folder.join("directions.txt"), list).unwrap();
        Self { folder }
    }

    pub(super) fn at(&self, name: &str) -> String {
        text(&self.folder.join(name)).to_owned()
    }

    pub(super) fn truth(&self, rig: &str) -> String {
        self.at(&format!("{rig}.truth.toml"))
    }

    /// The file of the preset `rig` with a camera without colours, before which the projector makes them.
    pub(super) fn in_bands(&self, rig: &str) -> String {
        self.at(&format!("{rig}.bands.toml"))
    }

    pub(super) fn write_in_bands(&self, preset: &str) {
        let mut rig = Rig::load(preset).unwrap();
        rig.camera.channels = 1;
        rig.bands = Some(Bands {
            made_by: MadeBy::Projector,
            name: ["red", "green", "blue"].map(str::to_owned).to_vec(),
            centre_nm: vec![620.0, 530.0, 460.0],
            width_nm: vec![60.0, 70.0, 25.0],
        });
        fs::write(self.in_bands(preset), rig.to_toml()).unwrap();
    }

    /// The calibration of `rig` as it really is, or of the one whose projector makes the `bands`; made when it is first asked for.
    pub(super) fn calibration(&self, rig: &'static str, bands: bool) -> Result<String, String> {
        static MADE: [[OnceLock<Result<(), String>>; 2]; 3] = [const { [const { OnceLock::new() }; 2] }; 3];
        let place = ["rcg-1-16bit", "rcg-2", "dmd"]
            .iter()
            .position(|name| *name == rig)
            .unwrap();
        let (name, file) = if bands {
            (format!("{rig}.bands"), self.in_bands(rig))
        } else {
            (rig.to_owned(), rig.to_owned())
        };
        let folder = self.at(&format!("{name}.calibration"));
        let made = MADE[place][usize::from(bands)].get_or_init(|| {
            let truth = self.truth(&name);
            for (what, size, rest) in [
                ("geometry", "96", &[][..]),
                ("photometry", "48", &["--tilts", TILTS]),
            ] {
                if what == "geometry" && !is_full() {
                    continue;
                }
                let all = [
                    "calibrate",
                    what,
                    "--rig",
                    &file,
                    "--out",
                    &folder,
                    "--truth",
                    &truth,
                ];
                let outcome = run(&[&all[..], &["--image-size", size], rest].concat(), "");
                if outcome.code != Some(0) {
                    return Err(format!("calibrate {what} of {name}: {}", outcome.stderr));
                }
            }
            Ok(())
        });
        made.clone().map(|()| folder)
    }

    /// Draws how the instrument with this `rig` really is, into `out`.
    pub(super) fn draw_truth(rig: &str, out: &str) {
        // Geometry takes long to calibrate: where pairs are drawn, only light and throughput are uneven.
        let still: &[&str] = if is_full() {
            &[]
        } else {
            &["--position-mm", "0", "--angle-deg", "0", "--without", "figure"]
        };
        run(
            &[&["truth", "--rig", rig, "--seed", "2", "--out", out][..], still].concat(),
            "",
        )
        .done();
    }

    pub(super) fn sample(&self, case: &Case) -> String {
        match case.sample {
            FILE => self.at("material.bsdf"),
            model => model.to_owned(),
        }
    }
}
