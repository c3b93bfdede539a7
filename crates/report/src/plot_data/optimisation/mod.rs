mod settings;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use atsplat_numeric::distinct;
use atsplat_protocol::OverlapBins;
use atsplat_results::{PresetRecord, Results};

use super::first_metric;
use super::subject::{FewerTargets, fewer_targets, unfinished};
use crate::ReportError;
use crate::counted;
use crate::file_names::{plain, unused};
use crate::page::PlotSection;
use crate::plot::{Drawing, OptimisationCurves, OptimisationPanel, OptimisationPoint};
use crate::table::{BUSY, Source};
use settings::{Network, Panel, PanelPoint, Settings, Study};

/// Kinds of methods that are optimised for each trial, and their curves' names, in the order of the legend.
const OPTIMISED: [(&str, &str); 4] =
    [(REFINEMENT, "ATSplat + refinement"), ("3dgs", "3DGS"), ("mip-splatting", "Mip-Splatting"), ("mcmc", "3DGS-MCMC")];
const REFINEMENT: &str = "atsplat+refine";
/// The kind of the network alone, from which the refinement's curve starts.
const NETWORK: &str = "atsplat";

/// The section before the tables: accuracy against the seconds of optimisation. It has one plot for each protocol of
/// a store under which trials were optimised with at least two budgets, with a panel for each number of context views, or
/// for each overlap bin if the protocol has bins that were published for the overlaps' estimator. `None` without a plot.
///
/// # Errors
/// [`ReportError::Store`] for an invalid protocol in a store.
pub fn optimisation_section(sources: &[Source<'_>]) -> Result<Option<PlotSection>, ReportError> {
    let plots = optimisation_plots(sources)?;
    Ok((!plots.is_empty()).then(|| PlotSection {
        title: "Accuracy against time".to_owned(),
        hint: "From one pass of a network to minutes of optimisation of each scene: what more seconds buy, and where more \
               views are needed."
            .to_owned(),
        plots,
        before_tables: true,
        stores: sources.iter().map(|source| (source.label.to_owned(), source.results.provenance.clone())).collect(),
    }))
}

/// The plots by name.
fn optimisation_plots(sources: &[Source<'_>]) -> Result<Vec<(String, Drawing)>, ReportError> {
    let mut plots: BTreeMap<String, Drawing> = BTreeMap::new();
    for Source { results, label } in sources {
        // Sweeps over the number of views evaluate one protocol on an index for each number.
        let mut protocols: BTreeMap<(&str, &str), Vec<&PresetRecord>> = BTreeMap::new();
        for preset in &results.provenance.presets {
            protocols.entry((&preset.preset, &preset.hash)).or_default().push(preset);
        }
        for ((name, _), presets) in protocols {
            let Some(plot) = curves(results, &presets)? else { continue };
            let name = format!("optimisation-{}", plain(name));
            // Stores have separate plots: curves of two would mix machines.
            let name = if plots.contains_key(&name) { format!("{name}-{}", plain(label)) } else { name };
            let name = unused(&name, |name| plots.contains_key(name));
            plots.insert(name, plot.draw());
        }
    }
    Ok(plots.into_iter().collect())
}

/// The curves of one protocol on one or several indices.
fn curves(results: &Results, presets: &[&PresetRecord]) -> Result<Option<OptimisationCurves>, ReportError> {
    let Some(first) = presets.first() else { return Ok(None) };
    let Some(metric) = first_metric(results, first) else { return Ok(None) };
    let protocol = first.protocol()?;
    let (aggregation, bins) = (protocol.aggregation, protocol.overlap_bins.filter(|bins| fit(bins, presets)));
    let study = Study { results, metric, aggregation, bins: bins.as_ref() };
    let Settings { placed, untimed, timed, scenes } = study.settings(presets);
    let panels: BTreeSet<&Panel> = placed.iter().map(|setting| &setting.panel).collect();
    let methods = curve_methods(&placed);
    let panels = panels.into_iter().filter_map(|panel| optimisation_panel(&placed, &methods, panel));
    let (panels, fewer): (Vec<OptimisationPanel>, Vec<Vec<FewerTargets>>) = panels.unzip();
    if panels.is_empty() {
        return Ok(None);
    }
    let mut notes = vec![
        "Points of one curve differ in the budget of their optimisation; the refinement starts from the network alone."
            .to_owned(),
    ];
    notes.extend(fewer_targets(&fewer.into_iter().flatten().collect::<Vec<_>>()));
    if !untimed.is_empty() {
        notes.push(format!("Not plotted, because no time was measured: {}.", untimed.join(", ")));
    }
    let random = placed.iter().filter(|setting| setting.method.untrained);
    let random = distinct(random.map(|setting| setting.title.as_str()));
    if !random.is_empty() {
        notes.push(format!("Random weights: {}.", random.join("; ")));
    }
    let busy = placed.iter().filter(|setting| setting.busy);
    let busy = distinct(busy.map(|setting| setting.title.as_str()));
    if !busy.is_empty() {
        notes.push(format!("{BUSY} {}.", busy.join("; ")));
    }
    let is_placed = |method: &str| placed.iter().any(|setting| setting.method.name == method);
    let is_shown = |preset: &str, method: &str| presets.iter().any(|known| known.name == preset) && is_placed(method);
    let lacking = unfinished(results, is_shown);
    if !lacking.is_empty() {
        notes.push(format!("Incomplete: {}.", lacking.join("; ")));
    }
    let scenes = counted(scenes.len() as u64, "scene");
    Ok(Some(OptimisationCurves {
        title: format!("{} against seconds of optimisation", metric.name),
        subtitle: format!("{} ({}); {scenes}{}", first.title, first.preset, timed.in_words()),
        quality: metric.into(),
        palette: methods.into_iter().map(|curve| curve.label).collect(),
        panels,
        note: notes.join(" "),
    }))
}

/// Whether bins are for the estimators of all overlaps: as in tables, others are in no bin.
fn fit(bins: &OverlapBins, presets: &[&PresetRecord]) -> bool {
    presets.iter().all(|preset| bins.mismatched_estimator(&preset.overlap_estimators).is_none())
}

/// The methods of a curve: those of a kind, and of one network if they refine one.
struct CurveMethods<'a> {
    label: String,
    kind: &'static str,
    network: Option<Network<'a>>,
}

impl CurveMethods<'_> {
    fn has(&self, setting: &PanelPoint<'_>) -> bool {
        setting.method.kind == self.kind && self.network.is_none_or(|network| setting.network() == network)
    }

    /// Whether it is the network that they refine, as far as that is known.
    fn starts_from(&self, setting: &PanelPoint<'_>) -> bool {
        let is_same = |network: Network<'_>| network.model.is_some() && setting.network() == network;
        setting.method.kind == NETWORK && self.network.is_some_and(is_same)
    }
}

