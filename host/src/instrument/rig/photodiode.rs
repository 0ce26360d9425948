//! Where a photodiode looks at the image of a projector that is a window.

use std::path::Path;

use super::{Rig, RigError};
use crate::instrument::monitor::is_beside;
use crate::instrument::optics::View;

impl Rig {
    /// Checks where the photodiode looks, if the projector has one.
    pub(super) fn check_photodiode(&self, path: &Path) -> Result<(), RigError> {
        let Some(window) = &self.projector.window else {
            return Ok(());
        };
        let error = |field: &str, (expected, found): (String, String)| RigError::Field {
            path: path.to_path_buf(),
            field: format!("projector.window.{field}"),
            expected,
            found,
        };
        if let Some(hz) = window.refresh_hz
            && !(1.0..=1e4).contains(&hz)
        {
            return Err(error("refresh_hz", ("1 to 10000 Hz".to_owned(), hz.to_string())));
        }
        self.photodiode_beside_mirror(window.patch_px)
            .map_err(|reason| error("patch_px", reason))
    }

    /// Checks that `patch_px` ([x, y, width, height] in pixels of the projector's image) is a part of the image whose light passes
    /// beside the mirror, and more than a little.
    ///
    /// # Errors
    /// What was expected, and what was found.
    pub fn photodiode_beside_mirror(&self, patch_px: [u32; 4]) -> Result<(), (String, String)> {
        let lens = &self.projector.lens;
        let [x, y, width, height] = patch_px;
        let found = format!("[{x}, {y}, {width}, {height}]");
        let is_inside =
            |at: u32, size: u32, limit: u32| size > 0 && at.checked_add(size).is_some_and(|end| end <= limit);
        if !is_inside(x, width, lens.width_px) || !is_inside(y, height, lens.height_px) {
            let expected = format!(
                "[x, y, width, height] of a part of the {}×{} pixels of projector.lens",
                lens.width_px, lens.height_px
            );
            return Err((expected, found));
        }
        let view = View::projector(self);
        if is_beside(&view, patch_px) {
            return Ok(());
        }
        let (right, bottom) = (lens.width_px - width, lens.height_px - height);
        let such_as = [[0, 0], [right, 0], [0, bottom], [right, bottom]]
            .into_iter()
            .find(|[x, y]| is_beside(&view, [*x, *y, width, height]))
            .map_or(String::new(), |[x, y]| {
                format!(", such as [{x}, {y}, {width}, {height}]")
            });
        Err((
            format!("a patch whose light passes beside the mirror{such_as}"),
            format!("{found}, of which the mirror may reflect some onto the sample"),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::sentence;
    use super::*;
    use crate::instrument::optics::DirectionTiles;

    #[test]
    fn a_patch_lights_no_sample_or_is_refused() {
        for preset in super::super::PRESETS {
            let rig = Rig::load(preset).unwrap();
            let tiles = DirectionTiles::of(View::projector(&rig));
            let (width, height) = (rig.projector.lens.width_px, rig.projector.lens.height_px);
            let lights = |[x, y, w, h]: [u32; 4]| {
                (y..y + h).any(|row| {
                    (x..x + w).any(|column| tiles.pixel((row * width + column) as usize).is_some())
                })
            };
            // From corners inwards, in sizes of all kinds: what passes lights nothing, and some passes.
            let (mut passed, mut refused) = (0, 0);
            for size in [1, 8, 40, 150, 600] {
                for share in 0..12 {
                    let at = |limit: u32| (limit - size.min(limit)) * share / 11;
                    for patch in [
                        [at(width), 0, size.min(width), size.min(height)],
                        [0, at(height), size.min(width), size.min(height)],
                        [at(width), at(height), size.min(width), size.min(height)],
                    ] {
                        if rig.photodiode_beside_mirror(patch).is_ok() {
                            assert!(!lights(patch), "{preset}: {patch:?}");
                            passed += 1;
                        } else {
                            refused += 1;
                        }
                    }
                }
            }
            assert!(passed > 10 && refused > 10, "{preset}: {passed} {refused}");
        }
    }

    /// The example of a rig file, with what it says of a window in place of its folder.
    #[test]
    fn the_example_of_a_window_is_one() {
        let of_files = ["[projector.files]", "folder = ", "patience_s = "];
        let of_window = [
            "[projector.window]",
            "display = ",
            "monitor = ",
            "patch_px = ",
            "refresh_hz = ",
            "pace = ",
        ];
        let begins = |line: &str, with: &[&str]| with.iter().any(|begin| line.starts_with(begin));
        let text =
            include_str!("../../../rigs/lab.toml").replace("driver = \"files\"", "driver = \"window\"");
        let lines = text.lines().filter(|line| !begins(line, &of_files));
        let lines = lines.map(|line| {
            line.strip_prefix("# ")
                .filter(|line| begins(line, &of_window))
                .unwrap_or(line)
        });
        let text = lines.collect::<Vec<_>>().join("\n");
        let lab = Rig::from_toml(&text, Path::new("lab.toml")).unwrap();
        let window = lab.projector.window.clone().unwrap();
        assert_eq!(
            (window.display.as_deref(), window.refresh_hz),
            (Some(":0"), Some(60.0))
        );
        assert_eq!(Rig::from_toml(&lab.to_toml(), Path::new("x")).unwrap(), lab);
        let bare = lab.without_drivers();
        assert!(!bare.to_toml().contains("window") && bare.driven_as(&lab) == lab);
    }

    #[test]
    fn a_window_without_a_good_patch_is_refused_by_its_field() {
        let camera = (
            "[camera]",
            "[camera]\ndriver = \"genicam\"\ngenicam = { region_px = [0, 0, 2048, 2048], pixel_format = \"RGB16\" }",
        );
        let window =
            |settings: &str| format!("[projector]\ndriver = \"window\"\nwindow = {{ {settings} }}\n");
        for (settings, field, found) in [
            (
                "patch_px = [480, 350, 64, 64]",
                "patch_px",
                "beside the mirror, such as [0, 0, 64, 64], found [480, 350, 64, 64]",
            ),
            (
                "patch_px = [1000, 0, 64, 64]",
                "patch_px",
                "1024×768 pixels of projector.lens, found [1000, 0, 64, 64]",
            ),
            ("patch_px = [0, 0, 0, 64]", "patch_px", "found [0, 0, 0, 64]"),
            (
                "patch_px = [0, 4294967295, 1, 1]",
                "patch_px",
                "found [0, 4294967295, 1, 1]",
            ),
            (
                "patch_px = [0, 0, 32, 32], refresh_hz = 0.0",
                "refresh_hz",
                "found 0",
            ),
        ] {
            let sentence = sentence(&[camera, ("[projector]\n", &window(settings))]);
            assert!(
                sentence.starts_with(&format!("lab/my.toml: projector.window.{field}"))
                    && sentence.contains(found),
                "{sentence}"
            );
        }
        let bare = sentence(&[camera, ("[projector]\n", "[projector]\ndriver = \"window\"\n")]);
        assert!(
            bare.contains("projector.window: expected a table with patch_px"),
            "{bare}"
        );
    }
}
