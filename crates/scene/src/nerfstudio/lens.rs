use std::path::Path;

use atsplat_camera::{Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use serde_json::Value;

use super::transforms::{FORMAT, Object};
use super::unread_fields::require_no_other_coefficients;
use crate::SceneError;

const UNSUPPORTED: &str = "neither perspective nor OPENCV_FISHEYE";

/// Difference of a focal length from that of a field of view in the same file above which they contradict each other.
/// Rounded angles and principal points off the centre differ by less than a hundredth.
const SAME_FOCAL: Tolerance = Tolerance::relative(0.05);

/// The intrinsics that a `transforms.json` states, globally or for one frame.
///
/// Lengths are in pixels of an image of `w` × `h`, the resolution that structure from motion ran at, which may differ
/// from that of all images on disk: they are always divided by `w` and `h` (depthsplat
/// `src/scripts/convert_dl3dv_test.py:90-129`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LensFields {
    /// Image width; may be written as a float.
    pub w: Option<f64>,
    /// Image height; may be written as a float.
    pub h: Option<f64>,
    /// Horizontal focal length.
    pub focal_x: Option<Focal>,
    /// Vertical focal length; if absent, the horizontal one in pixels (instant-ngp).
    pub focal_y: Option<Focal>,
    /// Horizontal and vertical field of view in radians that are stated in addition to a focal length or another field of
    /// view, and not used.
    pub angles: [Option<f64>; 2],
    /// Principal point column; the centre if absent.
    pub cx: Option<f64>,
    /// Principal point row; the centre if absent.
    pub cy: Option<f64>,
    /// Radial coefficients k1…k4, absent ones zero; `None` if all are absent. Nerfstudio's list `distortion_params` has
    /// these first, then p1 and p2.
    pub radial: Option<[f64; 4]>,
    /// Tangential coefficients p1, p2, an absent one zero; `None` if both are absent.
    pub tangential: Option<[f64; 2]>,
    /// Whether the lens is a fisheye (`OPENCV_FISHEYE`, instant-ngp's `is_fisheye`); `None` if not stated, which means a
    /// perspective lens.
    pub fisheye: Option<bool>,
}

/// A focal length in one of its two notations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focal {
    /// `fl_x`, `fl_y`: pixels.
    Pixels(f64),
    /// `camera_angle_x`, `camera_angle_y` in radians, or instant-ngp's `x_fov`, `y_fov` in degrees: the field of view,
    /// here in radians, in (0, π).
    Angle(f64),
}

/// A complete lens.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ResolvedLens {
    pub(super) intrinsics: NormalizedIntrinsics,
    pub(super) distortion: Distortion,
    /// The stated size if it is whole pixels.
    pub(super) size: Option<ImageSize>,
    /// How a focal length differs from the field of view that is also stated.
    pub(super) contradiction: Option<String>,
    /// Whether a focal length is in pixels and no principal point is stated. Files with a field of view alone mean the centre.
    pub(super) assumes_centre: bool,
}

impl LensFields {
    pub(super) fn read(object: &Object<'_>) -> Result<Self, SceneError> {
        let (radial, tangential) = read_coefficients(object)?;
        require_no_other_coefficients(object)?;
        let flag = object.value("is_fisheye").map(|_| object.flag("is_fisheye")).transpose()?;
        let of_model = match object.text("camera_model")? {
            Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE") => Some(false),
            Some("OPENCV_FISHEYE") => Some(true),
            Some(model) => {
                return Err(object.unsupported("camera_model", model, UNSUPPORTED));
            }
            None => None,
        };
        if let (Some(of_model), Some(flag)) = (of_model, flag)
            && of_model != flag
        {
            return Err(object.wrong("is_fisheye", &format!("{of_model}, as camera_model states"), &flag.to_string()));
        }
        for (field, model) in [("ftheta_p0", "FTheta"), ("latlong", "LatLong"), ("equirectangular", "Equirectangular")]
        {
            if object.value(field).is_some() {
                return Err(object.unsupported(field, model, UNSUPPORTED));
            }
        }
        let (focal_x, angle_x) = Focal::read(object, "fl_x", "x_fov", "camera_angle_x")?;
        let (focal_y, angle_y) = Focal::read(object, "fl_y", "y_fov", "camera_angle_y")?;
        Ok(Self {
            w: read_size(object, "w")?,
            h: read_size(object, "h")?,
            focal_x,
            focal_y,
            angles: [angle_x, angle_y],
            cx: object.number("cx")?,
            cy: object.number("cy")?,
            radial,
            tangential,
            fisheye: of_model.or(flag),
        })
    }

