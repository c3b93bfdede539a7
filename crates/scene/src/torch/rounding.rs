//! What rounding to f32 does to the cameras of a scene: a chunk stores `[R | t]`, and the centre `−Rᵀt` of a camera far from
//! the origin moves by the rounding of `t`, however near the cameras are to each other.

use atsplat_camera::CameraFromWorld;
use atsplat_numeric::median;
use atsplat_pickle::shortened;
use glam::DVec3;

use super::{ChunkScene, TorchError};

/// How far rounding may move a centre, as a share of the median distance between consecutive cameras. Published scenes are
/// below 1e-4.
const LOST_SHARE: f64 = 0.01;

/// How far rounding may move a centre in any scene, in its units: centres within 10 units of the origin always fit, also those of a
/// tripod whose poses have six decimals.
const ALWAYS_KEPT: f64 = 1e-6;

/// Distance up to which consecutive cameras are taken to stand still: nine decimals of a text file, and rounding of f64 far from
/// the origin.
const STILL: f64 = 1e-9;
const STILL_SHARE: f64 = 1e-12;

/// An error if a camera, read again from its row in f32, is elsewhere by more than a share of the distance between cameras.
///
/// Cameras that all stand still have no such distance, and pass.
pub(super) fn require_kept_trajectory(scene: &ChunkScene) -> Result<(), TorchError> {
    let centres: Vec<Option<DVec3>> = scene.cameras.iter().map(centre).collect();
    let farthest = centres.iter().flatten().map(|centre| centre.abs().max_element()).fold(0.0, larger);
    let distance = |pair: &[Option<DVec3>]| match pair {
        [Some(a), Some(b)] => Some(a.distance(*b)),
        _ => None,
    };
    let still = STILL + STILL_SHARE * farthest;
    let moved = centres.windows(2).filter_map(distance).filter(|distance| *distance > still);
    let Some(step) = median(moved) else { return Ok(()) };
    let limit = larger(LOST_SHARE * step, ALWAYS_KEPT);
    for (frame, (row, centre)) in scene.cameras.iter().zip(&centres).enumerate() {
        let rounded = self::centre(&row.map(rounded));
        let shift = centre.zip(rounded).map_or(0.0, |(centre, rounded)| centre.distance(rounded));
        if shift > limit {
            let location = format!("scene {:?}, frame {frame}", shortened(&scene.key));
            let expected = format!(
                "a camera whose centre f32, in which chunks store it, moves by at most {LOST_SHARE} of the median distance \
                 between consecutive frames ({step:.3e})"
            );
            let found = format!(
                "that it moves by {shift:.3e}, because coordinates are as large as {farthest:.3e}: shift the capture's \
                 origin to its cameras"
            );
            return Err(TorchError::malformed(location, expected, found));
        }
    }
    Ok(())
}

/// The centre of a row's camera; `None` if it is none, which is reported where it is read.
fn centre([_, _, _, _, _, _, pose @ ..]: &[f64; 18]) -> Option<DVec3> {
    CameraFromWorld::from_rows(pose).ok().map(|pose| pose.inverse().centre()).filter(|centre| centre.is_finite())
}

#[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
fn rounded(number: f64) -> f64 {
    f64::from(number as f32)
}

fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::SharedBytes;

    /// Cameras at `origin + offset`, each turned a little further.
    fn outcome(origin: [f64; 3], offsets: impl IntoIterator<Item = f64>) -> Result<(), String> {
        let row = |(at, offset): (usize, f64)| {
            let rotation = DMat3::from_rotation_y(0.3 + 0.01 * at as f64) * DMat3::from_rotation_x(0.4);
            let centre = DVec3::from_array(origin) + DVec3::new(offset, 0.2 * offset, -0.1 * offset);
            let (r, t) = (rotation.transpose(), rotation * -centre);
            let [x, y, z] = [r.x_axis, r.y_axis, r.z_axis];
            let pose = [x.x, x.y, x.z, t.x, y.x, y.y, y.z, t.y, z.x, z.y, z.z, t.z];
            let mut row = [0.5, 0.9, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            row[6..].copy_from_slice(&pose);
            row
        };
        let cameras: Vec<_> = offsets.into_iter().enumerate().map(row).collect();
        let (timestamps, images) = (vec![0; cameras.len()], vec![SharedBytes::new(Vec::new()); cameras.len()]);
        let scene = ChunkScene { key: "s".to_owned(), url: String::new(), timestamps, cameras, images };
        require_kept_trajectory(&scene).map_err(|error| error.to_string())
    }

    fn walk(step: f64) -> impl Iterator<Item = f64> {
        (0..12).map(move |at| step * f64::from(at))
    }

    const UTM: [f64; 3] = [4e5, 5.4e6, 120.0];

    #[test]
    fn a_walk_in_georeferenced_coordinates_is_lost_in_f32() {
        for step in [0.0132, 1.0] {
            let error = outcome(UTM, walk(step)).unwrap_err();
            assert!(
                error.contains("scene \"s\", frame 0: expected") && error.contains("as large as 5.400e6"),
                "{error}"
            );
            assert!(error.contains("shift the capture's origin"), "{error}");
        }
        assert_eq!(outcome(UTM, walk(200.0)), Ok(()), "an aeroplane");
        let near = outcome(UTM, walk(0.0132).chain([0.0; 20])).unwrap_err();
        assert!(near.contains("(1.3"), "frames that stand still have no distance: {near}");
    }

    #[test]
    fn usual_scenes_and_tripods_are_stored() {
        for scale in [1e-4, 1.0, 1e6] {
            let origin = [3.0, -2.0, 7.0].map(|x| scale * x);
            assert_eq!(outcome(origin, walk(0.01 * scale)), Ok(()), "in another unit");
        }
        for origin in [[0.0; 3], [3.0, -2.0, 7.0], UTM] {
            assert_eq!(outcome(origin, [0.0; 12]), Ok(()), "a tripod");
        }
        assert_eq!(
            outcome([3.0, -2.0, 1.0], (0..12).map(|at| 1e-6 * f64::from(at % 3))),
            Ok(()),
            "rounded to six decimals"
        );
        assert_eq!((outcome(UTM, [5.0]), outcome(UTM, [])), (Ok(()), Ok(())), "one frame");
    }
}
