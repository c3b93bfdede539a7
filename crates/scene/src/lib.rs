//! Dataset readers: RE10K trajectories, `.torch` chunks, `transforms.json` (nerfstudio, DL3DV, `ScanNet++`, instant-ngp) and COLMAP
//! models. Also the papers' joint preprocessing of images and intrinsics, dataset statistics and checks, and export to
//! Arrow, Parquet and CSV. Independent of models.

pub mod camera_file;
mod checks;
pub mod colmap;
#[cfg(feature = "columns")]
pub mod columns;
mod composited;
mod dataset;
mod error;
#[cfg(feature = "columns")]
pub mod export;
mod fetch;
mod files;
mod format;
mod frame_selection;
pub mod geometry;
mod image_finder;
mod image_options;
#[cfg(feature = "columns")]
pub mod inspect;
pub mod json;
pub mod nerfstudio;
mod number;
mod open;
pub mod poses;
pub mod preprocess;
pub mod re10k;
mod scene;
mod scene_key;
mod scene_reader;
#[cfg(all(test, feature = "columns"))]
mod test_source;
pub mod torch;
mod trained_camera;
mod warnings;

pub use atsplat_files::is_plain_name;
pub use atsplat_pickle::SharedBytes;
pub use checks::image_mismatch::{ImageMismatch, is_scaled_copy, pixel_mismatch, ratio_of_focal_lengths};
pub use colmap::{ColmapOptions, ColmapScenes};
pub use dataset::{OneScene, SceneSource, load_scenes};
pub use error::SceneError;
pub use fetch::Fetch;
pub use files::is_image_name;
pub use format::Format;
pub use frame_selection::{FrameSelection, InvalidSelection};
pub use image_options::{ImageOptions, UnreadOption};
pub use nerfstudio::{NerfstudioOptions, NerfstudioScenes};
pub use open::{Dataset, OpenOptions, open, open_with};
pub use re10k::{Re10kOptions, Re10kScenes};
pub use scene::{Frame, FrameImage, GeneratedImage, ImageFolder, ImageHeader, Scene, TimestampSource};
pub use scene_key::{AmbiguousScene, scene_key};
pub use warnings::{Warning, WarningKind, Warnings};

pub(crate) use scene_reader::SceneReader;
