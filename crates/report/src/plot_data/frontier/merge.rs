use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::times::TimingRow;
use atsplat_results::{MethodRecord, PresetRecord, Provenance, Results, TargetRow, TrialKey, TrialRow};

use crate::table::Source;

/// The rows of a protocol from stores that have it. A method whose name an earlier store also has gets the name of its store
/// added.
pub(super) fn merged_results(sources: &[Source<'_>], preset: &PresetRecord) -> Results {
    let mut all = Results::default();
    for source in sources {
        let Results { provenance, trials, targets, timings } = source.results;
        if all.provenance.presets.is_empty() {
            all.provenance = Provenance { presets: vec![preset.clone()], methods: Vec::new(), ..provenance.clone() };
        }
        let mut names: BTreeMap<&str, String> = BTreeMap::new();
        for method in &provenance.methods {
            let is_taken = all.provenance.methods.iter().any(|other| other.name == method.name);
            let named = |text: &str| if is_taken { format!("{text}, {}", source.label) } else { text.to_owned() };
            names.insert(&method.name, named(&method.name));
            let (name, title) = (named(&method.name), named(&method.title));
            all.provenance.methods.push(MethodRecord { name, title, ..method.clone() });
        }
        let renamed = |key: &TrialKey| {
            let name = names.get(key.method.as_str()).filter(|_| key.preset == preset.name)?;
            Some(TrialKey { method: name.clone(), ..key.clone() })
        };
        for row in trials {
            all.trials.extend(renamed(&row.key).map(|key| TrialRow { key, ..row.clone() }));
        }
        for row in targets {
            all.targets.extend(renamed(&row.key).map(|key| TargetRow { key, ..row.clone() }));
        }
        for row in timings {
            all.timings.extend(renamed(&row.key).map(|key| TimingRow { key, ..row.clone() }));
        }
    }
    all
}

/// Removes the methods with random weights, whose quality says nothing about them; returns their names.
pub(super) fn remove_untrained(results: &mut Results) -> BTreeSet<String> {
    let methods = &mut results.provenance.methods;
    let untrained: BTreeSet<String> =
        methods.iter().filter(|method| method.untrained).map(|method| method.name.clone()).collect();
    methods.retain(|method| !method.untrained);
    results.trials.retain(|row| !untrained.contains(&row.key.method));
    results.targets.retain(|row| !untrained.contains(&row.key.method));
    results.timings.retain(|row| !untrained.contains(&row.key.method));
    untrained
}
