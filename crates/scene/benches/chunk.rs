//! Reads a chunk of RE10K's size, compared with reading the same file's bytes.
//!
//! The chunk is written by [`ChunkWriter`]: 105 MB of incompressible images of 20 kB, 279 per scene. All cases sum
//! every image byte, so that nothing stays unread.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

use std::fs::File;
use std::hint::black_box;
use std::io::Read;
use std::path::Path;

use atsplat_numeric::SplitMix64;
use atsplat_scene::torch::{Chunk, ChunkScene, ChunkWriter};
use atsplat_scene::{FrameImage, SharedBytes, Warnings};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const SCENES: usize = 19;
const FRAMES: usize = 279;
const IMAGE_BYTES: usize = 19_800;

fn chunk(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = write_chunk(folder.path());
    let bytes = path.metadata().expect("the chunk").len();
    let mut group = criterion.benchmark_group("chunk");
    group.sample_size(20).throughput(Throughput::Bytes(bytes));
    group.bench_function("scenes and every image byte", |bencher| bencher.iter(|| sum_of_images(black_box(&path))));
    group.bench_function("plain read into one buffer", |bencher| {
        bencher.iter(|| sum(&std::fs::read(black_box(&path)).expect("the chunk")));
    });
    group.bench_function("plain read in blocks of 128 kB, like cat", |bencher| {
        bencher.iter(|| sum_in_blocks(black_box(&path)));
    });
    group.bench_function("scene list and cameras only", |bencher| bencher.iter(|| camera_count(black_box(&path))));
    group.finish();
}

fn write_chunk(folder: &Path) -> std::path::PathBuf {
    let mut writer = ChunkWriter::create(folder, u64::MAX).expect("an empty folder");
    let mut random = SplitMix64::new(1);
    for scene in 0..SCENES {
        let images = (0..FRAMES).map(|_| SharedBytes::new(image(&mut random))).collect();
        let camera = [0.5, 0.9, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3];
        let scene = ChunkScene {
            key: format!("{scene:016x}"),
            url: "https://example.org".to_owned(),
            timestamps: (0i64..).step_by(33_000).take(FRAMES).collect(),
            cameras: vec![camera; FRAMES],
            images,
        };
        writer.push(scene).expect("a scene");
    }
    writer.finish().expect("a chunk").chunks.remove(0)
}

/// A JPEG's first bytes, then noise.
fn image(random: &mut SplitMix64) -> Vec<u8> {
    let mut bytes = b"\xff\xd8\xff\xe0".to_vec();
    while bytes.len() < IMAGE_BYTES {
        bytes.extend_from_slice(&random.next_u64().to_le_bytes());
    }
    bytes
}

fn sum_of_images(path: &Path) -> u64 {
    let chunk = Chunk::open(path, &mut Warnings::new()).expect("a chunk");
    let mut total = 0;
    for key in chunk.keys() {
        for frame in chunk.load(key).expect("a scene").frames {
            if let FrameImage::Encoded(bytes) = frame.image {
                total += sum(&bytes);
            }
        }
    }
    total
}

fn camera_count(path: &Path) -> usize {
    let chunk = Chunk::open(path, &mut Warnings::new()).expect("a chunk");
    chunk.keys().iter().map(|key| chunk.load(key).expect("a scene").frames.len()).sum()
}

fn sum_in_blocks(path: &Path) -> u64 {
    let mut file = File::open(path).expect("the chunk");
    let mut buffer = vec![0; 128 << 10];
    let mut total = 0;
    loop {
        match file.read(&mut buffer).expect("bytes") {
            0 => return total,
            len => total += sum(&buffer[..len]),
        }
    }
}

fn sum(bytes: &[u8]) -> u64 {
    bytes.iter().map(|&byte| u64::from(byte)).sum()
}

criterion_group!(benches, chunk);
criterion_main!(benches);
