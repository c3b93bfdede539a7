use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_files::{AtomicFile, Sha256Digest};
use atsplat_results::times::platform;
use atsplat_results::{Provenance, Results, TargetRow, TargetStatus, TrialKey, TrialRow, TrialStatus};
use atsplat_splat::cpu::processor;
use serde::{Deserialize, Serialize};

use super::agreement::require_agreement;
use super::data::{images_of, images_of_targets};
use super::limits::limits;
use super::probe::{Fingerprint, Inputs, Outputs, Pipeline, Recipe, run as run_probe};
use super::{Acceptance, AcceptedNumber, DriftError, ImageDigest, Limit, compare, history, same_machine};

/// The format version that is written.
const FORMAT: u32 = 3;
/// The first version that lists images; older ones only have those of their targets.
const WITH_IMAGES: u32 = 3;
/// The first version with the numbers of earlier acceptances.
const WITH_NUMBERS: u32 = 2;
/// The oldest version that can be read.
const OLDEST: u32 = 1;

/// The accepted numbers of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Baseline {
    /// The acceptances, oldest first.
    pub history: Vec<Acceptance>,
    /// The means of every acceptance that recorded them, oldest first.
    pub numbers: Vec<AcceptedNumber>,
    /// The provenance of the accepted run.
    pub provenance: Provenance,
    /// How far the means of non-deterministic methods may change.
    pub limits: Vec<Limit>,
    /// The probe's outputs; `None` if no probe was run.
    pub probe: Option<ProbeRecord>,
    /// All images of the trials, ordered and without duplicates.
    pub images: Vec<ImageDigest>,
    /// Trials ordered by key.
    pub trials: Vec<BaselineTrial>,
    /// Targets ordered by key.
    pub targets: Vec<BaselineTarget>,
}

/// A probe's outputs in human-readable numbers; the values are in a separate file next to the baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ProbeRecord {
    /// The probe's settings.
    pub recipe: Recipe,
    /// Fingerprints of the stages' outputs.
    pub stages: Vec<Fingerprint>,
    /// The mean over the probe's targets of each score.
    pub scores: BTreeMap<String, f64>,
    /// SHA-256 of the file of values; `None` in a baseline that was accepted when only fingerprints were recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Operating system and architecture that it was run on, which need not be those of the rows; `None` in a baseline of an older
    /// version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub platform: Option<String>,
    /// The processor that it was run on, as [`Provenance::processor`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub processor: Option<String>,
}

/// The fields of a trial that are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaselineTrial {
    /// Preset, method, scene and entry.
    #[serde(flatten)]
    pub key: TrialKey,
    /// Same as [`TrialRow::trial_hash`].
    pub trial_hash: String,
    /// Same as [`TrialRow::status`].
    pub status: TrialStatus,
    /// Same as [`TrialRow::final_tokens`].
    pub final_tokens: Option<u64>,
    /// Same as [`TrialRow::gaussians`].
    pub gaussians: Option<u64>,
    /// Same as [`TrialRow::context`]; `None` in a baseline of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub context: Option<Vec<u64>>,
    /// Same as [`TrialRow::data_hash`]; `None` in a baseline of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_hash: Option<String>,
}

/// The fields of a target that are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BaselineTarget {
    /// Trial that the target belongs to.
    #[serde(flatten)]
    pub key: TrialKey,
    /// Same as [`TargetRow::target`].
    pub target: u32,
    /// Same as [`TargetRow::frame`].
    pub frame: u64,
    /// Same as [`TargetRow::status`].
    pub status: TargetStatus,
    /// Same as [`TargetRow::truth_hash`].
    pub truth_hash: Option<String>,
    /// Same as [`TargetRow::render_hash`]; kept for deterministic methods only.
    pub render_hash: Option<String>,
    /// Same as [`TargetRow::scores`], to the last bit.
    pub scores: BTreeMap<String, f64>,
    /// What tables group the target by; `None` in a baseline of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grouping: Option<TargetGrouping>,
}

