//! Checks whether an image fits its camera's intrinsics.
//!
//! Normalised intrinsics stay valid when an image is scaled, but not when it is cropped, rotated or stretched. Such a
//! mistake distorts the scene without looking broken.

use atsplat_camera::{ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use thiserror::Error;

use crate::{Frame, ImageHeader, WarningKind, Warnings};

/// Difference of the two focal lengths in pixels above which a warning is due. Calibrations of one lens differ by a few
/// thousandths.
const SQUARE: Tolerance = Tolerance::relative(0.02);
/// Difference above which the image cannot belong to the intrinsics. The pixels of standard video (ITU-R BT.601) are
/// 0.91 to 1.09 times as wide as high.
const NEARLY_SQUARE: Tolerance = Tolerance::relative(0.1);
/// Ratio of the focal lengths that no real camera has: the strongest anamorphic lenses squeeze by 2, and a film of
/// 21 : 9 that is stretched to a square by 2.33.
const WIDEST_PIXELS: f64 = 2.5;

/// Why an image does not fit its camera's intrinsics.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ImageMismatch {
    /// It is not a scaled copy of the image that the intrinsics are stated for.
    #[error(
        "expected an image of {stated}, for which the intrinsics are stated, or a scaled copy of it, found {found}: \
        cropped, rotated or stretched without adapting the intrinsics?"
    )]
    Shape { stated: ImageSize, found: ImageSize },
    /// The intrinsics are impossible for the size that they are stated for.
    #[error(
        "expected focal lengths that differ by a factor of at most {} in pixels, found fx : fy of {ratio:.2} : 1 for an \
        image of {stated}",
        WIDEST_PIXELS
    )]
    Aspect {
        stated: ImageSize,
        /// fx / fy in pixels.
        ratio: f64,
    },
    /// No size is stated, and with this one pixels would be far from square.
    #[error(
        "expected an image of about {fitting}, for which the intrinsics have square pixels, found {found}, for which \
        fx : fy is {ratio:.2} : 1: cropped, rotated or stretched without adapting the intrinsics?"
    )]
    Pixels {
        /// The size with the same height for which pixels are square.
        fitting: ImageSize,
        found: ImageSize,
        /// fx / fy in pixels.
        ratio: f64,
    },
}

impl ImageMismatch {
    /// Whether the image is unusable; otherwise the mismatch is within the range of real cameras.
    pub fn is_fatal(&self) -> bool {
        match self {
            Self::Shape { .. } | Self::Aspect { .. } => true,
            Self::Pixels { ratio, .. } => !NEARLY_SQUARE.accepts(*ratio, 1.0),
        }
    }
}

impl Frame {
    /// How an image of size `found` does not fit this frame's camera; `None` if it fits.
    ///
    /// If a size is stated, the image has to be a scaled copy of it; its pixels may have any shape that a real camera
    /// has. If none is, as in RE10K and `.torch` chunks, pixels have to be square.
    pub fn mismatch(&self, found: ImageSize) -> Option<ImageMismatch> {
        match self.stated_size {
            Some(stated) if !is_scaled_copy(found, stated) => Some(ImageMismatch::Shape { stated, found }),
            Some(stated) => {
                let ratio = ratio_of_focal_lengths(&self.camera.intrinsics, stated);
                let is_possible = ratio <= WIDEST_PIXELS && ratio >= WIDEST_PIXELS.recip();
                (!is_possible).then_some(ImageMismatch::Aspect { stated, ratio })
            }
            None => pixel_mismatch(&self.camera.intrinsics, found),
        }
    }

