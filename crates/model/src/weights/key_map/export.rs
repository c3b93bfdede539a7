use indexmap::IndexMap;

use super::{KeyMap, Rule, WHAT};
use crate::ModelError;
use crate::parameters::Parameter;
use crate::weights::{ImportReport, StoredTensor, StoredTensors};

impl KeyMap {
    /// Applies the rules backwards: our tensors with the names and shapes of the source format, without roots.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a tensor that no rule gives, or of which rules give only some parts, and for one that
    /// [`Self::apply`] does not read back: its new name is ignored, or begins with a root.
    pub fn export(&self, weights: &StoredTensors) -> Result<StoredTensors, ModelError> {
        let mut exported: IndexMap<String, StoredTensor> = IndexMap::new();
        let mut sources: IndexMap<&str, String> = IndexMap::new();
        for (name, tensor) in &weights.tensors {
            if self.rules.is_empty() {
                exported.insert(name.clone(), tensor.clone());
                sources.insert(name, name.clone());
                continue;
            }
            let mut parts_made = 0;
            let mut parts_needed = 1;
            for rule in &self.rules {
                let Some(captures) = rule.target_of(name) else { continue };
                let source = rule.from.filled(&captures);
                let is_first = self.rules.iter().find(|other| other.from.captures(&source).is_some());
                if !is_first.is_some_and(|first| std::ptr::eq(first, rule)) {
                    // Importing this name would use another rule.
                    sources.entry(name).or_insert(source);
                    continue;
                }
                let (part, count) = rule.part.unwrap_or((0, 1));
                // This rule alone makes the source, of a split for the first of its targets.
                if !exported.contains_key(&source) {
                    let whole = rule.joined(weights, &captures)?;
                    let tensor = if count > 1 { tensor.part(part, count)? } else { whole };
                    let tensor = if rule.transpose { tensor.transposed()? } else { tensor };
                    exported.insert(source.clone(), tensor);
                }
                sources.insert(name, source);
                parts_made += 1;
                parts_needed = count;
                if parts_made == parts_needed {
                    break;
                }
            }
            if parts_made < parts_needed {
                let expected = format!("a rule for each of {parts_needed} parts");
                return Err(ModelError::malformed(WHAT, format!("parameter {name}"), expected, parts_made));
            }
        }
        let exported = StoredTensors { tensors: exported, metadata: weights.metadata.clone() };
        self.check_export(weights, &exported, &sources)?;
        Ok(exported)
    }

    /// Checks that an import gives back every tensor. `sources`: a new name of each.
    fn check_export(
        &self,
        weights: &StoredTensors,
        exported: &StoredTensors,
        sources: &IndexMap<&str, String>,
    ) -> Result<(), ModelError> {
        let parameter = |(name, tensor): (&String, &StoredTensor)| Parameter {
            name: name.clone(),
            shape: tensor.shape().to_vec(),
            trained: true,
        };
        let expected: Vec<Parameter> = weights.tensors.iter().map(parameter).collect();
        let (found, report) = self.apply(exported, &expected);
        let is_equal = |name: &str, tensor: &StoredTensor| {
            found
                .tensors
                .get(name)
                .is_some_and(|found| found.dtype() == tensor.dtype() && found.bytes() == tensor.bytes())
        };
        let Some((name, _)) = weights.tensors.iter().find(|(name, tensor)| !is_equal(name, tensor)) else {
            return Ok(());
        };
        let source = sources.get(name.as_str()).map_or(name.as_str(), String::as_str);
        let found = self.read_as(source, name, &report);
        let expected = "a name under which the import reads it back";
        Err(ModelError::malformed(WHAT, format!("parameter {name}"), expected, found))
    }

    /// What an import makes of the name `source` of a parameter that it does not give back.
    fn read_as(&self, source: &str, parameter: &str, report: &ImportReport) -> String {
        let rootless = self.without_roots(source);
        let mismatched = report.mismatched.iter().find(|mismatched| mismatched.parameter == parameter);
        match mismatched {
            _ if report.ignored.iter().any(|ignored| ignored == source) => format!("{source}, which `ignore` matches"),
            _ if rootless != source => format!("{source}, which `roots` shorten to {rootless}"),
            Some(mismatched) => format!("{source}: {}", mismatched.found),
            None => format!("{source}, which it uses differently"),
        }
    }
}

impl Rule {
    /// What the wildcards match in a name that is one of the targets.
    fn target_of<'n>(&self, name: &'n str) -> Option<Vec<&'n str>> {
        self.targets.iter().find_map(|target| target.captures(name))
    }

    /// All targets of a rule, concatenated.
    fn joined(&self, weights: &StoredTensors, captures: &[&str]) -> Result<StoredTensor, ModelError> {
        let names: Vec<String> = self.targets.iter().map(|target| target.filled(captures)).collect();
        let parts: Option<Vec<&StoredTensor>> = names.iter().map(|name| weights.tensors.get(name)).collect();
        match parts.as_deref() {
            Some([whole]) => Ok((*whole).clone()),
            Some(parts) => Ok(StoredTensor::joined(parts)?),
            None => Err(ModelError::malformed(WHAT, "split", format!("all of {}", names.join(", ")), "some")),
        }
    }
}
