//! Every plot from synthetic data, for tests and for `examples/gallery.rs`, which includes this file. No number here is a
//! result.

mod images;
mod odd;

use atsplat_metrics::definition;
use atsplat_results::tradeoff::Standing;
use images::{contact_sheet, strips, token_expansion, uncertainty};
pub(crate) use odd::odd_gallery;

use crate::plot::{
    Ablation, AblationRow, BudgetHistogram, BudgetSeries, CostAxis, Drawing, DriftHistory, DriftRun, EffectCostRow,
    EffectCosts, Estimate, EstimatePoint, EstimatorPanel, EstimatorScatter, ExtrapolationDecay, ExtrapolationSeries,
    Frontier, FrontierPoint, Frontiers, HistogramPanel, Histograms, KPoint, KScaling, LearningCurve,
    OptimisationCurves, OptimisationPanel, OptimisationPoint, Origin, OverlapBin, OverlapBinMeans, OverlapBinSeries,
    OverlapCurves, OverlapHistogram, OverlapSeries, QualityMetric, ScatterPanel, ScatterPoint, SceneScatter, StageTime,
    StageTimeRow, StressError, StressErrors,
};

const SYNTHETIC: &str = "synthetic data of 8 scenes";

/// Every plot by name.
pub(crate) fn gallery() -> Vec<(&'static str, Drawing)> {
    vec![
        ("frontiers", frontiers().draw()),
        ("optimisation", optimisation().draw()),
        ("frontier-gaussians", frontier(CostAxis::Gaussians).draw()),
        ("frontier-seconds", frontier(CostAxis::Seconds).draw()),
        ("overlap-curves", overlap_curves().draw()),
        ("overlap-bins", overlap_bins().draw()),
        ("extrapolation", extrapolation().draw()),
        ("ablation", ablation().draw()),
        ("dynamic-budget", budget_histogram().draw()),
        ("k-scaling", k_scaling().draw()),
        ("scatter", scatter().draw()),
        ("drift-history", drift_history().draw()),
        ("stage-time", stage_time().draw()),
        ("token-expansion", token_expansion().draw()),
        ("expansion-strips", strips().draw()),
        ("uncertainty", uncertainty().draw()),
        ("effect-costs", effect_costs().draw()),
        ("estimators", estimators().draw()),
        ("histograms", histograms().draw()),
        ("overlap-histogram", overlap_histogram()),
        ("learning-curve", learning_curve()),
        ("contact-sheet", contact_sheet().draw()),
        ("stress", stress()),
    ]
}

fn metric(id: &str) -> QualityMetric {
    definition(id).unwrap().into()
}

/// A pseudo-random number in [0, 1), the same on every platform.
fn noise(seed: usize) -> f64 {
    let mixed = (seed as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((mixed ^ (mixed >> 29)) >> 40) as f64 / (1u64 << 24) as f64
}

fn around(value: f64, half: f64) -> Estimate {
    Estimate { value, interval: Some([value - half, value + half]) }
}

fn effect_costs() -> EffectCosts {
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

fn optimisation() -> OptimisationCurves {
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

fn frontier(cost: CostAxis) -> Frontier {
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
        CostAxis::Gaussians => gaussians,
        CostAxis::Seconds => secs,
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
        spread: (cost == CostAxis::Seconds).then_some([0.9 * secs, 1.15 * secs]),
        quality: around(quality, 0.4),
        origin: Origin::Measured,
        standing: None,
        ranked: true,
        highlighted: label == "K = 16",
    });
    let what = if cost == CostAxis::Gaussians { "Gaussians" } else { "time" };
    Frontier {
        title: format!("Accuracy against {what}"),
        subtitle: format!("RealEstate10K, 2 views, 256×256; {SYNTHETIC}"),
        cost,
        quality: metric("psnr"),
        points: published.into_iter().chain(measured).collect(),
        note: String::new(),
    }
}

fn frontiers() -> Frontiers {
    let standing = |at: usize| [Standing::Frontier, Standing::Worse, Standing::NotDistinguishable][at % 3];
    let panel = |cost| {
        let mut points: Vec<FrontierPoint> =
            frontier(cost).points.into_iter().filter(|point| point.origin == Origin::Measured).collect();
        points.iter_mut().enumerate().for_each(|(at, point)| point.standing = Some(standing(at)));
        (cost, points)
    };
    Frontiers {
        title: "PSNR against time to the first image and against Gaussians".to_owned(),
        subtitle: format!(
            "RealEstate10K, 2 views, 256×256; {SYNTHETIC}; timed on a machine with a long name, 2 threads on 2 logical processors"
        ),
        quality: metric("psnr"),
        panels: vec![panel(CostAxis::Seconds), panel(CostAxis::Gaussians)],
        note: "Frontier against time: K = 4, then warp. Bold: on the frontier; ?: not distinguishable from it."
            .to_owned(),
    }
}

fn overlap_curves() -> OverlapCurves {
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
        step: 0.062,
        series: vec![
            series("ATSplat", 22.6, 9.0),
            series("imported: DepthSplat", 21.1, 9.8),
            series("nearest view", 13.9, 6.0),
            series("warp", 14.3, 8.6),
        ],
    }
}

