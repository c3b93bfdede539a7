use indexmap::IndexMap;

/// Which frames of one scene are given and which are asked for.
///
/// Frame numbers are positions in [`atsplat_scene::Scene::frames`], not timestamps or file numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct IndexEntry {
    /// Frames that a method sees, in the index's order.
    pub context: Vec<usize>,
    /// Frames that it is scored on, in the index's order; may repeat a context frame ("leaked").
    pub target: Vec<usize>,
    /// Overlap of the context views in [0, 1], where the index ships one (NoPoSplat).
    pub overlap: Option<f64>,
}

/// An evaluation index: scene keys in file order, each with no entry (`null`), one, or several
/// (latentSplat). The format of pixelSplat, NoPoSplat, DepthSplat and latentSplat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluationIndex {
    /// Scene key → entries. An empty list is the file's `null`: a scene that the protocol leaves out.
    pub scenes: IndexMap<String, Vec<IndexEntry>>,
}