    /// A frame's fields, completed by the `global` ones.
    ///
    /// A frame that states any focal length states both axes: its `fl_x` alone is not paired with the global `fl_y`.
    /// Global lengths in pixels are scaled to the size of the frame if it states another one. Global coefficients are not those
    /// of a frame of another model, which would read them differently.
    pub(super) fn or(self, global: Self) -> Self {
        let global = global.scaled_to(self.w, self.h);
        let (focal_x, focal_y, angles) = match (self.focal_x, self.focal_y) {
            (None, None) => (global.focal_x, global.focal_y, global.angles),
            (focal_x, focal_y) => (focal_x, focal_y, self.angles),
        };
        let is_same_model = self.fisheye.is_none_or(|fisheye| fisheye == global.fisheye.unwrap_or(false));
        let (radial, tangential) = if is_same_model { (global.radial, global.tangential) } else { (None, None) };
        Self {
            w: self.w.or(global.w),
            h: self.h.or(global.h),
            focal_x,
            focal_y,
            angles,
            cx: self.cx.or(global.cx),
            cy: self.cy.or(global.cy),
            radial: self.radial.or(radial),
            tangential: self.tangential.or(tangential),
            fisheye: self.fisheye.or(global.fisheye),
        }
    }

    /// The fields with their lengths in pixels scaled to an image of another size.
    fn scaled_to(self, w: Option<f64>, h: Option<f64>) -> Self {
        let ratio = |new: Option<f64>, old: Option<f64>| new.zip(old).map_or(1.0, |(new, old)| new / old);
        let (x, y) = (ratio(w, self.w), ratio(h, self.h));
        let scaled = |focal: Option<Focal>, factor: f64| {
            focal.map(|focal| match focal {
                Focal::Pixels(pixels) => Focal::Pixels(pixels * factor),
                angle @ Focal::Angle(_) => angle,
            })
        };
        Self {
            focal_x: scaled(self.focal_x, x),
            focal_y: scaled(self.focal_y, y),
            cx: self.cx.map(|cx| cx * x),
            cy: self.cy.map(|cy| cy * y),
            ..self
        }
    }

    /// The fields with the size of an image, if none is stated (Blender's synthetic scenes).
    pub(super) fn of_image(self, image: Option<ImageSize>) -> Self {
        match (self.w, self.h, image) {
            (None, None, Some(size)) => {
                Self { w: Some(f64::from(size.width)), h: Some(f64::from(size.height)), ..self }
            }
            _ => self,
        }
    }

    /// Whether any length is stated in pixels.
    pub(super) const fn states_pixels(&self) -> bool {
        matches!(self.focal_x, Some(Focal::Pixels(_)))
            || matches!(self.focal_y, Some(Focal::Pixels(_)))
            || self.cx.is_some()
            || self.cy.is_some()
    }

    /// Whether both sides of the image are left to its file.
    pub(super) const fn states_no_size(&self) -> bool {
        self.w.is_none() && self.h.is_none()
    }

