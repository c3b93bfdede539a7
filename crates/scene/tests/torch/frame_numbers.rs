//! Chunks of captures have the numbers of frames in place of timestamps, and the cameras of a rig share them.

use std::fs;

use crate::chunks::{KEYS, open, write};
use crate::support::fixture;
use atsplat_scene::camera_file::{self, LensOfPoses};
use atsplat_scene::export::{ExportFormat, export};
use atsplat_scene::inspect::{InspectOptions, SizeSampling, inspect};
use atsplat_scene::torch::{Chunk, ChunkScene, ChunkWriter};
use atsplat_scene::{Format, WarningKind, Warnings};

/// The times of a scene with these timestamps, two of which are the same, and whether an inspection calls it complete.
fn found(timestamps: [i64; 3]) -> (Vec<Option<i64>>, bool) {
    let chunk = Chunk::open(fixture("zip.torch"), &mut Warnings::new()).unwrap();
    let scene = ChunkScene { timestamps: timestamps.to_vec(), ..chunk.record(KEYS[0]).unwrap() };
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), ChunkWriter::TARGET_BYTES, vec![scene]);
    let (source, mut warnings) = open(folder.path());
    let source = source.unwrap();
    let options = InspectOptions { sizes: SizeSampling::PerScene(0), per_scene: false };
    let report = inspect(&source, Format::TorchChunks, &options, &mut warnings, &|| ());
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::DuplicateTimestamp, 1)]);

    let cameras = camera_file::read(folder.path(), None, LensOfPoses::default(), &mut Warnings::new()).unwrap();
    let times: Vec<Option<i64>> = cameras.iter().map(|camera| camera.timestamp_micros).collect();
    let table = folder.path().join("cameras.csv");
    export(&source, &table, ExportFormat::Csv, &mut Warnings::new(), &|| ()).unwrap();
    let rows = fs::read_to_string(table).unwrap();
    let exported = rows.lines().skip(1).map(|row| row.split(',').nth(4).unwrap().parse::<i64>().ok());
    assert_eq!(exported.collect::<Vec<_>>(), times, "{rows}");
    (times, report.is_complete())
}

#[test]
fn numbers_of_frames_are_no_times_and_may_repeat() {
    assert_eq!(found([1, 1, 2]), (vec![None; 3], true));
    assert_eq!(found([0, 40_000, 40_000]), (vec![Some(0), Some(40_000), Some(40_000)], false));
}
