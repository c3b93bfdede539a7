use std::ops::AddAssign;

use atsplat_camera::ImageSize;
use atsplat_numeric::Extremes as _;
use rayon::prelude::*;
use serde::Serialize;

use crate::reference::SplatGradient;
use crate::reference::project_backward::GaussianGradient;
use crate::{Gaussians, GradientField, RenderOptions, SplatError, View};

/// The images of one view, row-major; f64 from the reference renderer, f32 from all others.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendering<T> {
    /// In pixels.
    pub size: ImageSize,
    /// Colour over the background; not clamped.
    pub rgb: Vec<[T; 3]>,
    /// Opacity in [0, 1].
    pub alpha: Vec<T>,
    /// If requested, see [`crate::Channels::depth`].
    pub depth: Option<Vec<T>>,
    /// If requested, see [`crate::Channels::scalar`].
    pub scalar: Option<Vec<T>>,
    /// If requested, see [`crate::Channels::median_depth`].
    pub median_depth: Option<Vec<T>>,
    /// Counts of Gaussians drawn, and of those culled by reason.
    pub counts: GaussianCounts,
}

/// Number of Gaussians drawn, and culled by reason. If several reasons apply to a Gaussian, renderers may count any of
/// them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct GaussianCounts {
    /// Projected into the image.
    pub drawn: u64,
    /// A value is NaN or infinite, or the covariance overflows.
    pub invalid: u64,
    /// In front of the near plane, behind the camera, or beyond the far plane.
    pub outside_depth: u64,
    /// Alpha below `min_alpha` everywhere.
    pub faint: u64,
    /// Outside the image, or outside the lens's field of view.
    pub outside_image: u64,
}

/// Why a Gaussian is not drawn; see [`GaussianCounts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Culled {
    Invalid,
    OutsideDepth,
    Faint,
    OutsideImage,
}

impl GaussianCounts {
    /// All Gaussians, drawn or not: those of the scene, once for each image.
    pub const fn total(self) -> u64 {
        let Self { drawn, invalid, outside_depth, faint, outside_image } = self;
        drawn + invalid + outside_depth + faint + outside_image
    }

    pub(crate) const fn count(&mut self, culled: Culled) {
        *match culled {
            Culled::Invalid => &mut self.invalid,
            Culled::OutsideDepth => &mut self.outside_depth,
            Culled::Faint => &mut self.faint,
            Culled::OutsideImage => &mut self.outside_image,
        } += 1;
    }
}

impl AddAssign for GaussianCounts {
    fn add_assign(&mut self, other: Self) {
        self.drawn += other.drawn;
        self.invalid += other.invalid;
        self.outside_depth += other.outside_depth;
        self.faint += other.faint;
        self.outside_image += other.outside_image;
    }
}

/// Gradients of a loss with respect to the images of a [`Rendering`]; `None` where it has none.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageGradients<T> {
    /// With respect to colour.
    pub rgb: Vec<[T; 3]>,
    /// With respect to alpha.
    pub alpha: Option<Vec<T>>,
    /// With respect to composited depth.
    pub depth: Option<Vec<T>>,
    /// With respect to the composited scalar.
    pub scalar: Option<Vec<T>>,
}

/// Gradients of a loss with respect to every input of a rendering.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradients<T> {
    /// With respect to the means.
    pub means: Vec<[T; 3]>,
    /// With respect to the quaternions as stored (not normalised); orthogonal to them.
    pub quaternions: Vec<[T; 4]>,
    /// With respect to the log-scales.
    pub log_scales: Vec<[T; 3]>,
    /// With respect to the opacity logits.
    pub opacity_logits: Vec<T>,
    /// With respect to the spherical-harmonics coefficients, of the Gaussians' own degree.
    pub sh: Vec<[T; 3]>,
    /// With respect to the scalars; empty if the Gaussians have none.
    pub scalars: Vec<T>,
    /// With respect to the projected means in pixels: the 3DGS densification criterion.
    pub means_2d: Vec<[T; 2]>,
    /// With respect to the conics, inverse 2D covariances `(a, b, c)` in `½(a·dx² + c·dy²) + b·dx·dy`.
    pub conics: Vec<[T; 3]>,
    /// With respect to the background.
    pub background: [T; 3],
    /// With respect to a small motion of the camera, `camera_from_world ← exp(ξ) · camera_from_world`: rotation, then
    /// translation.
    pub pose: [T; 6],
}

/// Gradient of a loss with respect to one pixel; 0 for absent images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PixelGradient<T> {
    pub(crate) rgb: [T; 3],
    pub(crate) alpha: T,
    pub(crate) depth: T,
    pub(crate) scalar: T,
}

impl<T> Rendering<T> {
    /// Bytes of the requested images.
    pub(crate) fn bytes(view: &View, options: &RenderOptions) -> u64 {
        let channels = &options.channels;
        let images = 4 + u64::from(channels.depth) + u64::from(channels.scalar) + u64::from(channels.median_depth);
        let pixels = u64::from(view.size.width) * u64::from(view.size.height);
        pixels.saturating_mul(images * size_of::<T>() as u64)
    }

