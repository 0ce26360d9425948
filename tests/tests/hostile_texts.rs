//! Law: whatever stands in a rig file or a plan, it is read as one that can be used, or refused in one sentence with its path. No panic, and no
//! memory that grows with a number that stands there.

use std::fs;
use std::path::Path;

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::plan::{Plan, Request};
use rcg_tests::is_full;

/// What may stand in the place of a number.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "nan",
    "inf",
    "-0.0",
    "1e308",
    "5e-324",
    "4294967296",
    "9223372036854775807",
    "0.1",
    "true",
    "\"7\"",
    "[]",
];

/// `text` with some of it changed.
fn changed(text: &str, rng: &mut Xoshiro256PlusPlus) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..5) {
            0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => {
                let end = (at + rng.random_range(1..40)).min(bytes.len());
                bytes.drain(at..end);
            }
            2 => {
                let end = (at + rng.random_range(1..40)).min(bytes.len());
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            _ => {
                // The number behind the next `=`.
                let Some(from) = bytes[at..].iter().position(|&byte| byte == b'=') else {
                    continue;
                };
                let from = at + from + 1;
                let end = bytes[from..].iter().position(|&byte| byte == b'\n');
                let number = NUMBERS[rng.random_range(0..NUMBERS.len())];
                bytes.splice(from..end.map_or(bytes.len(), |end| from + end), number.bytes());
            }
        }
        if bytes.is_empty() {
            bytes.push(b'\n');
        }
    }
    bytes
}

fn is_told(told: &str, path: &Path, content: &[u8]) {
    let content = String::from_utf8_lossy(content);
    assert!(
        told.contains(path.to_str().unwrap()) && !told.contains('\n'),
        "{told}\n{content}"
    );
}

#[test]
fn rigs_and_plans_are_usable_or_refused_by_name() {
    let scratch = tempfile::tempdir().unwrap();
    let (rig_path, plan_path) = (scratch.path().join("rig.toml"), scratch.path().join("plan.toml"));
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../host");
    let presets = ["rcg-1", "rcg-2", "rcg-3", "dmd"]
        .map(|name| root.join(format!("src/instrument/rig/presets/{name}.toml")));
    let rigs: Vec<String> = presets
        .iter()
        .chain([&root.join("rigs/lab.toml")])
        .map(|path| fs::read_to_string(path).unwrap())
        .collect();
    let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(16).unwrap();
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 15.0 },
        image_size: 16,
        ..Request::default()
    };
    let plan = Plan::new(request, &rig, 0.01).unwrap().to_toml();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
    let (mut usable, mut refused) = (0, 0);
    for round in 0..if is_full() { 100_000 } else { 1500 } {
        let content = changed(&rigs[round % rigs.len()], &mut rng);
        fs::write(&rig_path, &content).unwrap();
        match Rig::load(rig_path.to_str().unwrap()) {
            Ok(_) => usable += 1,
            Err(error) => {
                is_told(&error.to_string(), &rig_path, &content);
                refused += 1;
            }
        }
        let content = changed(&plan, &mut rng);
        fs::write(&plan_path, &content).unwrap();
        match Plan::read(&plan_path) {
            Ok(plan) => match plan.check(&plan_path) {
                Ok(()) => usable += 1,
                Err(error) => is_told(&error.to_string(), &plan_path, &content),
            },
            Err(error) => {
                is_told(&error.to_string(), &plan_path, &content);
                refused += 1;
            }
        }
    }
    assert!(
        usable > 100 && refused > 100,
        "{usable} usable, {refused} refused"
    );
}
