//! Files into scenes: RE10K trajectories, `.torch` chunks, nerfstudio and DL3DV `transforms.json`,
//! instant-ngp, COLMAP; the papers' preprocessing of pictures and intrinsics together; Arrow and
//! Parquet out. Knows nothing of models.

#[cfg(feature = "columns")]
pub mod columns;
mod dataset;
mod error;
#[cfg(feature = "columns")]
pub mod export;
pub mod geometry;
#[cfg(feature = "opencv")]
pub mod opencv;
pub mod preprocess;
mod scene;
mod shared_bytes;
#[cfg(all(test, feature = "columns"))]
mod test_source;
mod warnings;

pub use dataset::SceneSource;
pub use error::SceneError;
pub use scene::{Frame, Picture, Scene};
pub use shared_bytes::SharedBytes;
pub use warnings::{Warning, WarningKind, Warnings};
