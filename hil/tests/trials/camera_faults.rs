//! Faults of a camera on the network, in the middle of a measurement.

use rcg_hil::bench::{Bench, Outcome};
use rcg_hil::figures::Limit;
use rcg_hil::gige::{Faults, PixelFormat, Settings};

use crate::table::{counted, measure, same, simulated_of, table};

crate::trials!("camera":
    a_camera_that_changes_or_hears_nothing_ends_the_run_by_name [Emulator FastLink Camera],
    a_driver_with_two_buffers_loses_nothing_that_is_not_taken_again [Emulator FastLink Camera],
);

fn a_camera_that_changes_or_hears_nothing_ends_the_run_by_name(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let expected = simulated_of(bench, folder)?;
    let table = table(bench, folder, false, Settings::default())?;
    // Ids go on from run to run: three frames by software came first, 20 are within the first runs.
    let other: Vec<_> = (12..20).map(|id| (id, PixelFormat::Mono8)).collect();
    for (name, faults, told) in [
        (
            "another format",
            Faults {
                formats: other,
                ..Faults::default()
            },
            "has somebody else set its region or pixel format?",
        ),
        // Frames that do not come are wanted again, for which it would have to hear.
        (
            "deaf",
            Faults {
                silent: true,
                starved: (8..40).collect(),
                ..Faults::default()
            },
            "the connection has ended",
        ),
    ] {
        table.set_faults_after(6, faults);
        let more: &[&str] = if folder.join("table").exists() {
            &["--resume"]
        } else {
            &[]
        };
        let error = match measure(folder, "rig.toml", "table", more) {
            Ok(_) => return Err(format!("{name}: a measurement ended with it").into()),
            Err(error) => error.message().unwrap_or_default().to_owned(),
        };
        if !error.contains(told) {
            return Err(format!("{name} is told of as: {error}").into());
        }
        table.revive()?;
    }
    let (_, found) = measure(folder, "rig.toml", "table", &["--resume"])?;
    table.clear()?;
    same(&expected, &found)?;
    Ok(())
}

fn a_driver_with_two_buffers_loses_nothing_that_is_not_taken_again(bench: &mut Bench) -> Outcome {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    let expected = simulated_of(bench, folder)?;
    let table = table(bench, folder, false, Settings::default())?;
    let rig = std::fs::read_to_string(folder.join("rig.toml"))?;
    let few = rig.replace("buffers = 256", "buffers = 2");
    if few == rig {
        return Err("expected a rig file with 256 buffers, found none".into());
    }
    std::fs::write(folder.join("few.toml"), few)?;
    let (printed, found) = measure(folder, "few.toml", "table", &[])?;
    table.clear()?;
    same(&expected, &found)?;
    bench.figure(
        "exposures that were taken again by a driver with two buffers",
        counted(&printed, "repeated")? as f64,
        "exposures",
        Limit::AtMost(8.0),
    )
}
