use std::collections::HashSet;

use indexmap::IndexMap;

use super::{KeyMap, Rule};
use crate::ModelError;
use crate::parameters::Parameter;
use crate::weights::{
    ImportReport, Matched, MismatchReason, Mismatched, Missing, OtherSets, StoredTensor, StoredTensors, TensorError,
};

/// The tensors of a file for one parameter.
#[derive(Default)]
struct Candidate {
    sources: Vec<String>,
    /// By part; a whole tensor is part 0 of 1.
    parts: Vec<Option<StoredTensor>>,
    /// Why the parts cannot be used.
    fault: Option<Fault>,
}

/// Why tensors cannot be used, and what was found.
type Fault = (MismatchReason, String);

impl KeyMap {
    /// Finds the network's parameters in a file, with a report on every tensor and parameter. Tensors keep the file's element
    /// type; those that are not floating-point, or contain NaN or infinite values, are mismatches.
    pub fn apply(&self, stored: &StoredTensors, expected: &[Parameter]) -> (StoredTensors, ImportReport) {
        let mut report = ImportReport { key_map: self.name.clone(), ..ImportReport::default() };
        let mut candidates: IndexMap<&str, Candidate> =
            expected.iter().map(|parameter| (parameter.name.as_str(), Candidate::default())).collect();
        for (full_name, tensor) in &stored.tensors {
            let name = self.without_roots(full_name);
            if self.ignore.iter().any(|pattern| pattern.captures(name).is_some()) {
                report.ignored.push(full_name.clone());
            } else if !self.offer(full_name, name, tensor, &mut candidates) {
                report.left_over(full_name, tensor);
            }
        }
        let mut found = StoredTensors::default();
        for parameter in expected {
            let Some(candidate) = candidates.swap_remove(parameter.name.as_str()) else { continue };
            let name = parameter.name.clone();
            if candidate.sources.is_empty() {
                report.missing.push(Missing { parameter: name, shape: parameter.shape.clone() });
                continue;
            }
            let sources = candidate.sources.clone();
            match candidate.tensor(parameter) {
                Ok(tensor) => {
                    report.matched.push(Matched { parameter: name.clone(), sources });
                    found.tensors.insert(name, tensor);
                }
                Err((reason, found)) => {
                    let expected = format!("{:?}", parameter.shape);
                    report.mismatch(Mismatched { parameter: name, reason, sources, expected, found });
                }
            }
        }
        report.other_sets = self.other_sets(stored, &report);
        (found, report)
    }

    /// Complete sets among the tensors that are left over: other prefixes with which every name that was used exists, in the same
    /// shape.
    fn other_sets(&self, stored: &StoredTensors, report: &ImportReport) -> Option<OtherSets> {
        if !report.is_complete() {
            return None;
        }
        let sources = || report.matched.iter().flat_map(|matched| &matched.sources).map(String::as_str);
        let first = sources().next()?;
        let rootless = self.without_roots(first);
        let left_over: HashSet<&str> = report.left_over.iter().map(|unused| unused.tensor.as_str()).collect();
        let shape = |name: &str| stored.tensors.get(name).map(StoredTensor::shape);
        let has_all = |prefix: &str| {
            sources().all(|source| {
                let other = format!("{prefix}{}", self.without_roots(source));
                left_over.contains(other.as_str()) && shape(&other) == shape(source)
            })
        };
        let prefixes = report.left_over.iter().filter_map(|unused| unused.tensor.strip_suffix(rootless));
        let others: Vec<String> =
            prefixes.filter(|prefix| prefix.ends_with('.') && has_all(prefix)).map(str::to_owned).collect();
        let used = first.strip_suffix(rootless).unwrap_or_default().to_owned();
        (!others.is_empty()).then_some(OtherSets { used, others })
    }

