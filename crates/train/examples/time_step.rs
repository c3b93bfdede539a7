//! Times parts of a training step on request, so that a script can alternate with another library in one run.
//!
//! Each line on standard input is answered by one line of JSON:
//! - `model`: the network's configuration;
//! - `network SAMPLES`: seconds of the network on samples in parallel: forward, then backward from every set of Gaussians
//!   and every score;
//! - `splatting SAMPLES`: the same for the renderer alone, on the network's Gaussians, to as many targets as in training;
//! - `steps BATCH COUNT`: whole steps; seconds of parts are summed over samples.
//!
//! `time_step EXPERIMENT [WEIGHTS]` takes samples and network of an experiment, with weights from a file or a seed.

use std::error::Error;
use std::io::{BufRead, Write, stdin, stdout};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::time::Instant;

use atsplat_camera::ImageSize;
use atsplat_model::network::{Device, Forward, GaussianTensors, Network};
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile};
use atsplat_scene::Warnings;
use atsplat_splat::{Channels, RenderOptions, StoppedGradients, View};
use atsplat_train::samples::{Sample, SampleId, Source as _};
use atsplat_train::{Event, LossConfig, Parameters, SourceConfig, Start, TrainConfig, Trainer};
use burn::Tensor;
use rayon::prelude::*;
use serde_json::json;

/// The binary's.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1).map(PathBuf::from);
    let config = TrainConfig::read(&args.next().ok_or("usage: time_step EXPERIMENT [WEIGHTS]")?)?;
    let given = args.next().map(|path| TensorFile::open(&path)).transpose()?;
    let start = given.map_or(Start::Fresh, Start::Weights);
    let model = config.model.config()?;
    let weights = match &start {
        Start::Weights(file) => ModelWeights::of_file(file)?.tensors,
        _ => Parameters::fresh(&model, config.seed, StoredTensors::default()).stored()?,
    };
    let network = Network::new(&model, &Device::flex().autodiff())?.with_weights(&weights)?;
    let source = config.samples(&mut Warnings::new())?;
    let sample = |number| source.sample(SampleId { seed: 1, number, step: 0 });
    let splatting = |network: &Network, sample: &Sample| splatting_alone(network, sample, &config.losses);
    for line in stdin().lock().lines() {
        let line = line?;
        let request: Vec<&str> = line.split_whitespace().collect();
        let timed = |count: &str, part: &Part<'_>| -> Result<serde_json::Value, Failure> {
            let samples = (0..count.parse()?).map(sample).collect::<Result<Vec<Sample>, _>>()?;
            in_parallel(&samples, |sample| part(&network, sample))
        };
        let answer = match *request.as_slice() {
            ["model"] => serde_json::to_value(&model)?,
            ["network", count] => timed(count, &network_alone)?,
            ["splatting", count] => timed(count, &splatting)?,
            ["steps", batch, count] => steps(&config, &start, batch.parse()?, count.parse()?)?,
            _ => return Err(format!("{line}: expected model, network N, splatting N or steps N COUNT").into()),
        };
        writeln!(stdout(), "{answer}")?;
        stdout().flush()?;
    }
    Ok(())
}

/// Seconds forward and backward of one sample.
type Part<'a> = dyn Fn(&Network, &Sample) -> Result<[f64; 2], Failure> + Sync + 'a;

fn in_parallel(
    samples: &[Sample],
    part: impl Fn(&Sample) -> Result<[f64; 2], Failure> + Send + Sync,
) -> Result<serde_json::Value, Failure> {
    let start = Instant::now();
    let parts: Vec<[f64; 2]> = samples.par_iter().map(part).collect::<Result<_, _>>()?;
    let total = start.elapsed().as_secs_f64();
    let [forward, backward] = [0, 1].map(|part| parts.iter().map(|parts| parts[part]).sum::<f64>());
    Ok(json!({ "total": total, "forward": forward, "backward": backward }))
}

/// Every set of Gaussians that training renders, the final one first; intermediate ones with the scores of the next block.
fn sets(network: &Network, made: &Forward) -> Vec<(GaussianTensors, Option<Tensor<2>>)> {
    let mut sets = vec![(made.gaussians.clone(), None)];
    for pair in made.blocks.windows(2) {
        let scores = pair[1].expanded.as_ref().and_then(|expanded| expanded.scores.clone());
        sets.push((network.gaussians(&pair[0].tokens), scores));
    }
    sets
}

