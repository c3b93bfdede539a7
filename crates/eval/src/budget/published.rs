use atsplat_files::csv;
use atsplat_model::ImageSize;
use atsplat_model::budget::Budget;
use serde::Serialize;

/// The numbers of the paper (`eval/published/README.md`).
const TABLE: &str = include_str!("../../../../eval/published/budget.csv");
const COLUMNS: [&str; 8] =
    ["dataset", "model", "height", "width", "views", "initial-tokens", "final-tokens", "gaussians"];

/// A row of the paper's table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PublishedBudget {
    /// The dataset.
    pub dataset: String,
    /// Name of the configuration.
    pub model: String,
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
#[error("eval/published/budget.csv: {0}")]
pub struct BrokenTable(String);

/// All rows, in the order of the file.
///
/// # Errors
/// [`BrokenTable`] if the embedded file is broken.
pub fn published_budgets() -> Result<Vec<PublishedBudget>, BrokenTable> {
    read(TABLE).map_err(BrokenTable)
}

fn read(text: &str) -> Result<Vec<PublishedBudget>, String> {
    let records = csv::parse(text)?;
    let (header, rows) = records.split_first().ok_or("expected a header, found an empty file")?;
    if *header != COLUMNS {
        return Err(format!("expected the columns {}, found {}", COLUMNS.join(", "), header.join(", ")));
    }
    let numbered = (2..).zip(rows);
    numbered.map(|(line, record)| row(record).map_err(|problem| format!("line {line}: {problem}"))).collect()
}

fn row(record: &[String]) -> Result<PublishedBudget, String> {
    let [dataset, model, height, width, views, initial, last, gaussians] = record else {
        return Err(format!("expected {} fields, found {}", COLUMNS.len(), record.len()));
    };
    let count =
        |text: &str| text.parse::<usize>().map_err(|error| format!("expected a number, found {text:?}: {error}"));
    let optional = |text: &str| if text.is_empty() { Ok(None) } else { count(text).map(Some) };
    Ok(PublishedBudget {
        dataset: dataset.clone(),
        model: model.clone(),
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
        let (header, _) = TABLE.split_once('\n').unwrap();
        let read_row = |row: &str| read(&format!("{header}\n{row}\n"));
        for broken in ["", "RE10K,a,1,2,3,4,5", "RE10K,a,1,2,3,4,5,6,7", "RE10K,a,x,2,3,4,5,6", "RE10K,a,1,2,3,4,5,K"] {
            let error = read_row(broken).unwrap_err();
            assert!(error.starts_with("line 2: "), "{broken:?}: {error}");
        }
        let quoted = read_row("\"RE10K, all\",a,1,2,3,4,5,6K").unwrap();
        assert_eq!((quoted[0].dataset.as_str(), quoted[0].gaussians), ("RE10K, all", Count::Thousands(6)));
        let swapped = TABLE.replace("initial-tokens,final-tokens", "final-tokens,initial-tokens");
        assert!(read(&swapped).unwrap_err().starts_with("expected the columns dataset, model, "));
    }

    #[test]
    fn thousands_are_rounded_down() {
        assert!(Count::Thousands(52).agrees(52_928) && !Count::Thousands(53).agrees(52_928));
        assert!(Count::Exact(52_928).agrees(52_928) && !Count::Exact(52_912).agrees(52_928));
    }
}
