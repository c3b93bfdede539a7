//! Which networks a reproduction runs on which datasets.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_eval::ComputeDevice;
use atsplat_eval::discovery::NotRun;
use atsplat_eval::method::Method;
use atsplat_eval::runner::Dataset;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_eval::weights_list::WeightsList;
use atsplat_report::definition::TableDefinition;

use crate::embedded;

/// Datasets that are evaluated with the same weights.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) trained: Arc<TrainedNetwork>,
    pub(super) datasets: Vec<Dataset>,
}

/// The networks of a reproduction.
#[derive(Debug)]
pub(super) struct Listed {
    list: WeightsList,
    device: ComputeDevice,
    loaded: BTreeMap<PathBuf, Arc<TrainedNetwork>>,
}

impl Listed {
    /// From `--weights`: a weights file, a list (`.toml`), or by default the embedded weights.
    pub(super) fn new(argument: Option<&Path>, device: ComputeDevice) -> anyhow::Result<Self> {
        let list = match argument {
            None => WeightsList::one(PathBuf::from(embedded::MICRO_ROOMS)),
            Some(path) if path.extension().is_some_and(|extension| extension == "toml") => {
                WeightsList::read(path, &tables()?, &[embedded::MICRO_ROOMS])?
            }
            Some(path) => WeightsList::one(path.to_owned()),
        };
        Ok(Self { list, device, loaded: BTreeMap::new() })
    }

    /// Datasets by their weights, in the order of datasets; those without weights are not run.
    pub(super) fn groups(&mut self, datasets: Vec<Dataset>, not_run: &mut Vec<NotRun>) -> anyhow::Result<Vec<Group>> {
        let mut groups: Vec<(PathBuf, Group)> = Vec::new();
        for dataset in datasets {
            let Some(file) = self.list.network(&dataset.preset).map(Path::to_owned) else {
                let why = "the list of weights has no entry for this protocol".to_owned();
                not_run.push(NotRun { what: dataset.name, why });
                continue;
            };
            if let Some((_, group)) = groups.iter_mut().find(|(known, _)| *known == file) {
                group.datasets.push(dataset);
            } else {
                let trained = self.load(&file)?;
                groups.push((file, Group { trained, datasets: vec![dataset] }));
            }
        }
        Ok(groups.into_iter().map(|(_, group)| group).collect())
    }

    /// The variants with weights of their own under a dataset's protocol, by name.
    pub(super) fn variants(&mut self, dataset: &Dataset) -> anyhow::Result<Vec<(String, Arc<dyn Method>)>> {
        let listed = self.list.variants(&dataset.preset);
        let listed: Vec<(String, PathBuf)> =
            listed.into_iter().map(|(name, file)| (name.to_owned(), file.to_owned())).collect();
        let method = |(name, file): (String, PathBuf)| {
            let method = self.load(&file)?.as_variant(&name.replace('-', " "))?;
            Ok((name, method))
        };
        listed.into_iter().map(method).collect()
    }

    fn load(&mut self, file: &Path) -> anyhow::Result<Arc<TrainedNetwork>> {
        if let Some(known) = self.loaded.get(file) {
            return Ok(Arc::clone(known));
        }
        let by_default = file == Path::new(embedded::MICRO_ROOMS) && !file.exists();
        let trained = embedded::trained((!by_default).then_some(file))?;
        let trained = Arc::new(trained.on(&self.device));
        self.loaded.insert(file.to_owned(), Arc::clone(&trained));
        Ok(trained)
    }
}

/// The protocols of each table.
fn tables() -> anyhow::Result<BTreeMap<String, Vec<String>>> {
    let protocols = |name: &str| {
        let definition = TableDefinition::named(name)?;
        Ok((name.to_owned(), definition.presets().into_iter().map(str::to_owned).collect()))
    };
    TableDefinition::names().map(protocols).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_eval::discovery::simulated_datasets;

    #[test]
    fn datasets_are_grouped_by_their_weights_and_variants_have_names() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = std::fs::read("../../eval/checkpoints/micro-rooms.safetensors").unwrap();
        std::fs::write(folder.path().join("yards.safetensors"), bytes).unwrap();
        let list = folder.path().join("weights.toml");
        let text = "[[weights]]\nfile = 'micro-rooms'\npreset = 're10k-2v-256'\n\
                    [[weights]]\nfile = 'yards.safetensors'\ntable = 'dl3dv'\n\
                    [[weights]]\nfile = 'yards.safetensors'\ntable = 'unified'\nvariant = 'unified'\n";
        std::fs::write(&list, text).unwrap();
        let mut networks = Listed::new(Some(&list), ComputeDevice::default()).unwrap();
        let mut not_run = Vec::new();
        let groups = networks.groups(simulated_datasets(|_, _| 1).unwrap(), &mut not_run).unwrap();
        let names: Vec<Vec<&str>> =
            groups.iter().map(|group| group.datasets.iter().map(|own| own.name.as_str()).collect()).collect();
        assert_eq!(names, [vec!["rooms-2v-128"], vec!["yards-2v-128x224", "yards-4v-128x224", "yards-6v-128x224"]]);
        assert_eq!(not_run.len(), 6, "the other stand-ins have no weights: {not_run:?}");
        let (name, method) = networks.variants(&groups[0].datasets[0]).unwrap().swap_remove(0);
        let record = method.record();
        assert_eq!((name.as_str(), record.name.as_str()), ("unified", "atsplat unified"));
        assert_eq!(record.parameters["variant"], "unified");
        assert!(record.training.unwrap().data.contains("rooms"));
    }

    #[test]
    fn a_list_with_an_unknown_table_is_an_error_with_its_field() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("weights.toml");
        std::fs::write(&list, "[[weights]]\nfile = 'a'\ntable = 're20k'\n").unwrap();
        let error = Listed::new(Some(&list), ComputeDevice::default()).unwrap_err().to_string();
        assert!(error.contains("weights entry 1, table: expected one of") && error.contains("weights.toml"), "{error}");
    }
}
