use std::time::Instant;

use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::{Cleaning, Exposure, Gaussians, RasterMode, RenderOptions, Rendering, SplatError, View};
use pulp::Arch;
use rayon::prelude::*;

use crate::adam::Adam;
use crate::checkpoint::start_hash;
use crate::corrections::{CorrectionGradients, Corrections};
use crate::density::{Adaptive, Changes, DensityControl, DensityError, Fixed, Mcmc, StepContext, ViewGradients};
use crate::device::{Derivative, Job, Splatter};
use crate::filter_3d::{Cameras, MIP_BLUR};
use crate::loss::{PhotometricLoss, Terms};
use crate::random::{Purpose, stream, uniform};
use crate::view::{TrainingView, scene_extent};
use crate::{
    Background, Diagnosis, Elapsed, Fault, FitConfig, FitDevice, FitError, History, OptimisedGaussians, Schedule,
    Strategy, memory,
};

/// Gradients that are checked at once.
const CHUNK: usize = 1 << 14;
/// Steps between two computations of the 3D filter after density control has ended; none in the last ones of a run.
const FILTER_EVERY: u64 = 100;

/// An optimisation in progress.
#[derive(Debug)]
pub struct Fit {
    pub(crate) config: FitConfig,
    pub(crate) schedule: Schedule,
    pub(crate) views: Vec<TrainingView>,
    cameras: Cameras,
    extent: f64,
    pub(crate) limit: usize,
    first_degree: u8,
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
    dropped: usize,
    options: RenderOptions,
    pub(crate) splatter: Splatter,
    loss: PhotometricLoss,
    derivative: Derivative,
    /// Steps of this epoch in which no Gaussian was drawn.
    pub(crate) empty_steps: u64,
}

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepRecord {
    /// Counted from 1.
    pub step: u64,
    /// Position of the training view.
    pub view: usize,
    /// Terms of the loss.
    pub terms: Terms,
    /// Sum of the strategy's regularisers, which the total of the terms does not include.
    pub regularisers: f64,
    /// Gaussians after the step.
    pub gaussians: usize,
    /// What density control changed.
    pub changes: Changes,
}

impl StepRecord {
    /// PSNR of the training image, in dB; infinite for an exact one.
    pub fn psnr(&self) -> f64 {
        psnr(self.terms.mse)
    }
}

/// How well an image matches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// PSNR of colours clamped to [0, 1], not rounded to 8 bits; in dB.
    pub psnr: f64,
    /// SSIM as the loss computes it.
    pub ssim: f64,
}

impl Fit {
    /// An optimisation before its first step. Invalid Gaussians of `start` are dropped, see
    /// [`Self::dropped`]; the others are raised to the configured degree of the spherical harmonics.
    ///
    /// # Errors
    /// [`FitError::Setting`], [`FitError::View`] or [`FitError::Start`] for what cannot be optimised.
    pub fn new(config: FitConfig, views: Vec<TrainingView>, start: &Gaussians) -> Result<Self, FitError> {
        let begin = Instant::now();
        config.check()?;
        views.iter().try_for_each(TrainingView::check)?;
        if views.is_empty() {
            return Err(FitError::Setting { name: "views", expected: "at least 1".to_owned(), found: "0".to_owned() });
        }
        let hash = start_hash(start);
        let (start, found) = start.cleaned(Cleaning::Repair);
        if start.is_empty() {
            let found = format!("{}, none of them valid", found.total);
            return Err(FitError::Start { expected: "at least one valid Gaussian", found });
        }
        let extent = config.extent.map_or_else(|| scene_extent(&views, &start.parts().means), Ok)?;
        if extent.is_nan() || extent <= 0.0 {
            let expected =
                "cameras in different places that see the initial Gaussians, or an explicit extent".to_owned();
            return Err(FitError::Setting { name: "extent", expected, found: extent.to_string() });
        }
        let limit = memory::most_gaussians(&config, &views, start.len())?;
        let cameras = Cameras::new(views.iter().map(|view| &view.view), config.constants.near)?;
        let mut parts = start.with_sh_degree(config.sh_degree).into_parts();
        parts.scalars = None;
        let first_degree = start.sh_degree().min(config.sh_degree);
        let density: Box<dyn DensityControl> = match config.strategy {
            Strategy::Fixed => Box::new(Fixed),
            Strategy::Mcmc => Box::new(Mcmc),
            _ if config.absolute_gradients => Box::new(Adaptive::absolute()),
            Strategy::Gaussians3d | Strategy::MipSplatting => Box::new(Adaptive::default()),
        };
        let mut options = RenderOptions { constants: config.constants.clone(), ..RenderOptions::default() };
        if config.strategy == Strategy::MipSplatting {
            options.constants.blur = MIP_BLUR;
            options.mode = RasterMode::Antialiased;
        }
        let cpu = CpuRenderer::new(CpuOptions { memory_limit: config.memory_limit, ..CpuOptions::default() });
        let mut fit = Self {
            schedule: Schedule::of(config.steps),
            corrections: Corrections::new(&config, views.len()),
            history: History::new(views.len()),
            begin,
            before: Elapsed::default(),
            config,
            views,
            cameras,
            extent,
            limit,
            first_degree,
            start: hash,
            step: 0,
            scene: OptimisedGaussians::new(crate::optimised_gaussians::whole(parts)),
            density,
            dropped: found.rejected,
            options,
            splatter: Splatter { cpu, device: FitDevice::default() },
            loss: PhotometricLoss::default(),
            derivative: Derivative::default(),
            empty_steps: 0,
        };
        fit.filter().map_err(|fault| fit.stopped(1, 0, fault))?;
        Ok(fit)
    }

