//! Sample rows for tests, also those of other crates, which contain this file as a module.

use atsplat_results::times::{Load, Machine, TimingRow};
use atsplat_results::{MetricRecord, Results, TargetRow, TargetStatus, TrialKey, TrialRow, TrialStatus};

/// The preset's name in all sample rows.
pub(crate) const PRESET: &str = "sampled";

/// Rows of scenes given as `(scene, entry, scores of its targets)` under one method and metric; frames count from 0.
pub(crate) fn results(method: &str, metric: &str, scenes: &[(&str, u32, Vec<f64>)]) -> Results {
    let mut results = Results::default();
    results.provenance.metrics.push(MetricRecord { id: metric.to_owned(), ..MetricRecord::default() });
    for (scene, entry, scores) in scenes {
        results.trials.push(trial(method, scene, *entry, scores.len()));
        let rows = scores.iter().zip(0..).map(|(score, at)| target(method, scene, *entry, at, metric, *score));
        results.targets.extend(rows);
    }
    results
}

pub(crate) fn key(method: &str, scene: &str, entry: u32) -> TrialKey {
    TrialKey { preset: PRESET.to_owned(), method: method.to_owned(), scene: scene.to_owned(), entry }
}

pub(crate) fn target(method: &str, scene: &str, entry: u32, at: u32, metric: &str, score: f64) -> TargetRow {
    TargetRow {
        key: key(method, scene, entry),
        target: at,
        frame: at.into(),
        signed_distance: 0,
        leaked: false,
        overlap: None,
        width: 8,
        height: 8,
        truth_hash: Some(format!("truth of {scene} {entry} {at}")),
        render_hash: Some(format!("{method} at {scene} {entry} {at}: {score}")),
        status: TargetStatus::Scored,
        detail: None,
        non_finite: 0,
        scores: [(metric.to_owned(), score)].into(),
        not_computed: [].into(),
    }
}

pub(crate) fn trial(method: &str, scene: &str, entry: u32, targets: usize) -> TrialRow {
    TrialRow {
        key: key(method, scene, entry),
        trial_hash: format!("trial {scene} {entry}"),
        pose_hash: format!("poses {scene} {entry}"),
        data_hash: Some(format!("data {scene} {entry}")),
        input_hash: None,
        status: TrialStatus::Done,
        detail: None,
        context: vec![0, 9],
        context_hashes: [0, 9].map(|frame| format!("truth of {scene} {entry} {frame}")).to_vec(),
        targets: targets.try_into().unwrap(),
        overlap: None,
        width: 8,
        height: 8,
        initial_tokens: Some(512),
        final_tokens: Some(1440),
        gaussians: Some(23_040),
        gaussians_drawn: Some(20_000.0),
        context_psnr: None,
        peak_bytes: Some(1 << 20),
        network_adapter: None,
        renderer_adapter: None,
        effects: vec![],
        notes: vec![],
    }
}

/// The first entry of a scene, timed on a quiet machine.
pub(crate) fn timing(method: &str, scene: &str, encode: &[f64], render: &[f64]) -> TimingRow {
    TimingRow {
        key: key(method, scene, 0),
        trial_hash: format!("trial {scene} 0"),
        machine: Machine { processor: "a processor".to_owned(), platform: "linux".to_owned(), cpus: 2, threads: 2 },
        network_adapter: None,
        renderer_adapter: None,
        started: 1,
        trials_there: 3,
        warm_up: 1,
        encode: encode.to_vec(),
        render: render.to_vec(),
        stages: [].into(),
        held_bytes: None,
        peak_bytes: Some(1 << 20),
        load: Load { others: Some(0.01), ..Load::default() },
        detail: None,
    }
}
