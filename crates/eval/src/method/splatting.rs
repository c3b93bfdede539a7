use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_fit::FitDevice;
use atsplat_pixels::Image;
use atsplat_protocol::trial::TargetView;
use atsplat_results::{AdapterRecord, MethodRecord};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{EffectOutcome, EffectPlan, EffectSelection, Scene};
use atsplat_splat::{
    Field, Finding, Gaussians, Problem, RasterMode, RenderOptions, Renderer, RendererConstants, Rendering, SplatError,
    Validation, View,
};

use super::{ConstantsChoice, Cost, Prediction, Rendered, TrialInput};
use crate::suspicious_notes::SuspiciousNote;

/// How Gaussians are rendered.
#[derive(Clone, Debug)]
pub struct Splatting {
    /// Renderer constants.
    pub constants: ConstantsChoice,
    /// Background RGB; `None` uses the protocol's.
    pub background: Option<[f64; 3]>,
    /// How Gaussians smaller than a pixel are drawn; `None` draws them in the classic mode, as no protocol states another, with
    /// a note in trials whose Gaussians may be meant otherwise.
    pub mode: Option<RasterMode>,
    /// Which renderer effects run.
    pub effects: EffectSelection,
    /// Largest change of a sample that [`EffectSelection::Auto`] may cause, in units of display range.
    pub tolerance: f64,
    /// The rendering backend.
    pub backend: Backend,
}

/// A rendering backend; its clones share the renderers.
#[derive(Clone)]
pub enum Backend {
    /// The CPU: a pool of renderers, one per concurrent caller.
    Cpu(Arc<Mutex<Vec<CpuRenderer>>>),
    /// One renderer that all threads share, and its graphics adapter if it has one. It must render without rayon: a thread that
    /// waits for parts of its own work takes up other work, which may wait for the lock that it holds. Backward passes do use
    /// rayon, but only methods that run alone need them.
    Shared(Arc<Mutex<Box<dyn Renderer>>>, Option<AdapterRecord>),
}

impl std::fmt::Debug for Backend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.name())
    }
}

impl Default for Backend {
    fn default() -> Self {
        Self::Cpu(Arc::default())
    }
}

impl Backend {
    /// One renderer for all threads, which renders without rayon; `adapter` is its graphics adapter if it runs on a GPU.
    pub fn shared(renderer: Box<dyn Renderer>, adapter: Option<AdapterRecord>) -> Self {
        Self::Shared(Arc::new(Mutex::new(renderer)), adapter)
    }

    /// Human-readable name.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu(_) => Renderer::name(&CpuRenderer::default()),
            Self::Shared(renderer, _) => renderer.lock().unwrap_or_else(PoisonError::into_inner).name(),
        }
    }

    /// The graphics adapter; `None` for the CPU.
    pub const fn adapter(&self) -> Option<&AdapterRecord> {
        match self {
            Self::Cpu(_) => None,
            Self::Shared(_, adapter) => adapter.as_ref(),
        }
    }

    /// Where optimisations for this backend run: its graphics adapter, or the CPU.
    pub fn fit_device(&self) -> FitDevice {
        match self {
            Self::Cpu(_) => FitDevice::default(),
            Self::Shared(renderer, adapter) => {
                let name = adapter.as_ref().map_or_else(|| self.name(), ToString::to_string);
                FitDevice::adapter(Arc::clone(renderer), name).unwrap_or_default()
            }
        }
    }

    /// Whether equal inputs give bit-identical results on one machine.
    pub const fn is_deterministic(&self) -> bool {
        self.adapter().is_none()
    }

    /// Runs `work` with a renderer that no other thread uses at the same time.
    pub fn with<T>(&self, work: impl FnOnce(&mut dyn Renderer) -> T) -> T {
        match self {
            Self::Cpu(spare) => with_spare(spare, |renderer| work(renderer)),
            Self::Shared(renderer, _) => work(renderer.lock().unwrap_or_else(PoisonError::into_inner).as_mut()),
        }
    }
}

