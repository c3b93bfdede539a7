use atsplat_numeric::Extremes as _;

use super::MeasuredError;

use crate::reference::Jump;
use crate::{Gradients, ImageGradients, SplatError, View};

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
    let mut error = MeasuredError { name: "gradient", absolute: 0.0, relative: 0.0, bound, compared: 0 };
    let pairs = actual.fields().into_iter().zip(expected.fields());
    for (((field, actual), (_, expected)), size) in pairs.zip(sizes(expected)) {
        if actual.len() != expected.len() {
            return Err(SplatError::Length { field, expected: expected.len(), found: actual.len() });
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
pub(super) fn sizes(gradients: &Gradients<f64>) -> [f64; 10] {
    const COMPARABLE: std::ops::RangeInclusive<usize> = 2..=5;
    let largest =
        gradients.fields().map(|(_, field)| field.iter().fold(0.0, |most: f64, value| most.maximum_of(value.abs())));
    let largest_comparable =
        largest.iter().skip(*COMPARABLE.start()).take(COMPARABLE.count()).copied().fold(0.0, f64::maximum_of);
    let mut sizes = largest;
    for field in COMPARABLE {
        sizes[field] = sizes[field].maximum_of(1e-3 * largest_comparable);
    }
    sizes
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
