//! Networks on a GPU against the same networks on the CPU, which other tests compare with PyTorch.
//!
//! Without an adapter these tests print a message and pass; with `ATSPLAT_REQUIRE_GPU=1` they fail.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "helpers of tests fail like tests")]
#![expect(clippy::print_stdout, reason = "differences between devices are printed for people")]

use std::path::Path;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize as CameraSize, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::network::{
    BlockOutcome, Device, GaussianTensors, MatmulPrecision, Network, Processor, Reconstruction, RenderedTensors, Views,
    f32_values,
};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensor, TensorFile, generated};
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_numeric::{Extremes as _, SplitMix64, Tolerance};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::{AdapterChoice, GpuOptions, GpuRenderer, adapters};
use atsplat_splat::{
    Channels, GaussianParts, RenderOptions, Renderer, RendererConstants, SMALLEST_MIN_ALPHA, StoppedGradients, View,
};
use atsplat_tests::{skip, skip_without_graphics};
use burn::Tensor;
use burn::module::Module as _;
use burn::tensor::TensorData;
use glam::{DMat3, DVec3};
use indexmap::IndexMap;

/// The accuracy documented for `Processor::open`: of network outputs, of images, and of gradients relative to the largest
/// of their parameter.
const NETWORK: Tolerance = Tolerance { absolute: 2e-5, relative: 2e-5 };
const IMAGES: Tolerance = Tolerance { absolute: 5e-5, relative: 5e-5 };
const GRADIENTS: Tolerance = Tolerance { absolute: 5e-4, relative: 5e-4 };
/// Tokens whose scores are this close to the last selected one may be selected differently.
const TIE: f32 = 1e-6;

/// Where the two networks' Gaussians differ in the last digits, two that are equally far may be composited in the other order, and
/// pixels under both jump: so many of an image's numbers, or of a gradient's, may be outside their tolerance, and by so much.
const JUMPS: f64 = 0.02;
const LARGEST_JUMP: Tolerance = Tolerance { absolute: 5e-3, relative: 5e-3 };

type Part = fn(&GaussianParts) -> &[f32];

const PARTS: [(&str, Part); 5] = [
    ("means", |parts| parts.means.as_flattened()),
    ("quaternions", |parts| parts.quaternions.as_flattened()),
    ("log scales", |parts| parts.log_scales.as_flattened()),
    ("opacity logits", |parts| &parts.opacity_logits),
    ("spherical harmonics", |parts| parts.sh.as_flattened()),
];

fn wgpu() -> Option<Device> {
    match Processor::Wgpu(None).open() {
        Ok(device) => Some(device),
        Err(error) => {
            skip_without_graphics("model wgpu", error);
            None
        }
    }
}

/// Cameras that look inwards from an arc.
fn cameras(config: &ModelConfig) -> Vec<Camera> {
    let camera = |view: usize| {
        let angle = 0.25 * view as f64;
        let pose = WorldFromCamera::new(DMat3::from_rotation_y(-angle), DVec3::new(2.0 * angle.sin(), 0.0, 0.0));
        Camera::pinhole(pose.unwrap().inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap())
    };
    (0..config.views).map(camera).collect()
}

/// Images of colour waves.
fn views(config: &ModelConfig) -> Views {
    let (count, size) = (config.views, config.resolution);
    let samples = count * size.height * size.width * 3;
    let images = (0..samples).map(|at| 0.5 + 0.5 * (at as f32 * 0.37).sin() * (at as f32 * 0.000_91).cos()).collect();
    Views::new(size, images, cameras(config)).unwrap()
}

fn made(config: &ModelConfig, device: &Device) -> Reconstruction {
    let weights = generated(&parameters(config), 1);
    let network = Network::new(config, device).unwrap().with_weights(&weights).unwrap();
    network.reconstruct(&views(config), 7).unwrap()
}

#[test]
fn nano_on_wgpu_agrees_with_the_cpu() {
    let Some(device) = wgpu() else { return };
    compare("nano", &ModelConfig::named("nano").unwrap(), &device);
}

