use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::{Machine, Spread, TimingRow};
use crate::rows::placement;
use crate::{MethodRecord, Results, StatedSeconds, TrialKey, TrialRow};

/// Why a method has rendering times but no encoding times.
pub const NOTHING_ENCODED: &str = "the method makes no Gaussians from images";

/// Why a method has rendering times but no time to the first image.
pub const GAUSSIANS_UNTIMED: &str = "only its rendering was timed, not the making of its Gaussians";

/// Times of one method under one protocol on one machine type.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Times {
    /// The machine type.
    pub machine: Machine,
    /// What ran on a graphics adapter, and on which, such as `network and renderer on …`; `None` if everything ran on
    /// the CPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Trials that were timed.
    pub trials: u64,
    /// Their scenes and entries; empty if the times were stated.
    #[serde(skip)]
    pub timed: BTreeSet<(String, u32)>,
    /// Trials of the protocol: if all were timed, no more could be.
    pub trials_there: u64,
    /// Smallest number of repetitions of a trial.
    pub repetitions: u64,
    /// Warm-up repetitions.
    pub warm_up: u32,
    /// Seconds from context images to Gaussians.
    pub encode: Option<Spread>,
    /// Seconds per rendered image, a repetition's images averaged ([`TimingRow::secs_per_image`]).
    pub render: Option<Spread>,
    /// Seconds from context images to the first rendered image: the sum of both, or the only one of them. `None` for Gaussians of
    /// which only the rendering was timed ([`GAUSSIANS_UNTIMED`]).
    pub first_image: Option<Spread>,
    /// Seconds of the encoding's stages by name.
    pub stages: BTreeMap<String, Spread>,
    /// Peak memory of the process in bytes.
    pub peak_bytes: Option<u64>,
    /// Largest share of its processors that a trial's timing lacked ([`super::Load::others`]).
    pub others: Option<f64>,
    /// Whether that makes the times unreliable ([`super::Load::is_busy`]).
    pub busy: bool,
}

impl Times {
    /// Quartiles of [`Self::first_image`] over repetitions; `None` for times that were stated, which are single numbers.
    pub fn quartiles(&self) -> Option<[f64; 2]> {
        self.first_image.filter(|_| !self.machine.is_stated()).map(|spread| spread.quartiles)
    }

    /// Seconds of the encoding alone as a method in another process states them, in the stage `encode`; `None` unless it does so
    /// on every repetition of every timed trial. [`Self::encode`] covers its whole answer, with reading and writing of files.
    pub fn stated_encode(&self) -> Option<Spread> {
        let answers = self.encode?;
        self.stages.get("encode").copied().filter(|stated| stated.samples == answers.samples)
    }
}

/// A row with its trial.
type TimedTrial<'a> = (&'a TimingRow, &'a TrialRow);

/// A method's times under a protocol, on the protocol's machine ([`machine_of`]).
///
/// # Errors
/// Why there are none, as a human-readable message.
pub fn times(results: &Results, preset: &str, method: &str) -> Result<Times, String> {
    times_on(machine_of(results, preset).as_ref(), results, preset, method)
}

/// [`times`] on another machine; `None` if nothing was timed.
///
/// # Errors
/// As [`times`].
pub(crate) fn times_on(
    machine: Option<&Machine>,
    results: &Results,
    preset: &str,
    method: &str,
) -> Result<Times, String> {
    if let Some(stated) = stated(results, preset, method) {
        return Times::stated(stated, results, preset, method)
            .filter(|times| machine == Some(&times.machine))
            .ok_or_else(|| stated_elsewhere(stated, machine));
    }
    // The trial of a row, if it is still the one that was evaluated; other images make it another trial.
    let trials = results.trials_of(preset, method).map(|trial| ((&trial.key, trial.trial_hash.as_str()), trial));
    let trials: BTreeMap<(&TrialKey, &str), &TrialRow> = trials.collect();
    let of_method = results.timings.iter().filter(|row| row.key.is_of(preset, method));
    let timed = of_method.filter_map(|row| Some((row, *trials.get(&(&row.key, row.trial_hash.as_str()))?)));
    let all: Vec<TimedTrial<'_>> = timed.collect();
    let Some(machine) = machine else { return Err(untimed(results, method, &all)) };
    let on_machine = |(row, _): &TimedTrial<'_>| row.is_timed() && row.machine == *machine;
    let on_machine = last_of_each_trial(all.iter().copied().filter(on_machine));
    if on_machine.is_empty() {
        let elsewhere = all.iter().find(|(row, _)| row.is_timed());
        let message = |(row, _): &TimedTrial<'_>| format!("timed on another machine: {}", row.machine);
        return Err(elsewhere.map_or_else(|| untimed(results, method, &all), message));
    }
    // A pass counts the trials of its shard, or of a limit that a later run has extended.
    let there = results.trials_of(preset, method).count() as u64;
    Ok(Times::of(machine, &on_machine, there))
}

