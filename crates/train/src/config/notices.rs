use atsplat_model::ModelConfig;
use atsplat_model::config::AnchorContext;
use toml::Value;

use super::TrainConfig;
use super::check::sized;
use super::windows::views_field;

impl TrainConfig {
    /// Settings that are beyond what others leave to them, so that the run is one with lower numbers; gaps that it does not reach; and
    /// scores that no loss trains.
    pub(crate) fn notices(&self, model: &ModelConfig) -> Vec<String> {
        let settings = [
            self.larger_micro_batch(),
            self.more_intermediate_targets(),
            self.more_neighbours(model),
            self.untrained_scores(model),
        ];
        settings.into_iter().flatten().chain(self.smaller_gaps()).chain(self.unreached_gaps()).collect()
    }

    /// For each source with gaps that give no sample, the first number of views that has such gaps.
    fn smaller_gaps(&self) -> impl Iterator<Item = String> {
        self.sources().filter_map(|(field, source)| {
            let views = source.views();
            views.extremes().find_map(|(step, number)| {
                let sampler = views.sampler(number, step);
                let ((smallest, largest), least) = (sampler.gaps.at(step), sampler.least_gap());
                let field = views_field(&field, source);
                (smallest < least).then(|| {
                    format!(
                        "{field}.gaps: {smallest} to {largest} for {number} context views at step {step}: those below \
                         {least} leave no room for the views, their targets and insets"
                    )
                })
            })
        })
    }

    /// For each source of the training whose gaps still grow when the run ends, those of its last step: its record names the last ones.
    fn unreached_gaps(&self) -> impl Iterator<Item = String> {
        let steps = self.steps.get();
        self.data.iter().enumerate().filter_map(move |(at, data)| {
            let gaps = data.source.views().gaps;
            let ((smallest, largest), last) = (gaps.at(steps - 1), (gaps.min, gaps.max));
            let field = views_field(&format!("data[{at}].source"), &data.source);
            (gaps.warm_up_steps > steps && (smallest, largest) != last).then(|| {
                format!(
                    "{field}.gaps.warm-up-steps: {} in a run of {steps}, whose last gaps are {smallest} to {largest}, not {} to {}",
                    gaps.warm_up_steps, gaps.min, gaps.max
                )
            })
        })
    }

    fn larger_micro_batch(&self) -> Option<String> {
        let (micro_batch, batch) = (self.micro_batch, self.batch);
        (micro_batch > batch)
            .then(|| format!("micro-batch: {micro_batch} with batch = {batch}: a micro-batch has {batch} samples"))
    }

    fn more_intermediate_targets(&self) -> Option<String> {
        let most = self.data.iter().map(|data| data.source.views().targets).max()?;
        let targets = self.losses.intermediate_targets.filter(|targets| *targets > most)?;
        Some(format!("losses.intermediate-targets: {targets} with at most {most} a sample: all are rendered to"))
    }

