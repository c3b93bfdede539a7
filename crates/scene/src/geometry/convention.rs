use std::fmt;

use atsplat_camera::{Camera, CameraFromWorld, Distortion, NormalizedIntrinsics};
use serde::{Deserialize, Serialize};

use super::View;

/// Focal lengths that differ by less than this fraction count as equal.
const SAME_FOCAL: f64 = 0.01;

/// An interpretation of a camera file's numbers: as declared, or with one of the field's common mistakes.
///
/// The pose interpretations are complete for cameras in OpenCV or OpenGL axes stored in either direction: epipolar
/// lines do not change under a rotation of the world, and up to that all eight combinations of what was stored and what
/// was assumed are one of these four.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Convention {
    /// As the loader understood them.
    Declared,
    /// World-to-camera and camera-to-world exchanged.
    PoseInverted,
    /// OpenGL (+y up, +z back) and OpenCV (+y down, +z forward) camera axes exchanged.
    AxesFlipped,
    /// Both of the above.
    PoseInvertedAxesFlipped,
    /// The true focal lengths are half the declared ones.
    FocalHalved,
    /// The true focal lengths are twice the declared ones.
    FocalDoubled,
    /// fx and fy exchanged, or each divided by the other side of the image.
    FocalExchanged,
    /// fy is right and pixels are square; fx belongs to an image of another width (RE10K's 640×360 intrinsics used with
    /// square centre crops).
    FocalFromFy,
    /// fx is right and pixels are square; fy belongs to an image of another height.
    FocalFromFx,
    /// The images are already undistorted, though a lens is declared.
    NoDistortion,
}

impl Convention {
    /// All interpretations, the declared one first.
    pub const ALL: [Self; 10] = [
        Self::Declared,
        Self::PoseInverted,
        Self::AxesFlipped,
        Self::PoseInvertedAxesFlipped,
        Self::FocalHalved,
        Self::FocalDoubled,
        Self::FocalExchanged,
        Self::FocalFromFy,
        Self::FocalFromFx,
        Self::NoDistortion,
    ];

    /// The stable name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Declared => "declared",
            Self::PoseInverted => "pose-inverted",
            Self::AxesFlipped => "axes-flipped",
            Self::PoseInvertedAxesFlipped => "pose-inverted-axes-flipped",
            Self::FocalHalved => "focal-halved",
            Self::FocalDoubled => "focal-doubled",
            Self::FocalExchanged => "focal-exchanged",
            Self::FocalFromFy => "focal-from-fy",
            Self::FocalFromFx => "focal-from-fx",
            Self::NoDistortion => "no-distortion",
        }
    }

    /// A description of the suspected mistake, as a clause.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Declared => "poses, axes, focal lengths and lens are what the format declares",
            Self::PoseInverted => "poses look inverted: world-to-camera and camera-to-world are exchanged",
            Self::AxesFlipped => "camera axes look flipped: OpenGL and OpenCV axes are exchanged",
            Self::PoseInvertedAxesFlipped => {
                "poses look inverted and flipped: directions and OpenGL/OpenCV axes are both exchanged"
            }
            Self::FocalHalved => "focal lengths look twice too long",
            Self::FocalDoubled => "focal lengths look twice too short",
            Self::FocalExchanged => "fx and fy look exchanged, or divided by the other side of the image",
            Self::FocalFromFy => "fx looks as if it belonged to an image of another width; fy with square pixels fits",
            Self::FocalFromFx => "fy looks as if it belonged to an image of another height; fx with square pixels fits",
            Self::NoDistortion => "images look undistorted already, though a lens distortion is declared",
        }
    }

    /// The view under this interpretation; `None` if that equals the declared view, or is not a valid camera.
    pub fn reinterpret(self, view: &View) -> Option<View> {
        let Camera { camera_from_world, intrinsics: k, distortion } = view.camera;
        let world_from_camera = camera_from_world.inverse();
        let posed = |pose: CameraFromWorld| Camera { camera_from_world: pose, ..view.camera };
        let focal = |fx: f64, fy: f64| {
            let differs = (fx / k.fx - 1.0).abs() > SAME_FOCAL || (fy / k.fy - 1.0).abs() > SAME_FOCAL;
            let intrinsics = NormalizedIntrinsics::new(fx, fy, k.cx, k.cy).ok().filter(|_| differs)?;
            Some(Camera { intrinsics, ..view.camera })
        };
        let inverted = || CameraFromWorld::from_rows(&world_from_camera.to_rows()).ok();
        let aspect = f64::from(view.size.width) / f64::from(view.size.height);
        let camera = match self {
            Self::Declared => Some(view.camera),
            Self::PoseInverted => inverted().map(posed),
            Self::AxesFlipped => Some(posed(world_from_camera.opencv_from_opengl().inverse())),
            Self::PoseInvertedAxesFlipped => {
                inverted().map(|pose| posed(pose.inverse().opencv_from_opengl().inverse()))
            }
            Self::FocalHalved => focal(0.5 * k.fx, 0.5 * k.fy),
            Self::FocalDoubled => focal(2.0 * k.fx, 2.0 * k.fy),
            Self::FocalExchanged => focal(k.fy, k.fx),
            Self::FocalFromFy => focal(k.fy / aspect, k.fy),
            Self::FocalFromFx => focal(k.fx, k.fx * aspect),
            Self::NoDistortion => {
                (distortion != Distortion::None).then_some(Camera { distortion: Distortion::None, ..view.camera })
            }
        };
        camera.map(|camera| View { camera, ..*view })
    }
}

