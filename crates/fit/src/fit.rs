mod epoch;
mod gradients;
mod render;

use std::time::Instant;

use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::{Cleaning, Gaussians, RasterMode, RenderOptions, SplatError, Validation};

use crate::adam::Adam;
use crate::checkpoint::start_hash;
use crate::corrections::Corrections;
use crate::density::{Adaptive, DensityControl, DensityError, Fixed, Mcmc, StepContext};
use crate::device::{StepGradients, StepRenderer};
use crate::filter_3d::{Cameras, MIP_BLUR};
use crate::loss::PhotometricLoss;
use crate::memory::Shares;
use crate::view::{TrainingView, TrainingViews, scene_extent};
use crate::{
    Background, Diagnosis, Elapsed, FitConfig, FitDevice, FitError, History, OptimisedGaussians, Rates, Schedule,
    StepRecord, StopReason, Strategy, memory,
};

/// Steps between two computations of the 3D filter after density control has ended; none in the last ones of a run.
const FILTER_EVERY: u64 = 100;

/// An optimisation in progress.
#[derive(Debug)]
pub struct Fit {
    pub(crate) config: FitConfig,
    pub(crate) schedule: Schedule,
    pub(crate) views: TrainingViews,
    cameras: Cameras,
    extent: f64,
    pub(crate) limit: usize,
    first_degree: u8,
    /// Highest degree of the spherical harmonics so far.
    pub(crate) degree: u8,
    /// Hash of the initial Gaussians.
    pub(crate) start: String,
    pub(crate) step: u64,
    pub(crate) scene: OptimisedGaussians,
    pub(crate) density: Box<dyn DensityControl>,
    pub(crate) corrections: Corrections,
    pub(crate) history: History,
    /// When this process began, and the time before.
    pub(crate) begin: Instant,
    pub(crate) before: Elapsed,
    /// Of the initial Gaussians.
    validation: Validation,
    options: RenderOptions,
    renderer: StepRenderer,
    pub(crate) loss: PhotometricLoss,
    gradients: StepGradients,
    /// Steps of this epoch in which no Gaussian was drawn.
    pub(crate) empty_steps: u64,
}

impl Fit {
    /// An optimisation before its first step. Broken Gaussians of `start` are repaired or removed as by [`Cleaning::Repair`], see
    /// [`Self::start_validation`]; those that are left are raised to the configured degree of the spherical harmonics.
    ///
    /// # Errors
    /// [`FitError::Setting`], [`FitError::View`] or [`FitError::Start`] for what cannot be optimised.
    pub fn new(config: FitConfig, views: impl Into<TrainingViews>, start: &Gaussians) -> Result<Self, FitError> {
        let (begin, views): (_, TrainingViews) = (Instant::now(), views.into());
        config.check()?;
        views.iter().try_for_each(TrainingView::check)?;
        if views.is_empty() {
            return Err(FitError::Setting { name: "views", expected: "at least 1".to_owned(), found: "0".to_owned() });
        }
        let hash = start_hash(start);
        let (start, validation) = start.cleaned(Cleaning::Repair);
        if start.is_empty() {
            let found = format!("{}, none of them valid", validation.total);
            return Err(FitError::Start { expected: "at least one valid Gaussian", found });
        }
        let Shares { gaussians: limit, renderer: renderer_memory } = memory::shares(&config, &views, start.len())?;
        let extent = positive_extent(&config, &views, &start)?;
        let cameras = Cameras::new(views.iter().map(|view| &view.view), config.constants.near)?;
        let first_degree = start.sh_degree().min(config.sh_degree);
        let mut parts = start.with_sh_degree(config.sh_degree).into_parts();
        parts.scalars = None;
        let cpu = CpuRenderer::new(CpuOptions { memory_limit: renderer_memory, ..CpuOptions::default() });
        let mut fit = Self {
            schedule: Schedule::of(config.steps),
            corrections: Corrections::new(&config, views.len()),
            history: History::new(views.len()),
            density: density_control(&config),
            options: render_options(&config),
            begin,
            before: Elapsed::default(),
            config,
            views,
            cameras,
            extent,
            limit,
            first_degree,
            degree: first_degree,
            start: hash,
            step: 0,
            scene: OptimisedGaussians::new(crate::optimised_gaussians::gaussians_of(parts)),
            validation,
            renderer: StepRenderer { cpu, device: FitDevice::default() },
            loss: PhotometricLoss::default(),
            gradients: StepGradients::default(),
            empty_steps: 0,
        };
        fit.update_filter().map_err(|reason| fit.stopped(1, 0, reason))?;
        Ok(fit)
    }

    /// The same optimisation before its first step, rendered and differentiated on a device instead of the CPU.
    #[must_use]
    pub fn on(mut self, device: FitDevice) -> Self {
        self.renderer.device = device;
        self
    }

    /// Name of the device: adapter and driver, or `cpu`.
    pub fn device(&self) -> &str {
        self.renderer.device.name()
    }

    /// Changes the number of steps, at least those done, and with it the schedule of the rest.
    pub(crate) fn plan_steps(&mut self, steps: u64) {
        self.config.steps = steps.max(self.step);
        self.schedule = Schedule::of(self.config.steps);
    }

    /// The configuration.
    pub const fn config(&self) -> &FitConfig {
        &self.config
    }

    /// Steps done.
    pub const fn step_count(&self) -> u64 {
        self.step
    }

    /// Whether all steps are done.
    pub const fn is_complete(&self) -> bool {
        self.step >= self.config.steps
    }

    /// What happened so far, also before a resumption.
    pub const fn history(&self) -> &History {
        &self.history
    }

    /// The scene's extent in the unit of length of the views.
    pub const fn extent(&self) -> f64 {
        self.extent
    }