    /// Of the configuration's own number: that of a named network is for images of its size.
    fn more_neighbours(&self, model: &ModelConfig) -> Option<String> {
        let AnchorContext::PointNet { neighbours } = model.anchors.context else { return None };
        let context = self.model.changes.get("anchors").and_then(|anchors| anchors.get("context"));
        context.and_then(|context| context.get("neighbours")).and_then(Value::as_integer)?;
        let anchors = self.data.iter().map(|data| {
            let size = sized("data", &data.source).ok().and_then(|(_, size)| size).unwrap_or(model.resolution);
            let [_, views] = data.source.views().context;
            Some(model.coarse_grid(size).ok()?.len().saturating_mul(views.get()))
        });
        let most = anchors.flatten().max().filter(|most| neighbours > *most)?;
        Some(format!(
            "model.changes.anchors.context.neighbours: {neighbours} with at most {most} anchors a sample: each sees all"
        ))
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;
    use crate::SourceConfig;

    /// Three samples a step, and one target each.
    #[test]
    fn numbers_beyond_what_others_leave_are_reported() {
        let config = TrainConfig::shortest();
        let model = config.model.config().unwrap();
        assert_eq!(config.notices(&model), [""; 0]);
        let with = |micro_batch: usize, targets: usize| {
            let mut config = TrainConfig { micro_batch: NonZeroUsize::new(micro_batch).unwrap(), ..config.clone() };
            config.losses.intermediate_targets = NonZeroUsize::new(targets);
            config.notices(&model)
        };
        assert_eq!(with(3, 1), [""; 0]);
        let expected = [
            "micro-batch: 4 with batch = 3: a micro-batch has 3 samples",
            "losses.intermediate-targets: 2 with at most 1 a sample: all are rendered to",
        ];
        assert_eq!(with(4, 2), expected);
    }

    /// An inset of two leaves targets in gaps of four and more; of two to four views, two have half of the gaps.
    #[test]
    fn gaps_without_a_sample_are_reported() {
        let notices = |context: &str, gaps: &str, inset: usize| {
            let mut config = TrainConfig::shortest();
            let views = format!("context = {context}\ntargets = 1\ngaps = {{ {gaps} }}\ninset = {inset}");
            if let Some(SourceConfig::Rooms(rooms)) = config.data.first_mut().map(|data| &mut data.source) {
                rooms.views = toml::from_str(&views).unwrap();
            }
            config.notices(&config.model.config().unwrap())
        };
        assert_eq!(notices("[2, 2]", "min = 4, max = 8", 2), [""; 0]);
        let notice = |gaps: &str, views: u32, least: u32| {
            format!(
                "data[0].source.rooms.views.gaps: {gaps} for {views} context views at step 0: those below {least} leave no \
                 room for the views, their targets and insets"
            )
        };
        assert_eq!(notices("[2, 2]", "min = 3, max = 8", 2), [notice("3 to 8", 2, 4)]);
        assert_eq!(notices("[2, 4]", "min = 6, max = 9", 2), [notice("3 to 4", 2, 4)]);
    }

    /// After 7 of 16 steps, gaps have grown by 7/16, rounded down: 3 of 8 frames, and 7 of 16.
    #[test]
    fn gaps_that_a_run_does_not_reach_are_reported() {
        let notices = |gaps: &str| {
            let mut config = TrainConfig::shortest();
            let views = format!("context = [2, 2]\ntargets = 1\ngaps = {{ {gaps} }}");
            if let Some(SourceConfig::Rooms(rooms)) = config.data.first_mut().map(|data| &mut data.source) {
                rooms.views = toml::from_str(&views).unwrap();
            }
            config.notices(&config.model.config().unwrap())
        };
        let growing = "min = 10, max = 26, initial-min = 2, initial-max = 10, warm-up-steps = ";
        let expected = "data[0].source.rooms.views.gaps.warm-up-steps: 16 in a run of 8, whose last gaps are 5 to 17, not 10 to 26";
        assert_eq!(notices(&format!("{growing}16")), [expected]);
        assert_eq!(notices(&format!("{growing}8")), [""; 0], "as long as the run");
        let constant = "min = 10, max = 26, initial-min = 10, initial-max = 26, warm-up-steps = 16";
        assert_eq!(notices(constant), [""; 0]);
    }

    /// Two views of 256x256 have 256 patches of 16 pixels each.
    #[test]
    fn more_neighbours_than_anchors_are_reported() {
        let notices = |neighbours: usize| {
            let mut config = TrainConfig::shortest();
            let changes = format!("anchors.context = {{ kind = 'point-net', neighbours = {neighbours} }}");
            config.model.changes = changes.parse().unwrap();
            config.notices(&config.model.config().unwrap())
        };
        assert_eq!(notices(512), [""; 0]);
        let expected = "anchors.context.neighbours: 513 with at most 512 anchors a sample: each sees all";
        assert_eq!(notices(513), [format!("model.changes.{expected}")]);
        // As in tests on images of a few pixels.
        let mut small = TrainConfig::shortest().model.config().unwrap();
        small.anchors.context = AnchorContext::PointNet { neighbours: 513 };
        assert_eq!(TrainConfig::shortest().notices(&small), [""; 0]);
    }
}
