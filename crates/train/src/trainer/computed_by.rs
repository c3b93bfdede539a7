//! What computes a run, compared with its last checkpoint: another adapter is an error; another processor, driver or build is a notice.

use atsplat_splat::cpu;
use atsplat_splat::gpu::AdapterDescription;

use crate::TrainError;
use crate::checkpoint::State;

/// Between the drivers, and between the builds, that computed a run one after the other.
const THEN: &str = "; ";

/// What computes the next steps of a run.
#[derive(Debug)]
pub(super) struct ComputedBy {
    /// The type of processor.
    processor: String,
    /// The graphics adapter; `None` for the CPU.
    adapter: Option<AdapterDescription>,
    /// Version of the program, and commit if it is known.
    build: String,
}

/// What a run goes on from.
#[derive(Debug)]
pub(super) struct Resumed {
    /// The checkpoint's state, with what computes the next steps.
    pub(super) state: State,
    /// What has changed.
    pub(super) notices: Vec<String>,
    /// Whether the type of processor has.
    pub(super) processor_changed: bool,
}

impl ComputedBy {
    /// This processor and program, whose commit is given if it is known.
    pub(super) fn new(adapter: Option<AdapterDescription>, commit: Option<&str>) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        let build = commit.map_or_else(|| version.to_owned(), |commit| format!("{version} ({commit})"));
        Self { processor: cpu::processor(), adapter, build }
    }

    /// The state of a new run.
    pub(super) fn start(&self, state: State) -> State {
        State {
            adapter: self.adapter.as_ref().map(with_driver),
            processor: Some(self.processor.clone()),
            builds: Some(self.build.clone()),
            ..state
        }
    }

    /// The state of a run that goes on.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if it was computed on another adapter, or on the CPU instead of one.
    pub(super) fn resume(&self, state: State) -> Result<Resumed, TrainError> {
        let (adapter, other_driver) = self.adapter_after(state.adapter.as_deref())?;
        // A checkpoint of an earlier version does not state it.
        let processor = state.processor.as_deref().filter(|processor| *processor != self.processor);
        let other_processor = processor.map(|before| changed("on another type of processor", before, &self.processor));
        let processor_changed = other_processor.is_some();
        // Nor its build, which was another one.
        let builds = state.builds.as_deref().unwrap_or("not stated");
        let (builds, build_before) = followed_by(builds, &self.build);
        let other_build = build_before.map(|before| changed("by another build of this program", before, &self.build));
        let notices = [other_processor, other_driver, other_build].into_iter().flatten().collect();
        let state = State { adapter, processor: Some(self.processor.clone()), builds: Some(builds), ..state };
        Ok(Resumed { state, notices, processor_changed })
    }

    /// The adapter of a run that goes on, with all of its drivers, and a notice if the driver is another one.
    fn adapter_after(&self, recorded: Option<&str>) -> Result<(Option<String>, Option<String>), TrainError> {
        if recorded.is_none() && self.adapter.is_none() {
            return Ok((None, None));
        }
        let drivers = recorded.zip(self.adapter.as_ref()).and_then(|(recorded, adapter)| {
            let drivers = recorded.strip_prefix(&format!("{adapter}, "))?;
            Some((adapter, drivers))
        });
        let Some((adapter, drivers)) = drivers else {
            let name = |adapter: Option<String>| adapter.unwrap_or_else(|| "the CPU".to_owned());
            let expected = format!("{}, on which the run was started", name(recorded.map(str::to_owned)));
            let found = name(self.adapter.as_ref().map(with_driver));
            return Err(TrainError::malformed("checkpoint", "adapter", expected, found));
        };
        let (drivers, driver_before) = followed_by(drivers, &adapter.driver);
        let notice = driver_before.map(|before| changed("with another driver of the adapter", before, &adapter.driver));
        Ok((Some(format!("{adapter}, {drivers}")), notice))
    }
}

/// An adapter as checkpoints and weights name it.
pub(super) fn with_driver(adapter: &AdapterDescription) -> String {
    format!("{adapter}, {}", adapter.driver)
}

/// That a part of what computed the checkpoint has changed.
fn changed(part: &str, before: &str, now: &str) -> String {
    format!(
        "the checkpoint was computed {part}, {before}, now {now}: the run may not end bit for bit as it would have without the \
         change"
    )
}

