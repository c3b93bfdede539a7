use burn::Tensor;

use super::PatchFrames;

/// Tokens and their places.
#[derive(Clone, Debug)]
pub struct Tokens {
    /// `[scenes, tokens, channels]`.
    pub features: Tensor<3>,
    /// What the centres of their Gaussians are relative to.
    pub place: Place,
}

/// What the centres of tokens' Gaussians are relative to.
#[derive(Clone, Debug)]
pub enum Place {
    /// Anchors, from which the head predicts offsets; in the design `patch-depth`.
    Anchored {
        /// In scene units, `[scenes, tokens, 3]`.
        anchors: Tensor<3>,
        /// Depths along the anchors' rays, `[scenes, tokens]`.
        depths: Tensor<2>,
        /// Frames of each token's Gaussians, if `head.frame` is the patch's.
        frames: Option<Box<PatchFrames>>,
    },
    /// Origins and unit directions of rays, one for each of a token's Gaussians, each `[scenes, tokens, K · 3]`; in the design
    /// `ray-depth`.
    Rays([Tensor<3>; 2]),
    /// Nothing: centres are given in the normalised frame.
    Free,
}

impl Place {
    /// Anchors in scene units, `[scenes, tokens, 3]`; none in designs without anchors.
    pub const fn anchors(&self) -> Option<&Tensor<3>> {
        match self {
            Self::Anchored { anchors, .. } => Some(anchors),
            Self::Rays(_) | Self::Free => None,
        }
    }

    /// Depths along the anchors' rays, `[scenes, tokens]`; none in designs without anchors.
    pub const fn depths(&self) -> Option<&Tensor<2>> {
        match self {
            Self::Anchored { depths, .. } => Some(depths),
            Self::Rays(_) | Self::Free => None,
        }
    }

    /// Frames of each token's Gaussians, if they are measured in one.
    pub(super) fn frames(&self) -> Option<&PatchFrames> {
        match self {
            Self::Anchored { frames, .. } => frames.as_deref(),
            Self::Rays(_) | Self::Free => None,
        }
    }

    /// The places of other tokens, to which `gather` assigns these: it maps `[scenes, tokens, …]`.
    pub(super) fn inherited(self, gather: impl Fn(Tensor<3>) -> Tensor<3>) -> Self {
        match self {
            Self::Anchored { anchors, depths, frames } => Self::Anchored {
                anchors: gather(anchors),
                depths: gather(depths.unsqueeze_dim(2)).squeeze_dim(2),
                frames: frames.map(|frames| Box::new(frames.map(&gather))),
            },
            Self::Rays(rays) => Self::Rays(rays.map(gather)),
            Self::Free => Self::Free,
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_nn::f32_values;
    use atsplat_nn::ops::gather_rows;
    use atsplat_numeric::Tolerance;
    use burn::tensor::{Device, Int, TensorData};

    use super::super::Network;
    use super::super::tests::base;
    use super::*;
    use crate::config::{AnchorContext, AnchorDesign, HeadFrame};
    use crate::parameters::parameters;
    use crate::weights::generated;

    /// `[1, 3, width]`: all numbers of token t are `start + t`.
    fn numbered(start: u8, width: usize) -> Tensor<3> {
        let values: Vec<f32> = (start..start + 3).flat_map(|number| vec![f32::from(number); width]).collect();
        Tensor::from_data(TensorData::new(values, [1, 3, width]), &Device::flex())
    }

    /// Of three tokens, the last stays, and the first has two children.
    #[test]
    fn children_are_in_the_place_of_their_parent() {
        let parents = TensorData::new(vec![2i64, 0, 0], [1, 3]);
        let parents = Tensor::<2, Int>::from_data(parents, &Device::flex());
        let gather = |x: Tensor<3>| gather_rows(x, parents.clone());
        let frames = PatchFrames { axes: numbered(20, 9), footprints: numbered(30, 1) };
        let anchored = Place::Anchored {
            anchors: numbered(0, 3),
            depths: numbered(10, 1).squeeze_dim(2),
            frames: Some(Box::new(frames)),
        };
        let anchored = anchored.inherited(gather);
        let frames = anchored.frames().unwrap();
        let depths = anchored.depths().unwrap().clone().unsqueeze_dim::<3>(2);
        let Place::Rays([origins, directions]) = Place::Rays([numbered(40, 6), numbered(50, 6)]).inherited(gather)
        else {
            panic!("rays stay rays");
        };
        for (found, start) in [
            (anchored.anchors().unwrap().clone(), 0.0),
            (depths, 10.0),
            (frames.axes.clone(), 20.0),
            (frames.footprints.clone(), 30.0),
            (origins, 40.0),
            (directions, 50.0),
        ] {
            let [_, tokens, width] = found.dims();
            assert_eq!(tokens, 3);
            let expected = [2.0, 0.0, 0.0].into_iter().flat_map(|parent| vec![start + parent; width]);
            Tolerance::EXACT.assert(f32_values(found).into_iter().map(f64::from), expected, &format!("from {start}"));
        }
    }

    #[test]
    fn each_design_has_its_places_and_keeps_them_through_the_decoder() {
        let (fixture, device) = (base(), Device::flex());
        for (design, expected) in [
            (AnchorDesign::PatchDepth {}, "anchored"),
            (AnchorDesign::RayDepth {}, "rays"),
            (AnchorDesign::LearnableTokens { tokens: 6 }, "free"),
            (AnchorDesign::DirectXyz {}, "free"),
        ] {
            let mut config = fixture.config.clone();
            config.anchors.design = design;
            if !design.has_anchors() {
                (config.anchors.context, config.head.frame) = (AnchorContext::None {}, HeadFrame::World);
            }
            let weights = generated(&parameters(&config), fixture.seed);
            let network = Network::new(&config, &device).unwrap().with_weights(&weights).unwrap();
            let made = network.forward(&[fixture.views()], 0).unwrap();
            for tokens in std::iter::once(&made.initial).chain(made.blocks.iter().map(|block| &block.tokens)) {
                let [_, count, _] = tokens.features.dims();
                let (found, placed) = match &tokens.place {
                    Place::Anchored { anchors, .. } => ("anchored", anchors.dims()[1]),
                    Place::Rays([origins, _]) => ("rays", origins.dims()[1]),
                    Place::Free => ("free", count),
                };
                assert_eq!((found, placed), (expected, count), "{design:?}");
            }
        }
    }
}