fn overlap_bins() -> OverlapBinMeans {
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

fn extrapolation() -> ExtrapolationDecay {
    let curve = |inside: f64, decay: f64| {
        (-10..=10i32).map(move |distance| {
            let outside = f64::from(distance.abs());
            (f64::from(distance), around(inside - decay * outside.sqrt(), 0.2 + 0.05 * outside))
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

fn ablation() -> Ablation {
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

fn budget_histogram() -> BudgetHistogram {
    let series = |label: &str, middle: f64, width: f64, seed: usize| BudgetSeries {
        label: label.to_owned(),
        gaussians: (0..600)
            .map(|at| {
                let sum: f64 = (0..4).map(|part| noise(seed + at * 4 + part)).sum();
                (middle + width * (sum - 2.0)).clamp(8192.0, 65_536.0)
            })
            .collect(),
    };
    BudgetHistogram {
        title: "Gaussians per scene under thresholds".to_owned(),
        subtitle: format!("RealEstate10K, 600 scenes; {SYNTHETIC}"),
        series: vec![
            series("0.1 / 0.1 / 0.4", 13e3, 5e3, 1),
            series("0.05 / 0.05 / 0.2", 19e3, 9e3, 5000),
            series("0.01 / 0.01 / 0.04", 39e3, 14e3, 9000),
        ],
        fixed: Some(23_040.0),
    }
}

fn k_scaling() -> KScaling {
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

fn scatter() -> SceneScatter {
    let panel = |x: &str, ahead: f64, salt: usize| {
        let point = |at: usize| {
            let x = 18.0 + 14.0 * noise(at * 3 + salt);
            let ahead = 3.2 * (noise(at * 3 + salt + 1) + noise(at * 3 + salt + 2) - ahead);
            ScatterPoint { scene: format!("scene-{at:04}"), x, y: x + ahead }
        };
        let points: Vec<ScatterPoint> = (0..140).map(point).collect();
        ScatterPanel {
            x: x.to_owned(),
            difference: format!("+0.63 [+0.48, +0.79] to {x}; better in 98 of 140 scenes"),
            points,
        }
    };
    SceneScatter {
        title: "PSNR scene by scene: ATSplat against the others".to_owned(),
        subtitle: "RealEstate10K, 2 views; 140 scenes; synthetic data".to_owned(),
        quality: metric("psnr"),
        y: "ATSplat".to_owned(),
        panels: vec![
            panel("warp", 0.8, 0),
            panel("nearest view", 0.1, 7),
            panel("imported: DepthSplat", 1.2, 11),
            panel("ATSplat, no expansion", 1.0, 13),
        ],
        named: 3,
    }
}

fn overlap_histogram() -> Drawing {
    let bins = ["small", "medium", "large"].map(str::to_owned);
    let overlap = |at: usize| {
        let overlap = 0.05 + 0.85 * (noise(at * 2) + noise(at * 2 + 1)) / 2.0;
        (overlap, [0.3, 0.55, 0.8].iter().position(|edge| overlap < *edge))
    };
    let overlaps: Vec<(f64, Option<usize>)> = (0..1200).map(overlap).collect();
    let subtitle = "RealEstate10K, an index; 1200 context sets; synthetic data";
    OverlapHistogram { title: "Overlap of the context views", subtitle, overlaps: &overlaps, bins: &bins }.draw()
}

fn learning_curve() -> Drawing {
    let steps: Vec<u64> = (0..3000).collect();
    let term = |scale: f64, salt: usize| {
        let value = |at: usize| scale * (0.2 + (-(at as f64) / 700.0).exp()) * (0.7 + 0.6 * noise(at * 3 + salt));
        (0..3000).map(|at| (at % 97 != 5).then_some(value(at))).collect()
    };
    LearningCurve {
        title: "Learning curve of micro-rooms",
        subtitle: "rooms, 128×128; 3000 steps; synthetic data",
        steps: &steps,
        losses: &[
            ("mse", term(0.1, 1)),
            ("lpips", term(0.4, 2)),
            ("uncertainty", term(0.02, 3)),
            ("off", vec![Some(0.0); 3000]),
        ],
        evaluations: &[(0, 9.0), (1000, 17.5), (2000, 20.5), (2999, 21.5)].map(|(step, psnr)| (step, psnr, Some(16.5))),
    }
    .draw()
}

fn stress() -> Drawing {
    let cases: Vec<String> = ["needles", "dust", "huge", "behind"].map(str::to_owned).into();
    let renderers = [("reference", 1e-8, 1e-6), ("cpu, avx2", 2e-7, 1e-6), ("gpu, a device", 3e-7, 2e-6)];
    let error = |case: usize, (renderer, size, bound): (&'static str, f64, f64), kind: &'static str| {
        let relative = size * 10f64.powf(2.0 * noise(case * 17 + renderer.len()));
        (case, StressError { case: "", renderer, kind, relative, bound, passes: relative <= bound })
    };
    let all: Vec<(usize, StressError<'_>)> = (0..cases.len())
        .flat_map(|case| {
            renderers.map(|renderer| ["image", "gradient", "differences"].map(|kind| error(case, renderer, kind)))
        })
        .flatten()
        .collect();
    let errors: Vec<StressError<'_>> =
        all.iter().map(|(case, error)| StressError { case: &cases[*case], ..*error }).collect();
    StressErrors { errors: &errors }.draw()
}

fn estimators() -> EstimatorScatter {
    let panel = |estimator: &str, blur: f64, salt: usize| EstimatorPanel {
        estimator: estimator.to_owned(),
        points: (0..240)
            .map(|at| {
                let truth = noise(at * 5 + salt);
                let estimate = (truth + blur * (noise(at * 5 + salt + 1) - 0.4)).clamp(0.0, 1.0);
                EstimatePoint { kind: at % 2, truth, estimate }
            })
            .collect(),
        rank_correlations: vec![Some(1.0 - blur), None],
    };
    EstimatorScatter {
        title: "Estimated overlap against the truth".to_owned(),
        subtitle: format!("720 pairs of views; {SYNTHETIC}"),
        kinds: vec!["rooms".to_owned(), "yards".to_owned()],
        bins: ["small", "medium", "large"].map(str::to_owned).to_vec(),
        edges: vec![0.05, 0.3, 0.55, 0.8],
        panels: vec![
            panel("epipolar-ray", 0.6, 1),
            panel("feature-coverage", 0.3, 2),
            panel("depth-covisibility", 0.1, 3),
        ],
    }
}

fn histograms() -> Histograms {
    let panel = |measure: &str, middle: f64, salt: usize| {
        let of = |count: usize, salt: usize| (0..count).map(|at| middle * (0.5 + noise(at * 7 + salt))).collect();
        HistogramPanel { measure: measure.to_owned(), values: vec![of(300, salt), of(11, salt + 1)] }
    };
    Histograms {
        title: "How cameras move".to_owned(),
        subtitle: "300 simulated clips and 11 of RE10K; heights: share of a group's clips; synthetic data".to_owned(),
        groups: vec!["simulated".to_owned(), "real".to_owned()],
        panels: vec![
            panel("speed, units/s", 0.4, 1),
            panel("turn rate, °/s", 6.0, 2),
            panel("straightness", 0.9, 3),
            panel("baseline over 45 frames", 0.6, 4),
            panel("focal length over width", 0.48, 5),
        ],
    }
}

fn drift_history() -> DriftHistory {
    let run = |at: usize| {
        let moved = if at >= 13 { -0.09 } else { 0.0 };
        DriftRun {
            label: format!("{:07x}", (at + 3) * 7_919_317 % 0xfff_ffff),
            quality: around(27.4 + 0.012 * (noise(at) - 0.5) + moved, 0.02),
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

fn stage_time() -> StageTime {
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
