//! Which networks a reproduction runs on which datasets.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::TrainedNetwork;
use crate::discovery::NotRun;
use crate::method::Method;
use crate::runner::Dataset;
use crate::weights_list::WeightsList;
use crate::{ComputeDevice, EvalError};

/// Presets of the paper's ablations; simulated presets may stand in for them.
const ABLATIONS: [&str; 2] = ["re10k-2v-256", "dl3dv-6v-256x448"];

/// Datasets that are evaluated with the same weights.
#[derive(Debug)]
pub struct TrainedGroup {
    /// The weights.
    pub trained: Arc<TrainedNetwork>,
    /// The datasets.
    pub datasets: Vec<Dataset>,
}

/// Methods of a store of ablations, and the datasets that they run on.
pub type Ablations = (Vec<Arc<dyn Method>>, Vec<Dataset>);

/// The networks of a list of weights, each loaded when it is first needed.
#[derive(Debug)]
pub struct TrainedNetworks {
    list: WeightsList,
    device: ComputeDevice,
    load: fn(&Path) -> Result<TrainedNetwork, EvalError>,
    loaded: BTreeMap<PathBuf, Arc<TrainedNetwork>>,
}

impl TrainedNetworks {
    /// Networks that `load` makes of the paths and names in a list.
    pub const fn new(
        list: WeightsList,
        device: ComputeDevice,
        load: fn(&Path) -> Result<TrainedNetwork, EvalError>,
    ) -> Self {
        Self { list, device, load, loaded: BTreeMap::new() }
    }

    /// Datasets by their weights, in the order of datasets; those without weights are not run.
    ///
    /// # Errors
    /// Those of loading weights.
    pub fn groups(
        &mut self,
        datasets: Vec<Dataset>,
        not_run: &mut Vec<NotRun>,
    ) -> Result<Vec<TrainedGroup>, EvalError> {
        let mut groups: Vec<(PathBuf, TrainedGroup)> = Vec::new();
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
                groups.push((file, TrainedGroup { trained, datasets: vec![dataset] }));
            }
        }
        Ok(groups.into_iter().map(|(_, group)| group).collect())
    }

    /// The variants with separate weights under a dataset's protocol.
    fn variants(&mut self, dataset: &Dataset) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let variants = self.list.variants(&dataset.preset).into_iter();
        let listed: Vec<(String, PathBuf)> =
            variants.map(|(name, file)| (name.replace('-', " "), file.to_owned())).collect();
        listed.into_iter().map(|(name, file)| self.load(&file)?.as_variant(&name)).collect()
    }

    /// Variants with separate weights, and for the protocols of the paper's ablations also those that change the network at
    /// inference, unless their name has separate weights. Datasets with the same variants share a store.
    ///
    /// # Errors
    /// Those of loading weights and of [`TrainedNetwork::variants`].
    pub fn ablations(&mut self, groups: Vec<TrainedGroup>) -> Result<Vec<Ablations>, EvalError> {
        let mut all: Vec<Ablations> = Vec::new();
        for TrainedGroup { trained, datasets } in groups {
            // Thresholds by quantile are those of the first dataset for all of them.
            let mut at_inference: Option<Vec<Arc<dyn Method>>> = None;
            let mut by_names: Vec<(Vec<String>, Ablations)> = Vec::new();
            for dataset in datasets {
                let mut methods = self.variants(&dataset)?;
                if ABLATIONS.contains(&dataset.preset.published()) {
                    let variants = match &at_inference {
                        Some(known) => known.clone(),
                        None => at_inference.insert(trained.variants(&dataset)?).clone(),
                    };
                    let taken: Vec<String> = methods.iter().map(|method| method.record().name).collect();
                    methods.extend(variants.into_iter().filter(|method| !taken.contains(&method.record().name)));
                }
                let names: Vec<String> = methods
                    .iter()
                    .map(|method| format!("{} {:?}", method.record().name, method.record().weights_sha256))
                    .collect();
                match by_names.iter_mut().find(|(known, _)| *known == names) {
                    _ if methods.is_empty() => {}
                    Some((_, (_, datasets))) => datasets.push(dataset),
                    None => by_names.push((names, (methods, vec![dataset]))),
                }
            }
            all.extend(by_names.into_iter().map(|(_, ablations)| ablations));
        }
        Ok(all)
    }

    fn load(&mut self, file: &Path) -> Result<Arc<TrainedNetwork>, EvalError> {
        if let Some(known) = self.loaded.get(file) {
            return Ok(Arc::clone(known));
        }
        let trained = Arc::new((self.load)(file)?.on(&self.device));
        self.loaded.insert(file.to_owned(), Arc::clone(&trained));
        Ok(trained)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_model::weights::TensorFile;

    use super::*;
    use crate::discovery::simulated_datasets;

    const MICRO_ROOMS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../eval/checkpoints/micro-rooms.safetensors");

    fn load(path: &Path) -> Result<TrainedNetwork, EvalError> {
        let file = if path == Path::new("micro-rooms") { Path::new(MICRO_ROOMS) } else { path };
        TrainedNetwork::new(&TensorFile::open(file)?, path.display().to_string())
    }

    #[test]
    fn datasets_are_grouped_by_their_weights_and_variants_have_names() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::copy(MICRO_ROOMS, folder.path().join("yards.safetensors")).unwrap();
        let list = folder.path().join("weights.toml");
        let text = "[[weights]]\nfile = 'micro-rooms'\npreset = 're10k-2v-256'\n\
                    [[weights]]\nfile = 'yards.safetensors'\ntable = 'dl3dv'\n\
                    [[weights]]\nfile = 'yards.safetensors'\ntable = 'unified'\nvariant = 'unified'\n";
        std::fs::write(&list, text).unwrap();
        let table =
            |name: &str, presets: &[&str]| (name.to_owned(), presets.iter().copied().map(str::to_owned).collect());
        let dl3dv = ["dl3dv-2v-256x448", "dl3dv-4v-256x448", "dl3dv-6v-256x448"];
        let tables = [table("dl3dv", &dl3dv), table("unified", &["re10k-2v-256", dl3dv[0]])].into();
        let list = WeightsList::read(&list, &tables, &["micro-rooms"]).unwrap();
        let mut networks = TrainedNetworks::new(list, ComputeDevice::default(), load);
        let mut not_run = Vec::new();
        let groups = networks.groups(simulated_datasets(|_, _| 1).unwrap(), &mut not_run).unwrap();
        let names: Vec<Vec<&str>> =
            groups.iter().map(|group| group.datasets.iter().map(|dataset| dataset.name.as_str()).collect()).collect();
        assert_eq!(names, [vec!["rooms-2v-128"], vec!["yards-2v-128x224", "yards-4v-128x224", "yards-6v-128x224"]]);
        assert_eq!(not_run.len(), 6, "the other stand-ins have no weights: {not_run:?}");
        let record = networks.variants(&groups[0].datasets[0]).unwrap().swap_remove(0).record();
        assert_eq!(record.name, "atsplat unified");
        assert_eq!(record.parameters["variant"], "unified");
        assert!(record.training.unwrap().data.contains("rooms"));
    }
}