/// The fields of a target that tables group or leave out targets by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetGrouping {
    /// Same as [`TargetRow::leaked`].
    pub leaked: bool,
    /// Same as [`TargetRow::signed_distance`].
    pub signed_distance: i64,
    /// Same as [`TargetRow::overlap`].
    pub overlap: Option<f64>,
}

/// The JSON file.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct BaselineFile {
    format: u32,
    history: Vec<Acceptance>,
    provenance: Provenance,
    limits: Vec<Limit>,
    probe: Option<ProbeRecord>,
    #[serde(default)]
    numbers: Vec<AcceptedNumber>,
    #[serde(default, alias = "pictures")]
    images: Vec<ImageDigest>,
    trials: Vec<BaselineTrial>,
    targets: Vec<BaselineTarget>,
}

/// The field of a [`BaselineFile`] that says how to read the others.
#[derive(Deserialize)]
struct FormatOfFile {
    format: u32,
}

impl Baseline {
    /// The baseline of a run. `repeats` are reruns of the same plan, which determine the limits of non-deterministic methods.
    pub fn new(results: &Results, repeats: &[Results], acceptance: Acceptance) -> Self {
        let runs: Vec<&Results> = std::iter::once(results).chain(repeats).collect();
        let mut provenance = results.provenance.clone();
        // Time, command and threads do not affect numbers and would change with every acceptance.
        (provenance.started, provenance.threads) = (0, 0);
        provenance.command.clear();
        provenance.more_commands.clear();
        let deterministic =
            |key: &TrialKey| results.provenance.method(&key.method).is_some_and(|method| method.deterministic);
        let target = |row: &TargetRow| BaselineTarget {
            render_hash: row.render_hash.clone().filter(|_| deterministic(&row.key)),
            ..BaselineTarget::from(row)
        };
        let mut trials: Vec<BaselineTrial> = results.trials.iter().map(BaselineTrial::from).collect();
        let mut targets: Vec<BaselineTarget> = results.targets.iter().map(target).collect();
        trials.sort_by(|a, b| a.key.cmp(&b.key));
        targets.sort_by(|a, b| (&a.key, a.target).cmp(&(&b.key, b.target)));
        let (history, limits, images) = (vec![acceptance], limits(&runs), images_of(results));
        let numbers = Vec::new();
        Self { history, numbers, provenance, limits, probe: None, images, trials, targets }.with_numbers_of_rows()
    }

    /// Accepts another run: its baseline with this one's history continued. Limits that were stated, or estimated from repeated runs,
    /// stay unless `repeats` show others.
    #[must_use]
    pub fn accept(&self, results: &Results, repeats: &[Results], acceptance: Acceptance) -> Self {
        let mut next = Self::new(results, repeats, acceptance);
        if repeats.is_empty() {
            Limit::keep(&mut next.limits, &self.limits);
        }
        next.history = self.history.iter().cloned().chain(next.history).collect();
        let accepted = history::numbers_of_rows(&next, Some(&compare(results, self)));
        next.numbers = self.numbers.iter().cloned().chain(accepted).collect();
        next
    }

    /// Replaces the limits of a metric for all methods that are not deterministic, and those of the accepted numbers; numbers of the
    /// others are compared bit by bit.
    ///
    /// # Errors
    /// [`DriftError::Invalid`] if no such method has a score of the metric, and for a limit that is not positive and finite.
    pub fn with_limit(mut self, metric: &str, limit: f64) -> Result<Self, DriftError> {
        let is_valid = limit > 0.0 && limit.is_finite();
        if !is_valid {
            return Err(DriftError::invalid("limit", format!("a positive change of {metric}"), limit));
        }
        if Limit::state(&mut self.limits, metric, limit) {
            let last = self.history.len().saturating_sub(1);
            let is_limited = |number: &&mut AcceptedNumber| {
                number.acceptance == last && number.metric == metric && number.limit.is_some()
            };
            for number in self.numbers.iter_mut().filter(is_limited) {
                number.limit = Some(limit);
            }
            return Ok(self);
        }
        let known: BTreeSet<&str> = self.limits.iter().map(|limit| limit.metric.as_str()).collect();
        let known: Vec<&str> = known.into_iter().collect();
        let (expected, found) = match known.as_slice() {
            [] => ("a method that is not deterministic".to_owned(), "none"),
            known => (format!("a metric with a limit: one of {}", known.join(", ")), metric),
        };
        Err(DriftError::Invalid { what: "limit", expected, found: found.to_owned() })
    }

