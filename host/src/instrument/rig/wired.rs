//! What lies between the trigger box of a real rig and its parts.

use super::RigError;
use crate::instrument::drivers::{
    AuxFrom, AuxOutput, Delay, LONGEST_AUX_S, LONGEST_DELAY_S, LONGEST_GLITCH_S, LONGEST_SYNC_TIMEOUT_S,
    ProjectorDriver, Trigger, TriggerPace,
};

/// Checks what lies between the trigger box and the parts.
pub(super) fn check_wiring(
    trigger: &Trigger,
    projector: ProjectorDriver,
    error: impl Fn(&str, &str, &str) -> RigError,
) -> Result<(), RigError> {
    if projector == ProjectorDriver::Window && trigger.pace != TriggerPace::Free {
        let expected = "nothing beside a window, each picture of which begins a step";
        return Err(error("trigger.pace", expected, "a pace"));
    }
    let [proj, cam, strobe] = [trigger.proj_delay_s, trigger.cam_delay_s, trigger.strobe_delay_s];
    let spans = [
        (
            "sync_timeout_s",
            [trigger.sync_timeout_s; 2],
            LONGEST_SYNC_TIMEOUT_S,
        ),
        ("strobe_filter_s", [trigger.strobe_filter_s; 2], LONGEST_GLITCH_S),
        ("proj_delay_s", proj.0, LONGEST_DELAY_S),
        ("cam_delay_s", cam.0, LONGEST_DELAY_S),
        ("strobe_delay_s", strobe.0, LONGEST_DELAY_S),
    ];
    for (field, seconds, most) in spans {
        if let Some(wrong) = seconds.iter().find(|s| !(0.0..=most).contains(*s)) {
            let expected = format!("0 to {most} seconds");
            return Err(error(&format!("trigger.{field}"), &expected, &wrong.to_string()));
        }
    }
    // What is more than nothing may not become nothing in microseconds: that would be for ever.
    if trigger.sync_timeout_s > 0.0 && trigger.sync_timeout_s < 1e-6 {
        let found = trigger.sync_timeout_s.to_string();
        return Err(error(
            "trigger.sync_timeout_s",
            "0 or at least 1e-6 seconds",
            &found,
        ));
    }
    for (name, aux) in [("aux_a", trigger.aux_a), ("aux_b", trigger.aux_b)] {
        if let Some(aux) = aux {
            check_aux(trigger, &format!("trigger.{name}"), aux, &error)?;
        }
    }
    Ok(())
}

/// Checks what a further output does, which `field` says.
fn check_aux(
    trigger: &Trigger,
    field: &str,
    aux: AuxOutput,
    error: &impl Fn(&str, &str, &str) -> RigError,
) -> Result<(), RigError> {
    let AuxOutput {
        from,
        delay_s,
        width_s,
    } = aux;
    if !(0.0..=LONGEST_AUX_S).contains(&delay_s) {
        let expected = format!("0 to {LONGEST_AUX_S} seconds");
        return Err(error(
            &format!("{field}.delay_s"),
            &expected,
            &delay_s.to_string(),
        ));
    }
    match width_s {
        Some(width_s) if !(1e-8..=LONGEST_AUX_S).contains(&width_s) => {
            let expected = format!("1e-8 to {LONGEST_AUX_S} seconds");
            return Err(error(
                &format!("{field}.width_s"),
                &expected,
                &width_s.to_string(),
            ));
        }
        None if from == AuxFrom::Step => {
            let expected = "a length of the pulse, which CAM gives only where from is \"cam\"";
            return Err(error(&format!("{field}.width_s"), expected, "none"));
        }
        _ => {}
    }
    // Where edges leave earlier, steps begin earlier, and by how much depends on the step.
    let delayed = trigger.proj_delay_s != Delay::default() || trigger.cam_delay_s != Delay::default();
    if from == AuxFrom::Step && delayed {
        let expected =
            "\"cam\" beside trigger.proj_delay_s or trigger.cam_delay_s, by which steps begin earlier";
        return Err(error(&format!("{field}.from"), expected, "\"step\""));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::instrument::rig::tests::sentence;

    #[test]
    fn what_lies_between_box_and_parts_is_possible_or_refused() {
        let camera = (
            "[camera]",
            "[camera]\ndriver = \"genicam\"\ngenicam = { region_px = [0, 0, 2048, 2048], pixel_format = \"RGB16\" }",
        );
        for (settings, field, found) in [
            (
                "cam_delay_s = [0.0, 1.1e-3]",
                "trigger.cam_delay_s: expected 0 to 0.001",
                "found 0.0011",
            ),
            (
                "proj_delay_s = [-1e-9, 0.0]",
                "trigger.proj_delay_s",
                "found -0.000000001",
            ),
            (
                "strobe_delay_s = [nan, 0.0]",
                "trigger.strobe_delay_s",
                "found NaN",
            ),
            ("strobe_delay_s = [0.0]", "trigger", "2"),
            ("strobe_filter_s = 1.0", "trigger.strobe_filter_s", "found 1"),
            (
                "sync_timeout_s = 4295.0",
                "trigger.sync_timeout_s",
                "0 to 4294 seconds, found 4295",
            ),
            ("sync_timeout_s = 1e-7", "trigger.sync_timeout_s", "at least 1e-6"),
            ("active_low = [\"led\"]", "trigger", "strobe"),
            ("pace = \"each\"", "trigger", "sync-each"),
            ("polarity = 1", "trigger", "polarity"),
            (
                "aux_a = { from = \"step\" }",
                "trigger.aux_a.width_s",
                "found none",
            ),
            (
                "aux_b = { from = \"cam\", delay_s = -1e-6 }",
                "trigger.aux_b.delay_s: expected 0 to 18 seconds",
                "found -0.000001",
            ),
            (
                "aux_b = { from = \"cam\", width_s = 0.0 }",
                "trigger.aux_b.width_s",
                "found 0",
            ),
            ("aux_a = { from = \"proj\" }", "trigger", "proj"),
            ("aux_a = { delay_s = 1.0 }", "trigger", "from"),
            (
                "aux_a = { from = \"step\", width_s = 1e-3 }\ncam_delay_s = [1e-6, 2e-6]",
                "trigger.aux_a.from: expected \"cam\" beside",
                "found \"step\"",
            ),
        ] {
            let trigger = format!("[trigger]\n{settings}\n[mirror]");
            let projector = ("[projector]\n", "[projector]\ndriver = \"dlpc900\"\n");
            let sentence = sentence(&[camera, projector, ("[mirror]", &trigger)]);
            assert!(sentence.contains(field) && sentence.contains(found), "{sentence}");
        }
        let window = "[projector]\ndriver = \"window\"\nwindow = { patch_px = [0, 0, 9, 9] }\n";
        let paced = ("[mirror]", "[trigger]\npace = \"sync-start\"\n[mirror]");
        let sentence = sentence(&[camera, ("[projector]\n", window), paced]);
        assert!(
            sentence.contains("trigger.pace: expected nothing beside a window"),
            "{sentence}"
        );
    }
}
