//! `transforms.json` in its dialects: nerfstudio and DL3DV, `ScanNet++`, instant-ngp, Blender's synthetic scenes; camera paths of
//! nerfstudio's viewer.

mod camera_path;
mod layout;
mod lens;
mod open;
mod sizes;
mod source;
mod transforms;
mod unread_fields;

pub use lens::{Focal, LensFields};
pub use source::{AppliedTransform, NerfstudioOptions, NerfstudioScenes, SUBSET_PREFIX};
pub use transforms::{ListedFrame, Transforms, parse_transforms};

pub(crate) use camera_path::{camera_path, is_camera_path};
pub(crate) use layout::{LAYOUTS, transforms_in};
pub(crate) use open::READER;