/// Anchor designs, backbones and selections of the PyTorch fixtures, at 32×48 pixels.
#[test]
fn every_variant_on_wgpu_agrees_with_the_cpu() {
    let Some(device) = wgpu() else { return };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/network");
    let mut compared = 0;
    for path in std::fs::read_dir(folder).unwrap() {
        let path = path.unwrap().path();
        let configuration = TensorFile::open(&path).unwrap().stored.metadata["configuration"].clone();
        let config = ModelConfig::from_toml(&configuration).unwrap();
        compared += usize::from(compare(&path.file_stem().unwrap().to_string_lossy(), &config, &device));
    }
    assert!(compared >= 20, "ties left only {compared} to compare");
}

/// Returns whether everything was compared: after a tie that is broken differently, results differ.
fn compare(name: &str, config: &ModelConfig, device: &Device) -> bool {
    let (ours, theirs) = (made(config, device), made(config, &Device::flex()));
    assert_eq!(ours.budget, theirs.budget, "{name}");
    if let (Some(ours), Some(theirs)) = (&ours.anchors, &theirs.anchors) {
        assert_same(ours.as_flattened(), theirs.as_flattened(), &format!("{name}, anchors"));
    }
    for (block, (ours, theirs)) in ours.blocks.iter().zip(&theirs.blocks).enumerate() {
        if let (Some(ours), Some(theirs)) = (&ours.scores, &theirs.scores) {
            assert_same(ours, theirs, &format!("{name}, scores of block {block}"));
        }
        if ours.selected != theirs.selected {
            assert_tied(ours, theirs, &format!("{name}, block {block}"));
            println!("{name}, block {block}: a tie was broken differently");
            return false;
        }
    }
    let [ours, theirs] = [&ours, &theirs].map(|made| made.gaussians.parts());
    for (what, part) in PARTS {
        assert_same(part(ours), part(theirs), &format!("{name}, {what}"));
    }
    true
}

/// Asserts that tokens selected on only one device have the score of the last selected one.
fn assert_tied(ours: &BlockOutcome, theirs: &BlockOutcome, what: &str) {
    let scores = theirs.scores.as_ref().unwrap();
    let last = theirs.selected.iter().map(|&token| scores[token]).min_by(f32::total_cmp).unwrap();
    let differing = (0..scores.len()).filter(|token| ours.selected.contains(token) != theirs.selected.contains(token));
    for token in differing {
        let apart = (scores[token] - last).abs();
        assert!(apart <= TIE * (1.0 + last), "{what}: token {token} is {apart} from the last selected one");
    }
}

fn assert_same(ours: &[f32], theirs: &[f32], what: &str) {
    assert_within(NETWORK, ours, theirs, what);
}

fn assert_within(tolerance: Tolerance, ours: &[f32], theirs: &[f32], what: &str) {
    let wide = |numbers: &[f32]| numbers.iter().copied().map(f64::from).collect::<Vec<f64>>();
    let (ours, theirs) = (wide(ours), wide(theirs));
    let shares = ours.iter().zip(&theirs).map(|(ours, theirs)| (ours - theirs).abs() / (1.0 + theirs.abs()));
    println!("{what}: at most {:.1e} of 1 + the number", shares.max_by(f64::total_cmp).unwrap_or_default());
    tolerance.assert(ours, theirs, what);
}

/// As [`assert_within`], but for [`JUMPS`].
fn assert_same_but_jumps(tolerance: Tolerance, ours: &[f32], theirs: &[f32], what: &str) {
    assert_within(LARGEST_JUMP, ours, theirs, what);
    let outside =
        ours.iter().zip(theirs).filter(|(ours, theirs)| !tolerance.accepts((**ours).into(), (**theirs).into()));
    let (outside, all) = (outside.count(), theirs.len());
    assert!(outside as f64 <= JUMPS * all as f64, "{what}: {outside} of {all} numbers are outside {tolerance:?}");
}

