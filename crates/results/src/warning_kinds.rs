//! The kinds of warnings in a store that its readers distinguish from others.

/// How the kinds of warnings begin about methods whose settings other presets state; the method's name follows.
pub const UNLISTED_SETTINGS: &str =
    "methods with the preset's own poses and planes, because it states none of the method they name";
/// How the kinds of warnings begin about methods for which nobody chose a setting, although the preset lists one for their name, which
/// follows.
pub const SETTINGS_NOT_CHOSEN: &str =
    "methods with the preset's own poses and planes, although it states others for a method of their name";
/// The kind of the warning about learned metrics with other weights than the published ones, whose numbers are of another metric.
pub const UNPUBLISHED_WEIGHTS: &str = "learned metrics with other weights than the published ones";

/// How the kinds of warnings begin about results that a run evaluated again, for a metric or an image that they lack, and that failed
/// then; the method's name follows. The run after it tries again.
pub const FAILED_AGAIN: &str = "results that failed when they were evaluated again, so that the earlier ones stay";

/// The kind of the warning about stores merged into one that name other data than the first.
pub const OTHER_DATA: &str = "runs on data in another place than the first";
/// How the kinds of warnings begin about merged stores whose imported files are in another folder than the first's; the method's name
/// follows.
pub const OTHER_FOLDER: &str = "runs on files in another folder than the first";

/// The kind of the warning about scenes of an index that the data lack.
pub const MISSING_SCENES: &str = "scenes of the index that are not in the data";
/// How the kinds begin about entries of a published index that the split derived from it drops.
pub const DROPPED_BY_SPLIT: &str = "entries of the published index that have no place in its split";

/// The kind about scenes that have no entry in a sampled index.
pub const WITHOUT_ENTRY: &str = "scenes without an entry in the sampled index";
/// The kind about frames without an image.
pub const WITHOUT_IMAGE: &str = "frames without an image, which are not sampled";
/// The kind about images that cannot be read.
pub const UNREADABLE_IMAGE: &str = "images that cannot be read, found in sampling";
/// The kind about scenes that are not read.
pub const NOT_READ: &str = "scenes that are not read, and not sampled";
/// How the kinds begin about scenes and frames of the data that a sampled index leaves out.
pub const NOT_SAMPLED: [&str; 4] = [WITHOUT_ENTRY, WITHOUT_IMAGE, UNREADABLE_IMAGE, NOT_READ];

/// Whether a kind of warning is about a whole run, which every shard of it counts.
pub(crate) fn is_of_run(kind: &str) -> bool {
    kind.starts_with(UNLISTED_SETTINGS) || kind.starts_with(SETTINGS_NOT_CHOSEN) || kind == UNPUBLISHED_WEIGHTS
}
