//! Stress test: renders the hard cases with every backend, and compares images and gradients with the f64 reference and
//! with finite differences.

mod differences;
mod gradients;
mod images;
pub(crate) mod parameter;
mod report;
mod row;

use crate::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use crate::gpu::{AdapterChoice, GpuError, GpuOptions, GpuRenderer, SelfTestObserver};
use crate::hard_cases::{ErrorBounds, HardCase};
use crate::reference::{self, Jump};
use crate::{Gradients, ImageGradients, ReferenceRenderer, Renderer, Rendering, SplatError};

use differences::Differences;

pub use report::StressReport;
pub use row::{ErrorKind, MeasuredError, StressRow};

/// A renderer and its error allowance.
#[expect(missing_debug_implementations, reason = "renderers do not implement it")]
pub struct RendererUnderTest {
    /// The renderer.
    pub renderer: Box<dyn Renderer>,
    /// Factor on the bounds of a case, which hold for geometry in f64 and pixels in f32.
    pub slack: f64,
}

/// The reference, and the CPU renderer with each available instruction set.
pub fn cpu_under_test() -> Vec<RendererUnderTest> {
    let mut renderers = vec![RendererUnderTest { renderer: Box::new(ReferenceRenderer), slack: 1.0 }];
    for simd in SimdLevel::available() {
        let renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
        renderers.push(RendererUnderTest { renderer: Box::new(renderer), slack: 1.0 });
    }
    renderers
}

/// The GPU renderer on an adapter, with geometry in f32.
///
/// # Errors
/// [`GpuError`] if there is no such adapter, or it fails its self-test.
pub fn gpu_under_test(choice: &AdapterChoice, observer: &dyn SelfTestObserver) -> Result<RendererUnderTest, GpuError> {
    let renderer = GpuRenderer::observed(choice, GpuOptions::default(), observer)?;
    Ok(RendererUnderTest { renderer: Box::new(renderer), slack: GPU_SLACK })
}

/// Allowance for geometry in f32. Software Vulkan does not need it; other drivers round differently.
const GPU_SLACK: f64 = 2.0;

/// Runs every renderer on a case; one row per renderer.
///
/// # Errors
/// As [`reference::render`] for an invalid case, of which the catalogue has none. An error of a renderer is a finding
/// in its row.
pub fn rows(case: &HardCase, renderers: &mut [RendererUnderTest]) -> Result<Vec<StressRow>, SplatError> {
    let mut rows = Vec::with_capacity(renderers.len());
    let mut known: Option<Expected<'_>> = None;
    for RendererUnderTest { renderer, slack } in renderers {
        let expected = match known.take() {
            Some(expected) if expected.slack.to_bits() == slack.to_bits() => expected,
            _ => Expected::of(case, *slack)?,
        };
        rows.push(expected.row(renderer.as_mut()));
        known = Some(expected);
    }
    Ok(rows)
}

/// Findings for errors of too few compared values, which is correct only if nothing is drawn.
fn uncompared(errors: &[MeasuredError]) -> impl Iterator<Item = String> {
    // Of differences, as many as a pose has parameters.
    let least = |error: &MeasuredError| if error.kind == ErrorKind::Differences { 6 } else { 1 };
    let scarce = errors.iter().filter(move |error| error.compared < least(error));
    scarce.map(move |error| {
        format!("{}: {} values compared, expected at least {}", error.kind.name(), error.compared, least(error))
    })
}

/// Whether any parameter of a Gaussian has a gradient: without, its errors say nothing.
fn has_gradient(gradients: &Gradients<f64>) -> bool {
    let of_gaussians = gradients.fields().into_iter().filter(|(field, _)| field.is_of_gaussians());
    of_gaussians.flat_map(|(_, values)| values).any(|value| value.abs() > 0.0)
}

/// The expected results of a hard case.
#[derive(Debug)]
struct Expected<'a> {
    case: &'a HardCase,
    slack: f64,
    bounds: ErrorBounds,
    rendering: Rendering<f64>,
    jumps: Vec<Jump>,
    /// Gradients of a loss that ignores pixels that may jump.
    images: ImageGradients<f32>,
    gradients: Gradients<f64>,
    differences: Differences,
}

impl<'a> Expected<'a> {
    /// Renders and differentiates a case in f64, and computes finite differences of its smooth variant.
    fn of(case: &'a HardCase, slack: f64) -> Result<Self, SplatError> {
        let HardCase { gaussians, view, options, .. } = case;
        let mut bounds = case.bounds.scaled(slack);
        // Geometry in f32.
        if slack > 1.0 {
            bounds.image = case.image_in_f32.unwrap_or(bounds.image);
            bounds.gradient = if case.derivatives_need_f64 { f64::INFINITY } else { bounds.gradient };
        }
        let jumps = reference::jumps(gaussians, view, options, bounds.band)?;
        let images = gradients::loss_gradients(view, &jumps);
        Ok(Self {
            case,
            slack,
            bounds,
            rendering: reference::render(gaussians, view, options)?,
            gradients: reference::backward(gaussians, view, options, &images.map(f64::from))?,
            differences: Differences::of(case)?,
            jumps,
            images,
        })
    }

