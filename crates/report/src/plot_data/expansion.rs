use atsplat_eval::expansion::{ExpansionScene, ExpansionTarget, Stage, Uncertainty};
use atsplat_metrics::ColourMap;
use atsplat_numeric::Extremes as _;
use atsplat_numeric::spread;
use atsplat_pixels::{ImageU8, PixelError, Rounding};

use crate::plot::{
    Drawing, ExpansionStrip, ExpansionStrips, StripImage, TokenExpansion, UncertaintyRow, UncertaintyTriplets,
};
use crate::{ReportError, counted};

/// The most expanded tokens drawn over an image, so that it stays readable.
const MAX_DRAWN: usize = 160;

/// Plots by name: tokens of each scene, then strips and uncertainty of all targets; plots without data are omitted.
/// `subject` names model, weights and protocol.
///
/// # Errors
/// [`ReportError::Image`] for renders that are not finite, and for maps of a wrong size.
pub fn expansion_plots(subject: &str, scenes: &[ExpansionScene]) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut plots = Vec::new();
    for (at, scene) in scenes.iter().enumerate().filter(|(_, scene)| !scene.expanded_tokens.is_empty()) {
        plots.push((format!("token-expansion-{}", at + 1), tokens(subject, scene).draw()));
    }
    let targets = || scenes.iter().flat_map(|scene| scene.targets.iter().map(move |target| (scene, target)));
    let label = |scene: &ExpansionScene, target: &ExpansionTarget| format!("{}, frame {}", scene.label, target.frame);
    let rows = targets().map(|(scene, target)| {
        let truth = StripImage { image: target.truth.as_ref().clone(), caption: String::new() };
        let stages = target.study.stages.iter().map(stage);
        let images = stages.chain([Ok(truth)]).collect::<Result<_, ReportError>>()?;
        Ok(ExpansionStrip { label: label(scene, target), images })
    });
    let strips = rows.collect::<Result<Vec<_>, ReportError>>()?;
    if let Some((_, first)) = targets().next() {
        let names = first.study.stages.iter().map(|stage| blocks(&stage.blocks));
        let plot = ExpansionStrips {
            title: "Expansion, block by block".to_owned(),
            subtitle: format!(
                "{subject}, {}; the same weights with expansion enabled in ever more blocks",
                counted(scenes.len() as u64, "scene")
            ),
            columns: names.chain(["truth".to_owned()]).collect(),
            strips,
        };
        plots.push(("expansion-strips".to_owned(), plot.draw()));
    }
    let rows = targets().filter_map(|(scene, target)| Some((label(scene, target), target.study.uncertainty.as_ref()?)));
    let rows = rows.map(|(label, uncertainty)| triplet(&label, uncertainty)).collect::<Result<Vec<_>, _>>()?;
    if !rows.is_empty() {
        let plot = UncertaintyTriplets {
            title: "Error, prediction, selection".to_owned(),
            subtitle: format!(
                "{subject}, {}; before the last block that expands",
                counted(scenes.len() as u64, "scene")
            ),
            rows,
        };
        plots.push(("uncertainty".to_owned(), plot.draw()));
    }
    Ok(plots)
}

fn tokens(subject: &str, scene: &ExpansionScene) -> TokenExpansion {
    let ExpansionScene { label, frame, image, expanded_tokens, expanded, .. } = scene;
    let drawn = spread(expanded_tokens.len(), MAX_DRAWN);
    let expansions = drawn.iter().filter_map(|&at| expanded_tokens.get(at)).cloned();
    let place = format!("{label} from frame {frame}");
    TokenExpansion {
        title: "Children around their parents".to_owned(),
        subtitle: format!("{subject}; {place}: {} of {expanded} expanded tokens", drawn.len()),
        image: Some(image.as_ref().clone()),
        size: [image.width(), image.height()].map(f64::from),
        expansions: expansions.collect(),
    }
}