/// The curves in the order of their colours, which those of further networks do not change. If several networks are refined, each has a
/// curve with its title.
fn curve_methods<'a>(placed: &[PanelPoint<'a>]) -> Vec<CurveMethods<'a>> {
    let [(kind, label), others @ ..] = OPTIMISED;
    let refined = || placed.iter().filter(|setting| setting.method.kind == kind);
    let networks = distinct(refined().map(PanelPoint::network));
    let are_several = networks.len() > 1;
    let of_network = |network: Network<'a>| {
        let is_same = |setting: &&PanelPoint<'a>| setting.network() == network;
        let alone = placed.iter().filter(|setting| setting.method.kind == NETWORK).find(is_same);
        let name = alone.or_else(|| refined().find(is_same)).filter(|_| are_several);
        let label = name.map_or_else(|| label.to_owned(), |named| format!("{label}, {}", named.title));
        CurveMethods { label, kind, network: Some(network) }
    };
    let mut of_networks = networks.into_iter().map(of_network);
    let without = CurveMethods { label: label.to_owned(), kind, network: None };
    let first = of_networks.next().unwrap_or(without);
    let others = others.map(|(kind, label)| CurveMethods { label: label.to_owned(), kind, network: None });
    std::iter::once(first).chain(others).chain(of_networks).collect()
}

/// The curves of one panel, and the points whose means are over fewer scenes or targets than others of the panel; `None`
/// without a curve of two points.
fn optimisation_panel(
    placed: &[PanelPoint<'_>],
    methods: &[CurveMethods<'_>],
    panel: &Panel,
) -> Option<(OptimisationPanel, Vec<FewerTargets>)> {
    let settings = || placed.iter().filter(|setting| setting.panel == *panel);
    let mut curves: Vec<(String, Vec<&PanelPoint<'_>>)> = Vec::new();
    for of_curve in methods.iter().filter(|of_curve| settings().any(|setting| of_curve.has(setting))) {
        let is_drawn = |setting: &&PanelPoint<'_>| of_curve.has(setting) || of_curve.starts_from(setting);
        let mut points: Vec<&PanelPoint<'_>> = settings().filter(is_drawn).collect();
        points.sort_by(|a, b| a.point.secs.total_cmp(&b.point.secs));
        curves.push((of_curve.label.clone(), points));
    }
    let is_curve = curves.iter().any(|(_, points)| points.len() > 1);
    let drawn = || curves.iter().flat_map(|(_, points)| points);
    let of_scenes = drawn().map(|setting| setting.scenes).max()?;
    let of_targets = drawn().map(|setting| setting.targets).max()?;
    let name = match panel {
        Panel::Views(views) => counted(*views as u64, "view"),
        Panel::Overlap(_, name) => format!("{name} overlap"),
    };
    let lacks = |setting: &&&PanelPoint<'_>| setting.scenes < of_scenes || setting.targets < of_targets;
    let lacking = drawn().filter(lacks).map(|setting| FewerTargets {
        title: format!("{} with {name}", setting.title),
        scenes: [setting.scenes, of_scenes],
        targets: [setting.targets, of_targets],
    });
    let lacking: Vec<FewerTargets> = lacking.collect();
    let curve = |(label, settings): (String, Vec<&PanelPoint<'_>>)| {
        let points: Vec<OptimisationPoint> = settings.into_iter().map(|setting| setting.point).collect();
        (label, points)
    };
    let name = format!("{name} · {}", counted(of_scenes, "scene"));
    let curves = curves.into_iter().map(curve).collect();
    is_curve.then_some((OptimisationPanel { name, curves }, lacking))
}
