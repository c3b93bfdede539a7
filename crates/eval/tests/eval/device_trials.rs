//! The trials on which `crates/model/tests/wgpu.rs` compares graphics adapters with the CPU: that crate is below those that
//! simulate scenes. `ATSPLAT_BLESS=1` writes them again.

use std::path::PathBuf;
use std::sync::Arc;

use atsplat_camera::Camera;
use atsplat_eval::sources::simulated;
use atsplat_model::weights::{DType, StoredTensor, StoredTensors, TensorFile};
use atsplat_numeric::Tolerance;
use atsplat_protocol::trial::{Prefetch, Trial, TrialRecipe, Trials};
use atsplat_protocol::{IndexFile, Preset};
use atsplat_scene::SharedBytes;

/// The first entry of a preset's first scene.
fn first_trial(preset: &str) -> (Trial, Vec<u8>) {
    let preset = Preset::named(preset).unwrap();
    let mut index = IndexFile::embedded(&preset.index.accepted[0].name).unwrap().unwrap().index;
    index.scenes.truncate(1);
    index.scenes[0].truncate(1);
    let source = Arc::new(simulated(&preset, &index).unwrap().unwrap());
    let mut trials = Trials::new(source, &index, TrialRecipe::of(&preset, "ATSplat"), Prefetch::NONE);
    let (trial, targets) = trials.next().unwrap().unwrap();
    let context = trial.context().iter().map(|view| view.image().unwrap());
    let samples = context.chain([targets.get(0).unwrap().unwrap()]).flat_map(|image| image.samples().to_vec());
    let samples = samples.collect();
    (trial, samples)
}

/// Images of the context and of the first target, and their cameras in the trial's frame.
fn tensors(preset: &str) -> StoredTensors {
    let (trial, samples) = first_trial(preset);
    let cameras: Vec<Camera> =
        trial.context().iter().map(|view| view.camera).chain([trial.targets()[0].camera]).collect();
    let size = trial.targets()[0].size;
    let shape = vec![cameras.len(), size.height as usize, size.width as usize, 3];
    let images = StoredTensor::new(DType::U8, shape, SharedBytes::new(samples)).unwrap();
    let numbers = |width: usize, of: &dyn Fn(&Camera) -> Vec<f64>| {
        let bytes: Vec<u8> = cameras.iter().flat_map(of).flat_map(f64::to_le_bytes).collect();
        StoredTensor::new(DType::F64, vec![cameras.len(), width], SharedBytes::new(bytes)).unwrap()
    };
    let poses = numbers(12, &|camera| camera.camera_from_world.to_rows().to_vec());
    let intrinsics = numbers(4, &|camera| {
        let k = camera.intrinsics;
        vec![k.fx, k.fy, k.cx, k.cy]
    });
    let mut stored = StoredTensors::default();
    for (name, tensor) in [("images", images), ("camera-from-world", poses), ("intrinsics", intrinsics)] {
        stored.tensors.insert(name.to_owned(), tensor);
    }
    stored
}

#[test]
fn the_committed_trials_are_those_of_their_presets() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../model/tests/fixtures/trials");
    for preset in ["rooms-2v-128", "rooms-to-yards-128", "yards-4v-128x224", "yards-6v-112"] {
        let path = folder.join(format!("{preset}.safetensors"));
        let expected = tensors(preset);
        if std::env::var_os("ATSPLAT_BLESS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            expected.write(&path).unwrap();
        }
        let found = TensorFile::open(&path).unwrap().stored;
        let images = |stored: &StoredTensors| stored.tensors["images"].bytes().to_vec();
        let (ours, theirs) = (images(&found), images(&expected));
        // The last bits of the system's mathematics differ between machines.
        assert!(ours.len() == theirs.len() && ours.iter().zip(&theirs).all(|(a, b)| a.abs_diff(*b) <= 1), "{preset}");
        for name in ["camera-from-world", "intrinsics"] {
            let numbers = |stored: &StoredTensors| -> Vec<f64> {
                let words = stored.tensors[name].bytes().as_chunks().0;
                words.iter().map(|word| f64::from_le_bytes(*word)).collect()
            };
            Tolerance::absolute(1e-9).assert(numbers(&found), numbers(&expected), &format!("{preset}, {name}"));
        }
    }
}
