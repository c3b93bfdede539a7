//! `transforms.json` in its dialects: nerfstudio and DL3DV, instant-ngp, Blender's synthetic scenes.

mod lens;
mod pictures;
mod source;
mod transforms;

pub use lens::{Focal, LensFields};
pub use source::{NerfstudioOptions, NerfstudioScenes};
pub use transforms::{ListedFrame, Transforms, parse_transforms};

pub(crate) use pictures::{FoundPicture, PictureFinder};
pub(crate) use source::scene_files;
