//! Checks that windows of frames hold samples, whatever the scenes are.

use super::{SourceConfig, TrainConfig, WHAT};
use crate::TrainError;
use crate::samples::ViewChoice;

impl TrainConfig {
    /// Checks that each number of context views of each source can be drawn: in data of which other numbers give samples, draws of one
    /// that gives none would be replaced by those of others, and the run would never see it.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] with the field.
    pub(super) fn check_windows(&self) -> Result<(), TrainError> {
        self.sources().try_for_each(|(field, source)| check(&views_field(&field, source), source.views()))
    }
}

/// The path of a source's choice of frames.
pub(super) fn views_field(field: &str, source: &SourceConfig) -> String {
    let kind = match source {
        SourceConfig::Rooms(_) => "rooms",
        SourceConfig::Dataset(_) => "dataset",
    };
    format!("{field}.{kind}.views")
}

fn check(field: &str, views: &ViewChoice) -> Result<(), TrainError> {
    if views.inset > 0 && views.outside > 0 {
        let expected = "0 with an inset, which keeps targets inside the window";
        return Err(TrainError::malformed(WHAT, format!("{field}.outside"), expected, views.outside));
    }
    let [_, most] = views.context;
    for (step, number) in views.extremes() {
        let sampler = views.sampler(number, step);
        let (least, (_, largest)) = (sampler.least_gap(), sampler.gaps.at(step));
        if largest < least {
            let expected =
                format!("gaps of up to at least {least} frames for {number} context views, their targets and insets");
            let divided = match most.get() / number.get() {
                0 | 1 => String::new(),
                divisor => format!(", divided by {divisor} for fewer views"),
            };
            let found = format!("up to {largest} at step {step}{divided}");
            return Err(TrainError::malformed(WHAT, format!("{field}.gaps"), expected, found));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(views: &str) -> Result<(), String> {
        let text = format!(
            "title = 'windows'\nseed = 1\nsteps = 8\nbatch = 1\nmodel = {{ base = 'nano' }}\n[[data]]\n\
             [data.source.dataset]\npath = 'absent'\npreset = 're10k-2v-256'\nviews = {{ {views} }}"
        );
        let config = TrainConfig::from_toml(&text).unwrap();
        config.check_windows().map_err(|error| error.to_string())
    }

    #[track_caller]
    fn assert_refused(views: &str, field: &str, message: &str) {
        let error = checked(views).unwrap_err();
        assert!(
            error.contains(&format!("data[0].source.dataset.views.{field}: ")) && error.contains(message),
            "{error}"
        );
    }

    /// Of two to six views, two have a third of the gaps, and four or more all of them.
    #[test]
    fn every_number_of_context_views_can_be_drawn() {
        let views = |gaps: &str, more: &str| format!("context = [2, 6], targets = 1, gaps = {{ {gaps} }}{more}");
        let expected = "gaps of up to at least 6 frames for 2 context views, their targets and insets, found up to 5 at \
                        step 0, divided by 3 for fewer views";
        assert_refused(&views("min = 9, max = 15", ", inset = 3"), "gaps", expected);
        checked(&views("min = 9, max = 18", ", inset = 3")).unwrap();
        checked(&views("min = 9, max = 15", "")).unwrap();
        // Windows of five frames hold no six views; at first, or always.
        let expected = "at least 5 frames for 6 context views, their targets and insets, found up to 4 at step 0";
        assert_refused(&views("min = 3, max = 4", ""), "gaps", expected);
        let growing = "min = 3, max = 9, initial-min = 2, initial-max = 4, warm-up-steps = 7";
        assert_refused(&views(growing, ""), "gaps", expected);
        checked(&views(&growing.replace("initial-max = 4", "initial-max = 5"), "")).unwrap();
    }

    /// A window of five frames has five different targets, three of them inside its ends, and two more next to it.
    #[test]
    fn distinct_targets_have_room() {
        let views = |targets: u32, more: &str| {
            format!("context = [2, 2], targets = {targets}, gaps = {{ min = 1, max = 4 }}{more}")
        };
        checked(&views(5, "")).unwrap();
        assert_refused(&views(6, ""), "gaps", "at least 5 frames for 2 context views");
        assert_refused(&views(4, ", inset = 1"), "gaps", "at least 5 frames for 2 context views");
        checked(&views(7, ", outside = 1")).unwrap();
        checked(&views(9, ", repeat-targets = true")).unwrap();
    }

    /// A test that reads them does not check what only new runs must have, such as windows.
    #[test]
    fn all_experiments_are_those_of_new_runs() {
        let experiments = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments");
        let mut checked = 0;
        for folder in ["", "claims", "paper", "recipe"] {
            for path in std::fs::read_dir(experiments.join(folder)).unwrap().map(|entry| entry.unwrap().path()) {
                if path.extension().is_some_and(|extension| extension == "toml") {
                    TrainConfig::read(&path).unwrap().check_new_run().unwrap();
                    checked += 1;
                }
            }
        }
        assert!(checked > 50, "{checked}");
    }

    #[test]
    fn targets_are_inside_with_an_inset_or_may_be_outside() {
        let views = "context = [2, 2], targets = 1, gaps = { min = 4, max = 5 }";
        checked(&format!("{views}, inset = 2")).unwrap();
        checked(&format!("{views}, outside = 3")).unwrap();
        assert_refused(&format!("{views}, inset = 2, outside = 3"), "outside", "0 with an inset");
    }
}