impl fmt::Display for Convention {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::synthetic::view;
    use atsplat_numeric::Tolerance;

    /// One that is not would never be scored.
    #[test]
    fn all_conventions_are_in_the_list_of_all() {
        let unknown = serde_json::from_value::<Convention>("".into()).unwrap_err().to_string();
        let all = Convention::ALL.map(|convention| format!("`{}`", convention.name())).join(", ");
        assert_eq!(unknown, format!("unknown variant ``, expected one of {all}"));
    }

    #[test]
    fn pose_interpretations_are_involutions() {
        let view = view([0.3, -0.2, 0.1], [1.0, 2.0, 3.0]);
        for convention in [Convention::PoseInverted, Convention::AxesFlipped] {
            let twice = convention.reinterpret(&convention.reinterpret(&view).unwrap()).unwrap();
            let (back, before) = (twice.camera.camera_from_world, view.camera.camera_from_world);
            Tolerance::F64.assert(back.to_rows(), before.to_rows(), convention.name());
        }
    }

    #[test]
    fn interpretations_that_change_nothing_do_not_apply() {
        let mut square = view([0.0; 3], [0.0; 3]);
        assert!(Convention::FocalFromFy.reinterpret(&square).is_none(), "pixels are square already");
        assert!(Convention::NoDistortion.reinterpret(&square).is_none(), "there is no lens");
        square.camera.intrinsics.fx = square.camera.intrinsics.fy;
        assert!(Convention::FocalExchanged.reinterpret(&square).is_none(), "fx = fy");
    }

    #[test]
    fn square_pixels_restore_the_focal_length_of_a_centre_crop() {
        // RE10K: fx of 640×360, used with a 256×256 crop of the full height.
        let mut cropped = view([0.0; 3], [0.0; 3]);
        cropped.size = atsplat_camera::ImageSize { width: 256, height: 256 };
        cropped.camera.intrinsics = NormalizedIntrinsics::new(0.482, 0.482 * 640.0 / 360.0, 0.5, 0.5).unwrap();
        let right = Convention::FocalFromFy.reinterpret(&cropped).unwrap().camera.intrinsics;
        Tolerance::F64.assert([right.fx], [0.482 * 640.0 / 360.0], "fx");
    }

    #[test]
    fn names_match_serde() {
        for convention in Convention::ALL {
            assert_eq!(serde_json::to_value(convention).unwrap(), convention.name());
        }
    }
}
