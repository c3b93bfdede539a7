//! What evaluation leaves out by default does not show in its numbers.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use crate::common::{Run, Walls, dataset, entry};
use atsplat_camera::ImageSize;
use atsplat_eval::GaussianFrame;
use atsplat_eval::method::{AtSplat, Method, Ply, Splatting, WeightsSource};
use atsplat_eval::runner::Dataset;
use atsplat_model::network::{Device, Network};
use atsplat_model::weights::ModelWeights;
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_protocol::Preset;
use atsplat_results::TargetRow;
use atsplat_scene::preprocess::{Resize, Step};
use atsplat_splat::effects::{EffectPlan, EffectSelection};
use atsplat_splat::files::{self, Encoding, Output};
use atsplat_splat::{GaussianParts, Gaussians, sh_coefficients};

fn splattings() -> [(&'static str, Splatting); 2] {
    [("auto", Splatting::default()), ("all", Splatting { effects: EffectSelection::All, ..Splatting::default() })]
}

/// The walls in the images' shape of every preset, with its rules, once for each that differs.
fn presets() -> Vec<(&'static str, Preset)> {
    let mut found: BTreeMap<String, (&str, Preset)> = BTreeMap::new();
    for name in Preset::names() {
        let mut preset = Preset::named(name).unwrap();
        let source = preset.preprocessing.expected_size.unwrap_or(ImageSize { width: 960, height: 540 });
        let size = preset.preprocessing.plan(source).unwrap().output();
        preset.preprocessing.expected_size = None;
        preset.preprocessing.steps = vec![Step::Resize(Resize::new(size.height, size.width))];
        let renderer = &preset.renderer;
        found.insert(format!("{size} {renderer:?} {:?}", preset.near_far), (name, preset.clone()));
    }
    found.into_values().collect()
}

/// Asserts that PSNR differs by less than 1e-3 dB between the two methods in every preset; returns the number of targets
/// whose images differ.
fn compare(methods: Vec<Arc<dyn Method>>, targets: &[usize], presets: Vec<(&'static str, Preset)>) -> usize {
    let datasets = presets.into_iter().map(|(name, preset)| Dataset {
        name: name.to_owned(),
        preset,
        ..dataset(Walls::new(1, 24), &[entry(&[0, 4], targets)])
    });
    let folder = tempfile::tempdir().unwrap();
    let (results, _) = Run::new(datasets.collect(), methods).run(folder.path()).unwrap();
    let of = |name: &str| -> Vec<&TargetRow> { results.targets.iter().filter(|row| row.key.method == name).collect() };
    let (auto, all) = (of("auto"), of("all"));
    assert_eq!(auto.len(), all.len());
    for (auto, all) in auto.iter().zip(&all) {
        assert_eq!((&auto.key.preset, auto.target), (&all.key.preset, all.target));
        let (id, psnr) = auto.scores.iter().next().unwrap();
        let what = format!("{id} of target {} of {}", auto.target, auto.key.preset);
        Tolerance::absolute(1e-3).assert([*psnr], [all.scores[id]], &what);
    }
    auto.iter().zip(&all).filter(|(auto, all)| auto.render_hash != all.render_hash).count()
}

/// The embedded network at the shape of every preset.
#[test]
fn the_networks_psnr_is_that_of_everything() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/checkpoints/micro-rooms.safetensors");
    let weights = ModelWeights::read(&path).unwrap();
    let network = Network::new(&weights.config, &Device::flex()).unwrap().with_weights(&weights.tensors).unwrap();
    let source = WeightsSource::File { sha256: "0".repeat(64) };
    let methods = splattings().map(|(name, splatting)| {
        let network = network.clone().trained_at(weights.config.resolution);
        Arc::new(AtSplat::new(name, network, &source, 0, splatting).unwrap()) as Arc<dyn Method>
    });
    let [auto, all] = [0, 1].map(|at: usize| methods[at].record().parameters);
    assert_eq!((auto["effects"].as_str(), all["effects"].as_str()), (Some("auto"), Some("all")));
    Tolerance::EXACT.assert(auto["tolerance"].as_f64(), [EffectPlan::TOLERANCE], "recorded");
    compare(methods.to_vec(), &[2], presets());
}

/// Gaussians of degree 3 around the wall, of which one in eight shows its harmonics.
fn around_the_wall() -> Gaussians {
    const COUNT: usize = 6000;
    let mut random = SplitMix64::new(7);
    let mut spread = |size: f32| size * (2.0 * random.unit_f32() - 1.0);
    let mut parts = GaussianParts { sh_degree: 3, ..GaussianParts::default() };
    for at in 0..COUNT {
        parts.means.push([2.0 + spread(4.5), spread(2.2), 4.0 + spread(0.3)]);
        parts.quaternions.push([1.0, spread(1.0), spread(1.0), spread(1.0)]);
        parts.log_scales.push([-2.2 + spread(0.5), -2.2 + spread(0.5), -2.5]);
        parts.opacity_logits.push(spread(3.0));
        parts.sh.push([spread(1.0), spread(1.0), spread(1.0)]);
        let size = if at % 8 == 0 { 0.1 } else { 1e-4 };
        parts.sh.extend((1..sh_coefficients(3)).map(|_| [spread(size), spread(size), spread(size)]));
    }
    Gaussians::new(parts).unwrap()
}

/// Enough targets that harmonics are packed.
#[test]
fn the_psnr_of_harmonics_is_that_of_everything() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall-0.ply");
    files::write(&path, &around_the_wall(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
    let methods = splattings().map(|(name, splatting)| {
        let ply = Ply::new(folder.path(), Some(name), GaussianFrame::Dataset, false, splatting).unwrap();
        Arc::new(ply) as Arc<dyn Method>
    });
    let targets: Vec<usize> = (2..20).collect();
    let simulated = |(_, preset): &(&str, Preset)| ["rooms", "yards"].contains(&preset.dataset.as_str());
    let two: Vec<_> = presets().into_iter().filter(simulated).take(2).collect();
    assert_eq!(two.len(), 2);
    assert_eq!(compare(methods.to_vec(), &targets, two), 36, "something is left out of every image");
}
