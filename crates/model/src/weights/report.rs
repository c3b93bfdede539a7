use std::fmt;

use serde::Serialize;

use super::StoredTensor;

/// Number of names of each kind in a printed report.
const SHOWN: usize = 12;

/// How every tensor of a file was used, and where every parameter of the network came from.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImportReport {
    /// The key map that was used.
    pub key_map: String,
    /// Parameters that were found, in the network's order.
    pub matched: Vec<Matched>,
    /// Parameters without a tensor.
    pub missing: Vec<Missing>,
    /// Tensors that are not used, in the file's order.
    pub left_over: Vec<LeftOver>,
    /// Tensors that the key map ignores.
    pub ignored: Vec<String>,
    /// Parameters whose tensors have another shape or cannot be used.
    pub mismatched: Vec<Mismatched>,
}

/// A parameter and its tensors.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Matched {
    /// The parameter.
    pub parameter: String,
    /// Names in the file.
    pub sources: Vec<String>,
}

/// A parameter without a tensor in the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// The parameter.
    pub parameter: String,
    /// Its shape.
    pub shape: Vec<usize>,
}

/// A tensor that is not used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOver {
    /// Name in the file.
    pub tensor: String,
    /// Its type and shape.
    pub found: String,
}

/// A parameter whose tensors in the file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Mismatched {
    /// The parameter.
    pub parameter: String,
    /// Names in the file.
    pub sources: Vec<String>,
    /// The parameter's shape.
    pub expected: String,
    /// The tensors' shapes, or another reason.
    pub found: String,
}

impl ImportReport {
    /// Whether every parameter was found; unused tensors do not matter.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty() && self.mismatched.is_empty()
    }

    pub(super) fn left_over(&mut self, name: &str, tensor: &StoredTensor) {
        self.left_over.push(LeftOver { tensor: name.to_owned(), found: tensor.to_string() });
    }
}

impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} parameters matched by key map {:?}, {} missing, {} of another shape, {} tensors left over, {} ignored",
            self.matched.len(),
            self.key_map,
            self.missing.len(),
            self.mismatched.len(),
            self.left_over.len(),
            self.ignored.len(),
        )?;
        list(f, "missing", &self.missing, |Missing { parameter, shape }| format!("{parameter} {shape:?}"))?;
        list(f, "another shape", &self.mismatched, |mismatch| {
            let Mismatched { parameter, sources, expected, found } = mismatch;
            format!("{parameter}: expected {expected}, found {found} ({})", sources.join(", "))
        })?;
        list(f, "left over", &self.left_over, |LeftOver { tensor, found }| format!("{tensor} {found}"))
    }
}

fn list<T>(f: &mut fmt::Formatter<'_>, what: &str, items: &[T], show: impl Fn(&T) -> String) -> fmt::Result {
    for item in items.iter().take(SHOWN) {
        write!(f, "\n  {what}: {}", show(item))?;
    }
    match items.len().saturating_sub(SHOWN) {
        0 => Ok(()),
        more => write!(f, "\n  {what}: and {more} more"),
    }
}
