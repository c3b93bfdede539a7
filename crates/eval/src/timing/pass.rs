use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use atsplat_files::unix_seconds;
use atsplat_numeric::{Extremes as _, spread};
use atsplat_protocol::trial::{ContextView, Prefetch, Trials};
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_results::Store;
use atsplat_results::times::{Load, Machine, TimingRow};
use rayon::ThreadPool;

use super::exclusion;
use super::load::{CountedTime, LoadMonitor};
use super::samples::{PreparedTrial, Samples};
use super::this_machine;
use crate::EvalError;
use crate::method::{Method, MethodError, Timed};
use crate::runner::{Dataset, Plan, Step, groups, key_of, trials_of};

/// How many trials are timed, and how often.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimingPlan {
    /// Trials per method and protocol, spread over the index; all if there are fewer.
    pub trials: u32,
    /// Warm-up repetitions of each trial, which do not count.
    pub warm_up: u32,
    /// A warm-up run whose timed parts take at least this long counts as a repetition, and no more follow, unless one of them
    /// takes a tenth longer than in the next run.
    pub warm_up_until: Duration,
    /// Minimum number of repetitions of each trial.
    pub repetitions: u32,
    /// Two repetitions are enough if each takes at least this long, so that a pass does not last for hours.
    pub long: Duration,
}

impl Default for TimingPlan {
    fn default() -> Self {
        Self { trials: 3, warm_up: 1, warm_up_until: LONG, repetitions: 5, long: LONG }
    }
}

impl TimingPlan {
    /// Whether this many repetitions with this total time suffice.
    pub(super) fn is_enough(&self, repetitions: usize, secs: f64) -> bool {
        repetitions >= self.repetitions as usize
            || (repetitions >= 2 && secs >= self.long.as_secs_f64() * repetitions as f64)
    }
}

/// Work of this duration varies little in relation to itself: fewer repetitions tell as much.
const LONG: Duration = Duration::from_secs(1);

/// Additional trials that are tried if a method rejects some.
const SPARE: usize = 8;

/// Times a plan's methods and adds the rows of each to the store as soon as it is timed. Undisturbed times of the same trials on the
/// same machine type are not measured again. `step` is called after each method and protocol. The pass stops between two
/// trials when `stop` returns true; the times of methods that were finished stay in the store.
///
/// # Errors
/// [`EvalError::Settings`] if the pass cannot have the process to itself or create its threads, [`EvalError::Io`],
/// [`EvalError::Stopped`].
pub(crate) fn pass(
    plan: &Plan<'_>,
    timing: TimingPlan,
    store: &Store,
    step: &(dyn Fn(Step<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(), EvalError> {
    let _exclusive = exclusion::exclusive()?;
    let machine = this_machine();
    let threads = rayon::current_num_threads();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| EvalError::Settings {
        what: "timing pass",
        expected: format!("a pool of {threads} threads"),
        found: error.to_string(),
    })?;
    let started = unix_seconds();
    let pass = Pass { plan, timing, store, machine, started, pool: &pool, step, stop };
    // On a thread outside any pool: a pool's thread would steal other work while it waits.
    let outcome = std::thread::scope(|scope| scope.spawn(|| pass.run()).join());
    outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

struct Pass<'a> {
    plan: &'a Plan<'a>,
    timing: TimingPlan,
    store: &'a Store,
    machine: Machine,
    started: u64,
    pool: &'a ThreadPool,
    step: &'a (dyn Fn(Step<'_>) + Sync),
    stop: &'a (dyn Fn() -> bool + Sync),
}