    /// Runs a probe on this machine and adds it, as [`Self::with_probe`] does.
    ///
    /// # Errors
    /// [`DriftError::Invalid`] for an unknown name in the recipe, [`DriftError::Stage`].
    pub fn probed(self, recipe: Recipe) -> Result<(Self, Vec<u8>), DriftError> {
        let stages = Pipeline::of(&recipe)?;
        let outputs = run_probe(&stages, &Inputs::pattern(&stages.options.constants)?)?;
        let (mut baseline, values) = self.with_probe(recipe, &outputs)?;
        if let Some(probe) = &mut baseline.probe {
            (probe.platform, probe.processor) = (Some(platform()), Some(processor()));
        }
        Ok((baseline, values))
    }

    /// Adds the fingerprints of a probe and the hash of the file of its values, which [`Self::write_with_probe`] writes. Where it was
    /// run is unknown.
    ///
    /// # Errors
    /// Those of [`Outputs::to_bytes`].
    pub fn with_probe(self, recipe: Recipe, outputs: &Outputs) -> Result<(Self, Vec<u8>), DriftError> {
        let values = outputs.to_bytes()?;
        let (stages, scores) = (outputs.fingerprints(), outputs.mean_scores());
        let sha256 = Some(Sha256Digest::of(&values).to_string());
        let (platform, processor) = (None, None);
        Ok((Self { probe: Some(ProbeRecord { recipe, stages, scores, sha256, platform, processor }), ..self }, values))
    }

    /// Whether its probe was run on a machine of the type of `here`, so that its stages give the same bits; where that is unknown,
    /// whether its rows were.
    pub fn was_probed_on(&self, here: &Provenance) -> bool {
        let recorded = self.probe.as_ref().and_then(|probe| probe.platform.as_ref().zip(probe.processor.as_ref()));
        match recorded {
            Some((platform, processor)) => (platform, processor) == (&here.platform, &here.processor),
            None => same_machine(&self.provenance, here),
        }
    }

    /// Reads a baseline.
    ///
    /// # Errors
    /// [`DriftError::Io`]; [`DriftError::Malformed`] with line and column for invalid JSON, for another format, for two
    /// rows of one trial or target, for trials without one of their targets, and for targets without their trial or image, or of another
    /// mean than the numbers.
    pub fn read(path: &Path) -> Result<Self, DriftError> {
        let text = atsplat_files::read_to_string(path).map_err(DriftError::io("reading a baseline", path))?;
        Self::parse(&text, path)
    }

    /// Reads the text of the baseline at `path`.
    fn parse(text: &str, path: &Path) -> Result<Self, DriftError> {
        let malformed = |error: serde_json::Error| DriftError::malformed(path, "file", "a baseline", error);
        // Another format may have fields that are unknown here.
        let FormatOfFile { format } = serde_json::from_str(text).map_err(malformed)?;
        if !(OLDEST..=FORMAT).contains(&format) {
            let expected = format!("format {OLDEST} to {FORMAT}");
            return Err(DriftError::malformed(path, "field format", expected, format!("format {format}")));
        }
        let written: BaselineFile = serde_json::from_str(text).map_err(malformed)?;
        let BaselineFile { format: _, history, provenance, limits, probe, numbers, images, trials, targets } = written;
        let once = "each of them once";
        let (mut known_trials, mut known_targets) = (BTreeSet::new(), BTreeSet::new());
        if let Some(row) = trials.iter().find(|row| !known_trials.insert(&row.key)) {
            return Err(DriftError::malformed(path, "trials", once, format!("{} again", row.key)));
        }
        if let Some(row) = targets.iter().find(|row| !known_targets.insert((&row.key, row.target))) {
            let found = format!("target {} of {} again", row.target, row.key);
            return Err(DriftError::malformed(path, "targets", once, found));
        }
        // Older formats have these values only in their rows.
        let images = if format < WITH_IMAGES { images_of_targets(&targets) } else { images };
        let read = Self { history, numbers, provenance, limits, probe, images, trials, targets };
        let read = if format < WITH_NUMBERS { read.with_numbers_of_rows() } else { read };
        require_agreement(&read, path)?;
        Ok(read)
    }

