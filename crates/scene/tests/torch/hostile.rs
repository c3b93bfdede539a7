//! Malicious or corrupt files give a value or a typed error, in bounded time and memory.

use crate::support::{
    fixture_bytes, integer, pickle, saved, shared, storage, tensor, text, tuple, without_crcs, zip_of,
};
use atsplat_scene::torch::{self, Chunk, ChunkScene, ChunkWriter, MAX_DEPTH, TorchError};
use atsplat_scene::{SceneError, SharedBytes, Warnings};
use proptest::prelude::*;

/// Reads all scenes, cameras and images.
pub(crate) fn read_all(bytes: SharedBytes) -> Result<usize, SceneError> {
    let chunk = Chunk::from_bytes(bytes, "hostile.torch".as_ref(), &mut Warnings::new())?;
    let mut touched = 0;
    for key in chunk.keys() {
        if let Ok(scene) = chunk.record(key) {
            touched += scene
                .images
                .iter()
                .map(|image| image.iter().map(|&byte| usize::from(byte)).sum::<usize>())
                .sum::<usize>();
        }
        chunk.load(key).ok();
    }
    Ok(touched)
}

pub(crate) fn malformed(result: Result<torch::Value, TorchError>) -> String {
    match result {
        Err(TorchError::Malformed { location, expected, found }) => format!("{location}: {expected}: {found}"),
        other => panic!("expected a malformed file, found {other:?}"),
    }
}

#[test]
fn truncated_files_are_errors() {
    for name in ["zip.torch", "legacy.torch"] {
        let whole = fixture_bytes(name);
        assert!(read_all(shared(whole.clone())).is_ok());
        for len in 0..whole.len() {
            let result = torch::parse(shared(&whole[..len]));
            assert!(result.is_err(), "{name} cut to {len} of {} bytes", whole.len());
        }
    }
}

#[test]
fn flipped_bits_do_not_panic() {
    for name in ["zip.torch", "legacy.torch", "checkpoint_protocol4.pt"] {
        let whole = without_crcs(fixture_bytes(name));
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut flipped = whole.clone();
                flipped[at] ^= 1 << bit;
                read_all(shared(flipped)).ok();
            }
        }
    }
}

/// A chunk with one bit flipped in this entry.
fn damaged(mut file: Vec<u8>, entry: &str) -> Result<Chunk, SceneError> {
    let name = file.windows(entry.len()).position(|window| window == entry.as_bytes()).unwrap();
    let extra = u16::from_le_bytes([file[name - 2], file[name - 1]]);
    file[name + entry.len() + usize::from(extra)] ^= 1;
    Chunk::from_bytes(shared(file), "damaged.torch".as_ref(), &mut Warnings::new())
}

