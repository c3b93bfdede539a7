//! Inspects and exports a dataset of RE10K's size: 10 000 scenes of 150 frames, generated in memory. `load` is the cost
//! of generating the scenes; subtract it from the others to get the cost of inspection and export.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

use std::hint::black_box;
use std::path::PathBuf;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_scene::export::{ExportFormat, export};
use atsplat_scene::inspect::{InspectOptions, inspect};
use atsplat_scene::{Format, Frame, FrameImage, Scene, SceneError, SceneSource, Warnings};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

const SCENES: usize = 10_000;
const FRAMES: u32 = 150;

struct Trajectories {
    keys: Vec<String>,
}

impl SceneSource for Trajectories {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _: &mut Warnings) -> Result<Scene, SceneError> {
        let invalid = |source| SceneError::Camera { path: PathBuf::from("memory"), location: key.to_owned(), source };
        let seed = key.bytes().fold(1.0, |seed: f64, byte| (seed * 1.7 + f64::from(byte)) % 10.0);
        let frame = |position: u32| {
            let step = seed + f64::from(position) * 0.03;
            let rotation = DMat3::from_rotation_y(0.3 * step.sin()) * DMat3::from_rotation_x(0.1 * step.cos());
            let pose = WorldFromCamera::new(rotation, DVec3::new(step.sin(), 0.1 * step, step)).map_err(invalid)?;
            let intrinsics = NormalizedIntrinsics::new(0.48 + 0.01 * seed, 0.86, 0.5, 0.5).map_err(invalid)?;
            let timestamp = i64::from(position) * 33_367;
            Ok(Frame {
                name: timestamp.to_string(),
                timestamp_micros: Some(timestamp),
                camera: Camera::pinhole(pose.inverse(), intrinsics),
                stated_size: None,
                image: FrameImage::Absent,
            })
        };
        let frames = (0..FRAMES).map(frame).collect::<Result<_, SceneError>>()?;
        Ok(Scene { key: key.to_owned(), url: Some(format!("https://www.youtube.com/watch?v={key}")), frames })
    }
}

fn dataset_of_re10k_size(c: &mut Criterion) {
    let source = Trajectories { keys: (0..SCENES).map(|n| format!("{:016x}", n * 0x9e37_79b9)).collect() };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut group = c.benchmark_group("10 000 scenes of 150 frames");
    group.sample_size(10);
    group.bench_function("load", |b| {
        b.iter(|| {
            let load = |key: &String| source.load(key, &mut Warnings::new()).map_or(0, |scene| scene.frames.len());
            black_box(source.keys.par_iter().map(load).sum::<usize>())
        });
    });
    group.bench_function("inspect", |b| {
        b.iter(|| inspect(&source, Format::Re10k, &InspectOptions::default(), &mut Warnings::new(), &|| {}));
    });
    for format in [ExportFormat::Parquet, ExportFormat::ArrowIpc, ExportFormat::Csv] {
        group.bench_function(format!("export {format:?}"), |b| {
            let path = folder.path().join("cameras");
            b.iter(|| export(&source, &path, format, &mut Warnings::new(), &|| {}));
        });
    }
    group.finish();
}

criterion_group!(benches, dataset_of_re10k_size);
criterion_main!(benches);
