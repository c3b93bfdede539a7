use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Extremes as _;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::OverlapEstimator;
use crate::ProtocolError;

/// Camera centres closer than this, in scene units, count as equal (pixelSplat's `mask_at_camera` in
/// `src/geometry/epipolar_lines.py`).
const NO_BASELINE: f64 = 1e-6;

/// A centre within this angle, in radians, of a side of the other view's frustum counts as lying on it: half of the
/// digits of an f64, so that rounding affects neither the decision nor its consequences.
const GRAZING: f64 = 1e-8;

/// pixelSplat's overlap of two views (`src/evaluation/evaluation_index_generator.py`,
/// `src/geometry/epipolar_lines.py`): of the rays through the pixel centres of one view, from its centre to
/// infinity, the fraction whose projection touches the other view's image; the smaller of both
/// directions. Pure geometry: lens distortion and occlusion are ignored.
///
/// No ray is sampled or visited one by one. The directions that intersect the other view's frustum form a convex cone
/// (see [`EpipolarRays::fraction`]), so each row of the grid contains one interval of them, and counting the pixel
/// centres inside it gives the same number as testing every ray of the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpipolarRays {
    /// Columns and rows of rays, spread over the whole image or its crop. The default is the published generator's: one ray
    /// per pixel of its 320×180 images (`config/dataset/re10k.yaml`).
    #[serde(default = "published_grid")]
    pub grid: ImageSize,
    /// Overlap is that of images that were scaled to cover this size and cropped to it, as latentSplat's generator sees them:
    /// `rescale_and_crop` of pixelSplat's `src/dataset/shims/crop_shim.py`, which leaves the principal point as it is. By
    /// default that of whole images. Pixels are taken to be square, so that focal lengths give an image's aspect ratio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<ImageSize>,
}

const fn published_grid() -> ImageSize {
    ImageSize { width: 320, height: 180 }
}

impl Default for EpipolarRays {
    fn default() -> Self {
        Self { grid: published_grid(), crop: None }
    }
}

impl EpipolarRays {
    /// Two-way overlap in [0, 1], symmetric in its arguments.
    ///
    /// # Errors
    /// [`ProtocolError::Overlap`] for an empty grid or crop, or for cameras whose values overflow f64.
    pub fn overlap(&self, a: &Camera, b: &Camera) -> Result<f64, ProtocolError> {
        Ok(self.fraction(a, b)?.minimum_of(self.fraction(b, a)?))
    }

    /// Fraction of `from`'s rays that project into `into`'s image, in [0, 1].
    ///
    /// In camera coordinates of `into`, its frustum is the cone over the four corner rays `e₀ … e₃`. A ray of `from`
    /// with direction `d` starts at `o`; it intersects the frustum, possibly at infinity, iff `o + t·d = Σ λₖ eₖ` for
    /// some `t > 0` and `λ ≥ 0`, that is, iff `d` lies in the cone over `e₀ … e₃` and `−o`. Without a baseline,
    /// `o = 0` and the cone is the frustum itself. Centres behind the other camera, rays that cross its
    /// plane, parallel rays and points at infinity need no special case.
    ///
    /// # Errors
    /// Those of [`EpipolarRays::overlap`].
    pub fn fraction(&self, from: &Camera, into: &Camera) -> Result<f64, ProtocolError> {
        let rays = u64::from(self.grid.width) * u64::from(self.grid.height);
        if rays == 0 {
            return Err(self.unusable(format!("the grid of rays is {}", self.grid)));
        }
        if let Some(crop) = self.crop.filter(|crop| crop.width == 0 || crop.height == 0) {
            return Err(self.unusable(format!("the crop is {crop}")));
        }
        let [of_from, of_into] = [from, into].map(|camera| self.seen(&camera.intrinsics));
        let into_from_world = into.camera_from_world;
        let world_from_from = from.camera_from_world.inverse();
        let origin = into_from_world.transform_point(world_from_from.centre());
        let rotation = into_from_world.rotation() * world_from_from.rotation();
        if !(origin.is_finite() && rotation.is_finite()) {
            return Err(self.unusable("the relative pose overflows".to_owned()));
        }
        let hits = match cone_of_hits(&of_into, origin) {
            Cone::Everything => rays,
            Cone::Sides(sides) => {
                let sides: Vec<HalfPlane> =
                    sides.iter().map(|side| HalfPlane::on_grid(*side, rotation, &of_from, self.grid)).collect();
                if !sides.iter().all(HalfPlane::is_finite) {
                    return Err(self.unusable("the intrinsics overflow".to_owned()));
                }
                (0..self.grid.height).map(|row| hits_in_row(&sides, row, self.grid.width)).sum()
            }
        };
        Ok(hits as f64 / rays as f64)
    }

