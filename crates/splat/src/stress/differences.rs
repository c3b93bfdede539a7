//! Gradients against finite differences of the rendering function with its thresholds removed.
//!
//! At a threshold the rendering function jumps and has no gradient. The tests therefore differentiate it without an
//! early stop and with a `min_alpha` of 1e-12, where a Gaussian has faded out. The remaining jumps (near plane) and
//! kinks (clamps, depth ties) show as differences that do not converge as steps shrink, or that differ between the two
//! sides; such parameters are skipped, and the compared ones are counted. Backends in f32 support a `min_alpha` of at
//! least 1e-6: its effect on a gradient is known from the reference, and is subtracted from the difference.

use atsplat_numeric::Extremes as _;

use super::{ErrorKind, MeasuredError};
use rayon::prelude::*;

use super::gradients::{loss_gradients, relative, sizes};
use super::parameter::{Parameter, moved};
use crate::constants::{Extent, SMALLEST_MIN_ALPHA};
use crate::hard_cases::HardCase;
use crate::{
    ClampedGradient, Gaussians, ImageGradients, RenderOptions, Renderer, RendererConstants, Rendering, SplatError,
    View, reference,
};

/// `min_alpha` for the reference.
const FADED: f64 = 1e-12;
/// `min_alpha` for f32 backends.
const FADED_IN_F32: f64 = SMALLEST_MIN_ALPHA;

/// Finite differences with respect to selected parameters.
#[derive(Debug)]
pub(super) struct Differences {
    images: ImageGradients<f32>,
    differences: Vec<Difference>,
}

#[derive(Debug)]
struct Difference {
    parameter: Parameter,
    value: f64,
    /// The largest gradient of its field.
    size: f64,
}

impl Differences {
    pub(super) fn of(case: &HardCase) -> Result<Self, SplatError> {
        let images = loss_gradients(&case.view, &[]);
        let options = smooth(&case.options, FADED);
        let scene = Scene { case, options: &options, images: &images.map(f64::from) };
        let analytic = |min_alpha| {
            let options = smooth(&case.options, min_alpha);
            reference::backward_unchecked(&case.gaussians, &case.view, &options, scene.images)
        };
        let (whole, cut) = (analytic(FADED)?, analytic(FADED_IN_F32)?);
        let sizes = sizes(&whole);
        let differences = scene.parameters()?.into_par_iter().filter_map(|(parameter, step)| {
            let (_, size) = sizes.into_iter().find(|(field, _)| *field == parameter.field())?;
            let value = scene.difference(parameter, step, size)?
                - (parameter.gradient_in(&whole)? - parameter.gradient_in(&cut)?);
            Some(Difference { parameter, value, size })
        });
        Ok(Self { differences: differences.collect(), images })
    }

    /// Compares a renderer's gradients with the differences.
    pub(super) fn error(
        &self,
        case: &HardCase,
        renderer: &mut dyn Renderer,
        bound: f64,
    ) -> Result<MeasuredError, SplatError> {
        let options = smooth(&case.options, FADED_IN_F32);
        let gradients = renderer.backward(&case.gaussians, &case.view, &options, &self.images)?;
        let compared = self.differences.len() as u64;
        let mut error = MeasuredError { kind: ErrorKind::Differences, absolute: 0.0, relative: 0.0, bound, compared };
        for Difference { parameter, value, size } in &self.differences {
            let difference = (parameter.gradient_in(&gradients).unwrap_or(f64::NAN) - value).abs();
            error.absolute = error.absolute.maximum_of(difference);
            error.relative = error.relative.maximum_of(relative(difference, *size));
        }
        Ok(error)
    }
}

/// The options without thresholds, and with exact gradients of clamped values.
fn smooth(options: &RenderOptions, min_alpha: f64) -> RenderOptions {
    let constants = RendererConstants {
        min_alpha,
        min_transmittance: 0.0,
        extent: Extent::Exact,
        clamped_gradient: ClampedGradient::Exact,
        ..options.constants.clone()
    };
    RenderOptions { constants, ..options.clone() }
}

struct Scene<'a> {
    case: &'a HardCase,
    options: &'a RenderOptions,
    images: &'a ImageGradients<f64>,
}