    /// A rendering without images yet.
    pub(crate) const fn blank(view: &View) -> Self {
        let counts = GaussianCounts { drawn: 0, invalid: 0, outside_depth: 0, faint: 0, outside_image: 0 };
        Self {
            size: view.size,
            rgb: Vec::new(),
            alpha: Vec::new(),
            depth: None,
            scalar: None,
            median_depth: None,
            counts,
        }
    }
}

impl<T: Copy + Default> Rendering<T> {
    /// The requested images, filled with zeros.
    pub(crate) fn empty(view: &View, options: &RenderOptions) -> Self {
        let zeros = || vec![T::default(); view.pixels()];
        Self {
            size: view.size,
            rgb: vec![[T::default(); 3]; view.pixels()],
            alpha: zeros(),
            depth: options.channels.depth.then(zeros),
            scalar: options.channels.scalar.then(zeros),
            median_depth: options.channels.median_depth.then(zeros),
            counts: GaussianCounts::default(),
        }
    }
}

impl<T: Copy + Into<f64>> Rendering<T> {
    /// Number of NaN or infinite values over all images.
    pub fn non_finite(&self) -> u64 {
        let extra = [&self.depth, &self.scalar, &self.median_depth];
        let extra = extra.into_iter().flatten().flatten();
        count_non_finite(self.rgb.as_flattened().iter().chain(&self.alpha).chain(extra))
    }
}

impl<T: Copy + Into<f64>> Gradients<T> {
    /// Number of NaN or infinite values.
    pub fn non_finite(&self) -> u64 {
        self.fields().into_iter().map(|(_, list)| count_non_finite(list.iter())).sum()
    }

    /// The values of every field, in declaration order.
    pub fn fields(&self) -> [(GradientField, &[T]); 10] {
        [
            (GradientField::Means, self.means.as_flattened()),
            (GradientField::Quaternions, self.quaternions.as_flattened()),
            (GradientField::LogScales, self.log_scales.as_flattened()),
            (GradientField::OpacityLogits, &self.opacity_logits),
            (GradientField::Sh, self.sh.as_flattened()),
            (GradientField::Scalars, &self.scalars),
            (GradientField::Means2d, self.means_2d.as_flattened()),
            (GradientField::Conics, self.conics.as_flattened()),
            (GradientField::Background, &self.background),
            (GradientField::Pose, &self.pose),
        ]
    }
}

fn count_non_finite<'a, T: Copy + Into<f64> + 'a>(values: impl Iterator<Item = &'a T>) -> u64 {
    values.map(|value| u64::from(!(*value).into().is_finite())).sum()
}

impl<T: Copy> Rendering<T> {
    /// Converts every pixel value.
    pub fn map<U>(self, number: impl Fn(T) -> U + Copy) -> Rendering<U> {
        let each = |image: Vec<T>| image.into_iter().map(number).collect();
        Rendering {
            size: self.size,
            rgb: self.rgb.into_iter().map(|rgb| rgb.map(number)).collect(),
            alpha: each(self.alpha),
            depth: self.depth.map(each),
            scalar: self.scalar.map(each),
            median_depth: self.median_depth.map(each),
            counts: self.counts,
        }
    }
}

impl<T: Copy> ImageGradients<T> {
    /// Converts every value.
    pub fn map<U>(&self, number: impl Fn(T) -> U + Copy) -> ImageGradients<U> {
        let each = |image: &Vec<T>| image.iter().copied().map(number).collect();
        ImageGradients {
            rgb: self.rgb.iter().map(|rgb| rgb.map(number)).collect(),
            alpha: self.alpha.as_ref().map(each),
            depth: self.depth.as_ref().map(each),
            scalar: self.scalar.as_ref().map(each),
        }
    }
}

impl<T: Copy + Default + Into<f64> + Sync> ImageGradients<T> {
    /// Returns the largest magnitude of all gradients.
    ///
    /// # Errors
    /// [`SplatError::Length`] naming the first image without exactly one value per pixel, [`SplatError::NonFinite`]
    /// naming the first image with a NaN or infinite value.
    pub(crate) fn check(&self, view: &View) -> Result<f64, SplatError> {
        let expected = view.pixels();
        let images = [
            ("rgb gradient", Some(self.rgb.as_flattened()), 3),
            ("alpha gradient", self.alpha.as_deref(), 1),
            ("depth gradient", self.depth.as_deref(), 1),
            ("scalar gradient", self.scalar.as_deref(), 1),
        ];
        let images = || images.into_iter().filter_map(|(name, image, each)| Some((name, image?, each)));
        if let Some((field, image, each)) = images().find(|(_, image, each)| image.len() != expected * each) {
            return Err(SplatError::Length { field, expected, found: image.len() / each });
        }
        let mut largest = 0.0;
        for (name, image, each) in images() {
            let most = max_abs(image);
            if !most.is_finite() {
                let non_finite =
                    image.iter().map(|value| (*value).into()).enumerate().find(|(_, value)| !value.is_finite());
                let (at, found) = non_finite.unwrap_or((0, most));
                return Err(SplatError::NonFinite { image: name, pixel: at / each, found });
            }
            largest = most.maximum_of(largest);
        }
        Ok(largest)
    }
}