fn with_spare<T>(spare: &Mutex<Vec<CpuRenderer>>, work: impl FnOnce(&mut CpuRenderer) -> T) -> T {
    let taken = spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let mut renderer = taken.unwrap_or_default();
    let result = work(&mut renderer);
    spare.lock().unwrap_or_else(PoisonError::into_inner).push(renderer);
    result
}

impl Default for Splatting {
    /// The protocol's constants and background, with the effects that can change a sample by more than a quarter of a grey
    /// level, on the CPU.
    fn default() -> Self {
        Self {
            constants: ConstantsChoice::default(),
            background: None,
            mode: None,
            effects: EffectSelection::Auto,
            tolerance: EffectPlan::TOLERANCE,
            backend: Backend::default(),
        }
    }
}

impl Splatting {
    /// The background that the targets of a trial are rendered on.
    pub(super) fn background_of(&self, input: &TrialInput<'_>) -> [f64; 3] {
        self.background.unwrap_or(input.preset.renderer.background)
    }

    /// The prediction of a method whose Gaussians are in the trial's world frame.
    pub fn predict<'a>(&'a self, input: TrialInput<'a>, gaussians: Gaussians, cost: Cost) -> Box<dyn Prediction + 'a> {
        self.predict_with(input, gaussians, self.constants_in(input, 1.0), cost)
    }

    /// As [`Self::predict`], with these constants.
    pub(super) fn predict_with<'a>(
        &'a self,
        input: TrialInput<'a>,
        gaussians: Gaussians,
        constants: RendererConstants,
        mut cost: Cost,
    ) -> Box<dyn Prediction + 'a> {
        cost.notes.extend(self.mip_note(&gaussians));
        Box::new(Splatted::new(self, input, gaussians, constants, cost))
    }

    /// The constants for a trial in whose world the unit of the Gaussians' frame has this length.
    pub(super) fn constants_in(&self, input: TrialInput<'_>, unit: f64) -> RendererConstants {
        self.constants.constants_in_unit(&input.preset.renderer, input.trial.near_far(), unit)
    }

    /// Like [`Self::predict`], for Gaussians that were optimised for a renderer: with its constants, mode and degree.
    pub(super) fn predict_as_optimised<'a>(
        &'a self,
        input: TrialInput<'a>,
        gaussians: Gaussians,
        optimised_for: &RenderOptions,
        cost: Cost,
    ) -> Box<dyn Prediction + 'a> {
        let mut splatted = Splatted::new(self, input, gaussians, optimised_for.constants.clone(), cost);
        splatted.options = RenderOptions { background: splatted.options.background, ..optimised_for.clone() };
        Box::new(splatted)
    }

    /// A note on Gaussians with the 3D filter of Mip-Splatting, for which no mode was chosen: a PLY records that filter, but not
    /// the 2D filter that belongs to it.
    fn mip_note(&self, gaussians: &Gaussians) -> Option<String> {
        let is_noted = gaussians.parts().filter_3d.is_some() && self.mode.is_none();
        is_noted.then(|| {
            format!(
                "{}: the Gaussians have 3D filters (filter_3D), as Mip-Splatting makes them; see --mode antialiased, in Python \
                 antialiased=True, and --constants mip-splatting",
                SuspiciousNote::DrawnClassic
            )
        })
    }

    /// Adds the renderer's settings to a method's record.
    pub fn describe(&self, record: &mut MethodRecord) {
        record.constants = Some(self.constants.name().to_owned());
        record.backend = Some(self.backend.name());
        record.renderer_adapter = self.backend.adapter().cloned();
        record.deterministic = self.backend.is_deterministic();
        record.record_background(self.background);
        record.parameters.extend(parameters([
            ("effects", self.effects.to_string().into()),
            ("tolerance", self.tolerance.into()),
            ("renderer", self.explicit_constants()),
        ]));
        // Records of stores without a chosen mode stay as they are, and so do their renders.
        if let Some(mode) = self.mode {
            record.parameters.insert("mode".to_owned(), as_json(&mode));
        }
    }

    fn explicit_constants(&self) -> serde_json::Value {
        match &self.constants {
            ConstantsChoice::FromPreset => MethodRecord::OF_PRESET.into(),
            ConstantsChoice::Fixed(constants) => {
                let mut fields = as_json(constants);
                // JSON has no infinity.
                for (name, plane) in [("near", constants.near), ("far", constants.far)] {
                    if let Some(field) = fields.get_mut(name).filter(|_| !plane.is_finite()) {
                        *field = plane.to_string().into();
                    }
                }
                fields
            }
            ConstantsChoice::Changed(changed) => as_json(changed.overrides()),
        }
    }
}

