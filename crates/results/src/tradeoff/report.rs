use std::collections::BTreeMap;
use std::fmt;

use atsplat_numeric::{counted, decimals_of_small};
use serde::Serialize;

use super::{Axis, Counts, Frontier, Incomplete, Point, Price, Standing, Tradeoff};
use crate::statistics::MIN_SCENES;
use crate::store::Unfinished;
use crate::times::Machine;

/// Frontiers of every protocol and metric. [`Display`](fmt::Display) prints them as tables with prices.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct TradeoffReport {
    /// One per protocol and metric.
    pub tradeoffs: Vec<Tradeoff>,
    /// Runs that were cut off: their means are over the trials that they reached, if any ([`crate::Results::cut_off`]).
    pub unfinished: Vec<Unfinished>,
}

impl TradeoffReport {
    /// Why there is no score at all: of the first setting, or because no method has a trial. `None` if any setting has a score.
    pub fn nothing_scored(&self) -> Option<String> {
        if self.tradeoffs.iter().any(Tradeoff::has_score) {
            return None;
        }
        let first = self.tradeoffs.iter().find_map(|Tradeoff { preset, metric, unscored, .. }| {
            unscored.first().map(|(label, why)| format!("{preset}, {metric}, {label}: {why}"))
        });
        Some(first.unwrap_or_else(|| "no method has a trial".to_owned()))
    }

    /// Why no frontier has a point: no setting has a cost, with the reasons of the first one. `None` if any frontier has a point, and
    /// if [`Self::nothing_scored`] says why.
    pub fn why_empty(&self) -> Option<String> {
        let mut frontiers = self.tradeoffs.iter().flat_map(|tradeoff| &tradeoff.frontiers);
        if frontiers.any(|frontier| !frontier.points.is_empty()) {
            return None;
        }
        let tradeoff = self.tradeoffs.iter().find(|tradeoff| tradeoff.has_score())?;
        let is_scored = |label: &str| tradeoff.unscored.iter().all(|(unscored, _)| unscored != label);
        let reason = |frontier: &Frontier| {
            let (label, why) = frontier.left_out.iter().find(|(label, _)| is_scored(label))?;
            Some(format!("; against {}, {label}: {why}", cost_name(frontier.axis)))
        };
        let reasons: Vec<String> = tradeoff.frontiers.iter().filter_map(reason).collect();
        Some(format!("no setting has a cost{}", reasons.concat()))
    }
}

/// What a frontier is against.
const fn cost_name(axis: Axis) -> &'static str {
    match axis {
        Axis::Seconds => "seconds",
        Axis::Gaussians => "Gaussians",
    }
}

impl fmt::Display for TradeoffReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, tradeoff) in self.tradeoffs.iter().enumerate() {
            let Tradeoff { preset, metric, unit, frontiers, machines, incomplete, notes, .. } = tradeoff;
            let are_stated = machines.iter().any(Machine::is_stated);
            for frontier in frontiers {
                let blank = if at == 0 && frontier.axis == Axis::Seconds { "" } else { "\n" };
                writeln!(f, "{blank}{preset}: {metric} against {}", cost_name(frontier.axis))?;
                points(f, frontier, are_stated)?;
                prices(f, frontier, unit)?;
            }
            incomplete.iter().try_for_each(|setting| writeln!(f, "  {setting}"))?;
            notes.iter().try_for_each(|note| writeln!(f, "  {note}"))?;
        }
        explanations(f, &self.tradeoffs)?;
        unfinished(f, &self.unfinished)
    }
}

fn unfinished(f: &mut fmt::Formatter<'_>, unfinished: &[Unfinished]) -> fmt::Result {
    let mut unreached: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for Unfinished { preset, method, entries, total, lacking, .. } in unfinished {
        if *entries == 0 {
            unreached.entry(preset).or_default().push(method);
            continue;
        }
        write!(f, "{preset}: the run of {method} is unfinished: ")?;
        match lacking {
            None => writeln!(f, "its means are over {entries} of {total} index entries")?,
            Some(metric) => writeln!(f, "{entries} of {total} index entries have {metric}")?,
        }
    }
    unreached.iter().try_for_each(|(preset, methods)| {
        writeln!(f, "{preset}: the run is unfinished: it has not reached {}", methods.join(", "))
    })
}

