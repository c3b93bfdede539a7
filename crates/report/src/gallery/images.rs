//! The plots that show images.

use atsplat_eval::expansion::ProjectedToken;
use atsplat_pixels::ImageU8;

use super::{SYNTHETIC, noise};
use crate::plot::{
    ContactRow, ContactSheet, ExpansionStrip, ExpansionStrips, StripImage, TokenExpansion, UncertaintyRow,
    UncertaintyTriplets,
};

pub(super) fn contact_sheet() -> ContactSheet {
    let row = |at: u32| ContactRow {
        label: format!("rooms-test-{at:08}, 21.4 dB"),
        context: vec![image(1.0), image(0.9)],
        targets: vec![[image(0.4), image(1.0)], [image(0.3), image(0.9)]],
    };
    ContactSheet {
        title: "Held-out samples of micro-rooms".to_owned(),
        subtitle: "rooms, 128×128; 2 samples; synthetic data".to_owned(),
        rows: vec![row(1), row(2)],
    }
}

/// A scene of stripes and a disc; `detail` in [0, 1] is the contrast of the stripes.
pub(super) fn image(detail: f64) -> ImageU8 {
    painted(|x, y| {
        let stripes = if (x * 24.0 + y * 5.0).sin() > 0.0 { 0.25 * detail } else { -0.25 * detail };
        let disc = (x - 0.6).hypot(y - 0.45) < 0.22;
        let base = 0.35 + 0.4 * y + stripes;
        if disc { [0.85 - 0.2 * stripes, 0.45, 0.2] } else { [base * 0.8, base, base * 1.05] }
    })
}

fn painted(colour: impl Fn(f64, f64) -> [f64; 3]) -> ImageU8 {
    const WIDTH: u32 = 160;
    const HEIGHT: u32 = 90;
    let samples = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column)));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 8 bits")]
    let samples = samples.flat_map(|(row, column)| {
        colour(f64::from(column) / f64::from(WIDTH), f64::from(row) / f64::from(HEIGHT))
            .map(|value| (value * 255.0).clamp(0.0, 255.0) as u8)
    });
    ImageU8::new(WIDTH, HEIGHT, samples.collect()).unwrap()
}

pub(super) fn strips() -> ExpansionStrips {
    let strip = |label: &str| ExpansionStrip {
        label: label.to_owned(),
        images: [
            (0.1, "22.4 dB · 8K"),
            (0.4, "24.9 dB · 12K"),
            (0.7, "26.6 dB · 18K"),
            (0.9, "27.4 dB · 23K"),
            (1.0, ""),
        ]
        .map(|(detail, caption)| StripImage { image: image(detail), caption: caption.to_owned() })
        .to_vec(),
    };
    ExpansionStrips {
        title: "Expansion, block by block".to_owned(),
        subtitle: format!("the same weights with expansion enabled in ever more blocks; {SYNTHETIC}"),
        columns: ["none", "block 1", "blocks 1–2", "blocks 1–3", "truth"].map(str::to_owned).to_vec(),
        strips: vec![strip("scene-0007, frame 12"), strip("scene-0031, frame 40")],
    }
}

pub(super) fn uncertainty() -> UncertaintyTriplets {
    let heat = |value: f64| [value.sqrt(), value * value, 0.35 * (1.0 - value)];
    let row = |label: &str| UncertaintyRow {
        label: label.to_owned(),
        render: image(0.6),
        error: painted(|x, y| heat(0.5 + 0.5 * (x * 24.0 + y * 5.0).sin())),
        predicted: painted(|x, y| heat(0.5 + 0.4 * (x * 24.0 + y * 5.0 + 0.4).sin())),
        brightest: 0.62,
        selected_alpha: painted(|x, y| if (x * 24.0 + y * 5.0).sin() > 0.2 { [0.9; 3] } else { [0.05; 3] }),
        captions: ["mean 0.031".to_owned(), "Spearman 0.71".to_owned(), "50 % of tokens".to_owned()],
    };
    UncertaintyTriplets {
        title: "Error, prediction, selection".to_owned(),
        subtitle: format!("last block; dark is low, yellow is high; {SYNTHETIC}"),
        rows: vec![row("scene-0007, frame 12"), row("scene-0031, frame 40")],
    }
}

pub(super) fn token_expansion() -> TokenExpansion {
    let expansion = |at: usize| {
        let parent = [4.0 + 152.0 * noise(at * 5), 4.0 + 82.0 * noise(at * 5 + 1)];
        let angle = std::f64::consts::TAU * noise(at * 5 + 2);
        let reach = 1.5 + 3.5 * noise(at * 5 + 3);
        let child = |turn: f64| [parent[0] + reach * (angle + turn).cos(), parent[1] + reach * (angle + turn).sin()];
        ProjectedToken { block: 1 + at % 3, parent, children: vec![child(0.0), child(2.6)] }
    };
    TokenExpansion {
        title: "Children around their parents".to_owned(),
        subtitle: format!("scene-0007 from its first context view; places are mean centres of Gaussians; {SYNTHETIC}"),
        image: Some(image(1.0)),
        size: [160.0, 90.0],
        expansions: (0..110).map(expansion).collect(),
    }
}
