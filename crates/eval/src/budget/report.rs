use std::fmt;

use atsplat_model::budget::{Budget, BudgetRange, MemoryEstimate, budget, memory};
use atsplat_model::network::StageSeconds;
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_numeric::format_bytes;
use serde::Serialize;

use super::{MeasuredBudget, PublishedBudget};

/// The table of budgets. [`Display`](fmt::Display) prints it, with the runs below.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BudgetReport {
    /// A row per configuration and input size.
    pub rows: Vec<BudgetRow>,
    /// Whether the configurations differ from the named ones, by command-line arguments.
    pub changed: bool,
}

/// A configuration and the size of its input.
#[derive(Clone, Debug)]
pub struct BudgetCase {
    /// The dataset, if the case is published.
    pub dataset: Option<String>,
    /// Configuration whose budget is computed.
    pub config: ModelConfig,
    /// Number of context views.
    pub views: usize,
    /// Height and width in pixels.
    pub size: ImageSize,
    /// The paper's numbers, if any.
    pub published: Option<PublishedBudget>,
}

/// The budget of a configuration and input size.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BudgetRow {
    dataset: Option<String>,
    model: String,
    views: usize,
    /// Height and width in pixels.
    size: ImageSize,
    /// If no token exceeds a threshold; equal to `max` for fixed ratios.
    min: Tokens,
    max: Tokens,
    published: Option<PublishedBudget>,
    #[serde(rename = "verdict")]
    agreement: PaperAgreement,
    /// With weights of the configuration's size, if their network would see these images at another size.
    #[serde(skip_serializing_if = "Option::is_none")]
    resized: Option<Resized>,
    #[serde(flatten)]
    memory: MemoryEstimate,
    #[serde(skip_serializing_if = "Option::is_none")]
    run: Option<Run>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Tokens {
    initial: usize,
    blocks: Vec<usize>,
    r#final: usize,
    gaussians: usize,
}

/// What a network does whose weights were trained at the configuration's size, as of a file of weights.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Resized {
    /// The configuration's height and width.
    trained_at: ImageSize,
    /// Height and width at which the network sees the images.
    seen_at: ImageSize,
    min: Tokens,
    max: Tokens,
    /// In `reproduce`, whose networks see large images as they are.
    #[serde(skip_serializing_if = "Option::is_none")]
    high_resolution: Option<HighResolution>,
}

/// With the paper's setting for large images.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
struct HighResolution {
    min: Tokens,
    max: Tokens,
}

/// Comparison of the formula with the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum PaperAgreement {
    Equal,
    Differs,
    NotPublished,
}

/// Comparison of the network with the formula.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Run {
    tokens: Tokens,
    /// Whether the counts are within the range of the formula.
    keeps_to_formula: bool,
    seconds: StageSeconds,
    total_secs: f64,
    build_secs: f64,
    peak_bytes: Option<u64>,
}

impl From<&Budget> for Tokens {
    fn from(budget: &Budget) -> Self {
        Self {
            initial: budget.initial_tokens,
            blocks: budget.tokens.clone(),
            r#final: budget.final_tokens,
            gaussians: budget.gaussians,
        }
    }
}

impl BudgetRow {
    /// Computes the budget of a case by formula, and compares it with the published and the measured one.
    ///
    /// # Errors
    /// [`ModelError`] if the input does not fit the configuration, or large images need a setting of it that is not valid.
    pub fn new(case: BudgetCase, measured: Option<MeasuredBudget>) -> Result<Self, ModelError> {
        let BudgetCase { dataset, config, views, size, published } = case;
        let range: BudgetRange = budget(&config, views, size)?;
        let memory: MemoryEstimate = memory(&config, views, size)?;
        let resized = Resized::new(&config, views, size)?;
        let model = config.name;
        let (min, max) = (Tokens::from(&range.min), Tokens::from(&range.max));
        let agreement = match (&published, range.fixed()) {
            (None, _) => PaperAgreement::NotPublished,
            (Some(row), Some(budget)) if row.agrees(budget) => PaperAgreement::Equal,
            (Some(_), _) => PaperAgreement::Differs,
        };
        let run = measured.map(|measured| {
            let MeasuredBudget { budget, seconds, build_secs, peak_bytes } = measured;
            let tokens = Tokens::from(&budget);
            let keeps_to_formula = tokens.is_between(&min, &max);
            Run { tokens, keeps_to_formula, seconds, total_secs: seconds.total(), build_secs, peak_bytes }
        });
        Ok(Self { dataset, model, views, size, min, max, published, agreement, resized, memory, run })
    }
}

