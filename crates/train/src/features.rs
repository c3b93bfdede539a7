//! What a frozen backbone makes of pictures, kept on disk: each picture goes through it once, however often it is drawn.

use atsplat_files::Sha256Digest;
use std::path::{Path, PathBuf};

use atsplat_model::network::{Network, Views};
use atsplat_model::weights::{StoredTensor, StoredTensors, TensorFile};
use atsplat_model::{ImageSize, ModelConfig};

use crate::TrainError;
use crate::samples::Posed;

const FEATURES: &str = "features";
const DIGEST: &str = "tensors-sha256";

/// A folder of files, one for each picture, named by all that features depend on: the backbone with its weights, the
/// picture with its size. A file that is not whole is made again. Several runs may share a folder.
#[derive(Debug)]
pub struct FeatureCache {
    folder: PathBuf,
}

impl FeatureCache {
    /// In a folder below `folder` that is this backbone's; `frozen` are its weights.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] where the backbone is trained with the rest, [`TrainError::Io`] where no folder can be made.
    pub fn open(folder: &Path, config: &ModelConfig, frozen: &StoredTensors) -> Result<Self, TrainError> {
        if !config.backbone.is_frozen() {
            let found = format!("{:?}", config.backbone);
            return Err(TrainError::malformed(
                "training configuration",
                "model.feature-cache",
                "a frozen backbone",
                found,
            ));
        }
        let (backbone, coarse) = (&config.backbone, &config.coarse);
        let identity = format!("{} {backbone:?} {} {}", frozen.digest(), coarse.patch_size, coarse.image_downscale);
        let folder = folder.join(Sha256Digest::of(identity.as_bytes()).to_string());
        std::fs::create_dir_all(&folder).map_err(TrainError::io("making a folder for features", &folder))?;
        Ok(Self { folder })
    }

    /// Views that the network need not send through its backbone. `network` has the weights of [`Self::open`].
    ///
    /// # Errors
    /// [`TrainError::Model`] for pictures that the network does not take, [`TrainError::Io`] where a file cannot be written.
    pub fn views(&self, network: &Network, posed: &Posed) -> Result<Views, TrainError> {
        let mut features = Vec::new();
        for (view, &camera) in posed.cameras.iter().enumerate() {
            let picture = posed.picture(view);
            let path = self.folder.join(format!("{}.safetensors", key(posed.size, picture)));
            features.extend(match read(&path) {
                Some(known) => known,
                None => make(network, &Views::new(posed.size, picture.to_vec(), vec![camera])?, &path)?,
            });
        }
        Ok(posed.views()?.with_frozen_features(features))
    }
}

fn make(network: &Network, view: &Views, path: &Path) -> Result<Vec<f32>, TrainError> {
    let features = network.frozen_features(view)?;
    let mut stored = StoredTensors::default();
    stored.tensors.insert(FEATURES.to_owned(), StoredTensor::from_f32(vec![features.len()], &features)?);
    stored.metadata.insert(DIGEST.to_owned(), stored.digest());
    stored.write(path)?;
    Ok(features)
}

/// `None` where there is no file, or one that is not whole.
fn read(path: &Path) -> Option<Vec<f32>> {
    let stored = TensorFile::open(path).ok()?.stored;
    let whole = stored.metadata.get(DIGEST) == Some(&stored.digest());
    stored.tensors.get(FEATURES).filter(|_| whole)?.to_f32().ok()
}

fn key(size: ImageSize, picture: &[f32]) -> String {
    let mut bytes = size.to_string().into_bytes();
    bytes.extend(picture.iter().flat_map(|value| value.to_le_bytes()));
    Sha256Digest::of(&bytes).to_string()
}
