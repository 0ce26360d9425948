//! Whether a result is what it was.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::Path;
use std::time::UNIX_EPOCH;

use rayon::prelude::*;
use sha2::{Digest as _, Sha256};

use crate::failure::Failure;

/// Bytes that are read at once.
const BLOCK: usize = 1 << 16;

/// The files below a folder, by their paths, and the bytes of all.
pub(super) struct Content<'a> {
    dir: &'a Path,
    names: Vec<String>,
    pub(super) bytes: u64,
    /// SHA-256 over path, size and time of change of each: as long as it stays nobody need read them.
    pub(super) stamp: String,
}

impl<'a> Content<'a> {
    /// That of the folder `dir`.
    pub(super) fn of(dir: &'a Path) -> Result<Self, Failure> {
        let looked = || -> io::Result<Self> {
            let (mut names, mut folders) = (Vec::new(), vec![dir.to_owned()]);
            while let Some(folder) = folders.pop() {
                for entry in fs::read_dir(&folder)? {
                    let path = entry?.path();
                    if path.is_dir() {
                        folders.push(path);
                    } else {
                        let below = path.strip_prefix(dir).expect("invariant: it is below");
                        let parts = below.components().map(|part| part.as_os_str().to_string_lossy());
                        names.push(parts.collect::<Vec<_>>().join("/"));
                    }
                }
            }
            names.sort_unstable();
            let (mut bytes, mut stamp) = (0, Sha256::new());
            for name in &names {
                let about = dir.join(name).metadata()?;
                let changed = about.modified()?.duration_since(UNIX_EPOCH);
                let changed_ns = changed.map_or(0, |since| since.as_nanos());
                bytes += about.len();
                stamp.update(format!("{name}\n{} {changed_ns}\n", about.len()));
            }
            Ok(Self {
                dir,
                names,
                bytes,
                stamp: hex(stamp),
            })
        };
        looked().map_err(|error| failed(dir, &error))
    }

    /// SHA-256 of all files: of one line `SUM  PATH` for each, as `sha256sum` prints it, ordered by the bytes of the path, as lineages have it.
    pub(super) fn sum(&self) -> Result<String, Failure> {
        let line = |name: &String| -> io::Result<String> {
            let (mut file, mut digest) = (File::open(self.dir.join(name))?, Sha256::new());
            let mut block = vec![0; BLOCK];
            loop {
                match file.read(&mut block)? {
                    0 => return Ok(format!("{}  {name}\n", hex(digest))),
                    length => digest.update(&block[..length]),
                }
            }
        };
        let lines: io::Result<Vec<String>> = self.names.par_iter().map(line).collect();
        let lines = lines.map_err(|error| failed(self.dir, &error))?;
        Ok(hex(Sha256::new_with_prefix(lines.concat())))
    }
}

fn hex(digest: Sha256) -> String {
    digest.finalize().iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("strings take everything");
        text
    })
}

fn failed(path: &Path, error: &io::Error) -> Failure {
    Failure::Failed(anyhow::anyhow!("{}: {error}", path.display()))
}
