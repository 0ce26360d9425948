//! Law: the virtual rig sees the same whichever trigger box drives it, and whenever that was switched on.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Duration;

use rcg::base::progress::Silent;
use rcg::capture::Instrument;
use rcg::capture::camera::Frame;
use rcg::capture::device::DeviceError;
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{complete, prepare};
use rcg::plan::pattern::BitPattern;
use rcg::plan::schedule::Timing;
use rcg::plan::{Faults, Request, Virtual};
use rcg::virtual_rig::setup::{Setup, TriggerBox};
use rcg_protocol::{Pace, Program, Start, State, Ticks};
use rcg_tests::Bridge;

const CALM: Faults = Faults {
    missed_triggers: 0.0,
    dropped_frames: 0.0,
    doubled_frames: 0.0,
};
const FAULTS: Faults = Faults {
    missed_triggers: 0.05,
    dropped_frames: 0.05,
    doubled_frames: 0.05,
};

fn setup(bridge: Option<&Bridge>, noise: bool, faults: Faults) -> Setup {
    Setup {
        trigger_box: bridge.map(|bridge| TriggerBox {
            port: bridge.port.clone(),
            wires: bridge.wires.clone(),
        }),
        calibration: None,
        virtual_rig: Virtual {
            noise,
            seed: 5,
            faults,
            ..Virtual::default()
        },
        session: None,
    }
}

fn request() -> Request {
    Request {
        grid: Grid::ThetaPhi { step_deg: 15.0 },
        image_size: 32,
        ..Request::default()
    }
}

/// Every file below `dir`, by its path from there.
fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let inner = self::files(&path).into_iter();
            files.extend(inner.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            files.insert(name, fs::read(path).unwrap());
        }
    }
    files
}

#[test]
fn a_measurement_has_the_same_bits_behind_a_port() {
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::load("rcg-1-16bit").unwrap();
    let measure = |name: &str, setup: &Setup| {
        let (job, measurement) = prepare(&dir.path().join(name), &rig, request(), setup, &Silent).unwrap();
        let summary = complete(&measurement, &job, &|| Duration::ZERO, &Silent).unwrap();
        let read = |part: &str| files(&measurement.path(part));
        (summary.capture, read("brdf.zarr"), read("raw.zarr"))
    };
    let simulated = measure("simulated", &setup(None, true, FAULTS));
    assert!(simulated.0.missed_triggers > 0 && simulated.0.dropped_frames > 0);
    assert!(simulated.1.len() > 3 && simulated.2.len() > 3);
    for (start, late) in [(1, 0), (987_654_321_987, 0), (3, 1)] {
        let bridge = Bridge::new(Ticks(start), Ticks(late));
        let behind_a_port = measure(&format!("port-{start}"), &setup(Some(&bridge), true, FAULTS));
        assert_eq!(behind_a_port.0, simulated.0, "from tick {start}");
        for (part, ours, theirs) in [
            ("brdf.zarr", &behind_a_port.1, &simulated.1),
            ("raw.zarr", &behind_a_port.2, &simulated.2),
        ] {
            assert!(ours.keys().eq(theirs.keys()), "{part}");
            for (name, bytes) in ours {
                // What a late edge of STROBE changes is its own record, and the seal over all records, no frame; the lineage of the result
                // names the seals.
                let is_of_record = name.starts_with("strobe_") || name.starts_with("seal/");
                let is_lineage = part == "brdf.zarr" && name == "zarr.json";
                let its_own = late > 0 && (is_of_record || is_lineage);
                assert!(
                    its_own || bytes == &theirs[name],
                    "{part}/{name} differs, from tick {start}"
                );
            }
        }
    }
}

/// Frames of four patterns, each 200 pixels of the projector, under `program`.
fn expose(instrument: &mut Instrument, timing: &Timing, program: &Program) -> Vec<Frame> {
    let Instrument {
        device,
        camera,
        projector,
        ..
    } = instrument;
    let (width_px, height_px) = projector.size_px();
    projector.clear().unwrap();
    for pattern in 0..4 {
        let mut image = BitPattern::black(width_px, height_px);
        let middle = (width_px * height_px / 3) as u32 + 5000 * pattern;
        image.light(&(middle..middle + 200).collect::<Vec<_>>());
        projector.load(&image).unwrap();
    }
    camera.arm().unwrap();
    let step = timing.step(device.info().clock_hz);
    device.load(program, &[step]).unwrap();
    let run = device.arm().unwrap();
    device.start().unwrap();
    let ending = device.follow(run, |_| Ok::<(), DeviceError>(())).unwrap();
    assert_eq!((ending.state, ending.steps_done), (State::Done, 4));
    std::iter::from_fn(|| camera.next_frame(Duration::ZERO).unwrap()).collect()
}

#[test]
fn runs_that_begin_on_sync_have_the_same_images() {
    let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(32).unwrap();
    let timing = Timing::new(&rig, 0.004).unwrap();
    // Noise off: what differs between two runs of one instrument is then the exposure.
    let free = Timing::program(4);
    let images = |setup: &Setup| {
        let mut instrument = setup.world().unwrap().open(&rig, None).unwrap();
        let programs = [
            free,
            Program {
                start: Start::OnSync,
                ..free
            },
            Program {
                pace: Pace::EachOnSync,
                ..free
            },
        ];
        programs.map(|program| {
            let frames = expose(&mut instrument, &timing, &program);
            frames
                .into_iter()
                .map(|frame| (frame.id, frame.dn))
                .collect::<Vec<_>>()
        })
    };
    let [at_once, on_sync, each_on_sync] = images(&setup(None, false, CALM));
    assert_eq!(at_once.len(), 4);
    assert!(
        at_once.windows(2).all(|pair| pair[0].1 != pair[1].1),
        "patterns differ"
    );
    assert!(at_once == on_sync && at_once == each_on_sync);
    let bridge = Bridge::new(Ticks(31_415_927), Ticks::ZERO);
    assert!(
        images(&setup(Some(&bridge), false, CALM))
            .iter()
            .all(|images| *images == at_once)
    );
}

#[test]
fn a_box_that_is_still_busy_is_taken_over() {
    let rig = Rig::load("rcg-1-16bit").unwrap().with_image_size(16).unwrap();
    let bridge = Bridge::new(Ticks(3), Ticks::ZERO);
    let world = setup(Some(&bridge), true, CALM).world().unwrap();
    let mut first = world.open(&rig, None).unwrap();
    let timing = Timing::new(&rig, 0.004).unwrap();
    // Far more steps than the box can play before the next client comes.
    let step = timing.step(first.device.info().clock_hz);
    first.device.load(&Timing::program(u32::MAX), &[step]).unwrap();
    first.device.arm().unwrap();
    assert_eq!(first.device.start().unwrap().state, State::Running);
    drop(first);
    let mut second = world.open(&rig, None).unwrap();
    assert_eq!(expose(&mut second, &timing, &Timing::program(4)).len(), 4);
}