impl Pass<'_> {
    fn run(&self) -> Result<(), EvalError> {
        for dataset in self.plan.datasets {
            let index = self.plan.selected(dataset).index;
            for methods in groups(&dataset.preset, self.plan.methods) {
                self.dataset(dataset, &index, &methods)?;
            }
        }
        Ok(())
    }

    /// Times methods that share their trials.
    fn dataset(
        &self,
        dataset: &Dataset,
        index: &EvaluationIndex,
        methods: &[Arc<dyn Method>],
    ) -> Result<(), EvalError> {
        let known = self.store.timings()?;
        let requested = self.timing.trials as usize;
        // No more can be prepared: if all methods have as many times, no image is decoded.
        let most = requested.min(index.entries().count());
        let all = index.entries().count().min(requested + SPARE);
        let candidates = self.left(&known, dataset, methods.iter().collect(), most, &mut |tried: usize| tried >= all);
        if candidates.is_empty() {
            return Ok(());
        }
        let mut trials = TimingTrials::new(dataset, index, methods, requested);
        // Some entries have no trial.
        trials.prepare(requested);
        let prepared = trials.prepared.len();
        let are_all = &mut |tried: usize| tried >= requested + SPARE || trials.get(tried).is_none();
        let untimed = self.left(&known, dataset, candidates, prepared, are_all);
        // Images are decoded by now: decoding is part of neither the times nor the load.
        for method in untimed {
            let rows = self.method(dataset, &mut trials, method.as_ref())?;
            // At once, because a pass over many methods takes hours and may be killed.
            if !rows.is_empty() {
                for TimingRow { key, detail, .. } in self.store.add_timings(rows)? {
                    tracing::warn!(result = %key, why = detail.as_deref(), "not timed again: its earlier times stay");
                }
            }
            (self.step)(Step::Done);
        }
        Ok(())
    }

    fn check_stop(&self) -> Result<(), EvalError> {
        if (self.stop)() { Err(EvalError::Stopped) } else { Ok(()) }
    }

    /// The methods that are left to be timed on this many trials; every other one is a step that is done. `are_all` says
    /// whether this many trials are all that a method can be tried on.
    fn left<'m>(
        &self,
        known: &[TimingRow],
        dataset: &Dataset,
        methods: Vec<&'m Arc<dyn Method>>,
        trials: usize,
        are_all: &mut dyn FnMut(usize) -> bool,
    ) -> Vec<&'m Arc<dyn Method>> {
        let is_timed = |method: &&Arc<dyn Method>| {
            let (timed, tried) = self.known_trials(known, dataset, method.as_ref());
            timed >= trials || are_all(tried)
        };
        let (done, left): (Vec<_>, Vec<_>) = methods.into_iter().partition(is_timed);
        for _ in done {
            (self.step)(Step::Nothing);
        }
        left
    }

    /// On how many trials the known rows have what this pass would measure, and on how many the method was tried: those and the
    /// ones that it rejected. It did not reject a trial whose images it made when it was evaluated: it lacked memory, for instance.
    fn known_trials(&self, known: &[TimingRow], dataset: &Dataset, method: &dyn Method) -> (usize, usize) {
        let name = method.record().name;
        let is_of_pass = |row: &&TimingRow| row.key.is_of(&dataset.name, &name) && row.machine == self.machine;
        let (timed, mut rejected): (Vec<_>, Vec<_>) = known.iter().filter(is_of_pass).partition(|row| row.is_timed());
        let valid = |rows: &[&TimingRow]| rows.iter().filter(|row| self.is_valid(row)).count();
        rejected.retain(|row| method.timed() == Timed::NOTHING || !self.is_evaluated(row));
        match (valid(&timed), valid(&rejected)) {
            // Of a method that rejects every trial, only the first one has a row.
            (0, 1..) if timed.is_empty() => (0, usize::MAX),
            (timed, rejected) => (timed, timed + rejected),
        }
    }

    /// Whether the evaluation has scores of all targets of the row's trial.
    fn is_evaluated(&self, row: &TimingRow) -> bool {
        let known = self.store.known();
        known.trial(&row.key).is_some_and(|(_, targets)| known.scored(&row.key) == targets as usize)
    }

    /// Whether a row is of the trial as it is now, on a machine without other work, with as many repetitions as this pass makes.
    fn is_valid(&self, row: &TimingRow) -> bool {
        let Some((trial, targets)) = self.store.known().trial(&row.key) else { return false };
        let secs = row.encode.iter().chain(&row.render).sum();
        let is_enough = !row.is_timed() || self.timing.is_enough(row.repetitions(targets), secs);
        trial == row.trial_hash && !row.load.is_busy() && is_enough
    }

    /// The rows of one method: the requested number of timed trials and those that it rejected on the way, with the reason; if
    /// it rejects all, only the first that failed, or else the first.
    fn method(
        &self,
        dataset: &Dataset,
        trials: &mut TimingTrials,
        method: &dyn Method,
    ) -> Result<Vec<TimingRow>, EvalError> {
        let (requested, available) = (self.timing.trials as usize, trials.len());
        let (mut rows, mut rejected, mut first_failure) = (Vec::new(), Vec::new(), None);
        let timed = method.timed();
        for position in 0..requested + SPARE {
            self.check_stop()?;
            let Some(prepared) = trials.get(position) else { break };
            let (measured, load) = if timed.encoding || timed.rendering {
                self.measured(&dataset.preset, prepared, method)
            } else {
                (Err(MethodError::Failed("it imports finished images".to_owned())), Load::default())
            };
            // A trial that was interrupted was not rejected.
            self.check_stop()?;
            let mut row = TimingRow { load, ..self.row(dataset, prepared, method, available) };
            match measured {
                Ok(samples) => {
                    let Samples { warm_up, encode, render, stages, held_bytes, peak_bytes, .. } = samples;
                    rows.push(TimingRow { warm_up, encode, render, stages, held_bytes, peak_bytes, ..row });
                }
                Err(MethodError::Io(error)) => return Err(error.into()),
                Err(why) => {
                    if matches!(why, MethodError::Failed(_)) {
                        first_failure.get_or_insert(rejected.len());
                    }
                    row.detail = Some(why.to_string());
                    rejected.push(row);
                }
            }
            if rows.len() == requested || (!rejected.is_empty() && !timed.encoding && !timed.rendering) {
                break;
            }
        }
        // One row says why there are no times: a failure, if any, because it may pass.
        let (from, count) = if rows.is_empty() { (first_failure.unwrap_or(0), 1) } else { (0, rejected.len()) };
        rows.extend(rejected.into_iter().skip(from).take(count));
        Ok(rows)
    }

    /// Times one trial, and measures the machine's load meanwhile: a burst of other work affects one trial alone.
    fn measured(
        &self,
        preset: &Preset,
        prepared: &PreparedTrial,
        method: &dyn Method,
    ) -> (Result<Samples, MethodError>, Load) {
        let record = method.record();
        let is_cpu = record.network_adapter.is_none() && record.backend.is_none_or(|name| name.starts_with("cpu"));
        let counted = if is_cpu { CountedTime::Pool } else { CountedTime::Process };
        let outside = || method.process_secs().unwrap_or(0.0);
        let outside_before = outside();
        let monitor = LoadMonitor::start(self.pool, counted);
        let measured = self.pool.install(|| Samples::of(self.timing, preset, prepared, method));
        (measured, monitor.finish(|| (outside() - outside_before).maximum_of(0.0)))
    }

    fn row(&self, dataset: &Dataset, prepared: &PreparedTrial, method: &dyn Method, available: usize) -> TimingRow {
        let (trial, record) = (&prepared.trial, method.record());
        TimingRow {
            key: key_of(dataset, method, trial.scene(), trial.entry_number()),
            trial_hash: trial.hash().to_string(),
            machine: self.machine.clone(),
            network_adapter: record.network_adapter.as_ref().map(ToString::to_string),
            renderer_adapter: record.renderer_adapter.as_ref().map(ToString::to_string),
            started: self.started,
            trials_there: available as u64,
            warm_up: 0,
            encode: Vec::new(),
            render: Vec::new(),
            stages: [].into(),
            held_bytes: None,
            peak_bytes: None,
            load: Load::default(),
            detail: None,
        }
    }
}