    fn row(&self, renderer: &mut dyn Renderer) -> StressRow {
        let mut row = StressRow {
            case: self.case.name.to_owned(),
            renderer: renderer.name(),
            errors: Vec::new(),
            non_finite: 0,
            findings: Vec::new(),
        };
        if let Err(error) = self.try_row(renderer, &mut row) {
            row.findings.push(error.to_string());
        }
        row
    }

    fn try_row(&self, renderer: &mut dyn Renderer, row: &mut StressRow) -> Result<(), SplatError> {
        let HardCase { gaussians, view, options, counts, .. } = self.case;
        let rendering = renderer.render(gaussians, view, options)?;
        let gradients = renderer.backward(gaussians, view, options, &self.images)?;
        row.non_finite = rendering.non_finite() + gradients.non_finite();
        row.errors.push(images::error(self.case, &rendering, &self.rendering, &self.jumps, self.bounds.image)?);
        row.errors.push(gradients::error(&gradients, &self.gradients, self.bounds.gradient)?);
        row.errors.push(self.differences.error(self.case, renderer, self.bounds.gradient)?);
        if self.rendering.counts.drawn > 0 {
            row.findings.extend(uncompared(&row.errors));
            if !has_gradient(&self.gradients) {
                row.findings.push("gradient: no Gaussian is expected to have one".to_owned());
            }
        }
        if let Some(counts) = counts
            && rendering.counts != *counts
        {
            row.findings.push(format!("counts: expected {counts:?}, found {:?}", rendering.counts));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hard_cases::catalogue;
    use crate::{RenderOptions, RendererConstants};

    #[test]
    fn reports_errors_without_compared_values() {
        let error = |kind, compared| MeasuredError { kind, absolute: 0.0, relative: 0.0, bound: 1.0, compared };
        let of = |image, differences| -> Vec<String> {
            let errors = [(ErrorKind::Image, image), (ErrorKind::Gradient, 1), (ErrorKind::Differences, differences)];
            uncompared(&errors.map(|(kind, compared)| error(kind, compared))).collect()
        };
        assert_eq!(of(1, 6), [""; 0]);
        assert_eq!(of(1, 5), ["differences: 5 values compared, expected at least 6"]);
        assert_eq!(of(0, 9), ["image: 0 values compared, expected at least 1"]);
    }

    /// The background has a gradient whatever is drawn.
    #[test]
    fn gradients_of_gaussians_are_required_where_something_is_drawn() {
        let background = Gradients { background: [1.0, 2.0, 3.0], scalars: vec![0.0, -0.0], ..Gradients::default() };
        assert!(!has_gradient(&background));
        assert!(has_gradient(&Gradients { scalars: vec![0.0, -1e-9], ..background }));
        let case = catalogue().into_iter().find(|case| case.name == "no-blur-disc-edge-on").unwrap();
        let mut expected = Expected::of(&case, 1.0).unwrap();
        let row = expected.row(&mut ReferenceRenderer);
        assert!(row.passes(), "{row:?}");
        expected.gradients = Gradients::zero(&case.gaussians);
        let row = expected.row(&mut ReferenceRenderer);
        assert_eq!(row.findings, ["gradient: no Gaussian is expected to have one"]);
    }

    /// Bounds for geometry in f32 apply to no other renderer.
    #[test]
    fn bounds_depend_on_the_geometry() {
        let case = catalogue().into_iter().find(|case| case.name == "centre-at-1e5-pixels").unwrap();
        let bounds = |slack| Expected::of(&case, slack).unwrap().bounds;
        assert_eq!(bounds(1.0), case.bounds);
        let ErrorBounds { image, gradient, .. } = bounds(GPU_SLACK);
        assert_eq!((Some(image), gradient), (case.image_in_f32, f64::INFINITY));
    }

    /// Gradients that pass clamps, other axes, extents and principal points.
    #[test]
    fn the_cpu_passes_every_case_under_the_constants_of_published_rasterizers() {
        let mut cpu = CpuRenderer::default();
        for preset in ["inria", "pixelsplat-family", "gsplat-1.6"] {
            let mut drawn = 0;
            for case in catalogue() {
                let constants = RendererConstants::named(preset).unwrap();
                let case = HardCase { options: RenderOptions { constants, ..case.options.clone() }, ..case };
                let HardCase { gaussians, view, options, bounds, .. } = &case;
                let jumps = reference::jumps(gaussians, view, options, bounds.band).unwrap();
                let by = gradients::loss_gradients(view, &jumps);
                let expected = reference::render(gaussians, view, options).unwrap();
                let rendering = cpu.render(gaussians, view, options).unwrap();
                let image = images::error(&case, &rendering, &expected, &jumps, bounds.image).unwrap();
                drawn += u32::from(expected.counts.drawn > 0);
                let expected = reference::backward(gaussians, view, options, &by.map(f64::from)).unwrap();
                let found = cpu.backward(gaussians, view, options, &by).unwrap();
                let gradient = gradients::error(&found, &expected, bounds.gradient).unwrap();
                assert!(image.passes() && gradient.passes(), "{preset}, {}: {image:?}, {gradient:?}", case.name);
            }
            assert!(drawn > 70, "{preset}: {drawn} cases draw something");
        }
    }
}
