//! Radial distortion in OpenCV's model.

use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Extremes as _;
use glam::DVec2;

use super::SceneContext;

/// Largest displacement that counts as no distortion, in pixels.
const STRAIGHT: f64 = 0.05;
/// Smallest derivative of the distorted radius by the undistorted one inside an image. Where it is 0, the lens folds; just before,
/// the rays of a pixel would spread far.
const MIN_SLOPE: f64 = 0.3;
/// Narrower images count as this wide: a small image of a scene has the lens of a larger one.
const NARROWEST: u32 = 256;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let [k1, k2] = lens(scene);
    let largest = |farthest: &dyn Fn(&NormalizedIntrinsics) -> f64| {
        let cameras = scene.shots.iter().map(|shot| &shot.camera.intrinsics);
        cameras.map(|k| displacement([k1, k2], farthest(k), k, scene.size)).fold(0.0, f64::maximum_of)
    };
    // Which images have a lens is part of their generation: it is decided as if the corner were a point before the lens.
    let pixels = largest(&farthest_corner) * f64::from(scene.size.width.max(NARROWEST));
    (pixels > STRAIGHT).then(|| {
        let percent = largest(&|k| before_lens([k1, k2], farthest_corner(k))) * 100.0;
        format!("k1 = {k1:.3}, k2 = {k2:.3} move the image by up to {percent:.2} % of its width")
    })
}

/// The scene's lens; none if its coefficients are 0.
pub(super) fn distortion(scene: &SceneContext<'_>) -> Distortion {
    let [k1, k2] = lens(scene);
    let straight = k1.abs() + k2.abs() <= 0.0;
    if straight { Distortion::None } else { radial([k1, k2]) }
}

fn radial([k1, k2]: [f64; 2]) -> Distortion {
    Distortion::OpenCv { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 }
}

/// The drawn k1, k2, halved until the lens is invertible in all images with a margin.
fn lens(scene: &SceneContext<'_>) -> [f64; 2] {
    let corners = scene.shots.iter().map(|shot| farthest_corner(&shot.camera.intrinsics));
    unfolded(scene.conditions.lens, corners.fold(0.0, f64::maximum_of))
}

/// Halves k1, k2 until [`MIN_SLOPE`] is kept out to image points at this squared distance from the optical axis.
fn unfolded(mut lens: [f64; 2], farthest: f64) -> [f64; 2] {
    while reach(lens) < farthest {
        lens = lens.map(|k| k / 2.0);
    }
    lens
}

/// Squared distance from the optical axis, on the plane z = 1 behind the lens, out to which [`MIN_SLOPE`] is kept.
fn reach([k1, k2]: [f64; 2]) -> f64 {
    // The slope at a squared undistorted distance s is 1 + 3 k1 s + 5 k2 s²; of its two points at `MIN_SLOPE`, the nearer.
    let twice_lost = 2.0 * (1.0 - MIN_SLOPE);
    let divisor = (9.0 * k1 * k1 - 10.0 * k2 * twice_lost).sqrt() - 3.0 * k1;
    if divisor > 0.0 {
        let squared = twice_lost / divisor;
        squared * (1.0 + k1 * squared + k2 * squared * squared).powi(2)
    } else {
        f64::INFINITY
    }
}

/// Squared distance of the image's farthest corner from the optical axis, on the plane z = 1 behind the lens.
fn farthest_corner(k: &NormalizedIntrinsics) -> f64 {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let squared = corners.map(|[x, y]: [f64; 2]| ((x - k.cx) / k.fx).powi(2) + ((y - k.cy) / k.fy).powi(2));
    squared.into_iter().fold(0.0, f64::maximum_of)
}

/// The squared distance that a point at this one behind the lens has before it; infinite without such a point.
fn before_lens(lens: [f64; 2], squared: f64) -> f64 {
    let point = radial(lens).lens().and_then(|lens| lens.undistorted_from_distorted(DVec2::new(squared.sqrt(), 0.0)));
    point.map_or(f64::INFINITY, DVec2::length_squared)
}

