//! Files written by PyTorch are read as PyTorch reads them: every value of `golden.json`, in both containers.

use crate::support::{fixture, fixture_bytes};
use atsplat_files::Sha256Digest;
use atsplat_scene::torch::{self, Chunk, DType, Key, Tensor, Value};
use atsplat_scene::{FrameImage, SceneError, Warnings};
use serde_json::Value as Json;

fn golden(file: &str) -> Json {
    let golden: Json = serde_json::from_slice(&fixture_bytes("golden.json")).unwrap();
    golden[file].clone()
}

/// A value in the notation of `make_fixtures.py`.
fn plain(value: &Value) -> Json {
    match value {
        Value::None => Json::Null,
        Value::Bool(value) => (*value).into(),
        Value::Int(value) => (*value).into(),
        Value::Float(value) => serde_json::json!({ "float": hexadecimal(*value) }),
        Value::Str(text) => (**text).into(),
        Value::Bytes(bytes) => panic!("no fixture contains bytes: {bytes:?}"),
        Value::List(items) => serde_json::json!({ "list": items.iter().map(plain).collect::<Vec<_>>() }),
        Value::Tuple(items) => serde_json::json!({ "tuple": items.iter().map(plain).collect::<Vec<_>>() }),
        Value::Dict(dict) => {
            let key = |key: &Key| match key {
                Key::Str(text) => Json::from(&**text),
                Key::Int(number) => Json::from(*number),
            };
            let entries: Vec<Json> = dict.iter().map(|(k, v)| serde_json::json!([key(k), plain(v)])).collect();
            serde_json::json!({ "dict": entries })
        }
        Value::Tensor(tensor) => plain_tensor(tensor),
    }
}

fn plain_tensor(tensor: &Tensor) -> Json {
    let elements: Json = match tensor.dtype() {
        DType::F16 | DType::Bf16 | DType::F32 | DType::F64 => {
            tensor.to_f64().unwrap().into_iter().map(hexadecimal).collect::<Vec<_>>().into()
        }
        DType::U8 if tensor.element_count() > 64 => Sha256Digest::of(&tensor.to_bytes().unwrap()).0.to_vec().into(),
        _ => tensor.to_i64().unwrap().into(),
    };
    serde_json::json!({ "dtype": tensor.dtype().to_string(), "shape": tensor.shape(), "elements": elements })
}

/// Python's `float.hex`.
fn hexadecimal(value: f64) -> String {
    let bits = value.to_bits();
    let sign = if value.is_sign_negative() { "-" } else { "" };
    let (exponent, fraction) = (((bits >> 52) & 0x7ff).cast_signed(), bits & ((1 << 52) - 1));
    match (exponent, fraction) {
        (0, 0) => format!("{sign}0x0.0p+0"),
        (0, _) => format!("{sign}0x0.{fraction:013x}p-1022"),
        (exponent, _) => format!("{sign}0x1.{fraction:013x}p{:+}", exponent - 1023),
    }
}

#[test]
fn all_values_of_the_fixtures_match_pytorch() {
    for file in ["zip.torch", "legacy.torch", "checkpoint.pt", "checkpoint_protocol4.pt", "checkpoint_legacy.pt"] {
        let expected = golden(file);
        assert!(expected.is_object(), "golden.json has {file}");
        assert_eq!(plain(&torch::read(fixture(file)).unwrap()), expected, "{file}");
    }
}

#[test]
fn views_keep_their_strides() {
    let checkpoint = torch::read(fixture("checkpoint.pt")).unwrap();
    let tensor = |name| checkpoint.as_dict().unwrap().get(name).unwrap().as_tensor().unwrap();
    assert_eq!((tensor("transposed").shape(), tensor("transposed").strides()), (&[4, 3][..], &[1, 4][..]));
    assert!(!tensor("transposed").is_contiguous());
    assert!(tensor("row").is_contiguous(), "a row of a matrix needs no copy");
    assert_eq!(tensor("row").to_f64().unwrap().len(), 4);
}

#[test]
fn chunks_hold_posed_scenes() {
    for file in ["zip.torch", "legacy.torch"] {
        let mut warnings = Warnings::new();
        let chunk = Chunk::open(fixture(file), &mut warnings).unwrap();
        assert_eq!(chunk.keys(), ["aaaa000000000001", "bbbb000000000002"]);
        assert_eq!(warnings.total(), 0);
        for (key, start, magic) in
            [("aaaa000000000001", 100, &b"\xff\xd8\xff"[..]), ("bbbb000000000002", 200, b"\x89PNG")]
        {
            let scene = chunk.load(key).unwrap();
            assert_eq!(scene.url.as_deref(), Some(&*format!("https://example.org/watch?v={key}")));
            assert_eq!(scene.frames.len(), 3);
            for (position, frame) in scene.frames.iter().enumerate() {
                let timestamp = start + 33_000 * i64::try_from(position).unwrap();
                assert_eq!((frame.name.as_str(), frame.timestamp_micros), (&*timestamp.to_string(), Some(timestamp)));
                let FrameImage::Encoded(bytes) = &frame.image else { panic!("{:?}", frame.image) };
                assert!(bytes.starts_with(magic), "{file} {key} {position}");
            }
        }
        assert!(matches!(chunk.load("cccc"), Err(SceneError::UnknownScene { .. })));
    }
}

#[test]
fn images_are_slices_of_the_mapped_file() {
    let file = crate::support::shared(fixture_bytes("zip.torch"));
    let inside = file.as_ptr_range();
    let chunk = Chunk::from_bytes(file.clone(), "zip.torch".as_ref(), &mut Warnings::new()).unwrap();
    for key in chunk.keys() {
        for image in chunk.record(key).unwrap().images {
            assert!(inside.contains(&image.as_ptr()), "{key}: the image was copied");
        }
    }
}
