use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::statistics::{Identical, Leaked, MetricQuery, Summary, by_overlap, summary};
use atsplat_eval::timing::times;
use atsplat_eval::{MethodRecord, PresetRecord, Results, TrialRow, TrialStatus};
use atsplat_protocol::OverlapBins;

use super::first_metric;
use crate::ReportError;
use crate::counted;
use crate::file_names::{plain, unused};
use crate::page::PlotSection;
use crate::plot::{Drawing, Estimate, OptimisationCurves, OptimisationPanel, OptimisationPoint};
use crate::table::{BUSY, Source};

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
    let plots = of_optimisation(sources)?;
    Ok((!plots.is_empty()).then(|| PlotSection {
        title: "Accuracy against time".to_owned(),
        hint: "From one pass of a network to minutes of optimisation of each scene: what more seconds buy, and where more \
               views are needed."
            .to_owned(),
        plots,
        before_tables: true,
    }))
}

/// The plots by name.
fn of_optimisation(sources: &[Source<'_>]) -> Result<Vec<(String, Drawing)>, ReportError> {
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
            // Stores are measured on their own: curves of two would mix machines.
            let name = if plots.contains_key(&name) { format!("{name}-{}", plain(label)) } else { name };
            let name = unused(&name, |name| plots.contains_key(name));
            plots.insert(name, plot.draw());
        }
    }
    Ok(plots.into_iter().collect())
}

/// Which panel a point belongs to, in the panels' order.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Panel {
    Views(usize),
    /// Position and name of a bin of overlap.
    Overlap(usize, String),
}

/// A point of a method, and the panel that it belongs to.
struct PanelPoint<'a> {
    panel: Panel,
    method: &'a MethodRecord,
    point: OptimisationPoint,
    scenes: u64,
}

impl<'a> PanelPoint<'a> {
    /// Hash of its network's configuration.
    fn model(&self) -> Option<&'a str> {
        self.method.parameters.get("model-hash").and_then(|hash| hash.as_str())
    }
}

