//! What a network was trained on, from the description in its record.

use std::collections::BTreeSet;

use atsplat_eval::sources::is_simulated;
use atsplat_model::weights::training_data;
use atsplat_protocol::{NAMED_DATASETS, NamedDataset};
use atsplat_results::MethodRecord;

/// The pairs of datasets that a unified network is trained on: the paper's, and its stand-in.
const UNIFIED: [[&str; 2]; 2] = [["re10k", "dl3dv"], ["rooms", "yards"]];

/// Between the folder of a source and the preset that its images are prepared by, which may have any name.
const UNDER: &str = " under ";

/// The ids of the datasets that a network was trained on; empty unless every source in its description names a known one: the
/// network may have seen anything in the others. A folder is known by its name, not by that of the preset beside it.
fn training_datasets(record: &MethodRecord) -> BTreeSet<&'static str> {
    let description = record.training.as_ref().map_or("", |training| training.data.as_str());
    let of_sources: Vec<BTreeSet<&str>> = training_data::sources(description).map(datasets_of_source).collect();
    if of_sources.iter().any(BTreeSet::is_empty) {
        return BTreeSet::new();
    }
    of_sources.into_iter().flatten().collect()
}

fn datasets_of_source(source: &str) -> BTreeSet<&'static str> {
    datasets_in(data_of(source))
}

/// The data of a source, without its preset.
fn data_of(source: &str) -> &str {
    source.split_once(UNDER).map_or(source, |(data, _)| data)
}

fn datasets_in(description: &str) -> BTreeSet<&'static str> {
    let data = description.to_lowercase();
    let words: BTreeSet<&str> = data.split(|letter: char| !letter.is_ascii_alphanumeric()).collect();
    let is_in_words = |dataset: &&NamedDataset| dataset.words.iter().any(|word| words.contains(word));
    NAMED_DATASETS.iter().filter(is_in_words).map(|dataset| dataset.id).collect()
}

/// `zero-shot: not trained on yards`, for a network that was trained on other data than `dataset`, which is empty for data of no
/// known dataset; `None` for a network that was trained on it, or whose training data are not known.
pub(crate) fn zero_shot_note(record: &MethodRecord, dataset: &str) -> Option<String> {
    let datasets = training_datasets(record);
    let unseen = match (datasets.is_empty(), is_named(dataset)) {
        (true, _) => None,
        (false, true) => (!datasets.contains(dataset)).then(|| name(dataset)),
        (false, false) => datasets.iter().all(|id| is_simulated(id)).then_some("photographs"),
    };
    unseen.map(|data| format!("zero-shot: not trained on {data}"))
}

/// Whether the record of a network names one of these datasets among the data of its trainings. Of data that it names otherwise,
/// nothing is assumed.
pub(super) fn was_trained_on(record: &MethodRecord, ids: &[String]) -> bool {
    let description = record.training.as_ref().map_or("", |training| training.data.as_str());
    let mut seen = training_data::sources(description).flat_map(datasets_of_source);
    seen.any(|id| ids.iter().any(|unwanted| unwanted == id))
}

/// Whether one network was trained on both datasets of a unified model, or says that it is one.
pub(crate) fn is_unified(record: &MethodRecord) -> bool {
    let stated = record.stated_variant() == Some("unified");
    // A network that was fine-tuned on the second dataset is not one for both.
    let last = record.training.as_ref().and_then(|training| training_data::trainings(&training.data).next());
    let sources = last.into_iter().flat_map(training_data::sources_of);
    let datasets: BTreeSet<&str> = sources.flat_map(datasets_of_source).collect();
    stated || UNIFIED.iter().any(|pair| pair.iter().all(|id| datasets.contains(id)))
}

/// Whether tables name this dataset.
pub(crate) fn is_named(dataset: &str) -> bool {
    NamedDataset::by_id(dataset).is_some()
}

/// A dataset's name in tables.
pub(crate) fn name(dataset: &str) -> &str {
    NamedDataset::by_id(dataset).map_or(dataset, |named| named.name)
}

#[cfg(test)]
mod tests {
    use atsplat_results::TrainingRecord;

    use super::*;

    fn trained_on(data: &str) -> MethodRecord {
        let training = Some(TrainingRecord { data: data.to_owned(), seed: None });
        MethodRecord { training, ..MethodRecord::default() }
    }

