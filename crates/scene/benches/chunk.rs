//! Reading a chunk of RE10K's size against reading the same file's bytes.
//!
//! The chunk is written by the project's own writer: 105 MB of incompressible pictures of 20 kB, 279 a
//! scene. Every picture byte is added up, so that nothing stays unread; the plain reads add up theirs too.

use std::fs::File;
use std::hint::black_box;
use std::io::Read;
use std::path::Path;

use atsplat_scene::torch::{Chunk, ChunkScene, ChunkWriter};
use atsplat_scene::{Picture, SharedBytes, Warnings};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const SCENES: usize = 19;
const FRAMES: usize = 279;
const PICTURE_BYTES: usize = 19_800;

fn chunk(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = write_chunk(folder.path());
    let bytes = path.metadata().expect("the chunk").len();
    let mut group = criterion.benchmark_group("chunk");
    group.sample_size(20).throughput(Throughput::Bytes(bytes));
    group.bench_function("scenes and every picture byte", |bencher| bencher.iter(|| sum_of_pictures(black_box(&path))));
    group.bench_function("plain read into one buffer", |bencher| {
        bencher.iter(|| sum(&std::fs::read(black_box(&path)).expect("the chunk")))
    });
    group.bench_function("plain read through 128 kB, as cat", |bencher| {
        bencher.iter(|| sum_by_pieces(black_box(&path)))
    });
    group.bench_function("scene list and cameras only", |bencher| bencher.iter(|| camera_count(black_box(&path))));
    group.finish();
}

fn write_chunk(folder: &Path) -> std::path::PathBuf {
    let mut writer = ChunkWriter::create(folder, u64::MAX).expect("an empty folder");
    let mut state = 1u64;
    for scene in 0..SCENES {
        let images = (0..FRAMES).map(|_| SharedBytes::new(picture(&mut state))).collect();
        let camera = [0.5, 0.9, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3];
        let scene = ChunkScene {
            key: format!("{scene:016x}"),
            url: "https://example.org".to_owned(),
            timestamps: (0..FRAMES as i64).map(|frame| frame * 33_000).collect(),
            cameras: vec![camera; FRAMES],
            images,
        };
        writer.push(scene).expect("a scene");
    }
    writer.finish().expect("a chunk").chunks.remove(0)
}

/// A JPEG's first bytes and noise.
fn picture(state: &mut u64) -> Vec<u8> {
    let mut bytes = b"\xff\xd8\xff\xe0".to_vec();
    while bytes.len() < PICTURE_BYTES {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        bytes.extend_from_slice(&(*state >> 16).to_le_bytes());
    }
    bytes
}

fn sum_of_pictures(path: &Path) -> u64 {
    let chunk = Chunk::open(path, &mut Warnings::new()).expect("a chunk");
    let mut total = 0;
    for key in chunk.keys() {
        for frame in chunk.load(key).expect("a scene").frames {
            if let Picture::Encoded(bytes) = frame.picture {
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

fn sum_by_pieces(path: &Path) -> u64 {
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
