//! The plots of means of a metric, with their intervals.

use super::{SYNTHETIC, around, metric, noise};
use crate::plot::{
    Ablation, AblationRow, DriftHistory, DriftRun, Estimate, ExtrapolationDecay, ExtrapolationPoint,
    ExtrapolationSeries, Origin, OverlapBin, OverlapBinMeans, OverlapBinSeries, OverlapCurves, OverlapSeries,
};

pub(super) fn overlap_curves() -> OverlapCurves {
    let curve = |base: f64, slope: f64| {
        (0..12).map(move |at| {
            let overlap = 0.08 + 0.062 * f64::from(at);
            (overlap, around(base + slope * overlap, 0.25 + 0.3 * (overlap - 0.4).abs()))
        })
    };
    let series =
        |label: &str, base, slope| OverlapSeries { label: label.to_owned(), points: curve(base, slope).collect() };
    OverlapCurves {
        title: "PSNR against overlap".to_owned(),
        subtitle: format!("RealEstate10K by overlap, 5601 scenes; {SYNTHETIC}"),
        quality: metric("psnr"),
        bins: vec![
            OverlapBin { name: "small".to_owned(), edges: [0.05, 0.3], scenes: 1403 },
            OverlapBin { name: "medium".to_owned(), edges: [0.3, 0.55], scenes: 2568 },
            OverlapBin { name: "large".to_owned(), edges: [0.55, 0.8], scenes: 1630 },
        ],
        edges: (1..12).map(|at| 0.049 + 0.062 * f64::from(at)).collect(),
        series: vec![
            series("ATSplat", 22.6, 9.0),
            series("imported: DepthSplat", 21.1, 9.8),
            series("nearest view", 13.9, 6.0),
            series("warp", 14.3, 8.6),
        ],
    }
}

pub(super) fn overlap_bins() -> OverlapBinMeans {
    let series = |label: &str, means: [f64; 4], origin| OverlapBinSeries {
        label: label.to_owned(),
        means: means
            .map(|mean| Some(if origin == Origin::Measured { around(mean, 0.2) } else { Estimate::exact(mean) }))
            .to_vec(),
        origin,
    };
    OverlapBinMeans {
        title: "PSNR by overlap".to_owned(),
        subtitle: format!("RealEstate10K by overlap; {SYNTHETIC}"),
        quality: metric("psnr"),
        bins: ["small", "medium", "large", "average"].map(str::to_owned).to_vec(),
        series: vec![
            series("pixelSplat", [20.28, 23.73, 27.15, 23.86], Origin::Published),
            series("DepthSplat", [22.82, 25.38, 28.32, 25.59], Origin::Published),
            series("iLRM", [23.82, 26.54, 29.43, 26.70], Origin::Published),
            series("ATSplat (paper)", [24.09, 26.56, 29.13, 26.70], Origin::Published),
            series("ATSplat", [23.0, 25.4, 28.0, 25.5], Origin::Measured),
        ],
    }
}

pub(super) fn extrapolation() -> ExtrapolationDecay {
    let curve = |inside: f64, decay: f64| {
        (-10..=10i32).map(move |distance| {
            let outside = f64::from(distance.abs());
            let mean = around(inside - decay * outside.sqrt(), 0.2 + 0.05 * outside);
            ExtrapolationPoint { distance: f64::from(distance), mean, scenes: 12 }
        })
    };
    let series = |label: &str, inside, decay| ExtrapolationSeries {
        label: label.to_owned(),
        points: curve(inside, decay).collect(),
    };
    ExtrapolationDecay {
        title: "PSNR outside the window".to_owned(),
        subtitle: format!("DL3DV, 6 views, 10 frames either side; {SYNTHETIC}"),
        quality: metric("psnr"),
        step: 1.0,
        series: vec![series("ATSplat", 27.2, 2.1), series("warp", 21.0, 2.4), series("nearest view", 18.0, 1.5)],
    }
}

pub(super) fn ablation() -> Ablation {
    let row = |label: &str, published: Result<f64, &str>, measured: f64, gap: f64| AblationRow {
        label: label.to_owned(),
        published: Some(published.map_err(str::to_owned)),
        measured: Some(measured),
        gap: Some(around(gap, 0.18)),
    };
    Ablation {
        title: "Anchor designs".to_owned(),
        subtitle: format!("DL3DV, 6 views; {SYNTHETIC}"),
        quality: metric("psnr"),
        reference: row("Patch depth, anchor + offset", Ok(27.28), 21.9, 0.0),
        rows: vec![
            row("None, ray + depth", Ok(26.37), 21.1, -0.8),
            row("Learnable, direct xyz", Ok(21.05), 18.4, -3.5),
            row("None, direct xyz", Err("Diverged"), 16.2, -5.7),
        ],
        note: String::new(),
    }
}

pub(super) fn drift_history() -> DriftHistory {
    let run = |at: usize| {
        let moved = if at >= 13 { -0.09 } else { 0.0 };
        DriftRun {
            label: format!("{:07x}", (at + 3) * 7_919_317 % 0xfff_ffff),
            mean: 27.4 + 0.012 * (noise(at) - 0.5) + moved,
            limits: Some(if at >= 15 { [27.27, 27.35] } else { [27.36, 27.44] }),
            drift: (13..15).contains(&at).then(|| if at == 13 { "renderer: −0.09 dB" } else { "" }.to_owned()),
        }
    };
    DriftHistory {
        title: "PSNR over commits".to_owned(),
        subtitle: format!("RealEstate10K, quick suite; baseline accepted again at run 16; {SYNTHETIC}"),
        quality: metric("psnr"),
        runs: (0..20).map(run).collect(),
    }
}
