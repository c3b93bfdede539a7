use atsplat_splat::effects::{EffectPlan, EffectSelection, EffectSummary, Scene};
use atsplat_splat::{
    Channels, PrincipalPoint, RasterMode, RenderOptions, Renderer, RendererConstants, Rendering, SplatError,
};
use serde::Serialize;
use serde_json::Value;

use super::{Frame, FrameRequest};

/// How views are rendered: the options, and which effects may be skipped.
#[derive(Debug)]
pub struct RenderSettings {
    /// The options; the exposure is that of each request.
    pub options: RenderOptions,
    /// Which of the requested effects run.
    pub effects: EffectSelection,
    /// See [`EffectPlan::for_scene`].
    pub tolerance: f64,
}

impl RenderSettings {
    /// Plans the effects of a view.
    ///
    /// # Errors
    /// Those of [`EffectPlan::for_scene`].
    pub fn plan(&self, scene: &Scene<'_>, request: &FrameRequest) -> Result<EffectPlan, SplatError> {
        let options = request.exposed(&self.options);
        EffectPlan::for_scene(scene, &request.view, &options, &self.effects, self.tolerance)
    }

    /// Plans and renders a view.
    ///
    /// # Errors
    /// Those of [`Self::plan`], and those of the renderer.
    pub fn render(
        &self,
        renderer: &mut dyn Renderer,
        scene: &Scene<'_>,
        request: &FrameRequest,
    ) -> Result<(Rendering<f32>, EffectPlan), SplatError> {
        let plan = self.plan(scene, request)?;
        Ok((plan.render(renderer, scene.gaussians())?, plan))
    }

    /// Summarises the effects of all frames.
    pub fn summary(&self, frames: &[Frame]) -> EffectSummary {
        EffectSummary::new(&self.effects, self.tolerance, &frames.iter().map(|frame| frame.decisions.as_slice()))
    }
}

/// The warning about principal points that the constants ignore.
pub fn ignored_principal_points(constants: &RendererConstants, requests: &[FrameRequest]) -> Option<String> {
    const CENTRED: f64 = 1e-3;
    let is_off = |request: &&FrameRequest| {
        let intrinsics = request.view.camera.intrinsics;
        !((intrinsics.cx - 0.5).abs() <= CENTRED && (intrinsics.cy - 0.5).abs() <= CENTRED)
    };
    let off = requests.iter().filter(is_off).count();
    (off > 0 && constants.principal_point != PrincipalPoint::Full).then(|| {
        format!("{off} cameras have a principal point off the centre, which the constants {} ignore", constants.name)
    })
}

/// [`RenderOptions`] as recorded in `render.json`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RenderSettingsRecord {
    constants: Value,
    background: [f64; 3],
    mode: RasterMode,
    max_sh_degree: u8,
    channels: Channels,
}

impl RenderSettingsRecord {
    /// The record of these options.
    ///
    /// # Errors
    /// Of JSON, which finite constants cannot cause.
    pub fn of(options: &RenderOptions) -> serde_json::Result<Self> {
        let mut constants = serde_json::to_value(&options.constants)?;
        if options.constants.far.is_infinite()
            && let Some(far) = constants.get_mut("far")
        {
            // JSON has no infinity.
            *far = Value::from("inf");
        }
        Ok(Self {
            constants,
            background: options.background,
            mode: options.mode,
            max_sh_degree: options.max_sh_degree,
            channels: options.channels,
        })
    }
}
