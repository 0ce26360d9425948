use std::fs;

use half::f16;
use serde_json::json;

use super::*;

mod hostile;

const LAYOUT: BrdfLayout = BrdfLayout {
    incident: 7,
    grid: 4,
    channels: 3,
    chunk: 3,
};
const CHUNKS: usize = 3;

/// Rows whose every value differs from its neighbours', without missing ones: those are NaN, which equals nothing.
fn rows(index: usize) -> BrdfRows {
    let directions = (index * 3..(index * 3 + 3).min(7)).len();
    let cells = directions * 4 * 4;
    BrdfRows {
        f: (0..cells * 3)
            .map(|i| (i + 1000 * index) as f32 * 0.125 + 0.1)
            .collect(),
        sigma: (0..cells * 3)
            .map(|i| f16::from_bits((1 + i + 37 * index) as u16))
            .collect(),
        provenance: (0..cells).map(|i| (1 + (i + index) % 5) as u8).collect(),
    }
}

/// [`rows`], every third sample of which is missing.
fn gappy_rows(index: usize) -> BrdfRows {
    let mut rows = rows(index);
    for code in rows.provenance.iter_mut().step_by(3) {
        *code = Provenance::Missing.code();
    }
    rows.seal();
    rows
}

/// The bits of `rows`, by which NaN can be compared.
fn bits(rows: &BrdfRows) -> (Vec<u32>, Vec<u16>, &[u8]) {
    let f = rows.f.iter().map(|f| f.to_bits()).collect();
    let sigma = rows.sigma.iter().map(|sigma| sigma.to_bits()).collect();
    (f, sigma, &rows.provenance)
}

fn create(path: &Path, overwrite: bool) -> Result<BrdfWriter, StoreError> {
    BrdfWriter::create(path, LAYOUT, &[], Map::new(), overwrite)
}

fn whole_file(folder: &tempfile::TempDir) -> PathBuf {
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    (0..CHUNKS).for_each(|index| writer.write_chunk(index, &rows(index)).unwrap());
    writer.finish().unwrap();
    path
}

fn theta<'a>(values: Vec<f64>) -> SmallArray<'a> {
    SmallArray {
        name: "incident_theta",
        dims: &["incident"],
        shape: vec![values.len()],
        data: SmallData::F64(values),
        units: "degree",
        long_name: "polar angle of the incident direction",
        codes: &[],
    }
}

fn reasons<'a>(values: Vec<u8>, shape: Vec<usize>) -> SmallArray<'a> {
    SmallArray {
        name: "outgoing_reason",
        dims: &["y", "x"],
        shape,
        data: SmallData::U8(values),
        units: "1",
        long_name: "why an outgoing direction is not measurable",
        codes: &[(0, "measurable"), (1, "hole"), (2, "beyond rim")],
    }
}

#[test]
fn what_is_written_from_several_threads_is_read_and_an_absent_chunk_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let mut attributes = Map::new();
    attributes.insert("cosine".into(), json!("none"));
    let writer = BrdfWriter::create(&path, LAYOUT, &[], attributes, false).unwrap();
    std::thread::scope(|scope| {
        for index in [2, 0] {
            let writer = &writer;
            scope.spawn(move || writer.write_chunk(index, &rows(index)).unwrap());
        }
    });
    writer.finish().unwrap();

    let reader = BrdfReader::open(&path).unwrap();
    assert_eq!(reader.layout(), &LAYOUT);
    assert_eq!(reader.attributes()["cosine"], "none");
    assert_eq!(reader.chunks(), CHUNKS);
    assert_eq!(reader.chunk_range(2), 6..7);
    for index in [0, 2] {
        assert!(reader.chunk_is_present(index));
        assert_eq!(reader.read_chunk(index).unwrap(), rows(index));
    }
    assert!(!reader.chunk_is_present(1));
    let absent = reader.read_chunk(1).unwrap();
    assert_eq!(bits(&absent), bits(&BrdfRows::missing(3 * 16, 3)));
    assert!(absent.f.iter().all(|f| f.is_nan()) && absent.sigma.iter().all(|sigma| sigma.is_nan()));

    assert!(!reader.chunk_is_present(CHUNKS) && !reader.chunk_is_present(usize::MAX));
    assert!(matches!(
        reader.read_chunk(CHUNKS),
        Err(StoreError::Argument { .. })
    ));
}

