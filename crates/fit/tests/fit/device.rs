//! Fits on a graphics adapter against those on the CPU.

#![expect(clippy::panic, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use atsplat_fit::{Fit, FitConfig, FitDevice, FitError, StopReason, Strategy};
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::{
    AdapterChoice, GpuError, GpuOptions, GpuRenderer, SelfTestKey, SelfTestObserver, SelfTestResult,
};
use atsplat_splat::{Gaussians, RendererConstants};
use atsplat_tests::skip_without_graphics;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

use crate::common::{self, held_out, run, views};

/// The tests of atsplat-splat run its self-test.
struct Trusting;

impl SelfTestObserver for Trusting {
    fn cached(&self, _key: &SelfTestKey) -> Option<SelfTestResult> {
        Some(SelfTestResult { fault: None })
    }
}

type Shared = Arc<Mutex<Box<dyn atsplat_splat::Renderer>>>;

/// A separate renderer; `None` if there is no adapter and none is required.
fn open() -> Option<(Shared, FitDevice)> {
    match GpuRenderer::observed(&AdapterChoice::Automatic, GpuOptions::default(), &Trusting) {
        Ok(renderer) => {
            let name = renderer.adapter().to_owned();
            let shared: Shared = Arc::new(Mutex::new(Box::new(renderer)));
            Some((Arc::clone(&shared), FitDevice::adapter(shared, name).unwrap()))
        }
        Err(error @ GpuError::NoAdapter { .. }) => {
            skip_without_graphics("fit device", error);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// The renderer of all tests that leave it whole.
fn device() -> Option<FitDevice> {
    static SHARED: OnceLock<Option<FitDevice>> = OnceLock::new();
    SHARED.get_or_init(|| open().map(|(_, device)| device)).clone()
}

/// Without the threshold of alpha, which rounding could cross.
fn config(strategy: Strategy, steps: u64) -> FitConfig {
    let constants = RendererConstants { min_alpha: 1e-5, ..RendererConstants::default() };
    FitConfig { constants, ..common::config(strategy, steps) }
}

/// Ellipsoids in every direction, so that their rotations have gradients.
fn start(strategy: Strategy) -> Gaussians {
    let mut parts = common::start(strategy, 120).into_parts();
    for (number, (quaternion, scales)) in (0u8..).zip(parts.quaternions.iter_mut().zip(&mut parts.log_scales)) {
        let angle = f32::from(number);
        *quaternion = [1.0, angle.sin(), (2.0 * angle).sin(), (3.0 * angle).sin()];
        *scales = [scales[0] + 0.4, scales[1], scales[2] - 0.7];
    }
    Gaussians::new(parts).unwrap()
}

fn fit(config: &FitConfig, device: &FitDevice) -> Fit {
    Fit::new(config.clone(), views().0, &start(config.strategy)).unwrap().on(device.clone())
}

/// Parameters, Adam's moments and what density control remembers, by name.
fn state(fit: &Fit) -> BTreeMap<String, Vec<f64>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    fit.checkpoint(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let values = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|word| f64::from(f32::from_le_bytes(*word))).collect();
    let tensors = SafeTensors::deserialize(&bytes).unwrap().tensors();
    let state = tensors.into_iter().filter(|(_, tensor)| tensor.dtype() == Dtype::F32);
    state.map(|(name, tensor)| (name, values(tensor.data()))).collect()
}

/// Adam's first moments after one step are a tenth of the gradients.
#[test]
fn each_strategy_on_a_device_follows_the_cpu() {
    let Some(device) = device() else { return };
    let cpu = FitDevice::default();
    let absolute = FitConfig { absolute_gradients: true, ..config(Strategy::Gaussians3d, 400) };
    let strategies = [Strategy::Gaussians3d, Strategy::MipSplatting, Strategy::Mcmc, Strategy::Fixed];
    for config in strategies.map(|strategy| config(strategy, 400)).into_iter().chain([absolute]) {
        let what = format!("{}, absolute gradients {}", config.strategy.name(), config.absolute_gradients);
        let [mut expected, mut found] = [&cpu, &device].map(|device| fit(&config, device));
        let [first, on_device] = [&mut expected, &mut found].map(|fit| fit.step().unwrap());
        assert_eq!(on_device.view, first.view, "{what}");
        let within = Tolerance { absolute: 0.0, relative: 1e-5 };
        within.assert([on_device.terms.total], [first.terms.total], &format!("{what}: loss"));
        let (expected_state, found_state) = (state(&expected), state(&found));
        let mut again = fit(&config, &device);
        run(&mut again, 1);
        assert!(state(&again) == found_state, "{what}: not the same bits twice");
        let remembered = expected_state.keys().filter(|name| name.starts_with("memory/")).count();
        let adaptive = matches!(config.strategy, Strategy::Gaussians3d | Strategy::MipSplatting);
        assert_eq!(remembered, if adaptive { 2 } else { 0 }, "{what}");
        for (name, values) in &expected_state {
            let share = if name == "memory/gradient-counts" { 0.0 } else { 1e-4 };
            let is_gradient = name.starts_with("first-moment/") || name.starts_with("memory/");
            if is_gradient {
                assert!(values.iter().any(|value| value.abs() > 0.0), "{what}: {name} is zero everywhere");
                Tolerance::of_largest(share, values.iter().copied()).assert(
                    found_state[name].iter().copied(),
                    values.iter().copied(),
                    &format!("{what}: {name}"),
                );
            }
        }
        run(&mut expected, 29);
        run(&mut found, 29);
        let [on_cpu, on_device] = [held_out(&mut expected), held_out(&mut found)];
        Tolerance::absolute(0.05).assert([on_device], [on_cpu], &format!("{what}: held-out PSNR after 30 steps"));
    }
}

#[test]
fn a_step_copies_the_gaussians_to_the_device_once() {
    let Some((renderer, device)) = open() else { return };
    let mut copied = |count| {
        let config = config(Strategy::Fixed, 1);
        let mut fit = Fit::new(config.clone(), views().0, &common::start(config.strategy, count)).unwrap();
        fit = fit.on(device.clone());
        let gaussians = fit.gaussians();
        let numbers = 11 * gaussians.len() + gaussians.parts().sh.as_flattened().len();
        let counts = || renderer.lock().unwrap().on_adapter().unwrap().counts();
        let before = counts();
        fit.step().unwrap();
        ((counts() - before).bytes_up as f64, (4 * numbers) as f64)
    };
    let [(fewer, fewer_bytes), (more, more_bytes)] = [1000, 3000].map(&mut copied);
    Tolerance::absolute(0.1).assert([(more - fewer) / (more_bytes - fewer_bytes)], [1.0], "copies of the Gaussians");
}

/// Just before and after density control, which adds and removes Gaussians.
#[test]
fn a_run_on_a_device_resumes_to_the_same_bits() {
    let Some(device) = device() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let config = config(Strategy::MipSplatting, 400);
    let mut whole = fit(&config, &device);
    run(&mut whole, 98);
    whole.checkpoint(&path).unwrap();
    run(&mut whole, 4);
    assert_ne!(whole.len(), 120);
    let mut resumed = Fit::resume(config.clone(), views().0, &[], &start(config.strategy), device, &path).unwrap();
    run(&mut resumed, 4);
    assert!(state(&resumed) == state(&whole));
}

#[test]
fn a_checkpoint_of_another_device_is_refused() {
    let Some(device) = device() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    let config = config(Strategy::Fixed, 3);
    let cpu = FitDevice::default();
    for (written, other) in [(&cpu, &device), (&device, &cpu)] {
        fit(&config, written).checkpoint(&path).unwrap();
        let begin = start(config.strategy);
        let refused = Fit::resume(config.clone(), views().0, &[], &begin, other.clone(), &path);
        let refused = refused.unwrap_err().to_string();
        let expected = format!("checkpoint: device: expected {}, found {} (", other.name(), written.name());
        assert!(refused.starts_with(&expected), "{refused}");
    }
    assert_eq!(cpu.name(), "cpu");
    let of_cpu: Shared = Arc::new(Mutex::new(Box::<CpuRenderer>::default()));
    assert!(FitDevice::adapter(of_cpu, "none".to_owned()).is_none());
}

#[test]
fn a_lost_device_stops_with_the_last_good_state() {
    let Some((renderer, device)) = open() else { return };
    let mut fit = fit(&config(Strategy::Gaussians3d, 9), &device);
    run(&mut fit, 2);
    let before = state(&fit);
    renderer.lock().unwrap_or_else(PoisonError::into_inner).on_adapter().unwrap().device().destroy();
    let FitError::Stopped(diagnosis) = fit.step().unwrap_err() else { panic!("another error") };
    assert!(matches!(diagnosis.reason, StopReason::Device(_)) && diagnosis.step == 3, "{diagnosis}");
    assert!(diagnosis.to_string().contains(device.name()), "{diagnosis}");
    assert!((fit.step_count(), &state(&fit)) == (2, &before));
}
