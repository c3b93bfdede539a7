use std::sync::OnceLock;

use atsplat_model::ModelConfig;
use atsplat_model::weights::{DType, StoredTensor};
use atsplat_numeric::Tolerance;
use atsplat_scene::SharedBytes;
use atsplat_scene::preprocess::{Preprocessing, Resampling, RescaleAndCrop};
use atsplat_splat::RendererConstants;

use super::pipeline::weights;
use super::*;

fn baseline() -> &'static Outputs {
    static MADE: OnceLock<Outputs> = OnceLock::new();
    MADE.get_or_init(|| run(&Pipeline::of(&Recipe::default()).unwrap(), &pattern()).unwrap())
}

fn pattern() -> Inputs {
    Inputs::pattern(&RendererConstants::default()).unwrap()
}

fn attribution(stages: &dyn Stages) -> Attribution {
    attribute(stages, baseline(), true).unwrap()
}

fn changed(found: &Attribution) -> Vec<Stage> {
    found.stages.iter().filter(|stage| stage.verdict == StageVerdict::Changed).map(|stage| stage.stage).collect()
}

/// Asserts that only this stage changed and has an effect, and that effects sum up.
fn assert_only(found: &Attribution, stage: Stage) {
    assert_eq!((changed(found), found.first()), (vec![stage], Some(stage)), "{found:?}");
    for metric in &found.metrics {
        let sum: f64 = metric.effects.iter().sum();
        Tolerance::absolute(1e-9).assert([sum], [metric.now - metric.baseline], &metric.metric);
        for (other, effect) in found.stages.iter().zip(&metric.effects) {
            assert_eq!(*effect != 0.0, other.stage == stage, "{}: {} of {:?}", metric.metric, effect, other.stage);
        }
    }
}

#[test]
fn ten_runs_report_no_change() {
    let pipeline = Pipeline::of(&Recipe::default()).unwrap();
    for _ in 0..10 {
        let found = attribution(&pipeline);
        assert_eq!((found.first(), found.stages.iter().map(|stage| stage.differing).sum()), (None, 0u64), "{found:?}");
        assert!(found.metrics.iter().all(|metric| metric.effects.iter().all(|effect| *effect == 0.0)), "{found:?}");
    }
    assert_eq!(run(&pipeline, &pattern()).unwrap().fingerprints(), baseline().fingerprints());
}

#[test]
fn the_probe_has_nontrivial_outputs() {
    let [.., gaussians, render, scores] = &baseline().fingerprints()[..] else { panic!("five stages") };
    let of_render = [render.max, render.mean].map(Option::unwrap);
    assert!(gaussians.values > 10_000 && of_render[0] > 0.05 && of_render[1] > 0.001, "{render:?}");
    assert!(scores.min.is_some() && scores.max.unwrap() > 3.0, "{scores:?}");
}

#[test]
fn a_thousandth_of_a_renderer_constant_is_attributed_to_the_renderer() {
    let mut pipeline = Pipeline::of(&Recipe::default()).unwrap();
    pipeline.options.constants.blur *= 1.001;
    assert_only(&attribution(&pipeline), Stage::Renderer);
}

/// Independently of the network's Gaussians.
#[test]
fn a_thousandth_of_any_renderer_constant_changes_the_limit_scene() {
    type Constant = fn(&mut RendererConstants) -> &mut f64;
    let constants: [(&str, Constant); 7] = [
        ("near", |constants| &mut constants.near),
        ("far", |constants| &mut constants.far),
        ("blur", |constants| &mut constants.blur),
        ("max-alpha", |constants| &mut constants.max_alpha),
        ("min-alpha", |constants| &mut constants.min_alpha),
        ("min-transmittance", |constants| &mut constants.min_transmittance),
        ("jacobian-margin", |constants| &mut constants.jacobian_margin),
    ];
    let mut pipeline = Pipeline::of(&Recipe::default()).unwrap();
    let view = limit_scene::limit_view().unwrap();
    for preset in RendererConstants::preset_names() {
        let then = RendererConstants::named(preset).unwrap();
        let gaussians = limit_scene::limit_scene(&then).unwrap();
        let mut render = |constants: &RendererConstants| {
            pipeline.options.constants = constants.clone();
            pipeline.render(&gaussians, &view).unwrap()
        };
        let baseline = render(&then);
        for (name, of) in &constants {
            for factor in [0.999, 1.001] {
                let mut now = then.clone();
                *of(&mut now) *= factor;
                let may = now.check().is_ok() && of(&mut now).is_finite();
                assert!(!may || render(&now) != baseline, "{preset}: {name} times {factor}");
            }
        }
    }
}

