//! Which data the rows were computed from.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use crate::{
    MethodRecord, MetricRecord, Provenance, RecordKind, Results, ResultsError, SkippedEntry, TargetRow, TrialId,
    TrialKey, TrialRow, TrialStatus,
};

/// The results of a store: for each trial, the inputs of each method's result.
#[derive(Debug, Default)]
pub struct KnownResults {
    inputs: HashMap<TrialId, BTreeMap<String, Inputs>>,
}

/// Hashes of what a result was computed from.
#[derive(Debug)]
struct Inputs {
    trial: String,
    targets: u32,
    data: Option<String>,
    input: Option<String>,
    /// Whether a target lacks a metric that can be computed now.
    lacks_metric: bool,
    /// Number of targets with scores.
    scored: usize,
    /// Whether it failed, wholly or in part, or no render of it could be compared.
    is_incomplete: bool,
    /// Whether the run evaluates it again for that.
    is_retried: bool,
}

impl KnownResults {
    /// Trials with their targets, for a run that computes these metrics.
    pub(super) fn of(
        rows: impl Iterator<Item = (TrialRow, Vec<TargetRow>)>,
        methods: &[MethodRecord],
        metrics: &[MetricRecord],
    ) -> Self {
        let python = methods.iter().filter(|method| method.record_kind() == RecordKind::Python);
        let python: BTreeSet<&str> = python.map(|method| method.name.as_str()).collect();
        let mut known = Self::default();
        for (row, rows_of_targets) in rows {
            let TrialRow { key, trial_hash, targets, data_hash, input_hash, status, .. } = row;
            let lacks_metric = rows_of_targets.iter().any(|target| metrics.iter().any(|metric| target.lacks(metric)));
            let scored = rows_of_targets.iter().filter(|target| target.status.is_scored()).count();
            let is_incomplete = status.is_incomplete() || (status == TrialStatus::Done && scored == 0);
            // Nothing says whether the reason for which a method of Python failed is still there.
            let is_retried = is_incomplete && python.contains(key.method.as_str());
            let by_method = known.inputs.entry(key.trial()).or_default();
            let (trial, data, input) = (trial_hash, data_hash, input_hash);
            by_method.insert(
                key.method,
                Inputs { trial, targets, data, input, lacks_metric, scored, is_incomplete, is_retried },
            );
        }
        known
    }

    fn get(&self, key: &TrialKey) -> Option<&Inputs> {
        self.inputs.get(&key.trial())?.get(&key.method)
    }

    /// Whether there is a result for exactly this trial, data and input files.
    pub fn contains(&self, key: &TrialKey, trial: &str, data: &str, input: Option<&str>) -> bool {
        let same = |known: &Inputs| {
            known.trial == trial && known.data.as_deref() == Some(data) && known.input.as_deref() == input
        };
        self.get(key).is_some_and(same)
    }

    /// Whether a result lacks a metric that the run computes: it was made without it, or without its weights.
    pub fn lacks_metric(&self, key: &TrialKey) -> bool {
        self.get(key).is_some_and(|known| known.lacks_metric)
    }

    /// Makes a run evaluate again what failed, wholly or in part.
    pub(super) fn retry_failed(&mut self) {
        let all = self.inputs.values_mut().flat_map(BTreeMap::values_mut);
        all.for_each(|known| known.is_retried = known.is_incomplete);
    }

    /// Whether a result failed, wholly or in part, and is evaluated again: one of a method of Python always, others on request
    /// ([`Store::retry_failed`](super::Store::retry_failed)).
    pub fn is_retried(&self, key: &TrialKey) -> bool {
        self.get(key).is_some_and(|known| known.is_retried)
    }

    /// How many results of a run's protocols and methods lack a metric that it computes, by method: they are evaluated again.
    pub fn lacking(&self, run: &Provenance) -> BTreeMap<&str, u64> {
        self.count(run, |known| known.lacks_metric)
    }

    /// How many results of a run's protocols and methods failed and are evaluated again, by method.
    pub fn retried(&self, run: &Provenance) -> BTreeMap<&str, u64> {
        self.count(run, |known| known.is_retried)
    }

    fn count(&self, run: &Provenance, is_counted: impl Fn(&Inputs) -> bool) -> BTreeMap<&str, u64> {
        let of_run = self.inputs.iter().filter(|(trial, _)| run.preset(&trial.preset).is_some());
        let mut counts = BTreeMap::new();
        for (method, known) in of_run.flat_map(|(_, methods)| methods) {
            if is_counted(known) && run.method(method).is_some() {
                *counts.entry(method.as_str()).or_default() += 1;
            }
        }
        counts
    }

    /// How many targets of a result have scores.
    pub fn scored(&self, key: &TrialKey) -> usize {
        self.get(key).map_or(0, |known| known.scored)
    }

    /// Whether a result with scores was made from other imported files.
    pub fn has_other_files(&self, key: &TrialKey, input: Option<&str>) -> bool {
        self.get(key).is_some_and(|known| known.scored > 0 && known.input.as_deref() != input)
    }

