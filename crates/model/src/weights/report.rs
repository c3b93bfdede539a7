use std::fmt;

use serde::Serialize;

use super::StoredTensor;

/// How many names of a kind a printed report shows.
const SHOWN: usize = 12;

/// What became of every tensor of a file, and of every parameter of the network.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImportReport {
    /// The key map that was used.
    pub key_map: String,
    /// Parameters that were found, in the network's order.
    pub matched: Vec<Matched>,
    /// Parameters that no tensor became.
    pub missing: Vec<Missing>,
    /// Tensors that became no parameter, in the file's order.
    pub left_over: Vec<LeftOver>,
    /// Tensors that the key map knows and does not need.
    pub ignored: Vec<String>,
    /// Tensors that became a parameter of another shape, or could not.
    pub mismatched: Vec<Mismatched>,
}

/// A parameter and the tensors it came from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Matched {
    /// The parameter.
    pub parameter: String,
    /// Names in the file.
    pub sources: Vec<String>,
}

/// A parameter that the file does not have.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// The parameter.
    pub parameter: String,
    /// Its shape.
    pub shape: Vec<usize>,
}

/// A tensor that the network does not have.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOver {
    /// Name in the file.
    pub tensor: String,
    /// Its type and shape.
    pub found: String,
}

/// A parameter that cannot be what the file holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Mismatched {
    /// The parameter.
    pub parameter: String,
    /// Names in the file.
    pub sources: Vec<String>,
    /// The parameter's shape.
    pub expected: String,
    /// The tensors' shapes, or what stands in the way.
    pub found: String,
}

impl ImportReport {
    /// Whether every parameter was found. Tensors that are left over do not count.
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
