use std::sync::Arc;

use atsplat_eval::expansion::ExpansionTarget;
use atsplat_metrics::ColourMap;
use atsplat_numeric::quantile;
use atsplat_pixels::{ImageU8, Rounding};

use crate::ReportError;
use crate::numbers::significant_digits;
use crate::page::LiveImage;

/// Share of the pixels that may be brighter than the brightest colour of a map.
const CLIPPED: f64 = 0.01;

/// A trial in a row: its context images by frame, then truth, render, error, predicted uncertainty and depth of a target.
///
/// # Errors
/// [`ReportError::Image`] for a render that is not finite, and for maps of a wrong size.
pub fn trial_images(
    context: &[(usize, Arc<ImageU8>)],
    target: &ExpansionTarget,
) -> Result<Vec<LiveImage>, ReportError> {
    let live = |title: &str, note: String, image: ImageU8| LiveImage { title: title.to_owned(), note, image };
    let mut row: Vec<LiveImage> = context
        .iter()
        .map(|(frame, image)| live("context", format!("frame {frame}"), image.as_ref().clone()))
        .collect();
    row.push(live("target", format!("frame {}", target.frame), target.truth.as_ref().clone()));
    let size = [target.truth.width(), target.truth.height()];
    if let Some(last) = target.study.stages.last() {
        let render = last.image.to_u8(Rounding::Nearest)?;
        let error = difference(&render, &target.truth);
        row.push(live("render", format!("{:.2} dB", last.psnr), render));
        row.push(map("error", "mean of |render − target|", size, &error)?);
    }
    if let Some(uncertainty) = &target.study.uncertainty {
        let note = format!("predicted before block {}", uncertainty.block);
        let size = [uncertainty.size.width, uncertainty.size.height];
        row.push(map("uncertainty", &note, size, &uncertainty.predicted)?);
    }
    row.push(map("depth", "of the render, in scene units", size, &target.study.depth)?);
    Ok(row)
}

/// Mean absolute difference over the channels, in [0, 1].
fn difference(a: &ImageU8, b: &ImageU8) -> Vec<f64> {
    let pixels = a.samples().chunks_exact(3).zip(b.samples().chunks_exact(3));
    let channels = |(a, b): (&[u8], &[u8])| a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
    pixels.map(|pair| channels(pair) / (3.0 * 255.0)).collect()
}

/// Violet is 0; the note says what yellow is.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours are in [0, 1]")]
fn map(title: &str, what: &str, [width, height]: [u32; 2], values: &[f64]) -> Result<LiveImage, ReportError> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let brightest = quantile(&sorted, 1.0 - CLIPPED).unwrap_or(0.0);
    let scale = if brightest > 0.0 { brightest } else { 1.0 };
    let colours = values.iter().flat_map(|value| ColourMap::Viridis.colour(value / scale));
    let image = ImageU8::new(width, height, colours.map(|share| (share * 255.0).round() as u8).collect())?;
    let brightest = significant_digits(brightest);
    Ok(LiveImage { title: title.to_owned(), note: format!("{what}; yellow from {brightest}"), image })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_is_violet_at_zero_and_yellow_at_its_brightest() {
        let values: Vec<f64> = (0..200).map(|at| if at == 199 { 50.0 } else { f64::from(at) / 99.0 }).collect();
        let shown = map("error", "of a test", [20, 10], &values).unwrap();
        assert_eq!(shown.image.pixel(0, 0), Some([68, 1, 84]));
        assert_eq!(shown.image.pixel(19, 9), Some([253, 231, 37]), "brighter than one per cent");
        assert!(shown.note.starts_with("of a test; yellow from 1.99"), "{}", shown.note);
        assert!(map("error", "of a wrong size", [20, 11], &values).is_err());
        let dark = map("error", "of a good render", [2, 1], &[0.0041, 0.0041]).unwrap();
        assert_eq!(dark.note, "of a good render; yellow from 0.00410");
        let same = map("error", "none", [2, 1], &[0.0, 0.0]).unwrap();
        assert_eq!(same.image.pixel(1, 0), Some([68, 1, 84]));
    }

    #[test]
    fn differences_are_means_over_channels() {
        let [a, b] =
            [[0, 10, 20, 5, 5, 5], [255, 10, 0, 5, 5, 6]].map(|samples| ImageU8::new(2, 1, samples.to_vec()).unwrap());
        let expected = [275.0 / 765.0, 1.0 / 765.0];
        atsplat_numeric::Tolerance::F64.assert(difference(&a, &b), expected, "of two pixels");
    }
}
