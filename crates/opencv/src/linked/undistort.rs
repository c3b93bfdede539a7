use atsplat_camera::{Camera, Distortion, ImageSize, Lens, NormalizedIntrinsics, PixelIntrinsics};
use atsplat_pixels::ImageU8;
use glam::DVec2;

use ::opencv::calib3d::{estimate_new_camera_matrix_for_undistort_rectify, get_optimal_new_camera_matrix};
use ::opencv::core::{BORDER_CONSTANT, Mat, Matx33d, Scalar, Size, Vec2f, Vector};
use ::opencv::imgproc::{INTER_LINEAR, remap};
use ::opencv::prelude::*;

use super::{OpenCvError, called, mat_from_image, side};

/// Outside of any image: the map's value for rays outside the domain of the lens model.
const NOWHERE: f32 = -1e6;

/// The pinhole camera of the undistorted image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum UndistortMode {
    /// The same K: the scale at the principal point is unchanged, and parts of the border may be black.
    #[default]
    KeepK,
    /// A new K without black border, as Long-LRM and iLRM-wide undistort DL3DV (Long-LRM `data/prosess_dl3dv.py:20-62`):
    /// `cv2.getOptimalNewCameraMatrix` with `alpha = 0`, then `cv2.undistort`. Like theirs it passes K to OpenCV
    /// unchanged, although OpenCV's origin is the centre of the first pixel: an error of half a pixel times the lens's
    /// local change of scale. A fisheye, which their data does not contain, uses `cv2.fisheye`'s estimate with
    /// `balance = 0`. Their script skips portrait captures; here they are undistorted too.
    LongLrm,
}

/// Undistorts images of one size from one camera; the map is computed once.
///
/// Rays outside the domain of the lens model (beyond its fold) are black, where OpenCV's own map mirrors parts of the
/// image into the border. Sampling is bilinear, as in `cv2.undistort`.
#[derive(Debug)]
pub struct Undistorter {
    size: ImageSize,
    intrinsics: NormalizedIntrinsics,
    /// `None` for a pinhole, whose images are unchanged.
    map: Option<Mat>,
}

impl Undistorter {
    /// An undistorter of images of `size` from `camera`.
    ///
    /// # Errors
    /// [`OpenCvError::Lens`] for invalid coefficients or intrinsics, [`OpenCvError::Call`].
    pub fn new(camera: &Camera, size: ImageSize, mode: UndistortMode) -> Result<Self, OpenCvError> {
        let invalid = |source| OpenCvError::Lens { source };
        if camera.distortion == Distortion::None {
            return Ok(Self { size, intrinsics: camera.intrinsics, map: None });
        }
        let lens = camera.distortion.lens().map_err(invalid)?;
        let distorted = camera.intrinsics.pixel_from_normalized(size);
        let (undistorted, first_pixel) = match mode {
            UndistortMode::KeepK => (distorted, 0.5),
            UndistortMode::LongLrm => (long_lrm_intrinsics(&distorted, &camera.distortion, size)?, 0.0),
        };
        let intrinsics = undistorted.normalized_from_pixel(size).map_err(invalid)?;
        let map = source_map(&lens, &distorted, &undistorted, size, first_pixel)?;
        Ok(Self { size, intrinsics, map: Some(map) })
    }

    /// Intrinsics of the undistorted images, which have the same size and no distortion.
    pub const fn intrinsics(&self) -> NormalizedIntrinsics {
        self.intrinsics
    }

    /// The image as taken by a pinhole camera with [`Self::intrinsics`].
    ///
    /// # Errors
    /// [`OpenCvError::ImageSize`] for an image of another size, [`OpenCvError::Call`].
    pub fn undistort(&self, image: &ImageU8) -> Result<ImageU8, OpenCvError> {
        let found = ImageSize { width: image.width(), height: image.height() };
        if found != self.size {
            return Err(OpenCvError::ImageSize { expected: self.size, found });
        }
        let Some(map) = &self.map else { return Ok(image.clone()) };
        let undistorted = sampled(&mat_from_image(image)?, map)?;
        let samples = called("reading an image", undistorted.data_bytes())?.to_vec();
        #[expect(clippy::expect_used, reason = "the map has the image's size")]
        let undistorted = ImageU8::new(found.width, found.height, samples).expect("as many samples as the input");
        Ok(undistorted)
    }
}