    /// The same optimisation before its first step, rendered and differentiated on a device instead of the CPU.
    #[must_use]
    pub fn on(mut self, device: FitDevice) -> Self {
        self.splatter.device = device;
        self
    }

    /// Name of the device: adapter and driver, or `cpu`.
    pub fn device(&self) -> &str {
        self.splatter.device.name()
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

    /// Initial Gaussians that were dropped because they are invalid.
    pub const fn dropped(&self) -> usize {
        self.dropped
    }

    /// Number of Gaussians.
    pub const fn len(&self) -> usize {
        self.scene.len()
    }

    /// Never: a scene without Gaussians is a fault.
    pub const fn is_empty(&self) -> bool {
        self.scene.is_empty()
    }

    /// The Gaussians after the last good step, with Mip-Splatting's filters.
    pub fn gaussians(&self) -> Gaussians {
        self.scene.gaussians()
    }

    /// How the Gaussians have to be rendered: constants and mode of the optimisation, degree so far, background.
    pub fn options(&self) -> RenderOptions {
        let max_sh_degree = self.schedule.degree(self.first_degree, self.config.sh_degree, self.step);
        RenderOptions { max_sh_degree, background: self.background(None), ..self.options.clone() }
    }

    /// Takes the next step. If density control fails, the optimiser's update stays, and the step counts as done; after any other error
    /// the scene is that of the step before.
    ///
    /// # Errors
    /// [`FitError::Stopped`] with a diagnosis, such as that of a lost device; [`FitError::Splat`] if the renderer needs more
    /// memory than its limit.
    pub fn step(&mut self) -> Result<StepRecord, FitError> {
        let step = self.step + 1;
        let number = self.view_of(step);
        let degree = self.schedule.degree(self.first_degree, self.config.sh_degree, step);
        self.options.max_sh_degree = degree;
        self.options.background = self.background(Some(step));
        let (terms, slopes) = self.differentiate(number).map_err(|error| match error {
            FitError::Splat(SplatError::Gpu(error)) => self.stopped(step, number, Fault::Device(error)),
            other => other,
        })?;
        if !terms.total.is_finite() {
            return Err(self.stopped(step, number, Fault::Loss { l1: terms.l1, d_ssim: terms.d_ssim }));
        }
        if self.sees_nothing(step) {
            return Err(self.stopped(step, number, Fault::Unseen { near: self.options.constants.near }));
        }
        let regularisers = self.density.regularise(&self.scene, &mut self.derivative.gradients);
        if let Some(fault) = self.broken_gradient() {
            return Err(self.stopped(step, number, fault));
        }
        let rates = self.config.rates;
        let means_rate = self.schedule.means_rate(&rates, step) * self.extent;
        let adam = Adam {
            means: means_rate,
            colours: rates.colours,
            opacities: rates.opacities,
            scales: rates.scales,
            rotations: rates.rotations,
            sh_degree: degree,
            step,
        };
        adam.update(&mut self.scene, &self.derivative.gradients);
        self.corrections.update(number, &slopes, &self.config, (step, self.extent));
        let at = StepContext {
            step,
            schedule: self.schedule,
            extent: self.extent,
            means_rate,
            white: self.config.background == Background::White,
            seed: self.config.seed,
            limit: self.limit,
        };
        let density = self.density.after_step(&mut self.scene, &at);
        // The record of a control that failed has no changes; its error follows.
        let changes = density.as_ref().copied().unwrap_or_default();
        self.step = step;
        let record = StepRecord { step, view: number, terms, regularisers, gaussians: self.scene.len(), changes };
        self.history.add_step(&record);
        density.map_err(|error| match error {
            DensityError::Fault(fault) => self.stopped(step, number, fault),
            DensityError::Splat(error) => error.into(),
        })?;
        let late = step > self.schedule.density_until && step + FILTER_EVERY < self.schedule.steps;
        if changes.of_gaussians() || (late && step.is_multiple_of(FILTER_EVERY)) {
            self.filter().map_err(|fault| self.stopped(step, number, fault))?;
        }
        Ok(record)
    }

    /// A training view with its optimised camera, by position.
    ///
    /// # Errors
    /// [`FitError::Camera`] for a motion that is not finite.
    pub fn optimised_view(&self, number: usize) -> Result<Option<View>, FitError> {
        self.views.get(number).map(|own| self.corrections.view(number, &own.view)).transpose()
    }

    /// The optimised exposure of a training view, by position; `None` if exposures are not optimised.
    pub fn exposure(&self, number: usize) -> Option<Exposure> {
        self.config.exposure_rate.and_then(|_| self.corrections.exposure(number))
    }

    /// Forward and backward pass of one training view.
    fn differentiate(&mut self, number: usize) -> Result<(Terms, CorrectionGradients), FitError> {
        let exposure = self.exposure(number);
        let Self { views, scene, options, splatter, loss, derivative, density, config, .. } = self;
        #[expect(clippy::expect_used, reason = "the order of views is a permutation")]
        let TrainingView { view, rgb, .. } = views.get(number).expect("a view of the run");
        let view = &self.corrections.view(number, view)?;
        scene.with_gaussians(|gaussians| {
            let absolute = config.absolute_gradients;
            let job = Job { gaussians, view, options, absolute };
            let (terms, d_exposure) = splatter.differentiate(job, derivative, |rendered, slopes| {
                let exposed = exposure.map(|exposure| exposed(&exposure, rendered));
                let shown = exposed.as_deref().unwrap_or(rendered);
                let terms = loss.evaluate(shown, rgb, view.size, config.d_ssim, slopes);
                let d_exposure = exposure.map(|_| Exposure::gradient(rendered, slopes)).transpose()?;
                if let Some(exposure) = exposure {
                    for slope in slopes.iter_mut() {
                        *slope = before(&exposure, *slope);
                    }
                }
                Ok((terms, d_exposure))
            })?;
            let Derivative { gradients, screen, .. } = derivative;
            if terms.total.is_finite() {
                let means_2d = if absolute { &screen.absolute_2d } else { &gradients.means_2d };
                let size = [f64::from(view.size.width), f64::from(view.size.height)];
                density.observe(&ViewGradients { drawn: &screen.drawn, means_2d, size, count: gaussians.len() });
            }
            Ok((terms, CorrectionGradients { pose: gradients.pose, exposure: d_exposure }))
        })
    }

    /// Renders a view as the optimisation does, on the configured background, black for a random one.
    ///
    /// # Errors
    /// [`FitError::Splat`].
    pub fn render(&mut self, view: &View) -> Result<Rendering<f32>, FitError> {
        self.render_exposed(view, None)
    }

    fn render_exposed(&mut self, view: &View, exposure: Option<Exposure>) -> Result<Rendering<f32>, FitError> {
        let options = RenderOptions { exposure, ..self.options() };
        let Self { scene, splatter, .. } = self;
        Ok(scene.with_gaussians(|gaussians| splatter.render(gaussians, view, &options))?)
    }

    /// Compares the render of a view with its image.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn score(&mut self, view: &TrainingView) -> Result<Score, FitError> {
        view.check()?;
        let rendering = self.render(&view.view)?;
        Ok(score(&mut self.loss, &rendering.rgb, view))
    }

