use std::collections::BTreeMap;

use super::*;

#[test]
fn what_is_written_is_read_again() {
    for (text, light) in [
        ("single", Light::Single),
        ("auto", Light::Auto),
        ("multiplexed", Light::Multiplexed(None)),
        ("multiplexed:63", Light::Multiplexed(Some(63))),
        ("complement:7", Light::Complement(Some(7))),
    ] {
        assert_eq!(text.parse(), Ok(light));
        assert_eq!(light.to_string(), text);
    }
    for text in [
        "",
        "coded",
        "single:3",
        "multiplexed:",
        "multiplexed:1",
        "complement:5000",
        "auto:7",
    ] {
        let error = text.parse::<Light>().unwrap_err();
        assert!(error.starts_with("expected `single`"), "{text}");
    }
}

#[test]
fn every_row_of_every_code_is_shown_once_and_inverted_rows_light_the_rest() {
    for (directions, order) in [(10, 3), (64, 63), (135, 63), (5, 5)] {
        for complement in [false, true] {
            let patterns = Coding { order, complement }.patterns(directions).unwrap();
            let each = if complement { 2 } else { 1 };
            assert_eq!(patterns.len(), patterns.blocks().exposures() * each);
            let mut shown = BTreeMap::new();
            for number in 0..patterns.len() {
                let CodePattern {
                    block,
                    row,
                    is_inverted,
                } = patterns.pattern(number);
                assert!(patterns.of_block(block).contains(&number));
                *shown.entry((block, row, is_inverted)).or_insert(0) += 1;
                let lit: Vec<usize> = patterns.lit(number).collect();
                let code = patterns.blocks().code(block);
                for (column, direction) in patterns.cells(block) {
                    assert_eq!(lit.contains(&direction), code.lights(row, column) != is_inverted);
                }
            }
            assert_eq!(shown.len(), patterns.len());
        }
    }
}

#[test]
fn every_cell_has_a_column_of_its_own() {
    for count in 1..300 {
        let codes = Coding {
            order: count,
            complement: false,
        };
        let patterns = codes.patterns(count).unwrap();
        let mut columns: Vec<usize> = patterns.cells(0).map(|(column, _)| column).collect();
        columns.sort_unstable();
        assert!(columns.into_iter().eq(0..count), "{count}");
    }
}

#[test]
fn no_pattern_of_a_block_is_much_brighter_than_the_others() {
    // Rings of 24 directions, from above to grazing.
    let light = |direction: usize| (((direction / 24) as f64 + 0.5) * 15.0).to_radians().cos();
    for (order, most) in [(15, 1.6), (31, 1.5), (63, 1.4)] {
        let codes = Coding {
            order,
            complement: true,
        };
        let patterns = codes.patterns(144).unwrap();
        for block in 0..patterns.blocks().count() {
            let half = patterns
                .cells(block)
                .map(|(_, direction)| light(direction))
                .sum::<f64>()
                / 2.0;
            for number in patterns.of_block(block) {
                let lit: f64 = patterns.lit(number).map(light).sum();
                assert!(
                    lit < most * half,
                    "order {order}, pattern {number}: {}",
                    lit / half
                );
            }
        }
    }
}

#[test]
fn orders_that_no_code_has_are_refused_and_few_directions_are_one_block() {
    let cell = |pixel: u32| LitSet {
        pixels: vec![pixel],
        solid_angle_sr: 1.0,
        irradiance: 1.0,
        centroid: glam::DVec3::Z,
    };
    let cells: Vec<LitSet> = (0..40).map(cell).collect();
    let order = |light: Light, cells: &[LitSet], most| {
        light.coding(cells, most).map(|code| code.map(|code| code.order))
    };
    assert_eq!(order(Light::Single, &cells, 999), Ok(None));
    assert_eq!(order(Light::Auto, &cells, 999), Ok(None));
    assert_eq!(order(Light::Multiplexed(Some(40)), &cells, 999), Ok(Some(40)));
    assert_eq!(order(Light::Multiplexed(None), &cells[..2], 999), Ok(Some(2)));
    assert_eq!(order(Light::Complement(None), &cells[..1], 999), Ok(Some(1)));
    let error = |light, most| order(light, &cells, most).unwrap_err().to_string();
    assert!(error(Light::Multiplexed(Some(41)), 999).contains("found 41"));
    assert!(error(Light::Multiplexed(Some(40)), 7).contains("at most 7 cells"));
    // The same pixel in all: nothing can be lit together.
    let same = vec![cell(7); 40];
    assert!(Light::Multiplexed(None).coding(&same, 999).is_err());
}
