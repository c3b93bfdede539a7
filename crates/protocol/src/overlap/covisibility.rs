use atsplat_camera::{Camera, CameraError, DirectionScale, ImageSize, Projected};
use atsplat_numeric::Extremes as _;

use crate::ProtocolError;

/// The name that indices record. Overlaps recorded as `depth-covisibility` were measured otherwise: by the depth of one pixel, and
/// without lenses.
pub(super) const NAME: &str = "depth-covisibility-2x2";

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

    /// Whether a projected point is on a surface of this map: inside the image, not on a pixel of unknown depth, and within
    /// [`TOLERANCE`] of the depths at the four pixel centres around it.
    ///
    /// Between these centres, a flat surface has no other depths, however steep it is and however large the pixels are; the depth
    /// of the nearest centre differs by several per cent on floors. A point that is hidden may count if it is within a pixel of the
    /// edge of what hides it, none farther from it. In the outer half of the image's outermost pixels, there are only centres on
    /// one side, so that points on steep surfaces may be missed in small maps.
    fn shows(&self, point: &Projected) -> bool {
        let at = point.pixel(self.size);
        let depth = |right: f64, down: f64| {
            let (column, row) = (pixel(at.x + right, self.size.width), pixel(at.y + down, self.size.height));
            known(*self.depths.get(row * self.size.width as usize + column)?)
        };
        let Some(here) = depth(0.0, 0.0).filter(|_| point.is_inside()) else { return false };
        let around = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
        let around = around.into_iter().filter_map(|(right, down)| depth(right, down));
        let (least, greatest) =
            around.fold((here, here), |(least, greatest), depth| (depth.minimum_of(least), depth.maximum_of(greatest)));
        (least * (1.0 - TOLERANCE)..=greatest * (1.0 + TOLERANCE)).contains(&point.depth)
    }
}

/// How far a point's depth may be outside the range of depths around it, as a fraction of them.
const TOLERANCE: f64 = 0.01;

/// The depth, unless it is unknown.
fn known(depth: f32) -> Option<f64> {
    (depth.is_finite() && depth > 0.0).then(|| f64::from(depth))
}

/// The pixel along a side of the image that is nearest to a position, in pixels.
fn pixel(at: f64, side: u32) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates; the first pixel is nearest"
    )]
    let pixel = at as usize;
    pixel.min((side as usize).saturating_sub(1))
}

/// Overlap by depth in [0, 1]: the smaller of [`fraction`] in both directions, so that it is symmetric in its arguments.
///
/// # Errors
/// [`ProtocolError::Overlap`] if a view has no pixel of known depth, if a pixel of known depth has no ray through the lens, or if
/// the cameras' values overflow f64.
pub(super) fn overlap(a: (&Camera, &DepthMap<'_>), b: (&Camera, &DepthMap<'_>)) -> Result<f64, ProtocolError> {
    Ok(fraction(a, b)?.minimum_of(fraction(b, a)?))
}

