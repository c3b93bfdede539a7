use super::{Assessment, Effect, Request, Scene};
use crate::{Channels, Gaussians};

/// An image rendered in addition to colour and alpha.
#[derive(Debug)]
pub(super) struct Channel {
    name: &'static str,
    flag: fn(&mut Channels) -> &mut bool,
}

/// Depth along the optical axis.
pub(super) const DEPTH: Channel = Channel { name: "depth", flag: |channels| &mut channels.depth };
/// The per-Gaussian scalar, such as ATSplat's uncertainty.
pub(super) const SCALAR: Channel = Channel { name: "scalar", flag: |channels| &mut channels.scalar };
/// Depth at which the transmittance falls to one half.
pub(super) const MEDIAN_DEPTH: Channel = Channel { name: "median-depth", flag: |channels| &mut channels.median_depth };

impl Effect for Channel {
    fn name(&self) -> &'static str {
        self.name
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        let mut channels = request.options.channels;
        *(self.flag)(&mut channels)
    }

    fn remove_from(&self, request: &mut Request) {
        *(self.flag)(&mut request.options.channels) = false;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, _: f64) -> Assessment {
        // A Gaussian with a NaN scalar is culled.
        let shows = |scalar: &f32| *scalar != 0.0 && !scalar.is_nan();
        let reason = match &scene.gaussians().parts().scalars {
            None if self.name == SCALAR.name => "the Gaussians have none: the image is zero",
            Some(scalars) if self.name == SCALAR.name && !scalars.iter().any(shows) => {
                "every scalar is zero, and so is the image"
            }
            _ if self.name != SCALAR.name && scene.gaussians().is_empty() => "without Gaussians the image is zero",
            _ => return Assessment::keep("its image is requested"),
        };
        Assessment::remove(self, request, 0.0, reason)
    }
}