    /// [`Self::apply`], with an error if a parameter is missing or its tensors cannot be used.
    ///
    /// # Errors
    /// [`ModelError::Unfit`] with the report.
    pub fn import(
        &self,
        stored: &StoredTensors,
        expected: &[Parameter],
    ) -> Result<(StoredTensors, ImportReport), ModelError> {
        let (found, report) = self.apply(stored, expected);
        if report.is_complete() { Ok((found, report)) } else { Err(ModelError::Unfit(Box::new(report))) }
    }

    /// A name without its roots, in whatever order and however often wrappers have put them before it.
    pub(super) fn without_roots<'n>(&self, name: &'n str) -> &'n str {
        let roots = || self.roots.iter().map(String::as_str).filter(|root| !root.is_empty());
        let mut rootless = name;
        while let Some(shorter) = roots().find_map(|root| rootless.strip_prefix(root)) {
            rootless = shorter;
        }
        rootless
    }

    /// Adds a tensor to the candidates; returns whether it is used.
    fn offer(
        &self,
        full_name: &str,
        name: &str,
        tensor: &StoredTensor,
        candidates: &mut IndexMap<&str, Candidate>,
    ) -> bool {
        if self.rules.is_empty() {
            return candidates
                .get_mut(name)
                .map(|candidate| candidate.add(full_name, (0, 1), Ok(tensor.clone())))
                .is_some();
        }
        let first = self.rules.iter().find_map(|rule| rule.from.captures(name).map(|captures| (rule, captures)));
        let Some((rule, captures)) = first else { return false };
        let mut used = false;
        for (position, target) in rule.targets.iter().enumerate() {
            if let Some(candidate) = candidates.get_mut(target.filled(&captures).as_str()) {
                candidate.add(full_name, rule.part.unwrap_or((0, 1)), rule.tensor(tensor, position));
                used = true;
            }
        }
        used
    }
}

impl Rule {
    /// The part of a tensor for the target at `position`.
    fn tensor(&self, tensor: &StoredTensor, position: usize) -> Result<StoredTensor, TensorError> {
        let tensor = if self.transpose { tensor.transposed()? } else { tensor.clone() };
        match self.targets.len() {
            1 => Ok(tensor),
            count => tensor.part(position, count),
        }
    }
}

impl Candidate {
    fn add(&mut self, source: &str, (part, count): (usize, usize), tensor: Result<StoredTensor, TensorError>) {
        self.sources.push(source.to_owned());
        if self.parts.is_empty() {
            self.parts.resize(count, None);
        }
        let parts = self.parts.len();
        match (self.parts.get_mut(part).filter(|_| parts == count), tensor) {
            // Only a shape keeps a tensor from being transposed or split.
            (_, Err(error)) => self.fault = Some((MismatchReason::Shape, error.to_string())),
            (Some(slot @ None), Ok(tensor)) => *slot = Some(tensor),
            (Some(Some(_)), Ok(_)) => self.fault = Some((MismatchReason::Parts, "two tensors".to_owned())),
            (None, Ok(_)) => {
                self.fault = Some((MismatchReason::Parts, format!("part {part} of {count}, and parts of {parts}")));
            }
        }
    }

    fn tensor(self, parameter: &Parameter) -> Result<StoredTensor, Fault> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let count = self.parts.len();
        let parts: Vec<&StoredTensor> = self.parts.iter().flatten().collect();
        if parts.len() < count {
            return Err((MismatchReason::Parts, format!("{} of {count} parts", parts.len())));
        }
        let tensor = match parts.as_slice() {
            [whole] => (*whole).clone(),
            parts => StoredTensor::joined(parts).map_err(|error| (MismatchReason::Parts, error.to_string()))?,
        };
        if tensor.shape() != parameter.shape {
            return Err((MismatchReason::Shape, format!("{:?}", tensor.shape())));
        }
        let values = tensor.to_f32().map_err(|error| (MismatchReason::Type, error.to_string()))?;
        match values.iter().filter(|value| !value.is_finite()).count() {
            0 => Ok(tensor),
            1 => Err((MismatchReason::NotFinite, "1 value that is not finite as f32".to_owned())),
            unusable => Err((MismatchReason::NotFinite, format!("{unusable} values that are not finite as f32"))),
        }
    }
}
