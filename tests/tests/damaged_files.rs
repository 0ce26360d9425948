//! Law: of a measurement of which any file is cut short, altered in one bit or gone, the same BRDF comes to the bit, or one sentence that
//! says which file it is.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::capture::directory::Measurement;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{Job, assemble_measurement, capture, complete, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;
use rcg_tests::is_full;

/// What happens to a file.
#[derive(Clone, Copy, Debug)]
enum Damage {
    /// So many thousandths of it are left.
    Cut(usize),
    /// One bit is another.
    Flipped(u64),
    Gone,
}

impl Damage {
    /// Does it to the file at `path`; whether that changes anything.
    fn does(self, path: &Path) -> bool {
        let whole = fs::read(path).unwrap();
        match self {
            Self::Cut(thousandths) => fs::write(path, &whole[..whole.len() * thousandths / 1000]).unwrap(),
            Self::Flipped(seed) if !whole.is_empty() => {
                let bit = Xoshiro256PlusPlus::seed_from_u64(seed).random_range(0..8 * whole.len());
                let mut altered = whole.clone();
                altered[bit / 8] ^= 1 << (bit % 8);
                fs::write(path, altered).unwrap();
            }
            Self::Flipped(_) => {}
            Self::Gone => fs::remove_file(path).unwrap(),
        }
        !whole.is_empty()
    }
}

/// Every file below `dir`, by its path from there.
fn files(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![dir.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                all.insert(
                    path.strip_prefix(dir).unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    all
}

/// Makes `to` a folder with these `files`.
fn lay(to: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) {
    fs::remove_dir_all(to).ok();
    for (name, content) in files {
        let path = to.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
}

/// A finished measurement of two chunks, with noise.
fn measured(out: &Path) {
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 30.0 },
        image_size: 12,
        exposure_s: Some(0.02),
        ..Request::default()
    };
    let setup = Setup::from(Virtual {
        seed: 5,
        ..Virtual::default()
    });
    let (job, measurement) = prepare(out, &rig, request, &setup, &Silent).unwrap();
    complete(&measurement, &job, &|| Duration::ZERO, &Silent).unwrap();
}

/// Goes on with the measurement `out` as `rcg measure --resume` does, up to its result.
fn resumed(out: &Path) -> Result<(), String> {
    let measurement = Measurement::open_to_write(out).map_err(|error| error.to_string())?;
    let job = Job::of(&measurement, None).map_err(|error| error.to_string())?;
    capture(&measurement, &job, &Silent).map_err(|error| error.to_string())?;
    assemble_measurement(&measurement, &Silent).map_err(|error| error.to_string())?;
    Ok(())
}

/// All that a program may read of a BRDF.
fn read(path: &Path) -> Result<String, String> {
    let brdf = Brdf::open(path).map_err(|error| error.to_string())?;
    let mut all = format!("{:?} {:?} {:?}", brdf.grid(), brdf.disk(), brdf.attributes());
    for incident in 0..brdf.grid().len() {
        write!(all, "{:?}", brdf.incident_reason(incident)).unwrap();
    }
    for cell in 0..brdf.disk().len() {
        write!(all, "{:?} {}", brdf.outgoing_reason(cell), brdf.pixel_sr(cell)).unwrap();
    }
    for chunk in 0..brdf.chunks() {
        let rows = brdf.chunk(chunk).map_err(|error| error.to_string())?;
        write!(all, "{rows:?}").unwrap();
    }
    Ok(all)
}

/// Refuses what is no sentence about something in `out`.
fn is_told(told: &str, out: &Path, what: &str) {
    assert!(
        told.contains(out.to_str().unwrap()) && !told.contains('\n'),
        "{what}: {told}"
    );
}

#[test]
fn a_damaged_file_is_recovered_or_named_and_never_changes_a_value() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    measured(&out);
    let whole = files(&out);
    let expected = files(&out.join("brdf.zarr"));
    // Figures are drawn anew, a result is made anew.
    let is_read = |name: &Path| !name.starts_with("figures") && !name.starts_with("brdf.zarr");
    let (mut recovered, mut named) = (0, 0);
    for (number, name) in whole.keys().filter(|name| is_read(name)).enumerate() {
        // Of the columns beside the frames, which are all written alike, some.
        let is_like_others = name.components().count() == 3 && !name.starts_with("raw.zarr/frames");
        if is_like_others && number % 4 != 0 && !is_full() {
            continue;
        }
        let all = [Damage::Gone, Damage::Flipped(number as u64), Damage::Cut(500)];
        let some = if is_full() {
            &all[..]
        } else {
            &all[number % 3..=number % 3]
        };
        for damage in some {
            lay(&out, &whole);
            damage.does(&out.join(name));
            let what = format!("{damage:?} {}", name.display());
            match resumed(&out) {
                Ok(()) => {
                    let found = files(&out.join("brdf.zarr"));
                    assert!(found == expected, "{what}: another result, and nobody was told");
                    recovered += 1;
                }
                Err(told) => {
                    is_told(&told, &out, &what);
                    named += 1;
                }
            }
        }
    }
    assert!(
        recovered >= 5 && named >= 5,
        "{recovered} recovered, {named} named"
    );
}

#[test]
fn a_result_is_read_as_it_was_written_or_not_at_all() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("m");
    measured(&out);
    let out = out.join("brdf.zarr");
    let (whole, expected) = (files(&out), read(&out).unwrap());
    let (mut harmless, mut named) = (0, 0);
    for name in whole.keys() {
        let flips = if name.ends_with("zarr.json") { 60 } else { 6 };
        let flips = (0..if is_full() { 20 * flips } else { flips }).map(Damage::Flipped);
        let rest = [Damage::Gone, Damage::Cut(0), Damage::Cut(500), Damage::Cut(999)];
        for damage in flips.chain(rest) {
            damage.does(&out.join(name));
            let what = format!("{damage:?} {}", name.display());
            match read(&out) {
                Ok(found) => {
                    assert!(found == expected, "{what}: read as something else");
                    harmless += 1;
                }
                Err(told) => {
                    is_told(&told, &out, &what);
                    named += 1;
                }
            }
            fs::write(out.join(name), &whole[name]).unwrap();
        }
    }
    assert!(
        named > harmless && named > 100,
        "{harmless} changed nothing, {named} were named"
    );
}