#[expect(clippy::expect_used, reason = "the types contain numbers and strings only")]
fn as_json<T: serde::Serialize>(settings: &T) -> serde_json::Value {
    serde_json::to_value(settings).expect("settings are representable in JSON")
}

/// Gaussians in a trial's world frame, ready to be rendered.
struct Splatted<'a> {
    splatting: &'a Splatting,
    input: TrialInput<'a>,
    scene: Scene<'static>,
    options: RenderOptions,
    cost: Cost,
}

impl<'a> Splatted<'a> {
    fn new(
        splatting: &'a Splatting,
        input: TrialInput<'a>,
        gaussians: Gaussians,
        constants: RendererConstants,
        mut cost: Cost,
    ) -> Self {
        let options = RenderOptions {
            constants,
            background: splatting.background_of(&input),
            mode: splatting.mode.unwrap_or(RasterMode::Classic),
            ..RenderOptions::default()
        };
        cost.gaussians = Some(gaussians.len() as u64);
        // The number of the trial's targets, not of those that are rendered together, which must not change a single bit.
        let scene = Scene::owning(gaussians, input.trial.targets().len());
        Self { splatting, input, scene, options, cost }
    }

    fn target(&self, position: usize) -> Result<View, String> {
        let target = self.input.trial.targets().get(position);
        let TargetView { camera, size, .. } = target.ok_or_else(|| format!("no target {position}"))?;
        Ok(View { camera: *camera, size: *size })
    }

    /// Plans one view.
    fn plan(&self, position: usize) -> Result<EffectPlan, String> {
        let Splatting { effects, tolerance, .. } = self.splatting;
        let plan = EffectPlan::for_scene(&self.scene, &self.target(position)?, &self.options, effects, *tolerance);
        plan.map_err(|error| error.to_string())
    }

    /// Renders views whose plans leave the same options, and shares the per-scene work; bit-identical to rendering them
    /// one by one. `None` where that is impossible.
    fn render_together(&self, plans: &[EffectPlan]) -> Option<Vec<Result<Rendered, String>>> {
        let ([first, _, ..], Backend::Cpu(spare)) = (plans, &self.splatting.backend) else { return None };
        let options = &first.reduced().options;
        if plans.iter().any(|plan| plan.reduced().options != *options) {
            return None;
        }
        let views: Vec<View> = plans.iter().map(|plan| plan.reduced().view).collect();
        let renderings =
            with_spare(spare, |renderer| renderer.render_many(self.scene.gaussians(), &views, options)).ok()?;
        Some(renderings.into_iter().zip(plans).map(|(rendering, plan)| finished(rendering, plan)).collect())
    }

    /// Renders one view.
    fn render_one(&self, plan: &EffectPlan) -> Result<Rendered, String> {
        let rendering = self.splatting.backend.with(|renderer| plan.render(renderer, self.scene.gaussians()));
        finished(rendering.map_err(|error: SplatError| error.to_string())?, plan)
    }
}

fn finished(rendering: Rendering<f32>, plan: &EffectPlan) -> Result<Rendered, String> {
    let ran = plan
        .decisions()
        .iter()
        .filter(|decision| matches!(decision.outcome, EffectOutcome::Runs | EffectOutcome::Reduced));
    let effects = ran.map(|decision| decision.effect).collect();
    let samples = rendering.rgb.into_flattened();
    let image = Image::new(rendering.size.width, rendering.size.height, samples).map_err(|error| error.to_string())?;
    Ok(Rendered { image, drawn: Some(rendering.counts.drawn), effects })
}

