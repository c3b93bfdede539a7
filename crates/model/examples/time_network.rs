//! Times whole networks on request, so that a script can alternate with another library in one run.
//!
//! Each line on standard input is `NAME VIEWS HEIGHT WIDTH`, a built-in model and its input; it is answered by one line of
//! JSON with tokens, Gaussians, seconds of each stage, estimated memory, and the peak memory of the process so far.
//! `time_network [PROCESSOR]`: `cpu`, or `wgpu` and `wgpu:N` with the feature `gpu-network`.

use std::collections::BTreeMap;
use std::error::Error;
use std::io::{BufRead, Write, stdin, stdout};

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::network::{Device, Network, Processor, Reconstruction, Views};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::generated;
use atsplat_model::{ImageSize, ModelConfig};
use glam::{DMat3, DVec3};
use serde_json::json;

fn main() -> Result<(), Box<dyn Error>> {
    let processor: Processor = std::env::args().nth(1).map_or(Ok(Processor::Cpu), |name| name.parse())?;
    let device = processor.open()?;
    let mut networks = BTreeMap::new();
    for line in stdin().lock().lines() {
        let line = line?;
        let request: Vec<&str> = line.split_whitespace().collect();
        let [name, count, height, width] = *request.as_slice() else {
            return Err("expected NAME VIEWS HEIGHT WIDTH".into());
        };
        let views = views(count.parse()?, ImageSize::new(height.parse()?, width.parse()?))?;
        if !networks.contains_key(name) {
            networks.insert(name.to_owned(), network(name, &device)?);
        }
        if let Some(network) = networks.get(name) {
            writeln!(stdout(), "{}", report(&network.reconstruct(&views, 0)?))?;
            stdout().flush()?;
        }
    }
    Ok(())
}

fn network(name: &str, device: &Device) -> Result<Network, Box<dyn Error>> {
    let config = ModelConfig::named(name)?;
    let weights = generated(&parameters(&config), 1);
    Ok(Network::new(&config, device)?.with_weights(&weights)?)
}

/// Smooth images, and cameras along a line that look in one direction.
fn views(count: usize, size: ImageSize) -> Result<Views, Box<dyn Error>> {
    let pixels = count * size.height * size.width * 3;
    let images = (0..pixels).map(|at| (at % 251) as f32 / 250.0).collect();
    let camera = |view: usize| {
        let pose = WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(0.2 * view as f64, 0.0, 0.0))?;
        Ok(Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5)?))
    };
    let cameras: Result<Vec<Camera>, Box<dyn Error>> = (0..count).map(camera).collect();
    Ok(Views::new(size, images, cameras?)?)
}

fn report(made: &Reconstruction) -> serde_json::Value {
    json!({
        "initial_tokens": made.budget.initial_tokens,
        "tokens": made.budget.tokens,
        "final_tokens": made.budget.final_tokens,
        "gaussians": made.budget.gaussians,
        "seconds": made.seconds,
        "total": made.seconds.total(),
        "estimated_bytes": made.memory.peak_bytes(),
        "peak_kilobytes": peak_kilobytes(),
    })
}

/// Peak resident memory of this process, as counted by Linux.
fn peak_kilobytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok()
}
