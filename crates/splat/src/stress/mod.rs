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
pub use row::{MeasuredError, StressRow};

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

/// Findings for errors without any compared value, which is correct only if nothing is drawn.
fn uncompared(errors: &[MeasuredError]) -> impl Iterator<Item = String> {
    errors.iter().filter(|error| error.compared == 0).map(|error| format!("{}: nothing was compared", error.name))
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
        if case.derivatives_need_f64 && slack > 1.0 {
            bounds.gradient = f64::INFINITY;
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

    #[test]
    fn reports_errors_without_compared_values() {
        let error = |name, compared| MeasuredError { name, absolute: 0.0, relative: 0.0, bound: 1.0, compared };
        let found: Vec<String> = uncompared(&[error("image", 9), error("differences", 0)]).collect();
        assert_eq!(found, ["differences: nothing was compared"]);
    }
}
