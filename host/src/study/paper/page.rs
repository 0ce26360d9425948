//! The page: each figure beside what the paper says of it.

use std::fmt::Write as _;

use super::{CLOTHS, PATTERN_STEP_DEG, RIGS};
use crate::base::text::duration;
use crate::measure::report::{Summary, escape};
use crate::study::{COMPARED_IMAGE_SIZE, LIGHT_PHIS, LIGHT_THETAS, SPHERE_PX, Study};

/// A figure and what is said of it.
struct Entry {
    title: String,
    /// Pictures, relative to the page.
    pictures: Vec<String>,
    /// Tables and other files, relative to the page.
    files: Vec<String>,
    paper: String,
    ours: String,
}

/// The whole page.
pub(super) fn page(study: &Study, measurements: &[Summary], step_deg: f64) -> String {
    let mut body = String::new();
    for entry in entries(study, measurements, step_deg) {
        let pictures: String = entry.pictures.iter().fold(String::new(), |mut html, picture| {
            write!(html, "<a href=\"{picture}\"><img src=\"{picture}\" alt=\"\"></a>")
                .expect("strings take everything");
            html
        });
        let files: Vec<String> = entry
            .files
            .iter()
            .map(|file| format!("<a href=\"{file}\">{file}</a>"))
            .collect();
        writeln!(
            body,
            "<section><h2>{}</h2><div class=\"pair\"><div>{pictures}</div><div><h3>The paper</h3><p>{}</p>\
             <h3>Here</h3><p>{}</p><p>{}</p></div></div></section>",
            escape(&entry.title),
            escape(&entry.paper),
            escape(&entry.ours),
            files.join(", "),
        )
        .expect("strings take everything");
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>The figures of the RCG paper</title>\n\
         <style>body{{font:16px/1.5 system-ui,sans-serif;max-width:84em;margin:2em auto;padding:0 1em}}\
         .pair{{display:grid;grid-template-columns:3fr 2fr;gap:2em}}img{{max-width:100%}}\
         h3{{font-size:1em;margin-bottom:0}}h3+p{{margin-top:0}}</style>\n\
         <h1>The figures of the RCG paper, from our own data</h1>\n\
         <p>Y. Mukaigawa, K. Sumino, Y. Yagi: Rapid BRDF measurement using an ellipsoidal mirror and a projector. IPSJ \
         Transactions on Computer Vision and Applications 1, 21–32 (2009). “The paper” sums up what the paper shows, in \
         our words; “Here” is what this program made. All measurements are those of the virtual rig, with noise; the \
         dimensions of its mirror are ours, since the paper gives none. The cloths are models, since the paper's are not \
         at hand.</p>\n{body}</html>\n"
    )
}

/// All figures in their order; cloths were measured every `step_deg` degrees.
fn entries(study: &Study, measurements: &[Summary], step_deg: f64) -> Vec<Entry> {
    let mut entries = Vec::from(capture_entries(study, &measurements[0]));
    entries.extend(simulation_entries(study));
    entries.extend(cloth_entries(measurements, step_deg));
    entries
}

/// The path of a figure, relative to the page.
fn file(name: &str) -> String {
    format!("figures/{name}")
}

/// Patterns, images of the measurement `camera`, and spheres from coarse captures.
fn capture_entries(study: &Study, camera: &Summary) -> [Entry; 3] {
    [
        Entry {
            title: "Incident directions as projector patterns".to_owned(),
            pictures: vec![file("patterns.png")],
            files: Vec::new(),
            paper: "A lit spot of the projector's image is an incident direction: 360 × 90 = 32,400 of them for a \
                    material. The mirror's hole hides 0 to 27° around the normal."
                .to_owned(),
            ours: format!(
                "Patterns of the rig {}: to the left one, to the right all of a grid of {PATTERN_STEP_DEG}° that reach \
                 the sample. What is missing in the middle is the hole, the gap in a ring the wire that holds the sample.",
                RIGS[0]
            ),
        },
        Entry {
            title: "Camera images".to_owned(),
            pictures: vec!["ward-brass/figures/frames.png".to_owned()],
            files: vec!["ward-brass/report.html".to_owned()],
            paper: "One camera image holds the whole hemisphere of outgoing directions. A material takes about 50 minutes \
                    (the text gives 0.18 s an image too, which would make 97 minutes)."
                .to_owned(),
            ours: format!(
                "Images of {} on the rig {} from steep to grazing incidence, each stretched to its own range: {} \
                 exposures, {} of them on the instrument.",
                camera.sample,
                camera.rig,
                camera.exposures,
                duration(camera.instrument_s)
            ),
        },
        Entry {
            title: "Figure 7: spheres rendered from coarse captures".to_owned(),
            pictures: vec![file("comparison.png")],
            files: Vec::new(),
            paper: "Spheres of rolled brass (Ward's model, αx 0.05, αy 0.16), rendered from simulated captures, are held \
                    against the true ones."
                .to_owned(),
            ours: format!(
                "The same brass (ρd 0.10, ρs 0.33), exposure {}: the sample itself and reconstructions by linear \
                 interpolation in all four angles.",
                study.exposure
            ),
        },
    ]
}