/// For each pixel of the undistorted image, the position of the same ray in the distorted one, as (column, row) from
/// the centre of the first pixel. `first_pixel` is the coordinate of that centre under K: 0.5, or 0 if K is passed to
/// OpenCV unchanged.
fn source_map(
    lens: &Lens,
    distorted: &PixelIntrinsics,
    undistorted: &PixelIntrinsics,
    size: ImageSize,
    first_pixel: f64,
) -> Result<Mat, OpenCvError> {
    let k = distorted;
    let pixel_from_plane = |point: DVec2| DVec2::new(point.x * k.fx + k.cx, point.y * k.fy + k.cy);
    let mut positions = Vec::new();
    for row in 0..size.height {
        for column in 0..size.width {
            let pixel = DVec2::new(f64::from(column), f64::from(row)) + first_pixel;
            let ray =
                DVec2::new((pixel.x - undistorted.cx) / undistorted.fx, (pixel.y - undistorted.cy) / undistorted.fy);
            let position = lens.distorted_from_undistorted(ray).map(|point| pixel_from_plane(point) - first_pixel);
            positions.push(Vec2f::from(position.map_or([NOWHERE; 2], |position| position.as_vec2().to_array())));
        }
    }
    let rows = side(size.height)?;
    let flat = called("laying out a map", Mat::from_slice(&positions))?;
    let shaped = called("laying out a map", flat.reshape(2, rows))?;
    called("laying out a map", shaped.try_clone())
}

fn sampled(image: &Mat, map: &Mat) -> Result<Mat, OpenCvError> {
    let mut output = Mat::default();
    let black = Scalar::all(0.0);
    called("undistorting", remap(image, &mut output, map, &Mat::default(), INTER_LINEAR, BORDER_CONSTANT, black))?;
    Ok(output)
}

fn long_lrm_intrinsics(
    k: &PixelIntrinsics,
    distortion: &Distortion,
    size: ImageSize,
) -> Result<PixelIntrinsics, OpenCvError> {
    let matrix = matrix_of(k);
    let cv_size = Size::new(side(size.width)?, side(size.height)?);
    let action = "choosing a new camera matrix";
    let new = match *distortion {
        Distortion::None => return Ok(*k),
        Distortion::OpenCv { k1, k2, k3, p1, p2 } => {
            let coefficients = Vector::from_slice(&[k1, k2, p1, p2, k3]);
            let alpha = 0.0;
            called(action, get_optimal_new_camera_matrix(&matrix, &coefficients, cv_size, alpha, cv_size, None, false))?
        }
        Distortion::Fisheye { k } => {
            let (coefficients, upright) = (Vector::from_slice(&k), Matx33d::eye());
            let (balance, same_field) = (0.0, 1.0);
            let mut new = Mat::default();
            let estimated = estimate_new_camera_matrix_for_undistort_rectify(
                &matrix,
                &coefficients,
                cv_size,
                &upright,
                &mut new,
                balance,
                cv_size,
                same_field,
            );
            called(action, estimated)?;
            new
        }
    };
    let entry = |row: i32, column: i32| called(action, new.at_2d::<f64>(row, column)).copied();
    PixelIntrinsics::new(entry(0, 0)?, entry(1, 1)?, entry(0, 2)?, entry(1, 2)?)
        .map_err(|source| OpenCvError::Lens { source })
}

