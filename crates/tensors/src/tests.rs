//! Damaged and hostile files, and those that are written.

use atsplat_pickle::SharedBytes;
use proptest::prelude::*;

use super::*;

fn shared(bytes: impl Into<Vec<u8>>) -> SharedBytes {
    SharedBytes::new(bytes.into())
}

/// A file with a header and `data` bytes of data.
fn file(header: &str, data: usize) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &vec![0; data]].concat()
}

#[test]
fn rejects_malformed_headers() {
    let entry = |dtype: &str, shape: &str, offsets: &str| {
        format!(r#"{{"a":{{"dtype":"{dtype}","shape":{shape},"data_offsets":{offsets}}}}}"#)
    };
    for (header, data, expected) in [
        (entry("F32", "[2]", "[0,8]"), 8, ""),
        (entry("F32", "[2]", "[0,8]"), 9, "expected 8 bytes of data, found 9"),
        (entry("F32", "[3]", "[0,8]"), 8, "12 bytes of float32"),
        (entry("F64", "[2]", "[0,8]"), 8, "16 bytes of float64"),
        (entry("F32", "[2]", "[0,16]"), 8, "data within 8 bytes"),
        (entry("F32", "[2]", "[4,12]"), 12, "begins at 0"),
        (entry("F32", "[2]", "[8,0]"), 8, "begins at 0"),
        (entry("F32", "[0]", "[0,18446744073709551615]"), 8, "data within 8 bytes"),
        (entry("U8", "[18446744073709551615,2]", "[0,8]"), 8, "a whole tensor"),
        (entry("Q4", "[2]", "[0,8]"), 8, "found Q4"),
        (entry("F32", "[-2]", "[0,8]"), 8, "line 1"),
        (entry("F32", "[2.0]", "[0,8]"), 8, "line 1"),
        (r#"{"a":{"dtype":"F32"}}"#.to_owned(), 0, "missing field `shape`"),
        (r#"{"__metadata__":{"a":1}}"#.to_owned(), 0, "line 1"),
        (r#"{"__metadata__":{},"__metadata__":{}}"#.to_owned(), 0, "duplicate field"),
        (r#"{"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1]},"a":{"dtype":"U8","shape":[1],"data_offsets":[1,2]}}"#.to_owned(), 2, "two tensors"),
        (format!("{}{}", "{\"a\":".repeat(500), "}".repeat(500)), 0, "line 1"),
        ("{".to_owned(), 0, "line 1"),
    ] {
        let outcome = StoredTensors::parse(shared(file(&header, data)));
        match outcome {
            Ok(_) => assert_eq!(expected, "", "{header}"),
            Err(error) => {
                let error = error.to_string();
                assert!(!expected.is_empty() && error.contains(expected), "{error}");
            }
        }
    }
    for length in [u64::MAX, u64::MAX - 7, 1 << 40] {
        let bytes = [&length.to_le_bytes()[..], b"{}"].concat();
        assert!(StoredTensors::parse(shared(bytes)).is_err(), "{length}");
    }
    assert!(StoredTensors::parse(shared(*b"\x02\0\0\0\0\0\0\0{}")).is_ok(), "a file without tensors is valid");
}

proptest! {
    #[test]
    fn any_bytes_are_tensors_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        StoredTensors::parse(shared(bytes.clone())).ok();
        let text = String::from_utf8_lossy(&bytes).into_owned();
        StoredTensors::parse(shared(file(&format!("{{{text}}}"), 3))).ok();
    }

    #[test]
    fn a_damaged_file_is_tensors_or_an_error(at in 0usize..400, byte in any::<u8>(), cut in 0usize..400) {
        let tensors = [("a", vec![2usize, 3]), ("b.c", vec![4])];
        let mut stored = StoredTensors::default();
        for (name, shape) in tensors {
            let values = vec![1.5; shape.iter().product()];
            stored.tensors.insert(name.to_owned(), StoredTensor::from_f32(shape, &values).unwrap());
        }
        stored.metadata.insert("key".to_owned(), "value".to_owned());
        let mut bytes = stored.to_safetensors().unwrap();
        prop_assert_eq!(StoredTensors::parse(shared(bytes.clone())).unwrap().digest(), stored.digest());
        if let Some(slot) = bytes.get_mut(at) {
            *slot = byte;
        }
        StoredTensors::parse(shared(bytes.clone())).ok();
        bytes.truncate(cut);
        StoredTensors::parse(shared(bytes)).ok();
    }
}

/// A square matrix between two lists, so that an order by name, size or type differs from the given one.
#[test]
fn a_file_is_written_from_borrowed_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let view = |dtype, shape: &[usize], bytes| TensorView::new(dtype, shape.to_vec(), bytes);
    assert!(view(DType::F32, &[2], &[0; 7]).is_err(), "seven bytes are not two f32");
    let (b, a, c) = ([1u8; 8], [2u8; 4], [3u8; 2]);
    let mut tensors = [
        ("b", view(DType::F64, &[1], &b).unwrap()),
        ("a", view(DType::U8, &[2, 2], &a).unwrap()),
        ("c", view(DType::F16, &[1], &c).unwrap()),
    ];
    let metadata = std::collections::BTreeMap::from([("key".to_owned(), "value".to_owned())]);
    write_safetensors(&path, &tensors, &metadata).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert!(bytes.ends_with(&[&b[..], &a, &c].concat()), "in the given order");
    let read = StoredTensors::open(&path).unwrap();
    assert_eq!((read.tensors["a"].shape(), read.tensors["c"].bytes()), (&[2, 2][..], &c[..]));
    assert_eq!((&read.metadata, read_metadata(&path).unwrap().as_ref()), (&metadata, Some(&metadata)));
    assert!(read.to_safetensors().unwrap() == bytes, "the same file");
    drop(read);
    // Without its data, and damaged.
    std::fs::write(&path, &bytes[..bytes.len() - 14]).unwrap();
    assert_eq!(read_metadata(&path).unwrap(), Some(metadata.clone()));
    let error = StoredTensors::open(&path).unwrap_err().to_string();
    assert!(error.contains(r#"tensor "b": expected data within 0 bytes, found 0 to 8"#), "{error}");
    assert!(error.ends_with(&format!("({})", path.display())), "{error}");
    for other in [&bytes[..7], &bytes[..20], &b"\x01\0\0\0\0\0\0\0{}"[..], &[255; 9]] {
        std::fs::write(&path, other).unwrap();
        assert_eq!(read_metadata(&path).unwrap(), None, "{other:?}");
    }
    tensors[2].0 = "a";
    let error = write_safetensors(&path, &tensors, &metadata).unwrap_err().to_string();
    assert!(error.contains(r#"tensor "a": expected a unique name, found two tensors"#), "{error}");
}

/// A checkpoint in the legacy format: a dict whose only value is a list of `count` references to one item.
fn checkpoint(key: &str, item: &[u8], count: usize) -> Vec<u8> {
    let text = |value: &str| [b"X", &u32::try_from(value.len()).unwrap().to_le_bytes()[..], value.as_bytes()].concat();
    let object = [b"}", &text(key)[..], b"](", item, b"q\x00", &b"h\x00".repeat(count - 1), b"es"].concat();
    let storages = [b"]", &text("0")[..], b"a"].concat();
    // The number of the protocol, what the writer's system was, the object, keys of storages.
    let pickles = [&b"M\xe9\x03"[..], b"}", &object, &storages].map(|body| [b"\x80\x02", body, b"."].concat());
    let magic = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
    [&magic[..], &pickles.concat(), &1i64.to_le_bytes(), b"\x07"].concat()
}

/// A uint8 tensor of shape `[1]`.
const TENSOR: &[u8] = b"ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nByteStorage\nX\x01\0\0\x000\
    X\x03\0\0\0cpuK\x01tQK\x00K\x01\x85K\x01\x85\x89ccollections\nOrderedDict\n)RtR";

/// Each reference of two bytes would give a name of 4 KiB.
#[test]
fn names_of_repeated_references_are_bounded_by_the_file() {
    let key = "k".repeat(4096);
    let read = |bytes: Vec<u8>| StoredTensors::parse(shared(bytes));
    let few = read(checkpoint(&key, TENSOR, 2)).unwrap();
    let names = few.tensors.keys().collect::<Vec<_>>();
    assert_eq!(names, [&format!("{key}.0"), &format!("{key}.1")]);
    assert!(few.tensors.values().all(|tensor| tensor.bytes() == [7]), "{few:?}");
    // `0` discards the tensor, which the file's storage needs.
    let (empty, nested) = ([TENSOR, b"0]"].concat(), [b"](", TENSOR, b"e"].concat());
    for item in [TENSOR, &empty, &nested] {
        let error = read(checkpoint(&key, item, 4096)).unwrap_err();
        assert!(matches!(error, TensorError::Malformed(_)), "{error}");
        let error = error.to_string();
        assert!(error.contains("names and shapes of at most four times the file's size"), "{error}");
    }
    // Numbers get no names.
    let with_a_number = [TENSOR, b"0K\x05"].concat();
    assert!(read(checkpoint(&key, &with_a_number, 4096)).unwrap().tensors.is_empty());
}

/// Lists of lists, with a tensor in the innermost.
#[test]
fn tensors_are_found_at_any_depth() {
    let nested = [&b"](".repeat(20)[..], TENSOR, &b"e".repeat(20)].concat();
    let read = StoredTensors::parse(shared(checkpoint("k", &nested, 1))).unwrap();
    assert_eq!(read.tensors.keys().collect::<Vec<_>>(), [&format!("k{}", ".0".repeat(21))]);
}

/// A list of numbers beside a tensor, which may be long, but not shared by many references.
#[test]
fn visited_objects_are_bounded_by_the_file() {
    let read = |item: &[u8], count| StoredTensors::parse(shared(checkpoint("k", item, count)));
    let numbers = |count| b"K\x05".repeat(count);
    let long = read(&[b"](", TENSOR, &numbers(1 << 20), b"e"].concat(), 1).unwrap();
    assert_eq!(long.tensors.keys().collect::<Vec<_>>(), ["k.0.0"]);
    // `0` discards the tensor, so that only the numbers are shared.
    let error = read(&[TENSOR, b"0](", &numbers(4096), b"e"].concat(), 512).unwrap_err().to_string();
    assert!(error.contains("at most four objects for each byte of the file"), "{error}");
}

/// The folder of a training run is given in place of the weights in it.
#[test]
fn a_folder_is_no_weights_file() {
    let folder = tempfile::tempdir().unwrap();
    let error = || TensorFile::open(folder.path()).unwrap_err().to_string();
    assert_eq!(error(), format!("weights: expected a file, found a folder ({})", folder.path().display()));
    let inside = folder.path().join("weights.safetensors");
    std::fs::write(&inside, b"").unwrap();
    assert!(error().contains(&format!("a file, such as {}, found a folder", inside.display())), "{}", error());
}