/// Compares images, depth, scores, and their gradients with respect to every parameter.
#[test]
fn rendering_and_gradients_on_wgpu_agree_with_the_cpu() {
    let Some(device) = wgpu() else { return };
    assert!(Processor::Wgpu(None).renders(), "the renderer fails its self-test");
    let config = ModelConfig::named("nano").unwrap();
    let [ours, theirs] = [device, Device::flex()].map(|device| rendered(&config, &device.autodiff()));
    for ((what, ours), (_, theirs)) in ours.images.iter().zip(&theirs.images) {
        assert_same_but_jumps(IMAGES, ours, theirs, what);
    }
    assert!(ours.gradients.len() > 50, "{} parameters have a gradient", ours.gradients.len());
    for (name, theirs) in &theirs.gradients {
        let largest = theirs.iter().fold(0.0f32, |largest, value| largest.maximum_of(value.abs()));
        assert!(largest > 0.0, "{name} has a gradient");
        let scaled = |values: &[f32]| values.iter().map(|value| value / largest).collect::<Vec<f32>>();
        assert_same_but_jumps(
            GRADIENTS,
            &scaled(&ours.gradients[name]),
            &scaled(theirs),
            &format!("gradient of {name}"),
        );
    }
}

struct Rendered {
    images: Vec<(&'static str, Vec<f32>)>,
    /// By parameter.
    gradients: IndexMap<String, Vec<f32>>,
}

fn rendered(config: &ModelConfig, device: &Device) -> Rendered {
    let network = Network::new(config, device).unwrap().with_weights(&generated(&parameters(config), 1)).unwrap();
    let made = network.forward(&[views(config)], 0).unwrap();
    let size = CameraSize { width: 40, height: 24 };
    let targets: Vec<View> = cameras(config).into_iter().map(|camera| View { camera, size }).collect();
    let options = RenderOptions {
        // A Gaussian with alpha just above the usual 1/255 on one device and just below on the other would change a pixel
        // by its whole contribution; at the smallest threshold the jump is within tolerance.
        constants: RendererConstants { min_alpha: SMALLEST_MIN_ALPHA, ..RendererConstants::default() },
        channels: Channels { depth: true, scalar: true, ..Channels::default() },
        // As in training.
        gradients: StoppedGradients { scalar_stops: true, ..StoppedGradients::default() },
        ..RenderOptions::default()
    };
    // The scores of a block's tokens, on the Gaussians that those tokens would become.
    let (before, after) = (&made.blocks[0], &made.blocks[1]);
    let gaussians = network.gaussians(&before.tokens);
    let scores = after.expanded.as_ref().unwrap().scores.clone().unwrap();
    let [_, tokens] = scores.dims();
    let count = gaussians.means.dims()[1];
    let scalars = scores.unsqueeze_dim::<3>(2).repeat_dim(2, count / tokens).reshape([count]);
    let images = gaussians.render(0, &targets, &options, Some(scalars)).unwrap();
    let last = made
        .gaussians
        .render(0, &targets[..1], &RenderOptions { channels: Channels::default(), ..options.clone() }, None)
        .unwrap();
    assert_eq!(images.counts.len(), targets.len());
    let (depth, scalar) = (images.depth.unwrap(), images.scalar.unwrap());
    let flat = |rgb: &Tensor<4>| f32_values(rgb.clone().flatten::<3>(1, 2));
    let shown = vec![
        ("colour", flat(&images.rgb)),
        ("colour of the last set", flat(&last.rgb)),
        ("alpha", f32_values(images.alpha.clone())),
        ("depth", f32_values(depth.clone())),
        ("scores", f32_values(scalar.clone())),
    ];
    let sum = (images.rgb.clone() * images.rgb).sum() + (last.rgb.clone() * last.rgb).sum();
    let sum = sum + images.alpha.sum() * 0.3 + depth.sum() * 0.05 + scalar.sum() * 0.2;
    Rendered { images: shown, gradients: network.gradients(&sum.backward()) }
}

/// `scenes` different ones, `count` Gaussians each, as leaves of a graph; and one scalar for each Gaussian.
fn leaves(scenes: usize, count: usize, device: &Device) -> (GaussianTensors, Tensor<2>) {
    let mut random = SplitMix64::for_scene(7, "leaves");
    let mut tensor = |each: usize, low: f32, high: f32| {
        let values: Vec<f32> = (0..scenes * count * each).map(|_| low + (high - low) * random.unit_f32()).collect();
        Tensor::<3>::from_data(TensorData::new(values, [scenes, count, each]), device)
    };
    let shift = Tensor::<1>::from_floats([0.0, 0.0, 2.5], device).reshape([1, 1, 3]);
    let gaussians = GaussianTensors {
        means: (tensor(3, -1.0, 1.0) + shift).require_grad(),
        quaternions: tensor(4, -1.0, 1.0).require_grad(),
        log_scales: tensor(3, -3.5, -1.5).require_grad(),
        opacity_logits: tensor(1, -2.0, 2.0).squeeze_dim::<2>(2).require_grad(),
        sh: tensor(12, -0.8, 0.8).require_grad(),
        sh_degree: 1,
    };
    let scalars = tensor(1, 0.0, 1.0).squeeze_dim::<2>(2).require_grad();
    (gaussians, scalars)
}

/// Images of several scenes, all at once or scene by scene, and the gradients of a sum that weighs every pixel differently.
fn of_scenes(at_once: bool, count: usize, views: &[Vec<View>], device: &Device) -> Vec<Vec<f32>> {
    let (gaussians, scalars) = leaves(views.len(), count, device);
    let options = RenderOptions {
        channels: Channels { depth: true, scalar: true, ..Channels::default() },
        ..RenderOptions::default()
    };
    let rendered: Vec<RenderedTensors> = if at_once {
        vec![gaussians.render_all(views, &options, Some(scalars.clone())).unwrap()]
    } else {
        let one = |(scene, views): (usize, &Vec<View>)| {
            let of_scene = scalars.clone().slice_dim(0, scene..scene + 1).squeeze_dim::<1>(0);
            gaussians.render(scene, views, &options, Some(of_scene)).unwrap()
        };
        views.iter().enumerate().map(one).collect()
    };
    let rgb = Tensor::cat(rendered.iter().map(|images| images.rgb.clone()).collect(), 0);
    let channel = |of: fn(&RenderedTensors) -> Tensor<3>| Tensor::cat(rendered.iter().map(of).collect(), 0);
    let extra = channel(|it| it.depth.clone().unwrap()) * 0.1 + channel(|it| it.scalar.clone().unwrap());
    let count = rgb.shape().num_elements();
    let weights: Vec<f32> = (0..count).map(|at| (at as f32 * 0.37).sin()).collect();
    let weights = Tensor::<4>::from_data(TensorData::new(weights, rgb.dims()), device);
    let sum =
        (rgb.clone() * weights.clone()).sum() + (extra.clone() * weights.slice_dim(3, 0..1).squeeze_dim::<3>(3)).sum();
    let gradients = sum.backward();
    let of = |leaf: &Tensor<3>| f32_values(leaf.grad(&gradients).unwrap());
    let flat = |leaf: &Tensor<2>| f32_values(leaf.grad(&gradients).unwrap());
    let GaussianTensors { means, quaternions, log_scales, opacity_logits, sh, .. } = &gaussians;
    vec![
        f32_values(rgb),
        f32_values(extra),
        of(means),
        of(quaternions),
        of(log_scales),
        flat(opacity_logits),
        of(sh),
        flat(&scalars),
    ]
}

fn views_of_scenes(scenes: usize, count: usize, side: u32) -> Vec<Vec<View>> {
    let size = CameraSize { width: side, height: side - 3 };
    let view = |scene: usize, at: usize| {
        let pose = CameraFromWorld::new(
            DMat3::from_rotation_y(0.1 * scene as f64 - 0.01 * at as f64),
            DVec3::new(0.1 * at as f64 % 0.7, 0.05, 0.2 * scene as f64),
        );
        let intrinsics = NormalizedIntrinsics::new(0.9, 1.0, 0.5, 0.48).unwrap();
        View { camera: Camera::pinhole(pose.unwrap(), intrinsics), size }
    };
    (0..scenes).map(|scene| (0..count).map(|at| view(scene, at)).collect()).collect()
}

fn at_once_and_one_by_one_agree(count: usize, views: &[Vec<View>], device: &Device) {
    let [at_once, one_by_one] =
        [true, false].map(|at_once| of_scenes(at_once, count, views, &device.clone().autodiff()));
    for (part, (found, expected)) in at_once.iter().zip(&one_by_one).enumerate() {
        assert!(found == expected, "part {part} of {} scenes", views.len());
        assert!(found.iter().any(|value| value.abs() > 1e-3), "part {part}");
    }
}

/// Scenes at once have the images and gradients of scenes one by one: three in one launch, and two with more views than a launch takes.
/// The CPU's backend accepts batches too.
#[test]
fn scenes_at_once_are_those_one_by_one() {
    for device in [Some(Device::flex()), wgpu()].into_iter().flatten() {
        for views in [views_of_scenes(3, 2, 40), views_of_scenes(2, 81, 16)] {
            at_once_and_one_by_one_agree(300, &views, &device);
        }
    }
}

/// Two scenes whose lists of tiles fit one launch of the forward pass, but not of the backward pass, whose pairs are longer.
#[test]
fn gradients_of_scenes_that_are_too_large_together_are_those_one_by_one() {
    let Some(device) = wgpu() else { return };
    let (processor, views) = (Processor::Wgpu(None), views_of_scenes(2, 4, 256));
    let before = processor.rendering_counts().unwrap();
    of_scenes(true, 25_000, &views, &device.clone().autodiff());
    let made = processor.rendering_counts().unwrap() - before;
    // In one launch there are four, and two more for each repetition. An adapter with larger buffers needs no more.
    let is_small = processor.adapter().unwrap().unwrap().1.largest_binding <= 128 << 20;
    assert!(!is_small || made.submissions >= 8 + 2 * made.repeats, "one of the backward pass for each view: {made:?}");
    at_once_and_one_by_one_agree(25_000, &views, &device);
}

/// Largest difference in PSNR between the images that a network and a renderer on an adapter make of a trial and those that
/// the CPU makes, in dB.
const PSNR: f64 = 0.005;

/// A trial of simulated scenes, as `crates/eval/tests/eval/device_trials.rs` writes it: context views, then one target.
struct Trial {
    context: Views,
    target: View,
    truth: Vec<f32>,
}

impl Trial {
    fn open(preset: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/fixtures/trials/{preset}.safetensors"));
        let stored = TensorFile::open(&path).unwrap().stored;
        let images = &stored.tensors["images"];
        let [count, height, width, channels]: [usize; 4] = images.shape().try_into().unwrap();
        assert_eq!(channels, 3);
        let numbers = |name: &str| -> Vec<f64> {
            stored.tensors[name].bytes().as_chunks().0.iter().map(|word| f64::from_le_bytes(*word)).collect()
        };
        let (poses, intrinsics) = (numbers("camera-from-world"), numbers("intrinsics"));
        let cameras = poses.as_chunks().0.iter().zip(intrinsics.as_chunks().0).map(|(rows, &[fx, fy, cx, cy])| {
            let intrinsics = NormalizedIntrinsics::new(fx, fy, cx, cy).unwrap();
            Camera::pinhole(CameraFromWorld::from_rows(rows).unwrap(), intrinsics)
        });
        let mut cameras: Vec<Camera> = cameras.collect();
        let target = cameras.pop().unwrap();
        let mut samples: Vec<f32> = images.bytes().iter().map(|&sample| f32::from(sample) / 255.0).collect();
        let truth = samples.split_off((count - 1) * height * width * channels);
        let context = Views::new(ImageSize::new(height, width), samples, cameras).unwrap();
        let size = CameraSize { width: width.try_into().unwrap(), height: height.try_into().unwrap() };
        Self { context, target: View { camera: target, size }, truth }
    }

