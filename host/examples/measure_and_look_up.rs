//! Measures brass on the virtual rig and looks one pair of directions up in what came of it.
//!
//! `cargo run --release --example measure_and_look_up [FOLDER]`; without a folder a new one under the system's temporary
//! files. A coarse grid and small images: some seconds.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use rcg::base::progress::Silent;
use rcg::brdf::Brdf;
use rcg::hemisphere::direction::{from_degrees, to_degrees};
use rcg::hemisphere::incident::Grid;
use rcg::instrument::rig::Rig;
use rcg::measure::{complete, prepare};
use rcg::plan::{Request, Virtual};
use rcg::virtual_rig::setup::Setup;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map_or_else(
        || std::env::temp_dir().join(format!("rcg-example-{}", std::process::id())),
        PathBuf::from,
    );
    measure(&folder)?;

    let brdf = Brdf::open(&folder.join("brdf.zarr"))?;
    // Both directions point away from the surface. This is the mirror direction, 5° off it, so that the lobe is in sight.
    let (wi, wo) = (from_degrees(45.0, 30.0), from_degrees(40.0, 210.0));

    // Any pair: interpolated between what was captured, or the reason why there is no value.
    println!("incident (45°, 30°), outgoing (40°, 210°):");
    for value in brdf.values(&[(wi, wo), (wo, wi), (DVec3::Z, wo)])? {
        match value {
            Ok([r, g, b]) => println!("  f = {r:.4} {g:.4} {b:.4} 1/sr"),
            Err(reason) => println!("  no value: {reason}"),
        }
    }
    println!(
        "(the pair, the exchanged pair, and one with the light at the normal, where the mirror has its hole)"
    );

    nearest_sample(&brdf, wi, wo)
}

/// The whole job: plan, capture, assembly, evaluation and report, into `folder`, which must be new or empty.
fn measure(folder: &Path) -> Result<(), Box<dyn Error>> {
    let rig = Rig::load("rcg-1-16bit")?;
    let request = Request {
        grid: Grid::ThetaPhi { step_deg: 10.0 },
        image_size: 48,
        // A pilot capture finds how long.
        ..Request::default()
    };
    let setup = Setup::from(Virtual {
        sample: "ward:brass".to_owned(),
        ..Virtual::default()
    });
    let (job, measurement) = prepare(folder, &rig, request, &setup, &Silent)?;
    // The library has no clock of its own.
    let began = Instant::now();
    let summary = complete(&measurement, &job, &|| began.elapsed(), &Silent)?;
    println!(
        "{} on {}: {} exposures of {:.3} ms, {} samples; see {}",
        summary.sample,
        summary.rig,
        summary.exposures,
        summary.exposure_s * 1e3,
        summary.evaluation.measured_samples,
        measurement.path("report.html").display()
    );
    Ok(())
}

/// Prints the stored sample next to (`wi`, `wo`) as it stands in the file, with its standard uncertainty.
fn nearest_sample(brdf: &Brdf, wi: DVec3, wo: DVec3) -> Result<(), Box<dyn Error>> {
    // A file is a table: a row for each incident direction, in it a cell for each outgoing one. Rows come in chunks.
    let heaviest = |neighbours: [(usize, f64); 4]| {
        let heaviest = neighbours.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        heaviest.map_or(0, |(index, _)| index)
    };
    let row = heaviest(brdf.grid().neighbours(wi));
    let cell = heaviest(
        brdf.disk()
            .neighbours(wo)
            .ok_or("the direction is below the horizon")?,
    );
    let chunk = (0..brdf.chunks())
        .find(|&chunk| brdf.chunk_range(chunk).contains(&row))
        .ok_or("no chunk has this row")?;

    let (theta_i, phi_i) = brdf.grid().angles_deg(row);
    let (theta_o, phi_o) = brdf
        .disk()
        .direction(cell)
        .map_or((f64::NAN, f64::NAN), to_degrees);
    println!("nearest sample: incident ({theta_i:.1}°, {phi_i:.1}°), outgoing ({theta_o:.1}°, {phi_o:.1}°)");
    let Some(rows) = brdf.chunk(chunk)? else {
        println!("  nothing of its chunk was measured");
        return Ok(());
    };
    // Axes: incident direction within the chunk, cell, channel.
    let sample = (row - brdf.chunk_range(chunk).start) * brdf.disk().len() + cell;
    for channel in 0..brdf.channels() {
        let at = sample * brdf.channels() + channel;
        let (f, sigma) = (rows.f[at], rows.sigma[at].to_f32());
        println!("  channel {channel}: f = ({f:.4} ± {sigma:.4}) 1/sr, k = 1");
    }
    if let Some(missing) = brdf.uncalibrated().filter(|missing| !missing.is_empty()) {
        println!("  without any part of {}: not calibrated", missing.join(", "));
    }
    Ok(())
}