#[test]
fn what_is_missing_is_nan_and_the_rest_is_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    (0..CHUNKS).for_each(|index| writer.write_chunk(index, &gappy_rows(index)).unwrap());
    writer.finish().unwrap();
    let reader = BrdfReader::open(&path).unwrap();
    for index in 0..CHUNKS {
        assert_eq!(bits(&reader.read_chunk(index).unwrap()), bits(&gappy_rows(index)));
    }
    // What pads the last chunk is no value either: f has one of three incident directions there.
    let last = fs::read(path.join("f/c.2.0.0.0")).unwrap();
    let last = zstd::bulk::decompress(&last[..last.len() - 4], 3 * 16 * 3 * 4).unwrap();
    let padding = &last[16 * 3 * 4..];
    assert!(
        padding
            .chunks_exact(4)
            .all(|f| f32::from_le_bytes(f.try_into().unwrap()).is_nan())
    );
}

#[test]
fn a_file_that_says_so_has_rounded_values_and_every_other_all_bits() {
    let folder = tempfile::tempdir().unwrap();
    let mut rows = gappy_rows(0);
    for sigma in rows.sigma.iter_mut().filter(|sigma| !sigma.is_nan()) {
        *sigma = f16::from_f32(0.03);
    }
    for is_rounded in [false, true] {
        let path = folder.path().join(format!("{is_rounded}.zarr"));
        let mut attributes = Map::new();
        if is_rounded {
            attributes.insert(ROUNDED.into(), json!(crate::store::ROUNDING));
        }
        let writer = BrdfWriter::create(&path, LAYOUT, &[], attributes, false).unwrap();
        writer.write_chunk(0, &rows).unwrap();
        writer.finish().unwrap();
        let mut expected = rows.clone();
        if is_rounded {
            expected.round();
            assert_ne!(bits(&expected), bits(&rows));
        }
        let found = BrdfReader::open(&path).unwrap().read_chunk(0).unwrap();
        assert_eq!(bits(&found), bits(&expected));
    }
}

#[test]
fn every_array_declares_what_stands_for_no_data() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let extra = [theta(vec![0.0; 7]), reasons(vec![0; 16], vec![4, 4])];
    let writer = BrdfWriter::create(&path, LAYOUT, &extra, Map::new(), false).unwrap();
    writer.finish().unwrap();
    for (array, expected) in [
        (F, json!("NaN")),
        (SIGMA, json!("NaN")),
        (PROVENANCE, json!(Provenance::Missing.code())),
        ("incident_theta", json!("NaN")),
        ("outgoing_reason", json!(255)),
    ] {
        let metadata: Value =
            serde_json::from_slice(&fs::read(path.join(array).join("zarr.json")).unwrap()).unwrap();
        assert_eq!(metadata["fill_value"], expected, "{array}");
    }
}

#[test]
fn rows_that_contradict_themselves_are_neither_written_nor_read() {
    type Edit = fn(&mut BrdfRows);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let edits: [(&str, Edit); 5] = [
        (F, |rows| rows.f[0] = 0.0),
        (F, |rows| rows.f[4] = f32::NAN),
        (SIGMA, |rows| rows.sigma[1] = f16::ZERO),
        (SIGMA, |rows| rows.sigma[5] = f16::ZERO),
        (F, |rows| rows.provenance[1] = Provenance::Missing.code()),
    ];
    for (array, edit) in edits {
        let mut bad = gappy_rows(0);
        edit(&mut bad);
        let writer = create(&path, true).unwrap();
        let error = writer.write_chunk(0, &bad).unwrap_err();
        assert!(matches!(error, StoreError::Argument { .. }), "{error}");
        // Written by somebody else.
        writer.f.write(0, &bad.f).unwrap();
        writer.sigma.write(0, &bad.sigma).unwrap();
        writer.provenance.write(0, &bad.provenance).unwrap();
        writer.finish().unwrap();
        let error = BrdfReader::open(&path).unwrap().read_chunk(0).unwrap_err();
        assert!(
            matches!(&error, StoreError::Chunk { array: a, chunk: 0, .. } if a == array),
            "{error}"
        );
    }
}

