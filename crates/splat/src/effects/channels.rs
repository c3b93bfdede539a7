use super::{Assessment, Effect, Request, Scene};
use crate::{Channels, Gaussians, Rendering};

/// An image rendered in addition to colour and alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExtraImage {
    /// Depth along the optical axis.
    Depth,
    /// The per-Gaussian scalar, such as ATSplat's uncertainty.
    Scalar,
    /// Depth at which the transmittance falls to one half.
    MedianDepth,
}

impl ExtraImage {
    const fn flag(self, channels: &mut Channels) -> &mut bool {
        match self {
            Self::Depth => &mut channels.depth,
            Self::Scalar => &mut channels.scalar,
            Self::MedianDepth => &mut channels.median_depth,
        }
    }

    /// The image in a rendering, if it was rendered.
    pub(super) fn values_in<T>(self, rendering: &Rendering<T>) -> Option<&[T]> {
        match self {
            Self::Depth => rendering.depth.as_deref(),
            Self::Scalar => rendering.scalar.as_deref(),
            Self::MedianDepth => rendering.median_depth.as_deref(),
        }
    }

    /// Where a rendering has the image.
    pub(super) const fn slot<T>(self, rendering: &mut Rendering<T>) -> &mut Option<Vec<T>> {
        match self {
            Self::Depth => &mut rendering.depth,
            Self::Scalar => &mut rendering.scalar,
            Self::MedianDepth => &mut rendering.median_depth,
        }
    }
}

impl Effect for ExtraImage {
    fn name(&self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Scalar => "scalar",
            Self::MedianDepth => "median-depth",
        }
    }

    fn image(&self) -> Option<ExtraImage> {
        Some(*self)
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        let mut channels = request.options.channels;
        *self.flag(&mut channels)
    }

    fn remove_from(&self, request: &mut Request) {
        *self.flag(&mut request.options.channels) = false;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, _: f64) -> Assessment {
        // A Gaussian with a NaN scalar is culled.
        let shows = |scalar: &f32| *scalar != 0.0 && !scalar.is_nan();
        let reason = match (self, &scene.gaussians().parts().scalars) {
            (Self::Scalar, None) => "the Gaussians have none: the image is zero",
            (Self::Scalar, Some(scalars)) if !scalars.iter().any(shows) => "every scalar is zero, and so is the image",
            (Self::Depth | Self::MedianDepth, _) if scene.gaussians().is_empty() => {
                "without Gaussians the image is zero"
            }
            _ => return Assessment::keep("its image is requested"),
        };
        Assessment::remove(self, request, 0.0, reason)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::ImageSize;

    use super::*;
    use crate::GaussianCounts;
    use crate::effects::image_of;

    #[test]
    fn every_image_has_a_name_a_flag_and_a_place_of_its_own() {
        for (at, (name, image)) in
            [("depth", ExtraImage::Depth), ("scalar", ExtraImage::Scalar), ("median-depth", ExtraImage::MedianDepth)]
                .into_iter()
                .enumerate()
        {
            assert_eq!(image_of(name), Some(image));
            let mut channels = Channels::default();
            *image.flag(&mut channels) = true;
            let expected = [0, 1, 2].map(|other| other == at);
            assert_eq!([channels.depth, channels.scalar, channels.median_depth], expected, "{name}");
            let mut rendering = Rendering {
                size: ImageSize { width: 1, height: 1 },
                rgb: vec![[0.0; 3]],
                alpha: vec![0.0],
                depth: None,
                scalar: None,
                median_depth: None,
                counts: GaussianCounts::default(),
            };
            *image.slot(&mut rendering) = Some(vec![0.5]);
            let found = [&rendering.depth, &rendering.scalar, &rendering.median_depth].map(Option::is_some);
            assert_eq!((found, image.values_in(&rendering)), (expected, Some(&[0.5][..])), "{name}");
        }
        assert_eq!((image_of("lens"), image_of("median_depth")), (None, None));
    }
}
