//! Cache on disk of a frozen backbone's features: each image goes through the backbone once, however often it is drawn.

use std::path::{Path, PathBuf};

use atsplat_files::{Sha256Digest, create_folder};
use atsplat_model::network::{MatmulPrecision, Network, Views};
use atsplat_model::weights::{StoredTensor, StoredTensors, TensorFile};
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_splat::cpu;

use crate::TrainError;
use crate::config::WHAT;
use crate::samples::PosedImages;

/// The version of the computation of features, to be raised whenever a bit of them changes.
const COMPUTATION: u32 = 1;
const FEATURES: &str = "features";
const DIGEST: &str = "tensors-sha256";

/// A folder with one file per image, named by everything that features depend on: the backbone with its weights, the precision
/// of its products, the type of processor, the version of the computation, and the image with its size. An incomplete file is computed
/// again. Several runs may share a folder.
#[derive(Debug)]
pub struct FeatureCache {
    folder: PathBuf,
}

impl FeatureCache {
    /// Opens this backbone's subfolder of `folder`; `frozen` are its weights, and `precision` is the matrix precision in whose scope features
    /// are computed.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if the backbone is trained, [`TrainError::Io`] if the folder cannot be created.
    pub fn open(
        folder: &Path,
        config: &ModelConfig,
        frozen: &StoredTensors,
        precision: MatmulPrecision,
    ) -> Result<Self, TrainError> {
        if !config.backbone.is_frozen() {
            let found = format!("{:?}", config.backbone);
            return Err(TrainError::malformed(WHAT, "model.feature-cache", "a frozen backbone", found));
        }
        let identity = identity(config, frozen, precision, &cpu::processor());
        let folder = folder.join(Sha256Digest::of(identity.as_bytes()).to_string());
        create_folder(&folder).map_err(TrainError::io("creating a folder for features", &folder))?;
        Ok(Self { folder })
    }

    /// Views with their features, so that the network skips its backbone. `network` must have the weights given to
    /// [`Self::open`].
    ///
    /// # Errors
    /// [`TrainError::Model`] if the network rejects the images or a file cannot be written.
    pub fn views(&self, network: &Network, posed: &PosedImages) -> Result<Views, TrainError> {
        let mut features = Vec::new();
        for (view, &camera) in posed.cameras.iter().enumerate() {
            let image = posed.image(view);
            let path = self.folder.join(format!("{}.safetensors", key(posed.size, image)));
            let cached = read(&path);
            tracing::debug!(file = %path.display(), is_cached = cached.is_some(), "features of an image");
            features.extend(if let Some(cached) = cached {
                cached
            } else {
                let view = Views::new(posed.size, image.to_vec(), vec![camera])?;
                let computed = network.frozen_features(&view)?;
                write(&path, &computed)?;
                computed
            });
        }
        Ok(posed.views()?.with_frozen_features(features))
    }
}

/// What features of an image depend on.
fn identity(config: &ModelConfig, frozen: &StoredTensors, precision: MatmulPrecision, processor: &str) -> String {
    let (backbone, coarse, weights, precision) = (&config.backbone, &config.coarse, frozen.digest(), precision.name());
    let (patch_size, downscale) = (coarse.patch_size, coarse.image_downscale);
    format!("{COMPUTATION} {weights} {backbone:?} {patch_size} {downscale} {precision} {processor}")
}

fn write(path: &Path, features: &[f32]) -> Result<(), TrainError> {
    let tensor = StoredTensor::from_f32(vec![features.len()], features)?;
    let mut stored = StoredTensors::default();
    stored.tensors.insert(FEATURES.to_owned(), tensor);
    stored.metadata.insert(DIGEST.to_owned(), stored.digest());
    Ok(stored.write(path)?)
}

/// `None` if the file is absent, unreadable or incomplete: its features are then computed again.
fn read(path: &Path) -> Option<Vec<f32>> {
    let stored = TensorFile::open(path).ok()?.stored;
    let is_complete = stored.metadata.get(DIGEST) == Some(&stored.digest());
    stored.tensors.get(FEATURES).filter(|_| is_complete)?.to_f32().ok()
}

fn key(size: ImageSize, image: &[f32]) -> String {
    let mut bytes = size.to_string().into_bytes();
    bytes.extend(image.iter().flat_map(|value| value.to_le_bytes()));
    Sha256Digest::of(&bytes).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Products have other bits on other processors, and in other precisions.
    #[test]
    fn processors_and_precisions_have_features_of_their_own() {
        let (config, frozen) = (ModelConfig::named("paper-re10k").unwrap(), StoredTensors::default());
        let identity_of = |precision, processor| identity(&config, &frozen, precision, processor);
        let first = identity_of(MatmulPrecision::F32, "a processor");
        assert_eq!(first, identity_of(MatmulPrecision::F32, "a processor"));
        assert_ne!(first, identity_of(MatmulPrecision::F32, "another"));
        assert_ne!(first, identity_of(MatmulPrecision::Bf16, "a processor"));
    }
}
