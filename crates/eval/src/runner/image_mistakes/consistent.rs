//! Asks whether a correction improves every render of a trial, for models that are too weak for it to leave nearly no error.
//!
//! A correct render resembles its ground truth more than one with other channels or sides, however weak it is. Simulated from frames of
//! three real scenes, correct renders of 5 to 25 dB (frames of other poses, means of several, blurred, noisy, dark, pale, tinted or of
//! another scene) have at least 1.8 times their error after a correction that makes them resemble the truth so much: none of 6110 pairs of
//! three such renders and a correction is noted. Of renders of 14 to 25 dB with a mistake, most are.

use super::{Correction, MIN_DISTINCT_DIFFERENCE, RenderAndTruth, added, difference};

/// Not the encodings: a weak model that is too dark or too bright would be better with another one.
const CORRECTIONS: [Correction; 5] = [
    Correction::ExchangeRedAndBlue,
    Correction::MirrorLeftToRight,
    Correction::MirrorTopToBottom,
    Correction::RotateByHalfTurn,
    Correction::Transpose,
];
/// Of fewer targets, one that is closer by accident would be most of the evidence.
const MIN_TARGETS: usize = 3;
/// Every target improves by at least 1 dB: none speaks against the mistake,
const MAX_SHARE_LEFT_OF_EACH: f64 = 0.8;
/// and they improve by 3 dB on average (a geometric mean), where correct renders become worse.
const MAX_MEAN_SHARE_LEFT: f64 = 0.5;
/// The mean cosine of what is compared: renders of something else may become closer, but do not resemble the truth.
const MIN_LIKENESS: f64 = 0.6;

/// The correction that improves all of a trial's `targets` renders most, if one does.
pub(super) fn correction(pairs: &[RenderAndTruth], targets: usize) -> Option<Correction> {
    if targets < MIN_TARGETS || pairs.len() != targets {
        return None;
    }
    let improving = CORRECTIONS.into_iter().filter_map(|correction| Some((correction, share_left(pairs, correction)?)));
    improving.min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(correction, _)| correction)
}

/// The mean share of the error that a correction leaves; `None` unless it improves every render, and far enough.
fn share_left(pairs: &[RenderAndTruth], correction: Correction) -> Option<f64> {
    let (mut logarithms, mut likeness) = (0.0, 0.0);
    for pair in pairs {
        let improvement = Improvement::of(pair, correction)?;
        logarithms += improvement.share_left.ln();
        likeness += improvement.likeness;
    }
    let count = pairs.len() as f64;
    let share_left = (logarithms / count).exp();
    (share_left <= MAX_MEAN_SHARE_LEFT && likeness / count >= MIN_LIKENESS).then_some(share_left)
}

/// How a correction improves one render.
struct Improvement {
    share_left: f64,
    likeness: f64,
}

impl Improvement {
    /// `None` if the render does not improve enough, or if the truth does not show the difference.
    fn of(pair: &RenderAndTruth, correction: Correction) -> Option<Self> {
        let corrected = pair.render.corrected(correction)?;
        let truth = compared(&pair.truth.pixels, correction);
        let [before, after] = [&pair.render.pixels, &corrected].map(|pixels| compared(pixels, correction));
        let share_left = difference(&after, &truth) / difference(&before, &truth);
        let is_distinct = product(&truth, &truth) / truth.len() as f64 >= MIN_DISTINCT_DIFFERENCE;
        let likeness = product(&after, &truth) / (product(&after, &after) * product(&truth, &truth)).sqrt();
        (is_distinct && share_left <= MAX_SHARE_LEFT_OF_EACH).then_some(Self { share_left, likeness })
    }
}

/// What a correction changes of an image: of exchanged channels the difference of red and blue, of moved pixels their deviations from the
/// mean colour. What else is wrong with the image stays as it is.
fn compared(pixels: &[[f64; 3]], correction: Correction) -> Vec<[f64; 3]> {
    if correction == Correction::ExchangeRedAndBlue {
        return pixels.iter().map(|[red, _, blue]| [red - blue; 3]).collect();
    }
    let count = pixels.len() as f64;
    let mean = pixels.iter().fold([0.0; 3], |sum, pixel| added(sum, *pixel)).map(|sum| sum / count);
    pixels.iter().map(|pixel| added(*pixel, mean.map(|sample| -sample))).collect()
}

/// The scalar product, of a pixel the mean over its channels.
fn product(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| a * b).sum::<f64>() / 3.0
}