/// Trials of a protocol, prepared lazily: first one entry of each scene spread over the index, then one of each other scene,
/// then further entries.
struct TimingTrials {
    scenes: VecDeque<Trials>,
    prepared: Vec<PreparedTrial>,
    available: usize,
}

impl TimingTrials {
    fn new(dataset: &Dataset, index: &EvaluationIndex, methods: &[Arc<dyn Method>], requested: usize) -> Self {
        let scenes: Vec<_> = index.scenes.iter().collect();
        let positions = dataset.index.index.first_positions();
        let first = spread(scenes.len(), requested);
        let order = first.iter().copied().chain((0..scenes.len()).filter(|at| !first.contains(at)));
        let of_scene = |(key, entries): &(&String, &Vec<IndexEntry>)| {
            let index = EvaluationIndex { scenes: [((*key).clone(), (*entries).clone())].into_iter().collect() };
            trials_of(dataset, &index, &positions, methods, Prefetch::NONE)
        };
        let scenes = order.filter_map(|at| scenes.get(at)).map(of_scene).collect();
        Self { scenes, prepared: Vec::new(), available: index.entries().count() }
    }

    /// Number of trials of the protocol, whether or not they can be prepared.
    const fn len(&self) -> usize {
        self.available
    }

    fn prepare(&mut self, count: usize) {
        while self.prepared.len() < count {
            let Some(mut trials) = self.scenes.pop_front() else { return };
            let Some(trial) = trials.next() else { continue };
            self.scenes.push_back(trials);
            // The evaluation has already recorded why a trial cannot be prepared.
            let Ok((trial, _)) = trial else { continue };
            let images: Result<Vec<_>, _> = trial.context().iter().map(ContextView::image).collect();
            self.prepared.extend(images.ok().map(|images| PreparedTrial { trial, images }));
        }
    }

    fn get(&mut self, position: usize) -> Option<&PreparedTrial> {
        self.prepare(position + 1);
        self.prepared.get(position)
    }
}
