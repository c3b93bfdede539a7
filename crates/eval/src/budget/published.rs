use atsplat_model::ImageSize;
use atsplat_model::budget::Budget;
use serde::Serialize;

/// The numbers of the paper (`eval/published/README.md`).
const TABLE: &str = include_str!("../../../../eval/published/budget.csv");

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PublishedBudget {
    /// The dataset.
    pub dataset: &'static str,
    /// Name of the configuration.
    pub model: &'static str,
    /// Number of context views.
    pub views: usize,
    /// Height and width in pixels.
    pub size: ImageSize,
    /// Tokens that enter the decoder, if published.
    pub initial_tokens: Option<usize>,
    /// Tokens that leave the decoder, if published.
    pub final_tokens: Option<usize>,
    /// Gaussians.
    pub gaussians: Count,
}

/// A number as printed in the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Count {
    /// Exact.
    Exact(usize),
    /// Thousands, rounded down.
    Thousands(usize),
}

impl Count {
    fn agrees(self, found: usize) -> bool {
        match self {
            Self::Exact(count) => count == found,
            Self::Thousands(thousands) => thousands == found / 1000,
        }
    }
}

impl std::fmt::Display for Count {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Exact(count) => write!(f, "{count}"),
            Self::Thousands(thousands) => write!(f, "{thousands}K"),
        }
    }
}

impl PublishedBudget {
    /// Whether every printed number agrees with this budget.
    pub fn agrees(&self, found: &Budget) -> bool {
        self.initial_tokens.is_none_or(|count| count == found.initial_tokens)
            && self.final_tokens.is_none_or(|count| count == found.final_tokens)
            && self.gaussians.agrees(found.gaussians)
    }
}

/// The embedded table of published budgets is broken.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("eval/published/budget.csv, line {line}: {problem}")]
pub struct BrokenTable {
    line: usize,
    problem: String,
}

/// All rows, in the order of the file.
///
/// # Errors
/// [`BrokenTable`] if the embedded file is broken.
pub fn published_budgets() -> Result<Vec<PublishedBudget>, BrokenTable> {
    let rows = TABLE.lines().skip(1).enumerate();
    rows.map(|(at, line)| row(line).map_err(|problem| BrokenTable { line: at + 2, problem })).collect()
}

fn row(line: &'static str) -> Result<PublishedBudget, String> {
    let fields: Vec<&'static str> = line.split(',').collect();
    let [dataset, model, height, width, views, initial, last, gaussians] = *fields.as_slice() else {
        return Err(format!("expected 8 fields, found {}", fields.len()));
    };
    let count =
        |text: &str| text.parse::<usize>().map_err(|error| format!("expected a number, found {text:?}: {error}"));
    let optional = |text: &str| if text.is_empty() { Ok(None) } else { count(text).map(Some) };
    Ok(PublishedBudget {
        dataset,
        model,
        views: count(views)?,
        size: ImageSize::new(count(height)?, count(width)?),
        initial_tokens: optional(initial)?,
        final_tokens: optional(last)?,
        gaussians: match gaussians.strip_suffix('K') {
            Some(thousands) => Count::Thousands(count(thousands)?),
            None => Count::Exact(count(gaussians)?),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_committed_table_and_rejects_broken_rows() {
        assert_eq!(published_budgets().unwrap().len(), 6);
        for broken in ["", "RE10K,a,1,2,3,4,5", "RE10K,a,1,2,3,4,5,6,7", "RE10K,a,x,2,3,4,5,6", "RE10K,a,1,2,3,4,5,K"] {
            assert!(row(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn thousands_are_rounded_down() {
        assert!(Count::Thousands(52).agrees(52_928) && !Count::Thousands(53).agrees(52_928));
        assert!(Count::Exact(52_928).agrees(52_928) && !Count::Exact(52_912).agrees(52_928));
    }
}
