use std::time::Instant;

use atsplat_camera::{CentreSpread, WorldFromCamera};
use atsplat_fit::start::in_frustums;
use atsplat_fit::{Background, Budget, Fit, FitConfig, FitError, LastSteps, Strategy, TrainingView, TrainingViews};
use atsplat_model::ModelConfig;
use atsplat_model::network::Network;
use atsplat_results::{MethodRecord, TrainingRecord, TrialNote};
use atsplat_splat::Gaussians;

use super::atsplat::{LargeImages, context_views, method_error};
use super::splatting::{Splatting, broken_start_note, parameters};
use super::{Cost, Method, MethodError, Prediction, TrainedUnder, TrialInput, WeightsSource, trial_seed};
use crate::fitting::training_view;
use crate::timing::this_machine;
use crate::{EvalError, adapter_record};

/// Points of a random start.
pub const START_POINTS: usize = 5000;
/// Default maximum number of Gaussians of an optimisation from a random start.
pub const MAX_GAUSSIANS: usize = 100_000;

/// Gaussians optimised for each trial on its context views: 3DGS, Mip-Splatting and MCMC from a random start, or the
/// refinement of a network's Gaussians; rendered and differentiated by the backend that renders the targets.
///
/// The papers start 3DGS and Mip-Splatting from COLMAP's points of the context views; trials have none, so random points
/// seen by the context cameras are used instead, and each row says so.
#[derive(Debug)]
pub struct Optimised {
    strategy: Strategy,
    budget: Budget,
    seed: u64,
    /// Maximum number of Gaussians; `None` for a refinement, which keeps that of its network.
    limit: Option<usize>,
    /// Makes the Gaussians to start from.
    network: Option<Network>,
    /// Used instead of `network` for large images.
    large_images: Option<LargeImages>,
    splatting: Splatting,
    record: MethodRecord,
    /// Of the network, if it is known.
    trained_under: TrainedUnder,
}

/// The note about the steps that an optimisation took. How many fit into a time depends on the machine, which is then named.
fn steps_note(budget: Budget, steps: u64) -> String {
    let machine = match budget {
        Budget::Steps(_) => None,
        Budget::Seconds(_) => Some(this_machine().to_string()),
    };
    TrialNote::StepsTaken { steps, machine: machine.as_deref() }.to_string()
}

/// The note about context views that the PSNR on them leaves out.
fn left_out_note(LastSteps { views, identical, .. }: LastSteps) -> Option<String> {
    let all = views + identical;
    (identical > 0).then(|| {
        format!("the PSNR on the context views leaves out {identical} of {all}, whose render was equal to the image")
    })
}

impl Optimised {
    /// Optimisation from a random start.
    pub fn from_scratch(
        name: Option<&str>,
        strategy: Strategy,
        budget: Budget,
        limit: usize,
        seed: u64,
        splatting: Splatting,
    ) -> Self {
        let title = match strategy {
            Strategy::Gaussians3d => "3DGS",
            Strategy::MipSplatting => "Mip-Splatting",
            Strategy::Mcmc => "3DGS-MCMC",
            Strategy::Fixed => "fixed number of Gaussians",
        };
        let record = MethodRecord {
            name: name.map_or_else(|| format!("{}-{budget}", strategy.name()), str::to_owned),
            kind: strategy.name().to_owned(),
            title: format!("{title} ({budget})"),
            ..MethodRecord::default()
        };
        let (limit, network, large_images, trained_under) = (Some(limit), None, None, TrainedUnder::default());
        Self { strategy, budget, seed, limit, network, large_images, splatting, record, trained_under }.described()
    }

    /// Refinement of a network's Gaussians, without changing their number.
    ///
    /// # Errors
    /// [`EvalError::Model`] for a configuration that cannot be hashed.
    pub fn refined(
        name: Option<&str>,
        network: Network,
        weights: &WeightsSource,
        budget: Budget,
        seed: u64,
        splatting: Splatting,
    ) -> Result<Self, EvalError> {
        let config = network.config();
        let untrained = matches!(weights, WeightsSource::Random { .. });
        let suffix = if untrained { ", untrained" } else { "" };
        let mut record = MethodRecord {
            name: name.map_or_else(|| format!("atsplat+refine-{budget}"), str::to_owned),
            kind: "atsplat+refine".to_owned(),
            title: format!("ATSplat + refinement ({}, {budget}{suffix})", config.name),
            ..MethodRecord::default()
        };
        weights.describe(&network, &mut record)?;
        let (strategy, network, trained_under) = (Strategy::Fixed, Some(network), TrainedUnder::default());
        let (limit, large_images) = (None, None);
        Ok(Self { strategy, budget, seed, limit, network, large_images, splatting, record, trained_under }.described())
    }

