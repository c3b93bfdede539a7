use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use atsplat_pixels::Image;
use atsplat_protocol::trial::TargetView;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{EffectPlan, EffectSelection, Verdict};
use atsplat_splat::{Gaussians, RenderOptions, Renderer, Rendering, SplatError, View};

use super::{Answer, ConstantsChoice, Cost, Question, Rendered};
use crate::MethodRecord;

/// How Gaussians become pictures.
#[derive(Debug)]
pub struct Splatting {
    /// Rules of the rasterizer.
    pub constants: ConstantsChoice,
    /// RGB behind everything; `None` takes the protocol's.
    pub background: Option<[f64; 3]>,
    /// Which effects run.
    pub effects: EffectSelection,
    /// Who renders.
    pub backend: Backend,
    /// Why that is not who was asked for; `None` where it is.
    pub passed_over: Option<String>,
}

/// Who renders.
pub enum Backend {
    /// The processor: a renderer for each thread that asks.
    Cpu(Mutex<Vec<CpuRenderer>>),
    /// One renderer for all.
    One(Mutex<Box<dyn Renderer>>),
}

impl std::fmt::Debug for Backend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.name())
    }
}

impl Default for Backend {
    fn default() -> Self {
        Self::Cpu(Mutex::default())
    }
}

impl Backend {
    /// For people.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu(_) => Renderer::name(&CpuRenderer::default()),
            Self::One(renderer) => renderer.lock().unwrap_or_else(PoisonError::into_inner).name(),
        }
    }

    /// Whether equal inputs give equal bits on one machine.
    pub const fn is_deterministic(&self) -> bool {
        matches!(self, Self::Cpu(_))
    }

    fn with<T>(&self, work: impl FnOnce(&mut dyn Renderer) -> T) -> T {
        match self {
            Self::Cpu(spare) => with_spare(spare, |renderer| work(renderer)),
            Self::One(renderer) => work(renderer.lock().unwrap_or_else(PoisonError::into_inner).as_mut()),
        }
    }
}

fn with_spare<T>(spare: &Mutex<Vec<CpuRenderer>>, work: impl FnOnce(&mut CpuRenderer) -> T) -> T {
    let taken = spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
    let mut renderer = taken.unwrap_or_default();
    let made = work(&mut renderer);
    spare.lock().unwrap_or_else(PoisonError::into_inner).push(renderer);
    made
}

impl Default for Splatting {
    /// The protocol's constants and background, every effect that is asked for, on the processor.
    fn default() -> Self {
        Self {
            constants: ConstantsChoice::default(),
            background: None,
            effects: EffectSelection::All,
            backend: Backend::default(),
            passed_over: None,
        }
    }
}

impl Splatting {
    /// The answer of a method whose Gaussians are in the trial's world.
    pub fn answer<'a>(&'a self, question: Question<'a>, gaussians: Gaussians, cost: Cost) -> Box<dyn Answer + 'a> {
        Box::new(Splatted::new(self, question, gaussians, cost))
    }

    /// What a method's record says of its renderer.
    pub(super) fn describe(&self, record: &mut MethodRecord) {
        record.constants = Some(self.constants.name().to_owned());
        record.backend = Some(self.backend.name());
        record.deterministic = self.backend.is_deterministic();
        let background = self.background.map_or_else(|| "of the preset".into(), |rgb| serde_json::json!(rgb));
        let parameters: [(&str, serde_json::Value); 3] = [
            ("background", background),
            ("effects", self.effects.to_string().into()),
            ("renderer", self.explicit_constants()),
        ];
        record.parameters.extend(parameters.map(|(name, value)| (name.to_owned(), value)));
    }

    fn explicit_constants(&self) -> serde_json::Value {
        match &self.constants {
            ConstantsChoice::OfPreset => "of the preset".into(),
            ConstantsChoice::These(constants) => {
                let mut fields = as_json(constants);
                // An infinite plane is no JSON number.
                for (name, plane) in [("near", constants.near), ("far", constants.far)] {
                    if let Some(field) = fields.get_mut(name).filter(|_| !plane.is_finite()) {
                        *field = plane.to_string().into();
                    }
                }
                fields
            }
            ConstantsChoice::Changed(changed) => as_json(changed.knobs()),
        }
    }
}