fn stage(stage: &Stage) -> Result<StripImage, ReportError> {
    let gaussians = stage.gaussians as f64;
    let count = if gaussians < 1e3 { format!("{gaussians:.0}") } else { format!("{:.1}K", gaussians / 1e3) };
    Ok(StripImage { image: stage.image.to_u8(Rounding::Nearest)?, caption: format!("{:.2} dB · {count}", stage.psnr) })
}

/// `no expansion`, `block 2`, `blocks 2–4`, `blocks 2, 4`.
fn blocks(blocks: &[usize]) -> String {
    match blocks {
        [] => "no expansion".to_owned(),
        [only] => format!("block {only}"),
        [first, .., last] if last - first + 1 == blocks.len() => format!("blocks {first}–{last}"),
        _ => format!("blocks {}", blocks.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn triplet(label: &str, uncertainty: &Uncertainty) -> Result<UncertaintyRow, ReportError> {
    // The prediction was trained to equal the error: a common scale shows how much it differs.
    let brightest = brightest(&uncertainty.error).maximum_of(brightest(&uncertainty.predicted)).maximum_of(1e-6);
    let heat = |values: &[f64]| map(uncertainty, values, |value| ColourMap::Viridis.colour(value / brightest));
    let share = 100.0 * uncertainty.selected as f64 / uncertainty.tokens.max(1) as f64;
    let agreement =
        uncertainty.correlation.map_or("no rank correlation".to_owned(), |found| format!("Spearman {found:.2}"));
    Ok(UncertaintyRow {
        label: format!("{label}, block {}", uncertainty.block),
        render: uncertainty.render.to_u8(Rounding::Nearest)?,
        error: heat(&uncertainty.error)?,
        predicted: heat(&uncertainty.predicted)?,
        brightest,
        selected_alpha: map(uncertainty, &uncertainty.selected_alpha, |alpha| ColourMap::Grey.colour(alpha))?,
        captions: [
            format!("mean {:.3}", mean(&uncertainty.error)),
            format!("mean {:.3} · {agreement}", mean(&uncertainty.predicted)),
            format!("{} of {} tokens ({share:.0} %)", uncertainty.selected, uncertainty.tokens),
        ],
    })
}

/// The 99th percentile; 0 without values.
fn brightest(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() * 99 / 100).copied().unwrap_or(0.0)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours are in [0, 1]")]
fn map(uncertainty: &Uncertainty, values: &[f64], colour: impl Fn(f64) -> [f32; 3]) -> Result<ImageU8, PixelError> {
    let samples = values.iter().flat_map(|value| colour(*value).map(|share| (share * 255.0).round() as u8));
    ImageU8::new(uncertainty.size.width, uncertainty.size.height, samples.collect())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn names_ranges_and_lists_of_blocks() {
        let cases: [(&[usize], &str); 4] =
            [(&[], "no expansion"), (&[2], "block 2"), (&[2, 3, 4], "blocks 2–4"), (&[2, 4], "blocks 2, 4")];
        for (given, expected) in cases {
            assert_eq!(blocks(given), expected);
        }
    }

    #[test]
    fn without_data_there_is_no_plot() {
        assert!(expansion_plots("subject", &[]).unwrap().is_empty());
        let image = Arc::new(ImageU8::new(2, 1, vec![7; 6]).unwrap());
        let scene = ExpansionScene {
            label: "s".to_owned(),
            frame: 0,
            image,
            expanded_tokens: Vec::new(),
            expanded: 3,
            targets: Vec::new(),
        };
        assert!(expansion_plots("subject", &[scene]).unwrap().is_empty());
    }

    #[test]
    fn one_per_cent_of_the_values_may_be_brighter() {
        let values: Vec<f64> = (0..1000).map(f64::from).collect();
        assert_eq!(brightest(&values).to_bits(), 990.0f64.to_bits());
        assert_eq!(brightest(&[]).to_bits(), 0.0f64.to_bits());
    }
}
