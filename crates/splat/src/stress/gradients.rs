use atsplat_numeric::Extremes as _;

use super::{ErrorKind, MeasuredError};

use crate::reference::Jump;
use crate::{GradientField, Gradients, ImageGradients, SplatError, View};

/// Image gradients that vary from pixel to pixel; zero where a pixel may jump, because no gradient exists there.
pub(super) fn loss_gradients(view: &View, jumps: &[Jump]) -> ImageGradients<f32> {
    let wave = |phase: f32| -> Vec<f32> {
        let value = |pixel: usize| (pixel as f32 * 0.7 + phase).sin();
        let is_smooth = |pixel: usize| jumps.get(pixel).is_none_or(|jump| jump.share == 0.0);
        (0..view.pixels()).map(|pixel| if is_smooth(pixel) { value(pixel) } else { 0.0 }).collect()
    };
    let (red, green, blue) = (wave(0.0), wave(1.0), wave(2.0));
    ImageGradients {
        rgb: red.into_iter().zip(green).zip(blue).map(|((r, g), b)| [r, g, b]).collect(),
        alpha: Some(wave(3.0)),
        depth: Some(wave(4.0)),
        scalar: Some(wave(5.0)),
    }
}

/// The largest error over all fields, absolute and relative to the field's largest value.
///
/// # Errors
/// [`SplatError::Length`] naming the first field of another length, which cannot be compared.
pub(super) fn error(
    actual: &Gradients<f32>,
    expected: &Gradients<f64>,
    bound: f64,
) -> Result<MeasuredError, SplatError> {
    let mut error = MeasuredError { kind: ErrorKind::Gradient, absolute: 0.0, relative: 0.0, bound, compared: 0 };
    let pairs = actual.fields().into_iter().zip(expected.fields());
    for (((field, actual), (_, expected)), (_, size)) in pairs.zip(sizes(expected)) {
        if actual.len() != expected.len() {
            let (expected, found) = (expected.len(), actual.len());
            return Err(SplatError::Length { field: field.name(), expected, found });
        }
        for (actual, expected) in actual.iter().zip(expected) {
            let difference = (f64::from(*actual) - expected).abs();
            error.absolute = error.absolute.maximum_of(difference);
            error.relative = error.relative.maximum_of(relative(difference, size));
            error.compared += 1;
        }
    }
    Ok(error)
}

/// The largest gradient of each field. For log-scales, logits, SH coefficients and scalars, whose units are comparable,
/// at least a thousandth of the largest among them: if nothing depends on a field, its gradients are only rounding
/// errors of others.
pub(super) fn sizes(gradients: &Gradients<f64>) -> [(GradientField, f64); 10] {
    let is_comparable = |field| {
        use GradientField::{LogScales, OpacityLogits, Scalars, Sh};
        matches!(field, LogScales | OpacityLogits | Sh | Scalars)
    };
    let largest = gradients
        .fields()
        .map(|(field, values)| (field, values.iter().fold(0.0, |most: f64, value| most.maximum_of(value.abs()))));
    let comparable = largest.iter().filter(|(field, _)| is_comparable(*field)).map(|(_, size)| *size);
    let least = 1e-3 * comparable.fold(0.0, f64::maximum_of);
    largest.map(|(field, size)| (field, if is_comparable(field) { size.maximum_of(least) } else { size }))
}

/// The error relative to a size, which is at least f32's smallest normal number: image gradients are of order one, so
/// smaller gradients are zero in f32.
pub(super) fn relative(difference: f64, size: f64) -> f64 {
    difference / size.maximum_of(f64::from(f32::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::renderer::saturated;
    use crate::stress::parameter::Parameter;

    /// Of the second Gaussian, only the scalar has a gradient.
    #[test]
    fn fields_of_comparable_units_share_the_least_size() {
        let gradients = Gradients {
            means: vec![[0.0, -3.0, 1.0], [0.0; 3]],
            log_scales: vec![[0.5, 0.0, -0.25], [0.0; 3]],
            opacity_logits: vec![0.0; 2],
            sh: vec![[1e-4, 0.0, 0.0], [0.0; 3]],
            scalars: vec![0.0, -2.0],
            pose: [0.0, 0.0, 0.0, 0.0, 0.125, 0.0],
            ..Gradients::default()
        };
        let found = sizes(&gradients);
        let of = |field: GradientField| found.iter().find(|(known, _)| *known == field).map(|(_, size)| *size);
        for (parameter, size) in [
            (Parameter::Mean(1, 2), 3.0),
            (Parameter::Quaternion(0, 3), 0.0),
            (Parameter::LogScale(1, 0), 0.5),
            (Parameter::Logit(0), 2e-3),
            (Parameter::Sh(1, 2), 2e-3),
            (Parameter::Scalar(0), 2.0),
            (Parameter::Pose(5), 0.125),
        ] {
            assert_eq!(of(parameter.field()), Some(size), "{parameter:?}");
        }
        assert_eq!(of(GradientField::Conics), Some(0.0));
    }

    /// A missing gradient is not one without errors.
    #[test]
    fn every_gradient_is_compared() {
        let expected = Gradients { scalars: vec![1.0, -2.0], ..Gradients::<f64>::default() };
        let complete = expected.clone().map(saturated);
        assert!(error(&complete, &expected, 1e-6).unwrap().passes());
        let outcome = error(&Gradients { scalars: vec![1.0], ..complete }, &expected, 1e-6);
        assert!(matches!(outcome, Err(SplatError::Length { field: "scalars", expected: 2, found: 1 })), "{outcome:?}");
    }
}