    /// The camera's lens.
    pub(super) fn resolve(&self, location: &str, path: &Path) -> Result<ResolvedLens, SceneError> {
        let malformed = |field: &str, expected: &str, found: &str| {
            SceneError::malformed(FORMAT, path, format!("{location}{field}"), expected, found)
        };
        let (width, height) = match (self.w, self.h) {
            (Some(width), Some(height)) => (width, height),
            (None, None) => {
                return Err(malformed("w, h", "the size of the images, or an image to take it from", "neither"));
            }
            // The other side of an image may be that of a scaled copy.
            (Some(_), None) => return Err(malformed("h", "both w and h, or neither", "only w")),
            (None, Some(_)) => return Err(malformed("w", "both w and h, or neither", "only h")),
        };
        if let Some(axis) = self.fisheye_axis_without_length() {
            let expected = "a focal length in pixels, because a fisheye's field of view has several definitions";
            return Err(malformed(&format!("fl_{axis}"), expected, "only a field of view"));
        }
        let pixels = |focal: Option<Focal>, side: f64| focal.map(|focal| focal.pixels(side));
        let (x, y) = (pixels(self.focal_x, width), pixels(self.focal_y, height));
        let (Some(fl_x), Some(fl_y)) = (x.or(y), y.or(x)) else {
            return Err(malformed("fl_x", "a focal length (fl_x, camera_angle_x or x_fov)", "none"));
        };
        let (cx, cy) = match (self.cx, self.cy) {
            (Some(cx), Some(cy)) => (cx, cy),
            (None, None) => (0.5 * width, 0.5 * height),
            (Some(_), None) => return Err(malformed("cy", "both cx and cy, or neither", "only cx")),
            (None, Some(_)) => return Err(malformed("cx", "both cx and cy, or neither", "only cy")),
        };
        let intrinsics = NormalizedIntrinsics::new(fl_x / width, fl_y / height, cx / width, cy / height);
        let unsupported =
            |(model, reason)| SceneError::unsupported_model(path, format!("{location}camera_model"), model, reason);
        Ok(ResolvedLens {
            intrinsics: intrinsics.map_err(SceneError::camera(path, format!("{location}fl_x")))?,
            distortion: self.distortion().map_err(unsupported)?,
            size: whole_size(width, height),
            contradiction: self.contradiction(width, height),
            assumes_centre: self.cx.is_none() && self.states_pixels(),
        })
    }

    /// The axis along which a fisheye states a field of view, but no focal length.
    fn fisheye_axis_without_length(&self) -> Option<&'static str> {
        let is_angle = |focal: Option<Focal>| matches!(focal, Some(Focal::Angle(_)));
        let axes = [("x", self.focal_x), ("y", self.focal_y)];
        axes.into_iter().find(|(_, focal)| self.fisheye == Some(true) && is_angle(*focal)).map(|(axis, _)| axis)
    }

    /// How the first focal length differs from the field of view that is also stated. That of a fisheye has several definitions.
    fn contradiction(&self, width: f64, height: f64) -> Option<String> {
        let [angle_x, angle_y] = self.angles;
        let axes = [("x", self.focal_x, angle_x, width), ("y", self.focal_y, angle_y, height)];
        axes.into_iter().filter(|_| self.fisheye != Some(true)).find_map(|(axis, focal, angle, side)| {
            let (focal, angle) = focal.zip(angle)?;
            let pixels = focal.pixels(side);
            (!SAME_FOCAL.accepts(focal_of(angle, side), pixels)).then(|| {
                let (stated, degrees) = (angle.to_degrees(), 2.0 * (0.5 * side / pixels).atan().to_degrees());
                match focal {
                    Focal::Pixels(_) => format!(
                        "the field of view (camera_angle_{axis} or {axis}_fov) is {stated:.2}°, that of fl_{axis} \
                         {pixels:.2} for {side} pixels is {degrees:.2}°; fl_{axis} is used"
                    ),
                    Focal::Angle(_) => format!(
                        "the field of view camera_angle_{axis} is {stated:.2}°, {axis}_fov is {degrees:.2}°; \
                         {axis}_fov is used"
                    ),
                }
            })
        })
    }

    /// The coefficients determine the lens, not the model's name: nerfstudio reads them for a `PINHOLE` too.
    fn distortion(&self) -> Result<Distortion, (&'static str, &'static str)> {
        let [k1, k2, k3, k4] = self.radial.unwrap_or_default();
        let [p1, p2] = self.tangential.unwrap_or_default();
        let is_zero = |values: &[f64]| values.iter().all(|value| *value == 0.0);
        if self.fisheye == Some(true) {
            if !is_zero(&[p1, p2]) {
                return Err(("OPENCV_FISHEYE", "tangential coefficients p1, p2 are not zero"));
            }
            return Ok(Distortion::Fisheye { k: [k1, k2, k3, k4] });
        }
        if k4 != 0.0 {
            return Err(("OPENCV", "a fourth radial coefficient k4 is not zero"));
        }
        let pinhole = is_zero(&[k1, k2, k3, p1, p2]);
        Ok(if pinhole { Distortion::None } else { Distortion::OpenCv { k1, k2, k3, p1, p2 } })
    }
}

