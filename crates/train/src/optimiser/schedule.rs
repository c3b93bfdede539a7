use serde::{Deserialize, Serialize};

/// Schedule of the learning rate: linear warm-up, then cosine decay (paper, supplement, "Training Details").
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Schedule {
    /// Peak rate; by default the paper's.
    pub learning_rate: f64,
    /// Steps until the peak.
    pub warm_up_steps: u64,
    /// Final rate as a share of the peak.
    pub final_share: f64,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { learning_rate: 2e-4, warm_up_steps: 1000, final_share: 0.0 }
    }
}

impl Schedule {
    /// The rate of a step, counted from 0, of `steps` steps.
    pub fn rate(&self, step: u64, steps: u64) -> f64 {
        if step < self.warm_up_steps {
            return self.learning_rate * (step + 1) as f64 / self.warm_up_steps as f64;
        }
        let rest = steps.saturating_sub(self.warm_up_steps).max(1) as f64;
        let progress = ((step - self.warm_up_steps) as f64 / rest).clamp(0.0, 1.0);
        let share = 0.5 * (1.0 + (std::f64::consts::PI * progress).cos());
        self.learning_rate * (self.final_share + (1.0 - self.final_share) * share)
    }
}
