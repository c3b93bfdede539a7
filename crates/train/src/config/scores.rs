//! Which loss trains the scores by which tokens are selected.

use atsplat_model::ModelConfig;
use atsplat_model::config::Scoring;

use super::{TrainConfig, WHAT};
use crate::TrainError;

impl TrainConfig {
    /// Checks that the rendering loss alone trains the scores of a straight-through estimator, as in the paper's ablation: by default,
    /// the uncertainty loss would train them too.
    ///
    /// # Errors
    /// [`TrainError::Malformed`].
    pub(super) fn check_scores(&self, model: &ModelConfig) -> Result<(), TrainError> {
        let weight = self.losses.uncertainty_weight;
        match scoring(model) {
            Scoring::StraightThrough if weight > 0.0 => {
                let expected = "0.0 with the selection straight-through, whose scores only the rendering loss trains";
                Err(TrainError::malformed(WHAT, "losses.uncertainty-weight", expected, weight))
            }
            Scoring::StraightThrough | Scoring::Detached | Scoring::None => Ok(()),
        }
    }

    /// That nothing trains the scores of the selection by uncertainty. Not an error, as given weights may be meant to keep theirs.
    pub(super) fn untrained_scores(&self, model: &ModelConfig) -> Option<String> {
        match scoring(model) {
            Scoring::Detached if self.losses.uncertainty_weight <= 0.0 => Some(
                "losses.uncertainty-weight: 0 with the selection uncertainty: nothing trains the scores that select tokens"
                    .to_owned(),
            ),
            Scoring::Detached | Scoring::StraightThrough | Scoring::None => None,
        }
    }
}

/// The scores by which the blocks of a network select tokens; none if no block expands.
fn scoring(model: &ModelConfig) -> Scoring {
    let expands = model.decoder.blocks.iter().any(|block| block.active_expansion().is_some());
    if expands { model.expansion.selection.scoring() } else { Scoring::None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_uncertainty_loss_trains_the_scores_of_its_own_selection_and_no_others() {
        for (selection, weight, is_refused, is_noted) in [
            ("uncertainty", 0.1, false, false),
            ("uncertainty", 0.0, false, true),
            ("straight-through", 0.1, true, false),
            ("straight-through", 0.0, false, false),
            ("farthest-point", 0.1, false, false),
            ("farthest-point", 0.0, false, false),
        ] {
            let mut config = TrainConfig::shortest();
            config.losses.uncertainty_weight = weight;
            config.model.changes = format!("expansion.selection = {{ kind = '{selection}' }}").parse().unwrap();
            let case = format!("{selection} with {weight}");
            let refused = config.check_new_run().err().map(|error| error.to_string());
            let expected = "losses.uncertainty-weight: expected 0.0 with the selection straight-through, whose scores \
                            only the rendering loss trains, found 0.1";
            assert_eq!(refused, is_refused.then(|| format!("{WHAT}: {expected}")), "{case}");
            let mut model = config.model.config().unwrap();
            let noted = config.notices(&model);
            assert_eq!(noted.len(), usize::from(is_noted), "{case}: {noted:?}");
            assert!(noted.iter().all(|notice| notice.starts_with("losses.uncertainty-weight: 0 with")), "{noted:?}");
            // Then there are no scores.
            for block in &mut model.decoder.blocks {
                block.expand = false;
            }
            assert!(config.check_scores(&model).is_ok() && config.notices(&model).is_empty(), "{case}");
        }
    }
}
