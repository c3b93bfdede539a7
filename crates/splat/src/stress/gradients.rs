use atsplat_numeric::Extremes as _;

use super::MeasuredError;

use crate::reference::Jump;
use crate::{Gradients, ImageGradients, View};

/// Derivatives by images that differ from pixel to pixel, none where a pixel may jump: there is no derivative.
pub(super) fn of_loss(view: &View, jumps: &[Jump]) -> ImageGradients<f32> {
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

/// The largest error of all fields, each as a share of its largest value.
pub(super) fn error(actual: &Gradients<f32>, expected: &Gradients<f64>, bound: f64) -> MeasuredError {
    let mut error = MeasuredError { name: "gradient", absolute: 0.0, relative: 0.0, bound, compared: 0 };
    let pairs = actual.fields().into_iter().zip(expected.fields());
    for (((_, actual), (_, expected)), size) in pairs.zip(sizes(expected)) {
        for (actual, expected) in actual.iter().zip(expected) {
            let apart = (f64::from(*actual) - expected).abs();
            error.absolute = error.absolute.maximum_of(apart);
            error.relative = error.relative.maximum_of(share(apart, size));
            error.compared += 1;
        }
    }
    error
}

/// The largest derivative of each field. Of log-scales, logits, harmonics and scalars, whose units compare, at least a
/// thousandth of the largest: where nothing depends on a field, its derivatives are what others left by rounding.
pub(super) fn sizes(gradients: &Gradients<f64>) -> [f64; 10] {
    const ALIKE: std::ops::RangeInclusive<usize> = 2..=5;
    let largest =
        gradients.fields().map(|(_, field)| field.iter().fold(0.0, |most: f64, value| most.maximum_of(value.abs())));
    let of_alike = largest.iter().skip(*ALIKE.start()).take(ALIKE.count()).copied().fold(0.0, f64::maximum_of);
    let mut sizes = largest;
    for field in ALIKE {
        sizes.get_mut(field).into_iter().for_each(|size| *size = size.maximum_of(1e-3 * of_alike));
    }
    sizes
}

/// Of a size below which a derivative is nothing: derivatives by images are of order one, and f32 has no less.
pub(super) fn share(apart: f64, size: f64) -> f64 {
    apart / size.maximum_of(f64::from(f32::MIN_POSITIVE))
}