    /// Adds the network's configuration for large images, as [`super::AtSplat::with_high_resolution`].
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a configuration that JSON cannot represent.
    pub fn with_high_resolution(mut self, config: Option<ModelConfig>) -> Result<Self, EvalError> {
        self.large_images = config.map(|config| LargeImages::recorded(config, &mut self.record)).transpose()?;
        Ok(self)
    }

    /// Records how the network's weights were trained, as [`super::AtSplat::with_training`].
    #[must_use]
    pub fn with_training(mut self, training: Option<TrainingRecord>, under: TrainedUnder) -> Self {
        (self.record.training, self.trained_under) = (training, under);
        self
    }

    /// Completes the record.
    fn described(mut self) -> Self {
        let budget = match self.budget {
            Budget::Steps(steps) => ("steps", steps.into()),
            Budget::Seconds(seconds) => ("seconds", seconds.into()),
        };
        let start = if self.network.is_some() { "the network's Gaussians" } else { "random points in the frustums" };
        self.record.parameters.extend(parameters([
            budget,
            ("strategy", self.strategy.name().into()),
            ("start", start.into()),
            ("seed", self.seed.into()),
        ]));
        if let Some(limit) = self.limit {
            self.record.parameters.extend(parameters([("max-gaussians", limit.into())]));
        }
        self.splatting.describe(&mut self.record);
        if self.splatting.backend.adapter().is_some() {
            self.record.parameters.extend(parameters([("optimised-on", "the renderer's adapter".into())]));
        }
        if let Some(network) = &self.network {
            self.record.record_network(network.adapter().as_ref().map(adapter_record));
        }
        // How many steps fit into a time differs from run to run.
        self.record.deterministic &= matches!(self.budget, Budget::Steps(_));
        self
    }

    fn config(&self, input: &TrialInput<'_>) -> FitConfig {
        let convention = &input.preset.renderer;
        FitConfig {
            seed: trial_seed(self.seed, input.trial),
            background: Background::of(self.splatting.background_of(input)),
            max_gaussians: self.limit.unwrap_or(usize::MAX),
            constants: self.splatting.constants.constants_for(convention, input.trial.near_far()),
            ..FitConfig::new(self.strategy, 1)
        }
    }

    fn start(
        &self,
        input: &TrialInput<'_>,
        views: &[TrainingView],
        config: &mut FitConfig,
        cost: &mut Cost,
    ) -> Result<Gaussians, MethodError> {
        let Some(network) = &self.network else {
            cost.notes.push("random points stand in for COLMAP's: a trial has none".to_owned());
            let points = START_POINTS.min(config.max_gaussians);
            let near = config.constants.near;
            return in_frustums(views, points, None, near, config.seed, self.strategy).map_err(failed);
        };
        cost.notes.extend(self.trained_under.notes(input, self.setting(), &self.splatting));
        let given = context_views(input)?;
        let made = LargeImages::network_for(self.large_images.as_ref(), network, given.size())
            .and_then(|network| network.reconstruct(&given, config.seed))
            .map_err(|error| method_error(&error))?;
        cost.initial_tokens = Some(made.budget.initial_tokens as u64);
        cost.final_tokens = Some(made.budget.final_tokens as u64);
        cost.stages.extend(made.seconds.stages().map(|(name, secs)| (name.to_owned(), secs)));
        config.max_gaussians = made.gaussians.len();
        config.sh_degree = made.gaussians.sh_degree();
        Ok(made.gaussians)
    }
}