    /// The intrinsics of the crop of an image with these, or of the whole image without one.
    fn seen(&self, whole: &NormalizedIntrinsics) -> NormalizedIntrinsics {
        let Some(crop) = self.crop else { return *whole };
        let [width, height] = [crop.width, crop.height].map(f64::from);
        let aspect = whole.fy / whole.fx;
        // The scaled image, of which one side is the crop's; as Python rounds.
        let (columns, rows) =
            if aspect * height >= width { (aspect * height, height) } else { (width, width / aspect) };
        let [columns, rows] = [columns, rows].map(f64::round_ties_even);
        NormalizedIntrinsics { fx: whole.fx * (columns / width), fy: whole.fy * (rows / height), ..*whole }
    }

    fn unusable(&self, reason: String) -> ProtocolError {
        ProtocolError::Overlap { estimator: OverlapEstimator::EpipolarRay(*self).name(), reason }
    }
}

/// A convex cone of directions, in coordinates of the other camera.
enum Cone {
    Everything,
    /// Inward normals: a direction lies in the cone iff its dot product with none of them is negative.
    Sides(Vec<DVec3>),
}

/// The cone over the corner rays of the image and `−origin`.
///
/// The sides of the frustum that have `−origin` on their inner side are kept. The others are replaced by two new sides,
/// through `−origin` and the two edges where both kinds meet.
fn cone_of_hits(intrinsics: &NormalizedIntrinsics, origin: DVec3) -> Cone {
    let corner = |u: f64, v: f64| {
        DVec3::new((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1.0).normalize()
    };
    let edges = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
    let middle = edges.iter().sum::<DVec3>();
    let side = |a: DVec3, b: DVec3| {
        let normal = a.cross(b).normalize_or_zero();
        if normal.dot(middle) < 0.0 { -normal } else { normal }
    };
    let [e0, e1, e2, e3] = edges;
    let sides = [side(e0, e1), side(e1, e2), side(e2, e3), side(e3, e0)];
    if origin.length() < NO_BASELINE {
        return Cone::Sides(sides.to_vec());
    }
    let apex = -origin.normalize_or_zero();
    let replaced = sides.map(|normal| normal.dot(apex) < -GRAZING);
    if replaced == [true; 4] {
        return Cone::Everything;
    }
    let mut cone: Vec<DVec3> =
        sides.iter().zip(replaced).filter(|(_, replaced)| !replaced).map(|(side, _)| *side).collect();
    // Edge k lies between side k − 1 and side k.
    let before = [replaced[3], replaced[0], replaced[1], replaced[2]];
    for ((edge, one), other) in edges.iter().zip(before).zip(replaced) {
        if one != other {
            cone.push(side(apex, *edge));
        }
    }
    Cone::Sides(cone)
}

/// `column · i + row · j + constant ≥ 0` for pixel `(i, j)` of the grid.
struct HalfPlane {
    column: f64,
    row: f64,
    constant: f64,
}

impl HalfPlane {
    fn on_grid(normal: DVec3, into_from: DMat3, k: &NormalizedIntrinsics, grid: ImageSize) -> Self {
        let n = into_from.transpose() * normal;
        let (width, height) = (f64::from(grid.width), f64::from(grid.height));
        let (x0, y0) = ((0.5 / width - k.cx) / k.fx, (0.5 / height - k.cy) / k.fy);
        Self { column: n.x / (width * k.fx), row: n.y / (height * k.fy), constant: n.x * x0 + n.y * y0 + n.z }
    }

    fn is_finite(&self) -> bool {
        self.column.is_finite() && self.row.is_finite() && self.constant.is_finite()
    }
}

fn hits_in_row(sides: &[HalfPlane], row: u32, width: u32) -> u64 {
    let (mut first, mut last) = (0.0, f64::from(width) - 1.0);
    for side in sides {
        let rest = side.row * f64::from(row) + side.constant;
        let crossing = -rest / side.column;
        if side.column > 0.0 {
            first = if crossing > first { crossing } else { first };
        } else if side.column < 0.0 {
            last = if crossing < last { crossing } else { last };
        } else if rest < 0.0 {
            return 0;
        }
    }
    let (first, last) = (first.ceil(), last.floor());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 ≤ first ≤ last < width")]
    if first <= last { (last - first) as u64 + 1 } else { 0 }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::WorldFromCamera;
    use atsplat_numeric::Tolerance;
    use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop, Step};
    use proptest::prelude::*;

    use super::*;
    use crate::samplers::test_scene::looking;

    const GRID: EpipolarRays = EpipolarRays { grid: ImageSize { width: 64, height: 48 }, crop: None };

    /// The literal definition, ray by ray: the interval of `t ≥ 0` in which `o + t·d` lies on the inner side of all
    /// four sides, including infinity.
    fn by_testing_every_ray(grid: ImageSize, from: &Camera, into: &Camera) -> f64 {
        let into_from =
            |v: DVec3| into.camera_from_world.transform_vector(from.camera_from_world.inverse().transform_vector(v));
        let origin = into.camera_from_world.transform_point(from.camera_from_world.inverse().centre());
        let k = into.intrinsics;
        let sides = [
            DVec3::new(k.fx, 0.0, k.cx),
            DVec3::new(-k.fx, 0.0, 1.0 - k.cx),
            DVec3::new(0.0, k.fy, k.cy),
            DVec3::new(0.0, -k.fy, 1.0 - k.cy),
        ];
        let mut hits = 0;
        for row in 0..grid.height {
            for column in 0..grid.width {
                let u = (f64::from(column) + 0.5) / f64::from(grid.width);
                let v = (f64::from(row) + 0.5) / f64::from(grid.height);
                let f = from.intrinsics;
                let direction = into_from(DVec3::new((u - f.cx) / f.fx, (v - f.cy) / f.fy, 1.0));
                let (mut low, mut high) = (0.0, f64::INFINITY);
                for side in sides {
                    let (at, slope) = (side.dot(origin), side.dot(direction));
                    if slope > 0.0 && -at / slope > low {
                        low = -at / slope;
                    } else if slope < 0.0 && -at / slope < high {
                        high = -at / slope;
                    }
                }
                hits += u32::from(low < high);
            }
        }
        f64::from(hits) / (f64::from(grid.width) * f64::from(grid.height))
    }

    fn camera(yaw: f64, pitch: f64, roll: f64, centre: [f64; 3], focal: f64, principal: f64) -> Camera {
        let rotation = DMat3::from_rotation_y(yaw) * DMat3::from_rotation_x(pitch) * DMat3::from_rotation_z(roll);
        let pose = WorldFromCamera::new(rotation, DVec3::from_array(centre)).unwrap();
        let k = NormalizedIntrinsics::new(focal, focal * 1.5, principal, 1.0 - principal).unwrap();
        Camera::pinhole(pose.inverse(), k)
    }

    #[test]
    fn a_view_overlaps_itself_completely() {
        let a = looking(DMat3::IDENTITY, DVec3::new(1.0, 2.0, 3.0));
        Tolerance::EXACT.assert([GRID.overlap(&a, &a).unwrap()], [1.0], "itself");
    }

    /// By hand: frustums of 53° whose axes are 90° apart share no direction.
    #[test]
    fn views_turned_away_without_a_baseline_share_nothing() {
        let a = looking(DMat3::IDENTITY, DVec3::ZERO);
        let b = looking(DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2), DVec3::ZERO);
        Tolerance::EXACT.assert([GRID.overlap(&a, &b).unwrap()], [0.0], "a quarter turn");
    }

    /// Every ray of a camera inside the other's view starts inside it; back to back, none enters it.
    #[test]
    fn all_rays_of_a_camera_inside_the_other_view_hit() {
        let a = looking(DMat3::IDENTITY, DVec3::ZERO);
        let ahead = looking(DMat3::from_rotation_y(2.0), DVec3::new(0.1, 0.0, 5.0));
        Tolerance::EXACT.assert([GRID.fraction(&ahead, &a).unwrap()], [1.0], "all rays start inside");
        let backwards = looking(DMat3::from_rotation_y(std::f64::consts::PI), DVec3::new(0.0, 0.0, -5.0));
        Tolerance::EXACT.assert([GRID.fraction(&backwards, &a).unwrap()], [0.0], "back to back");
    }

    /// By hand: after a translation along the image's x axis, rays of the right camera intersect the left image unless
    /// their slope exceeds that of its edge; none does, because both cameras have the same edges.
    #[test]
    fn sideways_motion_keeps_every_epipolar_line_visible() {
        let a = looking(DMat3::IDENTITY, DVec3::ZERO);
        for distance in [1e-3, 1.0, 1e6] {
            let b = looking(DMat3::IDENTITY, DVec3::new(distance, 0.0, 0.0));
            Tolerance::EXACT.assert([GRID.overlap(&a, &b).unwrap()], [1.0], "parallel views");
        }
    }

    /// Written by `tests/fixtures/make_oracles.py`, an independent NumPy implementation in float64 that
    /// intersects each ray with the image's frame, as the paper's code does.
    #[test]
    fn agrees_with_the_numpy_oracle() {
        let oracle: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/fixtures/epipolar_oracle.json")).unwrap();
        let pairs = oracle["pairs"].as_array().unwrap();
        assert!(pairs.len() >= 60, "only {} pairs", pairs.len());
        for (number, pair) in pairs.iter().enumerate() {
            let read = |name: &str| {
                let rows: [f64; 12] = serde_json::from_value(pair[name]["w2c"].clone()).unwrap();
                let [fx, fy, cx, cy]: [f64; 4] = serde_json::from_value(pair[name]["k"].clone()).unwrap();
                let pose = atsplat_camera::CameraFromWorld::from_rows(&rows).unwrap();
                Camera::pinhole(pose, NormalizedIntrinsics::new(fx, fy, cx, cy).unwrap())
            };
            let [width, height]: [u32; 2] = serde_json::from_value(pair["grid"].clone()).unwrap();
            let rays = EpipolarRays { grid: ImageSize { width, height }, crop: None };
            let (a, b) = (read("a"), read("b"));
            let found = [rays.fraction(&a, &b).unwrap(), rays.fraction(&b, &a).unwrap()];
            let expected: [f64; 2] = serde_json::from_value(pair["fractions"].clone()).unwrap();
            Tolerance::F64.assert(found, expected, &format!("pair {number} ({})", pair["case"]));
            let [a_in_b, b_in_a] = expected;
            let smaller = if b_in_a < a_in_b { b_in_a } else { a_in_b };
            Tolerance::F64.assert([rays.overlap(&a, &b).unwrap()], [smaller], &format!("overlap of pair {number}"));
        }
    }

    /// By hand: two cameras of equal pose share the directions of the narrower one. All of its rays are in the wider
    /// image; of the wider one's, as many as fit into the narrower one. The overlap is the smaller fraction.
    #[test]
    fn the_overlap_is_the_smaller_direction() {
        let wide = looking(DMat3::IDENTITY, DVec3::ZERO);
        let mut narrow = wide;
        narrow.intrinsics.fx *= 4.0;
        narrow.intrinsics.fy *= 2.0;
        let fractions = [GRID.fraction(&narrow, &wide).unwrap(), GRID.fraction(&wide, &narrow).unwrap()];
        Tolerance::EXACT.assert(fractions, [1.0, 1.0 / 8.0], "both directions");
        let overlaps = [GRID.overlap(&narrow, &wide).unwrap(), GRID.overlap(&wide, &narrow).unwrap()];
        Tolerance::EXACT.assert(overlaps, [1.0 / 8.0; 2], "the smaller of them, either way round");
    }

    /// The same focal lengths as the papers' preprocessing gives, for wide, high and square images and crops.
    #[test]
    fn a_crop_sees_what_the_preprocessing_leaves() {
        for (width, height) in [(640_u32, 360_u32), (480, 270), (300, 400), (128, 128), (641, 479)] {
            let [fx, fy] = [width, height].map(|side| 250.0 / f64::from(side));
            let whole = NormalizedIntrinsics::new(fx, fy, 0.5, 0.4).unwrap();
            for crop in [ImageSize { width: 128, height: 128 }, ImageSize { width: 96, height: 64 }] {
                let steps = [Step::from(RescaleAndCrop::new(crop.height, crop.width))];
                let plan = Preprocessing::of(steps).plan(ImageSize { width, height }).unwrap();
                let expected = plan.intrinsics(&whole).unwrap();
                let found = EpipolarRays { crop: Some(crop), ..GRID }.seen(&whole);
                Tolerance::F64.assert(
                    [found.fx, found.fy, found.cx, found.cy],
                    [expected.fx, expected.fy, expected.cx, expected.cy],
                    &format!("{width}×{height} to {crop}"),
                );
            }
        }
    }

    #[test]
    fn extreme_cameras_give_an_error_or_a_valid_overlap() {
        let far = looking(DMat3::IDENTITY, DVec3::new(1e308, 1e308, 1e308));
        let other = looking(DMat3::from_rotation_y(0.3), DVec3::new(-1e308, -1e308, -1e308));
        assert!(matches!(GRID.overlap(&far, &other), Err(ProtocolError::Overlap { .. })));
        let nothing = ImageSize { width: 0, height: 5 };
        assert!(EpipolarRays { grid: nothing, ..GRID }.overlap(&far, &far).is_err());
        let error = EpipolarRays { crop: Some(nothing), ..GRID }.overlap(&other, &other).unwrap_err().to_string();
        assert!(error.contains("(epipolar-ray-crop): the crop is 0×5"), "{error}");
        let error = GRID.overlap(&far, &other).unwrap_err().to_string();
        assert!(error.contains("(epipolar-ray): "), "{error}");
        let mut pinhole = looking(DMat3::IDENTITY, DVec3::ZERO);
        pinhole.intrinsics = NormalizedIntrinsics::new(1e-320, 1e-320, 0.5, 0.5).unwrap();
        let outcome = GRID.overlap(&pinhole, &looking(DMat3::IDENTITY, DVec3::X));
        assert!(outcome.is_err() || outcome.is_ok_and(|o| (0.0..=1.0).contains(&o)));
    }

    fn any_camera() -> impl Strategy<Value = Camera> {
        (-3.2..3.2f64, -1.5..1.5f64, -3.2..3.2f64, prop::array::uniform3(-3.0..3.0f64), 0.3..3.0f64, 0.2..0.8f64)
            .prop_map(|(yaw, pitch, roll, centre, focal, principal)| camera(yaw, pitch, roll, centre, focal, principal))
    }

    proptest! {
        #[test]
        fn counting_intervals_equals_testing_every_ray(a in any_camera(), b in any_camera()) {
            Tolerance::EXACT.assert([GRID.fraction(&a, &b).unwrap()], [by_testing_every_ray(GRID.grid, &a, &b)], "fraction");
        }

        #[test]
        fn overlap_is_symmetric(a in any_camera(), b in any_camera()) {
            Tolerance::EXACT.assert([GRID.overlap(&a, &b).unwrap()], [GRID.overlap(&b, &a).unwrap()], "overlap");
        }

        /// A similarity of the world keeps the images: at most one or two rays on an edge may flip.
        #[test]
        fn is_invariant_under_similarities_of_the_world(a in any_camera(), b in any_camera(), yaw in -3.0..3.0f64, scale in 0.1..10.0f64) {
            let motion = WorldFromCamera::new(DMat3::from_rotation_y(yaw), DVec3::new(1.0, -2.0, 0.5)).unwrap();
            let moved = |camera: &Camera| {
                let pose = camera.camera_from_world.inverse().scaled_by(scale).unwrap().moved_by(&motion);
                Camera { camera_from_world: pose.inverse(), ..*camera }
            };
            let before = GRID.fraction(&a, &b).unwrap();
            let after = GRID.fraction(&moved(&a), &moved(&b)).unwrap();
            let two_rays = Tolerance::absolute(2.0 / (64.0 * 48.0));
            prop_assert!(two_rays.accepts(after, before), "{} and {}", before, after);
        }

        /// Widening the other view can only add rays.
        #[test]
        fn a_wider_view_is_hit_at_least_as_often(a in any_camera(), b in any_camera(), wider in 0.3..1.0f64) {
            let mut wide = b;
            wide.intrinsics.fx *= wider;
            wide.intrinsics.fy *= wider;
            prop_assert!(GRID.fraction(&a, &wide).unwrap() >= GRID.fraction(&a, &b).unwrap());
        }
    }
}
