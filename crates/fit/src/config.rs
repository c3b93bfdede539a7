use atsplat_splat::{MAX_SH_DEGREE, RendererConstants};
use serde::{Deserialize, Serialize};

use crate::FitError;

/// How the number of Gaussians changes, and which filters they have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// 3DGS' adaptive density control: [`crate::density::Adaptive`].
    #[serde(rename = "3dgs")]
    Gaussians3d,
    /// Mip-Splatting: adaptive density control with the [3D smoothing filter](crate::filter_3d) and the 2D Mip filter.
    MipSplatting,
    /// 3DGS-MCMC: [`crate::density::Mcmc`].
    Mcmc,
    /// The initial Gaussians, none added or removed: refinement.
    Fixed,
}

impl Strategy {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Gaussians3d, Self::MipSplatting, Self::Mcmc, Self::Fixed];

    /// Its name in arguments and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gaussians3d => "3dgs",
            Self::MipSplatting => "mip-splatting",
            Self::Mcmc => "mcmc",
            Self::Fixed => "fixed",
        }
    }
}

/// Background during optimisation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Black.
    Black,
    /// White; opacities are also reset when density control begins, see [`crate::Schedule::resets_opacities`].
    White,
    /// A random colour in each step, which makes holes visible to the loss; held-out views are rendered on black.
    Random,
    /// Any other colour: RGB in [0, 1].
    Colour([f64; 3]),
}

impl Background {
    /// A constant colour, RGB in [0, 1].
    pub fn of(rgb: [f64; 3]) -> Self {
        if rgb.iter().all(|channel| *channel <= 0.0) {
            Self::Black
        } else if rgb.iter().all(|channel| *channel >= 1.0) {
            Self::White
        } else {
            Self::Colour(rgb)
        }
    }
}

/// Learning rates of Adam: graphdeco-inria/gaussian-splatting `arguments/__init__.py`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Rates {
    /// Means in the first step, in units of the scene's extent.
    pub means: f64,
    /// Means in the last step; exponential in between.
    pub final_means: f64,
    /// Constant coefficients of the spherical harmonics; the others have a twentieth.
    pub colours: f64,
    /// Logits of opacities.
    pub opacities: f64,
    /// Logarithms of scales.
    pub scales: f64,
    /// Quaternions.
    pub rotations: f64,
}

impl Default for Rates {
    fn default() -> Self {
        Self { means: 1.6e-4, final_means: 1.6e-6, colours: 2.5e-3, opacities: 0.05, scales: 5e-3, rotations: 1e-3 }
    }
}

/// Everything that an optimisation depends on, apart from views and initial Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FitConfig {
    /// Density control and filters.
    pub strategy: Strategy,
    /// Number of steps, with which all schedules scale.
    pub steps: u64,
    /// Seed of the order of views, of density control and of random backgrounds.
    pub seed: u64,
    /// Degree of the spherical harmonics at the end.
    pub sh_degree: u8,
    /// Background.
    pub background: Background,
    /// Weight of `1 − SSIM`; the mean absolute error has the rest.
    pub d_ssim: f64,
    /// Learning rates.
    pub rates: Rates,
    /// Whether adaptive density control sums absolute gradients of single pixels, as gsplat's `absgrad`:
    /// [`crate::density::Adaptive::absolute`].
    pub absolute_gradients: bool,
    /// Initial learning rate of each view's camera, in radians, and in extents for its position; it falls to a hundredth. `None`
    /// leaves the cameras as they are. One Adam moves all views in every step, as gsplat does, which begins with 1e-5.
    pub pose_rate: Option<f64>,
    /// As `pose_rate`, for each view's exposure; graphdeco begins with 0.01.
    pub exposure_rate: Option<f64>,
    /// The scene's extent in the unit of length of the views; `None` is 3DGS' radius of the cameras, or half the
    /// median depth of the initial Gaussians if that is more.
    pub extent: Option<f64>,
    /// Largest number of Gaussians: MCMC's budget, and where the other strategies stop with [`crate::StopReason::TooManyGaussians`].
    pub max_gaussians: usize,
    /// Limit on the bytes of parameters, gradients, images ([`crate::TrainingViews`]) and the CPU's renderer; the
    /// renderer of a graphics adapter has another limit.
    pub memory_limit: u64,
    /// Thresholds of the renderer, near and far in the unit of length of the views; Mip-Splatting replaces the blur by 0.1 square
    /// pixels.
    pub constants: RendererConstants,
}

impl FitConfig {
    /// The published settings of a strategy for a number of steps, up to a million Gaussians in 8 GiB.
    pub fn new(strategy: Strategy, steps: u64) -> Self {
        Self {
            strategy,
            steps,
            seed: 0,
            sh_degree: 3,
            background: Background::Black,
            d_ssim: 0.2,
            rates: Rates::default(),
            absolute_gradients: false,
            pose_rate: None,
            exposure_rate: None,
            extent: None,
            max_gaussians: 1_000_000,
            memory_limit: 8 << 30,
            constants: RendererConstants::default(),
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`FitError::Setting`] naming the first field out of range, [`FitError::Splat`] for the renderer's constants.
    pub fn check(&self) -> Result<(), FitError> {
        let wrong = |name, expected: &str, found: &dyn std::fmt::Display| {
            Err(FitError::Setting { name, expected: expected.to_owned(), found: found.to_string() })
        };
        if self.steps == 0 {
            return wrong("steps", "at least 1", &self.steps);
        }
        if self.sh_degree > MAX_SH_DEGREE {
            return wrong("sh-degree", "at most 4", &self.sh_degree);
        }
        if self.max_gaussians == 0 {
            return wrong("max-gaussians", "at least 1", &self.max_gaussians);
        }
        if !(0.0..=1.0).contains(&self.d_ssim) {
            return wrong("d-ssim", "from 0 to 1", &self.d_ssim);
        }
        if let Background::Colour(rgb) = self.background
            && !rgb.iter().all(|channel| (0.0..=1.0).contains(channel))
        {
            return wrong("background", "channels from 0 to 1", &format!("{rgb:?}"));
        }
        if let Some(extent) = self.extent.filter(|extent| !(extent.is_finite() && *extent > 0.0)) {
            return wrong("extent", "a positive length", &extent);
        }
        for (name, rate) in [("pose-rate", self.pose_rate), ("exposure-rate", self.exposure_rate)] {
            if let Some(rate) = rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
                return wrong(name, "a positive learning rate", &rate);
            }
        }
        let Rates { means, final_means, colours, opacities, scales, rotations } = self.rates;
        for (name, rate) in [
            ("rates.means", means),
            ("rates.final-means", final_means),
            ("rates.colours", colours),
            ("rates.opacities", opacities),
            ("rates.scales", scales),
            ("rates.rotations", rotations),
        ] {
            if !(rate.is_finite() && rate > 0.0) {
                return wrong(name, "a positive learning rate", &rate);
            }
        }
        let adaptive = matches!(self.strategy, Strategy::Gaussians3d | Strategy::MipSplatting);
        if self.absolute_gradients && !adaptive {
            return wrong("absolute-gradients", "3dgs or mip-splatting", &self.strategy.name());
        }
        Ok(self.constants.check()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests run those of the list.
    #[test]
    fn all_strategies_are_in_the_list_of_all() {
        let unknown = serde_json::from_value::<Strategy>("".into()).unwrap_err().to_string();
        let all = Strategy::ALL.map(|strategy| format!("`{}`", strategy.name())).join(", ");
        assert_eq!(unknown, format!("unknown variant ``, expected one of {all}"));
    }
}