    /// [`Self::read`], or `None` if there is no file.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub fn read_if_exists(path: &Path) -> Result<Option<Self>, DriftError> {
        let exists = path.try_exists().map_err(DriftError::io("reading a baseline", path))?;
        exists.then(|| Self::read(path)).transpose()
    }

    /// Writes the baseline atomically. If it has no probe, that of an older baseline at the same path is removed.
    ///
    /// # Errors
    /// [`DriftError::Io`], and [`DriftError::Invalid`] for a baseline that could not be read again, such as one with a number that is NaN.
    pub fn write(&self, path: &Path) -> Result<(), DriftError> {
        let text = self.to_text(path)?;
        atsplat_files::write(path, text.as_bytes()).map_err(DriftError::io("writing a baseline", path))?;
        let probe = Self::probe_path(path);
        if self.probe.is_some() {
            return Ok(());
        }
        atsplat_files::remove_if_exists(&probe).map_err(DriftError::io("removing an older baseline's probe", &probe))
    }

    /// Writes the baseline and, next to it, the values of its probe. Both are complete before the first of them replaces an
    /// older file. Between the two replacements, the new baseline is next to an old probe, which [`Self::read_probe`] rejects.
    ///
    /// # Errors
    /// Those of [`Self::write`]; both older files are unchanged unless only the probe's could not be replaced.
    pub fn write_with_probe(&self, path: &Path, values: &[u8]) -> Result<(), DriftError> {
        let probe_path = Self::probe_path(path);
        let writing = |path| DriftError::io("writing a baseline", path);
        let text = self.to_text(path)?;
        let baseline = AtomicFile::holding(path, text.as_bytes()).map_err(writing(path))?;
        let probe = AtomicFile::holding(&probe_path, values).map_err(writing(&probe_path))?;
        baseline.commit().map_err(writing(path))?;
        probe.commit().map_err(writing(&probe_path))?;
        Ok(())
    }

    /// Path of the probe's values: next to the baseline, with `.probe.safetensors` in place of `.json`, or after any other end.
    pub fn probe_path(path: &Path) -> PathBuf {
        let is_json = path.extension().is_some_and(|extension| extension == "json");
        let stem = if is_json { path.with_extension("") } else { path.to_owned() };
        let mut name = stem.into_os_string();
        name.push(".probe.safetensors");
        PathBuf::from(name)
    }

    /// Reads the values of the baseline's probe; `None` if it has no probe.
    ///
    /// # Errors
    /// [`DriftError::Io`]; [`DriftError::Malformed`] for a file that does not match the baseline.
    pub fn read_probe(&self, path: &Path) -> Result<Option<(Recipe, Outputs)>, DriftError> {
        let Some(record) = &self.probe else { return Ok(None) };
        let path = Self::probe_path(path);
        let bytes = atsplat_files::read(&path).map_err(DriftError::io("reading a baseline's probe", &path))?;
        let sha256 = Sha256Digest::of(&bytes).to_string();
        if let Some(accepted) = record.sha256.as_ref().filter(|accepted| **accepted != sha256) {
            let expected = format!("the probe that was accepted with the baseline, {accepted}");
            return Err(DriftError::malformed(&path, "SHA-256", expected, sha256));
        }
        let outputs =
            Outputs::from_bytes(&bytes).map_err(|error| DriftError::malformed(&path, "file", "a probe", error))?;
        if outputs.fingerprints() != record.stages {
            return Err(DriftError::malformed(&path, "values", "the values of the baseline's probe", "other values"));
        }
        Ok(Some((record.recipe.clone(), outputs)))
    }

    /// Pretty-printed JSON with one row per line, which [`Self::read`] accepts.
    #[expect(clippy::expect_used, reason = "the field is part of the serialised structure")]
    fn to_text(&self, path: &Path) -> Result<String, DriftError> {
        let head = BaselineFile {
            format: FORMAT,
            history: self.history.clone(),
            provenance: self.provenance.clone(),
            limits: self.limits.clone(),
            probe: self.probe.clone(),
            numbers: Vec::new(),
            images: Vec::new(),
            trials: Vec::new(),
            targets: Vec::new(),
        };
        let invalid =
            |error: serde_json::Error| DriftError::malformed(path, "numbers", "numbers that JSON can represent", error);
        let mut text = serde_json::to_string_pretty(&head).map_err(invalid)?;
        // The four empty lists at the end are replaced by lists with one row per line.
        let end = text.rfind("\"numbers\": []").expect("the head ends with empty lists");
        text.truncate(end);
        let lists = [
            list("numbers", &self.numbers),
            list("images", &self.images),
            list("trials", &self.trials),
            list("targets", &self.targets),
        ];
        let lists = lists.into_iter().collect::<Result<Vec<_>, _>>().map_err(invalid)?;
        let text = format!("{text}{}\n}}\n", lists.join(",\n  "));
        // A number that is NaN or infinite is written as `null`, which is none; and it would replace a baseline that can be read.
        Self::parse(&text, path)
            .map_err(|error| DriftError::invalid("the new baseline", "one that can be read again", error))?;
        Ok(text)
    }
}