impl fmt::Display for Incomplete {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { label, counts, of_scenes, of_targets } = self;
        let Counts { scenes, targets, failed, not_applicable, non_finite, uncomputed, identical } = *counts;
        let reasons = [
            (failed, "failed"),
            (not_applicable, "not supported"),
            (non_finite, "not finite"),
            (uncomputed, "not computed"),
            (identical, "identical to the truth"),
        ];
        let reasons: Vec<String> =
            reasons.iter().filter(|(count, _)| *count > 0).map(|(count, why)| format!("{count} {why}")).collect();
        let reasons = if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join(", ")) };
        write!(
            f,
            "{label}: {scenes} of {of_scenes} scenes, {targets} of {of_targets} targets{reasons}: its mean is over fewer \
             targets than the others'"
        )
    }
}

/// The marks of seconds, each explained below.
const fn marks(whole_answer: bool, busy: bool) -> &'static str {
    match (whole_answer, busy) {
        (false, false) => "",
        (true, false) => "‡",
        (false, true) => "§",
        (true, true) => "‡§",
    }
}

/// Decimals of qualities and their differences.
const QUALITY_DECIMALS: usize = 4;

/// Decimals of a difference and its interval: enough to show that the interval excludes 0, if it does.
fn decimals_of_difference(interval: [f64; 2]) -> usize {
    match interval {
        [low, _] if low > 0.0 => decimals_of_small(low, QUALITY_DECIMALS),
        [_, high] if high < 0.0 => decimals_of_small(high, QUALITY_DECIMALS),
        _ => QUALITY_DECIMALS,
    }
}

/// `are_stated` says whether times were stated: such a time is a single number, without an interval over repetitions.
fn points(f: &mut fmt::Formatter<'_>, frontier: &Frontier, are_stated: bool) -> fmt::Result {
    let mut on_frontier = frontier.points.iter().filter(|point| point.on_frontier());
    let is_unsure = frontier.axis == Axis::Seconds && on_frontier.any(|point| point.busy);
    let knee = if is_unsure { ", knee§" } else { ", knee" };
    writeln!(f, "  {:<40} {:>10} {:>18} {:>12}  difference, 95 %", "", "quality", "ms", "Gaussians")?;
    for point in &frontier.points {
        let Point { label, quality, secs, secs_error, busy, whole_answer, gaussians, against, standing, .. } = point;
        let mark = match standing {
            Standing::Frontier => "*",
            Standing::Worse => " ",
            Standing::NotDistinguishable => "?",
        };
        let marks = marks(*whole_answer, *busy);
        let time = |secs: f64| {
            let decimals = decimals_of_small(1e3 * secs, 1);
            let error = if are_stated { String::new() } else { format!(" ±{:.decimals$}", 1e3 * secs_error) };
            format!("{:.decimals$}{error}{marks}", 1e3 * secs)
        };
        let ms = secs.map_or("-".to_owned(), time);
        let gaussians = gaussians.map_or("-".to_owned(), |count| format!("{count:.0}"));
        let difference = against.as_ref().map_or_else(String::new, |against| {
            let difference = against.difference;
            let decimals = difference.interval.map_or(QUALITY_DECIMALS, decimals_of_difference);
            let interval = difference.interval.map_or_else(
                || format!("no interval with fewer than {MIN_SCENES} scenes"),
                |[low, high]| format!("{low:+.decimals$} to {high:+.decimals$}"),
            );
            let unpaired = match difference.unpaired {
                0 => String::new(),
                count => format!(", without {} that only one of them has", counted(count, "target")),
            };
            format!("{:+.decimals$} ({interval}) from {}{unpaired}", difference.value, against.label)
        });
        let verdict = match standing {
            Standing::NotDistinguishable => ", not distinguishable",
            Standing::Frontier if frontier.knee.as_ref() == Some(label) => knee,
            Standing::Frontier | Standing::Worse => "",
        };
        writeln!(f, "{mark} {label:<40} {quality:>10.4} {ms:>18} {gaussians:>12}  {difference}{verdict}")?;
    }
    for (label, reason) in &frontier.left_out {
        writeln!(f, "- {label:<40} skipped: {reason}")?;
    }
    Ok(())
}

