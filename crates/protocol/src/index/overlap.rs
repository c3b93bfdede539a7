use crate::EvaluationIndex;

/// How much an entry's context views see of each other, and who says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// From 0 to 1.
    pub value: f64,
    /// What measured it, by [`crate::overlap::OverlapEstimator::name`]; `None` where the index does not say, as no
    /// published one does.
    pub estimator: Option<String>,
}

impl From<f64> for Overlap {
    /// A value of which nobody says how it was measured.
    fn from(value: f64) -> Self {
        Self { value, estimator: None }
    }
}

impl EvaluationIndex {
    /// Names of the estimators that the index records, sorted, each once.
    pub fn overlap_estimators(&self) -> Vec<String> {
        let recorded = self.entries().filter_map(|(_, _, entry)| entry.overlap.as_ref()?.estimator.clone());
        recorded.collect::<std::collections::BTreeSet<_>>().into_iter().collect()
    }

    /// Every overlap in index order.
    pub fn overlaps(&self) -> impl Iterator<Item = &Overlap> {
        self.entries().filter_map(|(_, _, entry)| entry.overlap.as_ref())
    }
}
