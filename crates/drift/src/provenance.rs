use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::Provenance;
use serde::Serialize;

/// A setting that differs from the baseline's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// Which setting, such as `method atsplat, weights-sha256`.
    pub what: String,
    /// The baseline's value, if any.
    pub baseline: Option<String>,
    /// The results' value, if any.
    pub now: Option<String>,
}

/// Settings that affect numbers and differ.
pub(super) fn differences(baseline: &Provenance, now: &Provenance) -> Vec<Difference> {
    let (baseline, now) = (settings(baseline), settings(now));
    let names: BTreeSet<&String> = baseline.keys().chain(now.keys()).collect();
    let difference = |what: &String| {
        let [baseline, now] = [&baseline, &now].map(|settings| settings.get(what).cloned());
        (baseline != now).then(|| Difference { what: what.clone(), baseline, now })
    };
    names.into_iter().filter_map(difference).collect()
}

/// Whether results can be compared bit by bit: the same platform, and a single processor that is the same. Graphics adapters do not
/// matter, as nothing that runs on one counts as deterministic.
pub fn same_machine(a: &Provenance, b: &Provenance) -> bool {
    a.processors().count() <= 1 && a.platform == b.platform && a.processor == b.processor
}

/// All settings of a provenance that affect numbers, by name; absent ones have no entry.
fn settings(provenance: &Provenance) -> BTreeMap<String, String> {
    let Provenance { atsplat, commit, platform, processor, adapter, presets, methods, metrics, .. } = provenance;
    let mut settings = BTreeMap::new();
    let mut put = |what: String, value: Option<String>| {
        if let Some(value) = value {
            settings.insert(what, value);
        }
    };
    put("atsplat".to_owned(), Some(atsplat.clone()));
    put("commit".to_owned(), commit.clone());
    put("platform".to_owned(), Some(platform.clone()));
    put("processor".to_owned(), Some(processor.clone()));
    put("adapter".to_owned(), adapter.clone());
    for preset in presets {
        let of = |field: &str| format!("preset {}, {field}", preset.name);
        put(of("hash"), Some(preset.hash.clone()));
        put(of("index-sha256"), Some(preset.index_sha256.clone()));
        put(of("dataset"), Some(preset.dataset.clone()));
        put(of("entries"), Some(preset.entries.to_string()));
    }
    for method in methods {
        let of = |field: &str| format!("method {}, {field}", method.name);
        put(of("kind"), Some(method.kind.clone()));
        put(of("weights-sha256"), method.weights_sha256.clone());
        put(of("constants"), method.constants.clone());
        put(of("backend"), method.backend.clone());
        put(of("network-adapter"), method.network_adapter.as_ref().map(ToString::to_string));
        put(of("renderer-adapter"), method.renderer_adapter.as_ref().map(ToString::to_string));
        put(of("deterministic"), Some(method.deterministic.to_string()));
        for (name, value) in &method.parameters {
            each_field(&of(name), value, &mut put);
        }
    }
    for metric in metrics {
        let of = |field: &str| format!("metric {}, {field}", metric.id);
        put(of("convention"), Some(metric.convention.clone()));
        put(of("weights-sha256"), metric.weights_sha256.clone());
        put(of("absent"), metric.reason_of_absence().map(str::to_owned));
    }
    settings
}

/// Adds a parameter's fields one by one, so that a difference names the field.
fn each_field(name: &str, value: &serde_json::Value, put: &mut impl FnMut(String, Option<String>)) {
    match value {
        serde_json::Value::Object(fields) => {
            fields.iter().for_each(|(field, value)| each_field(&format!("{name}.{field}"), value, put));
        }
        serde_json::Value::String(text) => put(name.to_owned(), Some(text.clone())),
        serde_json::Value::Number(number) => put(name.to_owned(), Some(plain(number))),
        other => put(name.to_owned(), Some(other.to_string())),
    }
}

/// A number with the digits it was written with: one that is an exact f32 is formatted as f32.
fn plain(number: &serde_json::Number) -> String {
    let Some(value) = number.as_f64().filter(|_| number.is_f64()) else { return number.to_string() };
    #[expect(clippy::cast_possible_truncation, reason = "the result is compared with the original")]
    let single = value as f32;
    let same = f64::from(single).to_bits() == value.to_bits();
    if same { single.to_string() } else { value.to_string() }
}