/// PSNR of simulated captures, as the paper has it and beyond.
fn simulation_entries(study: &Study) -> Vec<Entry> {
    let mut entries = Vec::new();
    let simulation = format!(
        "Spheres of {SPHERE_PX} × {SPHERE_PX} pixels under {LIGHT_THETAS} × {LIGHT_PHIS} lights; of the lights the one \
         with the smallest PSNR counts. Y is the worst of Y, Cb and Cr. Claim: more than 40 dB at intervals below 1° and \
         image sizes above 96 × 96."
    );
    for (title, stem) in [
        ("Figure 8: PSNR against the sampling interval", "psnr-interval"),
        ("Figure 9: PSNR against the image size", "psnr-image-size"),
    ] {
        entries.push(Entry {
            title: title.to_owned(),
            pictures: vec![file(&format!("{stem}.svg"))],
            files: vec![
                file(&format!("{stem}.png")),
                file("study.csv"),
                file("study.json"),
            ],
            paper: simulation.clone(),
            ours: said_of(study),
        });
    }
    entries.push(Entry {
        title: "Beyond the paper: interpolation of coarse captures".to_owned(),
        pictures: vec![file("psnr-captures.svg")],
        files: vec![file("psnr-captures.png"), file("methods.csv")],
        paper: "Not in the paper.".to_owned(),
        ours: format!("The same spheres from few captures of {COMPARED_IMAGE_SIZE} × {COMPARED_IMAGE_SIZE} pixels, by rule of interpolation."),
    });
    entries
}

/// Reflectance and pictures of the cloths as they were measured.
fn cloth_entries(measurements: &[Summary], step_deg: f64) -> Vec<Entry> {
    let mut entries = Vec::new();
    for cloth in CLOTHS {
        let summary = measurements.iter().find(|summary| summary.sample == cloth);
        let exposures = summary.map_or(0, |summary| summary.exposures);
        entries.push(Entry {
            title: format!("Figure 16: reflectance of {cloth}"),
            pictures: vec![file(&format!("{cloth}-measured.svg")), file(&format!("{cloth}-model.svg"))],
            files: vec![file(&format!("{cloth}-measured.csv")), format!("{cloth}/report.html")],
            paper: "Reflectance of velvet and satin against the azimuth φr at θr = 30°, for light from (30°, 0°), (30°, \
                    45°) and (30°, 90°)."
                .to_owned(),
            ours: format!(
                "Above as measured on the rig {} every {step_deg}° ({exposures} exposures), below the model that was \
                 measured. A gap is a direction without a value.",
                RIGS[1]
            ),
        });
    }
    for cloth in CLOTHS {
        entries.push(Entry {
            title: format!("Figures 17 and 18: spheres and corrugated planes of {cloth}"),
            pictures: vec![file(&format!("{cloth}-rendered.png"))],
            files: Vec::new(),
            paper: "Spheres and corrugated planes are rendered with the measured velvet and satin.".to_owned(),
            ours: "Rendered from the measurement above, one column per light, with attached and cast shadows; directions \
                   without a value would be hatched."
                .to_owned(),
        });
    }
    entries
}

/// The study's own figures in words.
fn said_of(study: &Study) -> String {
    let papers = study
        .rows
        .iter()
        .find(|row| row.image_size == 96 && (row.interval_deg - 1.0).abs() < 1e-9);
    let at = papers
        .and_then(|row| row.psnr.psnr_y_db)
        .map_or_else(String::new, |db| format!(" At 1° and 96 × 96 it is {db:.1} dB."));
    let coarsest = study
        .rows
        .iter()
        .filter(|row| row.psnr.exact || row.psnr.psnr_y_db.is_some_and(|db| db > 40.0))
        .min_by_key(|row| (row.captures, row.image_size));
    let first = coarsest.map_or_else(String::new, |row| {
        format!(
            " More than 40 dB are reached with {} captures ({}°) of {} × {}.",
            row.captures, row.interval_deg, row.image_size, row.image_size
        )
    });
    format!(
        "Smallest PSNR of Y over the lights, {}, exposure {}, the whole picture; brass is grey, so Cb and Cr have no \
         error.{at}{first} Our images are equal-area disks, finer at the normal than a camera's image of the mirror of the \
         same size.",
        study.sample, study.exposure
    )
}