impl Resized {
    /// `None` if the network sees the images as they are.
    fn new(config: &ModelConfig, views: usize, size: ImageSize) -> Result<Option<Self>, ModelError> {
        let trained_at = config.resolution;
        let seen_at = config.context_size(size, trained_at);
        if seen_at == size {
            return Ok(None);
        }
        let BudgetRange { min, max } = budget(config, views, seen_at)?;
        let high_resolution = HighResolution::new(config, views, size)?;
        Ok(Some(Self { trained_at, seen_at, min: (&min).into(), max: (&max).into(), high_resolution }))
    }
}

impl HighResolution {
    /// `None` for images that are not large, or whose half is not at the scale of the training, and for networks that need no other
    /// setting for large images.
    fn new(config: &ModelConfig, views: usize, size: ImageSize) -> Result<Option<Self>, ModelError> {
        if !config.has_high_resolution(size, config.resolution) {
            return Ok(None);
        }
        let Some(config) = config.for_high_resolution()? else { return Ok(None) };
        let BudgetRange { min, max } = budget(&config, views, size)?;
        Ok(Some(Self { min: (&min).into(), max: (&max).into() }))
    }
}

impl Tokens {
    fn is_between(&self, min: &Self, max: &Self) -> bool {
        let within = |low: usize, found: usize, high: usize| (low..=high).contains(&found);
        self.blocks.len() == min.blocks.len()
            && within(min.initial, self.initial, max.initial)
            && within(min.gaussians, self.gaussians, max.gaussians)
            && self
                .blocks
                .iter()
                .zip(&min.blocks)
                .zip(&max.blocks)
                .all(|((&found, &low), &high)| within(low, found, high))
    }
}

impl BudgetReport {
    /// Whether the formula agrees with the paper and every network with the formula.
    pub fn is_consistent(&self) -> bool {
        let right = |row: &BudgetRow| {
            row.agreement != PaperAgreement::Differs && row.run.as_ref().is_none_or(|run| run.keeps_to_formula)
        };
        self.rows.iter().all(right)
    }
}

impl fmt::Display for BudgetReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<7} {:<16} {:>9} {:>5}  {:>12}  {:>15}  {:>15}  {:<8}  {:>9}",
            "dataset", "model", "images", "views", "tokens", "Gaussians", "published", "verdict", "memory"
        )?;
        for row in &self.rows {
            row.fmt(f)?;
        }
        if self.changed {
            writeln!(
                f,
                "changed by --thresholds, --ratios or --expand-first: nothing is published about these networks"
            )?;
        }
        if self.rows.iter().any(|row| row.run.is_some()) {
            writeln!(f, "\nrun with random weights")?;
            writeln!(
                f,
                "{:<16} {:>9} {:>5}  {:>12}  {:>9}  {:<9}  {:>8}  {:>9}  seconds of each stage",
                "model", "images", "views", "tokens", "Gaussians", "formula", "seconds", "peak"
            )?;
            for row in &self.rows {
                row.write_run(f)?;
            }
        }
        writeln!(f, "\nimage sizes are height x width, as in the papers; memory is estimated by formula")?;
        self.rows.iter().try_for_each(|row| row.write_resized(f))
    }
}