#[test]
fn files_of_version_1_have_nan_where_their_provenance_says_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    for index in [0, 2] {
        let mut old = gappy_rows(index);
        old.f.iter_mut().filter(|f| f.is_nan()).for_each(|f| *f = 0.0);
        old.sigma
            .iter_mut()
            .filter(|sigma| sigma.is_nan())
            .for_each(|sigma| *sigma = f16::ZERO);
        writer.f.write(index, &old.f).unwrap();
        writer.sigma.write(index, &old.sigma).unwrap();
        writer.provenance.write(index, &old.provenance).unwrap();
    }
    writer.finish().unwrap();
    let file = path.join("zarr.json");
    let mut group: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
    assert_eq!(group["attributes"]["rcg_format_version"], 3);
    for (version, is_read) in [
        (json!(1), true),
        (json!(0), false),
        (json!(4), false),
        (json!("3"), false),
    ] {
        group["attributes"]["rcg_format_version"] = version.clone();
        fs::write(&file, group.to_string()).unwrap();
        match BrdfReader::open(&path) {
            Ok(reader) if is_read => {
                for index in [0, 2] {
                    assert_eq!(bits(&reader.read_chunk(index).unwrap()), bits(&gappy_rows(index)));
                }
                assert_eq!(
                    bits(&reader.read_chunk(1).unwrap()),
                    bits(&BrdfRows::missing(48, 3))
                );
            }
            Err(StoreError::Metadata { .. }) if !is_read => {}
            other => panic!("version {version}: {other:?}"),
        }
    }
}

#[test]
fn a_chunk_without_any_value_is_present_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    writer.write_chunk(0, &BrdfRows::missing(3 * 16, 3)).unwrap();
    writer.finish().unwrap();
    assert!(BrdfReader::open(&path).unwrap().chunk_is_present(0));
}

#[test]
fn an_unfinished_result_is_not_visible_and_no_obstacle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    writer.write_chunk(0, &rows(0)).unwrap();
    assert!(!path.exists());
    assert!(matches!(
        BrdfReader::open(&path),
        Err(StoreError::NotAGroup { .. })
    ));
    drop(writer);
    assert!(!path.exists());

    // The next writer starts from nothing, not from the leftovers.
    create(&path, false).unwrap().finish().unwrap();
    let reader = BrdfReader::open(&path).unwrap();
    assert!(!reader.chunk_is_present(0));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_result_is_replaced_only_on_demand_and_only_when_the_new_one_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = whole_file(&folder);
    assert!(matches!(
        create(&path, false),
        Err(StoreError::AlreadyExists { .. })
    ));

    let writer = create(&path, true).unwrap();
    assert_eq!(BrdfReader::open(&path).unwrap().read_chunk(0).unwrap(), rows(0));
    writer
        .write_chunk(
            0,
            &BrdfRows {
                f: rows(1).f,
                ..rows(0)
            },
        )
        .unwrap();
    writer.finish().unwrap();
    let reader = BrdfReader::open(&path).unwrap();
    assert_eq!(reader.read_chunk(0).unwrap().f, rows(1).f);
    assert!(!reader.chunk_is_present(1));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);

    // Two at a time: the one that did not ask to overwrite fails at the end.
    let other = folder.path().join("other.zarr");
    let late = create(&other, false).unwrap();
    fs::rename(&path, &other).unwrap();
    assert!(matches!(late.finish(), Err(StoreError::AlreadyExists { .. })));
    assert!(BrdfReader::open(&other).is_ok());
}

#[test]
fn a_folder_of_another_kind_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let thesis = folder.path().join("thesis");
    fs::create_dir(&thesis).unwrap();
    fs::write(thesis.join("chapter-1"), b"years of work").unwrap();
    assert!(matches!(create(&thesis, true), Err(StoreError::NotAGroup { .. })));
    assert!(thesis.join("chapter-1").exists());
}

#[test]
fn small_arrays_are_read_as_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let angles: Vec<f64> = (0..7).map(|i| f64::from(i) * 12.3).collect();
    let codes: Vec<u8> = (0..16).map(|i| i % 3).collect();
    let extra = [theta(angles.clone()), reasons(codes.clone(), vec![4, 4])];
    BrdfWriter::create(&path, LAYOUT, &extra, Map::new(), false)
        .unwrap()
        .finish()
        .unwrap();

    let reader = BrdfReader::open(&path).unwrap();
    assert_eq!(reader.small("incident_theta").unwrap(), SmallData::F64(angles));
    assert_eq!(reader.small("outgoing_reason").unwrap().as_u8(), Some(&codes[..]));
    for name in ["incident_phi", "", "../brdf.zarr/incident_theta", "c/0"] {
        assert!(
            matches!(reader.small(name), Err(StoreError::ArrayMissing { .. })),
            "{name}"
        );
    }
    assert!(matches!(reader.small(F), Err(StoreError::Metadata { .. })));
}

