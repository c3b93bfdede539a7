//! Every path through the hard cases, against the reference in f64 and its derivative against differences.

mod differences;
mod gradients;
mod images;
mod parameter;

use atsplat_numeric::StressRow;

use crate::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use crate::hard_cases::HardCase;
use crate::reference::{self, Jump};
use crate::{Gradients, ImageGradients, ReferenceRenderer, Renderer, Rendering, SplatError};

use differences::Differences;

/// Every renderer that this machine has: the reference, and the processor at each of its instruction sets.
pub fn paths() -> Vec<Box<dyn Renderer>> {
    let mut paths: Vec<Box<dyn Renderer>> = vec![Box::new(ReferenceRenderer)];
    for simd in SimdLevel::available() {
        paths.push(Box::new(CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() })));
    }
    paths
}

/// What a hard case has to give.
#[derive(Debug)]
pub struct Expected<'a> {
    case: &'a HardCase,
    rendering: Rendering<f64>,
    jumps: Vec<Jump>,
    /// Of a loss that looks away from pixels that may jump.
    images: ImageGradients<f32>,
    gradients: Gradients<f64>,
    differences: Differences,
}

impl<'a> Expected<'a> {
    /// Renders and differentiates a case in f64, and takes the differences of its smooth variant.
    ///
    /// # Errors
    /// As [`reference::render`]; the catalogue's cases have none.
    pub fn of(case: &'a HardCase) -> Result<Self, SplatError> {
        let HardCase { gaussians, view, options, bounds, .. } = case;
        let jumps = reference::jumps(gaussians, view, options, bounds.band)?;
        let images = gradients::of_loss(view, &jumps);
        Ok(Self {
            case,
            rendering: reference::render(gaussians, view, options)?,
            gradients: reference::backward(gaussians, view, options, &images.map(f64::from))?,
            differences: Differences::of(case)?,
            jumps,
            images,
        })
    }

    /// Puts a path through the case.
    pub fn row(&self, path: &mut dyn Renderer) -> StressRow {
        let mut row = StressRow {
            case: self.case.name.to_owned(),
            path: path.name(),
            errors: Vec::new(),
            non_finite: 0,
            findings: Vec::new(),
        };
        if let Err(error) = self.try_row(path, &mut row) {
            row.findings.push(error.to_string());
        }
        row
    }

    fn try_row(&self, path: &mut dyn Renderer, row: &mut StressRow) -> Result<(), SplatError> {
        let HardCase { gaussians, view, options, bounds, census, .. } = self.case;
        let rendering = path.render(gaussians, view, options)?;
        let derivatives = path.backward(gaussians, view, options, &self.images)?;
        row.non_finite = rendering.non_finite() + derivatives.non_finite();
        row.errors.push(images::error(self.case, &rendering, &self.rendering, &self.jumps)?);
        row.errors.push(gradients::error(&derivatives, &self.gradients, bounds.gradient));
        row.errors.push(self.differences.error(self.case, path)?);
        if let Some(census) = census
            && rendering.census != *census
        {
            row.findings.push(format!("census: expected {census:?}, found {:?}", rendering.census));
        }
        Ok(())
    }
}
