//! The dataset that results are known to be of. A protocol runs on any data, so that the one it states says nothing about them.

use std::path::Path;

use atsplat_eval::sources::{is_simulated, simulated_dataset};
use atsplat_files::Sha256Digest;
use atsplat_protocol::{KnownIndex, Preset};
use atsplat_results::{PresetRecord, Results};

use crate::definition::{dataset_name, is_named_dataset};

/// The data in words, if the protocol is that of a named dataset and they are not known to be of it.
pub(crate) fn other_data(results: &Results, record: &PresetRecord) -> Option<String> {
    let stated = record.protocol().ok()?.dataset;
    let known = known_dataset(results, record);
    let is_other = is_named_dataset(&stated) && known.as_deref() != Some(stated.as_str());
    is_other.then(|| in_words(known.as_deref(), &stated, &record.dataset))
}

/// Data in words: `RE10K`, `simulated rooms`, `capture fox`, or `unidentified data (desk)` where the protocol states a named dataset
/// and nothing shows that the data are of one. `described` is the record's [`PresetRecord::dataset`].
pub(super) fn in_words(known: Option<&str>, stated: &str, described: &str) -> String {
    match known {
        Some(known) if is_simulated(known) => format!("simulated {known}"),
        Some(known) => dataset_name(known).to_owned(),
        None if is_named_dataset(stated) => format!("unidentified data ({})", folder(described)),
        None => format!("capture {}", folder(described)),
    }
}

/// The last part of a path, after that of its parent if it is the name of a split: `desk`, `mine/test`.
fn folder(described: &str) -> String {
    // How the images were read may follow the path: `, images cropped beforehand`.
    let path = Path::new(described.rsplit_once(", images").map_or(described, |(path, _)| path));
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    match (path.parent().and_then(name), name(path)) {
        (Some(parent), Some(split)) if matches!(split.as_str(), "train" | "test" | "val") => {
            format!("{parent}/{split}")
        }
        (_, Some(last)) => last,
        (_, None) => described.to_owned(),
    }
}

/// That of the published index which names the evaluated scenes, or that of simulated scenes, which their keys tell; `None` for
/// all other data.
pub(super) fn known_dataset(results: &Results, record: &PresetRecord) -> Option<String> {
    let trials = results.trials.iter().filter(|trial| trial.key.preset == record.name);
    dataset_of_index(record).or_else(|| simulated_dataset(trials.map(|trial| trial.key.scene.as_str())))
}

/// The dataset of a recognised index: of a published file, what was derived from one or has fewer context views, also if it is another
/// protocol's, or of a stand-in's own file. A protocol gives a published name to no other file.
fn dataset_of_index(record: &PresetRecord) -> Option<String> {
    let by_hash = || record.index_sha256.parse::<Sha256Digest>().ok().and_then(|sha256| KnownIndex::by_sha256(&sha256));
    let name = record.index_name.as_deref().or(record.reduced_from.as_deref());
    let known = name.and_then(KnownIndex::by_name).or_else(by_hash);
    if let Some(known) = known {
        return Some(known.dataset.to_owned());
    }
    let preset = Preset::named(&record.preset).ok()?;
    let is_accepted = preset.index.accepted.iter().any(|accepted| accepted.sha256.to_string() == record.index_sha256);
    is_accepted.then_some(preset.dataset)
}
