//! Parameters, selections, neighbours and budgets agree with fixtures of the PyTorch reference in `oracle/`.

#![expect(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail like tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use atsplat_model::budget::Budget;
use atsplat_model::config::{BlockExpansion, ModelConfig, Selection};
use atsplat_model::farthest_point::farthest_points;
use atsplat_model::neighbours::nearest_neighbours;
use atsplat_model::parameters::parameters;
use atsplat_model::selection;
use atsplat_model::weights::{DType, StoredTensors, TensorFile};

struct Fixture {
    name: String,
    config: ModelConfig,
    stored: StoredTensors,
}

impl Fixture {
    fn all() -> Vec<Self> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/network");
        let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        assert!(paths.len() >= 25, "every variant has a fixture");
        paths.iter().map(|path| Self::read(path)).collect()
    }

    fn read(path: &std::path::Path) -> Self {
        let stored = TensorFile::open(path).unwrap().stored;
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let config =
            ModelConfig::from_toml(&stored.metadata["configuration"]).unwrap_or_else(|error| panic!("{name}: {error}"));
        Self { name, config, stored }
    }

    fn floats(&self, name: &str) -> Option<Vec<f32>> {
        self.stored.tensors.get(name).map(|tensor| tensor.to_f32().unwrap())
    }

    fn indices(&self, name: &str) -> Option<Vec<usize>> {
        let tensor = self.stored.tensors.get(name)?;
        assert_eq!(tensor.dtype(), DType::I32);
        let (elements, _) = tensor.bytes().as_chunks();
        Some(elements.iter().map(|bytes| usize::try_from(i32::from_le_bytes(*bytes)).unwrap()).collect())
    }

    fn anchors(&self) -> Option<Vec<[f32; 3]>> {
        self.floats("anchors").map(|numbers| numbers.as_chunks().0.to_vec())
    }

    fn gaussians(&self) -> usize {
        self.stored.tensors["opacity_logits"].shape()[0]
    }
}

#[test]
fn parameters_agree_with_pytorch() {
    for fixture in Fixture::all() {
        let theirs: BTreeMap<String, Vec<usize>> =
            serde_json::from_str(&fixture.stored.metadata["parameters"]).unwrap();
        // The reference lists only the parameters it uses, without those of disabled expansions.
        let unused = |name: &str| {
            let block = name.strip_prefix("decoder.blocks.").and_then(|rest| rest.split_once(".expansion."));
            block.is_some_and(|(block, _)| !fixture.config.decoder.blocks[block.parse::<usize>().unwrap()].expand)
        };
        let ours = parameters(&fixture.config).into_iter();
        let ours: BTreeMap<String, Vec<usize>> = ours
            .filter(|parameter| !unused(&parameter.name))
            .map(|parameter| (parameter.name, parameter.shape))
            .collect();
        assert_eq!(ours, theirs, "{}", fixture.name);
    }
}

#[test]
fn selections_agree_with_pytorch() {
    let mut chosen = 0;
    for fixture in Fixture::all() {
        let Fixture { name, config, .. } = &fixture;
        let mut anchors = fixture.anchors();
        let initial = fixture.gaussians();
        let mut tokens = anchors.as_ref().map_or(0, Vec::len);
        assert!(initial > 0);
        for (position, block) in config.decoder.blocks.iter().enumerate() {
            let Some(theirs) = fixture.indices(&format!("selected_{position}")) else {
                assert!(block.active_expansion().is_none(), "{name}");
                continue;
            };
            let parents = fixture.indices(&format!("parents_{position}")).unwrap();
            tokens = parents.len() - theirs.len() * (config.expansion.children - 1);
            let scores = fixture.floats(&format!("scores_{position}"));
            let count =
                |ratio: atsplat_model::config::SelectionRatio| ratio.of(tokens, config.expansion.ratio_rounding);
            let ours = match (config.expansion.selection, block.active_expansion().unwrap()) {
                (Selection::Random { seed }, BlockExpansion::Ratio(ratio)) => {
                    let call_seed = fixture.stored.metadata["call_seed"].parse().unwrap();
                    selection::random(tokens, count(ratio), &[seed, call_seed, position as u64])
                }
                (Selection::FarthestPoint {}, BlockExpansion::Ratio(ratio)) => {
                    farthest_points(anchors.as_deref().unwrap(), count(ratio)).unwrap()
                }
                (Selection::Uncertainty {} | Selection::StraightThrough {}, BlockExpansion::Ratio(ratio)) => {
                    selection::highest(&scores.unwrap(), count(ratio)).unwrap()
                }
                (_, BlockExpansion::Threshold(threshold)) => selection::above(&scores.unwrap(), threshold).unwrap(),
            };
            assert_eq!(ours, theirs, "{name}, block {position}");
            assert_eq!(
                selection::parents(tokens, &ours, config.expansion.children),
                parents,
                "{name}, block {position}"
            );
            anchors = anchors.map(|anchors| parents.iter().map(|&parent| anchors[parent]).collect());
            chosen += ours.len();
        }
        let last = fixture.gaussians() / config.head.gaussians_per_token;
        let left = fixture.indices(&format!("parents_{}", config.decoder.blocks.len() - 1)).map_or(tokens, |p| p.len());
        if left > 0 && config.decoder.blocks.last().unwrap().active_expansion().is_some() {
            assert_eq!(left, last, "{name}");
        }
    }
    assert!(chosen > 300, "the fixtures expand tokens: {chosen}");
}

/// The message for an unknown rule has the names of all.
#[test]
fn every_selection_rule_has_a_fixture() {
    let unknown = serde_json::from_value::<Selection>(serde_json::json!({ "kind": "" })).unwrap_err().to_string();
    let known: BTreeSet<&str> = unknown.split('`').skip(3).step_by(2).collect();
    assert!(known.contains("uncertainty") && known.len() > 3, "{unknown}");
    let fixtures = Fixture::all();
    let expands = |fixture: &&Fixture| fixture.config.expanding_blocks() > 0;
    let compared = fixtures.iter().filter(expands).map(|fixture| fixture.config.expansion.selection.name());
    assert_eq!(compared.collect::<BTreeSet<_>>(), known);
}

#[test]
fn neighbours_agree_with_pytorch() {
    let mut compared = 0;
    for fixture in Fixture::all() {
        let (Some(theirs), Some(anchors)) = (fixture.indices("neighbours"), fixture.anchors()) else { continue };
        let per_point = theirs.len() / anchors.len();
        let ours = nearest_neighbours(&anchors, per_point).unwrap();
        assert!(ours.indices.iter().map(|&index| index as usize).eq(theirs), "{}", fixture.name);
        compared += 1;
    }
    assert!(compared >= 15);
}

#[test]
fn budgets_agree_with_the_gaussians_of_pytorch() {
    for fixture in Fixture::all() {
        let config = &fixture.config;
        let range = atsplat_model::budget::budget(config, config.views, config.resolution).unwrap();
        let expanded: Vec<usize> = (0..config.decoder.blocks.len())
            .map(|block| fixture.indices(&format!("selected_{block}")).map_or(0, |selected| selected.len()))
            .collect();
        let counted = Budget::from_selections(config, range.min.initial_tokens, &expanded).unwrap();
        assert_eq!(counted.gaussians, fixture.gaussians(), "{}", fixture.name);
        match range.fixed() {
            Some(fixed) => assert_eq!(*fixed, counted, "{}", fixture.name),
            None => assert!((range.min.gaussians..=range.max.gaussians).contains(&counted.gaussians)),
        }
    }
}
