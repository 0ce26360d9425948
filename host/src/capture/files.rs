//! A projector whose patterns another program shows: they are handed over as files.
//!
//! # Design
//! For projectors that are driven by their maker's program, or by a script of one's own. In the folder:
//!
//! | name | content |
//! |---|---|
//! | `000003/00000.png`, `000003/00001.png`, … | patterns in their order, PNG of the projector's native resolution, 8 bits, grey, or RGB where one primary alone is lit |
//! | `current` | name of the folder of the sequence that is to be shown, such as `000003`; it comes when all of its patterns are there |
//! | `ready` | written by the program that shows them: that name, once black is shown and the next trigger shows the first pattern |
//!
//! Each trigger of PROJ then advances to the next pattern. No trigger comes before the program is ready, so that it may take its
//! time to load. A sequence that is over is removed. Grey levels are those of the projector's input: no gamma, no scaling, no dither.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use crate::capture::projector::{Projector, ProjectorError, check_resolution, check_room};
use crate::plan::pattern::BitPattern;
use crate::store::whole_file::{FileError, write_whole};

/// Name of the file that says which sequence is to be shown.
pub const CURRENT: &str = "current";
/// Name of the file by which the program that shows the patterns answers.
pub const READY: &str = "ready";
/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(2);
/// How many patterns a sequence may have.
const CAPACITY: usize = 4096;

/// Hands patterns over as files.
#[derive(Debug)]
pub struct FilesProjector {
    name: String,
    folder: PathBuf,
    size_px: (usize, usize),
    patience: Duration,
    sequence: u64,
    loaded: usize,
}

/// Name of the file of pattern `number`, from 0 on.
#[must_use]
pub fn name_of(number: usize) -> String {
    format!("{number:05}.png")
}

impl FilesProjector {
    /// Hands patterns of `size_px` (width, height) over in `folder`, which is made if there is none; who shows them may take as
    /// long as `patience`.
    ///
    /// # Errors
    /// [`ProjectorError`] where the folder cannot be written, or holds something else.
    pub fn open(folder: &Path, size_px: (usize, usize), patience: Duration) -> Result<Self, ProjectorError> {
        let at = |source| FileError::at(folder, source);
        fs::create_dir_all(folder).map_err(at)?;
        let current = folder.join(CURRENT);
        let sequence = match fs::read_to_string(&current) {
            Ok(text) => text.trim().parse().ok(),
            Err(_) if fs::read_dir(folder).map_err(at)?.next().is_none() => Some(0),
            Err(_) => None,
        };
        let sequence = sequence.ok_or_else(|| ProjectorError::Failed {
            projector: folder.display().to_string(),
            reason: format!(
                "expected an empty folder for patterns, or one with a file `{CURRENT}` that holds the number of a sequence, \
                 found other files"
            ),
        })?;
        Ok(Self {
            name: format!("files in {}", folder.display()),
            folder: folder.to_owned(),
            size_px,
            patience,
            sequence,
            loaded: 0,
        })
    }

    fn sequence_folder(&self) -> PathBuf {
        self.folder.join(format!("{:06}", self.sequence))
    }
}

impl Projector for FilesProjector {
    fn name(&self) -> &str {
        &self.name
    }

    fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    fn capacity(&self) -> usize {
        CAPACITY
    }

    fn clear(&mut self) -> Result<(), ProjectorError> {
        let before = self.sequence_folder();
        self.sequence += 1;
        let next = self.sequence_folder();
        // What was left half done is no part of it.
        fs::remove_dir_all(&next).ok();
        fs::create_dir_all(&next).map_err(|source| FileError::at(&next, source))?;
        fs::remove_dir_all(before).ok();
        self.loaded = 0;
        Ok(())
    }

    fn load(&mut self, pattern: &BitPattern) -> Result<(), ProjectorError> {
        let projector = || self.folder.display().to_string();
        check_resolution(&projector(), self.size_px, pattern)?;
        check_room(&projector(), self.loaded, CAPACITY)?;
        let png = encoded(pattern).map_err(|error| ProjectorError::Failed {
            projector: projector(),
            reason: format!("a pattern cannot be made a PNG: {error}"),
        })?;
        // It needs no sync to the disk: after a crash nothing is shown.
        let path = self.sequence_folder().join(name_of(self.loaded));
        let unfinished = path.with_extension("partial");
        fs::write(&unfinished, png)
            .and_then(|()| fs::rename(&unfinished, &path))
            .map_err(|source| FileError::at(&path, source))?;
        self.loaded += 1;
        Ok(())
    }

    fn ready(&mut self) -> Result<(), ProjectorError> {
        let name = format!("{:06}", self.sequence);
        write_whole(&self.folder.join(CURRENT), format!("{name}\n").as_bytes())?;
        let answer = self.folder.join(READY);
        let began = Instant::now();
        loop {
            let found = fs::read_to_string(&answer).unwrap_or_default();
            if found.trim() == name {
                return Ok(());
            }
            if began.elapsed() > self.patience {
                return Err(ProjectorError::Failed {
                    projector: self.name.clone(),
                    reason: format!(
                        "expected {name} in {} within {} s of the same in `{CURRENT}`, found {}: is the program running that \
                         shows the patterns?",
                        answer.display(),
                        self.patience.as_secs(),
                        if found.is_empty() { "nothing" } else { found.trim() }
                    ),
                });
            }
            thread::sleep(LOOK);
        }
    }
}