/// Largest displacement of an image point, as a share of the image's width. On the plane z = 1, the lens moves a point that is at a
/// distance r from the optical axis before it by k1 r³ + k2 r⁵: most at the `farthest` squared distance or where the derivative is
/// zero.
fn displacement([k1, k2]: [f64; 2], farthest: f64, k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
    let moved = |squared: f64| (k1 * squared + k2 * squared * squared).abs() * squared.sqrt();
    let stationary = Some(-0.6 * k1 / k2).filter(|squared| (0.0..farthest).contains(squared));
    let largest = moved(farthest).maximum_of(stationary.map_or(0.0, moved));
    largest * k.fx.maximum_of(k.fy * f64::from(size.height) / f64::from(size.width))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    /// The largest displacement of a point of the image.
    fn displacement_in_image(lens: [f64; 2], k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
        displacement(lens, before_lens(lens, farthest_corner(k)), k, size)
    }

    /// The distance from the axis before a lens that moves it to `behind`, by Newton's method.
    fn inverted([k1, k2]: [f64; 2], behind: f64) -> f64 {
        (0..20).fold(behind, |r, _| {
            let s = r * r;
            r - (r * (1.0 + k1 * s + k2 * s * s) - behind) / (1.0 + 3.0 * k1 * s + 5.0 * k2 * s * s)
        })
    }

    /// The largest displacement over a grid of image points, in pixels.
    fn by_grid(lens: [f64; 2], k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
        const STEPS: u32 = 200;
        let share = |step: u32| f64::from(step) / f64::from(STEPS);
        let points = (0..=STEPS).flat_map(|row| (0..=STEPS).map(move |column| [share(column), share(row)]));
        let moved = points.map(|[u, v]| {
            let behind = DVec2::new((u - k.cx) / k.fx, (v - k.cy) / k.fy);
            let moved = behind.normalize_or_zero() * (inverted(lens, behind.length()) - behind.length());
            (moved.x * k.fx * f64::from(size.width)).hypot(moved.y * k.fy * f64::from(size.height))
        });
        moved.fold(0.0, f64::maximum_of)
    }

    fn intrinsics(size: ImageSize, [cx, cy]: [f64; 2]) -> NormalizedIntrinsics {
        let fy = 0.805_002;
        NormalizedIntrinsics::new(fy * f64::from(size.height) / f64::from(size.width), fy, cx, cy).unwrap()
    }

    const WIDE: ImageSize = ImageSize { width: 480, height: 270 };
    /// Those of yards-test-00002562.
    const CANCELLING: [f64; 2] = [-0.026_219, 0.016_317];

    /// Coefficients of opposite sign, of equal sign, and one alone; principal points off the centre.
    #[test]
    fn the_largest_displacement_is_found_inside_the_image_or_at_its_farthest_corner() {
        let tall = ImageSize { width: 200, height: 300 };
        for lens in [CANCELLING, [0.02, -0.012], [-0.03, -0.01], [0.01, 0.02], [-0.02, 0.0], [0.0, 0.015]] {
            for (principal_point, size) in [([0.5, 0.5], WIDE), ([0.2, 0.6], WIDE), ([0.7, 0.1], tall)] {
                let k = intrinsics(size, principal_point);
                let lens = unfolded(lens, farthest_corner(&k));
                let pixels = displacement_in_image(lens, &k, size) * f64::from(size.width);
                let what = format!("{lens:?}, {size}, {principal_point:?}");
                Tolerance::relative(1e-6).assert([pixels], [by_grid(lens, &k, size)], &what);
            }
        }
    }

    /// At a distance of 1.20 from the axis, to where the lens moved a point at 1.346, by 7 % of the width; a point that is at 1.20
    /// before the lens moves by 5 %.
    #[test]
    fn the_corner_is_a_point_behind_the_lens() {
        let size = ImageSize { width: 640, height: 360 };
        let fy = 0.85;
        let k = NormalizedIntrinsics::new(fy * 360.0 / 640.0, fy, 0.5, 0.5).unwrap();
        let share = displacement_in_image([-0.06, 0.0], &k, size);
        Tolerance::absolute(5e-5).assert([share], [0.07], "of the width");
    }

    /// Whether a lens can be inverted in the image's farthest corner, and the slope along the radius there is large enough.
    fn is_steep(lens: [f64; 2], k: &NormalizedIntrinsics) -> bool {
        let lens = radial(lens).lens().unwrap();
        let far = |c: f64| if c > 0.5 { 0.0 } else { 1.0 };
        let corner = DVec2::new((far(k.cx) - k.cx) / k.fx, (far(k.cy) - k.cy) / k.fy);
        let straight = lens.undistorted_from_distorted(corner);
        straight.is_ok_and(|straight| (lens.jacobian(straight).unwrap() * corner.normalize()).length() > MIN_SLOPE)
    }

    /// The first is the lens of rooms-train-00000292 at 640×360. Without a repair, all but the last three fold inside the image.
    #[test]
    fn a_lens_is_weakened_only_as_far_as_the_image_needs() {
        let (wide, banner) = (ImageSize { width: 640, height: 360 }, ImageSize { width: 1024, height: 256 });
        for (lens, size, principal_point, halvings) in [
            ([-0.0861, -0.0083], wide, [0.5, 0.5], 1),
            ([-0.06, 0.0], wide, [0.2, 0.6], 1),
            ([-0.04, -0.002], banner, [0.5, 0.5], 2),
            ([0.0, -0.2], wide, [0.5, 0.5], 3),
            ([-0.06, 0.0], wide, [0.5, 0.5], 0),
            ([-0.04, 0.002], banner, [0.5, 0.5], 0),
            ([0.03, 0.02], banner, [0.1, 0.5], 0),
        ] {
            let k = intrinsics(size, principal_point);
            let found = unfolded(lens, farthest_corner(&k));
            let what = format!("{lens:?}, {size}, {principal_point:?}");
            let expected = lens.map(|k| k / f64::from(1 << halvings));
            Tolerance::EXACT.assert(found, expected, &what);
            assert!(is_steep(found, &k), "{what}");
            assert!(halvings == 0 || !is_steep(found.map(|k| k * 2.0), &k), "{what}: twice as strong");
        }
    }

    #[test]
    fn a_lens_that_cancels_in_the_corners_moves_the_image_between() {
        let k = intrinsics(WIDE, [0.5, 0.5]);
        let squared = (0.5 / k.fx).powi(2) + (0.5 / k.fy).powi(2);
        let [k1, k2] = CANCELLING;
        let corner = (k1 * squared + k2 * squared * squared).abs() * squared.sqrt() * k.fx * 480.0;
        let largest = displacement_in_image(CANCELLING, &k, WIDE) * 480.0;
        assert!(corner < 0.02 && (2.1..2.2).contains(&largest), "{corner} px in a corner, {largest} px at most");
    }
}
