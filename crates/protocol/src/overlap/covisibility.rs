use atsplat_camera::{Camera, ImageSize};
use glam::DVec3;

use crate::ProtocolError;

/// Depth along a camera's z axis, one value per pixel, in scene units. Zero, negative and non-finite values
/// mean unknown depth.
#[derive(Clone, Copy, Debug)]
pub struct DepthMap<'a> {
    size: ImageSize,
    depths: &'a [f32],
}

impl<'a> DepthMap<'a> {
    /// A depth map of row-major depths, height × width.
    ///
    /// # Errors
    /// [`ProtocolError::Overlap`] unless there are `width · height` depths.
    pub fn new(size: ImageSize, depths: &'a [f32]) -> Result<Self, ProtocolError> {
        let expected = u64::from(size.width) * u64::from(size.height);
        if depths.len() as u64 != expected {
            return Err(unusable(format!("a depth map of {size} needs {expected} depths, found {}", depths.len())));
        }
        Ok(Self { size, depths })
    }

    fn known(&self, column: usize, row: usize) -> Option<f64> {
        let depth = *self.depths.get(row * self.size.width as usize + column)?;
        (depth.is_finite() && depth > 0.0).then(|| f64::from(depth))
    }
}

/// Largest difference of two depths that agree, as a fraction of the depth that was read. On a surface seen at a grazing
/// angle, depth changes by more than that within a pixel.
const TOLERANCE: f64 = 0.01;

/// Overlap by depth in [0, 1]: the smaller of [`fraction`] in both directions, so that it is symmetric in its arguments.
///
/// # Errors
/// [`ProtocolError::Overlap`] if a view has no pixel of known depth.
pub(super) fn overlap(a: (&Camera, &DepthMap<'_>), b: (&Camera, &DepthMap<'_>)) -> Result<f64, ProtocolError> {
    let (of_a, of_b) = (fraction(a, b)?, fraction(b, a)?);
    Ok(if of_b < of_a { of_b } else { of_a })
}