/// The curves of one protocol on one or several indices.
fn curves(results: &Results, presets: &[&PresetRecord]) -> Result<Option<OptimisationCurves>, ReportError> {
    let Some(first) = presets.first() else { return Ok(None) };
    let Some(metric) = first_metric(results, &first.name) else { return Ok(None) };
    let protocol = first.protocol()?;
    let (aggregation, bins) = (protocol.aggregation, protocol.overlap_bins.filter(|bins| fit(bins, presets)));
    let is_optimised = |kind: &str| OPTIMISED.iter().any(|(own, _)| *own == kind);
    let (mut placed, mut untimed, mut busy) = (Vec::new(), Vec::new(), false);
    let (mut machines, mut devices, mut scenes) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    let methods = results.provenance.methods.iter();
    let methods = methods.filter(|method| is_optimised(&method.kind) || method.kind == NETWORK);
    for (method, preset) in methods.flat_map(|method| presets.iter().map(move |preset| (method, preset))) {
        let is_own = |trial: &&TrialRow| trial.key.preset == preset.name && trial.key.method == method.name;
        let trials: Vec<&TrialRow> = results.trials.iter().filter(is_own).collect();
        let Some(first) = trials.first() else { continue };
        let query = MetricQuery {
            preset: &preset.name,
            method: &method.name,
            metric: metric.id,
            // An optimisation fits its context views: only others are held out.
            leaked: Leaked::Excluded,
            identical: Identical::Excluded,
        };
        let found: Vec<(Panel, Summary)> = match &bins {
            Some(bins) => {
                let binned = by_overlap(results, &query, bins).bins.into_iter().enumerate();
                binned.map(|(at, (name, summary))| (Panel::Overlap(at, name), summary)).collect()
            }
            None => vec![(Panel::Views(first.context.len()), summary(results, &query, aggregation))],
        };
        if found.iter().all(|(_, summary)| summary.mean.is_none()) {
            continue;
        }
        let timed = times(results, &preset.name, &method.name).and_then(|times| {
            let first_image = times.first_image.ok_or("neither encoding nor rendering was timed")?;
            Ok((times, first_image))
        });
        let (times, first_image) = match timed {
            Ok(timed) => timed,
            Err(why) => {
                untimed.push(format!("{} ({why})", method.title));
                continue;
            }
        };
        busy |= times.busy;
        let has_results = |trial: &&&TrialRow| matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
        scenes.extend(trials.iter().filter(has_results).map(|trial| &trial.key.scene));
        machines.insert(times.machine);
        devices.extend(times.device);
        for (panel, found) in found {
            let Some(value) = found.mean else { continue };
            let is_in_panel = |trial: &&&TrialRow| match (&panel, &bins) {
                (Panel::Overlap(_, name), Some(bins)) => {
                    trial.overlap.and_then(|overlap| bins.name_of(overlap)) == Some(name)
                }
                _ => true,
            };
            let psnrs: Vec<f64> = trials.iter().filter(is_in_panel).filter_map(|trial| trial.context_psnr).collect();
            placed.push(PanelPoint {
                panel,
                method,
                scenes: found.scenes,
                point: OptimisationPoint {
                    secs: first_image.median,
                    held_out: Estimate { value, interval: found.interval },
                    context: (!psnrs.is_empty()).then(|| psnrs.iter().sum::<f64>() / psnrs.len() as f64),
                },
            });
        }
    }
    let panels: BTreeSet<&Panel> = placed.iter().map(|own| &own.panel).collect();
    let panels: Vec<OptimisationPanel> =
        panels.into_iter().filter_map(|panel| optimisation_panel(&placed, panel)).collect();
    if panels.is_empty() {
        return Ok(None);
    }
    let scenes = counted(scenes.len() as u64, "scene");
    let machines: String = machines.iter().map(|machine| format!("; timed on {machine}")).collect();
    let devices: String = devices.iter().map(|device| format!("; {device}")).collect();
    let mark = if busy { format!("; {BUSY} the machine was busy") } else { String::new() };
    let mut note =
        "Points of one curve differ in the budget of their optimisation; the refinement starts from the network alone."
            .to_owned();
    if placed.iter().any(|own| own.point.held_out.interval.is_some()) {
        note.push_str(" Bars: 95 % intervals over scenes.");
    }
    if !untimed.is_empty() {
        note.push_str(&format!(" Not plotted, because no time was measured: {}.", untimed.join(", ")));
    }
    Ok(Some(OptimisationCurves {
        title: format!("{} against seconds of optimisation", metric.name),
        subtitle: format!("{} ({}); {scenes}{machines}{devices}{mark}", first.title, first.preset),
        quality: metric.into(),
        palette: OPTIMISED.iter().map(|(_, label)| (*label).to_owned()).collect(),
        panels,
        note,
    }))
}

/// Whether bins are for the estimators of all overlaps: as in tables, others are in no bin.
fn fit(bins: &OverlapBins, presets: &[&PresetRecord]) -> bool {
    presets.iter().all(|preset| bins.mismatched_estimator(&preset.overlap_estimators).is_none())
}