/// Largest magnitude; infinite or NaN if any value is.
fn max_abs<T: Copy + Into<f64> + Sync>(values: &[T]) -> f64 {
    const CHUNK: usize = 1 << 16;
    // Without the sign, bit patterns order like magnitudes, with infinity and NaN last.
    let bits = |value: &T| (*value).into().abs().to_bits();
    let most = |values: &[T]| values.iter().map(bits).fold(0, |most, bits| if bits > most { bits } else { most });
    f64::from_bits(values.par_chunks(CHUNK).map(most).max().unwrap_or(0))
}

impl<T> ImageGradients<T> {
    /// # Errors
    /// [`SplatError::Length`] for gradients of depth or scalar.
    pub(crate) fn check_colour_only(&self) -> Result<(), SplatError> {
        for (field, image) in [("depth gradient", &self.depth), ("scalar gradient", &self.scalar)] {
            if let Some(image) = image {
                return Err(SplatError::Length { field, expected: 0, found: image.len() });
            }
        }
        Ok(())
    }
}

impl<T: Copy + Default> ImageGradients<T> {
    /// The gradient at one pixel of images that passed [`Self::check`].
    #[expect(clippy::expect_used, reason = "every image has one value per pixel")]
    pub(crate) fn at(&self, pixel: usize) -> PixelGradient<T> {
        let value = |image: &Option<Vec<T>>| {
            image.as_ref().map_or_else(T::default, |image| *image.get(pixel).expect("a pixel of the image"))
        };
        PixelGradient {
            rgb: *self.rgb.get(pixel).expect("a pixel of the image"),
            alpha: value(&self.alpha),
            depth: value(&self.depth),
            scalar: value(&self.scalar),
        }
    }
}

impl<T: Copy + Default> Gradients<T> {
    /// Resizes every array to fit these Gaussians; the values are unspecified.
    pub(crate) fn fit(&mut self, gaussians: &Gaussians) {
        let (zero, count, parts) = (T::default(), gaussians.len(), gaussians.parts());
        self.means.resize(count, [zero; 3]);
        self.quaternions.resize(count, [zero; 4]);
        self.log_scales.resize(count, [zero; 3]);
        self.opacity_logits.resize(count, zero);
        self.sh.resize(parts.sh.len(), [zero; 3]);
        self.scalars.resize(if parts.scalars.is_some() { count } else { 0 }, zero);
        self.means_2d.resize(count, [zero; 2]);
        self.conics.resize(count, [zero; 3]);
    }

    /// All zero.
    pub(crate) fn zero(gaussians: &Gaussians) -> Self {
        let mut gradients = Self::default();
        gradients.fit(gaussians);
        gradients
    }
}

impl<T: Copy> Gradients<T> {
    /// Converts every value.
    pub fn map<U>(self, number: impl Fn(T) -> U + Copy) -> Gradients<U> {
        fn rows<T: Copy, U, const N: usize>(values: Vec<[T; N]>, number: impl Fn(T) -> U + Copy) -> Vec<[U; N]> {
            values.into_iter().map(|row| row.map(number)).collect()
        }
        let each = |values: Vec<T>| values.into_iter().map(number).collect();
        Gradients {
            means: rows(self.means, number),
            quaternions: rows(self.quaternions, number),
            log_scales: rows(self.log_scales, number),
            opacity_logits: each(self.opacity_logits),
            sh: rows(self.sh, number),
            scalars: each(self.scalars),
            means_2d: rows(self.means_2d, number),
            conics: rows(self.conics, number),
            background: self.background.map(number),
            pose: self.pose.map(number),
        }
    }
}

impl Gradients<f64> {
    /// Stores one Gaussian's gradients.
    pub(crate) fn store(&mut self, position: usize, d_gaussian: &GaussianGradient, d_splat: &SplatGradient) {
        let stored = self.sh.len() / self.means.len();
        self.means[position] = d_gaussian.mean.to_array();
        self.quaternions[position] = d_gaussian.quaternion;
        self.log_scales[position] = d_gaussian.log_scales.to_array();
        self.opacity_logits[position] = d_gaussian.logit;
        // Empty if the Gaussians have no scalars.
        if let Some(slot) = self.scalars.get_mut(position) {
            *slot = d_splat.scalar;
        }
        self.means_2d[position] = d_splat.centre.to_array();
        self.conics[position] = d_splat.conic.to_array();
        self.sh[position * stored..][..stored].copy_from_slice(&d_gaussian.sh[..stored]);
    }
}