    /// What was wrong with the initial Gaussians, and how many of them were repaired or removed.
    pub const fn start_validation(&self) -> &Validation {
        &self.validation
    }

    /// Number of Gaussians.
    pub const fn len(&self) -> usize {
        self.scene.len()
    }

    /// Never: a scene without Gaussians stops the run.
    pub const fn is_empty(&self) -> bool {
        self.scene.is_empty()
    }

    /// The Gaussians after the last good step, with Mip-Splatting's filters.
    pub fn gaussians(&self) -> Gaussians {
        self.scene.gaussians()
    }

    /// How the Gaussians have to be rendered: constants and mode of the optimisation, degree so far, background.
    pub fn options(&self) -> RenderOptions {
        RenderOptions { max_sh_degree: self.degree, background: self.background(None), ..self.options.clone() }
    }

    /// Takes the next step. [`Diagnosis`] says which scene an error leaves.
    ///
    /// # Errors
    /// [`FitError::Stopped`] with a diagnosis, such as that of a lost device; [`FitError::Splat`] if the renderer needs more
    /// memory than its limit.
    pub fn step(&mut self) -> Result<StepRecord, FitError> {
        let step = self.step + 1;
        let number = self.view_of(step);
        let degree = self.degree_of(step);
        self.options.max_sh_degree = degree;
        self.options.background = self.background(Some(step));
        let (terms, of_view) = self.differentiate(number).map_err(|error| match error {
            FitError::Splat(SplatError::Gpu(error)) => self.stopped(step, number, StopReason::Device(error)),
            other => other,
        })?;
        if !terms.total.is_finite() {
            return Err(self.stopped(step, number, StopReason::NonFiniteLoss { l1: terms.l1, d_ssim: terms.d_ssim }));
        }
        if self.sees_nothing(step) {
            return Err(self.stopped(step, number, self.nothing_visible()));
        }
        let regularisers = self.density.regularise(&self.scene, &mut self.gradients.gaussians);
        if let Some(reason) = self.non_finite_gradients(&of_view) {
            return Err(self.stopped(step, number, reason));
        }
        self.observe(number);
        let means_rate = self.schedule.means_rate(&self.config.rates, step) * self.extent;
        self.adam(step, degree, means_rate).update(&mut self.scene, &self.gradients.gaussians);
        self.corrections.update(number, &of_view, &self.config, step, self.extent);
        let context = self.density_context(step, means_rate);
        let density = self.density.after_step(&mut self.scene, &context);
        // The record of a control that failed has no changes; its error follows.
        let changes = density.as_ref().copied().unwrap_or_default();
        (self.step, self.degree) = (step, degree);
        let record = StepRecord { step, view: number, terms, regularisers, gaussians: self.scene.len(), changes };
        self.history.add_step(&record);
        density.map_err(|error| match error {
            DensityError::Stop(reason) => self.stopped(step, number, reason),
            DensityError::Splat(error) => error.into(),
        })?;
        let late = step > self.schedule.density_until && step + FILTER_EVERY < self.schedule.steps;
        if changes.affect_gaussians() || (late && step.is_multiple_of(FILTER_EVERY)) {
            self.update_filter().map_err(|reason| self.stopped(step, number, reason))?;
        }
        Ok(record)
    }

    fn adam(&self, step: u64, sh_degree: u8, means: f64) -> Adam {
        let Rates { colours, opacities, scales, rotations, .. } = self.config.rates;
        Adam { means, colours, opacities, scales, rotations, sh_degree, step }
    }

    fn density_context(&self, step: u64, means_rate: f64) -> StepContext {
        StepContext {
            step,
            schedule: self.schedule,
            extent: self.extent,
            means_rate,
            white: self.config.background == Background::White,
            seed: self.config.seed,
            limit: self.limit,
        }
    }

    /// Computes the 3D filter, if the strategy has one.
    fn update_filter(&mut self) -> Result<(), StopReason> {
        if self.config.strategy == Strategy::MipSplatting {
            self.scene.parts.filter_3d = Some(self.cameras.filters(&self.scene.parts.means)?);
        }
        Ok(())
    }

    fn stopped(&self, step: u64, view: usize, reason: StopReason) -> FitError {
        let view = self.views.get(view).map_or_else(String::new, |view| view.name.clone());
        FitError::Stopped(Box::new(Diagnosis { step, view, gaussians: self.scene.len(), reason }))
    }
}

fn density_control(config: &FitConfig) -> Box<dyn DensityControl> {
    match config.strategy {
        Strategy::Fixed => Box::new(Fixed),
        Strategy::Mcmc => Box::new(Mcmc),
        _ if config.absolute_gradients => Box::new(Adaptive::absolute()),
        Strategy::Gaussians3d | Strategy::MipSplatting => Box::new(Adaptive::default()),
    }
}

fn render_options(config: &FitConfig) -> RenderOptions {
    let mut options = RenderOptions { constants: config.constants.clone(), ..RenderOptions::default() };
    if config.strategy == Strategy::MipSplatting {
        options.constants.blur = MIP_BLUR;
        options.mode = RasterMode::Antialiased;
    }
    options
}

/// The configured extent, or that of the views and the initial Gaussians.
fn positive_extent(config: &FitConfig, views: &TrainingViews, start: &Gaussians) -> Result<f64, FitError> {
    let extent = config.extent.map_or_else(|| scene_extent(views, &start.parts().means), Ok)?;
    if extent.is_nan() || extent <= 0.0 {
        let expected = "cameras in different places that see the initial Gaussians, or an explicit extent".to_owned();
        return Err(FitError::Setting { name: "extent", expected, found: extent.to_string() });
    }
    Ok(extent)
}

#[cfg(test)]
mod tests;