impl Focal {
    /// In pixels, over a side of an image.
    fn pixels(self, side: f64) -> f64 {
        match self {
            Self::Pixels(pixels) => pixels,
            Self::Angle(angle) => focal_of(angle, side),
        }
    }

    /// The focal length, and an angle in radians that is also stated, which may be anything.
    fn read(
        object: &Object<'_>,
        pixels: &str,
        degrees: &str,
        radians: &str,
    ) -> Result<(Option<Self>, Option<f64>), SceneError> {
        if let Some(length) = object.number(pixels)? {
            let stated = |name: &str| object.value(name).and_then(Value::as_f64);
            return Ok((Some(Self::Pixels(length)), stated(degrees).map(f64::to_radians).or_else(|| stated(radians))));
        }
        let (name, angle, other_angle) = match (object.number(degrees)?, object.number(radians)?) {
            (Some(angle), other_angle) => (degrees, angle.to_radians(), other_angle),
            (None, Some(angle)) => (radians, angle, None),
            (None, None) => return Ok((None, None)),
        };
        if angle > 0.0 && angle < std::f64::consts::PI {
            return Ok((Some(Self::Angle(angle)), other_angle));
        }
        Err(object.wrong(name, "an angle between 0 and 180°", &format!("{}°", angle.to_degrees())))
    }
}

/// The focal length of a field of view in radians over a side of an image, in the unit of the side.
pub(super) fn focal_of(angle: f64, side: f64) -> f64 {
    0.5 * side / (0.5 * angle).tan()
}

/// Radial coefficients k1…k4 and tangential ones p1, p2.
type Coefficients = (Option<[f64; 4]>, Option<[f64; 2]>);

/// The radial and the tangential coefficients, by name or in nerfstudio's list (`data/dataparsers/nerfstudio_dataparser.py`);
/// `None` if all of a kind are absent.
fn read_coefficients(object: &Object<'_>) -> Result<Coefficients, SceneError> {
    const LIST: &str = "distortion_params";
    let radial = read_all(object, ["k1", "k2", "k3", "k4"])?;
    let tangential = read_all(object, ["p1", "p2"])?;
    match object.numbers::<6>(LIST)? {
        None => Ok((radial, tangential)),
        Some([k1, k2, k3, k4, p1, p2]) if radial.is_none() && tangential.is_none() => {
            Ok((Some([k1, k2, k3, k4]), Some([p1, p2])))
        }
        Some(_) => Err(object.wrong(LIST, "either this list or k1, k2, k3, k4, p1 and p2", "both")),
    }
}

/// The numbers with these names, absent ones zero; `None` if all are absent.
fn read_all<const N: usize>(object: &Object<'_>, names: [&str; N]) -> Result<Option<[f64; N]>, SceneError> {
    let (mut values, mut any) = ([0.0; N], false);
    for (value, name) in values.iter_mut().zip(names) {
        if let Some(stated) = object.number(name)? {
            (*value, any) = (stated, true);
        }
    }
    Ok(any.then_some(values))
}

fn read_size(object: &Object<'_>, name: &str) -> Result<Option<f64>, SceneError> {
    match object.number(name)? {
        Some(length) if length >= 1.0 && length <= f64::from(u32::MAX) => Ok(Some(length)),
        Some(length) => Err(object.wrong(name, "an image size in pixels", &length.to_string())),
        None => Ok(None),
    }
}

/// The size if it is whole pixels.
fn whole_size(width: f64, height: f64) -> Option<ImageSize> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to fit u32 when read")]
    let whole = |length: f64| (length.fract() == 0.0).then_some(length as u32);
    Some(ImageSize { width: whole(width)?, height: whole(height)? })
}