#[test]
fn small_arrays_that_do_not_fit_are_refused_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let good = || theta(vec![0.0; 7]);
    let bad: [Vec<SmallArray<'_>>; 9] = [
        vec![SmallArray { name: "f", ..good() }],
        vec![SmallArray {
            name: "../f",
            ..good()
        }],
        vec![SmallArray { name: "", ..good() }],
        vec![good(), good()],
        vec![theta(vec![0.0; 6])],
        vec![SmallArray {
            data: SmallData::F64(vec![0.0; 3]),
            ..good()
        }],
        vec![SmallArray {
            dims: &["incident", "y"],
            ..good()
        }],
        vec![SmallArray {
            codes: &[(0, "none")],
            ..good()
        }],
        vec![reasons(vec![], vec![usize::MAX, usize::MAX])],
    ];
    for extra in bad {
        let error = BrdfWriter::create(&path, LAYOUT, &extra, Map::new(), false)
            .map(|_| ())
            .unwrap_err();
        assert!(matches!(error, StoreError::Argument { .. }), "{error}");
    }
    for layout in [
        BrdfLayout { grid: 0, ..LAYOUT },
        BrdfLayout {
            chunk: usize::MAX,
            ..LAYOUT
        },
    ] {
        let error = BrdfWriter::create(&path, layout, &[], Map::new(), false)
            .map(|_| ())
            .unwrap_err();
        assert!(matches!(error, StoreError::Argument { .. }), "{error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn rows_of_the_wrong_length_are_refused_and_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    let mut bad = [rows(0), rows(0), rows(0)];
    bad[0].f.pop();
    bad[1].sigma.push(f16::ONE);
    bad[2].provenance.pop();
    for rows in &bad {
        assert!(matches!(
            writer.write_chunk(0, rows),
            Err(StoreError::Argument { .. })
        ));
    }
    assert!(matches!(
        writer.write_chunk(2, &rows(0)),
        Err(StoreError::Argument { .. })
    ));
    assert!(matches!(
        writer.write_chunk(3, &rows(0)),
        Err(StoreError::Argument { .. })
    ));
    writer.finish().unwrap();
    assert!((0..CHUNKS).all(|index| !BrdfReader::open(&path).unwrap().chunk_is_present(index)));
}

#[test]
fn other_programs_find_names_units_and_codes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let extra = [theta(vec![0.0; 7]), reasons(vec![0; 16], vec![4, 4])];
    BrdfWriter::create(&path, LAYOUT, &extra, Map::new(), false)
        .unwrap()
        .finish()
        .unwrap();
    let read = |file: &str| -> Value { serde_json::from_slice(&fs::read(path.join(file)).unwrap()).unwrap() };
    let group = read("zarr.json");
    for (array, units) in [
        ("f", "sr-1"),
        ("sigma", "sr-1"),
        ("provenance", "1"),
        ("incident_theta", "degree"),
    ] {
        let metadata = read(&format!("{array}/zarr.json"));
        assert_eq!(metadata["attributes"]["units"], units);
        assert!(metadata["attributes"]["long_name"].is_string());
        let names = metadata["dimension_names"].as_array().unwrap();
        assert_eq!(names.len(), metadata["shape"].as_array().unwrap().len());
        // The group's copy and the array's own metadata say the same.
        assert_eq!(group["consolidated_metadata"]["metadata"][array], metadata);
    }
    let provenance = &read("provenance/zarr.json")["attributes"];
    assert_eq!(provenance["flag_values"], json!([0, 1, 2, 3, 4, 5]));
    assert_eq!(
        provenance["flag_meanings"],
        "missing measured merged reciprocal interpolated modelled"
    );
    let reason = &read("outgoing_reason/zarr.json")["attributes"];
    assert_eq!(reason["flag_meanings"], "measurable hole beyond_rim");
    assert_eq!(
        read("f/zarr.json")["attributes"]["coordinates"],
        "incident_theta outgoing_reason"
    );
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("brdf.zarr");
    let writer = create(&path, false).unwrap();
    for n in 0..100 {
        let link = format!("brdf.zarr.partial/f/c.0.0.0.0.tmp-{}-{n}", std::process::id());
        std::os::unix::fs::symlink("/dev/full", folder.path().join(link)).unwrap();
    }
    let error = writer.write_chunk(0, &rows(0)).unwrap_err();
    assert!(matches!(error, StoreError::DiskFull { .. }), "{error}");
    assert!(!writer.f.is_present(0));
}