    /// Gaussians, those drawn, and the PSNR of the target.
    fn evaluated(&self, network: &Network, renderer: &mut dyn Renderer) -> (Reconstruction, u64, f64) {
        let found = network.reconstruct(&self.context, 0).unwrap();
        let rendering = renderer.render(&found.gaussians, &self.target, &RenderOptions::default()).unwrap();
        let errors = rendering.rgb.as_flattened().iter().zip(&self.truth);
        let squares: f64 = errors.map(|(ours, truth)| f64::from(ours.clamp(0.0, 1.0) - truth).powi(2)).sum();
        (found, rendering.counts.drawn, -10.0 * (squares / self.truth.len() as f64).log10())
    }
}

/// Products in float16 change the embedded network's image of a trial, but hardly its PSNR.
#[test]
fn products_in_float16_move_the_psnr_by_little() {
    let Some(device) = wgpu() else { return };
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/checkpoints/micro-rooms.safetensors");
    let trained = ModelWeights::of_file(&TensorFile::open(&file).unwrap()).unwrap();
    let network = Network::new(&trained.config, &device).unwrap().with_weights(&trained.tensors).unwrap();
    assert!(!network.supports_precision(MatmulPrecision::Bf16) && network.supports_precision(MatmulPrecision::F32));
    if !network.supports_precision(MatmulPrecision::F16) {
        skip("products_in_float16_move_the_psnr_by_little", "the adapter's shaders have no 16-bit floats");
        return;
    }
    let trial = Trial::open("rooms-2v-128");
    let [exact, half] = [MatmulPrecision::F32, MatmulPrecision::F16]
        .map(|products| products.scope(|| trial.evaluated(&network, &mut CpuRenderer::default())));
    println!("{} dB in f32, {} dB in float16", exact.2, half.2);
    assert!(exact.0.gaussians.parts().means != half.0.gaussians.parts().means);
    Tolerance::absolute(0.05).assert([half.2], [exact.2], "PSNR");
}

/// The embedded network on a trial of rooms and of a yard, and untrained ones on four and six views of a yard.
#[test]
fn trials_of_each_family_on_wgpu_have_the_cpus_psnr_and_gaussians() {
    let Some(device) = wgpu() else { return };
    let mut renderer = GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default()).unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/checkpoints/micro-rooms.safetensors");
    let trained = ModelWeights::of_file(&TensorFile::open(&file).unwrap()).unwrap();
    let nano = ModelConfig::named("nano").unwrap();
    let untrained = generated(&parameters(&nano), 1);
    for (preset, config, weights, least) in [
        ("rooms-2v-128", &trained.config, &trained.tensors, 18.0),
        ("rooms-to-yards-128", &trained.config, &trained.tensors, 12.0),
        ("yards-4v-128x224", &nano, &untrained, 0.0),
        ("yards-6v-112", &nano, &untrained, 0.0),
    ] {
        let trial = Trial::open(preset);
        let network = |device: &Device| Network::new(config, device).unwrap().with_weights(weights).unwrap();
        let on_adapter = network(&device);
        assert!(on_adapter.adapter().is_some_and(|adapter| renderer.adapter() == adapter.to_string()));
        let (ours, ours_drawn, ours_psnr) = trial.evaluated(&on_adapter, &mut renderer);
        let (theirs, theirs_drawn, theirs_psnr) =
            trial.evaluated(&network(&Device::flex()), &mut CpuRenderer::default());
        println!("{preset}: {ours_psnr} and {theirs_psnr} dB, {ours_drawn} and {theirs_drawn} drawn");
        assert_eq!(ours.budget, theirs.budget, "{preset}");
        for (block, (ours, theirs)) in ours.blocks.iter().zip(&theirs.blocks).enumerate() {
            if ours.selected != theirs.selected {
                assert_tied(ours, theirs, &format!("{preset}, block {block}"));
                println!("{preset}, block {block}: a tie was broken differently");
                break;
            }
        }
        assert!(theirs_psnr >= least, "{preset}: {theirs_psnr} dB");
        Tolerance::absolute(PSNR).assert([ours_psnr], [theirs_psnr], preset);
        Tolerance::relative(1e-3).assert([ours_drawn as f64], [theirs_drawn as f64], preset);
    }
}

