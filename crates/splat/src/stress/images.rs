use atsplat_numeric::Extremes as _;

use super::{ErrorKind, MeasuredError};

use crate::hard_cases::HardCase;
use crate::reference::{self, Jump};
use crate::{Rendering, SplatError};

/// An image to compare, and the range of its composited values.
struct Compared<'a> {
    actual: &'a [f32],
    expected: &'a [f64],
    /// Range of the composited values.
    spread: f64,
}

/// The largest error over all images, minus the allowed jumps.
///
/// # Errors
/// [`SplatError::Image`] naming the first image that is missing or of another size, which cannot be compared.
pub(super) fn error(
    case: &HardCase,
    actual: &Rendering<f32>,
    expected: &Rendering<f64>,
    jumps: &[Jump],
    bound: f64,
) -> Result<MeasuredError, SplatError> {
    check_lengths(actual, expected)?;
    let mut error = MeasuredError { kind: ErrorKind::Image, absolute: 0.0, relative: 0.0, bound, compared: 0 };
    let [colour, depth, scalar] = spreads(case)?;
    let flat = |image: &[f64]| image.iter().fold(1.0, |most: f64, value| most.maximum_of(value.abs()));
    let mut compare =
        |Compared { actual, expected, spread }: Compared<'_>, samples: usize, skips: fn(&Jump) -> bool| {
            let size = flat(expected);
            for ((actual, expected), jump) in actual.chunks(samples).zip(expected.chunks(samples)).zip(jumps) {
                if skips(jump) {
                    continue;
                }
                for (actual, expected) in actual.iter().zip(expected) {
                    let difference = (f64::from(*actual) - expected).abs() - jump.share * spread;
                    error.absolute = error.absolute.maximum_of(difference);
                    error.relative = error.relative.maximum_of(difference / size);
                    error.compared += 1;
                }
            }
        };
    let never = |_: &Jump| false;
    let gain = case.options.exposure.map_or(1.0, |exposure| exposure.gain());
    let (rgb, expected_rgb) = (actual.rgb.as_flattened(), expected.rgb.as_flattened());
    compare(Compared { actual: rgb, expected: expected_rgb, spread: colour * gain }, 3, never);
    compare(Compared { actual: &actual.alpha, expected: &expected.alpha, spread: 1.0 }, 1, never);
    if let (Some(actual), Some(expected)) = (&actual.depth, &expected.depth) {
        compare(Compared { actual, expected, spread: depth }, 1, never);
    }
    if let (Some(actual), Some(expected)) = (&actual.scalar, &expected.scalar) {
        compare(Compared { actual, expected, spread: scalar }, 1, never);
    }
    if let (Some(actual), Some(expected)) = (&actual.median_depth, &expected.median_depth) {
        compare(Compared { actual, expected, spread: depth }, 1, |jump| jump.median);
    }
    Ok(error)
}

fn check_lengths(actual: &Rendering<f32>, expected: &Rendering<f64>) -> Result<(), SplatError> {
    let described =
        |pixels: Option<usize>| pixels.map_or_else(|| "no such image".to_owned(), |count| format!("{count} pixels"));
    for ((image, found), (_, expected)) in lengths(actual).into_iter().zip(lengths(expected)) {
        if found != expected {
            return Err(SplatError::Image { image, expected: described(expected), found: described(found) });
        }
    }
    Ok(())
}

/// Name and number of pixels of each image; `None` for an image that is absent.
fn lengths<T>(rendering: &Rendering<T>) -> [(&'static str, Option<usize>); 5] {
    let Rendering { rgb, alpha, depth, scalar, median_depth, .. } = rendering;
    [
        ("rgb image", Some(rgb.len())),
        ("alpha image", Some(alpha.len())),
        ("depth image", depth.as_ref().map(Vec::len)),
        ("scalar image", scalar.as_ref().map(Vec::len)),
        ("median-depth image", median_depth.as_ref().map(Vec::len)),
    ]
}

/// Ranges of the composited values: colour including the background, depth and scalar including zero.
fn spreads(case: &HardCase) -> Result<[f64; 3], SplatError> {
    let mut ranges = [[0.0; 2]; 3];
    let mut widen = |range: usize, value: f64| {
        if let Some([low, high]) = ranges.get_mut(range) {
            (*low, *high) = (low.minimum_of(value), high.maximum_of(value));
        }
    };
    case.options.background.iter().for_each(|channel| widen(0, *channel));
    let projections = reference::project(&case.gaussians, &case.view, &case.options)?;
    let scalars = case.gaussians.parts().scalars.iter().flatten().map(|scalar| f64::from(*scalar));
    for (projection, scalar) in projections.iter().zip(scalars.chain(std::iter::repeat(0.0))) {
        let Some(projection) = projection else { continue };
        projection.rgb.iter().for_each(|channel| widen(0, *channel));
        widen(1, projection.depth);
        widen(2, scalar);
    }
    Ok(ranges.map(|[low, high]| high - low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Exposure;
    use crate::hard_cases::catalogue;
    use crate::renderer::saturated;

    /// A missing image is not one without errors.
    #[test]
    fn every_image_is_compared() {
        let case = catalogue().into_iter().find(|case| case.name == "zero-quaternions").unwrap();
        let expected = reference::render(&case.gaussians, &case.view, &case.options).unwrap();
        let jumps = reference::jumps(&case.gaussians, &case.view, &case.options, case.bounds.band).unwrap();
        let of = |actual: &Rendering<f32>| error(&case, actual, &expected, &jumps, 1e-6);
        let complete = expected.clone().map(saturated);
        assert!(of(&complete).unwrap().passes());
        let text = |actual: &Rendering<f32>| of(actual).unwrap_err().to_string();
        let without_depth = Rendering { depth: None, ..complete.clone() };
        assert_eq!(text(&without_depth), "depth image: expected 432 pixels, found no such image");
        let mut short = complete;
        short.alpha.pop();
        assert_eq!(text(&short), "alpha image: expected 432 pixels, found 431 pixels");
    }

    /// An exposure brightens jumps of colour as it brightens the image.
    #[test]
    fn allowed_jumps_of_colour_are_as_large_as_the_exposure_shows_them() {
        let mut case = catalogue().into_iter().find(|case| case.name == "zero-quaternions").unwrap();
        case.options.exposure = Some(Exposure::uniform(4.0));
        let expected = reference::render(&case.gaussians, &case.view, &case.options).unwrap();
        let [colours, ..] = spreads(&case).unwrap();
        assert!(colours > 0.0);
        let jumps = vec![Jump { share: 0.125, median: false }; expected.rgb.len()];
        let with_change = |share: f64| {
            let mut changed = expected.clone();
            changed.rgb[7][1] += share * colours;
            error(&case, &changed.map(saturated), &expected, &jumps, 1e-6).unwrap().passes()
        };
        assert_eq!([with_change(0.45), with_change(0.55)], [true, false], "four times an eighth of the colours' range");
    }
}
