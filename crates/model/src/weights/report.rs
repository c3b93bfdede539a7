use std::fmt;

use atsplat_numeric::counted;
use serde::Serialize;

use super::StoredTensor;

/// Number of names of each kind in a printed report, unless it is printed with `{:#}`.
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
    pub left_over: Vec<UnusedTensor>,
    /// Tensors that the key map ignores.
    pub ignored: Vec<String>,
    /// Parameters whose tensors cannot be used.
    pub mismatched: Vec<Mismatched>,
    /// Their number by reason.
    pub mismatches: MismatchCounts,
    /// Further complete sets of tensors with the names and shapes of those that were used, such as averaged weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other_sets: Option<OtherSets>,
}

/// Complete sets of tensors that are left over.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct OtherSets {
    /// What begins the names of the tensors that were used.
    pub used: String,
    /// What begins the names of each other set in its place, in the file's order.
    pub others: Vec<String>,
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
pub struct UnusedTensor {
    /// Name in the file.
    pub tensor: String,
    /// Its type and shape.
    pub found: String,
}

/// Why the tensors for a parameter cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MismatchReason {
    /// They have another shape.
    Shape,
    /// Their elements are not floating-point numbers.
    Type,
    /// Elements are NaN or infinite as f32.
    NotFinite,
    /// They are not the parts of one tensor: too few, too many, or ones that do not belong together.
    Parts,
}

/// Numbers of mismatched parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MismatchCounts {
    /// For [`MismatchReason::Shape`].
    pub shape: usize,
    /// For [`MismatchReason::Type`].
    pub r#type: usize,
    /// For [`MismatchReason::NotFinite`].
    pub not_finite: usize,
    /// For [`MismatchReason::Parts`].
    pub parts: usize,
}

/// A parameter whose tensors in the file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Mismatched {
    /// The parameter.
    pub parameter: String,
    /// What is wrong with the tensors.
    pub reason: MismatchReason,
    /// Names in the file.
    pub sources: Vec<String>,
    /// The parameter's shape.
    pub expected: String,
    /// The shape that the tensors have, or what else is wrong with them.
    pub found: String,
}

impl ImportReport {
    /// Whether every parameter was found; unused tensors do not matter.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty() && self.mismatched.is_empty()
    }

    pub(super) fn mismatch(&mut self, mismatched: Mismatched) {
        let counts = &mut self.mismatches;
        *match mismatched.reason {
            MismatchReason::Shape => &mut counts.shape,
            MismatchReason::Type => &mut counts.r#type,
            MismatchReason::NotFinite => &mut counts.not_finite,
            MismatchReason::Parts => &mut counts.parts,
        } += 1;
        self.mismatched.push(mismatched);
    }

    pub(super) fn left_over(&mut self, name: &str, tensor: &StoredTensor) {
        self.left_over.push(UnusedTensor { tensor: name.to_owned(), found: tensor.to_string() });
    }
}

/// With `{:#}`, every name is listed.
impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (matched, missing) = (self.matched.len(), self.missing.len());
        let matched = counted(matched as u64, "parameter");
        write!(f, "{matched} matched by key map {:?}, {missing} missing, ", self.key_map)?;
        let MismatchCounts { shape, r#type, not_finite, parts } = self.mismatches;
        write!(f, "{shape} of another shape, ")?;
        for (count, what) in [(r#type, "of another type"), (not_finite, "not finite"), (parts, "with wrong parts")] {
            if count > 0 {
                write!(f, "{count} {what}, ")?;
            }
        }
        write!(f, "{} left over, {} ignored", counted(self.left_over.len() as u64, "tensor"), self.ignored.len())?;
        list(f, "missing", &self.missing, |Missing { parameter, shape }| format!("{parameter} {shape:?}"))?;
        for reason in MismatchReason::ALL {
            let of_reason = self.mismatched.iter().filter(|mismatched| mismatched.reason == reason);
            list(f, reason.heading(), &of_reason.collect::<Vec<_>>(), |mismatched| {
                let Mismatched { parameter, sources, expected, found, .. } = mismatched;
                let expected = match reason {
                    MismatchReason::Shape => format!("expected {expected}, found "),
                    _ => String::new(),
                };
                format!("{parameter}: {expected}{found} ({})", sources.join(", "))
            })?;
        }
        list(f, "left over", &self.left_over, |UnusedTensor { tensor, found }| format!("{tensor} {found}"))?;
        self.other_sets.as_ref().map_or(Ok(()), |sets| write!(f, "\n  {sets}"))
    }
}

impl fmt::Display for OtherSets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { used, others } = self;
        for (at, other) in others.iter().enumerate() {
            let separator = if at == 0 { "also contains a complete set under" } else { " and" };
            write!(f, "{separator} {other:?}")?;
        }
        if used.is_empty() {
            // As a root, the prefix would map both sets to the same parameters.
            let other = "for another set, let `from` of the key map's rules begin with its prefix";
            return write!(f, "; this import used names without a prefix; {other}");
        }
        let first = others.first().map_or("", String::as_str);
        write!(f, "; this import used {used:?}; for another set, use a key map with its prefix: roots = [{first:?}]")
    }
}

impl MismatchReason {
    const ALL: [Self; 4] = [Self::Shape, Self::Type, Self::NotFinite, Self::Parts];

    /// What begins each line of a printed list.
    const fn heading(self) -> &'static str {
        match self {
            Self::Shape => "another shape",
            Self::Type => "another type",
            Self::NotFinite => "not finite",
            Self::Parts => "wrong parts",
        }
    }
}

fn list<T>(f: &mut fmt::Formatter<'_>, what: &str, items: &[T], show: impl Fn(&T) -> String) -> fmt::Result {
    let shown = if f.alternate() { items.len() } else { SHOWN };
    for item in items.iter().take(shown) {
        write!(f, "\n  {what}: {}", show(item))?;
    }
    match items.len().saturating_sub(shown) {
        0 => Ok(()),
        more => write!(f, "\n  {what}: and {more} more"),
    }
}