    /// Renders a training view, by position, as the optimisation does, with its optimised camera and exposure, and compares it with
    /// its image; `None` if there is no such view.
    ///
    /// # Errors
    /// As [`Self::render`] and [`Self::optimised_view`].
    pub fn render_training(&mut self, number: usize) -> Result<Option<(Rendering<f32>, Score)>, FitError> {
        let Some(view) = self.optimised_view(number)? else { return Ok(None) };
        let rendering = self.render_exposed(&view, self.exposure(number))?;
        let Self { views, loss, .. } = self;
        let score = views.get(number).map(|own| score(loss, &rendering.rgb, own));
        Ok(score.map(|score| (rendering, score)))
    }

    /// The view of a step: a random permutation of all views in each epoch.
    fn view_of(&self, step: u64) -> usize {
        let count = self.views.len() as u64;
        let (epoch, position) = ((step - 1) / count, (step - 1) % count);
        let order = stream(self.config.seed, Purpose::Order, epoch).permutation(self.views.len());
        #[expect(clippy::expect_used, reason = "a remainder is below the number of views")]
        usize::try_from(position)
            .ok()
            .and_then(|position| order.get(position).copied())
            .expect("a position of the order")
    }

    fn background(&self, step: Option<u64>) -> [f64; 3] {
        match (self.config.background, step) {
            (Background::White, _) => [1.0; 3],
            (Background::Colour(rgb), _) => rgb,
            (Background::Random, Some(step)) => {
                let mut random = stream(self.config.seed, Purpose::Background, step);
                std::array::from_fn(|_| uniform(&mut random))
            }
            (Background::Black, _) | (Background::Random, None) => [0.0; 3],
        }
    }