fn network_alone(network: &Network, sample: &Sample) -> Result<[f64; 2], Failure> {
    let start = Instant::now();
    let made = network.forward(&[sample.context.views()?], 0)?;
    let sets = sets(network, &made);
    let forward = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let sums = sets.into_iter().flat_map(|(gaussians, scores)| {
        let GaussianTensors { means, quaternions, log_scales, opacity_logits, sh, .. } = gaussians;
        let flat = [means, quaternions, log_scales, sh].map(Tensor::sum);
        flat.into_iter().chain([opacity_logits.sum()]).chain(scores.map(Tensor::sum))
    });
    let sum = sums.reduce(|a, b| a + b).ok_or("no Gaussians")?;
    let gradient = network.flat_gradient(&sum.backward());
    if gradient.dims() == [0] {
        return Err("no gradients".into());
    }
    Ok([forward, start.elapsed().as_secs_f64()])
}

fn splatting_alone(network: &Network, sample: &Sample, losses: &LossConfig) -> Result<[f64; 2], Failure> {
    let all = sample.targets.cameras.len();
    let intermediate = losses.intermediate_targets.map_or(all, |most| most.get().min(all));
    let made = network.forward(&[sample.context.views()?], 0)?;
    let mut seconds = [0.0, 0.0];
    for (at, (gaussians, scores)) in sets(network, &made).into_iter().enumerate() {
        let leaf = |tensor: Tensor<3>| tensor.detach().require_grad();
        let gaussians = GaussianTensors {
            means: leaf(gaussians.means),
            quaternions: leaf(gaussians.quaternions),
            log_scales: leaf(gaussians.log_scales),
            opacity_logits: gaussians.opacity_logits.detach().require_grad(),
            sh: leaf(gaussians.sh),
            sh_degree: gaussians.sh_degree,
        };
        let [_, count, _] = gaussians.means.dims();
        let scalars = scores.map(|scores| {
            let [_, tokens] = scores.dims();
            let scores = scores.detach().require_grad();
            scores.unsqueeze_dim::<3>(2).repeat_dim(2, count / tokens.max(1)).reshape([count])
        });
        let options = RenderOptions {
            channels: Channels { scalar: scalars.is_some(), ..Channels::default() },
            gradients: StoppedGradients { scalar_stops: true, ..StoppedGradients::default() },
            ..RenderOptions::default()
        };
        let side = |side: usize| u32::try_from(side);
        let size = ImageSize { width: side(sample.targets.size.width)?, height: side(sample.targets.size.height)? };
        let targets = sample.targets.cameras.iter().take(if at == 0 { all } else { intermediate });
        let views: Vec<View> = targets.map(|&camera| View { camera, size }).collect();
        let start = Instant::now();
        let images = gaussians.render(0, &views, &options, scalars)?;
        seconds[0] += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let sum = images.rgb.sum() + images.scalar.map_or_else(|| images.alpha.sum() * 0.0, Tensor::sum);
        let gradients = sum.backward();
        if gaussians.means.grad(&gradients).is_none() {
            return Err("no gradients".into());
        }
        seconds[1] += start.elapsed().as_secs_f64();
    }
    Ok(seconds)
}

/// With one scene, so that its clip is cached after the first steps, as in a long run.
fn steps(config: &TrainConfig, start: &Start, batch: NonZeroUsize, count: u64) -> Result<serde_json::Value, Failure> {
    let folder = tempfile::tempdir()?;
    let mut config = TrainConfig { batch, evaluation: None, ..config.clone() };
    for data in &mut config.data {
        if let SourceConfig::Rooms(rooms) = &mut data.source {
            rooms.scenes = NonZeroU32::MIN;
        }
    }
    let mut trainer = Trainer::new(config, folder.path(), start)?;
    let mut records = Vec::new();
    for _ in 0..count {
        trainer.step(&mut |event| {
            if let Event::Step(record) = event {
                records.push((*record).clone());
            }
        })?;
    }
    Ok(serde_json::to_value(&records)?)
}
