//! Files of checkpoints: those of earlier versions, and damaged ones.

use std::collections::HashMap;
use std::path::Path;

use atsplat_files::Sha256Digest;
use atsplat_fit::{Fit, FitConfig, FitDevice, FitError, Strategy};
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;
use serde_json::{Value, json};

use crate::common::{config, run, start, views};

/// All tensors of a checkpoint of Mip-Splatting, in the order of their hash.
const TENSORS: [&str; 24] = [
    "value/means",
    "value/quaternions",
    "value/log-scales",
    "value/opacity-logits",
    "value/sh",
    "first-moment/means",
    "first-moment/quaternions",
    "first-moment/log-scales",
    "first-moment/opacity-logits",
    "first-moment/sh",
    "second-moment/means",
    "second-moment/quaternions",
    "second-moment/log-scales",
    "second-moment/opacity-logits",
    "second-moment/sh",
    "filter-3d",
    "views/value",
    "views/first-moment",
    "views/second-moment",
    "memory/gradient-sums",
    "memory/gradient-counts",
    "history/losses",
    "history/scores",
    "history/training",
];

/// Writes the state of a checkpoint after four steps as versions did that used the crate `safetensors`, which sorts tensors by type
/// and name.
fn rewrite_as_earlier_versions(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let now: Value = serde_json::from_str(&header.metadata().as_ref().unwrap()["atsplat.fit"]).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(tensors.len(), TENSORS.len());
    let mut hashed = Vec::new();
    for name in TENSORS {
        let tensor = tensors.tensor(name).unwrap();
        let dtype = if name.starts_with("history/") { Dtype::F64 } else { Dtype::F32 };
        assert_eq!((tensor.dtype(), tensor.shape().len()), (dtype, 1), "{name}");
        hashed.extend_from_slice(tensor.data());
    }
    let history = &now["history"];
    let earlier = json!({
        "step": 4,
        "run": now["run"],
        "configuration": now["configuration"],
        "start": now["start"],
        "device": "cpu",
        "sh_degree": 1,
        "filtered": true,
        "memory": ["gradient-sums", "gradient-counts"],
        "history": {
            "changes": history["changes"],
            "held_out": history["held_out"],
            "evaluations": [[4, history["evaluations"][0][1]]],
        },
        "empty_steps": now["empty_steps"],
        "joint_corrections": true,
        "elapsed": {"seconds": 100.5, "since-step": 0},
        "tensors": Sha256Digest::of(&hashed).to_string(),
    });
    let metadata = HashMap::from([("atsplat.fit".to_owned(), earlier.to_string())]);
    let rewritten = safetensors::serialize(tensors.iter(), Some(metadata)).unwrap();
    std::fs::write(path, rewritten).unwrap();
}

#[test]
fn a_checkpoint_of_an_earlier_version_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let ((views, held_out), start) = (views(), start(Strategy::MipSplatting, 60));
    let config = FitConfig { exposure_rate: Some(1e-3), ..config(Strategy::MipSplatting, 20) };
    let mut whole = Fit::new(config.clone(), views.clone(), &start).unwrap();
    run(&mut whole, 4);
    whole.evaluate(&held_out).unwrap();
    whole.checkpoint(&path).unwrap();
    rewrite_as_earlier_versions(&path);
    assert!(Fit::is_checkpoint(&path).unwrap());
    let mut resumed = Fit::resume(config, views, &held_out, &start, FitDevice::default(), &path).unwrap();
    assert!(resumed.step_count() == 4 && resumed.elapsed().seconds > 100.0, "{:?}", resumed.elapsed());
    for fit in [&mut whole, &mut resumed] {
        run(fit, 3);
    }
    assert_eq!(resumed.gaussians(), whole.gaussians());
    let (mut found, expected) = (resumed.history().clone(), whole.history());
    assert_eq!(found.evaluations[0].score.ssim, None, "earlier versions computed another SSIM");
    found.evaluations[0].score.ssim = expected.evaluations[0].score.ssim;
    assert!(found == *expected, "another history");
}

#[test]
fn an_error_of_a_damaged_checkpoint_names_its_file_and_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let (views, start, config) = (views().0, start(Strategy::Mcmc, 50), config(Strategy::Mcmc, 50));
    Fit::new(config.clone(), views.clone(), &start).unwrap().checkpoint(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let replaced = |from: &str, to: &str| {
        let at = whole.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()
    };
    let header = usize::from(whole[0]) + (usize::from(whole[1]) << 8);
    for (bytes, expected) in [
        (Vec::new(), "byte 0: expected a safetensors file"),
        (whole[..8 + header / 2].to_vec(), "byte 0: expected a safetensors file"),
        (replaced("{", "x"), "byte 0: expected a safetensors file"),
        (replaced("{\"", "{x"), "header, line 1 column "),
        (whole[..whole.len() - 1].to_vec(), "tensor \"second-moment/sh\": expected data within "),
        (replaced("atsplat.fit", "atsplat.fat"), "atsplat.fit: expected metadata, found none"),
        (replaced("value/means", "value/meant"), "value/means: expected a tensor of float32, found none"),
        (replaced(r#"\"step\":0"#, r#"\"step\":3"#), "atsplat.fit: expected the metadata that were written"),
        (replaced("\"F64\"", "\"I64\""), "history/losses: expected a tensor of float64, found int64 [0]"),
    ] {
        std::fs::write(&path, &bytes).unwrap();
        let error = Fit::resume(config.clone(), views.clone(), &[], &start, FitDevice::default(), &path).unwrap_err();
        assert!(matches!(error, FitError::Checkpoint { .. }), "{error}");
        let (error, end) = (error.to_string(), format!("({})", path.display()));
        assert!(error.starts_with(&format!("checkpoint: {expected}")) && error.ends_with(&end), "{error}");
    }
}
