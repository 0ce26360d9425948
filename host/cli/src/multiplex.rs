//! `rcg multiplex`

use std::fmt::Write as _;

use rcg::base::progress::Progress as _;
use rcg::base::text::duration;
use rcg::instrument::rig::Rig;
use rcg::measure::Job;
use rcg::study::multiplex::choose::{Choice, Method, REGIONS, choose};
use rcg::virtual_rig::setup::Setup;
use serde_json::{Value, json};

use crate::Done;
use crate::failure::Failure;
use crate::output::Output;
use crate::request::{CalibrationArgs, PortArgs, RequestArgs, VirtualArgs};

/// Say whether multiplexed light pays: uncertainty of single, longer and multiplexed exposures in the same time.
///
/// A pilot capture on the virtual rig takes about 48 single exposures and a few of blocks of directions lit together.
/// From these and the camera's photon-transfer curve follows the median relative standard uncertainty over all values
/// with theta up to 80 degrees, and by the angle from the mirror direction: peak to 5, lobe to 20, diffuse to 60 degrees,
/// tail beyond. The smallest over all values is picked.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    request: RequestArgs,
    #[command(flatten)]
    calibration: CalibrationArgs,
    /// Most directions that are lit in one block, or auto for 7, 15, 31, 63, 127 and 255
    #[arg(long, value_name = "N|auto", default_value = "auto", value_parser = order)]
    order: Order,
    /// Read noise of the camera in electrons [default: as the rig says, or what calibration found]
    #[arg(long, value_name = "E", allow_negative_numbers = true)]
    read_noise: Option<f64>,
    #[command(flatten)]
    virtual_rig: VirtualArgs,
    #[command(flatten)]
    port: PortArgs,
}

/// Which orders are tried.
#[derive(Clone, Copy, Debug)]
enum Order {
    Auto,
    Given(usize),
}

fn order(text: &str) -> Result<Order, String> {
    match text {
        "auto" => Ok(Order::Auto),
        _ => text
            .parse()
            .map(Order::Given)
            .map_err(|_| "expected auto or a whole number of cells".to_owned()),
    }
}

pub(crate) fn run(args: &Args, rig: &str, output: &Output) -> Done {
    let (mut rig, calibration) = args.calibration.rig(Rig::load(rig)?.without_drivers())?;
    let trigger_box = args.port.trigger_box(&rig)?;
    let setup = Setup {
        virtual_rig: args.virtual_rig.virtual_rig(None),
        trigger_box,
        calibration,
        session: None,
    };
    let request = args.request.request(None)?;
    if request.exposure_s.is_some() || !request.brackets.is_one() {
        return Err(Failure::input(
            "multiplex: expected neither --exposure-ms nor --brackets, as it finds the exposure times of every alternative \
             itself, found one",
        ));
    }
    if !request.light.is_single() {
        return Err(Failure::input(format!(
            "--light: expected single, as multiplex compares single exposures with codes itself, found {}",
            request.light
        )));
    }
    if let Some(read_noise_e) = args.read_noise {
        if setup.virtual_rig.truth.is_some() || setup.calibration.is_some() {
            return Err(Failure::input(format!(
                "--read-noise: expected none with --truth or --calibration, which say what the camera really has, found \
                 {read_noise_e}"
            )));
        }
        rig = rig.with_read_noise(read_noise_e)?;
    }
    let job = Job::with_times(&rig, request, &[rig.camera.exposure_s], &setup, output)?;
    let mut instrument = job.open()?;
    let rig = match &job.calibration {
        Some(found) => found.with_camera(&job.rig),
        None => job.rig.clone(),
    };
    let sample = &setup.virtual_rig.sample;
    let order = match args.order {
        Order::Auto => None,
        Order::Given(order) => Some(order),
    };
    output.begin("pilot capture", 1, "runs");
    let choice = choose(&rig, &job.plan.request, order, &mut instrument)?;
    output.end();
    let mut value = serde_json::to_value(&choice).map_err(std::io::Error::from)?;
    if let Value::Object(object) = &mut value {
        object.insert("sample".to_owned(), json!(sample));
        object.insert("rig".to_owned(), json!(rig.name));
        object.insert("read_noise_e".to_owned(), json!(rig.camera.read_noise_e));
    }
    output.print(&value, || {
        let head = format!(
            "{sample} on {}, read noise {} e⁻: {} directions in {}\n",
            rig.name,
            rig.camera.read_noise_e,
            choice.directions,
            duration(choice.time_s)
        );
        head + &text(&choice)
    })
}

fn text(choice: &Choice) -> String {
    let mut text = String::from(
        "median relative standard uncertainty in %\nlight            exposures  exposure  repeats      all",
    );
    for (region, _) in REGIONS {
        write!(text, "  {region:>7}").expect("strings take everything");
    }
    text.push('\n');
    for (index, one) in choice.alternatives.iter().enumerate() {
        let light = match one.method {
            Method::Single => "single".to_owned(),
            Method::LongSingle => "single, longer".to_owned(),
            Method::Multiplexed => format!("order {}", one.order),
        };
        let percent = |value: f64| format!("{:.2}", 100.0 * value);
        let regions: Vec<String> = one
            .by_region
            .iter()
            .map(|value| format!("{:>7}", value.map_or_else(|| "-".to_owned(), percent)))
            .collect();
        writeln!(
            text,
            "{light:<15}  {:>9}  {:>8}  {:>7}  {:>7}  {}{}",
            one.exposures,
            duration(one.exposure_s),
            one.repeats,
            one.uncertainty.map_or_else(|| "-".to_owned(), percent),
            regions.join("  "),
            if index == choice.pick { "  <- pick" } else { "" }
        )
        .expect("strings take everything");
    }
    for refused in &choice.refused {
        writeln!(text, "order {} is left out: {}", refused.order, refused.reason)
            .expect("strings take everything");
    }
    text + &choice.verdict + "\n"
}
