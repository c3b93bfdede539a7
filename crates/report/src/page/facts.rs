use std::collections::BTreeSet;

use atsplat_numeric::{distinct, noun};
use atsplat_results::Provenance;

use super::{PageStore, escaped};
use crate::counted;
use crate::hashes::{short, short_commit};
use crate::table::{Table, agreement};

/// A summary in a few numbers, then a line per table.
pub(super) fn summary(tables: &[Table], stores: &[PageStore<'_>]) -> String {
    let results = || stores.iter().map(|store| store.source.results);
    let trials: usize = results().map(|results| results.trials.len()).sum();
    let targets: usize = results().map(|results| results.targets.len()).sum();
    // Several stores may have results of one method or protocol.
    let methods = results().flat_map(|results| &results.provenance.methods);
    let methods =
        methods.map(|method| (&method.name, &method.weights_sha256, method.untrained)).collect::<BTreeSet<_>>();
    let presets = results().flat_map(|results| &results.provenance.presets);
    let protocols = presets.map(|preset| (&preset.name, &preset.hash, &preset.index_sha256)).collect::<BTreeSet<_>>();
    let facts = [(protocols.len(), "protocol"), (methods.len(), "method"), (trials, "trial"), (targets, "target view")];
    let fact =
        |(count, what): (usize, &str)| format!("<li><b>{count}</b><span>{}</span></li>", noun(count as u64, what));
    let facts: String = facts.map(fact).concat();
    let mut text = format!("<ul class=\"facts\">{facts}</ul>");
    let untrained = methods.iter().filter(|(.., untrained)| *untrained).count();
    if untrained > 0 {
        let all = methods.len();
        text.push_str(&format!(
            "<p class=\"warning\">{untrained} of {all} methods have random weights: their counts are real, their quality is meaningless.</p>"
        ));
    }
    let compared: Vec<_> =
        tables.iter().map(|table| (table, agreement(table))).filter(|(_, agreement)| agreement.compared > 0).collect();
    if !compared.is_empty() {
        text.push_str("<ul>");
        for (table, agreement) in compared {
            let headline = agreement.headline.as_ref().map_or_else(String::new, |headline| format!("{headline}. "));
            text.push_str(&format!(
                "<li><a href=\"#table-{}\">{}</a>: {}</li>",
                escaped(&table.name),
                escaped(&table.title),
                escaped(&format!("{headline}{agreement}"))
            ));
        }
        text.push_str("</ul>");
    }
    text
}

/// The provenance of every store, by its name.
pub(super) fn origin<'a>(stores: impl IntoIterator<Item = (&'a str, &'a Provenance)>) -> String {
    stores.into_iter().map(|(label, provenance)| card(label, provenance)).collect()
}

/// The most commands of a store that are shown: a merged one may have thousands.
const SHOWN_COMMANDS: usize = 20;

fn card(label: &str, provenance: &Provenance) -> String {
    let commands = match provenance.commands().count() {
        1 => "Command".to_owned(),
        several => format!("Commands ({several})"),
    };
    let mut facts = vec![
        (
            "atsplat",
            format!(
                "{} {}",
                provenance.atsplat,
                provenance.commit.as_deref().map_or_else(|| "outside its repository".to_owned(), short_commit)
            ),
        ),
        (
            "Machine",
            format!(
                "{}, {}, {}",
                provenance.processor,
                provenance.platform,
                counted(provenance.threads.into(), "thread")
            ),
        ),
    ];
    facts.extend(provenance.commands().take(SHOWN_COMMANDS).map(|command| (commands.as_str(), command.join(" "))));
    if provenance.commands().count() > SHOWN_COMMANDS {
        facts.push((commands.as_str(), "… (the others are in provenance.json)".to_owned()));
    }
    facts.push(("Schema", format!("version {}, {}", provenance.schema_version, short(&provenance.schema_hash))));
    facts.extend(provenance.adapter.as_ref().map(|adapter| ("Adapter", adapter.clone())));
    for preset in &provenance.presets {
        let index = preset.index_name.as_deref().unwrap_or(&preset.index);
        facts.push((
            "Protocol",
            format!(
                "{}: {}; {} of {} entries, index {index}, data {}, {}",
                preset.name,
                preset.title,
                preset.entries,
                preset.entries_of_index,
                preset.dataset,
                short(&preset.hash)
            ),
        ));
    }
    for method in &provenance.methods {
        let weights =
            method.weights_sha256.as_deref().map_or_else(String::new, |hash| format!(", weights {}", short(hash)));
        let untrained = if method.untrained { ", untrained" } else { "" };
        facts.push(("Method", format!("{} ({}): {}{weights}{untrained}", method.name, method.kind, method.title)));
    }
    for warning in &provenance.warnings {
        facts.push((
            "Warning",
            format!("{} × {} in {}: {}", warning.count, warning.kind, warning.preset, warning.example),
        ));
    }
    if let Some(first) = provenance.skipped.first() {
        let count = counted(provenance.skipped.len() as u64, "index entry");
        facts.push(("Skipped", format!("{count}; the first: {} {}: {}", first.scene, first.reason, first.detail)));
    }
    let names = distinct(facts.iter().map(|(name, _)| *name));
    let values = |name: &str| -> String {
        let of_name = facts.iter().filter(|(other, _)| *other == name);
        of_name.map(|(_, value)| format!("<dd>{}</dd>", escaped(value))).collect()
    };
    let facts: String = names.into_iter().map(|name| format!("<dt>{name}</dt>{}", values(name))).collect();
    format!("<article class=\"card\"><h3>{}</h3><dl>{facts}</dl></article>\n", escaped(label))
}
