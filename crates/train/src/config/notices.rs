use atsplat_model::ModelConfig;
use atsplat_model::config::AnchorContext;
use toml::Value;

use super::TrainConfig;
use super::check::sized;

impl TrainConfig {
    /// Settings that are beyond what others leave to them, so that the run is one with lower numbers.
    pub(crate) fn notices(&self, model: &ModelConfig) -> Vec<String> {
        [self.larger_micro_batch(), self.more_intermediate_targets(), self.more_neighbours(model)]
            .into_iter()
            .flatten()
            .collect()
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
