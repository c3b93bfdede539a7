//! A trial's Gaussians for the page's live view: after every block of the decoder, in 16 bytes each, with the cameras.

mod pack;

use atsplat_camera::ImageSize;
use atsplat_model::network::Trace;
use atsplat_numeric::{Extremes as _, median};
use atsplat_protocol::trial::Trial;
use atsplat_splat::{Gaussians, RenderOptions, SplatError, View};
use glam::DVec3;
use serde::Serialize;

use crate::expansion::ExpansionError;

pub use pack::{BYTES, Packed};

/// Gaussians and cameras of one trial.
#[derive(Clone, Debug)]
pub struct LiveScene {
    /// Context cameras, then targets.
    pub cameras: Vec<LiveCamera>,
    /// The point about which the view turns: on the first camera's optical axis, at the Gaussians' median depth.
    pub focus: [f64; 3],
    /// How the Gaussians are rendered, except for spherical harmonics, which the live view lacks.
    pub options: RenderOptions,
    /// Gaussians of the tokens that enter each block, and of the final ones.
    pub stages: Vec<LiveStage>,
    /// Smallest and largest predicted uncertainty; `None` if no block scores tokens.
    pub uncertainty: Option<[f32; 2]>,
}

/// A camera, without lens distortion.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LiveCamera {
    /// Position of the frame in the scene.
    pub frame: usize,
    /// Whether it is a context camera.
    pub context: bool,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Horizontal and vertical focal length in pixels.
    pub focal: [f64; 2],
    /// The principal point that the renderer uses, in pixels.
    pub principal: [f64; 2],
    /// Rows of `[R | t]`.
    pub camera_from_world: [f64; 12],
}

/// Gaussians of the tokens between two blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveStage {
    /// Number of blocks that the tokens have passed.
    pub blocks: usize,
    /// Number of Gaussians, including those that are dropped because no pixel shows them.
    pub all: usize,
    /// The Gaussians that are kept.
    pub gaussians: Packed,
    /// Tokens in the order of their Gaussians; tokens without any are left out.
    pub tokens: Vec<LiveToken>,
}

/// A token with its Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveToken {
    /// The block that made it by expansion, from 1; 0 for an initial token.
    pub block: u8,
    /// Predicted uncertainty in 255 steps of [`LiveScene::uncertainty`]: of the token itself if the next block scores it, else
    /// of its ancestor in the last block that did.
    pub uncertainty: u8,
    /// Number of consecutive Gaussians.
    pub count: u16,
}

impl LiveScene {
    /// The Gaussians of a forward pass with the cameras of its trial, as rendered by `options`.
    ///
    /// # Errors
    /// [`ExpansionError::Invalid`] for a network with more than 255 blocks, whose numbers do not fit into [`LiveToken::block`].
    pub fn of(trace: &Trace, trial: &Trial, options: &RenderOptions) -> Result<Self, ExpansionError> {
        let context =
            trial.context().iter().map(|view| (true, view.frame, View { camera: view.camera, size: view.size }));
        let targets =
            trial.targets().iter().map(|view| (false, view.frame, View { camera: view.camera, size: view.size }));
        let views: Vec<(bool, usize, View)> = context.chain(targets).collect();
        let scores = || trace.reconstruction.blocks.iter().flat_map(|block| &block.scores).flatten().copied();
        let range = scores().reduce(f32::minimum_of).zip(scores().reduce(f32::maximum_of));
        let uncertainty = range.map(|(least, most)| [least, most]);
        Ok(Self {
            focus: views.first().map_or([0.0; 3], |(.., view)| focus(view, &trace.reconstruction.gaussians)),
            cameras: views
                .iter()
                .map(|(context, frame, view)| LiveCamera::of(*context, *frame, view, options))
                .collect::<Result<_, _>>()?,
            options: options.clone(),
            stages: stages(trace, uncertainty.unwrap_or_default(), options.constants.min_alpha)?,
            uncertainty,
        })
    }
}

