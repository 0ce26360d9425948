//! Laws of the control chart: rules of values, and lines that one value does not draw to itself.

use super::*;
use crate::judge::chart::svg;

fn member(day: u64, relative: f64) -> Member {
    let departure = Departure {
        relative,
        standard_uncertainty: 2e-3,
        noise: 1e-4,
        stated: 5e-3,
    };
    Member {
        name: format!("day {day}"),
        began: Some(format!("2026-01-{:02}T08:00:00Z", day + 1)),
        departures: vec![Some(departure)],
    }
}

fn history(values: &[f64]) -> History {
    let members: Vec<Member> = (0..)
        .zip(values)
        .map(|(day, value)| member(day, *value))
        .collect();
    History::of_members(&members, Over::Mean, vec![String::new()]).unwrap()
}

#[test]
fn every_rule_is_broken_by_what_it_names_and_by_nothing_less() {
    use Rule::{BeyondAction, EightOnOneSide, TwoOfThreeBeyondWarning};
    for (deviations, rules) in [
        (&[0.0, 3.1][..], &[BeyondAction][..]),
        (&[0.0, -3.1], &[BeyondAction]),
        (&[3.1, 0.0], &[]),
        (&[2.1, 0.0, 2.1], &[TwoOfThreeBeyondWarning]),
        (&[2.1, 2.1], &[TwoOfThreeBeyondWarning]),
        (&[2.1, 0.0, 0.0, 2.1], &[]),
        (&[2.1, -2.1], &[]),
        (&[2.1, 2.1, 1.0], &[]),
        (&[0.1; 7], &[]),
        (&[0.1; 8], &[EightOnOneSide]),
        (&[-0.1; 9], &[EightOnOneSide]),
        (&[0.1, 0.1, 0.1, 0.0, 0.1, 0.1, 0.1, 0.1], &[]),
        (&[], &[]),
    ] {
        assert_eq!(broken(deviations), rules, "{deviations:?}");
    }
}

#[test]
fn one_value_that_is_off_is_named_and_the_others_are_not() {
    let found = history(&[1e-3, -1e-3, 0.5e-3, -0.5e-3, 0.05, 1e-3, -1e-3, 0.0]);
    assert_eq!(found.signals.len(), 1, "{:?}", found.signals);
    assert_eq!(
        (found.signals[0].number, found.signals[0].rule),
        (4, Rule::BeyondAction)
    );
    assert!((found.lines[0].mean - 1.0).abs() < 5e-4 && found.is_out_of_control());
    assert!(found.warnings[0].contains("day 4"), "{:?}", found.warnings);
    let calm = history(&[1e-3, -1e-3, 0.5e-3, -0.5e-3, 0.4e-3, 1e-3, -1e-3, 0.0]);
    assert!(calm.signals.is_empty() && calm.warnings.is_empty(), "{calm:?}");
}

#[test]
fn lines_are_no_closer_than_noise_and_a_drift_is_told() {
    let found = history(&[0.0, 1e-6]);
    assert!((found.lines[0].standard_deviation - 1e-4).abs() < 1e-12);
    let drift: Vec<f64> = (0..10).map(|day| 1e-3 * f64::from(day)).collect();
    let drift = history(&drift).lines[0].drift.unwrap();
    assert!(
        (drift.per_day - 1e-3).abs() < 1e-9 && drift.is_significant == Some(true),
        "{drift:?}"
    );
}

#[test]
fn the_table_has_all_and_the_chart_shows_it() {
    let mut members: Vec<Member> = (0..4).map(|day| member(day, 1e-3 * day as f64)).collect();
    members[1].name = "a, \"b\"".to_owned();
    let found = History::of_members(&members, Over::First, vec![String::new()]).unwrap();
    let table = found.csv();
    assert_eq!(table.lines().count(), 5);
    assert!(
        table.contains("\n\"a, \"\"b\"\"\",2026-01-02T08:00:00Z,1.000000,0,,1.001000,"),
        "{table}"
    );
    let charts = found.charts("it");
    assert_eq!((charts.len(), charts[0].curves.len()), (1, 6));
    assert!(svg(&charts).contains("days since 2026-01-01T08:00:00Z"));
}
