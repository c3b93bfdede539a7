//! Radial distortion in OpenCV's model.

use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Extremes as _;

use super::SceneContext;

/// Largest displacement that counts as no distortion, in pixels.
const STRAIGHT: f64 = 0.05;
/// Smallest derivative of the distorted radius by the undistorted one inside an image. Where it is 0, the lens folds; just before,
/// the rays of a pixel would spread far.
const LEAST_SLOPE: f64 = 0.3;
/// Narrower images count as this wide: a small image of a scene has the lens of a larger one.
const NARROWEST: u32 = 256;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let [k1, k2] = lens(scene);
    let shares = scene.shots.iter().map(|shot| displacement([k1, k2], &shot.camera.intrinsics, scene.size));
    let share = shares.fold(0.0, f64::maximum_of);
    let pixels = share * f64::from(scene.size.width.max(NARROWEST));
    (pixels > STRAIGHT)
        .then(|| format!("k1 = {k1:.3}, k2 = {k2:.3} move the image by up to {:.2} % of its width", share * 100.0))
}

/// The scene's lens; none if its coefficients are 0.
pub(super) fn distortion(scene: &SceneContext<'_>) -> Distortion {
    let [k1, k2] = lens(scene);
    let straight = k1.abs() + k2.abs() <= 0.0;
    if straight { Distortion::None } else { Distortion::OpenCv { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 } }
}

/// The drawn k1, k2, halved until the lens is invertible in all images with a margin.
fn lens(scene: &SceneContext<'_>) -> [f64; 2] {
    let corners = scene.shots.iter().map(|shot| farthest_corner(&shot.camera.intrinsics));
    unfolded(scene.conditions.lens, corners.fold(0.0, f64::maximum_of))
}

/// Halves k1, k2 until [`LEAST_SLOPE`] is kept out to image points at this squared distance from the optical axis.
fn unfolded(mut lens: [f64; 2], farthest: f64) -> [f64; 2] {
    while reach(lens) < farthest {
        lens = lens.map(|k| k / 2.0);
    }
    lens
}

/// Squared distance from the optical axis, on the plane z = 1 behind the lens, out to which [`LEAST_SLOPE`] is kept.
fn reach([k1, k2]: [f64; 2]) -> f64 {
    // The slope at a squared undistorted distance s is 1 + 3 k1 s + 5 k2 s²; of its two points at `LEAST_SLOPE`, the nearer.
    let twice_lost = 2.0 * (1.0 - LEAST_SLOPE);
    let divisor = (9.0 * k1 * k1 - 10.0 * k2 * twice_lost).sqrt() - 3.0 * k1;
    if divisor > 0.0 {
        let squared = twice_lost / divisor;
        squared * (1.0 + k1 * squared + k2 * squared * squared).powi(2)
    } else {
        f64::INFINITY
    }
}

/// Squared distance of the image's farthest corner from the optical axis, on the plane z = 1.
fn farthest_corner(k: &NormalizedIntrinsics) -> f64 {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let squared = corners.map(|[x, y]: [f64; 2]| ((x - k.cx) / k.fx).powi(2) + ((y - k.cy) / k.fy).powi(2));
    squared.into_iter().fold(0.0, f64::maximum_of)
}

/// Largest displacement of an image point, as a share of the image's width. On the plane z = 1, the lens moves a point at a
/// distance r from the optical axis by k1 r³ + k2 r⁵: most at the farthest corner or where the derivative is zero.
fn displacement([k1, k2]: [f64; 2], k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
    let farthest = farthest_corner(k);
    let moved = |squared: f64| (k1 * squared + k2 * squared * squared).abs() * squared.sqrt();
    let stationary = Some(-0.6 * k1 / k2).filter(|squared| (0.0..farthest).contains(squared));
    let largest = moved(farthest).maximum_of(stationary.map_or(0.0, moved));
    largest * k.fx.maximum_of(k.fy * f64::from(size.height) / f64::from(size.width))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::DVec2;

    use super::*;

    /// The largest displacement over a grid of image points, in pixels.
    fn by_grid([k1, k2]: [f64; 2], k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
        const STEPS: u32 = 200;
        let share = |step: u32| f64::from(step) / f64::from(STEPS);
        let points = (0..=STEPS).flat_map(|row| (0..=STEPS).map(move |column| [share(column), share(row)]));
        let moved = points.map(|[u, v]| {
            let (x, y) = ((u - k.cx) / k.fx, (v - k.cy) / k.fy);
            let squared = x * x + y * y;
            let stretched = k1 * squared + k2 * squared * squared;
            let (right, down) = (stretched * x * k.fx, stretched * y * k.fy);
            (right * f64::from(size.width)).hypot(down * f64::from(size.height))
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
                let pixels = displacement(lens, &k, size) * f64::from(size.width);
                let what = format!("{lens:?}, {size}, {principal_point:?}");
                Tolerance::relative(1e-6).assert([pixels], [by_grid(lens, &k, size)], &what);
            }
        }
    }

    /// Whether a lens can be inverted in the image's farthest corner, and the slope along the radius there is large enough.
    fn is_steep([k1, k2]: [f64; 2], k: &NormalizedIntrinsics) -> bool {
        let lens = Distortion::OpenCv { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 }.lens().unwrap();
        let far = |c: f64| if c > 0.5 { 0.0 } else { 1.0 };
        let corner = DVec2::new((far(k.cx) - k.cx) / k.fx, (far(k.cy) - k.cy) / k.fy);
        let straight = lens.undistorted_from_distorted(corner);
        straight.is_ok_and(|straight| (lens.jacobian(straight).unwrap() * corner.normalize()).length() > LEAST_SLOPE)
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
        let largest = displacement(CANCELLING, &k, WIDE) * 480.0;
        assert!(corner < 0.02 && (2.1..2.2).contains(&largest), "{corner} px in a corner, {largest} px at most");
    }
}
