//! A calibration of the virtual rig that is kept for further measurements on it.
//!
//! # Design
//! Nothing of the virtual rig changes by itself, so a calibration holds as long as all that decided it is the same: the rig, how it
//! really is, its noise, the tilt at which the standard was captured, and the program that captured and fitted. [`key`] names all of
//! that; what is kept under another key is never taken. What was found is kept, the captures that it was found with are not.

use std::fs;
use std::path::Path;

use crate::instrument::calibration::{VIEWS, rig_hash};
use crate::instrument::rig::{Rig, Tilt};
use crate::plan::Virtual;
use crate::store::checksum::{sum, sum_of};
use crate::store::whole_file::FileError;

/// The name under which the calibration of `rig` is kept if it really is as `virtual_rig` says (its truth and its noise; the
/// sample, its seed and faults have no part in a calibration), with the standard at `tilt` too, by the program in the file
/// `program`: 16 hexadecimal digits.
///
/// # Errors
/// [`FileError`] for a truth or a program that cannot be read.
pub fn key(
    rig: &Rig,
    virtual_rig: &Virtual,
    tilt: Option<Tilt>,
    program: &Path,
) -> Result<String, FileError> {
    let of = |path: &Path| sum_of(path).map_err(|source| FileError::at(path, source));
    let truth = virtual_rig.truth.as_ref().map(|path| of(Path::new(path)));
    let parts = [
        of(program)?,
        rig_hash(rig),
        truth.transpose()?.unwrap_or_default(),
        if virtual_rig.noise { "noise" } else { "" }.to_owned(),
        tilt.map(|tilt| tilt.to_string()).unwrap_or_default(),
    ];
    let mut key = sum(parts.join("\n").as_bytes());
    key.truncate(16);
    Ok(key)
}

/// Keeps what was found in the directory `made` as the directory `kept`, on the same disk; what another process kept there
/// meanwhile is the same and stays. The captures go.
///
/// # Errors
/// [`FileError`] for a disk that does not take it.
pub fn keep(made: &Path, kept: &Path) -> Result<(), FileError> {
    let failed = |source| FileError::at(kept, source);
    for entry in fs::read_dir(made).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let is_captured = VIEWS.iter().any(|name| path.ends_with(name));
        if path.is_dir() {
            fs::remove_dir_all(&path).map_err(failed)?;
        } else if is_captured {
            fs::remove_file(&path).map_err(failed)?;
        }
    }
    match fs::rename(made, kept) {
        Err(_) if kept.is_dir() => Ok(()),
        renamed => renamed.map_err(failed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_decides_a_calibration_has_another_key() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str, text: &str| {
            let path = dir.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        let [program, newer] = [at("program", "1"), at("newer", "2")];
        let truth = |text: &str| Some(at(&format!("{text}.toml"), text).display().to_string());
        let with = |truth, noise| Virtual {
            truth,
            noise,
            ..Virtual::default()
        };
        let [rig, other] = ["rcg-3", "rcg-2"].map(|name| Rig::load(name).unwrap());
        let tilt = Some("10:0:0".parse().unwrap());
        let usual = with(None, true);
        let keys = [
            key(&rig, &usual, None, &program),
            key(&other, &usual, None, &program),
            key(&rig, &with(truth("a"), true), None, &program),
            key(&rig, &with(truth("b"), true), None, &program),
            key(&rig, &with(None, false), None, &program),
            key(&rig, &usual, tilt, &program),
            key(&rig, &usual, None, &newer),
        ];
        let keys: std::collections::BTreeSet<String> = keys.into_iter().map(Result::unwrap).collect();
        assert_eq!(keys.len(), 7);
        // The same truth elsewhere, and another sample, are the same instrument.
        let copy = with(Some(at("copy.toml", "a").display().to_string()), true);
        assert!(keys.contains(&key(&rig, &copy, None, &program).unwrap()));
        let sample = Virtual {
            sample: "lambert:0.1".to_owned(),
            seed: 7,
            ..usual
        };
        assert!(keys.contains(&key(&rig, &sample, None, &program).unwrap()));
        assert!(key(&rig, &with(Some("none.toml".to_owned()), true), None, &program).is_err());
    }

    #[test]
    fn what_was_found_is_kept_and_the_captures_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let [made, kept] = ["made", "kept"].map(|name| dir.path().join(name));
        for text in ["first", "second"] {
            fs::create_dir_all(made.join("geometry.raw.zarr/c")).unwrap();
            fs::write(made.join("rig.toml"), text).unwrap();
            fs::write(made.join(VIEWS[1]), text).unwrap();
            keep(&made, &kept).unwrap();
            let names: Vec<_> = fs::read_dir(&kept)
                .unwrap()
                .map(|entry| entry.unwrap().file_name())
                .collect();
            assert_eq!(names, ["rig.toml"]);
            // What is there stays as it is.
            assert_eq!(fs::read_to_string(kept.join("rig.toml")).unwrap(), "first");
        }
        assert!(keep(&made, &dir.path().join("no/folder")).is_err());
    }
}