#[test]
fn a_flipped_bit_is_an_error_of_its_entry_alone_when_it_is_read() {
    let whole = fixture_bytes("zip.torch");
    let [first, second] = ["aaaa000000000001", "bbbb000000000002"];

    let error = damaged(whole.clone(), "zip/data.pkl").unwrap_err().to_string();
    assert!(error.contains("zip/data.pkl") && error.contains("CRC-32"), "{error}");

    let of_camera = damaged(whole.clone(), "zip/data/6").unwrap();
    let error = of_camera.load(second).unwrap_err().to_string();
    assert!(error.contains(r#"zip entry "zip/data/6""#) && error.contains("CRC-32"), "{error}");
    assert_eq!(of_camera.load(first).unwrap().frames.len(), 3);

    let of_image = damaged(whole.clone(), "zip/data/3").unwrap();
    let scene = of_image.load(first).unwrap();
    let read = |frame: usize| scene.frames[frame].bytes(first, frame).map(|bytes| bytes.len());
    assert_eq!((read(0).unwrap(), read(2).unwrap()), (663, 667), "other images");
    let error = read(1).unwrap_err().to_string();
    assert!(error.starts_with(r#"frame 1 of scene "aaaa000000000001": zip entry "zip/data/3""#), "{error}");
    assert!(error.ends_with(" (damaged.torch)"), "{error}");
    // Written again, the damage would get a CRC-32 that fits.
    let stored = ChunkScene::from_scene(&scene, &mut Warnings::new());
    assert!(matches!(stored, Err(SceneError::Damaged { frame: 1, .. })), "{stored:?}");
    let folder = tempfile::tempdir().unwrap();
    let mut writer = ChunkWriter::create(folder.path(), ChunkWriter::TARGET_BYTES).unwrap();
    assert!(writer.push(of_image.record(first).unwrap()).is_err());

    for entry in ["zip/data/3", "zip/data/6"] {
        let chunk = damaged(without_crcs(whole.clone()), entry).unwrap();
        let scene = chunk.load(first).unwrap();
        assert!((0..3).all(|frame| scene.frames[frame].bytes(first, frame).is_ok()), "{entry}: written without CRCs");
    }
}

#[test]
fn globals_outside_the_allow_list_are_errors() {
    for (module, name) in [
        ("os", "system"),
        ("posix", "system"),
        ("builtins", "eval"),
        ("torch.storage", "_load_from_bytes"),
        ("torch._utils", "_rebuild_tensor_v3"),
        ("torch", "Tensor"),
        ("collections", "OrderedDict "),
    ] {
        let plain = [format!("c{module}\n{name}\n").as_bytes(), &text("rm -rf /"), b"\x85R"].concat();
        let stacked = [&text(module)[..], &text(name), b"\x93", &text("rm -rf /"), b"\x85R"].concat();
        for body in [plain, stacked] {
            match torch::parse_pickle(&pickle(&body)) {
                Err(TorchError::ForbiddenGlobal { global, .. }) => assert_eq!(global, format!("{module} {name}")),
                other => panic!("{module}.{name}: {other:?}"),
            }
        }
    }
}

#[test]
fn opcodes_outside_the_allow_list_are_errors() {
    // INST, OBJ, PERSID, NEWOBJ, NEWOBJ_EX, EXT1, FLOAT, STRING, GET, PUT, DICT, LIST, FROZENSET, BYTEARRAY8
    for opcode in [b'i', b'o', b'P', 0x81, 0x92, 0x82, b'F', b'S', b'g', b'p', b'd', b'l', 0x91, 0x96] {
        let result = torch::parse_pickle(&pickle(&[opcode]));
        assert!(
            matches!(result, Err(TorchError::ForbiddenOpcode { offset: 2, opcode: found }) if found == opcode),
            "0x{opcode:02x}: {result:?}"
        );
    }
}

#[test]
fn calling_anything_but_a_function_is_an_error() {
    for body in [
        &b"K\x01)R"[..],
        b"])R",
        b"ctorch\nFloatStorage\n)R",
        b"ccollections\nOrderedDict\nR",
        b"ccollections\nOrderedDict\nK\x01R",
    ] {
        malformed(torch::parse_pickle(&pickle(body)));
    }
    malformed(torch::parse_pickle(&pickle(b"ccollections\nOrderedDict\n]K\x01a\x85R")));
    malformed(torch::parse_pickle(&pickle(b"K\x01}b")));
    malformed(torch::parse_pickle(&pickle(b"ctorch._utils\n_rebuild_parameter\nK\x01\x89}\x87R")));
}

#[test]
fn stack_and_memo_misuse_is_an_error() {
    #[rustfmt::skip]
    let bodies = [
        &b""[..], b"0", b"1", b"t", b"\x85", b"K\x01\x86", b"K\x01(\x85", b"a", b"e", b"](", b"]K\x01(a", b"}K\x01s",
        b"}(K\x01u", b"K\x01K\x02a", b"K\x01(K\x02e", b"h\x00", b"j\xff\xff\xff\xff", b"q\x00", b"Q", b"R", b"b",
        b"\x93", b"K\x01K\x02\x93", b"(0",
    ];
    for body in bodies {
        let message = malformed(torch::parse_pickle(&pickle(body)));
        assert!(message.starts_with("pickle byte"), "{body:?}: {message}");
    }
}

#[test]
fn lengths_beyond_the_file_are_errors_before_allocation() {
    #[rustfmt::skip]
    let bodies = [
        &b"X\xff\xff\xff\xffabc"[..], b"\x8d\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x8e\xff\xff\xff\xff\xff\xff\xff\x7f", b"B\xff\xff\xff\x7f", b"\x8a\xff\x01", b"\x8b\xff\xff\xff\x7f",
        b"\x8b\xff\xff\xff\xff", b"\x95\xff\xff\xff\xff\xff\xff\xff\xff", b"ctorch", b"I12",
        b"I99999999999999999999\n",
    ];
    for body in bodies {
        malformed(torch::parse_pickle(&pickle(body)));
    }
}

#[test]
fn deep_nesting_is_an_error_without_recursion() {
    let nested = |depth: usize| pickle(&[vec![b']'; depth], vec![b'a'; depth - 1]].concat());
    assert!(torch::parse_pickle(&nested(MAX_DEPTH + 1)).is_ok());
    assert!(matches!(torch::parse_pickle(&nested(MAX_DEPTH + 2)), Err(TorchError::Unsupported { .. })));
    assert!(matches!(torch::parse_pickle(&nested(1_000_000)), Err(TorchError::Unsupported { .. })));
    let tuples = pickle(&[vec![b')'], vec![0x85; 1_000_000]].concat());
    assert!(matches!(torch::parse_pickle(&tuples), Err(TorchError::Unsupported { .. })));
    malformed(torch::parse_pickle(&vec![b'('; 1_000_000]));
    malformed(torch::parse_pickle(&pickle(&vec![b'('; 1_000_000])));
}

#[test]
fn a_billion_laughs_are_shared_not_copied() {
    let mut body = b"]q\x00".to_vec();
    for level in 0..90u8 {
        body.extend([b']', b'q', level + 1, b'(']);
        body.extend([b'h', level].repeat(100));
        body.push(b'e');
    }
    let value = torch::parse_pickle(&pickle(&body)).unwrap();
    assert_eq!(value.as_sequence().unwrap().len(), 100);
    assert_eq!(format!("{value:?}"), "a list of 100", "printing does not expand 100^90 paths");
}

#[test]
fn cycles_are_errors() {
    for body in [&b"]q\x00h\x00a"[..], b"}q\x00K\x01h\x00s", b"]q\x00h\x00\x85a", b"]q\x00]q\x01h\x00aa"] {
        let result = torch::parse_pickle(&pickle(body));
        assert!(matches!(result, Err(TorchError::Unsupported { .. })), "{result:?}");
    }
}

/// Each call needs 3 bytes and copies the same memoised list, in total 10^5 × 10^5 entries.
#[test]
fn copying_one_list_into_many_dicts_is_an_error() {
    const ENTRIES: usize = 100_000;
    let pairs = b"K\x01K\x02\x86".repeat(ENTRIES);
    let list = [&b"]("[..], &pairs, b"e\x85q\x02ccollections\nOrderedDict\nq\x03"].concat();
    let bomb = pickle(&[&list[..], &b"h\x03h\x02R0".repeat(ENTRIES)].concat());
    let message = malformed(torch::parse_pickle(&bomb));
    assert!(message.contains("copied repeatedly"), "{message}");
}

#[test]
fn memo_slots_are_bounded_by_the_bytes_read() {
    for slot in [&b"r\xff\xff\xff\xff"[..], b"r\xfe\xff\xff\x7f", b"q\xff"] {
        let message = malformed(torch::parse_pickle(&pickle(&[b"K\x01", slot].concat())));
        assert!(message.contains("memo slot"), "{message}");
    }
    assert!(torch::parse_pickle(&pickle(b"K\x01q\x03h\x03\x86")).is_ok(), "Python 2 starts at 1");
}

#[test]
fn dict_keys_must_be_strings_or_integers() {
    for key in [&b"N"[..], b"]", b"}", b")", b"G\x00\x00\x00\x00\x00\x00\x00\x00"] {
        malformed(torch::parse_pickle(&pickle(&[b"}", key, b"Ns"].concat())));
    }
    let repeated = torch::parse_pickle(&pickle(b"}(K\x01K\x02K\x07K\x08K\x01K\x03u")).unwrap();
    let dict = repeated.as_dict().unwrap();
    assert_eq!(dict.len(), 2);
    assert_eq!(
        format!("{dict:?}"),
        "{Int(1): the integer 3, Int(7): the integer 8}",
        "as in Python: first position, last value"
    );
}

#[test]
fn tensors_outside_their_storage_are_errors() {
    let four_floats = [0u8; 16];
    let floats = storage("FloatStorage", 4);
    assert!(torch::parse(saved(&pickle(&tensor(&floats, 1, &[3], &[1])), &four_floats)).is_ok());
    for (offset, shape, strides) in [
        (0, &[5][..], &[1][..]),
        (2, &[3], &[1]),
        (-1, &[1], &[1]),
        (0, &[2], &[-1]),
        (0, &[-1], &[1]),
        (0, &[i64::MAX, i64::MAX], &[1, 1]),
        (0, &[2], &[i64::MAX]),
        (i64::MAX, &[1], &[1]),
        (0, &[2, 2], &[1]),
        (0, &[1; 65], &[1; 65]),
    ] {
        let message = malformed(torch::parse(saved(&pickle(&tensor(&floats, offset, shape, strides)), &four_floats)));
        assert!(message.contains("tensor") || message.contains("pickle byte"), "{message}");
    }
}

#[test]
fn storages_must_have_their_declared_length() {
    for (class, len, bytes) in [
        ("FloatStorage", 4, 15),
        ("FloatStorage", 4, 17),
        ("DoubleStorage", i64::MAX, 16),
        ("ByteStorage", -1, 16),
        ("LongStorage", 4, 16),
    ] {
        malformed(torch::parse(saved(&pickle(&tensor(&storage(class, len), 0, &[0], &[1])), &vec![0; bytes])));
    }
    let absent = pickle(&tensor(&storage("FloatStorage", 4), 0, &[4], &[1]));
    malformed(torch::parse_pickle(&absent));
}

#[test]
fn persistent_ids_must_be_storages() {
    let class = b"ctorch\nFloatStorage\n";
    let (name, key, place, len) = (text("storage"), text("0"), text("cpu"), integer(4));
    let long = text(&"9".repeat(65));
    let wrong: [Vec<u8>; 9] = [
        b"K\x01Q".to_vec(),
        b")Q".to_vec(),
        [b"(", &text("module")[..], class, &key, &place, &len, b"tQ"].concat(),
        [b"(", &name[..], &text("FloatStorage"), &key, &place, &len, b"tQ"].concat(),
        [b"(", &name[..], b"ccollections\nOrderedDict\n", &key, &place, &len, b"tQ"].concat(),
        [b"(", &name[..], class, &integer(0), &place, &len, b"tQ"].concat(),
        [b"(", &name[..], class, &key, &place, &text("4"), b"tQ"].concat(),
        [b"(", &name[..], class, &key, &place, &len, &tuple(&[1, 2, 3]), b"tQ"].concat(),
        [b"(", &name[..], class, &long, &place, &len, b"tQ"].concat(),
    ];
    for body in wrong {
        malformed(torch::parse_pickle(&pickle(&body)));
    }
    malformed(torch::parse(saved(&pickle(&storage("FloatStorage", 4)), &[0; 16])));
    malformed(torch::parse(saved(&pickle(b"ctorch\nFloatStorage\n"), &[])));
}

#[test]
fn inconsistent_zip_directories_are_errors() {
    let good = zip_of(&[("a/data.pkl", b"\x80\x02N."), ("a/version", b"3\n")]);
    assert!(torch::parse(shared(good.clone())).is_ok());
    let directory = good.windows(4).position(|window| window == b"PK\x01\x02").unwrap();
    let end = good.windows(4).position(|window| window == b"PK\x05\x06").unwrap();
    let patched = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        torch::parse(shared(file))
    };
    let saturated = [0xff; 4];
    for (what, at, bytes) in [
        ("one entry fewer", end + 10, &[1, 0][..]),
        ("one entry more", end + 10, &[3, 0]),
        ("directory past the end", end + 16, &[0xfe, 0xff, 0xff, 0x7f]),
        ("directory longer than the file", end + 12, &[0xfe, 0xff, 0xff, 0x7f]),
        ("zip64 without its record", end + 16, &saturated),
        ("a comment that is not there", end + 20, &[1, 0]),
        ("no signature", directory, b"XXXX"),
        ("a name past the directory", directory + 28, &[0xff, 0xff]),
        ("extra fields past the directory", directory + 30, &[0xff, 0xff]),
        ("lengths that differ", directory + 24, &[5, 0, 0, 0]),
        ("a zip64 length without its field", directory + 24, &saturated),
        ("a header past the end", directory + 42, &[0xf0, 0xff, 0xff, 0x7f]),
        ("a name that is not UTF-8", directory + 46, &[0xff]),
    ] {
        let message = malformed(patched(at, bytes));
        assert!(message.contains("zip") || message.contains("byte"), "{what}: {message}");
    }
    for (what, at, bytes) in [("deflate", directory + 10, [8, 0]), ("encryption", directory + 8, [1, 0])] {
        assert!(matches!(patched(at, &bytes), Err(TorchError::Unsupported { .. })), "{what}");
    }
}

#[test]
fn zip64_lengths_of_two_to_the_63_are_errors() {
    let good = zip_of(&[("a/data.pkl", b"\x80\x02N.")]);
    let directory = good.windows(4).position(|window| window == b"PK\x01\x02").unwrap();
    let end = good.windows(4).position(|window| window == b"PK\x05\x06").unwrap();
    // A zip64 extra field with 2^63 for both lengths, after the name.
    let extra = [&[1, 0, 16, 0][..], &(1u64 << 63).to_le_bytes(), &(1u64 << 63).to_le_bytes()].concat();
    let mut header = good[directory..end].to_vec();
    header[20..28].copy_from_slice(&[0xff; 8]);
    header[30..32].copy_from_slice(&u16::try_from(extra.len()).unwrap().to_le_bytes());
    header.splice(56..56, extra);
    let mut tail = good[end..].to_vec();
    tail[12..16].copy_from_slice(&u32::try_from(header.len()).unwrap().to_le_bytes());
    let message = malformed(torch::parse(shared([&good[..directory], &header, &tail].concat())));
    assert!(message.contains("9223372036854775808 bytes"), "{message}");
}

#[test]
fn ambiguous_and_unrelated_archives_are_errors() {
    let pickle = &b"\x80\x02N."[..];
    let twice = zip_of(&[("a/data.pkl", pickle), ("a/data/0", b"x"), ("a/data/1", b"y")]);
    let at = twice.windows(8).rposition(|window| window == b"a/data/1").unwrap();
    let mut renamed = twice;
    renamed[at + 7] = b'0';
    assert!(malformed(torch::parse(shared(renamed))).contains("distinct"));
    malformed(torch::parse(shared(zip_of(&[("a/data.pkl", pickle), ("b/data.pkl", pickle)]))));
    malformed(torch::parse(shared(zip_of(&[("data.pkl", pickle)]))));
    malformed(torch::parse(shared(zip_of(&[("readme.txt", b"hello")]))));
    let big = zip_of(&[("a/data.pkl", pickle), ("a/byteorder", b"big")]);
    assert!(matches!(torch::parse(shared(big)), Err(TorchError::Unsupported { .. })));
    for bytes in [&b""[..], b"P", b"\x89PNG\r\n", b"GIF89a"] {
        malformed(torch::parse(shared(bytes)));
    }
}

#[test]
fn a_chunk_must_be_a_list_of_scenes_with_keys() {
    let load = |body: &[u8]| {
        let mut warnings = Warnings::new();
        let chunk = Chunk::from_bytes(saved(&pickle(body), b""), "x.torch".as_ref(), &mut warnings);
        chunk.map(|chunk| (chunk.keys().to_vec(), warnings.total()))
    };
    assert!(load(b"}").is_err());
    assert!(load(b"N").is_err());
    assert_eq!(load(b"]").unwrap(), (vec![], 0));
    let scene = |key: &[u8]| [b"}", &text("key")[..], key, b"s"].concat();
    let (one, two) = (scene(&text("one")), scene(&text("two")));
    let body = [b"](", &one[..], b"}", &scene(b"K\x01"), &one, b"N", &two, b"e"].concat();
    assert_eq!(
        load(&body).unwrap(),
        (vec!["one".to_owned(), "two".to_owned()], 4),
        "four entries are reported, not dropped"
    );
}

#[test]
fn fields_of_the_wrong_type_or_length_name_the_scene_and_the_field() {
    let longs = tensor(&storage("LongStorage", 4), 0, &[2], &[1]);
    let floats = storage("FloatStorage", 8);
    let bytes = tensor(&storage("ByteStorage", 32), 0, &[3], &[1]);
    let none = tensor(&floats, 0, &[0, 18], &[18, 1]);
    let images = [b"](", &bytes[..], &bytes, b"e"].concat();
    let strided = [b"](", &bytes[..], &tensor(&storage("ByteStorage", 32), 0, &[3], &[2]), b"e"].concat();
    let field = |name: &str, value: &[u8]| [&text(name)[..], value].concat();
    let error_of = |fields: &[Vec<u8>]| {
        let body = [b"]}(", &field("key", &text("k"))[..], &fields.concat(), b"ua"].concat();
        let chunk = Chunk::from_bytes(saved(&pickle(&body), &[0; 32]), "x.torch".as_ref(), &mut Warnings::new());
        // A storage of 32 bytes under one key can have only one type; the other fields fail before.
        match chunk.and_then(|chunk| chunk.load("k")) {
            Err(error) => error.to_string(),
            Ok(scene) => panic!("{scene:?}"),
        }
    };
    let cases = [
        (vec![], "field timestamps"),
        (vec![field("timestamps", &text("soon"))], "field timestamps"),
        (vec![field("timestamps", &none)], "field timestamps"),
        (vec![field("timestamps", &longs)], "field cameras"),
        (vec![field("timestamps", &longs), field("cameras", &longs)], "field cameras"),
        (vec![field("timestamps", &longs), field("cameras", &none)], "field images"),
        (vec![field("timestamps", &longs), field("cameras", &none), field("images", &bytes)], "field images"),
        (vec![field("timestamps", &longs), field("cameras", &none), field("images", b"]K\x01a")], "field images[0]"),
        (
            vec![field("timestamps", &longs), field("cameras", &none), field("images", &strided)],
            "field images[1]: expected a list of contiguous uint8 tensors",
        ),
        (
            vec![field("timestamps", &longs), field("cameras", &none), field("images", &images)],
            "expected 2, as many as timestamps, found 0",
        ),
        (
            vec![
                field("url", b"K\x01"),
                field("timestamps", &longs),
                field("cameras", &none),
                field("images", &images),
            ],
            "field url",
        ),
    ];
    for (fields, expected) in cases {
        let message = error_of(&fields);
        assert!(message.contains(expected) && message.contains("scene \"k\""), "{message} does not contain {expected}");
    }
}

proptest! {
    #[test]
    fn any_bytes_as_a_pickle(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        torch::parse_pickle(&bytes).ok();
    }

    #[test]
    fn any_sequence_of_opcodes(picks in proptest::collection::vec(0..OPCODES.len(), 0..200)) {
        let body: Vec<u8> = picks.into_iter().flat_map(|pick| OPCODES[pick].to_vec()).collect();
        if let Ok(value) = torch::parse_pickle(&pickle(&body)) {
            prop_assert!(value.to_string().len() < 200);
        }
        torch::parse(saved(&pickle(&body), &[0; 8])).ok();
    }

    #[test]
    fn any_splice_of_a_real_file(at in 0..7000usize, len in 0..40usize, with in proptest::collection::vec(any::<u8>(), 0..40)) {
        let mut file = without_crcs(fixture_bytes("zip.torch"));
        let start = at.min(file.len());
        let end = (start + len).min(file.len());
        file.splice(start..end, with);
        read_all(shared(file)).ok();
    }
}

/// Sequences that are valid together often enough to reach deep into the interpreter.
#[rustfmt::skip]
const OPCODES: &[&[u8]] = &[
    b"]", b"}", b")", b"(", b"N", b"\x88", b"K\x01", b"J\xff\xff\xff\xff", b"\x8a\x01\x7f",
    b"G\x3f\xf0\x00\x00\x00\x00\x00\x00", b"a", b"e", b"s", b"u", b"t", b"\x85", b"\x86", b"\x87", b"q\x00",
    b"q\x01", b"h\x00", b"h\x01", b"\x94", b"0", b"1", b"R", b"b", b"Q", b"X\x07\x00\x00\x00storage",
    b"X\x01\x00\x00\x000", b"X\x03\x00\x00\x00key", b"C\x01a", b"ctorch\nByteStorage\n",
    b"ctorch._utils\n_rebuild_tensor_v2\n", b"ctorch._utils\n_rebuild_parameter\n", b"ccollections\nOrderedDict\n",
    b"\x93", b"(X\x07\x00\x00\x00storagectorch\nByteStorage\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x08tQ",
    b"(K\x00K\x02\x85K\x01\x85\x89}",
];
