//! A synthetic store for tests: two protocols, three methods, a hostile scene name, a failed trial, a leaked target, LPIPS
//! without weights.

use atsplat_model::ModelConfig;
use atsplat_protocol::Preset;
use atsplat_results::times::{Load, Machine, TimingRow};
use atsplat_results::{
    MethodRecord, MetricRecord, PresetRecord, Provenance, Results, SkippedEntry, TargetRow, TargetStatus, TrialKey,
    TrialRow, TrialStatus,
};

/// A name that injects a script if it is not escaped.
pub(crate) const HOSTILE: &str = "</script><script>window.injected=1</script>\"'&|*_\\\u{1b}[31m";
/// A long name without spaces, as those of checkpoints are.
pub(crate) const UNBROKEN: &str =
    "mvsplat_re10k_finetuned_rank16_lr1e-4_steps30000_batch8_seed1_ema_checkpoint_last_final";
const OVERLAPS: [f64; 4] = [0.1, 0.3, 0.5, 0.7];
/// The hash of no known index.
pub(crate) const UNKNOWN_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000001";
pub(crate) const SCENES: [&str; 4] = ["aa11", "bb22", "cc33", HOSTILE];

pub(crate) fn preset(name: &str) -> PresetRecord {
    let preset = Preset::named(name).unwrap();
    let index = preset.index.accepted.first();
    PresetRecord {
        name: name.to_owned(),
        stands_for: preset.stands_for.clone(),
        preset: name.to_owned(),
        title: preset.title.clone(),
        hash: preset.hash().unwrap().to_string(),
        toml: preset.to_toml().unwrap(),
        dataset: "data/re10k".to_owned(),
        index: "index.json".to_owned(),
        index_sha256: index.map_or_else(|| UNKNOWN_HASH.to_owned(), |index| index.sha256.to_string()),
        index_name: index.map(|index| index.name.clone()),
        reduced_from: None,
        overlap_estimators: Vec::new(),
        entries: 4,
        entries_of_index: 7194,
        scenes_of_index: None,
        scenes_sha256: None,
    }
}

pub(crate) fn atsplat(name: &str, change: impl FnOnce(&mut ModelConfig)) -> MethodRecord {
    let mut config = ModelConfig::named("nano").unwrap();
    change(&mut config);
    let mut record = MethodRecord {
        name: name.to_owned(),
        kind: "atsplat".to_owned(),
        title: "ATSplat".to_owned(),
        weights_sha256: Some("0123456789abcdef0123456789abcdef".to_owned()),
        constants: Some("gsplat".to_owned()),
        backend: Some("cpu".to_owned()),
        deterministic: true,
        ..MethodRecord::default()
    };
    record.record_configuration(serde_json::to_value(&config).unwrap());
    record
}

pub(crate) fn nearest_view() -> MethodRecord {
    MethodRecord {
        name: "nearest-view".to_owned(),
        kind: "nearest-view".to_owned(),
        title: "Nearest view".to_owned(),
        deterministic: true,
        ..MethodRecord::default()
    }
}

/// Rows of every method on every scene; quality falls with the positions of scene and method.
pub(crate) fn results(presets: Vec<PresetRecord>, methods: Vec<MethodRecord>) -> Results {
    results_over(presets, methods, SCENES.len())
}

/// Like [`results`], with more scenes: fewer than six have no intervals.
pub(crate) fn results_over(presets: Vec<PresetRecord>, methods: Vec<MethodRecord>, count: usize) -> Results {
    let more = (SCENES.len()..count).map(|at| format!("scene {at}"));
    let scenes: Vec<String> = SCENES.map(str::to_owned).into_iter().chain(more).collect();
    let mut results = Results {
        provenance: Provenance {
            schema_version: 2,
            schema_hash: "5c4e".to_owned(),
            atsplat: "0.1.0".to_owned(),
            commit: Some("0011223344556677".to_owned()),
            platform: "linux x86_64".to_owned(),
            processor: "a processor".to_owned(),
            threads: 2,
            command: ["atsplat", "run"].map(str::to_owned).to_vec(),
            metrics: vec![
                metric("psnr"),
                metric("ssim"),
                MetricRecord { absent: Some(ABSENT.to_owned()), ..metric("lpips") },
            ],
            skipped: vec![SkippedEntry {
                preset: "re10k-2v-256".to_owned(),
                scene: "dd44".to_owned(),
                reason: "missing-frame".to_owned(),
                detail: "frame 7 is absent".to_owned(),
                ..SkippedEntry::default()
            }],
            presets,
            methods,
            ..Provenance::default()
        },
        ..Results::default()
    };
    for preset in results.provenance.presets.clone() {
        let views = preset.protocol().map_or(2, |protocol| protocol.index.context_views);
        for (place, method) in results.provenance.methods.clone().iter().enumerate() {
            for (at, scene) in scenes.iter().enumerate() {
                let (preset, method_name) = (preset.name.clone(), method.name.clone());
                let key = TrialKey { preset, method: method_name, scene: scene.clone(), entry: 0 };
                let failed = place == 1 && at == 2;
                results.trials.push(trial((&key, views), failed, method.kind == "atsplat", at));
                if at < 3 && !failed {
                    results.timings.push(timing(&key, method.kind == "atsplat", at));
                }
                results.targets.extend((0..3).map(|target| view(&key, target, place, at, failed)));
            }
        }
    }
    results
}

