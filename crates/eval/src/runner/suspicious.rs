//! Renders that are scored but are probably a mistake; the notes of their trial count them.

use std::collections::BTreeMap;

use atsplat_pixels::{Image, ImageU8};

use crate::suspicious_notes::SuspiciousNote;

/// Why a render is suspicious.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum SuspiciousRender {
    /// No Gaussian contributes to it.
    Empty,
    /// It is grey, but the ground truth is not.
    NoColour,
}

impl SuspiciousRender {
    /// What is suspicious about a render to which this many Gaussians contribute.
    pub(super) fn of(render: &Image, drawn: Option<u64>, truth: &ImageU8) -> Option<Self> {
        if drawn == Some(0) {
            return Some(Self::Empty);
        }
        // Fast: nearly every render has a colour in its first pixel, and the truth is only examined if the render is
        // grey.
        let is_grey = |pixel: &[f32; 3]| {
            let [red, green, blue] = pixel.map(f32::to_bits);
            red == green && green == blue
        };
        let has_colour = |[red, green, blue]: &[u8; 3]| red != green || green != blue;
        let render_is_grey = render.samples().as_chunks().0.iter().all(is_grey);
        (render_is_grey && truth.samples().as_chunks().0.iter().any(has_colour)).then_some(Self::NoColour)
    }
}

/// Notes on a trial with `gaussians` Gaussians and `targets` targets: how many renders are suspicious, and why.
pub(super) fn notes(
    suspicious: &BTreeMap<SuspiciousRender, usize>,
    targets: usize,
    gaussians: Option<u64>,
) -> Vec<String> {
    let note = |(suspicion, count): (&SuspiciousRender, &usize)| match (suspicion, gaussians) {
        (SuspiciousRender::Empty, Some(0)) => {
            format!("no Gaussian is left: {count} of {targets} renders show the background")
        }
        (SuspiciousRender::Empty, _) => {
            let question = "do the Gaussians belong to this scene, its axes and its unit of length?";
            format!("no Gaussian is drawn: {count} of {targets} renders show the background; {question}")
        }
        (SuspiciousRender::NoColour, _) => {
            format!("{}: {count} of {targets}, where the ground truth has colours", SuspiciousNote::NoColour)
        }
    };
    suspicious.iter().map(note).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_render_without_colour_is_suspicious_where_the_truth_has_some() {
        let truth = |last: u8| ImageU8::new(2, 1, vec![9, 9, 9, 40, 40, last]).unwrap();
        let render = |last: f32| Image::new(2, 1, vec![0.1, 0.1, 0.1, 0.5, 0.5, last]).unwrap();
        assert_eq!(SuspiciousRender::of(&render(0.5), None, &truth(41)), Some(SuspiciousRender::NoColour));
        assert_eq!(SuspiciousRender::of(&render(0.5), None, &truth(40)), None, "a scene without colour");
        assert_eq!(SuspiciousRender::of(&render(0.51), None, &truth(41)), None);
        assert_eq!(SuspiciousRender::of(&render(0.5), Some(1), &truth(41)), Some(SuspiciousRender::NoColour));
        assert_eq!(SuspiciousRender::of(&render(0.51), Some(0), &truth(41)), Some(SuspiciousRender::Empty));
    }
}