/// Of one view's pixels with known depth, the fraction in [0, 1] whose surface point projects into the other view's image and is
/// on a surface there: see [`DepthMap::shows`]. Both views are seen through the lenses that the cameras state.
fn fraction(
    (from, depths): (&Camera, &DepthMap<'_>),
    (into, other_depths): (&Camera, &DepthMap<'_>),
) -> Result<f64, ProtocolError> {
    let impossible = |error: CameraError| unusable(format!("a pixel of a depth map has no place: {error}"));
    let rays = from.projector().and_then(|from| from.pixel_rays(depths.size, DirectionScale::UnitDepth));
    let rays = rays.map_err(impossible)?;
    let into = into.projector().map_err(impossible)?;
    let (mut pixels, mut seen) = (0u64, 0u64);
    for (ray, depth) in rays.zip(depths.depths) {
        let Some(depth) = known(*depth) else { continue };
        pixels += 1;
        seen += match into.project(ray.map_err(impossible)?.at(depth)) {
            Ok(point) => u64::from(other_depths.shows(&point)),
            Err(CameraError::BehindCamera { .. } | CameraError::OutsideLens { .. }) => 0,
            Err(error) => return Err(impossible(error)),
        };
    }
    if pixels == 0 {
        return Err(unusable("a depth map has no pixel of known depth".to_owned()));
    }
    Ok(seen as f64 / pixels as f64)
}

fn unusable(reason: String) -> ProtocolError {
    ProtocolError::Overlap { estimator: NAME, reason }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Distortion, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};

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
        let (mut known, mut seen) = (0.0, 0.0);
        for (origin, direction) in pixel_rays(from) {
            let Some(t) = cast(origin, direction) else { continue };
            known += 1.0;
            let point = origin + direction * t;
            let unblocked = cast(eye, point - eye).is_some_and(|t| Tolerance::F64.accepts(t, 1.0));
            let inside = into.project(point).is_ok_and(|projected| projected.is_inside());
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
            // 0.46 and 0.62 of the first and the last view, 0.31 and 0.21 of the last two.
            let smaller = exact.minimum_of(exact_fraction(b, a));
            outline.assert([overlap((a, &maps.0), (b, &maps.1)).unwrap()], [smaller], "the smaller of both directions");
        }
    }

    /// The depth along a ray, in units of its direction, from inside a corridor that is 4 wide and 2.7 high and ends at z = 12.
    fn in_corridor(origin: DVec3, direction: DVec3) -> f64 {
        let walls = [
            (-2.0, origin.x, direction.x),
            (2.0, origin.x, direction.x),
            (-1.3, origin.y, direction.y),
            (1.4, origin.y, direction.y),
            (12.0, origin.z, direction.z),
        ];
        let depths = walls.into_iter().map(|(wall, origin, direction)| (wall - origin) / direction);
        depths.filter(|depth| *depth > 0.0).fold(f64::INFINITY, f64::minimum_of)
    }

    /// A view of the corridor by a camera with this lens: its depth map, and for each pixel the point on the wall.
    #[expect(clippy::cast_possible_truncation, reason = "depth maps are f32")]
    fn corridor_view(camera: &Camera, size: ImageSize) -> (Vec<f32>, Vec<DVec3>) {
        let rays = camera.pixel_rays(size, DirectionScale::UnitDepth).unwrap();
        let depths = rays.iter().map(|ray| in_corridor(ray.origin, ray.direction));
        depths.zip(&rays).map(|(depth, ray)| (depth as f32, ray.at(depth))).unzip()
    }

    /// Depth on floors and side walls changes by several per cent within a pixel, the more the smaller the map is. Nothing hides
    /// anything, so that a point is seen iff it is inside the image.
    #[test]
    fn walls_at_a_grazing_angle_are_seen_in_maps_of_any_size_through_any_lens() {
        let (small, large) = (ImageSize { width: 64, height: 36 }, ImageSize { width: 256, height: 144 });
        let places = [
            looking(DMat3::from_rotation_y(-0.25), DVec3::new(0.5, 0.0, 0.0)),
            looking(DMat3::IDENTITY, DVec3::new(0.3, 0.0, 1.0)),
        ];
        for (k1, place) in [0.0, -0.09].into_iter().flat_map(|k1| places.map(|place| (k1, place))) {
            let distortion = Distortion::OpenCv { k1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
            let intrinsics = NormalizedIntrinsics::new(0.95 * 9.0 / 16.0, 0.95, 0.5, 0.5).unwrap();
            let [a, b] = [looking(DMat3::IDENTITY, DVec3::ZERO), place].map(|camera| Camera {
                intrinsics,
                distortion,
                ..camera
            });
            for (sizes, tolerance) in [([large; 2], 0.003), ([small; 2], 0.02), ([small, large], 0.02)] {
                let [(depths_a, points_a), (depths_b, points_b)] =
                    [corridor_view(&a, sizes[0]), corridor_view(&b, sizes[1])];
                let maps = [DepthMap::new(sizes[0], &depths_a).unwrap(), DepthMap::new(sizes[1], &depths_b).unwrap()];
                let inside = |points: &[DVec3], into: &Camera| {
                    let seen = points.iter().filter(|point| into.project(**point).is_ok_and(|seen| seen.is_inside()));
                    seen.count() as f64 / points.len() as f64
                };
                let found = [fraction((&a, &maps[0]), (&b, &maps[1])), fraction((&b, &maps[1]), (&a, &maps[0]))];
                let expected = [inside(&points_a, &b), inside(&points_b, &a)];
                assert!((expected[0] - expected[1]).abs() > 0.02, "the directions differ: {expected:?}");
                let what = format!("k1 {k1}, from {} to {}", sizes[0], sizes[1]);
                Tolerance::absolute(tolerance).assert(found.map(Result::unwrap), expected, &what);
            }
        }
    }

    /// A pixel of known depth that the lens cannot have seen: the radius of this lens never exceeds 0.47, the corners' is 0.7.
    #[test]
    fn depth_outside_the_lens_is_an_error() {
        let camera = Camera {
            distortion: Distortion::OpenCv { k1: -0.66, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 },
            ..looking(DMat3::IDENTITY, DVec3::ZERO)
        };
        let mut depths = vec![3.0f32; 80 * 60];
        let of = |depths: &[f32]| {
            let map = DepthMap::new(SIZE, depths).unwrap();
            overlap((&camera, &map), (&camera, &map))
        };
        let error = of(&depths).unwrap_err().to_string();
        assert!(error.contains("a pixel of a depth map has no place") && error.contains("outside"), "{error}");
        for (at, depth) in depths.iter_mut().enumerate() {
            let (x, y) = ((at % 80) as f64 / 80.0 - 0.5, (at / 80) as f64 / 60.0 - 0.5);
            *depth = if x.hypot(y) < 0.4 { 3.0 } else { 0.0 };
        }
        Tolerance::EXACT.assert([of(&depths).unwrap()], [1.0], "unknown where the lens sees nothing");
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