#[test]
fn another_adapter_than_the_opened_one_is_rejected_and_an_unknown_number_lists_them() {
    if wgpu().is_none() {
        return;
    }
    let listed = adapters();
    let unknown = Processor::Wgpu(Some(99)).open().unwrap_err().to_string();
    assert!(unknown.contains("expected number 99") && listed.iter().all(|one| unknown.contains(&one.to_string())));
    let (opened, _) = Processor::Wgpu(None).adapter().unwrap().unwrap();
    assert!(Processor::Wgpu(Some(opened)).open().is_ok());
    if let Some(other) = (0..listed.len()).find(|number| *number != opened) {
        let rejected = Processor::Wgpu(Some(other)).open().unwrap_err().to_string();
        assert!(rejected.contains("opened before") && rejected.contains(&format!("wgpu:{other}")), "{rejected}");
    }
}

/// Steps of gradient descent as a training run takes them: each step has a network of the new weights, whose forks have separate
/// graphs, and starts the backward pass from a gradient that the host computed.
#[test]
fn a_few_training_steps_on_wgpu_follow_the_cpu() {
    const STEPS: usize = 3;
    let Some(device) = wgpu() else { return };
    let [ours, theirs] = [device, Device::flex()].map(|device| losses(&device.autodiff(), STEPS));
    println!("losses: {ours:?} and {theirs:?}");
    assert!(theirs.is_sorted_by(|before, after| after < before), "it learns: {theirs:?}");
    Tolerance::relative(5e-3).assert(ours, theirs, "loss of each step");
}

