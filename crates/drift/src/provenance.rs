use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use atsplat_protocol::Preset;
use atsplat_results::{PresetRecord, Provenance, excerpts};
use serde::ser::{Serialize, SerializeStruct as _, Serializer};

/// What a setting is of, by name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Setting {
    /// The run.
    Run,
    /// A method.
    Method(String),
    /// A metric, by its id.
    Metric(String),
    /// A preset.
    Preset(String),
}

/// A setting that differs from the baseline's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// What it is a setting of.
    pub of: Setting,
    /// The field; `None` for the presence of all of a method, metric or preset.
    pub field: Option<String>,
    /// The baseline's value, if any.
    pub baseline: Option<String>,
    /// The results' value, if any.
    pub now: Option<String>,
}

impl Difference {
    /// Which setting, such as `method atsplat, weights-sha256`.
    pub fn what(&self) -> String {
        let (kind, name) = match &self.of {
            Setting::Run => return self.field.clone().unwrap_or_default(),
            Setting::Method(name) => ("method", name),
            Setting::Metric(name) => ("metric", name),
            Setting::Preset(name) => ("preset", name),
        };
        let field = self.field.as_ref().map_or_else(String::new, |field| format!(", {field}"));
        format!("{kind} {name}{field}")
    }

    /// `was 0.3, is now 0.1`: at most 48 characters of each value, as those of configurations are long.
    pub(super) fn values(&self) -> String {
        let values = [&self.baseline, &self.now].map(|value| value.as_deref().unwrap_or("nothing"));
        let [was, now] = excerpts(values, 48);
        format!("was {was}, is now {now}")
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.what(), self.values())
    }
}

impl Serialize for Difference {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Difference", 3)?;
        fields.serialize_field("what", &self.what())?;
        fields.serialize_field("baseline", &self.baseline)?;
        fields.serialize_field("now", &self.now)?;
        fields.end()
    }
}

/// Values of settings by name.
type Fields = BTreeMap<String, String>;

/// Fields of a [`PresetRecord`] that are not of its protocol.
pub(super) const OF_RECORD: [&str; 4] = ["hash", "index-sha256", "data", "entries"];
/// Whether the text of a protocol can be read; the other fields of one that cannot are unknown.
pub(super) const TEXT: &str = "toml";
const READABLE: &str = "readable";

/// Fields of presets that change no number, as [`atsplat_protocol::Preset::hash`] leaves them out.
const PROSE: [&str; 6] = ["name", "title", "notes", "inferred", "sources", "stands-for"];
/// The same below the top.
const PROSE_BELOW: [&str; 2] = ["index.sampler", "overlap-bins.estimator"];

/// Parameters of a method that are configurations of networks.
const NETWORKS: [&str; 2] = ["configuration.", LARGE_IMAGES];
/// That of the network for large images. Methods of older versions may have none: this is a single difference.
const LARGE_IMAGES: &str = "high-resolution.";
/// Fields of a network's configuration that change no number; `model` has its name.
const PROSE_OF_NETWORK: [&str; 4] = ["name", "title", "notes", "inferred"];

/// Settings that affect numbers and differ: those of the run, then of each method, metric and preset field by field. One that only
/// one of them has is a single difference.
pub(super) fn differences(baseline: &Provenance, now: &Provenance) -> Vec<Difference> {
    let is_other = |then: &&PresetRecord| now.preset(&then.name).is_some_and(|now| now.hash != then.hash);
    let others: BTreeSet<&str> = baseline.presets.iter().filter(is_other).map(|then| then.name.as_str()).collect();
    let [then, now] = [baseline, now].map(|provenance| settings(provenance, &others));
    let mut found = Vec::new();
    for of in then.keys().chain(now.keys()).collect::<BTreeSet<_>>() {
        if let (Some(then), Some(now)) = (then.get(of), now.get(of)) {
            found.extend(differing_fields(of, then, now));
        } else {
            let presence =
                |all: &BTreeMap<Setting, Fields>| if all.contains_key(of) { "present" } else { "absent" }.to_owned();
            let (baseline, now) = (Some(presence(&then)), Some(presence(&now)));
            found.push(Difference { of: of.clone(), field: None, baseline, now });
        }
    }
    found
}

fn differing_fields(of: &Setting, then: &Fields, now: &Fields) -> Vec<Difference> {
    let is_unreadable = |fields: &Fields| fields.get(TEXT).is_some_and(|text| text != READABLE);
    let are_known = !matches!(of, Setting::Preset(_)) || !(is_unreadable(then) || is_unreadable(now));
    let is_known = |field: &str| are_known || field == TEXT || OF_RECORD.contains(&field);
    let difference = |field: &String| {
        let [baseline, now] = [then, now].map(|fields| fields.get(field).cloned());
        let is_different = baseline != now && is_known(field);
        is_different.then(|| Difference { of: of.clone(), field: Some(field.clone()), baseline, now })
    };
    let has_large = |fields: &Fields| fields.keys().any(|field| field.starts_with(LARGE_IMAGES));
    let [large_then, large_now] = [then, now].map(|fields| has_large(fields).then(|| "present".to_owned()));
    let is_single = |field: &&String| large_then != large_now && field.starts_with(LARGE_IMAGES);
    let names: BTreeSet<&String> = then.keys().chain(now.keys()).filter(|field| !is_single(field)).collect();
    let mut found: Vec<Difference> = names.into_iter().filter_map(difference).collect();
    if large_then != large_now {
        let field = Some(LARGE_IMAGES.trim_end_matches('.').to_owned());
        found.push(Difference { of: of.clone(), field, baseline: large_then, now: large_now });
    }
    found
}