const ABSENT: &str = "weights absent: torchvision's vgg16 is neither in the hub cache nor given by --lpips-vgg";

fn metric(id: &str) -> MetricRecord {
    MetricRecord { id: id.to_owned(), ..MetricRecord::default() }
}

fn trial((key, views): (&TrialKey, usize), failed: bool, tokens: bool, at: usize) -> TrialRow {
    let count = |count: u64| tokens.then_some(count);
    TrialRow {
        key: key.clone(),
        trial_hash: format!("trial {at}"),
        pose_hash: format!("poses {at}"),
        data_hash: Some(format!("data {at}")),
        input_hash: None,
        status: if failed { TrialStatus::Failed } else { TrialStatus::Done },
        detail: failed.then(|| "the network said NaN".to_owned()),
        context_hashes: Vec::new(),
        context: (0..views as u64).map(|view| 30 * view).collect(),
        targets: 3,
        overlap: Some(OVERLAPS[at % OVERLAPS.len()]),
        width: 16,
        height: 16,
        initial_tokens: count(512),
        final_tokens: count(1440),
        gaussians: count(23_040),
        gaussians_drawn: None,
        context_psnr: None,
        peak_bytes: None,
        network_adapter: None,
        renderer_adapter: None,
        effects: Vec::new(),
        notes: Vec::new(),
    }
}

fn timing(key: &TrialKey, encodes: bool, at: usize) -> TimingRow {
    let secs = 0.25 + 0.01 * at as f64;
    let each = |share: f64| [-0.002, 0.0, 0.001, -0.001, 0.002].map(|noise| share * (secs + noise)).to_vec();
    let stages = [("coarse".to_owned(), each(0.8)), ("decoder".to_owned(), each(0.2))];
    TimingRow {
        key: key.clone(),
        trial_hash: format!("trial {at}"),
        machine: Machine {
            processor: "a processor".to_owned(),
            platform: "linux x86_64".to_owned(),
            cpus: 2,
            threads: 2,
        },
        network_adapter: None,
        renderer_adapter: None,
        started: 1_700_000_000,
        trials_there: 4,
        warm_up: 1,
        encode: if encodes { each(1.0) } else { Vec::new() },
        render: vec![0.005; 5],
        stages: if encodes { stages.into() } else { [].into() },
        held_bytes: Some(100 << 20),
        peak_bytes: Some(160 << 20),
        load: Load { average_before: Some(0.1), others: Some(0.01), ..Load::default() },
        detail: None,
    }
}

fn view(key: &TrialKey, target: u32, place: usize, at: usize, failed: bool) -> TargetRow {
    let offset = f64::from(target) * 0.25;
    let psnr = 27.0 - 2.0 * at as f64 - 3.0 * place as f64 + offset;
    let leaked = target == 2 && at == 0;
    TargetRow {
        key: key.clone(),
        target,
        frame: u64::from(target) * 10 + 5,
        signed_distance: i64::from(target) - 1,
        leaked,
        overlap: Some(OVERLAPS[at % OVERLAPS.len()]),
        width: 16,
        height: 16,
        truth_hash: None,
        render_hash: None,
        status: if failed { TargetStatus::Failed } else { TargetStatus::Scored },
        detail: None,
        non_finite: 0,
        scores: if failed { [].into() } else { [("psnr".to_owned(), psnr), ("ssim".to_owned(), psnr / 32.0)].into() },
        not_computed: if failed { [].into() } else { [("lpips".to_owned(), ABSENT.to_owned())].into() },
    }
}

/// The store of most tests.
pub(crate) fn store() -> Results {
    results(
        vec![preset("re10k-2v-256"), preset("re10k-overlap")],
        vec![atsplat("atsplat", |_| ()), random(), nearest_view()],
    )
}

/// Random selection, as an ablation.
pub(crate) fn random() -> MethodRecord {
    let record = atsplat("atsplat-random", |config| {
        config.expansion.selection = atsplat_model::config::Selection::Random { seed: 1 }
    });
    MethodRecord { title: "ATSplat, random".to_owned(), ..record }
}
