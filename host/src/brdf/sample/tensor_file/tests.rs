//! The container survives anything, and says what is wrong with it.

use std::io::Cursor;

use proptest::prelude::*;

use super::*;
use crate::brdf::sample::tensor_writer::{Data, write};

fn open(bytes: &[u8]) -> Result<TensorFile<Cursor<&[u8]>>, SampleError> {
    TensorFile::new(Cursor::new(bytes), Path::new("x.bsdf"))
}

fn message(bytes: &[u8]) -> String {
    open(bytes).expect_err("must be refused").to_string()
}

fn example() -> Vec<u8> {
    write(&[
        ("grid", &[2, 3], Data::F32(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0])),
        ("small", &[2], Data::F16(&[0.5, -2.0])),
        ("large", &[2], Data::F64(&[0.25, 1e300])),
        ("flag", &[1], Data::U8(&[1])),
    ])
}

#[test]
fn reads_every_float_type() {
    let bytes = example();
    let mut file = open(&bytes).expect("valid");
    let grid = file
        .read_f32("grid", &[Extent::Exactly(2), Extent::AtLeast(2)], 0.0)
        .expect("valid");
    assert_eq!(
        (grid.shape, grid.values),
        (vec![2, 3], vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    );
    let small = file
        .read_f32("small", &[Extent::Exactly(2)], f32::MIN)
        .expect("valid");
    assert_eq!(small.values, [0.5, -2.0]);
    assert_eq!(file.read_u8("flag", &[Extent::Exactly(1)]).expect("valid"), [1]);
    assert!(file.has("flag") && !file.has("flags"));
}

#[test]
fn reads_fields_longer_than_a_chunk() {
    let values: Vec<f32> = (0..50_000).map(|i| i as f32).collect();
    let bytes = write(&[("long", &[50_000], Data::F32(&values))]);
    let long = open(&bytes)
        .expect("valid")
        .read_f32("long", &[Extent::AtLeast(1)], 0.0)
        .expect("valid");
    assert_eq!(long.values, values);
}

#[test]
fn says_what_is_wrong_with_a_field() {
    let bytes = example();
    let mut file = open(&bytes).expect("valid");
    let mut read = |name: &str, extents: &[Extent], lowest: f32| {
        file.read_f32(name, extents, lowest)
            .expect_err("must be refused")
            .to_string()
    };
    let two = [Extent::Exactly(2)];
    assert_eq!(
        read("grid", &two, 0.0),
        "x.bsdf, grid: expected f32 or f16 or f64 [2], found f32 [2, 3]"
    );
    assert_eq!(
        read("ndf", &two, 0.0),
        "x.bsdf, ndf: expected f32 or f16 or f64 [2], found only the fields flag, grid, large, small"
    );
    assert_eq!(
        read("small", &two, 0.0),
        "x.bsdf, small, entry 1: expected a finite value of at least 0, found -2"
    );
    assert_eq!(
        read("large", &two, f32::MIN),
        "x.bsdf, large, entry 1: expected a finite value, found inf"
    );
    assert_eq!(
        read("flag", &[Extent::AtLeast(1)], 0.0),
        "x.bsdf, flag: expected f32 or f16 or f64 [≥1], found u8 [1]"
    );
}

#[test]
fn says_what_the_file_is_instead() {
    let found = |bytes: &[u8], expected: &str| {
        assert_eq!(
            message(bytes),
            format!("x.bsdf, start of file: expected an RGL tensor file, found {expected}")
        );
    };
    found(b"", "an empty file");
    found(b"tensor", "the end of the file after 6 bytes");
    found(b"# a comment\nSource\tMeasured\nScatterType\tBRDF\n", ZEMAX);
    found(b"<?xml version=\"1.0\"?>", "an XML file");
    found(b"\x89PNG\r\n", "a file that begins with '\\x89PNG\\r\\n'");
}
const ZEMAX: &str = "a Zemax text file, another format with the same extension";

#[test]
fn refuses_claims_that_the_file_cannot_hold() {
    let huge = [1_000_000, 1_000_000];
    let outside = write(&[("vndf", &huge, Data::F32(&[1.0]))]);
    assert!(
        message(&outside).contains("vndf: expected data inside the file of "),
        "{}",
        message(&outside)
    );
    let overflow = write(&[("vndf", &[u64::MAX, u64::MAX], Data::F32(&[1.0]))]);
    assert!(message(&overflow).contains("vndf: expected data inside the file"));
    let twice = write(&[("a", &[1], Data::F32(&[1.0])), ("a", &[1], Data::F32(&[2.0]))]);
    assert_eq!(
        message(&twice),
        "x.bsdf, a: expected a field once, found a second one of this name"
    );
    // Byte positions in the header of a single field named "a": 18 name length, 20 name, 23 type, 24 offset.
    let single = write(&[("a", &[1], Data::F32(&[1.0]))]);
    let patched = |at: usize, byte: u8| {
        let mut bytes = single.clone();
        bytes[at] = byte;
        message(&bytes)
    };
    assert_eq!(patched(12, 2), "x.bsdf, version: expected 1.0, found 2.0");
    assert_eq!(
        patched(20, 0xff),
        "x.bsdf, field number 0: expected a name in UTF-8, found bytes ff"
    );
    assert_eq!(
        patched(23, 12),
        "x.bsdf, a: expected a type from 1 to 11, found type 12"
    );
    assert_eq!(
        patched(23, 0),
        "x.bsdf, a: expected a type from 1 to 11, found type 0"
    );
    assert!(patched(31, 0xff).contains("a: expected data inside the file"));
    assert!(patched(17, 0xff).contains("expected more of the header"));
}

#[test]
fn refuses_the_file_cut_at_any_byte() {
    let bytes = example();
    for length in 0..bytes.len() {
        assert!(
            open(&bytes[..length]).is_err(),
            "cut at {length} of {}",
            bytes.len()
        );
    }
    open(&bytes).expect("whole");
}

proptest! {
    #[test]
    fn never_panics_on_a_damaged_file(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = example();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(mut file) = open(&bytes) {
            for name in ["grid", "small", "large", "flag"] {
                let _ = file.read_f32(name, &[Extent::AtLeast(0), Extent::AtLeast(0)], 0.0);
                let _ = file.read_u8(name, &[Extent::AtLeast(0)]);
            }
        }
    }
}
