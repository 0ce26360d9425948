//! One picture, or one round of advice, in the terminal.

use std::fmt::Write as _;

use rcg::calibrate::geometry::alignment::{Advice, advise};
use rcg::calibrate::live::{Settings, Table};
use serde_json::json;

use crate::Done;
use crate::calibrate::hands::Lines;
use crate::failure::Failure;
use crate::output::Output;

/// Takes one picture and prints its figures; the exposure time is found first where that `is_open`.
pub(crate) fn picture(mut table: Table, is_open: bool, output: &Output) -> Done {
    if is_open {
        let exposure_s = table.auto_exposure_s()?;
        let settings = table.settings().clone();
        table.set(Settings {
            exposure_s,
            ..settings
        })?;
    }
    let shot = table.shoot()?;
    let settings = table.settings();
    let value = json!({
        "shown": settings.shown.to_string(), "exposure_ms": settings.exposure_s * 1e3, "gain": settings.gain, "holder": settings.held,
        "strobe": shot.strobe, "attempts": shot.attempts, "look": shot.look, "outlines": shot.outlines,
    });
    output.print(&value, || {
        let look = &shot.look;
        let mut text = format!(
            "{} for {:.4} ms, {} in the holder\nSTROBE {:.2} µs after the trigger, {:.2} µs long\nmedian {} of {}, one value in a thousand \
             above {}, {} of {} saturated\nfocus figure {:.2}\n",
            settings.shown,
            settings.exposure_s * 1e3,
            settings.held,
            shot.strobe.delay_us,
            shot.strobe.width_us,
            look.median_dn,
            look.full_dn,
            look.bright_dn,
            look.saturated,
            look.values,
            look.sharpness
        );
        for outline in &shot.outlines {
            let seen = outline.seen.map_or_else(
                || "not seen".to_owned(),
                |seen| {
                    let [right, down] = seen.shift_px;
                    format!(
                        "seen {:.1} px from where it is expected (RMS): {right:+.1} px to the right, {down:+.1} px down",
                        seen.distance_px
                    )
                },
            );
            writeln!(text, "{}: {seen}", outline.name).expect("strings take everything");
        }
        text
    })
}

/// Takes the views and prints what they advise.
pub(crate) fn advice(mut table: Table, output: &Output) -> Done {
    let folder = tempfile::tempdir()?;
    let dir = folder.path().join("views");
    if !table.views(&dir, None, &mut Lines { output }, output)? {
        return Err(Failure::input(
            "--advise: expected all views, found that somebody stopped",
        ));
    }
    let advice = advise(&dir)?;
    output.print(&advice, || text(&advice))
}

fn text(advice: &Advice) -> String {
    let mut text = String::new();
    for one in &advice.moves {
        let mark = if one.is_clear { "→" } else { " " };
        writeln!(text, "{mark} {}", one.words).expect("strings take everything");
    }
    for one in &advice.undetermined {
        let space = if one.unit == "mm" { " " } else { "" };
        writeln!(
            text,
            "  not told: {} (± {:.1}{space}{})",
            one.what, one.standard_uncertainty, one.unit
        )
        .expect("strings take everything");
    }
    writeln!(
        text,
        "directions are off by {:.2}° (RMS), {:.2}° behind these moves; centres by {:.2} ± {:.2} mm\n{}",
        advice.directions_deg,
        advice.directions_after_deg,
        advice.lateral_mm,
        advice.lateral_uncertainty_mm,
        if advice.is_aligned {
            "aligned: calibrate now"
        } else {
            "make the moves marked with →, then ask again"
        }
    )
    .expect("strings take everything");
    text
}