    /// Warns if the image of this frame, the scene's at `position`, does not fit its camera, is rotated or mirrored by EXIF, or
    /// has an alpha channel, 16-bit samples or samples in another encoding.
    pub fn report(&self, scene: &str, position: usize, header: &ImageHeader, warnings: &mut Warnings) {
        if let Some(mismatch) = self.mismatch(header.size) {
            warnings.push(WarningKind::UnexpectedSize, scene, format!("frame {position}: {mismatch}"));
        }
        if let Some(orientation) = header.orientation {
            let detail = format!("frame {position}: {orientation}; the stored pixels are used");
            warnings.push(WarningKind::TurnedImage, scene, detail);
        }
        if header.has_alpha {
            let detail = format!("frame {position}: it has an alpha channel, which is dropped");
            warnings.push(WarningKind::DroppedAlpha, scene, detail);
        }
        if header.has_16_bits {
            let detail = format!("frame {position}: its samples have 16 bits; the low byte of each is dropped");
            warnings.push(WarningKind::DroppedLowBytes, scene, detail);
        }
        if header.has_other_encoding {
            let found = "its header (gAMA or cICP) states another encoding than that for a display, such as linear light, high \
                         dynamic range or a narrow range";
            let detail = format!("frame {position}: {found}; samples are used as they are");
            warnings.push(WarningKind::OtherEncoding, scene, detail);
        }
    }
}

/// fx / fy in pixels of an image of this size.
pub fn ratio_of_focal_lengths(k: &NormalizedIntrinsics, size: ImageSize) -> f64 {
    (k.fx * f64::from(size.width)) / (k.fy * f64::from(size.height))
}

/// What is suspicious about the pixels of the size that intrinsics are stated for, if they are not nearly square.
pub(crate) fn stretched_pixels(k: &NormalizedIntrinsics, stated: ImageSize) -> Option<String> {
    let ratio = ratio_of_focal_lengths(k, stated);
    let suspicion = "an anamorphic or stretched capture, or a wrong focal length?";
    (!NEARLY_SQUARE.accepts(ratio, 1.0))
        .then(|| format!("fx : fy is {ratio:.2} : 1 in pixels of an image of {stated}: {suspicion}"))
}