/// Why times that were stated are left out: others were measured, or are stated for another machine.
fn stated_elsewhere(stated: &StatedSeconds, machine: Option<&Machine>) -> String {
    let StatedSeconds { encode, machine: name, .. } = stated;
    match machine.filter(|machine| machine.is_stated() && machine.processor != *name) {
        Some(others) => format!("stated as {encode} s on {name}, while others are stated for {}", others.processor),
        None => format!("stated as {encode} s on {name}, not measured here"),
    }
}

/// Of several passes on one trial the last one counts. Shards of a run time different trials, each in another pass.
fn last_of_each_trial<'a>(all: impl Iterator<Item = TimedTrial<'a>>) -> Vec<TimedTrial<'a>> {
    let mut last: BTreeMap<&TrialKey, TimedTrial<'a>> = BTreeMap::new();
    for timed in all {
        let (row, _) = timed;
        let known = last.entry(&row.key).or_insert(timed);
        if row.started > known.0.started {
            *known = timed;
        }
    }
    last.into_values().collect()
}

impl Times {
    /// Joins the times of one method's trials, of which there is at least one; the method has `there` trials now.
    fn of(machine: &Machine, timed: &[TimedTrial<'_>], there: u64) -> Self {
        let rows: Vec<&TimingRow> = timed.iter().map(|(row, _)| *row).collect();
        let names: BTreeSet<&String> = rows.iter().flat_map(|row| row.stages.keys()).collect();
        let stage = |name: &String| {
            let samples = rows.iter().map(|row| row.stages.get(name).map_or(&[][..], Vec::as_slice));
            Some((name.clone(), Spread::of(samples)?))
        };
        let encode = Spread::of(rows.iter().map(|row| row.encode.as_slice()));
        let per_image: Vec<Vec<f64>> = timed.iter().map(|(row, trial)| row.secs_per_image(trial.targets)).collect();
        let render = Spread::of(per_image.iter().map(Vec::as_slice));
        let has_gaussians = timed.iter().any(|(_, trial)| trial.gaussians.is_some());
        let repetitions = timed.iter().map(|(row, trial)| row.repetitions(trial.targets) as u64);
        let device = |row: &&TimingRow| placement(row.network_adapter.as_deref(), row.renderer_adapter.as_deref());
        Self {
            machine: machine.clone(),
            // A method of a store has one device.
            device: rows.first().and_then(device),
            trials: rows.len() as u64,
            timed: rows.iter().map(|row| (row.key.scene.clone(), row.key.entry)).collect(),
            trials_there: rows.iter().fold(there, |most, row| most.max(row.trials_there)),
            repetitions: repetitions.fold(u64::MAX, u64::min),
            warm_up: rows.iter().fold(u32::MAX, |least, row| least.min(row.warm_up)),
            encode,
            render,
            first_image: match (encode, render) {
                (Some(encode), Some(render)) => Some(encode.plus(render)),
                (None, Some(_)) if has_gaussians => None,
                (encode, render) => encode.or(render),
            },
            stages: names.into_iter().filter_map(stage).collect(),
            peak_bytes: rows.iter().filter_map(|row| row.peak_bytes).max(),
            others: rows.iter().filter_map(|row| row.load.others).max_by(f64::total_cmp),
            busy: rows.iter().any(|row| row.load.is_busy()),
        }
    }

    /// The times of a method as its user states them; `None` if it has no trial.
    fn stated(stated: &StatedSeconds, results: &Results, preset: &str, method: &str) -> Option<Self> {
        let StatedSeconds { encode, render, .. } = stated;
        let once = |secs: f64| Spread::of(std::iter::once(&[secs][..]));
        let (encode, render) = (once(*encode)?, render.and_then(once));
        let trials = results.trials_of(preset, method).count() as u64;
        (trials > 0).then(|| Self {
            machine: stated.machine(),
            device: None,
            trials,
            timed: BTreeSet::new(),
            trials_there: trials,
            repetitions: 1,
            warm_up: 0,
            encode: Some(encode),
            render,
            first_image: Some(render.map_or(encode, |render| encode.plus(render))),
            stages: BTreeMap::new(),
            peak_bytes: None,
            others: None,
            busy: false,
        })
    }
}

fn stated<'a>(results: &'a Results, preset: &str, method: &str) -> Option<&'a StatedSeconds> {
    results.provenance.method(method)?.stated.get(preset)?.seconds.as_ref()
}