    /// Scenes with results under a preset.
    pub fn scenes(&self, preset: &str) -> BTreeSet<&str> {
        let of_preset = self.inputs.keys().filter(|trial| trial.preset == preset);
        of_preset.map(|trial| trial.scene.as_str()).collect()
    }

    /// How many entries of a preset have a result of any method, or a reason why there is none.
    pub(super) fn entries_of(&self, preset: &str, skipped: &[SkippedEntry]) -> u64 {
        let of_preset = self.inputs.iter().filter(|(trial, methods)| trial.preset == preset && !methods.is_empty());
        let mut entries: BTreeSet<(&str, u32)> =
            of_preset.map(|(trial, _)| (trial.scene.as_str(), trial.entry)).collect();
        let skipped = skipped.iter().filter(|skipped| skipped.preset == preset);
        entries.extend(skipped.map(|skipped| (skipped.scene.as_str(), skipped.entry)));
        entries.len() as u64
    }

    /// Whether there is a result of a method under a preset.
    pub(super) fn has(&self, preset: &str, method: &str) -> bool {
        self.inputs.iter().any(|(trial, methods)| trial.preset == preset && methods.contains_key(method))
    }

    /// Drops the results of these methods.
    pub(super) fn forget(&mut self, methods: &BTreeSet<String>) {
        self.inputs.values_mut().for_each(|by_method| by_method.retain(|name, _| !methods.contains(name)));
    }

    /// The hash of the trial that a method's result belongs to, and its number of targets.
    pub fn trial(&self, key: &TrialKey) -> Option<(&str, u32)> {
        self.get(key).map(|known| (known.trial.as_str(), known.targets))
    }

    /// Methods with a result for a trial.
    pub fn methods(&self, trial: &TrialId) -> impl Iterator<Item = &str> {
        self.inputs.get(trial).into_iter().flatten().map(|(method, _)| method.as_str())
    }

    /// Methods whose result for a trial was computed from other data.
    pub fn outdated(&self, trial: &TrialId, data_hash: &str) -> impl Iterator<Item = &str> {
        let methods = self.inputs.get(trial).into_iter().flatten();
        methods.filter(move |(_, known)| known.data.as_deref() != Some(data_hash)).map(|(name, _)| name.as_str())
    }
}

/// Rejects rows of one trial that were computed from different data.
pub(super) fn check_consistent(results: &Results) -> Result<(), ResultsError> {
    let mut data: HashMap<(&str, &str, u32), (&TrialKey, &str)> = HashMap::new();
    for TrialRow { key, data_hash, .. } in &results.trials {
        let Some(hash) = data_hash else { continue };
        let (first, known) = *data.entry((&key.preset, &key.scene, key.entry)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("images or cameras", first, key));
        }
    }
    // Rows of older schema versions only record the ground-truth images.
    let mut truths: HashMap<(&str, &str, u32, u32), (&TrialKey, &str)> = HashMap::new();
    for row in &results.targets {
        let (key, Some(hash)) = (&row.key, &row.truth_hash) else { continue };
        let (first, known) = *truths.entry((&key.preset, &key.scene, key.entry, row.target)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("ground-truth images", first, key));
        }
    }
    Ok(())
}