fn matrix_of(k: &PixelIntrinsics) -> Matx33d {
    Matx33d::from_array([k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linked::test_images::{level, shifted_noise};
    use ::opencv::calib3d::undistort;
    use atsplat_camera::CameraFromWorld;

    const SIZE: ImageSize = ImageSize { width: 320, height: 240 };
    const BARREL: Distortion = Distortion::OpenCv { k1: -0.2, k2: 0.03, k3: 0.0, p1: 1e-3, p2: -5e-4 };
    const FISHEYE: Distortion = Distortion::Fisheye { k: [-0.02, 0.004, 0.0, 0.0] };

    fn camera(distortion: Distortion) -> Camera {
        let intrinsics = NormalizedIntrinsics::new(0.7, 0.7 * 320.0 / 240.0, 0.51, 0.49).unwrap();
        Camera { camera_from_world: CameraFromWorld::IDENTITY, intrinsics, distortion }
    }

    /// The plane z = 1 seen through `camera`, with dark lines `X = n · step` and `Y = n · step` on white.
    fn grid(camera: &Camera, step: f64) -> ImageU8 {
        let k = camera.intrinsics.pixel_from_normalized(SIZE);
        let lens = camera.distortion.lens().unwrap();
        let mut samples = Vec::new();
        for row in 0..SIZE.height {
            for column in 0..SIZE.width {
                let pixel = DVec2::new(f64::from(column), f64::from(row)) + 0.5;
                let distorted = DVec2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy);
                let ray = lens.undistorted_from_distorted(distorted).unwrap();
                // Soft lines, so that sampling between pixels is accurate.
                let line = |x: f64| (std::f64::consts::PI * x / step).cos().powi(8);
                let dark = 1.0 - (1.0 - line(ray.x)) * (1.0 - line(ray.y));
                samples.extend([level(255.0 - 200.0 * dark); 3]);
            }
        }
        ImageU8::new(SIZE.width, SIZE.height, samples).unwrap()
    }

    fn largest_difference(a: &ImageU8, b: &ImageU8, border: u32) -> u8 {
        let inner =
            |x: u32, y: u32| (border..SIZE.width - border).contains(&x) && (border..SIZE.height - border).contains(&y);
        let pixels = (0..SIZE.height).flat_map(|y| (0..SIZE.width).map(move |x| (x, y)));
        pixels
            .filter(|(x, y)| inner(*x, *y))
            .filter_map(|(x, y)| Some(a.pixel(x, y)?[0].abs_diff(b.pixel(x, y)?[0])))
            .max()
            .unwrap_or(u8::MAX)
    }

    #[test]
    fn undistorted_lines_match_those_of_a_pinhole() {
        for distortion in [BARREL, FISHEYE] {
            let distorted = grid(&camera(distortion), 0.2);
            let straight = Undistorter::new(&camera(distortion), SIZE, UndistortMode::KeepK).unwrap();
            assert_eq!(straight.intrinsics(), camera(distortion).intrinsics);
            let pinhole = Camera { distortion: Distortion::None, ..camera(distortion) };
            let difference = largest_difference(&straight.undistort(&distorted).unwrap(), &grid(&pinhole, 0.2), 2);
            // Bilinear sampling of a soft line changes it by a few levels; a shift by half a pixel by over 20.
            assert!(difference <= 8, "{distortion:?}: off by {difference} levels");
            assert!(largest_difference(&distorted, &grid(&pinhole, 0.2), 2) > 60, "the distortion is visible");
        }
    }

    #[test]
    fn long_lrm_mode_matches_opencv_undistort() {
        let Distortion::OpenCv { k1, k2, k3, p1, p2 } = BARREL else { unreachable!() };
        let camera = camera(BARREL);
        let image = shifted_noise(SIZE.width, SIZE.height, 0, 0);
        let ours = Undistorter::new(&camera, SIZE, UndistortMode::LongLrm).unwrap();
        assert_ne!(ours.intrinsics(), camera.intrinsics);

        let matrix = |k: PixelIntrinsics| matrix_of(&k);
        let (old, new) =
            (matrix(camera.intrinsics.pixel_from_normalized(SIZE)), ours.intrinsics().pixel_from_normalized(SIZE));
        let mut theirs = Mat::default();
        let coefficients = Vector::from_slice(&[k1, k2, p1, p2, k3]);
        undistort(&mat_from_image(&image).unwrap(), &mut theirs, &old, &coefficients, &matrix(new)).unwrap();
        let theirs = ImageU8::new(SIZE.width, SIZE.height, theirs.data_bytes().unwrap().to_vec()).unwrap();
        let difference = largest_difference(&ours.undistort(&image).unwrap(), &theirs, 0);
        assert!(
            difference <= 2,
            "{difference} levels: both round positions to 1/32 pixel, from maps of different precision"
        );
    }

    #[test]
    fn a_pincushion_has_a_black_border_with_keep_k_but_not_with_alpha_zero() {
        let pincushion = Distortion::OpenCv { k1: 0.15, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        let white = ImageU8::new(SIZE.width, SIZE.height, vec![255; 320 * 240 * 3]).unwrap();
        let black_share = |mode| {
            let undistorter = Undistorter::new(&camera(pincushion), SIZE, mode).unwrap();
            let image = undistorter.undistort(&white).unwrap();
            image.samples().iter().filter(|sample| **sample < u8::MAX).count() as f64 / f64::from(320 * 240 * 3)
        };
        let [keep, fit] = [UndistortMode::KeepK, UndistortMode::LongLrm].map(black_share);
        assert!(keep > 0.02 && fit < 0.01, "{keep} {fit}");
    }

    #[test]
    fn rays_beyond_the_fold_are_black() {
        let mut wide = camera(Distortion::OpenCv { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 });
        wide.intrinsics = NormalizedIntrinsics::new(0.3, 0.4, 0.5, 0.5).unwrap();
        let straight = Undistorter::new(&wide, SIZE, UndistortMode::KeepK).unwrap();
        let white = ImageU8::new(SIZE.width, SIZE.height, vec![255; 320 * 240 * 3]).unwrap();
        let image = straight.undistort(&white).unwrap();
        assert_eq!(image.pixel(0, 0), Some([0; 3]), "the corner's ray is beyond the fold");
        assert_eq!(image.pixel(160, 120), Some([255; 3]));
    }

    #[test]
    fn a_pinhole_is_unchanged_and_other_sizes_are_errors() {
        let straight = Undistorter::new(&camera(Distortion::None), SIZE, UndistortMode::LongLrm).unwrap();
        let image = shifted_noise(SIZE.width, SIZE.height, 3, 3);
        assert_eq!(straight.undistort(&image).unwrap(), image);
        assert_eq!(straight.intrinsics(), camera(Distortion::None).intrinsics);
        let other = shifted_noise(32, 24, 0, 0);
        assert!(matches!(straight.undistort(&other), Err(OpenCvError::ImageSize { .. })));
        let nan = camera(Distortion::Fisheye { k: [f64::NAN; 4] });
        assert!(matches!(Undistorter::new(&nan, SIZE, UndistortMode::KeepK), Err(OpenCvError::Lens { .. })));
    }
}