/// The machine on which a protocol's methods are compared: the one with the most timed trials, or without any the one for which
/// most methods state their times; the first in order if tied. `None` if there are no times.
pub fn machine_of(results: &Results, preset: &str) -> Option<Machine> {
    measured_on(results, preset).or_else(|| stated_on(results, preset))
}

/// The trials of all protocols that were timed, each once for every machine on which it was.
pub(crate) fn timed_trials(results: &Results) -> BTreeSet<(&TrialKey, &Machine)> {
    let timed = || results.timings.iter().filter(|row| row.is_timed());
    let hashes: BTreeSet<(&TrialKey, &str)> = timed().map(|row| (&row.key, row.trial_hash.as_str())).collect();
    // Other images make a trial another one, whose times are not used. Few of many trials are timed.
    let trials = results.trials.iter().map(|trial| (&trial.key, trial.trial_hash.as_str()));
    let there: BTreeSet<(&TrialKey, &str)> = trials.filter(|trial| hashes.contains(trial)).collect();
    let rows = timed().filter(|row| there.contains(&(&row.key, row.trial_hash.as_str())));
    rows.map(|row| (&row.key, &row.machine)).collect()
}

fn measured_on(results: &Results, preset: &str) -> Option<Machine> {
    let timed = timed_trials(results).into_iter().filter(|(key, _)| key.preset == preset);
    most_frequent(timed.map(|(_, machine)| machine.clone()))
}

fn stated_on(results: &Results, preset: &str) -> Option<Machine> {
    let has_trials = |method: &str| results.trials_of(preset, method).next().is_some();
    let methods = results.provenance.methods.iter();
    let stating = methods.filter_map(|method| Some((method.name.as_str(), stated(results, preset, &method.name)?)));
    // Few methods state a time, and trials are many.
    most_frequent(stating.filter(|&(method, _)| has_trials(method)).map(|(_, seconds)| seconds.machine()))
}

fn most_frequent(machines: impl Iterator<Item = Machine>) -> Option<Machine> {
    let mut counts: BTreeMap<Machine, usize> = BTreeMap::new();
    for machine in machines {
        *counts.entry(machine).or_default() += 1;
    }
    let most = counts.values().copied().max()?;
    counts.into_iter().find(|(_, count)| *count == most).map(|(machine, _)| machine)
}

