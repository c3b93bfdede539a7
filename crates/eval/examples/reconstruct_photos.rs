//! Reconstructs the first scene of a dataset from two of its frames: `reconstruct_photos DATA WEIGHTS.safetensors OUT.ply`.

#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_eval::reconstruct::{NetworkSource, reconstruct};
use atsplat_model::network::Device;
use atsplat_model::weights::{ModelWeights, TensorFile};
use atsplat_scene::{SceneSource as _, Warnings};
use atsplat_splat::files::{Encoding, Output, write};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [data, weights, out] = arguments.as_slice() else {
        anyhow::bail!("usage: reconstruct_photos DATA WEIGHTS.safetensors OUT.ply")
    };
    let dataset = atsplat_scene::open(data, &mut Warnings::new())?;
    let key = dataset.keys().first().context("the dataset has no scene")?;
    let scene = dataset.load(key, &mut Warnings::new())?;
    let frames = [0, scene.frames.len() / 4];

    let path = PathBuf::from(weights);
    let config = ModelWeights::read(&path)?.config;
    let source = NetworkSource::from_file(config.clone(), path.clone(), TensorFile::open(&path)?, config);
    let (network, _) = source.load(&Device::flex())?;
    let (photos, reconstruction) = reconstruct(&network, scene, &frames, 0)?;

    // From the network's normalised frame into that of the dataset's cameras.
    let gaussians = photos.in_scene(&reconstruction.gaussians)?;
    write(Path::new(out), &gaussians, Output::Ply(Encoding::BinaryLittleEndian))?;
    println!("{key}, frames {frames:?}: {} Gaussians in {out}", gaussians.len());
    Ok(())
}