/// Whether results can be compared bit by bit: the same platform, and a single processor that is the same. Graphics adapters do not
/// matter, as nothing that runs on one counts as deterministic.
pub fn same_machine(a: &Provenance, b: &Provenance) -> bool {
    a.processors().count() <= 1 && a.platform == b.platform && a.processor == b.processor
}

/// All settings of a provenance that affect numbers, by what they are of and name; absent ones have no entry. Of presets, protocols are
/// among them for those whose names are in `others`.
fn settings(provenance: &Provenance, others: &BTreeSet<&str>) -> BTreeMap<Setting, Fields> {
    let Provenance { atsplat, commit, platform, processor, adapter, presets, methods, metrics, .. } = provenance;
    let of_run = fields([
        ("atsplat", Some(atsplat.clone())),
        ("commit", commit.clone()),
        ("platform", Some(platform.clone())),
        ("processor", Some(processor.clone())),
        ("adapter", adapter.clone()),
    ]);
    let mut settings = BTreeMap::from([(Setting::Run, of_run)]);
    for preset in presets {
        let is_other = others.contains(preset.name.as_str());
        let mut of_preset = if is_other { protocol(&preset.toml) } else { Fields::new() };
        of_preset.extend(fields([
            ("hash", Some(preset.hash.clone())),
            ("index-sha256", Some(preset.index_sha256.clone())),
            // Not the protocol's field `dataset`.
            ("data", Some(preset.dataset.clone())),
            ("entries", Some(preset.entries.to_string())),
        ]));
        settings.insert(Setting::Preset(preset.name.clone()), of_preset);
    }
    for method in methods {
        let mut of_method = fields([
            ("kind", Some(method.kind.clone())),
            ("weights-sha256", method.weights_sha256.clone()),
            ("constants", method.constants.clone()),
            ("backend", method.backend.clone()),
            ("network-adapter", method.network_adapter.as_ref().map(ToString::to_string)),
            ("renderer-adapter", method.renderer_adapter.as_ref().map(ToString::to_string)),
            ("deterministic", Some(method.deterministic.to_string())),
        ]);
        for (name, value) in &method.parameters {
            each_field(name, value, &mut of_method);
        }
        of_method.retain(|field, _| field_of_network(field).is_none_or(|field| !PROSE_OF_NETWORK.contains(&field)));
        settings.insert(Setting::Method(method.name.clone()), of_method);
    }
    for metric in metrics {
        let of_metric = fields([
            ("convention", Some(metric.convention.clone())),
            ("weights-sha256", metric.weights_sha256.clone()),
            ("absent", metric.reason_of_absence().map(str::to_owned)),
        ]);
        settings.insert(Setting::Metric(metric.id.clone()), of_metric);
    }
    settings
}

/// Whether a method's field is one of its network's configuration.
pub(super) fn is_of_network(field: &str) -> bool {
    field_of_network(field).is_some()
}

/// The field of a network's configuration, if a method's field is one.
fn field_of_network(field: &str) -> Option<&str> {
    NETWORKS.iter().find_map(|network| field.strip_prefix(network))
}

/// The fields that have a value.
fn fields<const N: usize>(all: [(&str, Option<String>); N]) -> Fields {
    all.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
}

/// The fields of a preset's TOML that can change a number, and whether it is TOML. A preset of an older version has the fields of this
/// one.
fn protocol(text: &str) -> Fields {
    let written = Preset::from_toml(text).and_then(|preset| preset.to_toml());
    let table = match written.as_deref().unwrap_or(text).parse::<toml::Table>() {
        Ok(table) => table,
        Err(error) => {
            let why = error.message().lines().next().unwrap_or_default();
            return fields([(TEXT, Some(format!("unreadable: {why}")))]);
        }
    };
    let mut fields = fields([(TEXT, Some(READABLE.to_owned()))]);
    for (name, value) in table {
        if let Ok(value) = serde_json::to_value(value)
            && !PROSE.contains(&name.as_str())
        {
            each_field(&name, &value, &mut fields);
        }
    }
    fields.retain(|name, _| !PROSE_BELOW.contains(&name.as_str()));
    fields
}

/// Adds a parameter's fields one by one, so that a difference names the field.
fn each_field(name: &str, value: &serde_json::Value, fields: &mut Fields) {
    let text = match value {
        serde_json::Value::Object(below) => {
            for (field, value) in below {
                each_field(&format!("{name}.{field}"), value, fields);
            }
            return;
        }
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Number(number) => plain(number),
        other => other.to_string(),
    };
    fields.insert(name.to_owned(), text);
}

/// A number with the digits it was written with: one that is an exact f32 is formatted as f32.
fn plain(number: &serde_json::Number) -> String {
    let Some(value) = number.as_f64().filter(|_| number.is_f64()) else { return number.to_string() };
    #[expect(clippy::cast_possible_truncation, reason = "the result is compared with the original")]
    let single = value as f32;
    let same = f64::from(single).to_bits() == value.to_bits();
    if same { single.to_string() } else { value.to_string() }
}
