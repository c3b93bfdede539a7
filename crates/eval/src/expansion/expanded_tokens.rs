use std::collections::BTreeMap;

use atsplat_model::network::Trace;
use atsplat_splat::{Gaussians, View};
use glam::DVec3;

use super::ExpansionError;

/// An expanded token and its children, each at the mean centre of the Gaussians that the head decodes it to: the parent as it
/// enters its block, the children as they leave it. They share an anchor, so their separation is learned.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpandedToken {
    /// Number of the decoder block that expanded it, from 1.
    pub block: usize,
    /// Predicted uncertainty, if the block scores tokens.
    pub score: Option<f32>,
    /// Position of the parent in the world frame of the context cameras.
    pub parent: DVec3,
    /// Positions of the children in the same frame, as many as the configuration sets.
    pub children: Vec<DVec3>,
}

/// A [`ExpandedToken`] in an image, in pixels: +x right, +y down, the centre of the first pixel at (0.5, 0.5).
#[derive(Clone, Debug, PartialEq)]
pub struct ProjectedToken {
    /// Same as [`ExpandedToken::block`].
    pub block: usize,
    /// Position of the parent, which is inside the image.
    pub parent: [f64; 2],
    /// Positions of the children in front of the camera, inside the image or not.
    pub children: Vec<[f64; 2]>,
}

/// Every expanded token, block by block.
pub(super) fn expanded_tokens(trace: &Trace) -> Vec<ExpandedToken> {
    let made = &trace.reconstruction;
    // A network without tokens expands none.
    let Some(per_token) = made.budget.gaussians.checked_div(made.budget.final_tokens) else { return Vec::new() };
    let mut expanded_tokens = Vec::new();
    for (at, (block, entering)) in made.blocks.iter().zip(&trace.entering).enumerate() {
        let mut children: BTreeMap<usize, Vec<DVec3>> =
            block.selected.iter().map(|&token| (token, Vec::new())).collect();
        for (token, parent) in block.parents.iter().enumerate() {
            if let Some(of_parent) = children.get_mut(parent) {
                of_parent.extend(mean_centre(trace.leaving(at), token, per_token));
            }
        }
        expanded_tokens.extend(children.into_iter().filter_map(|(token, children)| {
            let score = block.scores.as_ref().and_then(|scores| scores.get(token)).copied();
            Some(ExpandedToken { block: at + 1, score, parent: mean_centre(entering, token, per_token)?, children })
        }));
    }
    expanded_tokens
}

/// `None` if a token has no Gaussians.
fn mean_centre(gaussians: &Gaussians, token: usize, per_token: usize) -> Option<DVec3> {
    let means = gaussians.parts().means.chunks_exact(per_token.max(1)).nth(token)?;
    let sum: DVec3 = means.iter().map(|mean| DVec3::from(mean.map(f64::from))).sum();
    Some(sum / means.len() as f64)
}

/// Expanded tokens whose parent projects into an image, occluded or not.
///
/// # Errors
/// [`ExpansionError::Camera`] for an invalid camera.
pub fn projected_tokens(expanded_tokens: &[ExpandedToken], view: &View) -> Result<Vec<ProjectedToken>, ExpansionError> {
    let projector = view.camera.projector()?;
    let seen = |expanded: &ExpandedToken| {
        let parent = projector.project(expanded.parent).ok().filter(atsplat_camera::Projected::is_inside)?;
        let children = expanded.children.iter().filter_map(|&child| projector.project(child).ok());
        let children = children.map(|child| child.pixel(view.size).to_array()).collect();
        Some(ProjectedToken { block: expanded.block, parent: parent.pixel(view.size).to_array(), children })
    };
    Ok(expanded_tokens.iter().filter_map(seen).collect())
}
