//! The plots of time and Gaussians, and of what they buy.

use atsplat_results::tradeoff::{Axis, Standing};

use super::{SYNTHETIC, around, metric};
use crate::plot::{
    EffectCostRow, EffectCosts, Estimate, FrontierPoint, Frontiers, KPoint, KScaling, OptimisationCurves,
    OptimisationPanel, OptimisationPoint, Origin, StageTime, StageTimeRow,
};

pub(super) fn frontiers() -> Frontiers {
    let standing = |at: usize| [Standing::Frontier, Standing::Worse, Standing::NotDistinguishable][at % 3];
    let panel = |cost| {
        let points = frontier(cost).panels.into_iter().flat_map(|(_, points)| points);
        let mut points: Vec<FrontierPoint> = points.filter(|point| point.origin == Origin::Measured).collect();
        points.iter_mut().enumerate().for_each(|(at, point)| point.standing = Some(standing(at)));
        (cost, points)
    };
    Frontiers {
        title: "PSNR against time to the first image and against Gaussians".to_owned(),
        subtitle: format!(
            "RealEstate10K, 2 views, 256×256; {SYNTHETIC}; timed on a machine with a long name, 2 threads on 2 logical processors"
        ),
        quality: metric("psnr"),
        panels: vec![panel(Axis::Seconds), panel(Axis::Gaussians)],
        note: "Frontier against time: K = 4, then warp. Bold: on the frontier; ?: not distinguishable from it."
            .to_owned(),
    }
}

pub(super) fn frontier(cost: Axis) -> Frontiers {
    let published = [
        ("PixelSplat", 131e3, 0.127, 25.89),
        ("MVSplat", 131e3, 0.044, 26.39),
        ("DepthSplat", 131e3, 0.067, 27.47),
        ("iLRM", 131e3, 0.025, 28.65),
        ("TokenGS", 262e3, 0.066, 28.41),
        ("ATSplat (paper)", 23e3, 0.022, 28.46),
    ];
    let measured = [
        ("K = 4", 5760.0, 0.31, 26.1),
        ("K = 8", 11_520.0, 0.33, 26.9),
        ("K = 16", 23_040.0, 0.36, 27.4),
        ("K = 32", 46_080.0, 0.45, 27.6),
        ("warp", 131_072.0, 0.012, 19.4),
    ];
    let place = |gaussians, secs| match cost {
        Axis::Gaussians => gaussians,
        Axis::Seconds => secs,
    };
    let published = published.map(|(label, gaussians, secs, quality)| FrontierPoint {
        label: label.to_owned(),
        cost: place(gaussians, secs),
        spread: None,
        quality: Estimate::exact(quality),
        origin: Origin::Published,
        standing: None,
        ranked: true,
        highlighted: false,
    });
    let measured = measured.map(|(label, gaussians, secs, quality)| FrontierPoint {
        label: label.to_owned(),
        cost: place(gaussians, secs),
        spread: (cost == Axis::Seconds).then_some([0.9 * secs, 1.15 * secs]),
        quality: around(quality, 0.4),
        origin: Origin::Measured,
        standing: None,
        ranked: true,
        highlighted: label == "K = 16",
    });
    let what = if cost == Axis::Gaussians { "Gaussians" } else { "time" };
    Frontiers {
        title: format!("Accuracy against {what}"),
        subtitle: format!("RealEstate10K, 2 views, 256×256; {SYNTHETIC}"),
        quality: metric("psnr"),
        panels: vec![(cost, published.into_iter().chain(measured).collect())],
        note: String::new(),
    }
}