/// Those that computed a run one after the other, with the one that goes on with it; and the last before it, if that is another.
fn followed_by<'a>(all: &'a str, now: &str) -> (String, Option<&'a str>) {
    if all == now || all.ends_with(&format!("{THEN}{now}")) {
        return (all.to_owned(), None);
    }
    let last = all.rsplit_once(THEN).map_or(all, |(_, last)| last);
    (format!("{all}{THEN}{now}"), Some(last))
}

#[cfg(test)]
mod tests {
    use atsplat_splat::gpu::AdapterKind;

    use super::*;
    use crate::parameters::Parameters;

    fn card(name: &str, driver: &str) -> AdapterDescription {
        AdapterDescription {
            name: name.to_owned(),
            backend: "Vulkan".to_owned(),
            kind: AdapterKind::Discrete,
            driver: driver.to_owned(),
            largest_binding: 0,
            largest_buffer: 0,
            storage_buffers: 0,
            workgroups: 0,
            timestamps: false,
        }
    }

    fn fresh() -> State {
        State::new(Parameters::of_values(Vec::new(), Vec::new()))
    }

    #[test]
    fn another_driver_is_noted_and_recorded_and_another_adapter_is_an_error() {
        let on = |adapter| ComputedBy::new(adapter, Some("a1"));
        let mut state = on(Some(card("RTX 1", "nvidia 570"))).start(fresh());
        for (driver, before, recorded) in [
            ("nvidia 570", None, "RTX 1 (Vulkan), nvidia 570"),
            ("nvidia 580", Some("nvidia 570"), "RTX 1 (Vulkan), nvidia 570; nvidia 580"),
            ("nvidia 580", None, "RTX 1 (Vulkan), nvidia 570; nvidia 580"),
            ("nvidia 570", Some("nvidia 580"), "RTX 1 (Vulkan), nvidia 570; nvidia 580; nvidia 570"),
        ] {
            let resumed = on(Some(card("RTX 1", driver))).resume(state).unwrap();
            let notice = |before: &str| {
                format!(
                    "the checkpoint was computed with another driver of the adapter, {before}, now {driver}: the run may not end \
                     bit for bit as it would have without the change"
                )
            };
            assert_eq!(resumed.notices, before.map(notice).into_iter().collect::<Vec<_>>());
            assert_eq!(resumed.state.adapter.as_deref(), Some(recorded));
            assert!(!resumed.processor_changed);
            state = resumed.state;
        }
        let cpu = on(None).start(fresh());
        assert_eq!(cpu.adapter, None);
        assert_eq!(on(None).resume(cpu.clone()).unwrap().state.adapter, None);
        let started = "RTX 1 (Vulkan), nvidia 570; nvidia 580; nvidia 570";
        for (state, now, started, found) in [
            (&state, Some(card("RTX 2", "nvidia 570")), started, "RTX 2 (Vulkan), nvidia 570"),
            (&state, Some(card("RTX", "nvidia 570")), started, "RTX (Vulkan), nvidia 570"),
            (&state, None, started, "the CPU"),
            (&cpu, Some(card("RTX 1", "nvidia 570")), "the CPU", "RTX 1 (Vulkan), nvidia 570"),
        ] {
            let error = on(now).resume(state.clone()).unwrap_err().to_string();
            let expected = format!("adapter: expected {started}, on which the run was started, found {found}");
            assert!(error.ends_with(&expected), "{error}");
        }
    }

    #[test]
    fn every_build_of_a_run_is_recorded_in_order() {
        let version = env!("CARGO_PKG_VERSION");
        let [first, second] = ["a1", "b2+c3"].map(|commit| ComputedBy::new(None, Some(commit)));
        let mut state = first.start(fresh());
        assert_eq!(state.builds, Some(format!("{version} (a1)")));
        for (build, noted) in [(&first, false), (&second, true), (&second, false)] {
            let resumed = build.resume(state).unwrap();
            let notice = format!("another build of this program, {version} (a1), now {version} (b2+c3): ");
            assert_eq!(resumed.notices.len(), usize::from(noted));
            assert!(resumed.notices.iter().all(|found| found.contains(&notice)), "{:?}", resumed.notices);
            state = resumed.state;
        }
        assert_eq!(state.builds, Some(format!("{version} (a1); {version} (b2+c3)")));
        // As in a checkpoint of an earlier version.
        let unstated = State { builds: None, ..state };
        let resumed = ComputedBy::new(None, None).resume(unstated).unwrap();
        assert_eq!(resumed.state.builds, Some(format!("not stated; {version}")));
        assert!(
            resumed.notices[0].contains("another build of this program, not stated, now "),
            "{:?}",
            resumed.notices
        );
    }
}
