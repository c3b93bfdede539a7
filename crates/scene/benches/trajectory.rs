//! Reads RE10K trajectories: the text of one file on one core, and a folder of ten thousand files on all cores.

#![expect(clippy::unwrap_used, reason = "a benchmark stops at the first error")]

use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use atsplat_scene::re10k::{Re10kOptions, Re10kScenes, parse_trajectory};
use atsplat_scene::{SceneSource, Warnings, load_scenes};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const ROWS: u32 = 150;
const FILES: usize = 10_000;

/// A clip as RE10K writes it: nine decimals, a camera that turns as it moves. `seed` changes every pose.
fn text(seed: u32) -> String {
    let mut text = format!("https://www.youtube.com/watch?v={seed:011}\n");
    for row in 0..ROWS {
        let angle = f64::from(row) * 0.003 + f64::from(seed) * 1e-4;
        let (sin, cos) = angle.sin_cos();
        write!(
            text,
            "{} 0.482334223 0.857483078 0.500000000 0.500000000 0.000000000 0.000000000",
            45_979_267 + row * 33_366
        )
        .unwrap();
        for number in [cos, 0.0, sin, angle * 0.7, 0.0, 1.0, 0.0, -angle, -sin, 0.0, cos, angle * 1.9 - 0.3] {
            write!(text, " {number:.9}").unwrap();
        }
        text.push('\n');
    }
    text
}

fn one_file(criterion: &mut Criterion) {
    let text = text(7);
    let mut group = criterion.benchmark_group("trajectory text");
    group.throughput(Throughput::Bytes(text.len() as u64));
    group.bench_function("parse 150 rows", |bencher| {
        bencher.iter(|| parse_trajectory(black_box(text.as_bytes()), Path::new("clip.txt")).unwrap());
    });
    group.finish();
}

fn ten_thousand_files(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = 0;
    for file in 0..FILES {
        let text = text(u32::try_from(file).unwrap());
        bytes += text.len() as u64;
        std::fs::write(folder.path().join(format!("{file:016x}.txt")), text).unwrap();
    }
    let mut group = criterion.benchmark_group("trajectory folder");
    group.sample_size(10).measurement_time(Duration::from_secs(30)).throughput(Throughput::Bytes(bytes));
    group.bench_function("open and load 10000 files of 150 rows", |bencher| {
        bencher.iter(|| {
            let mut warnings = Warnings::new();
            let source = Re10kScenes::open(folder.path(), Re10kOptions::default(), &mut warnings).unwrap();
            let mut frames = 0;
            for keys in source.keys().chunks(1000) {
                let scenes = load_scenes(&source, keys, &mut warnings, &|_| ());
                frames += scenes.iter().map(|scene| scene.frames.len()).sum::<usize>();
            }
            assert_eq!((frames, warnings.total()), (FILES * ROWS as usize, 0));
        });
    });
    group.finish();
}

criterion_group!(benches, one_file, ten_thousand_files);
criterion_main!(benches);