impl Method for Optimised {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn runs_alone(&self) -> bool {
        true
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let context = input.trial.context().iter().zip(input.images);
        let views: Vec<TrainingView> = context
            .map(|(view, image)| training_view(format!("frame {}", view.frame), view.camera, view.size, image))
            .collect();
        let views = TrainingViews::from(views);
        let poses: Vec<WorldFromCamera> =
            views.iter().map(|view| view.view.camera.camera_from_world.inverse()).collect();
        if self.network.is_none() && CentreSpread::of(&poses) != CentreSpread::Apart {
            return Err(MethodError::NotApplicable("all context cameras are in the same place".to_owned()));
        }
        let mut cost = Cost::default();
        let mut config = self.config(&input);
        let start = self.start(&input, &views, &mut config, &mut cost)?;
        let begin = Instant::now();
        let device = self.splatting.backend.fit_device();
        let (steps, deadline) = self.budget.plan(&config, &views, &start, &device).map_err(failed)?;
        config.steps = steps;
        let mut fit = Fit::new(config, views, &start).map_err(failed)?.on(device);
        cost.notes.extend(broken_start_note(fit.start_validation()));
        fit.run(deadline, |_, _| Ok::<_, FitError>(())).map_err(failed)?;
        if fit.step_count() == 0 {
            return Err(MethodError::Failed("the time was over before the first step".to_owned()));
        }
        cost.stages.insert("optimisation".to_owned(), begin.elapsed().as_secs_f64());
        // Of the last step on each view, so that overfitting shows next to the held-out PSNR.
        let last = fit.history().last_steps();
        cost.context_psnr = last.psnr;
        cost.notes.extend(left_out_note(last));
        cost.notes.push(steps_note(self.budget, fit.step_count()));
        Ok(self.splatting.predict_as_optimised(input, fit.gaussians(), &fit.options(), cost))
    }
}

