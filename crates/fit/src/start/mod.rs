//! Gaussians to start from.

mod frustum;
mod neighbours;

use atsplat_numeric::{Extremes as _, logit, narrowed};
use atsplat_splat::sh::C0;
use atsplat_splat::{GaussianParts, Gaussians};

use crate::optimised_gaussians::gaussians_of;
use crate::{FitError, Strategy};

pub use frustum::in_frustums;

/// A coloured point, for example of COLMAP's sparse model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// In scene units.
    pub position: [f64; 3],
    /// RGB in [0, 1].
    pub colour: [f64; 3],
}

/// One Gaussian per point, as 3DGS starts (`create_from_pcd`): round, as wide as the root mean square distance of the three
/// nearest points, of opacity 0.1. MCMC starts with a tenth of that width and opacity 0.5, as its published settings say.
///
/// # Errors
/// [`FitError::Start`] for fewer than four points, or one that is not finite.
pub fn from_points(points: &[Point], strategy: Strategy) -> Result<Gaussians, FitError> {
    let is_finite = |point: &Point| point.position.iter().chain(&point.colour).all(|value| value.is_finite());
    if points.len() < 4 {
        return Err(FitError::Start { expected: "at least four points", found: points.len().to_string() });
    }
    if let Some(at) = points.iter().position(|point| !is_finite(point)) {
        return Err(FitError::Start { expected: "finite points", found: format!("point {at}, which is not") });
    }
    let (opacity, width) = if strategy == Strategy::Mcmc { (0.5, 0.1) } else { (0.1, 1.0) };
    let positions: Vec<[f64; 3]> = points.iter().map(|point| point.position).collect();
    let scale = |squared: f64| narrowed((width * squared.maximum_of(1e-7).sqrt()).ln());
    Ok(gaussians_of(GaussianParts {
        means: positions.iter().map(|position| position.map(narrowed)).collect(),
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; points.len()],
        log_scales: neighbours::mean_squared_distances(&positions)
            .into_iter()
            .map(|squared| [scale(squared); 3])
            .collect(),
        opacity_logits: vec![logit(opacity); points.len()],
        sh_degree: 0,
        sh: points.iter().map(|point| point.colour.map(|value| narrowed((value - 0.5) / C0))).collect(),
        scalars: None,
        filter_3d: None,
    }))
}