impl Scene<'_> {
    /// The parameters of a few Gaussians and the pose, each with a step that changes the image little.
    fn parameters(&self) -> Result<Vec<(Parameter, f64)>, SplatError> {
        const SMALL: f64 = 1.0 / 256.0;
        let HardCase { gaussians, view, .. } = self.case;
        let projections = reference::project_unchecked(gaussians, view, self.options)?;
        let drawn: Vec<(usize, f64)> = projections
            .iter()
            .enumerate()
            .filter_map(|(position, projection)| Some((position, projection.as_ref()?.depth)))
            .collect();
        let k = view.camera.intrinsics.pixel_from_normalized(view.size);
        // Size of a pixel at unit distance.
        let pixel = k.fx.maximum_of(k.fy).recip();
        let mut chosen: Vec<(usize, f64)> = [0, drawn.len() / 2, drawn.len().saturating_sub(1)]
            .into_iter()
            .filter_map(|place| drawn.get(place).copied())
            .collect();
        chosen.dedup_by_key(|(position, _)| *position);
        chosen.truncate(if gaussians.len() > 500 { 1 } else { 3 });
        let step = |parameter: Parameter, depth: f64| match parameter {
            Parameter::Mean(..) => SMALL * pixel * depth,
            Parameter::Quaternion(at, _) => {
                let quaternion = gaussians.parts().quaternions[at];
                SMALL * quaternion.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt()
            }
            Parameter::Sh(at, _) => {
                let coefficient = gaussians.parts().sh[at];
                SMALL * coefficient.iter().map(|value| f64::from(value.abs())).fold(1.0, f64::maximum_of)
            }
            _ => SMALL,
        };
        let mut list: Vec<(Parameter, f64)> = Vec::new();
        for (position, depth) in &chosen {
            let parameters = Parameter::of_gaussian(gaussians, *position);
            list.extend(parameters.into_iter().map(|parameter| (parameter, step(parameter, *depth))));
        }
        let nearest = drawn.iter().map(|(_, depth)| *depth).fold(f64::INFINITY, f64::minimum_of);
        if nearest.is_finite() {
            let step = |axis| if axis < 3 { SMALL * pixel } else { SMALL * pixel * nearest };
            list.extend((0..6).map(|axis| (Parameter::Pose(axis), step(axis))));
        }
        Ok(list)
    }

    /// The derivative with respect to a parameter; `None` if the differences do not converge.
    fn difference(&self, parameter: Parameter, step: f64, size: f64) -> Option<f64> {
        const TRIES: i32 = 5;
        // Rounding error of sums over pixels, relative to the sum of magnitudes.
        const ROUNDING: f64 = 1e-15;
        // Far below the errors to be detected.
        const SETTLED: f64 = 1e-5;
        let here = self.loss(&self.case.gaussians, &self.case.view)?;
        (0..TRIES).find_map(|attempt| {
            let step = step * 0.125f64.powi(attempt);
            let noise = ROUNDING * here.magnitude / (0.25 * step);
            let [wide, middle, narrow] = [1.0, 0.5, 0.25].map(|share| self.slope(parameter, step * share, here.sum));
            let (wide, middle, narrow) = (wide?, middle?, narrow?);
            let (coarse, fine) =
                ((4.0 * middle.central - wide.central) / 3.0, (4.0 * narrow.central - middle.central) / 3.0);
            let kink = 2.0 * narrow.bend - middle.bend;
            let is_settled = (coarse - fine).abs() + kink.abs() + noise <= SETTLED * size;
            is_settled.then_some((16.0 * fine - coarse) / 15.0)
        })
    }

    /// Slopes of the loss over a step to both sides; steps are rounded to f32.
    fn slope(&self, parameter: Parameter, step: f64, here: f64) -> Option<Slope> {
        // Smallest step in units in the last place.
        const RESOLVED: f64 = 64.0;
        if let Parameter::Pose(axis) = parameter {
            let at = |step: f64| {
                let view = moved(&self.case.view, axis, step).ok()?;
                Some((step.abs(), self.loss(&self.case.gaussians, &view)?.sum))
            };
            return Some(Slope::of(at(step)?, here, at(-step)?));
        }
        let mut parts = self.case.gaussians.parts().clone();
        let value = *parameter.slot(&mut parts)?;
        let unit = f64::from(value.abs().next_up() - value.abs());
        if !(step > RESOLVED * unit) {
            return None;
        }
        let mut at = |step: f64| {
            let moved = crate::renderer::saturated(f64::from(value) + step);
            *parameter.slot(&mut parts)? = moved;
            let loss = self.loss(&Gaussians::new(parts.clone()).ok()?, &self.case.view)?;
            Some(((f64::from(moved) - f64::from(value)).abs(), loss.sum))
        };
        Some(Slope::of(at(step)?, here, at(-step)?))
    }

    fn loss(&self, gaussians: &Gaussians, view: &View) -> Option<Loss> {
        let Rendering { rgb, alpha, depth, scalar, .. } =
            reference::render_unchecked(gaussians, view, self.options).ok()?;
        let by = self.images;
        let mut loss = Loss::default();
        loss.add(rgb.as_flattened(), by.rgb.as_flattened());
        for (image, by) in [(&Some(alpha), &by.alpha), (&depth, &by.depth), (&scalar, &by.scalar)] {
            if let (Some(image), Some(by)) = (image, by) {
                loss.add(image, by);
            }
        }
        Some(loss)
    }
}

/// The loss: a weighted sum of all samples.
#[derive(Clone, Copy, Debug, Default)]
struct Loss {
    sum: f64,
    /// The sum of magnitudes.
    magnitude: f64,
}

impl Loss {
    fn add(&mut self, image: &[f64], by: &[f64]) {
        for (value, by) in image.iter().zip(by) {
            self.sum += value * by;
            self.magnitude += (value * by).abs();
        }
    }
}

struct Slope {
    /// Derivative of the parabola through three points, at the middle one.
    central: f64,
    /// Right slope minus left slope: proportional to the step unless there is a kink.
    bend: f64,
}

impl Slope {
    fn of((a, ahead): (f64, f64), here: f64, (b, behind): (f64, f64)) -> Self {
        let (right, left) = ((ahead - here) / a, (here - behind) / b);
        Self { central: (b * right + a * left) / (a + b), bend: right - left }
    }
}