impl Prediction for Splatted<'_> {
    /// Gaussians are checked here, and not in the time of the encoding.
    fn cost(&self) -> Cost {
        let mut cost = self.cost.clone();
        cost.notes.extend(broken_note(self.scene.gaussians(), &cost.notes));
        cost.notes.extend(self.options.ignored_harmonics(self.scene.gaussians()));
        cost.notes.extend(self.options.differing_harmonics(self.scene.gaussians()));
        cost
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let plans: Vec<_> = targets.iter().map(|position| self.plan(*position)).collect();
        let together = plans.iter().cloned().collect::<Result<Vec<_>, _>>().ok();
        if let Some(rendered) = together.and_then(|plans| self.render_together(&plans)) {
            return rendered;
        }
        plans.into_iter().map(|plan| self.render_one(&plan?)).collect()
    }
}

/// A note on Gaussians that no renderer draws, unless `notes` have them already: those of a file are noted when it is read. Logits
/// and log-scales that are not finite are opacities of 0 and 1 and scales of 0, and are rendered.
fn broken_note(gaussians: &Gaussians, notes: &[String]) -> Option<String> {
    let broken = SuspiciousNote::BrokenGaussians;
    let are_noted = notes.iter().any(|note| broken.is(note));
    let is_new = |finding: &&Finding| match finding.problem {
        // Reading a file drops them, but reading logits as opacities makes new ones.
        Problem::NotANumber => true,
        _ => !are_noted && !matches!(finding.field, Field::OpacityLogits | Field::LogScales),
    };
    let found = gaussians.validate();
    let kinds: Vec<String> = found.findings.iter().filter(is_new).map(ToString::to_string).collect();
    (!kinds.is_empty()).then(|| format!("{broken}: {}, of {}: they are not drawn", kinds.join("; "), found.total))
}

/// A note on Gaussians that were broken before they were optimised.
pub(super) fn broken_start_note(found: &Validation) -> Option<String> {
    let Validation { total, invalid, rejected, repaired, findings, .. } = found;
    let kinds = findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    let broken = SuspiciousNote::BrokenGaussians;
    (!found.is_clean()).then(|| {
        format!("{broken}: {invalid} of {total} to start from ({rejected} removed, {repaired} repaired): {kinds}")
    })
}

