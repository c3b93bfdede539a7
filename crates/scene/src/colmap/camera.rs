use std::path::Path;

use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics, PixelIntrinsics};

use crate::SceneError;

/// COLMAP's camera models, by the numbers that binary files use (colmap
/// `src/colmap/sensor/models.h`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
#[expect(missing_docs, reason = "the names are COLMAP's")]
pub enum ColmapCameraModel {
    SimplePinhole = 0,
    Pinhole = 1,
    SimpleRadial = 2,
    Radial = 3,
    OpenCv = 4,
    OpenCvFisheye = 5,
    FullOpenCv = 6,
    Fov = 7,
    SimpleRadialFisheye = 8,
    RadialFisheye = 9,
    ThinPrismFisheye = 10,
    RadTanThinPrismFisheye = 11,
    SimpleDivision = 12,
    Division = 13,
    SimpleFisheye = 14,
    Fisheye = 15,
    Eucm = 16,
    Equirectangular = 17,
}

use ColmapCameraModel as Model;

/// Each model's name in text files and number of parameters.
const MODELS: [(Model, &str, usize); 18] = [
    (Model::SimplePinhole, "SIMPLE_PINHOLE", 3),
    (Model::Pinhole, "PINHOLE", 4),
    (Model::SimpleRadial, "SIMPLE_RADIAL", 4),
    (Model::Radial, "RADIAL", 5),
    (Model::OpenCv, "OPENCV", 8),
    (Model::OpenCvFisheye, "OPENCV_FISHEYE", 8),
    (Model::FullOpenCv, "FULL_OPENCV", 12),
    (Model::Fov, "FOV", 5),
    (Model::SimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 4),
    (Model::RadialFisheye, "RADIAL_FISHEYE", 5),
    (Model::ThinPrismFisheye, "THIN_PRISM_FISHEYE", 12),
    (Model::RadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
    (Model::SimpleDivision, "SIMPLE_DIVISION", 4),
    (Model::Division, "DIVISION", 5),
    (Model::SimpleFisheye, "SIMPLE_FISHEYE", 3),
    (Model::Fisheye, "FISHEYE", 4),
    (Model::Eucm, "EUCM", 6),
    (Model::Equirectangular, "EQUIRECTANGULAR", 2),
];

impl ColmapCameraModel {
    /// The model that text files write as `name`.
    pub fn from_name(name: &str) -> Option<Self> {
        MODELS.iter().find(|(_, known, _)| *known == name).map(|(model, _, _)| *model)
    }

    /// The model that binary files write as `number`.
    pub fn from_number(number: i32) -> Option<Self> {
        MODELS.iter().find(|(model, _, _)| *model as i32 == number).map(|(model, _, _)| *model)
    }

    /// COLMAP's name.
    pub fn name(self) -> &'static str {
        self.entry().1
    }

    /// Number of parameters of a camera of this model.
    pub fn parameter_count(self) -> usize {
        self.entry().2
    }

    fn entry(self) -> (Self, &'static str, usize) {
        let entry = MODELS.into_iter().find(|(model, _, _)| *model == self);
        entry.unwrap_or_else(|| unreachable!("MODELS lists every model"))
    }
}

/// One entry of `cameras.txt` or `cameras.bin`: lens and image size, without a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// The camera model that the parameters belong to.
    pub model: ColmapCameraModel,
    /// Image size in pixels; not empty.
    pub size: ImageSize,
    /// [`ColmapCameraModel::parameter_count`] numbers in COLMAP's order; lengths in pixels, with pixel centres at + 0.5.
    pub parameters: Vec<f64>,
}

impl ColmapCamera {
    /// Intrinsics and distortion of the camera. `location` and `path` are for messages.
    ///
    /// # Errors
    /// [`SceneError::UnsupportedCameraModel`] for a model that none of pinhole, `OPENCV` (k1, k2, k3, p1, p2) and
    /// `OPENCV_FISHEYE` covers; [`SceneError::Camera`] for invalid numbers.
    pub fn lens(&self, location: &str, path: &Path) -> Result<(NormalizedIntrinsics, Distortion), SceneError> {
        let unsupported = |reason| SceneError::unsupported_model(path, location, self.model.name(), reason);
        let camera = |source| SceneError::camera(path, location)(source);
        let open_cv = |k1, k2, k3, p1, p2| {
            let pinhole = [k1, k2, k3, p1, p2].iter().all(|coefficient| *coefficient == 0.0);
            if pinhole { Distortion::None } else { Distortion::OpenCv { k1, k2, k3, p1, p2 } }
        };
        let ([fx, fy, cx, cy], distortion) = match (self.model, self.parameters.as_slice()) {
            (Model::SimplePinhole, &[f, cx, cy]) => ([f, f, cx, cy], Distortion::None),
            (Model::Pinhole, &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::None),
            (Model::SimpleRadial, &[f, cx, cy, k]) => ([f, f, cx, cy], open_cv(k, 0.0, 0.0, 0.0, 0.0)),
            (Model::Radial, &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], open_cv(k1, k2, 0.0, 0.0, 0.0)),
            (Model::OpenCv, &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy, cx, cy], open_cv(k1, k2, 0.0, p1, p2)),
            (Model::FullOpenCv, &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                if [k4, k5, k6].iter().any(|k| *k != 0.0) {
                    return Err(unsupported("the coefficients k4, k5, k6 of its denominator are not zero"));
                }
                ([fx, fy, cx, cy], open_cv(k1, k2, k3, p1, p2))
            }
            (Model::OpenCvFisheye, &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
                ([fx, fy, cx, cy], Distortion::Fisheye { k: [k1, k2, k3, k4] })
            }
            (Model::SimpleRadialFisheye, &[f, cx, cy, k]) => {
                ([f, f, cx, cy], Distortion::Fisheye { k: [k, 0.0, 0.0, 0.0] })
            }
            (Model::RadialFisheye, &[f, cx, cy, k1, k2]) => {
                ([f, f, cx, cy], Distortion::Fisheye { k: [k1, k2, 0.0, 0.0] })
            }
            (Model::SimpleFisheye, &[f, cx, cy]) => ([f, f, cx, cy], Distortion::Fisheye { k: [0.0; 4] }),
            (Model::Fisheye, &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::Fisheye { k: [0.0; 4] }),
            _ => return Err(unsupported("it is not a special case of PINHOLE, OPENCV or OPENCV_FISHEYE")),
        };
        if let Some(found) = self.parameters.iter().find(|parameter| !parameter.is_finite()) {
            return Err(camera(atsplat_camera::CameraError::NonFinite { field: "parameter", found: *found }));
        }
        let pixels = PixelIntrinsics::new(fx, fy, cx, cy).map_err(camera)?;
        let intrinsics = pixels.normalized_from_pixel(self.size).map_err(camera)?;
        Ok((intrinsics, distortion))
    }
}
