//! Reading, hashing, linting and writing an index of the size of pixelSplat's RE10K file: 7194 keys, a tenth of
//! them null, 3 targets each.

use std::hint::black_box;

use atsplat_protocol::{IndexFile, LintOptions, lint_file};
use atsplat_scene::Warnings;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

const KEYS: u64 = 7194;

/// Scene keys and frame numbers as long as the real ones; about 456 KB.
fn index_text() -> String {
    let scene = |at: u64| {
        let key = at.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let first = key % 180;
        let entry = if at % 10 == 9 {
            "null".to_owned()
        } else {
            format!(
                "{{\"context\": [{first}, {}], \"target\": [{}, {}, {}]}}",
                first + 66,
                first + 7,
                first + 23,
                first + 51
            )
        };
        format!("\"{key:016x}\": {entry}")
    };
    format!("{{{}}}", (0..KEYS).map(scene).collect::<Vec<_>>().join(", "))
}

fn index(c: &mut Criterion) {
    let text = index_text();
    let Ok(file) = IndexFile::parse(text.as_bytes()) else { return };
    let mut group = c.benchmark_group("index of 7194 keys");
    group.throughput(Throughput::Bytes(text.len() as u64));
    group.bench_function("parse and sha256", |b| b.iter(|| IndexFile::parse(black_box(text.as_bytes()))));
    group.bench_function("content hash", |b| b.iter(|| black_box(&file.index).content_hash()));
    group.bench_function("lint", |b| {
        b.iter(|| lint_file(black_box(&file), &LintOptions::default(), &mut Warnings::new()));
    });
    group.bench_function("write", |b| b.iter(|| black_box(&file.index).to_json(&file.layout)));
    group.finish();
}

criterion_group!(benches, index);
criterion_main!(benches);