fn untimed(results: &Results, method: &str, all: &[TimedTrial<'_>]) -> String {
    if let Some(reason) = all.iter().find_map(|(row, _)| row.detail.as_ref()) {
        return reason.clone();
    }
    if results.provenance.method(method).is_some_and(MethodRecord::has_finished_images) {
        return "it imports finished images".to_owned();
    }
    if results.provenance.schema_version < FIRST_WITH_TIMINGS {
        return "the store was written by an older atsplat, which measured times while other trials ran: run again with --timing"
            .to_owned();
    }
    "no timing pass was made: `atsplat run --timing` makes one".to_owned()
}

/// The first schema version with a table of times.
const FIRST_WITH_TIMINGS: u32 = 2;

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::StatedCost;
    use crate::sample_rows::{PRESET, results, timing};
    use crate::times::Load;

    #[test]
    fn times_come_from_one_machine_and_the_last_pass_on_each_trial() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0]), ("z", 0, vec![20.0])]);
        store.provenance.schema_version = 2;
        let on = |name: &str, scene: &str, started, secs: f64| {
            let mut row = timing("a", scene, &[secs], &[0.25]);
            row.machine.processor = name.to_owned();
            TimingRow { started, ..row }
        };
        store.timings =
            vec![on("slow", "x", 5, 9.0), on("fast", "x", 5, 2.0), on("fast", "y", 5, 4.0), on("fast", "x", 9, 1.0)];
        let found = times(&store, PRESET, "a").unwrap();
        assert_eq!((found.machine.processor.as_str(), found.trials, found.trials_there), ("fast", 2, 3));
        let secs = [found.encode, found.render, found.first_image].map(|spread| spread.unwrap().median);
        Tolerance::F64.assert(secs, [2.5, 0.25, 2.75], "encoding, rendering and both: 1 s of x and 4 s of y");
        assert!(!found.busy);
        store.timings[3].load.others = Some(0.3);
        assert!(times(&store, PRESET, "a").unwrap().busy);
        // The trial has other images now.
        store.timings[3].trial_hash = "another".to_owned();
        let earlier = times(&store, PRESET, "a").unwrap();
        assert_eq!((earlier.trials, earlier.encode.unwrap().samples, earlier.busy), (2, 2, false));
        Tolerance::F64.assert([earlier.encode.unwrap().median], [3.0], "2 s of x and 4 s of y");
    }

    /// Three passes on one trial, and two on a trial that has other images now, against one on each of two.
    #[test]
    fn the_machine_is_that_of_most_trials_not_of_most_rows() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        let on = |name: &str, scene: &str, started| {
            let mut row = timing("a", scene, &[1.0], &[0.25]);
            row.machine.processor = name.to_owned();
            TimingRow { started, ..row }
        };
        let outdated = |started| TimingRow { trial_hash: "another".to_owned(), ..on("a card", "y", started) };
        store.timings = vec![on("two cards", "x", 1), on("two cards", "y", 1)];
        store.timings.extend([
            on("a card", "x", 1),
            on("a card", "x", 2),
            on("a card", "x", 3),
            outdated(1),
            outdated(2),
        ]);
        assert_eq!(machine_of(&store, PRESET).unwrap().processor, "two cards");
        store.trials.clear();
        assert_eq!(machine_of(&store, PRESET), None, "no row is of a trial");
    }

    /// Images of 10, 20 and 60 ms, in the second repetition 6 ms slower and in the third one 3 ms.
    #[test]
    fn images_of_one_repetition_are_no_repetitions() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0; 4])]);
        let repetition = |slower: f64| [0.01, 0.02, 0.06].map(|secs| secs + slower);
        store.timings = vec![timing("a", "x", &[], &[0.0, 0.006, 0.003].map(repetition).concat())];
        let found = times(&store, PRESET, "a").unwrap();
        let render = found.render.unwrap();
        Tolerance::F64.assert(
            [render.median, render.mad],
            [0.033, 0.003],
            "the mean of three images, and its repetitions",
        );
        Tolerance::F64.assert(render.quartiles, [0.0315, 0.0345], "quartiles");
        assert_eq!((render.samples, found.repetitions), (3, 3));
        assert!(render.error < 0.01, "{} s", render.error);
    }

    /// Fewest repetitions and warm-ups, most memory and load, whichever trial has them.
    #[test]
    fn trials_that_differ_are_joined_by_their_extremes() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        let busy = Load { others: Some(0.4), ..Load::default() };
        let short = timing("a", "x", &[1.0; 3], &[0.25; 3]);
        let long = timing("a", "y", &[1.0; 5], &[0.25; 5]);
        store.timings = vec![
            TimingRow { warm_up: 2, trials_there: 7, load: busy, ..short },
            TimingRow { peak_bytes: Some(2 << 20), ..long },
        ];
        let found = times(&store, PRESET, "a").unwrap();
        assert_eq!((found.repetitions, found.warm_up, found.trials_there), (3, 1, 7));
        assert_eq!((found.peak_bytes, found.others, found.busy), (Some(2 << 20), Some(0.4), true));
    }

    /// Two scenes by a limit, which was extended later without timing.
    #[test]
    fn trials_that_were_added_after_a_pass_are_there() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0]), ("z", 0, vec![20.0])]);
        store.timings = ["x", "y"].map(|scene| TimingRow { trials_there: 2, ..timing("a", scene, &[1.0], &[]) }).into();
        let found = times(&store, PRESET, "a").unwrap();
        assert_eq!((found.trials, found.trials_there), (2, 3));
        store.trials.pop();
        assert_eq!(times(&store, PRESET, "a").unwrap().trials_there, 2);
    }

    /// Each shard times other trials, in another pass.
    #[test]
    fn the_passes_of_all_shards_count() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0]), ("z", 0, vec![20.0])]);
        let of_shard = |scene: &str, started, secs: f64| TimingRow { started, ..timing("a", scene, &[secs], &[0.25]) };
        store.timings = vec![of_shard("x", 5, 1.0), of_shard("y", 7, 2.0), of_shard("z", 6, 9.0)];
        for row in &mut store.timings {
            row.trials_there = 1;
        }
        let found = times(&store, PRESET, "a").unwrap();
        assert_eq!((found.trials, found.trials_there, found.encode.unwrap().samples), (3, 3, 3));
        Tolerance::F64.assert([found.encode.unwrap().median], [4.0], "the mean of three trials");
    }

    /// Gaussians that another program made: nobody knows how long that took.
    #[test]
    fn rendering_alone_is_no_time_to_the_first_image_of_gaussians() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
        store.timings = vec![timing("a", "x", &[], &[0.25, 0.5, 0.75])];
        let imported = times(&store, PRESET, "a").unwrap();
        assert_eq!((imported.encode, imported.first_image), (None, None));
        Tolerance::F64.assert([imported.render.unwrap().median], [0.5], "an image");
        store.trials[0].gaussians = None;
        let without = times(&store, PRESET, "a").unwrap();
        assert_eq!(without.first_image, without.render, "the nearest view has nothing to make");
    }

    #[test]
    fn times_name_the_adapters_of_network_and_renderer() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
        let mut device = |network: Option<&str>, renderer: Option<&str>| {
            let [network_adapter, renderer_adapter] = [network, renderer].map(|name| name.map(str::to_owned));
            store.timings = vec![TimingRow { network_adapter, renderer_adapter, ..timing("a", "x", &[1.0], &[0.5]) }];
            times(&store, PRESET, "a").unwrap().device
        };
        assert_eq!(device(None, None), None);
        assert_eq!(device(Some("A"), Some("A")).as_deref(), Some("network and renderer on A"));
        assert_eq!(device(Some("A"), Some("B")).as_deref(), Some("network on A, renderer on B"));
        assert_eq!(device(Some("A"), None).as_deref(), Some("network on A"));
        assert_eq!(device(None, Some("B")).as_deref(), Some("renderer on B"));
    }

    #[test]
    fn an_encoder_is_stated_on_every_repetition_of_every_trial() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        let stating = |scene: &str, encoder: &[f64]| {
            let stages = [("encode".to_owned(), encoder.to_vec()), ("read".to_owned(), vec![0.5; 3])];
            TimingRow { stages: stages.into(), ..timing("a", scene, &[1.0, 2.0, 3.0], &[0.25]) }
        };
        store.timings = vec![stating("x", &[0.1, 0.2, 0.3]), stating("y", &[0.4, 0.5, 0.6])];
        let both = times(&store, PRESET, "a").unwrap();
        let medians = [both.stated_encode(), both.encode].map(|spread| spread.unwrap().median);
        Tolerance::F64.assert(medians, [0.35, 2.0], "the encoder, and the whole answer");
        store.timings[1].stages.clear();
        let one = times(&store, PRESET, "a").unwrap();
        assert_eq!((one.stated_encode(), one.stages["encode"].samples), (None, 3), "y does not state it");
        store.timings[1] = TimingRow { encode: Vec::new(), ..stating("y", &[]) };
        store.timings[0].encode.clear();
        assert_eq!(times(&store, PRESET, "a").unwrap().stated_encode(), None, "nothing was encoded");
    }

    #[test]
    fn missing_times_have_a_reason() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
        store.provenance.schema_version = 1;
        assert!(times(&store, PRESET, "a").unwrap_err().contains("while other trials ran"));
        store.provenance.schema_version = 2;
        assert!(times(&store, PRESET, "a").unwrap_err().contains("run --timing"));
        let finished = MethodRecord { name: "a".to_owned(), kind: "renders".to_owned(), ..MethodRecord::default() };
        store.provenance.methods.push(finished);
        assert_eq!(times(&store, PRESET, "a").unwrap_err(), "it imports finished images");
        store.timings = vec![TimingRow { detail: Some("out of memory".to_owned()), ..timing("a", "x", &[], &[]) }];
        assert_eq!(times(&store, PRESET, "a").unwrap_err(), "out of memory");
        let mut elsewhere = timing("b", "x", &[1.0], &[]);
        elsewhere.machine.processor = "another".to_owned();
        store.timings = vec![elsewhere, timing("a", "x", &[1.0], &[])];
        store.trials.push(TrialRow { key: store.timings[0].key.clone(), ..store.trials[0].clone() });
        let is_timed = [times(&store, PRESET, "a"), times(&store, PRESET, "b")].map(|found| found.is_ok());
        assert_eq!(is_timed.iter().filter(|timed| **timed).count(), 1, "rows of two machines are not compared");
    }

    /// Methods a and b, of which b has imported images that took 0.5 s and 0.01 s on a card.
    fn with_stated() -> Results {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        let imported = results("b", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        store.trials.extend(imported.trials);
        store.targets.extend(imported.targets);
        let seconds = Some(StatedSeconds { encode: 0.5, render: Some(0.01), machine: "a card".to_owned() });
        let stated = BTreeMap::from([(PRESET.to_owned(), StatedCost { gaussians: Some(7), seconds })]);
        store.provenance.methods = [("a", BTreeMap::new()), ("b", stated)]
            .map(|(name, stated)| MethodRecord { name: name.to_owned(), stated, ..MethodRecord::default() })
            .into();
        store
    }

    #[test]
    fn stated_times_are_shown_unless_something_was_measured() {
        let mut store = with_stated();
        store.provenance.schema_version = FIRST_WITH_TIMINGS;
        let found = times(&store, PRESET, "b").unwrap();
        let secs = [found.encode, found.render, found.first_image].map(|spread| spread.unwrap().median);
        Tolerance::F64.assert(secs, [0.5, 0.01, 0.51], "encoding, rendering and both");
        assert_eq!((found.trials, found.trials_there, found.machine.is_stated()), (2, 2, true));
        assert_eq!(found.quartiles(), None, "a mean without repetitions");
        assert_eq!(found.machine.to_string(), "a card (stated, not measured here)");
        let other = times(&store, PRESET, "a").unwrap_err();
        assert!(other.contains("no timing pass"), "{other}");
        store.timings = vec![timing("a", "x", &[1.0], &[0.25])];
        assert!(!machine_of(&store, PRESET).unwrap().is_stated());
        let why = times(&store, PRESET, "b").unwrap_err();
        assert_eq!(why, "stated as 0.5 s on a card, not measured here");
    }

    #[test]
    fn times_of_other_stated_machines_are_not_compared() {
        let mut store = with_stated();
        let mut other = store.provenance.methods[1].clone();
        other.name = "a".to_owned();
        let seconds = other.stated.get_mut(PRESET).and_then(|stated| stated.seconds.as_mut());
        seconds.unwrap().machine = "another card".to_owned();
        store.provenance.methods[0] = other;
        assert_eq!(machine_of(&store, PRESET).unwrap().processor, "a card", "the first in order");
        let why = times(&store, PRESET, "a").unwrap_err();
        assert_eq!(why, "stated as 0.5 s on another card, while others are stated for a card");
        assert!(times(&store, PRESET, "b").is_ok());
    }
}