/// The curves of one panel; `None` without a curve of two points.
fn optimisation_panel(placed: &[PanelPoint<'_>], panel: &Panel) -> Option<OptimisationPanel> {
    let own = || placed.iter().filter(|own| own.panel == *panel);
    let mut curves = Vec::new();
    for (kind, label) in OPTIMISED {
        let of_kind = || own().filter(|own| own.method.kind == kind);
        let is_start = |own: &&PanelPoint<'_>| {
            let is_refined = || own.model().is_some() && of_kind().any(|refined| refined.model() == own.model());
            kind == REFINEMENT && own.method.kind == NETWORK && is_refined()
        };
        let mut points: Vec<OptimisationPoint> = of_kind().chain(own().filter(is_start)).map(|own| own.point).collect();
        points.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        if of_kind().next().is_some() {
            curves.push((label.to_owned(), points));
        }
    }
    let is_curve = curves.iter().any(|(_, points)| points.len() > 1);
    let scenes = own().map(|own| own.scenes).max()?;
    let name = match panel {
        Panel::Views(views) => counted(*views as u64, "view"),
        Panel::Overlap(_, name) => format!("{name} overlap"),
    };
    let name = format!("{name} · {}", counted(scenes, "scene"));
    is_curve.then_some(OptimisationPanel { name, curves })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{atsplat, floor, preset, results, results_over};
    use atsplat_eval::{TargetRow, TrialKey};
    use atsplat_numeric::Tolerance;

    /// Two budgets of refinement and one of 3DGS, with the network that refinement starts from and a baseline.
    fn methods() -> Vec<MethodRecord> {
        let optimised = |name: &str, kind: &str| MethodRecord {
            kind: kind.to_owned(),
            parameters: [("model-hash".to_owned(), "1f".into())].into(),
            ..atsplat(name, |_| ())
        };
        vec![
            optimised("atsplat", "atsplat"),
            optimised("refined 10", "atsplat+refine"),
            optimised("refined 100", "atsplat+refine"),
            optimised("3dgs-100", "3dgs"),
            floor(),
        ]
    }

    /// With two views, by times of a stated order.
    #[test]
    fn budgets_of_one_method_are_a_curve_that_starts_from_the_network() {
        let mut own = results(vec![preset("re10k-2v-256")], methods());
        for timing in &mut own.timings {
            let secs = match timing.key.method.as_str() {
                "refined 100" => 3.0,
                "atsplat" => 0.1,
                _ => 0.5,
            };
            timing.encode = vec![secs; 5];
        }
        for trial in &mut own.trials {
            trial.context_psnr = (trial.key.method == "3dgs-100").then_some(41.5);
        }
        let curves = |own: &Results| curves(own, &own.provenance.presets.iter().collect::<Vec<_>>()).unwrap();
        let found = curves(&own).unwrap();
        let [panel] = &found.panels[..] else { panic!("{:?}", found.panels) };
        assert_eq!(panel.name, "2 views · 4 scenes");
        let lengths: Vec<(&str, usize)> = panel.curves.iter().map(|(label, own)| (label.as_str(), own.len())).collect();
        assert_eq!(lengths, [("ATSplat + refinement", 3), ("3DGS", 1)]);
        let refined = &panel.curves[0].1;
        assert!(refined[0].secs < refined[1].secs && 4.0 * refined[1].secs < refined[2].secs, "{refined:?}");
        assert_eq!((refined[0].context, panel.curves[1].1[0].context), (None, Some(41.5)));

        // Targets that are context views are not held out.
        let mut leaking = own.clone();
        leaking.targets.extend(own.targets.iter().map(|target| {
            let scores = target.scores.keys().map(|metric| (metric.clone(), 99.0)).collect();
            TargetRow { target: target.target + 50, leaked: true, scores, ..target.clone() }
        }));
        let values = |own: &Results| {
            let of_curve = |(_, points): &(String, Vec<OptimisationPoint>)| -> Vec<f64> {
                points.iter().map(|point| point.held_out.value).collect()
            };
            curves(own).unwrap().panels[0].curves.iter().flat_map(of_curve).collect::<Vec<f64>>()
        };
        Tolerance::EXACT.assert(values(&leaking), values(&own), "held out");

        own.timings.retain(|timing| timing.key.method != "refined 100");
        let note = curves(&own).unwrap().note;
        assert!(note.contains("Not plotted, because no time was measured: ") && !note.contains("interval"), "{note}");
        let mut many = results_over(vec![preset("re10k-2v-256")], methods(), 8);
        many.timings.iter_mut().for_each(|timing| timing.encode = vec![0.5; 5]);
        let note = curves(&many).unwrap().note;
        assert!(note.contains("95 % intervals"), "{note}");
        let alone = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), floor()]);
        assert!(curves(&alone).is_none());
        // The same protocol with three views, on an index of its own.
        let mut more = results(vec![preset("re10k-2v-256")], methods()[..4].to_vec());
        for (at, method) in more.provenance.methods.iter_mut().enumerate() {
            method.name = format!("{at} with three");
        }
        let renamed = |name: &str| format!("{} with three", methods().iter().position(|own| own.name == name).unwrap());
        more.provenance.presets[0].name.push_str("-3-views");
        let name = &more.provenance.presets[0].name;
        for trial in &mut more.trials {
            (trial.key.method, trial.key.preset) = (renamed(&trial.key.method), name.clone());
            trial.context = vec![0, 15, 30];
        }
        for target in &mut more.targets {
            (target.key.method, target.key.preset) = (renamed(&target.key.method), name.clone());
        }
        for timing in &mut more.timings {
            (timing.key.method, timing.key.preset) = (renamed(&timing.key.method), name.clone());
            timing.encode = vec![0.7; 5];
        }
        let mut both = own.clone();
        both.provenance.presets.extend(more.provenance.presets);
        both.provenance.methods.extend(more.provenance.methods);
        both.trials.extend(more.trials);
        both.targets.extend(more.targets);
        both.timings.extend(more.timings);
        let panels: Vec<String> = curves(&both).unwrap().panels.into_iter().map(|panel| panel.name).collect();
        assert_eq!(panels, ["2 views · 4 scenes", "3 views · 4 scenes"]);
        let source = |label| Source { label, results: &own };
        let names = of_optimisation(&[source("a"), source("b")]).unwrap();
        let names: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["optimisation-re10k-2v-256", "optimisation-re10k-2v-256-b"]);
    }

    #[test]
    fn bins_of_overlap_have_panels_of_their_own() {
        let mut overlap = results(vec![preset("re10k-overlap")], methods()[..4].to_vec());
        for (at, trial) in overlap.trials.iter_mut().enumerate() {
            trial.overlap = Some(if at % 2 == 0 { 0.2 } else { 0.7 });
            trial.context_psnr = Some(if at % 2 == 0 { 20.0 } else { 40.0 });
            if trial.key.scene == "aa11" {
                trial.status = TrialStatus::Partial;
            }
        }
        let of_trial = |key: &TrialKey| overlap.trials.iter().find(|trial| trial.key == *key).unwrap().overlap;
        let overlaps: Vec<_> = overlap.targets.iter().map(|target| of_trial(&target.key)).collect();
        overlap.targets.iter_mut().zip(overlaps).for_each(|(target, overlap)| target.overlap = overlap);
        overlap.timings.iter_mut().enumerate().for_each(|(at, timing)| timing.encode = vec![0.1 + at as f64; 5]);
        let OptimisationCurves { panels, subtitle, .. } =
            curves(&overlap, &[&overlap.provenance.presets[0]]).unwrap().unwrap();
        assert!(subtitle.contains("; 4 scenes"), "of both panels: {subtitle}");
        let shown: Vec<(&str, Option<f64>)> =
            panels.iter().map(|panel| (panel.name.as_str(), panel.curves[0].1[1].context)).collect();
        assert_eq!(shown, [("small overlap · 2 scenes", Some(20.0)), ("large overlap · 2 scenes", Some(40.0))]);
    }

    #[test]
    fn overlaps_of_another_estimator_are_in_no_bin() {
        let optimised = |name: &str| MethodRecord { kind: REFINEMENT.to_owned(), ..atsplat(name, |_| ()) };
        let panels = |overlap_estimators: Vec<String>| -> Vec<String> {
            let record = PresetRecord { overlap_estimators, ..preset("re10k-overlap") };
            let results = results(vec![record], vec![optimised("refined 10"), optimised("refined 100")]);
            let plot = curves(&results, &[&results.provenance.presets[0]]).unwrap().unwrap();
            plot.panels.into_iter().map(|panel| panel.name).collect()
        };
        let binned = panels(Vec::new());
        assert!(binned.iter().all(|name| name.contains(" overlap · ")), "{binned:?}");
        assert_eq!(panels(vec!["another".to_owned()]), ["2 views · 4 scenes"]);
    }
}