impl BudgetRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { dataset, model, views, min, max, published, agreement, .. } = self;
        let tokens = format!("{} > {}", max.initial, range(min.r#final, max.r#final));
        let gaussians = range(min.gaussians, max.gaussians);
        let reported = published.as_ref().map_or_else(
            || "-".to_owned(),
            |row| match row.final_tokens {
                Some(tokens) => format!("{tokens}, {}", row.gaussians),
                None => row.gaussians.to_string(),
            },
        );
        let agreement = match agreement {
            PaperAgreement::Equal => "equal",
            PaperAgreement::Differs => "DIFFERS",
            PaperAgreement::NotPublished => "-",
        };
        let (dataset, size) = (dataset.as_deref().unwrap_or("-"), self.size.to_string());
        let memory = format_bytes(self.memory.peak_bytes());
        writeln!(
            f,
            "{dataset:<7} {model:<16} {size:>9} {views:>5}  {tokens:>12}  {gaussians:>15}  {reported:>15}  {agreement:<8}  {memory:>9}"
        )
    }

    /// What `run` and `reproduce` do with weights of another size, whose counts are not those of the row.
    fn write_resized(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { model, size, resized: Some(resized), .. } = self else { return Ok(()) };
        let Resized { trained_at, seen_at, min, max, high_resolution } = resized;
        writeln!(
            f,
            "{model}: assumes weights that were trained at {size}; the network of weights trained at {trained_at} sees these images at \
             {seen_at}: {}",
            counts(min, max)
        )?;
        let Some(HighResolution { min, max }) = high_resolution else { return Ok(()) };
        writeln!(f, "{model}: in evaluations, this network takes the setting for large images: {}", counts(min, max))
    }

    fn write_run(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(run) = &self.run else { return Ok(()) };
        let tokens = format!("{} > {}", run.tokens.initial, run.tokens.r#final);
        let formula = if run.keeps_to_formula { "within" } else { "OUTSIDE" };
        let peak = run.peak_bytes.map_or_else(|| "-".to_owned(), format_bytes);
        let stages: Vec<String> =
            run.seconds.stages().iter().map(|(stage, seconds)| format!("{stage} {seconds:.2}")).collect();
        let (model, size, views) = (&self.model, self.size.to_string(), self.views);
        let (gaussians, seconds, stages) = (run.tokens.gaussians, run.total_secs, stages.join(", "));
        writeln!(
            f,
            "{model:<16} {size:>9} {views:>5}  {tokens:>12}  {gaussians:>9}  {formula:<9}  {seconds:>8.2}  {peak:>9}  {stages}"
        )
    }
}

/// `896 > 2520 tokens, 40320 Gaussians`.
fn counts(min: &Tokens, max: &Tokens) -> String {
    let (tokens, gaussians) = (range(min.r#final, max.r#final), range(min.gaussians, max.gaussians));
    format!("{} > {tokens} tokens, {gaussians} Gaussians", max.initial)
}

/// `2520`, or `1000 to 2520`.
fn range(min: usize, max: usize) -> String {
    if min == max { max.to_string() } else { format!("{min} to {max}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Images of twice the size are seen as those of the training; large ones have the setting for them too.
    #[test]
    fn other_images_are_seen_at_the_scale_of_the_training() {
        let resized = |model: &str, height, width| {
            let config = ModelConfig::named(model).unwrap();
            let found = Resized::new(&config, 6, ImageSize::new(height, width)).unwrap()?;
            let large = found.high_resolution.map(|large| (large.max.r#final, large.max.gaussians));
            Some((found.seen_at, found.max.gaussians, large))
        };
        let square = ImageSize::new(128, 128);
        assert_eq!(resized("micro", 112, 112), Some((square, 69_120, None)));
        assert_eq!(resized("micro", 128, 128), None);
        assert_eq!(resized("micro", 256, 256), Some((square, 69_120, None)));
        assert_eq!(resized("micro", 128, 224), None);
        let large = Some((9074, 145_184));
        assert_eq!(resized("paper-dl3dv", 512, 896), Some((ImageSize::new(256, 448), 120_960, large)));
        assert_eq!(resized("paper-dl3dv-hr", 512, 960), None);
        // Not twice the size of the training.
        assert_eq!(resized("paper-dl3dv", 768, 1344), Some((ImageSize::new(256, 448), 120_960, None)));
    }

    /// Twice the resolution of the training is too long for a configuration.
    #[test]
    fn a_setting_for_large_images_that_cannot_be_made_is_an_error() {
        let config = ModelConfig { resolution: ImageSize::new(8208, 16), ..ModelConfig::named("nano").unwrap() };
        let row = |size: ImageSize| {
            let case = BudgetCase { dataset: None, config: config.clone(), views: 1, size, published: None };
            BudgetRow::new(case, None).map(|row| row.resized.map(|resized| resized.seen_at))
        };
        let error = row(ImageSize::new(16_416, 32)).unwrap_err().to_string();
        assert!(error.starts_with("setting for large images: ") && error.ends_with("found 16416"), "{error}");
        assert_eq!(row(ImageSize::new(64, 32)).unwrap(), Some(ImageSize::new(32, 16)), "not for other images");
    }

    #[test]
    fn a_run_keeps_to_the_formula_within_both_bounds_of_every_count() {
        let tokens = |initial, block, gaussians| Tokens { initial, blocks: vec![10, block], r#final: block, gaussians };
        let (min, max) = (tokens(4, 10, 80), tokens(4, 20, 160));
        for within in [tokens(4, 10, 80), tokens(4, 15, 120), tokens(4, 20, 160)] {
            assert!(within.is_between(&min, &max), "{within:?}");
        }
        let shorter = Tokens { blocks: vec![10], ..tokens(4, 15, 120) };
        for outside in [tokens(5, 15, 120), tokens(4, 9, 120), tokens(4, 21, 120), tokens(4, 15, 161), shorter] {
            assert!(!outside.is_between(&min, &max), "{outside:?}");
        }
    }
}
