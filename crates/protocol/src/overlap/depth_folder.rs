use std::path::{Component, Path, PathBuf};

use atsplat_camera::ImageSize;
use atsplat_files::FileError;
use atsplat_pixels::DecodeLimits;
use atsplat_pixels::exr::{self, Values};

use super::{DepthMap, covisibility};
use crate::ProtocolError;

/// A folder of depth maps, `<scene key>/<frame name>.exr`: the channel `Z`, or the only channel, in scene units along
/// the camera's z axis, through the frame's lens. A map may have any scale, but not another shape than the frame's image. The file
/// may leave open what the values are, but not state that they are something else.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DepthFolder {
    root: PathBuf,
}

/// A depth map read from a [`DepthFolder`].
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedDepth {
    size: ImageSize,
    depths: Vec<f32>,
}

impl DepthFolder {
    /// Opens the folder at `root`.
    ///
    /// # Errors
    /// [`ProtocolError::Io`] if it cannot be read.
    pub fn open(root: &Path) -> Result<Self, ProtocolError> {
        std::fs::read_dir(root).map_err(FileError::during::<ProtocolError>("opening depth maps", root))?;
        Ok(Self { root: root.to_owned() })
    }

    /// Reads the depth map of one frame.
    ///
    /// # Errors
    /// [`ProtocolError::Io`], or [`ProtocolError::InFile`] around [`ProtocolError::Overlap`] for a path outside
    /// the folder and for a file without depth, or whose values are stated to be something else.
    pub fn load(&self, scene: &str, frame: &str) -> Result<LoadedDepth, ProtocolError> {
        let relative = Path::new(scene).join(format!("{frame}.exr"));
        let path = self.root.join(&relative);
        let unusable = |reason: String| ProtocolError::Overlap { estimator: covisibility::NAME, reason }.in_file(&path);
        if scene.is_empty() || !relative.components().all(|part| matches!(part, Component::Normal(_))) {
            return Err(unusable("expected a path inside the folder of depth maps".to_owned()));
        }
        let limits = DecodeLimits::default();
        let bytes =
            atsplat_files::read(&path).map_err(FileError::during::<ProtocolError>("reading a depth map", &path))?;
        let channels = exr::read(&bytes, &limits).map_err(|error| unusable(error.to_string()))?;
        let depth = match channels.channels() {
            [only] => only,
            _ => channels.get("Z").map_err(|error| unusable(error.to_string()))?,
        };
        if !matches!(depth.values, Values::Depth | Values::Unstated) {
            let reason = format!("the channel {:?}: expected depth, found {}", depth.name, depth.values);
            return Err(unusable(reason));
        }
        let size = ImageSize { width: channels.width(), height: channels.height() };
        Ok(LoadedDepth { size, depths: depth.samples.clone() })
    }
}

impl LoadedDepth {
    /// Columns and rows.
    pub const fn size(&self) -> ImageSize {
        self.size
    }

    /// The depth map for an [`super::OverlapView`].
    ///
    /// # Errors
    /// Those of [`DepthMap::new`]; never for a map from [`DepthFolder::load`].
    pub fn map(&self) -> Result<DepthMap<'_>, ProtocolError> {
        DepthMap::new(self.size, &self.depths)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_pixels::exr::{Channel, Channels};

    use super::*;

    fn write(path: &Path, names: &[&str]) {
        write_as(path, names, &Values::Depth);
    }

    fn write_as(path: &Path, names: &[&str], values: &Values) {
        let channel = |(at, name): (usize, &&str)| Channel {
            name: (*name).to_owned(),
            values: values.clone(),
            samples: vec![f32::from(u8::try_from(at).unwrap()) + 1.0; 6],
        };
        let channels = names.iter().enumerate().map(channel).collect();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, exr::write(&Channels::new(3, 2, channels).unwrap()).unwrap()).unwrap();
    }

    #[test]
    fn reads_the_channel_z_or_the_only_channel() {
        let folder = tempfile::tempdir().unwrap();
        let depths = DepthFolder::open(folder.path()).unwrap();
        write(&folder.path().join("s/0.exr"), &["R", "Z"]);
        write(&folder.path().join("s/deep/1.png.exr"), &["depth"]);
        write(&folder.path().join("s/2.exr"), &["R", "G"]);
        let loaded = depths.load("s", "0").unwrap();
        assert_eq!((loaded.size, loaded.depths.len()), (ImageSize { width: 3, height: 2 }, 6));
        assert!(loaded.map().is_ok() && depths.load("s", "deep/1.png").is_ok());
        let two = depths.load("s", "2").unwrap_err().to_string();
        assert!(two.contains('Z') && two.contains("2.exr"), "{two}");
        std::fs::write(folder.path().join("s/3.exr"), b"no image").unwrap();
        assert!(depths.load("s", "3").unwrap_err().to_string().contains("3.exr"));
        assert!(depths.load("s", "4").unwrap_err().to_string().starts_with("reading a depth map"));
    }

    #[test]
    fn values_that_are_stated_to_be_no_depth_are_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let depths = DepthFolder::open(folder.path()).unwrap();
        for (values, found) in [
            (Values::Depth, None),
            (Values::Unstated, None),
            (Values::Linear, Some("found linear")),
            (Values::DisplayReferred, Some("found sRGB-encoded display-referred")),
            (Values::Named("standard deviation of depth".to_owned()), Some("found standard deviation of depth")),
        ] {
            for names in [&["Z"][..], &["sigma"], &["A", "Z"]] {
                write_as(&folder.path().join("s/0.exr"), names, &values);
                let error = depths.load("s", "0").map(|_| ()).map_err(|error| error.to_string());
                match found {
                    None => assert_eq!(error, Ok(())),
                    Some(found) => {
                        let error = error.unwrap_err();
                        assert!(error.contains(found) && error.contains("expected depth"), "{names:?}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn rejects_paths_outside_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("0.exr"), &["Z"]);
        std::fs::create_dir(folder.path().join("depth")).unwrap();
        let depths = DepthFolder::open(&folder.path().join("depth")).unwrap();
        for (scene, frame) in [("..", "0"), ("s", "../../0"), ("", "0"), ("/", "0"), ("s", "/0")] {
            let error = depths.load(scene, frame).unwrap_err().to_string();
            assert!(error.contains("inside the folder"), "{scene:?} {frame:?}: {error}");
        }
        assert!(DepthFolder::open(&folder.path().join("nowhere")).is_err());
    }
}
