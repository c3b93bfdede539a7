//! The plots of many single values.

use super::{SYNTHETIC, metric, noise};
use crate::plot::{
    BudgetHistogram, BudgetSeries, Drawing, EstimatePoint, EstimatorPanel, EstimatorScatter, HistogramPanel,
    Histograms, LearningCurve, OverlapHistogram, ScatterPanel, ScatterPoint, SceneScatter, StressError, StressErrors,
};

pub(super) fn budget_histogram() -> BudgetHistogram {
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
        fixed: vec![23_040.0],
    }
}

pub(super) fn scatter() -> SceneScatter {
    let panel = |x: &str, ahead: f64, salt: usize| {
        let point = |at: usize| {
            let x = 18.0 + 14.0 * noise(at * 3 + salt);
            let ahead = 3.2 * (noise(at * 3 + salt + 1) + noise(at * 3 + salt + 2) - ahead);
            ScatterPoint { scene: format!("scene-{at:04}"), x, y: x + ahead }
        };
        let points: Vec<ScatterPoint> = (0..140).map(point).collect();
        ScatterPanel {
            x: x.to_owned(),
            difference: format!("+0.63 [+0.48, +0.79] against {x}; better in 98 of 140 scenes"),
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

pub(super) fn overlap_histogram() -> Drawing {
    let bins = ["small", "medium", "large"].map(str::to_owned);
    let overlap = |at: usize| {
        let overlap = 0.05 + 0.85 * (noise(at * 2) + noise(at * 2 + 1)) / 2.0;
        (overlap, [0.3, 0.55, 0.8].iter().position(|edge| overlap < *edge))
    };
    let overlaps: Vec<(f64, Option<usize>)> = (0..1200).map(overlap).collect();
    let subtitle = "RealEstate10K, an index; 1200 context sets; synthetic data";
    OverlapHistogram { title: "Overlap of the context views", subtitle, overlaps: &overlaps, bins: &bins }.draw()
}

pub(super) fn histograms() -> Histograms {
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

pub(super) fn estimators() -> EstimatorScatter {
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

pub(super) fn learning_curve() -> Drawing {
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

pub(super) fn stress() -> Drawing {
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
