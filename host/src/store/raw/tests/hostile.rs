//! What is no file of raw frames, or claims what cannot be, is told with its path and field.

use super::*;

#[test]
fn create_refuses_what_exists_and_layouts_that_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = whole_store(&folder);
    let before = tree(&path);
    assert!(matches!(
        RawStore::create(&path, LAYOUT, Map::new()),
        Err(StoreError::AlreadyExists { .. })
    ));
    assert_eq!(tree(&path), before);

    let path = folder.path().join("other.zarr");
    for layout in [
        RawLayout {
            exposures: 0,
            ..LAYOUT
        },
        RawLayout { segment: 0, ..LAYOUT },
        RawLayout { width: 0, ..LAYOUT },
        RawLayout { bits: 0, ..LAYOUT },
        RawLayout { bits: 17, ..LAYOUT },
        RawLayout {
            height: usize::MAX,
            ..LAYOUT
        },
        RawLayout {
            segment: usize::MAX,
            ..LAYOUT
        },
        RawLayout {
            height: 1 << 20,
            width: 1 << 20,
            ..LAYOUT
        },
    ] {
        let error = RawStore::create(&path, layout, Map::new()).unwrap_err();
        assert!(matches!(error, StoreError::Argument { .. }), "{error}");
        assert!(!path.exists());
    }
    // What a create that was killed has left is no obstacle.
    fs::create_dir_all(folder.path().join("other.zarr.partial/frames")).unwrap();
    RawStore::create(&path, LAYOUT, Map::new()).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    // A trailing slash names the same file.
    let error = RawStore::create(&folder.path().join("other.zarr/"), LAYOUT, Map::new()).unwrap_err();
    assert!(matches!(error, StoreError::AlreadyExists { .. }), "{error}");
    RawStore::create(&folder.path().join("third.zarr/"), LAYOUT, Map::new()).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    assert!(RawStore::create(&folder.path().join(".."), LAYOUT, Map::new()).is_err());
}

#[test]
fn what_is_no_raw_file_is_told_in_one_sentence_with_its_path() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    fs::write(folder.path().join("file"), b"x").unwrap();
    for (name, found) in [
        ("absent", "nothing"),
        ("empty", "without zarr.json"),
        ("file", "no folder"),
    ] {
        let error = RawStore::open(&folder.path().join(name)).unwrap_err();
        assert!(matches!(error, StoreError::NotAGroup { .. }));
        let told = error.to_string();
        assert!(
            told.contains(name) && told.contains(found) && !told.contains('\n'),
            "{told}"
        );
    }
}

/// Opens a copy of a whole store of which the JSON value at `pointer` in `file` is replaced.
fn open_with(file: &str, pointer: &str, value: &Value) -> Result<RawStore, StoreError> {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = whole_store(&folder);
    let mut metadata: Value = serde_json::from_slice(&fs::read(path.join(file)).unwrap()).unwrap();
    *metadata.pointer_mut(pointer).unwrap() = value.clone();
    fs::write(path.join(file), metadata.to_string()).unwrap();
    RawStore::open(&path)
}

#[test]
fn hostile_metadata_are_refused_with_the_field() {
    let huge = u64::MAX;
    let cases = [
        ("zarr.json", "/zarr_format", json!(2)),
        ("zarr.json", "/node_type", json!("array")),
        ("zarr.json", "/attributes/rcg_format_version", json!(99)),
        ("frames/zarr.json", "/shape", json!([10, 3, 5])),
        ("frames/zarr.json", "/shape", json!([10, 3, -5, 2])),
        ("frames/zarr.json", "/shape", json!([huge, huge, huge, huge])),
        ("frames/zarr.json", "/shape", json!([0, 3, 5, 2])),
        ("frames/zarr.json", "/shape", json!("all")),
        ("frames/zarr.json", "/shape", json!([])),
        (
            "frames/zarr.json",
            "/chunk_grid/configuration/chunk_shape",
            json!([0, 3, 5, 2]),
        ),
        (
            "frames/zarr.json",
            "/chunk_grid/configuration/chunk_shape",
            json!([4, 3, 5, 1]),
        ),
        (
            "frames/zarr.json",
            "/chunk_grid/configuration/chunk_shape",
            json!([huge, 3, 5, 2]),
        ),
        (
            "frames/zarr.json",
            "/chunk_grid/configuration/chunk_shape",
            json!([1u64 << 40, 3, 5, 2]),
        ),
        ("frames/zarr.json", "/chunk_grid/name", json!("rectilinear")),
        ("frames/zarr.json", "/chunk_key_encoding/name", json!("nonsense")),
        ("frames/zarr.json", "/data_type", json!("float64")),
        ("frames/zarr.json", "/data_type", json!({"name": "r16"})),
        ("frames/zarr.json", "/codecs", json!([])),
        ("frames/zarr.json", "/codecs/1/name", json!("zstd")),
        (
            "frames/zarr.json",
            "/codecs/0/configuration",
            json!({"endian": "middle"}),
        ),
        ("frames/zarr.json", "/fill_value", json!("NaN")),
        (
            "frames/zarr.json",
            "/dimension_names",
            json!(["exposure", "x", "y", "channel"]),
        ),
        ("frames/zarr.json", "/dimension_names", Value::Null),
        ("frames/zarr.json", "/attributes/significant_bits", json!(0)),
        (
            "frames/zarr.json",
            "/attributes/significant_bits",
            json!("twelve"),
        ),
        ("frames/zarr.json", "/attributes/significant_bits", json!(8)),
        ("kind/zarr.json", "/shape", json!([11])),
        (
            "kind/zarr.json",
            "/chunk_grid/configuration/chunk_shape",
            json!([5]),
        ),
        ("kind/zarr.json", "/data_type", json!("uint16")),
    ];
    for (file, pointer, value) in cases {
        let error = open_with(file, pointer, &value).map(|_| ()).unwrap_err();
        let told = error.to_string();
        assert!(
            matches!(error, StoreError::Metadata { .. }),
            "{pointer} = {value}: {told}"
        );
        assert!(told.contains(file) && !told.contains('\n'), "{told}");
    }
    // The law needs its converse: what is untouched opens.
    open_with("frames/zarr.json", "/zarr_format", &json!(3)).unwrap();
}

#[test]
fn metadata_that_are_no_json_or_gone_are_told() {
    for bytes in [&b""[..], b"{", b"[1, 2]", b"\xff\xfe", b"{\"zarr_format\":3}"] {
        for file in ["zarr.json", "frames/zarr.json", "attempts/zarr.json"] {
            let folder = tempfile::tempdir().unwrap();
            let (path, _) = whole_store(&folder);
            fs::write(path.join(file), bytes).unwrap();
            let error = RawStore::open(&path).unwrap_err();
            assert!(matches!(error, StoreError::Metadata { .. }), "{error}");
        }
    }
    for array in ["frames", "strobe_off_tick"] {
        let folder = tempfile::tempdir().unwrap();
        let (path, _) = whole_store(&folder);
        fs::remove_file(path.join(array).join("zarr.json")).unwrap();
        let error = RawStore::open(&path).unwrap_err();
        assert!(
            matches!(&error, StoreError::ArrayMissing { array: a, .. } if a == array),
            "{error}"
        );
    }
}