fn losses(device: &Device, steps: usize) -> Vec<f64> {
    const RATE: f32 = 0.01;
    let trial = Trial::open("rooms-2v-128");
    let config = ModelConfig::named("nano").unwrap();
    let mut weights = generated(&parameters(&config), 1);
    let template = Network::new(&config, device).unwrap();
    let mut losses = Vec::new();
    for _ in 0..steps {
        let network = template.clone().with_weights(&weights).unwrap();
        let network = network.clone().fork(&network.device());
        let made = network.forward(std::slice::from_ref(&trial.context), 0).unwrap();
        let images = made.gaussians.render(0, &[trial.target], &RenderOptions::default(), None).unwrap();
        let rgb = f32_values(images.rgb.clone());
        let errors: Vec<f32> = rgb.iter().zip(&trial.truth).map(|(ours, truth)| ours - truth).collect();
        let count = errors.len() as f32;
        losses.push(errors.iter().map(|error| f64::from(*error).powi(2)).sum::<f64>() / errors.len() as f64);
        let gradient = errors.iter().map(|error| 2.0 * error / count).collect::<Vec<f32>>();
        let gradient = Tensor::<4>::from_data(TensorData::new(gradient, images.rgb.dims()), &images.rgb.device());
        for (name, gradient) in network.gradients(&(images.rgb * gradient).sum().backward()) {
            let tensor = &mut weights.tensors[&name];
            let moved =
                tensor.to_f32().unwrap().iter().zip(&gradient).map(|(value, by)| value - RATE * by).collect::<Vec<_>>();
            *tensor = StoredTensor::from_f32(tensor.shape().to_vec(), &moved).unwrap();
        }
    }
    losses
}