fn mixed(what: &'static str, first: &TrialKey, second: &TrialKey) -> ResultsError {
    ResultsError::MixedData { what, first: first.to_string(), second: second.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PresetRecord, TargetStatus, WEIGHTS_ABSENT, sample_rows};

    /// A method of Python may have been mended; what another method failed fails again.
    #[test]
    fn failures_of_python_are_retried() {
        let of_targets = |kind: &str, status, of_target| {
            let method = MethodRecord { name: "m".to_owned(), kind: kind.to_owned(), ..MethodRecord::default() };
            let row = TrialRow { status, data_hash: Some("d".to_owned()), ..sample_rows::trial("m", "a", 0, 1) };
            let (key, hash) = (row.key.clone(), row.trial_hash.clone());
            let target = sample_rows::target("m", "a", 0, 0, "psnr", 20.0);
            let rows = [(row, vec![TargetRow { status: of_target, ..target }])];
            let known = KnownResults::of(rows.into_iter(), &[method], &[]);
            assert!(known.contains(&key, &hash, "d", None), "its row is there");
            known.is_retried(&key)
        };
        let of = |kind: &str, status| of_targets(kind, status, TargetStatus::Scored);
        assert!(of_targets("python", TrialStatus::Done, TargetStatus::NonFinite), "nothing could be compared");
        assert!(of("python", TrialStatus::Failed) && of("python", TrialStatus::Partial));
        assert!(!of("python", TrialStatus::Done) && !of("python", TrialStatus::NotApplicable));
        assert!(!of("exec", TrialStatus::Failed));
    }

    /// One of four results is whole, and nothing of the last could be compared; a method that does not support a trial has not failed.
    #[test]
    fn failures_are_retried_on_request() {
        let of_trials = [
            ("a", TrialStatus::Failed, TargetStatus::Failed),
            ("b", TrialStatus::Done, TargetStatus::Scored),
            ("c", TrialStatus::Partial, TargetStatus::Scored),
            ("d", TrialStatus::NotApplicable, TargetStatus::Failed),
            ("e", TrialStatus::Done, TargetStatus::NonFinite),
        ];
        let rows = of_trials.map(|(scene, status, of_target)| {
            let target = sample_rows::target("m", scene, 0, 0, "psnr", 20.0);
            let trial = TrialRow { status, ..sample_rows::trial("m", scene, 0, 1) };
            (trial, vec![TargetRow { status: of_target, ..target }])
        });
        let mut known = KnownResults::of(rows.into_iter(), &[], &[]);
        let run = Provenance {
            presets: vec![PresetRecord { name: sample_rows::PRESET.to_owned(), ..PresetRecord::default() }],
            methods: vec![MethodRecord { name: "m".to_owned(), ..MethodRecord::default() }],
            ..Provenance::default()
        };
        assert!(known.retried(&run).is_empty());
        known.retry_failed();
        assert_eq!(known.retried(&run), BTreeMap::from([("m", 3)]));
        let again = of_trials.map(|(scene, ..)| known.is_retried(&sample_rows::key("m", scene, 0)));
        assert_eq!(again, [true, false, true, false, true]);
    }

    /// Of two methods, one is run again, under one of two protocols.
    #[test]
    fn results_that_lack_a_metric_are_counted_for_a_run() {
        let rows = ["a", "b", "c"].map(|scene| {
            let scores = if scene == "c" { &["psnr", "l1"][..] } else { &["psnr"] };
            let scores = scores.iter().map(|id| ((*id).to_owned(), 0.5)).collect();
            let target = TargetRow { scores, ..sample_rows::target("m", scene, 0, 0, "psnr", 0.5) };
            (sample_rows::trial("m", scene, 0, 1), vec![target])
        });
        let metrics = ["psnr", "l1"].map(|id| MetricRecord { id: id.to_owned(), ..MetricRecord::default() });
        let known = KnownResults::of(rows.into_iter(), &[], &metrics);
        let lacking = |preset: &str, method: &str| {
            let preset = PresetRecord { name: preset.to_owned(), ..PresetRecord::default() };
            let method = MethodRecord { name: method.to_owned(), ..MethodRecord::default() };
            let run = Provenance { presets: vec![preset], methods: vec![method], ..Provenance::default() };
            known.lacking(&run).into_iter().map(|(name, count)| (name.to_owned(), count)).collect::<Vec<_>>()
        };
        assert_eq!(lacking(sample_rows::PRESET, "m"), [("m".to_owned(), 2)]);
        assert_eq!([lacking("another", "m"), lacking(sample_rows::PRESET, "n")], [vec![], vec![]]);
        assert_eq!(known.scenes(sample_rows::PRESET), BTreeSet::from(["a", "b", "c"]));
        let key = sample_rows::key("m", "a", 0);
        assert_eq!(
            (known.scored(&key), known.has_other_files(&key, None), known.has_other_files(&key, Some("f"))),
            (1, false, true)
        );
    }

    #[test]
    fn results_made_without_a_metric_or_its_weights_lack_it() {
        let metric = |id: &str, absent: bool| {
            let absent = absent.then(|| "weights absent: LPIPS (VGG) needs a file".to_owned());
            MetricRecord { id: id.to_owned(), absent, ..MetricRecord::default() }
        };
        let lacks = |status: TargetStatus, why: Option<&str>, metrics: &[MetricRecord]| {
            let computed = sample_rows::target("m", "a", 0, 0, "psnr", 20.0);
            let not_computed = why.map(|why| ("lpips".to_owned(), why.to_owned())).into_iter().collect();
            let scores = if status == TargetStatus::Scored { computed.scores.clone() } else { BTreeMap::new() };
            let target = TargetRow { status, scores, not_computed, ..computed };
            let row = sample_rows::trial("m", "a", 0, 1);
            let key = row.key.clone();
            KnownResults::of([(row, vec![target])].into_iter(), &[], metrics).lacks_metric(&key)
        };
        let (now, absent) = ([metric("psnr", false), metric("lpips", false)], [metric("lpips", true)]);
        let scored = |why, metrics: &[MetricRecord]| lacks(TargetStatus::Scored, why, metrics);
        assert!(scored(None, &now) && scored(Some(WEIGHTS_ABSENT), &now));
        assert!(!scored(Some("too small"), &now) && !scored(None, &now[..1]), "there is a reason, or it is there");
        assert!(!scored(None, &absent) && !scored(Some(WEIGHTS_ABSENT), &absent), "it cannot be computed now either");
        assert!(!lacks(TargetStatus::Failed, None, &now) && lacks(TargetStatus::NonFinite, None, &now));
    }
}
