use std::path::Path;

use atsplat_files::FileError;
use atsplat_scene::Scene;
use atsplat_scene::re10k::{Trajectory, TrajectoryRow, write_trajectory};

use super::{ImageEncoding, encoded, make_folder, write_file};
use crate::{RoomsError, Split};

/// Writes `<split>/<key>.txt`, and images named by their timestamps in `<split>/<key>/`. The scene has no lens.
#[expect(clippy::expect_used, reason = "every simulated frame has a timestamp")]
pub(super) fn write(folder: &Path, split: Split, scene: &Scene, encoding: ImageEncoding) -> Result<(), RoomsError> {
    let folder = folder.join(split.to_string());
    let images = folder.join(&scene.key);
    make_folder(&images)?;
    for frame in &scene.frames {
        write_file(&images.join(format!("{}.{}", frame.name, encoding.extension())), encoded(frame))?;
    }
    let rows = scene.frames.iter().map(|frame| TrajectoryRow {
        timestamp_micros: frame.timestamp_micros.expect("a timestamp"),
        intrinsics: frame.camera.intrinsics,
        radial: [0.0; 2],
        camera_from_world: frame.camera.camera_from_world,
    });
    let header = Some(format!("# simulated by {}: {}", env!("CARGO_PKG_NAME"), scene.key));
    let trajectory = Trajectory { header, rows: rows.collect() };
    let path = folder.join(format!("{}.txt", scene.key));
    let mut text = Vec::new();
    let written = write_trajectory(&trajectory, &mut text);
    written.map_err(FileError::during::<RoomsError>("writing a trajectory", &path))?;
    write_file(&path, &text)
}