#[test]
fn another_filter_is_attributed_to_resizing() {
    let mut pipeline = Pipeline::of(&Recipe::default()).unwrap();
    let bilinear = RescaleAndCrop { filter: Resampling::Bilinear, ..RescaleAndCrop::new(64, 64) };
    pipeline.preprocessing = Preprocessing::of([bilinear.into()]);
    assert_only(&attribution(&pipeline), Stage::Resize);
}

#[test]
fn one_flipped_sign_is_attributed_to_the_model() {
    let recipe = Recipe::default();
    let config = ModelConfig::named("nano").unwrap();
    let mut tensors = weights(&config, &recipe.weights).unwrap();
    let (_, tensor) = tensors.tensors.iter_mut().rfind(|(_, tensor)| tensor.shape().len() == 2).unwrap();
    let mut values = tensor.to_f32().unwrap();
    let largest = (0..values.len()).max_by(|a, b| values[*a].abs().total_cmp(&values[*b].abs())).unwrap();
    values[largest] = -values[largest];
    *tensor = StoredTensor::from_f32(tensor.shape().to_vec(), &values).unwrap();
    let pipeline = Pipeline::with_weights(&recipe, &config, &tensors).unwrap();
    assert_only(&attribution(&pipeline), Stage::Model);
}

/// Stages of which some are changed.
struct Changed {
    pipeline: Pipeline,
    stages: Vec<Stage>,
}

impl Stages for Changed {
    fn decode(&self, bytes: &[u8]) -> Result<ImageU8, DriftError> {
        let image = self.pipeline.decode(bytes)?;
        let step = u8::from(self.stages.contains(&Stage::Decode));
        let samples = image.samples().iter().map(|sample| sample ^ step).collect();
        Ok(ImageU8::new(image.width(), image.height(), samples).unwrap())
    }

    fn resize(&self, view: &View) -> Result<View, DriftError> {
        self.pipeline.resize(view)
    }

    fn model(&self, context: &[View]) -> Result<Gaussians, DriftError> {
        let made = self.pipeline.model(context)?;
        if !self.stages.contains(&Stage::Model) {
            return Ok(made);
        }
        let half: Vec<usize> = (0..made.len() / 2).collect();
        Ok(made.select(&half).unwrap())
    }

    fn render(&self, gaussians: &Gaussians, target: &View) -> Result<Image, DriftError> {
        self.pipeline.render(gaussians, target)
    }

    fn score(&self, render: &Image, truth: &ImageU8) -> Result<BTreeMap<String, f64>, DriftError> {
        let mut scores = self.pipeline.score(render, truth)?;
        if self.stages.contains(&Stage::Metric) {
            for score in scores.values_mut() {
                *score *= 1.001;
            }
        }
        Ok(scores)
    }
}

#[test]
fn changes_of_decoding_and_metrics_are_attributed() {
    for stage in [Stage::Decode, Stage::Metric] {
        let stages = Changed { pipeline: Pipeline::of(&Recipe::default()).unwrap(), stages: vec![stage] };
        assert_only(&attribution(&stages), stage);
    }
}

