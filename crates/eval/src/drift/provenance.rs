use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::Provenance;

/// Something that was otherwise when the baseline was made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Difference {
    /// What, as `method atsplat, weights-sha256`.
    pub what: String,
    /// What the baseline says; `None` where it does not know of it.
    pub baseline: Option<String>,
    /// What the results say.
    pub now: Option<String>,
}

/// What decides numbers and is not the same.
pub(super) fn differences(baseline: &Provenance, now: &Provenance) -> Vec<Difference> {
    let (baseline, now) = (facts(baseline), facts(now));
    let names: BTreeSet<&String> = baseline.keys().chain(now.keys()).collect();
    let difference = |what: &String| {
        let [baseline, now] = [&baseline, &now].map(|facts| facts.get(what).cloned());
        (baseline != now).then(|| Difference { what: what.clone(), baseline, now })
    };
    names.into_iter().filter_map(difference).collect()
}

/// Whether bits may be compared: the same platform and processor, and the same adapter where one rendered.
pub fn same_machine(a: &Provenance, b: &Provenance) -> bool {
    a.platform == b.platform && a.processor == b.processor && a.adapter == b.adapter
}

/// Everything in a provenance that decides numbers, by name; what is absent has no entry.
fn facts(provenance: &Provenance) -> BTreeMap<String, String> {
    let Provenance { atsplat, commit, platform, processor, adapter, presets, methods, metrics, .. } = provenance;
    let mut facts = BTreeMap::new();
    let mut put = |what: String, value: Option<String>| {
        if let Some(value) = value {
            facts.insert(what, value);
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
        put(of("deterministic"), Some(method.deterministic.to_string()));
        for (name, value) in &method.parameters {
            each_field(&of(name), value, &mut put);
        }
    }
    for metric in metrics {
        let of = |field: &str| format!("metric {}, {field}", metric.id);
        put(of("convention"), Some(metric.convention.clone()));
        put(of("weights-sha256"), metric.weights_sha256.clone());
        put(of("absent"), metric.absent.clone());
    }
    facts
}

/// A parameter's fields one by one, so that a difference shows the field and not the whole of it.
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

/// A number with the digits that it was written with: one that went through f32 has no more than those.
fn plain(number: &serde_json::Number) -> String {
    let Some(value) = number.as_f64().filter(|_| number.is_f64()) else { return number.to_string() };
    #[expect(clippy::cast_possible_truncation, reason = "the question is whether f32 holds it")]
    let single = value as f32;
    let same = f64::from(single).to_bits() == value.to_bits();
    if same { single.to_string() } else { value.to_string() }
}