#[expect(clippy::expect_used, reason = "structures of numbers and names")]
fn as_json<T: serde::Serialize>(settings: &T) -> serde_json::Value {
    serde_json::to_value(settings).expect("settings that JSON holds")
}

/// Gaussians in a trial's world, ready to be rendered.
struct Splatted<'a> {
    splatting: &'a Splatting,
    question: Question<'a>,
    gaussians: Gaussians,
    options: RenderOptions,
    cost: Cost,
}

impl<'a> Splatted<'a> {
    fn new(splatting: &'a Splatting, question: Question<'a>, gaussians: Gaussians, mut cost: Cost) -> Self {
        let convention = &question.preset.renderer;
        let options = RenderOptions {
            constants: splatting.constants.of(convention, question.trial.near_far()),
            background: splatting.background.unwrap_or(convention.background),
            ..RenderOptions::default()
        };
        cost.gaussians = Some(gaussians.len() as u64);
        cost.notes.extend(splatting.passed_over.clone());
        Self { splatting, question, gaussians, options, cost }
    }

    fn target(&self, position: usize) -> Result<View, String> {
        let target = self.question.trial.targets().get(position);
        let TargetView { camera, size, .. } = target.ok_or_else(|| format!("no target {position}"))?;
        Ok(View { camera: *camera, size: *size })
    }

    fn plan(&self, view: &View) -> Result<EffectPlan, SplatError> {
        let selection = &self.splatting.effects;
        EffectPlan::for_scene(&self.gaussians, view, &self.options, selection, EffectPlan::TOLERANCE)
    }

    /// One view.
    fn one(&self, position: usize) -> Result<Rendered, String> {
        let view = self.target(position)?;
        let told = |error: SplatError| error.to_string();
        let plan = self.plan(&view).map_err(told)?;
        let rendering = self.splatting.backend.with(|renderer| plan.render(renderer, &self.gaussians)).map_err(told)?;
        finished(rendering, &plan)
    }

    /// Several views with what they share worked out once: the same bits.
    fn together(&self, targets: &[usize], spare: &Mutex<Vec<CpuRenderer>>) -> Result<Vec<Rendered>, String> {
        let told = |error: SplatError| error.to_string();
        let views: Vec<View> = targets.iter().map(|position| self.target(*position)).collect::<Result<_, _>>()?;
        let plans: Vec<EffectPlan> =
            views.iter().map(|view| self.plan(view).map_err(told)).collect::<Result<_, _>>()?;
        let renderings =
            with_spare(spare, |renderer| renderer.render_many(&self.gaussians, &views, &self.options)).map_err(told)?;
        renderings.into_iter().zip(&plans).map(|(rendering, plan)| finished(rendering, plan)).collect()
    }
}

fn finished(rendering: Rendering<f32>, plan: &EffectPlan) -> Result<Rendered, String> {
    let ran = plan.decisions().iter().filter(|decision| matches!(decision.verdict, Verdict::Runs | Verdict::Reduced));
    let effects = ran.map(|decision| decision.effect).collect();
    let samples = rendering.rgb.into_flattened();
    let image = Image::new(rendering.size.width, rendering.size.height, samples).map_err(|error| error.to_string())?;
    Ok(Rendered { image, drawn: Some(rendering.census.drawn), effects })
}

impl Answer for Splatted<'_> {
    fn cost(&self) -> &Cost {
        &self.cost
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        // What is left out depends on the view, and so does the request.
        let alike = self.splatting.effects == EffectSelection::All;
        if let (true, true, Backend::Cpu(spare)) = (alike, targets.len() > 1, &self.splatting.backend)
            && let Ok(rendered) = self.together(targets, spare)
        {
            return rendered.into_iter().map(Ok).collect();
        }
        targets.iter().map(|position| self.one(*position)).collect()
    }
}

/// Parameters by name.
pub(super) fn parameters<const N: usize>(list: [(&str, serde_json::Value); N]) -> BTreeMap<String, serde_json::Value> {
    list.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}