/// Parameters by name.
pub(super) fn parameters<const N: usize>(list: [(&str, serde_json::Value); N]) -> BTreeMap<String, serde_json::Value> {
    list.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use atsplat_protocol::Preset;
    use atsplat_splat::{GaussianParts, ReferenceRenderer};
    use glam::DVec3;

    use super::*;
    use crate::method::atsplat::tests::trials;

    #[test]
    fn only_results_of_adapters_are_recorded_as_not_deterministic() {
        let shared = |adapter| Backend::shared(Box::new(ReferenceRenderer), adapter);
        let recorded = |backend| {
            let mut record = MethodRecord::default();
            Splatting { backend, ..Splatting::default() }.describe(&mut record);
            record.deterministic
        };
        let backends = [Backend::default(), shared(None), shared(Some(AdapterRecord::default()))];
        assert_eq!(backends.map(recorded), [true, true, false]);
    }

    #[test]
    fn gaussians_that_are_not_drawn_are_noted_once() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let notes = |notes: &[&str], change: fn(&mut GaussianParts)| {
            let mut parts = GaussianParts {
                means: vec![[0.0, 0.0, 2.0]; 3],
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 3],
                log_scales: vec![[-2.0; 3]; 3],
                opacity_logits: vec![0.5; 3],
                sh: vec![[0.25; 3]; 3],
                ..GaussianParts::default()
            };
            change(&mut parts);
            let cost = Cost { notes: notes.iter().map(ToString::to_string).collect(), ..Cost::default() };
            let splatting = Splatting::default();
            splatting.predict(input, Gaussians::new(parts).unwrap(), cost).cost().notes
        };
        let nan: fn(&mut GaussianParts) = |parts| parts.means[1][0] = f32::NAN;
        let zero: fn(&mut GaussianParts) = |parts| parts.quaternions[2] = [0.0; 4];
        let opaque: fn(&mut GaussianParts) = |parts| {
            parts.opacity_logits[0] = f32::INFINITY;
            parts.log_scales[0][2] = f32::NEG_INFINITY;
        };
        let of_nan = "broken Gaussians: means not a number in 1, first 1, of 3: they are not drawn";
        assert_eq!(notes(&[], nan), [of_nan]);
        assert_eq!(notes(&[], zero), ["broken Gaussians: quaternions zero in 1, first 2, of 3: they are not drawn"]);
        assert_eq!(notes(&[], opaque), [""; 0], "an opacity of 1 and a scale of 0 are drawn");
        let of_file =
            "broken Gaussians: 1 of 3 (1 drawn only if the renderer can): quaternions zero in 1, first 2 (a.ply)";
        assert_eq!(notes(&[of_file], zero), [of_file]);
        assert_eq!(notes(&[of_file], nan), [of_file, of_nan]);
    }

    #[test]
    fn broken_gaussians_of_a_start_are_noted() {
        assert_eq!(broken_start_note(&Validation { total: 9, ..Validation::default() }), None);
        let of = |field, problem, count, first| Finding { field, problem, count, first };
        let means = of(Field::Means, Problem::NotANumber, 1, 4);
        let findings = vec![means, of(Field::OpacityLogits, Problem::Infinite, 2, 0)];
        let found = Validation { total: 9, invalid: 3, rejected: 1, repaired: 2, findings, dropped: vec![4] };
        let expected = "broken Gaussians: 3 of 9 to start from (1 removed, 2 repaired): means not a number in 1, first 4; opacity \
                        logits infinite in 2, first 0";
        assert_eq!(broken_start_note(&found).as_deref(), Some(expected));
    }

    /// Gaussians that are smaller than a pixel, which the blur of the classic mode brightens.
    #[test]
    fn a_3d_filter_is_noted_unless_a_mode_is_chosen() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        let (trial, images) = trials(&preset).swap_remove(0);
        let input = TrialInput { preset: &preset, trial: &trial, images: &images };
        let inverse = trial.targets()[0].camera.camera_from_world.inverse();
        let means = [-0.5, 0.0, 0.5].map(|x| inverse.transform_point(DVec3::new(x, 0.0, 3.0)).as_vec3().to_array());
        let found = |mode, filter_3d| {
            let parts = GaussianParts {
                means: means.to_vec(),
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 3],
                log_scales: vec![[-6.0; 3]; 3],
                opacity_logits: vec![3.0; 3],
                sh: vec![[1.0; 3]; 3],
                filter_3d,
                ..GaussianParts::default()
            };
            let splatting = Splatting { mode, background: Some([0.0; 3]), ..Splatting::default() };
            let mut record = MethodRecord::default();
            splatting.describe(&mut record);
            let prediction = splatting.predict(input, Gaussians::new(parts).unwrap(), Cost::default());
            let image = prediction.render(&[0]).remove(0).unwrap().image;
            let light = image.samples().iter().map(|sample| f64::from(*sample)).sum::<f64>();
            (prediction.cost().notes, record.parameters.get("mode").cloned(), light)
        };
        let filter = || Some(vec![1e-4; 3]);
        let (notes, recorded, unchosen) = found(None, filter());
        let is_noted = matches!(&notes[..], [note] if SuspiciousNote::DrawnClassic.is(note) && note.contains("--mode"));
        assert!(is_noted, "{notes:?}");
        assert_eq!(recorded, None, "as in stores of older versions, which are resumed");
        assert_eq!(found(None, None).0, [""; 0]);
        let [classic, antialiased] =
            [RasterMode::Classic, RasterMode::Antialiased].map(|mode| found(Some(mode), filter()));
        assert_eq!((classic.0.len(), antialiased.0.len()), (0, 0), "a choice needs no note");
        assert_eq!([classic.1, antialiased.1], ["classic", "antialiased"].map(|mode| Some(mode.into())));
        Tolerance::EXACT.assert([classic.2], [unchosen], "the default is the classic mode");
        assert!(antialiased.2 < 0.8 * classic.2, "{} and {}", antialiased.2, classic.2);
    }
}