fn prices(f: &mut fmt::Formatter<'_>, frontier: &Frontier, unit: &str) -> fmt::Result {
    for price in &frontier.prices {
        let Price { from, to, gain, gain_interval: [low, high], step, secs, gaussians, .. } = price;
        let marks = marks(price.whole_answer, price.busy);
        let ms = secs
            .map(|secs| format!("{:+.decimals$} ms{marks}", 1e3 * secs, decimals = decimals_of_small(1e3 * secs, 1)));
        let gaussians =
            gaussians.map(|count| format!("{count:+.decimals$} Gaussians", decimals = decimals_of_small(count, 0)));
        let paid: Vec<String> = ms.into_iter().chain(gaussians).collect();
        let paid = if paid.is_empty() { "no measurable time".to_owned() } else { paid.join(" and ") };
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let decimals = decimals_of_difference([*low, *high]);
        writeln!(
            f,
            "  {from} to {to}, {gain:.decimals$}{unit} better ({low:.decimals$} to {high:.decimals$}): the next {step}{unit} for {paid}"
        )?;
    }
    if frontier.prices.is_empty() && frontier.points.len() > 1 {
        writeln!(f, "  no price: no costlier setting is distinguishably better")?;
    }
    Ok(())
}

fn explanations(f: &mut fmt::Formatter<'_>, tradeoffs: &[Tradeoff]) -> fmt::Result {
    writeln!(
        f,
        "\n* on the frontier: better than the previous one by more than the interval of their difference, over the same scenes.\n\
         ? not distinguishable from it. Milliseconds are of the timing pass: medians of encoding and of rendering one view, added\n\
         and averaged over the timed trials: until the first image. Gaussians are averaged over the trials that all settings finished."
    )?;
    let counts: BTreeMap<&str, (u64, u64)> =
        tradeoffs.iter().map(|tradeoff| (tradeoff.preset.as_str(), (tradeoff.leaked, tradeoff.targets))).collect();
    for (preset, (leaked, targets)) in counts.into_iter().filter(|(_, (leaked, _))| *leaked > 0) {
        writeln!(
            f,
            "{preset}: {leaked} of {targets} targets are context views, which an optimisation fits: `atsplat tradeoff STORE \
             --without-leaked` leaves them out."
        )?;
    }
    let mut machines: Vec<String> =
        tradeoffs.iter().flat_map(|tradeoff| &tradeoff.machines).map(ToString::to_string).collect();
    machines.sort();
    machines.dedup();
    machines.iter().try_for_each(|machine| writeln!(f, "Timed on {machine}."))?;
    let mut devices: BTreeMap<&String, Vec<&str>> = BTreeMap::new();
    for (device, labels) in tradeoffs.iter().flat_map(|tradeoff| &tradeoff.devices) {
        let all = devices.entry(device).or_default();
        for label in labels {
            if !all.contains(&label.as_str()) {
                all.push(label);
            }
        }
    }
    devices.iter().try_for_each(|(device, labels)| writeln!(f, "{}: {device}.", labels.join(", ")))?;
    let points = || tradeoffs.iter().flat_map(|tradeoff| &tradeoff.frontiers).flat_map(|frontier| &frontier.points);
    if points().any(|point| point.whole_answer) {
        writeln!(f, "‡ The whole answer of a process, with reading and writing of files.")?;
    }
    if points().any(|point| point.busy) {
        writeln!(f, "§ The machine was busy with other work: these times are not reliable.")?;
    }
    Ok(())
}