    #[test]
    fn a_network_is_zero_shot_on_what_its_record_does_not_name() {
        let rooms = trained_on("simulated rooms, train split, seeds 0 to 5999, 128x128");
        assert_eq!(zero_shot_note(&rooms, "rooms"), None);
        assert_eq!(zero_shot_note(&rooms, "yards").as_deref(), Some("zero-shot: not trained on yards"));
        assert_eq!(zero_shot_note(&rooms, "dl3dv").as_deref(), Some("zero-shot: not trained on DL3DV"));
        assert_eq!(zero_shot_note(&rooms, "photos").as_deref(), Some("zero-shot: not trained on photographs"));
        let re10k = trained_on("data/re10k/train under re10k-2v-256");
        assert_eq!((zero_shot_note(&re10k, "re10k"), zero_shot_note(&re10k, "photos")), (None, None));
        assert_eq!(
            zero_shot_note(&trained_on("my own videos"), "re10k"),
            None,
            "nothing is claimed about unknown data"
        );
        assert_eq!(zero_shot_note(&MethodRecord::default(), "re10k"), None);
    }

    /// A folder of any name may be a copy of the dataset.
    #[test]
    fn one_source_of_unknown_data_is_enough_for_no_claim() {
        let (rooms, own) = ("1 × rooms train 0 to 9 at 64x64 (2 views)", "1 × ch under mine-128.toml (2 views)");
        let before = "rooms train 200000 to 207039 at 128x128; before: 6000 rooms of the train split at 128x128";
        let note = |data: &str| zero_shot_note(&trained_on(data), "re10k");
        assert_eq!(note(&format!("{rooms}; before: {before}")).as_deref(), Some("zero-shot: not trained on RE10K"));
        for data in [
            format!("{own}; before: {before}"),
            format!("{rooms}; before: {own}"),
            format!("{rooms} + {own}"),
            format!("{own} + {rooms}"),
        ] {
            assert_eq!(note(&data), None, "{data}");
        }
        for preset in ["dl3dv-128.toml", "rooms-2v-128"] {
            assert_eq!(note(&format!("1 × ch under {preset} (2 views); before: {before}")), None, "{preset}");
        }
        let of_its_preset = "1 × data/yards/train under rooms-2v-128 (2 views)";
        let unseen = zero_shot_note(&trained_on(of_its_preset), "rooms");
        assert_eq!(unseen.as_deref(), Some("zero-shot: not trained on rooms"), "rooms are only in the preset's name");
        assert_eq!(zero_shot_note(&trained_on(of_its_preset), "yards"), None);
        let yards = note(&format!("{rooms} + 2 × yards train 0 to 9 at 64x112; before: {before}"));
        assert_eq!(yards.as_deref(), Some("zero-shot: not trained on RE10K"));
    }

    #[test]
    fn datasets_have_names_and_those_of_unified_networks_are_known() {
        assert_eq!([name("acid"), name("yards"), name("fox")], ["ACID", "yards", "fox"]);
        assert!(!is_named("photos") && UNIFIED.iter().flatten().all(|id| is_named(id)));
    }

    #[test]
    fn unified_networks_were_trained_on_both_datasets() {
        let sources = ["1 × data/re10k/train under re10k-2v-256", "1 × data/dl3dv/train under dl3dv-6v"];
        assert!(is_unified(&trained_on(&training_data::of_sources(sources.map(str::to_owned)))));
        assert!(is_unified(&trained_on("1 × rooms train 0 to 9 at 128x128 + 1 × yards train 0 to 9 at 128x128")));
        for of_one in [
            "1 × data/dl3dv/train under re10k-to-dl3dv-256",
            "1 × data/yards/train under rooms-to-yards-128 + 1 × data/yards/more under yards-2v-128x224",
        ] {
            assert!(!is_unified(&trained_on(of_one)), "{of_one}: the other dataset is only in the preset's name");
        }
        assert!(!is_unified(&trained_on("simulated rooms")) && !is_unified(&trained_on("dl3dv and rooms")));
        let fine_tuned = trained_on("data/dl3dv/train under dl3dv-6v; before: data/re10k/train under re10k-2v-256");
        assert!(!is_unified(&fine_tuned));
        assert_eq!(zero_shot_note(&fine_tuned, "re10k"), None);
    }
}