#[expect(clippy::needless_pass_by_value, reason = "an error to convert")]
fn failed(error: FitError) -> MethodError {
    MethodError::Failed(error.to_string())
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use atsplat_model::ImageSize;
    use atsplat_model::network::Device;
    use atsplat_model::parameters::parameters;
    use atsplat_model::weights::generated;
    use atsplat_pixels::ImageU8;
    use atsplat_protocol::Preset;
    use atsplat_results::{AdapterRecord, RecordKind};
    use atsplat_splat::Renderer;
    use atsplat_splat::gpu::{AdapterChoice, GpuError, GpuOptions, GpuRenderer};

    use super::*;
    use crate::method::atsplat::tests::trials;
    use crate::method::{AtSplat, Backend};

    /// Of the last step on each view, also after a number of steps that is not a multiple of theirs.
    #[test]
    fn the_context_psnr_is_over_all_views() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        for steps in [3, 5, 7] {
            let budget = Budget::Steps(steps);
            let method = Optimised::from_scratch(None, Strategy::Mcmc, budget, 400, 0, Splatting::default());
            let context = trial.context().iter().zip(&images);
            let views: Vec<TrainingView> =
                context.map(|(view, image)| training_view(String::new(), view.camera, view.size, image)).collect();
            let mut config = method.config(&input);
            let start = method.start(&input, &views, &mut config, &mut Cost::default()).unwrap();
            config.steps = steps;
            let mut fit = Fit::new(config, views, &start).unwrap();
            let mut last = std::collections::BTreeMap::new();
            fit.run(None, |_, step| {
                last.insert(step.view, step.psnr());
                Ok::<_, FitError>(())
            })
            .unwrap();
            let expected = last.values().sum::<f64>() / 2.0;
            let found = method.predict(input).unwrap().cost().context_psnr.unwrap();
            atsplat_numeric::Tolerance::relative(1e-12).assert([found], [expected], "both views");
            assert_eq!(last.len(), 2);
        }
    }

    /// Without the note, the PSNR of the others would pass for that of all.
    #[test]
    fn context_views_that_the_psnr_leaves_out_are_noted() {
        let of = |views, identical| left_out_note(LastSteps { psnr: Some(30.0), views, identical });
        assert_eq!(of(3, 0), None);
        let expected = "the PSNR on the context views leaves out 1 of 3, whose render was equal to the image";
        assert_eq!(of(2, 1).as_deref(), Some(expected));
    }

    #[test]
    fn records_name_known_kinds() {
        for strategy in Strategy::ALL {
            let method =
                Optimised::from_scratch(None, strategy, Budget::Steps(1), 400, 0, Splatting::default()).record();
            assert_eq!(method.record_kind(), RecordKind::Optimised, "{}", method.kind);
        }
    }

    #[test]
    fn optimises_the_context_of_a_trial_within_its_budget() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let scratch = |strategy, budget| Optimised::from_scratch(None, strategy, budget, 400, 0, Splatting::default());
        let rendered = |method: &Optimised| {
            let prediction = method.predict(input).unwrap();
            let cost = prediction.cost();
            assert!(cost.stages["optimisation"] > 0.0 && cost.gaussians.is_some_and(|count| count > 0), "{cost:?}");
            assert!(cost.context_psnr.is_some_and(|psnr| psnr > 0.0), "{cost:?}");
            (cost, prediction.render(&[0]).remove(0).unwrap().image)
        };
        let steps = |count| scratch(Strategy::MipSplatting, Budget::Steps(count));
        let ((cost, first), (_, again), (_, longer)) = (rendered(&steps(2)), rendered(&steps(2)), rendered(&steps(12)));
        assert!(first == again && first != longer);
        assert!(cost.notes.iter().any(|note| note.contains("stand in for COLMAP")), "{:?}", cost.notes);
        assert!(cost.notes.iter().any(|note| note == "optimisation: 2 steps"), "{:?}", cost.notes);
        let long = rendered(&steps(60)).0.context_psnr;
        assert!(long > cost.context_psnr, "it fits its context views better and better: {long:?}");
        assert_eq!((steps(2).record().name.as_str(), steps(2).record().deterministic), ("mip-splatting-2", true));
        let timed = scratch(Strategy::Mcmc, Budget::Seconds(0.2));
        let (cost, _) = rendered(&timed);
        assert!(!timed.record().deterministic && cost.gaussians.is_some_and(|count| count <= 400));
        let on = format!(" steps in its time on {}", this_machine());
        let says = |note: &String| note.starts_with("optimisation: ") && note.ends_with(&on);
        assert!(cost.notes.iter().any(says), "{:?}", cost.notes);

        let method = refined(Splatting::default());
        let (cost, _) = rendered(&method);
        assert!(cost.final_tokens.is_some() && method.record().untrained);
    }

    /// A refinement keeps the number of its network, which is not a limit.
    #[test]
    fn the_record_states_a_limit_only_where_there_is_one() {
        let budget = Budget::Steps(2);
        let scratch = Optimised::from_scratch(None, Strategy::Mcmc, budget, 400, 0, Splatting::default());
        let limit = |method: &Optimised| method.record().parameters.get("max-gaussians").cloned();
        assert_eq!((limit(&scratch), limit(&refined(Splatting::default()))), (Some(400.into()), None));
    }

    #[test]
    fn an_optimisation_without_a_step_is_a_failure() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let budget = Budget::Seconds(1e-9);
        let method = Optimised::from_scratch(None, Strategy::Mcmc, budget, 400, 0, Splatting::default());
        let why = method.predict(input).err().unwrap();
        assert!(matches!(&why, MethodError::Failed(why) if why == "the time was over before the first step"), "{why}");
    }

    #[test]
    fn a_refinement_keeps_the_training_of_its_network() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let evaluated = preset.setting_for("ATSplat").pose_normalisation.name();
        let training = Some(TrainingRecord { data: "yards".to_owned(), seed: None });
        let found = |poses: &str| {
            let under = TrainedUnder { poses: Some(poses.to_owned()), background: None };
            let method = refined(Splatting::default()).with_training(training.clone(), under);
            let input = TrialInput { preset: &preset, trial: &trial, images: &images };
            let notes = method.predict(input).unwrap().cost().notes;
            assert_eq!(method.record().training, training);
            notes.into_iter().filter(|note| note.starts_with("trained with")).collect::<Vec<_>>()
        };
        let other = format!("trained with the pose normalisation baseline-one, evaluated with {evaluated}");
        assert_eq!((found("baseline-one"), found(&evaluated)), (vec![other], Vec::new()));
    }

    /// Patches of 16 pixels do not divide it. The network alone does not support it either.
    #[test]
    fn a_size_that_the_network_does_not_take_does_not_count_as_a_failure() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let image = Arc::new(ImageU8::new(100, 100, vec![9; 30_000]).unwrap());
        let images = vec![image; images.len()];
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let method = refined(Splatting::default());
        let why = method.predict(input).err().unwrap();
        assert!(matches!(&why, MethodError::NotApplicable(why) if why.contains("divisible by 16")), "{why}");
    }

    /// Between the Gaussians of the start, images show the background.
    #[test]
    fn optimises_on_the_background_that_targets_are_rendered_on() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let on = |background: [f64; 3]| {
            let splatting = Splatting { background: Some(background), ..Splatting::default() };
            let method = Optimised::from_scratch(None, Strategy::Mcmc, Budget::Steps(2), 400, 0, splatting);
            let cost = method.predict(input).unwrap().cost();
            (method.config(&input).background, cost.context_psnr.unwrap().to_bits())
        };
        let colour = [0.25, 0.5, 0.75];
        let [(black, on_black), (coloured, on_colour), (_, on_white)] = [[0.0; 3], colour, [1.0; 3]].map(on);
        assert_eq!((black, coloured), (Background::Black, Background::Colour(colour)));
        assert!(on_colour != on_black && on_colour != on_white, "another PSNR on each background");
    }

    /// Two steps of refining what a network makes.
    fn refined(splatting: Splatting) -> Optimised {
        let config = ModelConfig::named("nano").unwrap();
        let network = Network::new(&config, &Device::flex()).unwrap();
        let network = network.with_weights(&generated(&parameters(&config), 1)).unwrap();
        let weights = WeightsSource::Random { seed: 1, backbone_sha256: None };
        Optimised::refined(None, network, &weights, Budget::Steps(2), 0, splatting).unwrap()
    }

    /// As in the record of the network's method: networks that differ in any of these make other Gaussians.
    #[test]
    fn the_record_says_which_weights_the_network_has() {
        let config = ModelConfig::named("nano").unwrap();
        let network = |size: Option<ImageSize>| {
            let network = Network::new(&config, &Device::flex()).unwrap();
            if let Some(size) = size { network.trained_at(size) } else { network }
        };
        let random = |seed, backbone: Option<&str>| {
            let backbone_sha256 = backbone.map(str::to_owned);
            WeightsSource::Random { seed, backbone_sha256 }
        };
        let record = |size, weights: &WeightsSource| {
            let splatting = Splatting::default();
            Optimised::refined(None, network(size), weights, Budget::Steps(2), 0, splatting).unwrap().record()
        };
        let without = |mut record: MethodRecord, parameter: &str| {
            assert!(record.parameters.remove(parameter).is_some(), "{parameter}");
            record
        };
        let size = Some(ImageSize::new(32, 64));
        let cases = [(None, 1, None), (None, 2, None), (None, 1, Some("ab")), (size, 1, None)];
        let [first, second, backbone, sized] = cases.map(|(size, seed, of)| record(size, &random(seed, of)));
        assert!(first.untrained && first.parameters["weights-seed"] == 1 && second.parameters["weights-seed"] == 2);
        assert_eq!(without(first.clone(), "weights-seed"), without(second, "weights-seed"));
        assert_eq!((&backbone.parameters["backbone-sha256"], &backbone.title), (&"ab".into(), &first.title));
        assert_eq!(without(backbone, "backbone-sha256"), first);
        assert_eq!(without(sized, "context-at-scale-of"), first);

        let weights = random(3, Some("cd"));
        let refined = record(size, &weights).parameters;
        let atsplat = AtSplat::new("atsplat", network(size), &weights, 0, Splatting::default()).unwrap();
        let alone = atsplat.record().parameters;
        for name in ["model", "model-hash", "weights-seed", "backbone-sha256", "context-at-scale-of"] {
            assert!(alone.contains_key(name) && alone.get(name) == refined.get(name), "{name}: {alone:?} {refined:?}");
        }
        let file = record(None, &WeightsSource::File { sha256: "ef".to_owned() });
        assert_eq!((file.weights_sha256.as_deref(), file.untrained), (Some("ef"), false));
        assert!(!file.parameters.contains_key("weights-seed"));
    }

    /// Before any target is rendered there: one submission for each of both passes of two steps.
    #[test]
    fn optimises_on_the_adapter_of_its_backend() {
        let renderer: Box<dyn Renderer> = match GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default()) {
            Ok(renderer) => Box::new(renderer),
            Err(error @ GpuError::NoAdapter { .. }) => {
                return atsplat_tests::skip_without_graphics("eval optimised", error);
            }
            Err(error) => panic!("{error}"),
        };
        let renderer = Arc::new(Mutex::new(renderer));
        let backend = Backend::Shared(Arc::clone(&renderer), Some(AdapterRecord::default()));
        let splatting = || Splatting { backend: backend.clone(), ..Splatting::default() };
        let submissions = || renderer.lock().unwrap().device_counts().unwrap().submissions;
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let scratch = [Strategy::Gaussians3d, Strategy::MipSplatting, Strategy::Mcmc]
            .map(|strategy| Optimised::from_scratch(None, strategy, Budget::Steps(2), 400, 0, splatting()));
        for method in scratch.into_iter().chain([refined(splatting())]) {
            let before = submissions();
            method.predict(input).unwrap();
            let record = method.record();
            assert!(submissions() >= before + 4, "{}", record.name);
            assert_eq!(
                (&record.parameters["optimised-on"], record.deterministic),
                (&"the renderer's adapter".into(), false)
            );
        }
        let on_cpu = Optimised::from_scratch(None, Strategy::Mcmc, Budget::Steps(2), 400, 0, Splatting::default());
        assert!(!on_cpu.record().parameters.contains_key("optimised-on"));
    }
}