/// Of one view's pixels with known depth, the fraction in [0, 1] whose surface point projects into the other view's image
/// onto a pixel of the same depth.
///
/// The other view's depth is read at the pixel that the point falls into, not interpolated: across the edge of a
/// surface, interpolated depths belong to no surface. A point that falls onto a pixel of unknown depth counts as
/// not seen. Lens distortion is ignored.
fn fraction(
    (from, depths): (&Camera, &DepthMap<'_>),
    (into, other_depths): (&Camera, &DepthMap<'_>),
) -> Result<f64, ProtocolError> {
    let k = from.intrinsics.pixel_from_normalized(depths.size);
    let other_k = into.intrinsics.pixel_from_normalized(other_depths.size);
    let world_from_camera = from.camera_from_world.inverse();
    let (mut known, mut seen) = (0u64, 0u64);
    for row in 0..depths.size.height as usize {
        for column in 0..depths.size.width as usize {
            let Some(z) = depths.known(column, row) else { continue };
            known += 1;
            let ray = DVec3::new((column as f64 + 0.5 - k.cx) / k.fx, (row as f64 + 0.5 - k.cy) / k.fy, 1.0);
            let point = into.camera_from_world.transform_point(world_from_camera.transform_point(ray * z));
            let landed =
                pixel_of(point, &other_k, other_depths.size).and_then(|(column, row)| other_depths.known(column, row));
            let agrees = |other: f64| (point.z - other).abs() <= TOLERANCE * other;
            seen += u64::from(landed.is_some_and(agrees));
        }
    }
    if known == 0 {
        return Err(unusable("a depth map has no pixel of known depth".to_owned()));
    }
    Ok(seen as f64 / known as f64)
}

fn unusable(reason: String) -> ProtocolError {
    ProtocolError::Overlap { estimator: "depth-covisibility", reason }
}

/// The pixel that a point in front of the camera falls into.
fn pixel_of(point: DVec3, k: &atsplat_camera::PixelIntrinsics, size: ImageSize) -> Option<(usize, usize)> {
    let (x, y) = (k.fx * point.x / point.z + k.cx, k.fy * point.y / point.z + k.cy);
    let inside = point.z > 0.0 && x >= 0.0 && y >= 0.0 && x < f64::from(size.width) && y < f64::from(size.height);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
    inside.then_some((x as usize, y as usize))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::DMat3;

    use super::*;
    use crate::samplers::test_scene::looking;

    const SIZE: ImageSize = ImageSize { width: 80, height: 60 };

    /// Casts a ray into the test scene: a wall at z = 4 and, in front of it, a square of side 1 at z = 2 around
    /// the axis. Returns the depth along the ray in units of its direction.
    fn cast(origin: DVec3, direction: DVec3) -> Option<f64> {
        let plane = |z: f64| (z - origin.z) / direction.z;
        let square = plane(2.0);
        let at = origin + direction * square;
        if square > 0.0 && at.x.abs() <= 0.5 && at.y.abs() <= 0.5 {
            return Some(square);
        }
        Some(plane(4.0)).filter(|t| *t > 0.0)
    }

    fn pixel_rays(camera: &Camera) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        let k = camera.intrinsics.pixel_from_normalized(SIZE);
        let pose = camera.camera_from_world.inverse();
        (0..SIZE.width * SIZE.height).map(move |pixel| {
            let (x, y) = (f64::from(pixel % SIZE.width) + 0.5, f64::from(pixel / SIZE.width) + 0.5);
            (pose.centre(), pose.transform_vector(DVec3::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0)))
        })
    }

    #[expect(clippy::cast_possible_truncation, reason = "depth maps are f32")]
    fn depth_of(camera: &Camera) -> Vec<f32> {
        pixel_rays(camera).map(|(o, d)| cast(o, d).map_or(0.0, |t| t as f32)).collect()
    }

    /// The exact fraction, without depth maps: the surface point is inside the other image, and nothing
    /// occludes it from the other camera.
    fn exact_fraction(from: &Camera, into: &Camera) -> f64 {
        let eye = into.camera_from_world.inverse().centre();
        let k = into.intrinsics.pixel_from_normalized(SIZE);
        let (mut known, mut seen) = (0.0, 0.0);
        for (origin, direction) in pixel_rays(from) {
            let Some(t) = cast(origin, direction) else { continue };
            known += 1.0;
            let point = origin + direction * t;
            let unblocked = cast(eye, point - eye).is_some_and(|t| Tolerance::F64.accepts(t, 1.0));
            let inside = pixel_of(into.camera_from_world.transform_point(point), &k, SIZE).is_some();
            seen += f64::from(u8::from(unblocked && inside));
        }
        seen / known
    }

    /// A wall at z = 4 seen by cameras a fifth of an image apart: 80 px · 0.8 / 4 = 16 columns are lost.
    #[test]
    fn agrees_with_a_hand_computed_wall() {
        let (a, b) = (looking(DMat3::IDENTITY, DVec3::ZERO), looking(DMat3::IDENTITY, DVec3::new(0.8, 0.0, 0.0)));
        let wall = vec![4.0f32; 80 * 60];
        let map = DepthMap::new(SIZE, &wall).unwrap();
        let overlap = overlap((&a, &map), (&b, &map)).unwrap();
        Tolerance::EXACT.assert([overlap], [0.8], "64 of 80 columns");
    }

    #[test]
    fn agrees_with_ray_casting_under_occlusion() {
        let cameras = [
            looking(DMat3::IDENTITY, DVec3::ZERO),
            looking(DMat3::IDENTITY, DVec3::new(0.7, 0.1, 0.0)),
            looking(DMat3::from_rotation_y(-0.2), DVec3::new(-0.5, 0.0, 0.4)),
        ];
        // Pixels on the outline of the square or of the image may fall on either side.
        let outline = Tolerance::absolute(0.02);
        for (a, b) in [(0, 1), (1, 0), (0, 2), (2, 1)] {
            let (a, b) = (&cameras[a], &cameras[b]);
            let (depth_a, depth_b) = (depth_of(a), depth_of(b));
            let maps = (DepthMap::new(SIZE, &depth_a).unwrap(), DepthMap::new(SIZE, &depth_b).unwrap());
            let found = fraction((a, &maps.0), (b, &maps.1)).unwrap();
            let exact = exact_fraction(a, b);
            assert!((0.2..0.97).contains(&exact), "a trivial case: {exact}");
            outline.assert([found], [exact], "co-visible pixels");
        }
    }

    #[test]
    fn views_turned_away_share_nothing_and_unknown_depth_is_an_error() {
        let (a, b) =
            (looking(DMat3::IDENTITY, DVec3::ZERO), looking(DMat3::from_rotation_y(std::f64::consts::PI), DVec3::ZERO));
        let depths = vec![3.0f32; 80 * 60];
        let map = DepthMap::new(SIZE, &depths).unwrap();
        Tolerance::EXACT.assert([overlap((&a, &map), (&b, &map)).unwrap()], [0.0], "back to back");
        let unknown = [f32::NAN, f32::INFINITY, 0.0, -1.0].repeat(80 * 15);
        let holes = DepthMap::new(SIZE, &unknown).unwrap();
        assert!(overlap((&a, &map), (&a, &holes)).is_err(), "nothing to count");
        assert!(DepthMap::new(SIZE, &depths[1..]).is_err(), "one depth short");
    }

    /// With half of the depths unknown, only the other half counts; a point that falls into a hole is not seen.
    #[test]
    fn holes_are_skipped_in_one_view_and_count_as_unseen_in_the_other() {
        let a = looking(DMat3::IDENTITY, DVec3::ZERO);
        let full = vec![3.0f32; 80 * 60];
        let mut half = full.clone();
        half[..80 * 30].fill(f32::NAN);
        let (full, half) = (DepthMap::new(SIZE, &full).unwrap(), DepthMap::new(SIZE, &half).unwrap());
        Tolerance::EXACT.assert([fraction((&a, &half), (&a, &full)).unwrap()], [1.0], "known half");
        Tolerance::EXACT.assert([fraction((&a, &full), (&a, &half)).unwrap()], [0.5], "into holes");
    }
}