#[test]
fn several_changes_are_all_found_and_their_effects_sum_up() {
    let mut pipeline = Pipeline::of(&Recipe::default()).unwrap();
    pipeline.options.constants.min_alpha *= 2.0;
    let stages = vec![Stage::Decode, Stage::Model, Stage::Metric];
    let found = attribution(&Changed { pipeline, stages });
    assert_eq!(changed(&found), [Stage::Decode, Stage::Model, Stage::Renderer, Stage::Metric], "{found:?}");
    assert_eq!((found.first(), found.stages[2].values_now * 2), (Some(Stage::Decode), found.stages[2].values));
    for metric in &found.metrics {
        let sum: f64 = metric.effects.iter().sum();
        Tolerance::absolute(1e-9).assert([sum], [metric.now - metric.baseline], &metric.metric);
    }
}

#[test]
fn another_machine_may_round_differently() {
    let mut outputs = baseline().clone();
    let render = &outputs.renders[0];
    let samples = render.samples().iter().map(|sample| sample + 1e-6).collect();
    outputs.renders[0] = Image::new(render.width(), render.height(), samples).unwrap();
    let pipeline = Pipeline::of(&Recipe::default()).unwrap();
    // The scores must belong to the modified render.
    outputs.scores = vec![pipeline.score(&outputs.renders[0], &outputs.views[2].image).unwrap()];
    assert_eq!(attribute(&pipeline, &outputs, true).unwrap().first(), Some(Stage::Renderer));
    assert_eq!(attribute(&pipeline, &outputs, false).unwrap().first(), None);
}

#[test]
fn the_file_is_exact_and_small() {
    let bytes = baseline().to_bytes().unwrap();
    assert!(bytes.len() < 600_000, "{} bytes", bytes.len());
    assert_eq!(&Outputs::from_bytes(&bytes).unwrap(), baseline());
    assert_eq!(bytes, baseline().to_bytes().unwrap(), "the same bytes each time");
}

#[test]
fn broken_files_are_errors() {
    let bytes = baseline().to_bytes().unwrap();
    for length in [0, 7, 8, 100, bytes.len() / 2, bytes.len() - 1] {
        assert!(Outputs::from_bytes(&bytes[..length]).is_err(), "{length} bytes");
    }
    let without = |name: &str| {
        let mut stored = atsplat_model::weights::StoredTensors::parse(SharedBytes::new(bytes.clone())).unwrap();
        stored.tensors.shift_remove(name).unwrap();
        Outputs::from_bytes(&stored.to_safetensors().unwrap())
    };
    for name in ["context", "camera.1", "decode.2", "resize.0", "model.sh", "model.quaternions"] {
        assert!(without(name).is_err(), "without {name}");
    }
    let mut stored = atsplat_model::weights::StoredTensors::parse(SharedBytes::new(bytes.clone())).unwrap();
    let flat = StoredTensor::new(DType::U8, vec![3], SharedBytes::new(vec![0; 3])).unwrap();
    stored.tensors.insert("decode.0".to_owned(), flat);
    let error = Outputs::from_bytes(&stored.to_safetensors().unwrap()).unwrap_err().to_string();
    assert!(error.contains("decode.0") && error.contains("[3]"), "{error}");
}

#[test]
fn rejects_invalid_recipes() {
    assert_eq!(Recipe::from_toml("").unwrap(), Recipe::default());
    let text = toml::to_string(&Recipe::default()).unwrap();
    assert_eq!(Recipe::from_toml(&text).unwrap(), Recipe::default());
    let error = Recipe::from_toml("constants = 'exact'\nmodell = 'nano'").unwrap_err().to_string();
    assert!(error.starts_with("probe: line 2 column 1: expected ") && error.contains("field `modell`"), "{error}");
    let broken = ["model = 'none'", "constants = 'none'", "metrics = ['none']", "metrics = ['lpips']", "metrics = []"];
    for broken in broken {
        let recipe = Recipe::from_toml(broken).unwrap();
        let outcome = Pipeline::of(&recipe).and_then(|stages| run(&stages, &pattern()));
        assert!(outcome.is_err(), "{broken}");
    }
}