/// `pattern` as a PNG.
fn encoded(pattern: &BitPattern) -> Result<Vec<u8>, png::EncodingError> {
    let (width, height) = pattern.size_px();
    let channels = if pattern.primary().is_some() { 3 } else { 1 };
    let mut values = vec![0; width * height * channels];
    for pixel in pattern.lit() {
        let at = pixel as usize * channels + pattern.primary().map_or(0, usize::from);
        values[at] = pattern.level();
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(if channels == 3 {
        png::ColorType::Rgb
    } else {
        png::ColorType::Grayscale
    });
    encoder.set_compression(png::Compression::Fastest);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&values)?;
    writer.finish()?;
    Ok(bytes)
}

/// The pattern that the PNG at `path` shows: its lit pixels have one level, in white or in one primary.
///
/// # Errors
/// [`ProjectorError::Failed`] where it is no such picture.
pub fn read_pattern(path: &Path) -> Result<BitPattern, ProjectorError> {
    let failed = |reason: String| ProjectorError::Failed {
        projector: path.display().to_string(),
        reason,
    };
    let picture = image::open(path).map_err(|error| failed(error.to_string()))?;
    pattern_of(&picture.into_rgb8()).map_err(failed)
}

/// The pattern that `picture` shows: its lit pixels have one level, in white or in one primary.
///
/// # Errors
/// What was expected of a pixel, and what was found.
pub fn pattern_of(picture: &image::RgbImage) -> Result<BitPattern, String> {
    let mut pattern = BitPattern::black(picture.width() as usize, picture.height() as usize);
    // (level, primary) of the lit pixels.
    let mut look = None;
    let mut lit = Vec::new();
    for (index, pixel) in picture.pixels().enumerate() {
        let found = match pixel.0 {
            [0, 0, 0] => continue,
            [red, 0, 0] => (red, Some(0)),
            [0, green, 0] => (green, Some(1)),
            [0, 0, blue] => (blue, Some(2)),
            [red, green, blue] if red == green && green == blue => (red, None),
            _ => return Err("expected grey or one primary, found a mixture".to_owned()),
        };
        if *look.get_or_insert(found) != found {
            return Err("expected lit pixels of one level, found two".to_owned());
        }
        lit.push(index as u32);
    }
    pattern.light(&lit);
    if let Some((level, primary)) = look {
        pattern.set_level(level);
        pattern.set_primary(primary);
    }
    Ok(pattern)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_handed_over_is_read_as_it_was_and_replaces_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("patterns");
        let mut projector = FilesProjector::open(&folder, (37, 5), Duration::ZERO).unwrap();
        let mut patterns = Vec::new();
        for (number, look) in [(255, None), (90, None), (255, Some(1)), (7, Some(2))]
            .into_iter()
            .enumerate()
        {
            let mut pattern = BitPattern::black(37, 5);
            pattern.light(&[number as u32, 36, 37 * 5 - 1]);
            pattern.set_level(look.0);
            pattern.set_primary(look.1);
            patterns.push(pattern);
        }
        // A black one: nothing is lit, so that it has no level.
        patterns.push(BitPattern::black(37, 5));
        for sequence in ["000001", "000002"] {
            projector.clear().unwrap();
            for pattern in &patterns {
                projector.load(pattern).unwrap();
            }
            let error = projector.ready().unwrap_err().to_string();
            assert!(error.contains(&format!("expected {sequence} in")), "{error}");
            fs::write(folder.join(READY), sequence).unwrap();
            projector.ready().unwrap();
        }
        // Another process goes on.
        let mut projector = FilesProjector::open(&folder, (37, 5), Duration::ZERO).unwrap();
        assert_eq!(fs::read_to_string(folder.join(CURRENT)).unwrap(), "000002\n");
        for (number, pattern) in patterns.iter().enumerate() {
            assert_eq!(
                read_pattern(&folder.join("000002").join(name_of(number))).unwrap(),
                *pattern
            );
        }
        projector.clear().unwrap();
        let mut names: Vec<_> = fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        assert_eq!(names, ["000003", CURRENT, READY]);
        let error = projector.load(&BitPattern::black(37, 6)).unwrap_err().to_string();
        assert!(
            error.contains("expected a pattern of 37×5 pixels, found 37×6"),
            "{error}"
        );
    }

    #[test]
    fn a_folder_with_something_else_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.tex"), "x").unwrap();
        let error = FilesProjector::open(folder.path(), (4, 4), Duration::ZERO)
            .unwrap_err()
            .to_string();
        assert!(error.contains("expected an empty folder"), "{error}");
        assert!(folder.path().join("thesis.tex").exists());
    }
}