/// How far pixels of an image of this size are from square, for intrinsics that state no size; `None` if they are within the range of
/// calibrations.
pub fn pixel_mismatch(k: &NormalizedIntrinsics, found: ImageSize) -> Option<ImageMismatch> {
    let (width, ratio) = (f64::from(found.width), ratio_of_focal_lengths(k, found));
    let square_width = (width / ratio).round();
    // Half a pixel of rounding on either side moves the ratio of small images.
    let is_rounded = (square_width - width).abs() <= 1.0;
    if is_rounded || SQUARE.accepts(ratio, 1.0) {
        return None;
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive; the cast saturates")]
    let fitting = ImageSize { width: square_width as u32, height: found.height };
    Some(ImageMismatch::Pixels { fitting, found, ratio })
}

/// Whether an image is the stated one or a scaled copy of it with sides rounded to whole pixels, such as `images_4` next
/// to a `transforms.json` that states the full size.
pub fn is_scaled_copy(size: ImageSize, stated: ImageSize) -> bool {
    let side =
        |length: u32, other: u32, stated_other: u32| f64::from(length) * f64::from(other) / f64::from(stated_other);
    let width = side(stated.width, size.height, stated.height);
    let height = side(stated.height, size.width, stated.width);
    // Either side may have been rounded, or truncated; that of the shorter one moves the longer one by more than a pixel.
    (width - f64::from(size.width)).abs() <= 1.0 || (height - f64::from(size.height)).abs() <= 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_camera::{Camera, CameraFromWorld};

    const fn size(width: u32, height: u32) -> ImageSize {
        ImageSize { width, height }
    }

    fn frame(fx: f64, fy: f64, stated_size: Option<ImageSize>) -> Frame {
        let intrinsics = NormalizedIntrinsics::new(fx, fy, 0.5, 0.5).unwrap();
        Frame {
            name: "0".to_owned(),
            timestamp_micros: None,
            camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics),
            stated_size,
            image: crate::FrameImage::Absent,
        }
    }

    #[test]
    fn a_downscaled_copy_fits_the_stated_size() {
        assert!(is_scaled_copy(size(480, 270), size(3840, 2160)));
        assert!(is_scaled_copy(size(455, 256), size(640, 360)), "455.1 columns");
        assert!(is_scaled_copy(size(239, 135), size(3818, 2160)), "238.6 columns");
        assert!(is_scaled_copy(size(1000, 250), size(4000, 1003)), "250.75 rows, truncated");
        assert!(!is_scaled_copy(size(256, 256), size(640, 360)), "a crop");
        assert!(!is_scaled_copy(size(270, 480), size(480, 270)), "rotated");
    }

    #[test]
    fn a_stated_size_allows_pixels_that_are_not_square() {
        let stated = Some(size(640, 360));
        for fx in [0.5, 0.9] {
            assert_eq!(frame(fx, 0.9, stated).mismatch(size(320, 180)), None);
            let mismatch = frame(fx, 0.9, stated).mismatch(size(360, 360)).unwrap();
            assert_eq!(mismatch, ImageMismatch::Shape { stated: size(640, 360), found: size(360, 360) });
            assert!(mismatch.is_fatal());
        }
    }

    /// Both ways, and for a copy of any size; an anamorphic lens is allowed.
    #[test]
    fn no_camera_has_one_focal_length_ten_times_the_other() {
        let stated = Some(size(640, 360));
        let fatal = |fx, fy| frame(fx, fy, stated).mismatch(size(320, 180)).map(|mismatch| mismatch.is_fatal());
        let square = 640.0 / 360.0;
        assert_eq!([2.0, 0.5].map(|squeeze| fatal(squeeze, square)), [None; 2]);
        assert_eq!([10.0, 0.1].map(|squeeze| fatal(squeeze, square)), [Some(true); 2]);
        let mismatch = frame(10.0, square, stated).mismatch(size(640, 360)).unwrap().to_string();
        assert!(mismatch.contains("10.00 : 1") && mismatch.contains("640×360"), "{mismatch}");
    }

    /// RE10K: intrinsics of 16 : 9 with square crops of its frames.
    #[test]
    fn square_crops_do_not_fit_intrinsics_of_wide_images() {
        let re10k = frame(0.482_334_223, 0.857_483_091, None);
        for fitting in [size(640, 360), size(1920, 1080), size(455, 256), size(57, 32)] {
            assert_eq!(re10k.mismatch(fitting), None, "{fitting}");
        }
        let Some(mismatch @ ImageMismatch::Pixels { fitting, ratio, .. }) = re10k.mismatch(size(256, 256)) else {
            panic!()
        };
        assert_eq!(fitting, size(455, 256));
        Tolerance::absolute(1e-3).assert([ratio], [0.5625], "9 : 16");
        assert!(mismatch.is_fatal());
        let message = mismatch.to_string();
        assert!(
            message.contains("455×256") && message.contains("256×256") && message.contains("0.56 : 1"),
            "{message}"
        );
    }

    #[test]
    fn samples_in_another_encoding_are_counted() {
        let reported = |has_other_encoding: bool| {
            let header = ImageHeader { has_other_encoding, ..ImageHeader::upright(size(64, 64)) };
            let mut warnings = Warnings::new();
            frame(1.0, 1.0, None).report("s", 3, &header, &mut warnings);
            warnings
        };
        assert_eq!(reported(false).total(), 0);
        let warnings = reported(true);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::OtherEncoding, 1)]);
        assert!(
            warnings.kept()[0].detail.starts_with("frame 3: its header (gAMA or cICP) states another encoding"),
            "{warnings:?}"
        );
    }

    #[test]
    fn nearly_square_pixels_are_not_fatal() {
        let at = |fx: f64| frame(fx, 1.0, None).mismatch(size(1000, 1000)).map(|mismatch| mismatch.is_fatal());
        assert_eq!(
            [0.88, 0.91, 0.975, 0.99, 1.0, 1.01, 1.025, 1.09, 1.12].map(at),
            [Some(true), Some(false), Some(false), None, None, None, Some(false), Some(false), Some(true)]
        );
    }
}