pub(super) fn optimisation() -> OptimisationCurves {
    let curve = |label: &str, [from, rise, context]: [f64; 3]| {
        let point = |step: i32| OptimisationPoint {
            secs: 0.2 * 4.0f64.powi(step),
            held_out: around(from + rise * f64::from(step), 0.8),
            context: (step > 0).then_some(context + 2.0 * f64::from(step)),
        };
        (label.to_owned(), (0..4).map(point).collect())
    };
    let panel = |views: usize| OptimisationPanel {
        name: format!("{views} views · 8 scenes"),
        curves: vec![
            curve("ATSplat + refinement", [22.0, 0.3, 24.0]),
            curve("3DGS", [13.0 + views as f64, -0.4, 30.0]),
            curve("Mip-Splatting", [14.0 + views as f64, 0.2, 28.0]),
        ],
    };
    OptimisationCurves {
        title: "PSNR against seconds of optimisation".to_owned(),
        subtitle: format!("12 views, {SYNTHETIC}"),
        quality: metric("psnr"),
        palette: ["ATSplat + refinement", "3DGS", "Mip-Splatting"].map(str::to_owned).to_vec(),
        panels: [2, 3, 6, 12].map(panel).to_vec(),
        note: "Points of one curve differ in the budget of their optimisation.".to_owned(),
    }
}

pub(super) fn k_scaling() -> KScaling {
    let published =
        [(4.0, 27.63, 5e3), (8.0, 28.25, 11e3), (16.0, 28.46, 23e3), (32.0, 28.66, 46e3), (64.0, 28.73, 92e3)];
    let measured = [(4.0, 27.1), (8.0, 27.7), (16.0, 28.0), (32.0, 28.1)];
    let published = published.map(|(k, quality, gaussians)| KPoint {
        k,
        quality: Estimate::exact(quality),
        gaussians: Some(gaussians),
        origin: Origin::Published,
    });
    let measured = measured.map(|(k, quality)| KPoint {
        k,
        quality: around(quality, 0.15),
        gaussians: Some(1440.0 * k),
        origin: Origin::Measured,
    });
    KScaling {
        title: "PSNR against K".to_owned(),
        subtitle: format!("RealEstate10K, 2 views; {SYNTHETIC}"),
        quality: metric("psnr"),
        points: published.into_iter().chain(measured).collect(),
        note: String::new(),
    }
}

pub(super) fn stage_time() -> StageTime {
    let row = |label: &str, secs: [f64; 5]| StageTimeRow {
        label: label.to_owned(),
        stages: ["coarse", "anchors", "decoder", "head", "render a view"]
            .into_iter()
            .zip(secs)
            .map(|(name, secs)| (name.to_owned(), secs))
            .collect(),
        total: Some(secs.iter().sum()),
        spread: Some([0.97, 1.08].map(|share| share * secs.iter().sum::<f64>())),
        untimed: None,
    };
    let untimed = StageTimeRow {
        label: "imported: DepthSplat".to_owned(),
        stages: Vec::new(),
        total: None,
        spread: None,
        untimed: Some("no timing pass was made: `atsplat run --timing` makes one".to_owned()),
    };
    StageTime {
        title: "Where the time goes until the first image".to_owned(),
        subtitle: format!("2 threads; {SYNTHETIC}"),
        rows: vec![
            row("ATSplat", [0.031, 0.36, 0.12, 0.055, 0.21]),
            row("warp", [0.031, 0.004, 0.0, 0.022, 0.21]),
            row("nearest view", [0.03, 0.0001, 0.0, 0.001, 0.2]),
            untimed,
        ],
    }
}

pub(super) fn effect_costs() -> EffectCosts {
    let row =
        |effect: &str, needed_by, millis| EffectCostRow { effect: effect.to_owned(), needed_by, scenes: 8, millis };
    EffectCosts {
        title: "What each effect costs".to_owned(),
        subtitle: SYNTHETIC.replace("data of", "data, frames of"),
        rows: vec![
            row("soft shadows", 8, Some([4.0, 6.5, 9.0])),
            row("reflection", 7, Some([2.0, 2.5, 4.5])),
            row("vignetting", 3, None),
            row("motion blur", 0, None),
        ],
        note: "All effects take 1.1 times as long.".to_owned(),
    }
}