/// A field with one row per line.
fn list<T: Serialize>(name: &str, rows: &[T]) -> Result<String, serde_json::Error> {
    let rows = rows.iter().map(serde_json::to_string).collect::<Result<Vec<_>, _>>()?;
    let inside = if rows.is_empty() { String::new() } else { format!("\n    {}\n  ", rows.join(",\n    ")) };
    Ok(format!("\"{name}\": [{inside}]"))
}

impl TargetGrouping {
    /// The first field that differs now, with both values: `leaked was false, is now true`.
    pub(super) fn change(&self, now: &Self) -> Option<String> {
        if self == now {
            return None;
        }
        let fields = |Self { leaked, signed_distance, overlap }: &Self| {
            let overlap = overlap.map_or_else(|| "none".to_owned(), |overlap| overlap.to_string());
            [("leaked", leaked.to_string()), ("distance", signed_distance.to_string()), ("overlap", overlap)]
        };
        let mut pairs = fields(self).into_iter().zip(fields(now));
        let ((field, was), (_, is)) = pairs.find(|(was, is)| was != is)?;
        Some(format!("{field} was {was}, is now {is}"))
    }
}

impl From<&TrialRow> for BaselineTrial {
    fn from(row: &TrialRow) -> Self {
        let TrialRow { key, trial_hash, status, final_tokens, gaussians, context, data_hash, .. } = row.clone();
        Self { key, trial_hash, status, final_tokens, gaussians, context: Some(context), data_hash }
    }
}

impl From<&TargetRow> for BaselineTarget {
    fn from(row: &TargetRow) -> Self {
        let TargetRow { key, target, frame, status, truth_hash, render_hash, mut scores, .. } = row.clone();
        scores.retain(|_, score| score.is_finite());
        let TargetRow { leaked, signed_distance, overlap, .. } = *row;
        let grouping = Some(TargetGrouping { leaked, signed_distance, overlap });
        Self { key, target, frame, status, truth_hash, render_hash, scores, grouping }
    }
}
