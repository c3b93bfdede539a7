//! A target's row: scores and hashes.

use atsplat_files::Sha256Digest;
use atsplat_metrics::{NotComputed, Score, Suite, definition};
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::{TargetView, Trial};
use atsplat_results::{IDENTICAL, TargetRow, TargetStatus, TrialKey, WEIGHTS_ABSENT};

/// The row of a target before it is rendered.
pub(super) fn unscored_row(key: &TrialKey, trial: &Trial, target: &TargetView, position: usize) -> TargetRow {
    TargetRow {
        key: key.clone(),
        target: super::group_run::to_u32(position),
        frame: target.frame as u64,
        signed_distance: target.label.signed_distance,
        leaked: target.label.leaked,
        overlap: trial.entry().overlap.as_ref().map(|overlap| overlap.value),
        width: target.size.width,
        height: target.size.height,
        truth_hash: None,
        render_hash: None,
        status: TargetStatus::Failed,
        detail: None,
        non_finite: 0,
        scores: [].into(),
        not_computed: [].into(),
    }
}

/// Compares a render with the ground truth and fills in the row.
pub(super) fn compare(row: &mut TargetRow, suite: &Suite, render: &Image, truth: &ImageU8) {
    row.render_hash = Some(hash_of(render));
    let [expected, found] =
        [(truth.width(), truth.height()), (render.width(), render.height())].map(|(w, h)| format!("{w}×{h}"));
    if expected != found {
        row.detail = Some(format!("expected an image of {expected}, found {found}"));
        return;
    }
    let scored = suite.score(render, &Image::from_u8(truth));
    row.non_finite = scored.non_finite.render;
    row.status = if scored.non_finite.total() > 0 {
        row.detail = Some(scored.non_finite.to_string());
        TargetStatus::NonFinite
    } else if scored.identical {
        TargetStatus::Identical
    } else {
        TargetStatus::Scored
    };
    for (id, score) in scored.scores {
        let why = match score {
            Score::Value(value) if possible(id, value) => {
                row.scores.insert(id.to_owned(), value);
                continue;
            }
            // Sums of squares of enormous samples lose all digits of an SSIM.
            Score::Value(value) => format!("the score is {value}"),
            Score::Identical => IDENTICAL.to_owned(),
            // The searched folders are in the provenance.
            Score::NotComputed(NotComputed::WeightsAbsent(_)) => WEIGHTS_ABSENT.to_owned(),
            Score::NotComputed(_) if row.status == TargetStatus::NonFinite => "NaN or infinite samples".to_owned(),
            Score::NotComputed(reason) => reason.to_string(),
        };
        row.not_computed.insert(id.to_owned(), why);
    }
}

/// Whether a score is finite and within the range of its metric: another one is not stored.
fn possible(id: &str, score: f64) -> bool {
    score.is_finite() && definition(id).is_none_or(|metric| metric.is_possible(score))
}

/// SHA-256 of the samples as little-endian f32.
pub(super) fn hash_of(render: &Image) -> String {
    let bytes: Vec<u8> = render.samples().iter().flat_map(|sample| sample.to_le_bytes()).collect();
    Sha256Digest::of(&bytes).to_string()
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::Networks;
    use atsplat_numeric::Tolerance;

    use super::super::named_metrics;
    use super::*;

    fn scored(change: impl Fn(usize, f32) -> f32) -> TargetRow {
        let ids = ["psnr", "ssim", "psnr-8bit-rounded", "lpips"];
        let suite = Suite::new(named_metrics(ids).unwrap(), Networks::default(), 0);
        let samples: Vec<u8> = (0..64u32 * 64 * 3).map(|at| u8::try_from(40 + at * 7 % 160).unwrap()).collect();
        let truth = ImageU8::new(64, 64, samples).unwrap();
        let changed = Image::from_u8(&truth).into_samples();
        let changed = changed.into_iter().enumerate().map(|(at, sample)| change(at, sample)).collect();
        let (width, height, status) = (64, 64, TargetStatus::Failed);
        let sample = crate::sample_rows::target("m", "a", 0, 0, "psnr", 0.0);
        let mut row = TargetRow { width, height, status, scores: [].into(), ..sample };
        compare(&mut row, &suite, &Image::new(64, 64, changed).unwrap(), &truth);
        row.check().unwrap();
        row
    }

    #[test]
    fn an_identical_render_has_no_infinite_score() {
        let row = scored(|_, sample| sample);
        assert_eq!(row.status, TargetStatus::Identical);
        assert_eq!(row.not_computed["psnr"], IDENTICAL);
        assert_eq!(row.scores.keys().collect::<Vec<_>>(), ["ssim"]);
        assert_eq!(row.not_computed["lpips"], "weights absent");
    }

    #[test]
    fn a_render_that_is_identical_only_after_rounding_is_scored() {
        let row = scored(|_, sample| sample + 1e-4);
        assert_eq!(row.status, TargetStatus::Scored);
        assert_eq!(row.not_computed["psnr-8bit-rounded"], IDENTICAL);
        Tolerance::absolute(1e-2).assert([row.scores["psnr"]], [80.0], "an offset of 1e-4");
    }

    #[test]
    fn non_finite_samples_are_counted_and_not_scored() {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let row = scored(|at, sample| if at % 1000 == 7 { value } else { sample });
            assert_eq!((row.status, row.non_finite), (TargetStatus::NonFinite, 13));
            assert!(row.scores.is_empty() && row.not_computed.len() == 4);
            assert!(row.detail.unwrap().contains("column 2, row 0"));
        }
    }
}
