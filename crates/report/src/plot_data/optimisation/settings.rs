use std::collections::BTreeSet;

use atsplat_metrics::Definition;
use atsplat_protocol::{Aggregation, OverlapBins};
use atsplat_results::statistics::{Identical, Leaked, MetricQuery, Summary, by_overlap, summary};
use atsplat_results::times::{GAUSSIANS_UNTIMED, times};
use atsplat_results::{MethodRecord, PresetRecord, Results, TrialRow, TrialStatus};
use serde_json::Value;

use super::{NETWORK, OPTIMISED};
use crate::plot::{Estimate, OptimisationPoint};
use crate::plot_data::subject::title_of;
use crate::plot_data::timed::Timed;

/// Which panel a point belongs to, in the panels' order.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Panel {
    Views(usize),
    /// Position and name of a bin of overlap.
    Overlap(usize, String),
}

/// A point of a method, and the panel that it belongs to.
pub(super) struct PanelPoint<'a> {
    pub(super) panel: Panel,
    pub(super) method: &'a MethodRecord,
    pub(super) title: String,
    pub(super) point: OptimisationPoint,
    /// Scenes in the mean.
    pub(super) scenes: u64,
    /// Targets in the mean.
    pub(super) targets: u64,
    /// Whether the machine was busy while it was timed.
    pub(super) busy: bool,
}

/// What tells a network from others: the hashes of its configuration and weights, or how these are generated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Network<'a> {
    pub(super) model: Option<&'a str>,
    weights: Option<&'a str>,
    seed: Option<&'a Value>,
    backbone: Option<&'a Value>,
}

impl<'a> PanelPoint<'a> {
    /// Its network, if it has one.
    pub(super) fn network(&self) -> Network<'a> {
        let MethodRecord { weights_sha256, parameters, .. } = self.method;
        Network {
            model: self.method.model_hash(),
            weights: weights_sha256.as_deref(),
            seed: parameters.get(MethodRecord::WEIGHTS_SEED),
            backbone: parameters.get(MethodRecord::BACKBONE_SHA256),
        }
    }
}

/// What is measured of a protocol.
#[derive(Clone, Copy)]
pub(super) struct Study<'a> {
    pub(super) results: &'a Results,
    pub(super) metric: &'static Definition,
    pub(super) aggregation: Aggregation,
    /// Bins of overlap, each with a separate panel.
    pub(super) bins: Option<&'a OverlapBins>,
}

/// The settings of a study.
#[derive(Default)]
pub(super) struct Settings<'a> {
    pub(super) placed: Vec<PanelPoint<'a>>,
    /// Titles of methods without a time, each with the reason.
    pub(super) untimed: Vec<String>,
    pub(super) timed: Timed,
    /// Scenes with results.
    pub(super) scenes: BTreeSet<&'a str>,
}

impl<'a> Study<'a> {
    /// The optimised methods and networks that were run under these presets.
    pub(super) fn settings(self, presets: &[&'a PresetRecord]) -> Settings<'a> {
        let is_optimised = |kind: &str| OPTIMISED.iter().any(|(known, _)| *known == kind);
        let methods = self.results.provenance.methods.iter();
        let methods = methods.filter(|method| is_optimised(&method.kind) || method.kind == NETWORK);
        let mut settings = Settings::default();
        for (method, preset) in methods.flat_map(|method| presets.iter().map(move |preset| (method, *preset))) {
            self.add(&mut settings, method, preset);
        }
        settings
    }

    fn add(self, settings: &mut Settings<'a>, method: &'a MethodRecord, preset: &'a PresetRecord) {
        let trials: Vec<&TrialRow> = self.results.trials_of(&preset.name, &method.name).collect();
        let Some(first) = trials.first() else { return };
        let found = self.means(method, preset, first.context.len());
        if found.iter().all(|(_, summary)| summary.mean.is_none()) {
            return;
        }
        let title = title_of(self.results, method);
        let timed = times(self.results, &preset.name, &method.name).and_then(|times| {
            let first_image = times.first_image.ok_or(GAUSSIANS_UNTIMED)?;
            Ok((times, first_image))
        });
        let (times, first_image) = match timed {
            Ok(timed) => timed,
            Err(why) => {
                settings.untimed.push(format!("{title} ({why})"));
                return;
            }
        };
        settings.timed.add(&title, &times.machine, times.device.as_deref());
        settings.timed.trials(&title, [times.trials, times.trials_there]);
        settings.timed.mark(None, times.busy);
        let has_results = |trial: &&&TrialRow| matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
        settings.scenes.extend(trials.iter().filter(has_results).map(|trial| trial.key.scene.as_str()));
        for (panel, found) in found {
            let Some(value) = found.mean else { continue };
            let is_in_panel = |trial: &&&TrialRow| match (&panel, self.bins) {
                (Panel::Overlap(_, name), Some(bins)) => {
                    trial.overlap.and_then(|overlap| bins.name_of(overlap)) == Some(name)
                }
                _ => true,
            };
            let psnrs: Vec<f64> = trials.iter().filter(is_in_panel).filter_map(|trial| trial.context_psnr).collect();
            settings.placed.push(PanelPoint {
                panel,
                method,
                title: title.clone(),
                scenes: found.scenes,
                targets: found.targets,
                busy: times.busy,
                point: OptimisationPoint {
                    secs: first_image.median,
                    held_out: Estimate { value, interval: found.interval },
                    context: (!psnrs.is_empty()).then(|| psnrs.iter().sum::<f64>() / psnrs.len() as f64),
                },
            });
        }
    }

    /// The means over targets that are not context views, which an optimisation fits.
    fn means(self, method: &MethodRecord, preset: &PresetRecord, views: usize) -> Vec<(Panel, Summary)> {
        let query = MetricQuery {
            preset: &preset.name,
            method: &method.name,
            metric: self.metric.id,
            leaked: Leaked::Excluded,
            identical: Identical::Excluded,
        };
        match self.bins {
            Some(bins) => {
                let binned = by_overlap(self.results, &query, bins, self.aggregation).bins.into_iter().enumerate();
                binned.map(|(at, (name, summary))| (Panel::Overlap(at, name), summary)).collect()
            }
            None => vec![(Panel::Views(views), summary(self.results, &query, self.aggregation))],
        }
    }
}
