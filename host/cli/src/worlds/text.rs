//! Worlds in words.

use std::fmt::Write as _;

use rcg::judge::worlds::{Judgement, OfPreset, Outcome, Summary, World};

/// A share in percent, or `none`.
fn percent(share: Option<f64>, digits: usize) -> String {
    share.map_or_else(
        || "none".to_owned(),
        |share| format!("{:.digits$} %", 100.0 * share),
    )
}

/// What stands in a world and how it ended, in one line.
pub(super) fn line(world: &World) -> String {
    let (rig, request) = (&world.rig, &world.request);
    let flaws: Vec<&str> = rig.flaws.iter().map(|(_, value)| value.as_str()).collect();
    let mut line = format!(
        "rig {} world {}: {} ({}), {}, {}, brackets {}",
        rig.index,
        request.index,
        rig.preset,
        flaws.join("/"),
        request.sample,
        request.grid,
        request.brackets
    );
    if request.light != "single" {
        write!(line, ", light {}", request.light).expect("strings take everything");
    }
    if request.estimate {
        line.push_str(", estimated");
    }
    for tilt in &request.captures {
        let tilt = tilt.as_deref().unwrap_or("none");
        if request.captures.len() > 1 || tilt != "none" {
            write!(line, ", tilt {tilt}").expect("strings take everything");
        }
    }
    for (option, rate) in &request.faults {
        write!(line, ", {option} {rate}").expect("strings take everything");
    }
    write!(line, ": {}", world.outcome.name()).expect("strings take everything");
    match &world.outcome {
        Outcome::Refused { command, sentence } => {
            write!(line, " by {command}: {sentence}").expect("strings take everything");
        }
        Outcome::Broken { command, ending } => {
            write!(line, " by {command}: {ending}").expect("strings take everything");
        }
        Outcome::Right | Outcome::Silent { .. } => {}
    }
    for file in &world.files {
        write!(line, "; {} {}", file.name, figures(&file.judgement)).expect("strings take everything");
    }
    write!(line, "; {:.0} s", world.elapsed_s).expect("strings take everything");
    line
}

fn figures(judgement: &Judgement) -> String {
    let worst = judgement.worst.first().map_or(0.0, |one| one.z.abs());
    let scale = judgement.scale.map_or_else(
        || "none".to_owned(),
        |scale| format!("{:.4} ± {:.4}", scale.value, scale.standard_uncertainty),
    );
    format!(
        "error {}, σ {}, {} within 2 σ ({} beside the scale), worst {worst:.1} σ, scale {scale}",
        percent(judgement.median_error, 2),
        percent(judgement.median_sigma, 2),
        percent(judgement.measured.coverage(), 1),
        percent(judgement.own_coverage, 1)
    )
}

/// What is wrong in a world and its worst samples, a line each.
pub(super) fn faults(world: &World) -> Vec<String> {
    let Outcome::Silent { wrong } = &world.outcome else {
        return Vec::new();
    };
    let mut lines: Vec<String> = wrong.iter().map(|sentence| format!("    {sentence}")).collect();
    let files = world.files.iter().filter(|file| !file.judgement.wrong.is_empty());
    for file in files {
        for one in &file.judgement.worst {
            let [theta_i, phi_i, theta_o, phi_o] = one.directions_deg;
            lines.push(format!(
                "    {}: θi {theta_i:.2}° φi {phi_i:.2}° θo {theta_o:.2}° φo {phi_o:.2}° channel {}: f {:.6}, true {:.6}, \
                 σ {:.6} /sr, z {:.1}",
                file.name, one.channel, one.f, one.truth, one.sigma, one.z
            ));
        }
    }
    lines
}

const HEAD: &str =
    "rig       worlds  right refused silent broken      samples  scored   error       σ  within 2σ  >6σ >10σ";

fn row(of: &OfPreset) -> String {
    format!(
        "{:<9} {:>6} {:>6} {:>7} {:>6} {:>6} {:>12} {:>7} {:>7} {:>7} {:>11} {:>4} {:>4}",
        of.preset,
        of.worlds,
        of.right,
        of.refused,
        of.silent,
        of.broken,
        of.measured.samples,
        percent(of.scored_share, 1),
        percent(of.median_error, 2),
        percent(of.median_sigma, 2),
        percent(of.coverage, 2),
        of.measured.beyond_6,
        of.measured.beyond_10
    )
}

/// All of them as tables.
pub(super) fn summary(summary: &Summary) -> String {
    let mut text = format!("{HEAD}\n");
    for of in &summary.presets {
        writeln!(text, "{}", row(of)).expect("strings take everything");
    }
    let none = if summary.presets.iter().all(|of| of.filled_in.is_empty()) {
        " none"
    } else {
        ""
    };
    writeln!(text, "\nfilled in (stated, not judged):{none}").expect("strings take everything");
    for (name, of) in summary.presets.last().iter().flat_map(|all| &all.filled_in) {
        writeln!(
            text,
            "{name:<14} {:>12} samples, {} within 2 σ, {} beyond 6 σ, {} beyond 10 σ",
            of.samples,
            percent(of.coverage(), 2),
            of.beyond_6,
            of.beyond_10
        )
        .expect("strings take everything");
    }
    let none = if summary.causes.is_empty() { " none" } else { "" };
    writeln!(text, "\nrefusals:{none}").expect("strings take everything");
    for cause in &summary.causes {
        writeln!(text, "{:>6}  {}: {}", cause.worlds, cause.command, cause.sentence)
            .expect("strings take everything");
    }
    writeln!(
        text,
        "\nflaws drawn       worlds        least    median      most"
    )
    .expect("strings take everything");
    for drawn in &summary.flaws {
        let [least, middle, most] = drawn.quantiles;
        writeln!(
            text,
            "{:<17} {:<8} {least:>9} {middle:>9} {most:>9}",
            drawn.option, drawn.ended
        )
        .expect("strings take everything");
    }
    text
}
