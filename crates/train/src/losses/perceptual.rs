use burn::Tensor;
use burn::tensor::Device;

use super::lpips::LpipsLoss;
use super::{Loss, Stack, d_ssim, graph};
use crate::TrainError;
use crate::config::PerceptualChoice;

/// The perceptual term of the final renders.
#[derive(Debug)]
pub enum Perceptual {
    /// `1 − SSIM`.
    DSsim,
    /// LPIPS or ST-LPIPS.
    Lpips(Box<LpipsLoss>),
}

impl Perceptual {
    /// The chosen loss; reads its weights, if it has any, to a device with gradients.
    ///
    /// # Errors
    /// As [`LpipsLoss::read`].
    pub fn new(choice: &PerceptualChoice, device: &Device) -> Result<Self, TrainError> {
        match choice {
            PerceptualChoice::DSsim => Ok(Self::DSsim),
            PerceptualChoice::Learned { network, weights } => {
                Ok(Self::Lpips(Box::new(LpipsLoss::read(*network, weights, device)?)))
            }
        }
    }

    /// Description, for provenance.
    pub fn name(&self) -> String {
        match self {
            Self::DSsim => "D-SSIM (1 − SSIM, Gaussian window of 11) in place of a learned loss".to_owned(),
            Self::Lpips(lpips) => lpips.name(),
        }
    }

    /// The loss, mean over views.
    pub fn evaluate(&self, render: &[f32], truth: &[f32], stack: Stack) -> Loss {
        match self {
            Self::DSsim => d_ssim(render, truth, stack).loss,
            Self::Lpips(lpips) => lpips.evaluate(render, truth, stack),
        }
    }

    /// The loss of images `[images, height, width, 3]` on their device, mean over the views of each sample.
    pub fn in_graph(&self, render: Tensor<4>, truth: Tensor<4>, d_ssim: &graph::DSsim, samples: usize) -> Tensor<1> {
        match self {
            Self::DSsim => graph::means(d_ssim.map(render, truth), samples),
            Self::Lpips(lpips) => lpips.distance(render, truth, samples),
        }
    }
}
