//! Reconstructs Gaussians from posed photos, any frames of any scene, with a network, and records everything the result
//! depends on.
//!
//! [`reconstruct`] is a single call. [`Photos`] and [`NetworkSource`] are its parts, for callers that also render targets,
//! check sizes before they load weights, or record where everything came from.
//!
//! ```no_run
//! use atsplat_eval::reconstruct::{NetworkSource, reconstruct};
//! use atsplat_model::ModelConfig;
//! use atsplat_model::network::Device;
//! use atsplat_scene::{SceneSource as _, Warnings};
//!
//! let dataset = atsplat_scene::open("capture", &mut Warnings::new())?;
//! let scene = dataset.load("garden", &mut Warnings::new())?;
//! let (network, _) = NetworkSource::untrained(ModelConfig::named("nano")?, 1).load(&Device::flex())?;
//! let (photos, reconstruction) = reconstruct(&network, scene, &[0, 5, 10], 0)?;
//! let gaussians = photos.in_scene(&reconstruction.gaussians)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod network_source;
mod photos;
mod record;
mod render_json;
mod renders;
mod report;
mod scene_file;

use atsplat_model::network::{Network, Reconstruction};
use atsplat_protocol::trial::Skipped;
use atsplat_scene::{Scene, Warnings};

pub use network_source::{BackboneRecord, ModelRecord, NetworkSource, UntrainedBackbone, WeightsRecord, WrittenFor};
pub use photos::{PhotoSelection, Photos, photo_recipe};
pub use record::{BlockRecord, InputRecord, NormalisationRecord, TokenRecord, ViewRecord, rounding_warning, warnings};
pub use render_json::rendered_scene;
pub use renders::{RendersRecord, write_renders};
pub use report::{Clock, MemoryRecord, PlotsRecord, Record, Report};
pub use scene_file::{OutputRecord, write_gaussians};

/// Why photos cannot be reconstructed.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum ReconstructError {
    /// The photos cannot become a trial.
    #[error("scene {:?}: {}: {}", .0.scene, .0.reason.name(), .0.detail)]
    Skipped(Skipped),
    /// No context view was selected.
    #[error("no context view")]
    NoContext,
    /// Context images of several sizes.
    #[error("expected context images of one size, found {expected} in frame {first} and {found} in frame {frame}")]
    Sizes { expected: atsplat_camera::ImageSize, first: usize, found: atsplat_camera::ImageSize, frame: usize },
    /// The network or its weights cannot be used.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// A photo cannot be read.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// The Gaussians cannot be transformed.
    #[error(transparent)]
    Gaussians(#[from] atsplat_splat::SplatError),
    /// A view cannot be rendered.
    #[error("rendering frame {frame}: {source}")]
    Render { frame: usize, source: atsplat_splat::SplatError },
    /// An image cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] atsplat_pixels::PixelError),
    /// A file cannot be written.
    #[error("writing {}: {source}", path.display())]
    Write { path: std::path::PathBuf, source: std::io::Error },
}

/// Reconstructs a scene from the frames at the positions `context`, at the network's resolution and in normalised poses.
/// `seed` is that of random token selection.
///
/// The Gaussians are in the network's frame, whose unit of length is that of the normalised poses; [`Photos::in_scene`]
/// transforms them into the axes and units of the scene.
///
/// # Errors
/// [`ReconstructError`] if the frames cannot be read or do not fit the network.
pub fn reconstruct(
    network: &Network,
    scene: Scene,
    context: &[usize],
    seed: u64,
) -> Result<(Photos, Reconstruction), ReconstructError> {
    let selection = PhotoSelection { context: context.to_vec(), targets: Vec::new() };
    let resolution = network.config().resolution;
    let photos = Photos::new(scene, selection, photo_recipe(resolution), &mut Warnings::new())?;
    photos.size()?;
    let reconstruction = network.reconstruct(&photos.views()?, seed)?;
    Ok((photos, reconstruction))
}

#[cfg(test)]
mod tests {
    use atsplat_model::ModelConfig;
    use atsplat_model::network::Device;
    use atsplat_rooms::{Request, SceneKind, SceneSeed, SimulatedScenes, Split};
    use atsplat_scene::SceneSource as _;

    use super::*;

    #[test]
    fn reconstructs_a_simulated_scene_in_one_call() {
        let seed = SceneSeed { split: Split::Test, number: 0 };
        let size = atsplat_camera::ImageSize { width: 32, height: 32 };
        let request = Request { size, frames: 8, samples: 1, ..Request::new(SceneKind::Rooms, seed) };
        let mut scenes = SimulatedScenes::new();
        scenes.add(request);
        let scene = scenes.load(&scenes.keys()[0], &mut Warnings::new()).unwrap();
        let config =
            ModelConfig { resolution: atsplat_model::ImageSize::new(32, 32), ..ModelConfig::named("nano").unwrap() };
        let (network, record) = NetworkSource::untrained(config, 1).load(&Device::flex()).unwrap();
        assert!(record.untrained().is_some());
        let (photos, reconstruction) = reconstruct(&network, scene.clone(), &[5, 0], 0).unwrap();
        assert_eq!(reconstruction.gaussians.len(), reconstruction.budget.gaussians);
        assert_eq!(photos.trial().context().iter().map(|view| view.frame).collect::<Vec<_>>(), [5, 0]);
        assert_eq!(photos.in_scene(&reconstruction.gaussians).unwrap().len(), reconstruction.gaussians.len());
        assert!(reconstruct(&network, scene, &[99], 0).is_err());
    }
}
