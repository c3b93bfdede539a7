//! Notes of trials whose scores are probably those of a mistake.

use std::fmt;

use atsplat_splat::files::{SUSPICIOUS_COLOURS, SUSPICIOUS_LOG_SCALES, SUSPICIOUS_OPACITIES};

/// What is suspicious about a trial. Its text is how the note begins that the trial has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SuspiciousNote {
    /// Gaussians of which a value is NaN or infinite were repaired or are not drawn.
    BrokenGaussians,
    /// Gaussians of antialiased training or with 3D filters are drawn in the classic mode, because none was chosen.
    DrawnClassic,
    /// Values that look like opacities were read as logits.
    Opacities,
    /// Values that look like scales were read as their logarithms.
    LogScales,
    /// Values that look like colours were read as coefficients.
    Colours,
    /// Renders are grey.
    NoColour,
    /// A change would bring most renders far closer to the ground truth.
    WrittenWrongly,
    /// All imported images are equal.
    Repeated,
    /// No render is better than one colour.
    Flat,
}

impl SuspiciousNote {
    /// All, in the order of the remarks of a table.
    pub const ALL: [Self; 9] = [
        Self::BrokenGaussians,
        Self::DrawnClassic,
        Self::Opacities,
        Self::LogScales,
        Self::Colours,
        Self::NoColour,
        Self::WrittenWrongly,
        Self::Repeated,
        Self::Flat,
    ];

    /// Whether a note says this.
    pub fn is(self, note: &str) -> bool {
        note.starts_with(self.beginning())
    }

    const fn beginning(self) -> &'static str {
        match self {
            Self::BrokenGaussians => "broken Gaussians",
            Self::DrawnClassic => "drawn in the classic mode",
            Self::Opacities => SUSPICIOUS_OPACITIES,
            Self::LogScales => SUSPICIOUS_LOG_SCALES,
            Self::Colours => SUSPICIOUS_COLOURS,
            Self::NoColour => "renders without colour",
            Self::WrittenWrongly => "renders would be closer to the truth",
            Self::Repeated => "one image for all targets",
            Self::Flat => "no better than one flat colour",
        }
    }

    /// What tables say of the trials that have such a note, before "in 2 of 4 trials".
    pub const fn remark(self) -> &'static str {
        match self {
            Self::BrokenGaussians => "broken Gaussians were repaired or not drawn",
            Self::DrawnClassic => "Gaussians of antialiased training or with 3D filters were drawn in the classic mode",
            Self::Opacities => "opacities were read as logits that may be none",
            Self::LogScales => "scales were read as logarithms that may be none",
            Self::Colours => "colours were read as coefficients that may be none",
            Self::NoColour => "renders have no colour",
            Self::WrittenWrongly => {
                "renders seem to have other channels, another encoding, other sides or another order than the ground truth"
            }
            Self::Repeated => "all targets have the same image",
            Self::Flat => "no render is better than one flat colour",
        }
    }
}

impl fmt::Display for SuspiciousNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.beginning())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stores have these beginnings: by another one, tables would no longer remark on the notes of older stores.
    const fn stored(note: SuspiciousNote) -> &'static str {
        match note {
            SuspiciousNote::BrokenGaussians => "broken Gaussians",
            SuspiciousNote::DrawnClassic => "drawn in the classic mode",
            SuspiciousNote::Opacities => "every opacity of the file lies in [0, 1]",
            SuspiciousNote::LogScales => "every log-scale of the file lies in (0, 1]",
            SuspiciousNote::Colours => "every coefficient of the file lies in [0, 1]",
            SuspiciousNote::NoColour => "renders without colour",
            SuspiciousNote::WrittenWrongly => "renders would be closer to the truth",
            SuspiciousNote::Repeated => "one image for all targets",
            SuspiciousNote::Flat => "no better than one flat colour",
        }
    }

    #[test]
    fn notes_are_recognised_by_the_texts_of_stores() {
        for note in SuspiciousNote::ALL {
            let text = format!("{}: 2 of 3", stored(note));
            assert_eq!(note.to_string(), stored(note));
            assert!(SuspiciousNote::ALL.iter().all(|other| other.is(&text) == (*other == note)), "{text}");
        }
    }
}