    /// Computes the 3D filter, if the strategy has one.
    fn filter(&mut self) -> Result<(), Fault> {
        if self.config.strategy == Strategy::MipSplatting {
            self.scene.parts.filter_3d = Some(self.cameras.filters(&self.scene.parts.means)?);
        }
        Ok(())
    }

    /// Whether `step` ends an epoch in which no Gaussian was drawn. One view may see none of them; if none does, no step changes
    /// anything.
    fn sees_nothing(&mut self, step: u64) -> bool {
        let epoch = self.views.len() as u64;
        if step % epoch == 1 % epoch {
            self.empty_steps = 0;
        }
        self.empty_steps += u64::from(self.derivative.screen.drawn.is_empty());
        self.empty_steps == epoch
    }

    /// Fails a run that ended before its first epoch did and saw nothing until then.
    pub(crate) fn check_short_run(&self) -> Result<(), FitError> {
        if self.step == 0 || self.empty_steps < self.step {
            return Ok(());
        }
        Err(self.stopped(self.step, self.view_of(self.step), Fault::Unseen { near: self.options.constants.near }))
    }

    fn broken_gradient(&self) -> Option<Fault> {
        let used = ["means", "quaternions", "log_scales", "opacity_logits", "sh", "pose"];
        let fields = self.derivative.gradients.fields().into_iter().filter(|(name, _)| used.contains(name));
        fields.into_iter().find_map(|(parameter, values)| {
            let broken = |values: &[f32]| values.iter().filter(|value| !value.is_finite()).count();
            let count =
                values.par_chunks(CHUNK).map(|values| if all_finite(values) { 0 } else { broken(values) }).sum();
            (count > 0).then_some(Fault::Gradients { parameter, count })
        })
    }

    fn stopped(&self, step: u64, view: usize, fault: Fault) -> FitError {
        let view = self.views.get(view).map_or_else(String::new, |view| view.name.clone());
        FitError::Stopped(Box::new(Diagnosis { step, view, gaussians: self.scene.len(), fault }))
    }
}

/// Compares an image with that of a view of its size.
fn score(loss: &mut PhotometricLoss, rgb: &[[f32; 3]], view: &TrainingView) -> Score {
    let terms = loss.evaluate(rgb, &view.rgb, view.view.size, 1.0, &mut Vec::new());
    Score { psnr: psnr(terms.mse), ssim: 1.0 - terms.d_ssim }
}

/// The image as an exposure shows it.
fn exposed(exposure: &Exposure, rgb: &[[f32; 3]]) -> Vec<[f32; 3]> {
    rgb.iter().map(|rgb| exposure.of(rgb.map(f64::from)).map(crate::optimised_gaussians::narrowed)).collect()
}

/// The gradient with respect to a pixel before exposure.
fn before(exposure: &Exposure, slope: [f32; 3]) -> [f32; 3] {
    let [a, b, c] = exposure.matrix;
    let column = |at: usize| {
        let rows = [a, b, c].into_iter().zip(slope);
        rows.map(|(row, slope)| row[at] * f64::from(slope)).sum::<f64>()
    };
    [column(0), column(1), column(2)].map(crate::optimised_gaussians::narrowed)
}

/// Whether all values are finite: infinities and NaN have the largest exponents.
fn all_finite(values: &[f32]) -> bool {
    const MAGNITUDE: u32 = u32::MAX >> 1;
    let largest = |most: u32, value: &f32| most.max(value.to_bits() & MAGNITUDE);
    Arch::new().dispatch(|| values.iter().fold(0, largest)) < f32::INFINITY.to_bits()
}

/// In dB, of values in [0, 1].
pub(crate) fn psnr(mse: f64) -> f64 {
    -10.0 * mse.log10()
}
