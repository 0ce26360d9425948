//! Damaged and hostile files.

use super::*;

#[test]
fn damage_names_the_array_and_the_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = whole_file(&folder);
    for (file, array) in [
        ("f/c.1.0.0.0", F),
        ("sigma/c.1.0.0.0", SIGMA),
        ("provenance/c.1.0.0", PROVENANCE),
    ] {
        let whole = fs::read(path.join(file)).unwrap();
        let reader = BrdfReader::open(&path).unwrap();

        let mut flipped = whole.clone();
        flipped[whole.len() / 3] ^= 1;
        fs::write(path.join(file), flipped).unwrap();
        let error = reader.read_chunk(1).unwrap_err();
        assert!(
            matches!(&error, StoreError::Checksum { array: a, chunk: 1, .. } if a == array),
            "{error}"
        );

        fs::write(path.join(file), &whole[..whole.len() / 2]).unwrap();
        let error = reader.read_chunk(1).unwrap_err();
        assert!(
            matches!(&error, StoreError::Checksum { array: a, chunk: 1, .. } if a == array),
            "{error}"
        );

        // Of a right checksum, but not of a chunk: more than one, less, and what was never compressed.
        let unpacked = zstd::bulk::decompress(&whole[..whole.len() - 4], 1 << 20).unwrap();
        let more = zstd::bulk::compress(&[&unpacked[..], &vec![0; 1 << 20]].concat(), 1).unwrap();
        let less = zstd::bulk::compress(&unpacked[1..], 1).unwrap();
        for bytes in [more, less, unpacked, Vec::new()] {
            let sum = crc32c::crc32c(&bytes).to_le_bytes();
            fs::write(path.join(file), [&bytes[..], &sum].concat()).unwrap();
            let error = reader.read_chunk(1).unwrap_err();
            assert!(
                matches!(&error, StoreError::Chunk { array: a, chunk: 1, .. } if a == array),
                "{error}"
            );
        }
        fs::write(path.join(file), b"abc").unwrap();
        assert!(matches!(reader.read_chunk(1), Err(StoreError::Chunk { .. })));

        fs::remove_file(path.join(file)).unwrap();
        let error = reader.read_chunk(1).unwrap_err();
        assert!(
            matches!(&error, StoreError::Chunk { array: a, chunk: 1, .. } if a == array),
            "{error}"
        );

        fs::write(path.join(file), whole).unwrap();
        assert_eq!(reader.read_chunk(1).unwrap(), rows(1));
    }
}

#[test]
fn hostile_metadata_are_refused_with_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = whole_file(&folder);
    let cases = [
        ("f", "/shape", json!([7, 4, 5, 3])),
        ("f", "/shape", json!([7, u64::MAX, u64::MAX, 3])),
        ("f", "/data_type", json!("float16")),
        ("sigma", "/shape", json!([7, 4, 4, 2])),
        ("sigma", "/data_type", json!("float32")),
        ("provenance", "/shape", json!([7, 4, 4, 3])),
        (
            "provenance",
            "/chunk_grid/configuration/chunk_shape",
            json!([2, 4, 4]),
        ),
        ("provenance", "/codecs", json!([{"name": "bytes"}])),
    ];
    for (array, pointer, value) in cases {
        let file = path.join(array).join("zarr.json");
        let whole = fs::read(&file).unwrap();
        let mut metadata: Value = serde_json::from_slice(&whole).unwrap();
        *metadata.pointer_mut(pointer).unwrap() = value.clone();
        fs::write(&file, metadata.to_string()).unwrap();
        let error = BrdfReader::open(&path).map(|_| ()).unwrap_err();
        assert!(
            matches!(error, StoreError::Metadata { .. }),
            "{pointer} = {value}: {error}"
        );
        fs::write(&file, whole).unwrap();
    }
    fs::remove_file(path.join("sigma/zarr.json")).unwrap();
    assert!(matches!(
        BrdfReader::open(&path),
        Err(StoreError::ArrayMissing { .. })
    ));
}