impl LiveCamera {
    /// A camera as a renderer with these options uses it.
    ///
    /// # Errors
    /// [`SplatError::View`] for a field of view without a focal length.
    pub fn of(context: bool, frame: usize, view: &View, options: &RenderOptions) -> Result<Self, SplatError> {
        let ImageSize { width, height } = view.size;
        let [focal, principal] = view.focal_and_principal(options.constants.principal_point)?;
        let camera_from_world = view.camera.camera_from_world.to_rows();
        Ok(Self { frame, context, size: [width, height], focal, principal, camera_from_world })
    }
}

/// The point on a camera's optical axis at the median depth of the Gaussians in front of it; at depth 1 without any.
fn focus(view: &View, gaussians: &Gaussians) -> [f64; 3] {
    let pose = view.camera.camera_from_world;
    let depth = |mean: &[f32; 3]| pose.transform_point(DVec3::from(mean.map(f64::from))).z;
    let depth = median(gaussians.parts().means.iter().map(depth).filter(|depth| *depth > 0.0)).unwrap_or(1.0);
    pose.inverse().transform_point(DVec3::new(0.0, 0.0, depth)).to_array()
}

#[expect(clippy::expect_used, reason = "a trace has the Gaussians and parents of every block")]
fn stages(trace: &Trace, uncertainty: [f32; 2], min_alpha: f64) -> Result<Vec<LiveStage>, ExpansionError> {
    let made = &trace.reconstruction;
    let first = trace.entering.first().expect("a decoder has at least one block");
    let per_token = made.budget.gaussians_per_token();
    let mut origins = vec![0; first.len() / per_token];
    let mut scores: Vec<f32> = vec![uncertainty[0]; origins.len()];
    let mut stages = Vec::with_capacity(made.blocks.len() + 1);
    for (at, block) in made.blocks.iter().enumerate() {
        if let Some(of_block) = &block.scores {
            scores.clone_from(of_block);
        }
        let entering = trace.entering.get(at).expect("the Gaussians that enter the block");
        stages.push(LiveStage::of(at, entering, per_token, &labels(&origins, &scores, uncertainty), min_alpha));
        let inherited = |parent: &usize| *scores.get(*parent).expect("a token that entered the block");
        scores = block.parents.iter().map(inherited).collect();
        let number = u8::try_from(at + 1).map_err(|_too_large| ExpansionError::Invalid {
            what: "live view",
            expected: format!("at most {} decoder blocks", u8::MAX),
            found: made.blocks.len().to_string(),
        })?;
        let origin = |parent: &usize| match block.selected.binary_search(parent) {
            Ok(_) => number,
            Err(_) => *origins.get(*parent).expect("a token that entered the block"),
        };
        origins = block.parents.iter().map(origin).collect();
    }
    let last = labels(&origins, &scores, uncertainty);
    stages.push(LiveStage::of(made.blocks.len(), &made.gaussians, per_token, &last, min_alpha));
    Ok(stages)
}

/// Block and uncertainty of each token.
fn labels(origins: &[u8], scores: &[f32], range: [f32; 2]) -> Vec<(u8, u8)> {
    let share = |score: &f32| pack::level(*score, range, 255.0).to_le_bytes()[0];
    origins.iter().copied().zip(scores.iter().map(share)).collect()
}

impl LiveStage {
    /// Gaussians of tokens that have passed `blocks` blocks, `per_token` each, with the block that made each token and
    /// its uncertainty. Finite and without a 3D filter, as a network predicts them.
    pub fn of(blocks: usize, gaussians: &Gaussians, per_token: usize, labels: &[(u8, u8)], min_alpha: f64) -> Self {
        let (packed, kept) = pack::pack(gaussians, min_alpha);
        let mut counts = vec![0u16; labels.len()];
        for at in kept {
            if let Some(count) = counts.get_mut(at / per_token) {
                *count += 1;
            }
        }
        let tokens = labels.iter().zip(counts).filter(|(_, count)| *count > 0);
        let tokens = tokens.map(|(&(block, uncertainty), count)| LiveToken { block, uncertainty, count });
        Self { blocks, all: gaussians.len(), gaussians: packed, tokens: tokens.collect() }
    }
}

#[cfg(test)]
mod tests;
