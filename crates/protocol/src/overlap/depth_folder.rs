use std::path::{Component, Path, PathBuf};

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::FileError;
use atsplat_pixels::exr::{self, Channel, Channels, Values};
use atsplat_pixels::{DecodeLimits, PixelError};
use atsplat_scene::Warnings;
use atsplat_scene::camera_file::{self, FileCamera, LensOfPoses};

use super::{DepthMap, covisibility};
use crate::ProtocolError;

/// The record that `atsplat render` writes next to its images.
const RECORD_OF_RENDERS: &str = "render.json";

/// A folder of depth maps, `<scene key>/<frame name>.exr`: the channel `Z`, the only channel, or the only one that states to be
/// depth; in scene units along the camera's z axis, through the frame's lens. A map may have any scale, but not another shape than
/// the frame's image. The file may leave open what the values are, but not state that they are something else.
///
/// The folder of a scene may also be one that `atsplat render --cameras` wrote for its cameras: it numbers its files, and its
/// `render.json` names the frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DepthFolder {
    root: PathBuf,
}

/// The depth maps of one scene in a [`DepthFolder`].
#[derive(Clone, Debug)]
pub struct SceneDepths {
    root: PathBuf,
    scene: String,
    /// The cameras of a record of renders; `None` in a folder without one. Otherwise, why it cannot be read.
    rendered: Result<Option<Vec<FileCamera>>, String>,
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

    /// The depth maps of one scene. A record of renders is read here, once for all frames; an error in it is one of each frame.
    pub fn of_scene(&self, scene: &str) -> SceneDepths {
        let record = self.root.join(scene).join(RECORD_OF_RENDERS);
        let rendered = if is_below(Path::new(scene)) && record.is_file() {
            let views = camera_file::read(&record, None, LensOfPoses::default(), &mut Warnings::new());
            views.map(Some).map_err(|error| error.to_string())
        } else {
            Ok(None)
        };
        SceneDepths { root: self.root.clone(), scene: scene.to_owned(), rendered }
    }
}

/// Whether a relative path leads to something below its folder, whatever is there.
fn is_below(relative: &Path) -> bool {
    let mut parts = relative.components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

impl SceneDepths {
    /// Reads the depth map of one frame, of which `camera` is the one in the data.
    ///
    /// # Errors
    /// [`ProtocolError::Io`], or [`ProtocolError::InFile`] around [`ProtocolError::Overlap`] for a path outside
    /// the folder, for a file without depth, or whose values are stated to be something else, and for renders of other cameras.
    pub fn load(&self, frame: &str, camera: &Camera) -> Result<LoadedDepth, ProtocolError> {
        let scene = Path::new(&self.scene);
        let relative = scene.join(format!("{frame}.exr"));
        let named = self.root.join(&relative);
        if !is_below(scene) || !is_below(&relative) {
            return Err(unusable("expected a path inside the folder of depth maps".to_owned()).in_file(&named));
        }
        let path = self.render_of(frame, camera)?.unwrap_or(named);
        let unusable = |reason: String| unusable(reason).in_file(&path);
        let limits = DecodeLimits::default();
        let bytes =
            atsplat_files::read(&path).map_err(FileError::during::<ProtocolError>("reading a depth map", &path))?;
        let channels = exr::read(&bytes, &limits).map_err(|error| unusable(error.to_string()))?;
        let depth = depth_channel(&channels).map_err(|error| unusable(error.to_string()))?;
        if !matches!(depth.values, Values::Depth | Values::Unstated) {
            let reason = format!("the channel {:?}: expected depth, found {}", depth.name, depth.values);
            return Err(unusable(reason));
        }
        let size = ImageSize { width: channels.width(), height: channels.height() };
        Ok(LoadedDepth { size, depths: depth.samples.clone() })
    }

    /// The render of a frame; `None` in a folder without a record of renders. One of a frame's name by another camera, such as the
    /// first of an orbit, which is called 0, is not taken for it.
    fn render_of(&self, frame: &str, camera: &Camera) -> Result<Option<PathBuf>, ProtocolError> {
        let views = self.rendered.as_ref().map_err(|reason| unusable(reason.clone()))?;
        let Some(views) = views else { return Ok(None) };
        let folder = self.root.join(&self.scene);
        let of_frame: Vec<_> = views.iter().filter(|view| view.name == frame).collect();
        let number = match of_frame.as_slice() {
            [view] if view.camera == *camera => Ok(view.number),
            [view] => Err(format!(
                "expected the camera of frame {frame:?}, found another one, with the number {}",
                view.number
            )),
            found => Err(format!("expected one view of frame {frame:?}, found {}", found.len())),
        };
        let number = number.map_err(|reason| unusable(reason).in_file(&folder.join(RECORD_OF_RENDERS)))?;
        Ok(Some(folder.join(format!("{number:06}.exr"))))
    }
}

/// The channel of depth: `atsplat render` writes `Z` and `median-depth`, of which one may be chosen.
fn depth_channel(channels: &Channels) -> Result<&Channel, PixelError> {
    let planes = channels.channels();
    channels.get("Z").or_else(|missing| {
        let mut of_depth = planes.iter().filter(|plane| plane.values == Values::Depth);
        let only = match planes {
            [only] => Some(only),
            _ => of_depth.next().filter(|_| of_depth.next().is_none()),
        };
        only.ok_or(missing)
    })
}

fn unusable(reason: String) -> ProtocolError {
    ProtocolError::Overlap { estimator: covisibility::NAME, reason }
}

impl LoadedDepth {
    /// Columns and rows.
    pub const fn size(&self) -> ImageSize {
        self.size
    }

    /// The depth map for an [`super::OverlapView`].
    ///
    /// # Errors
    /// Those of [`DepthMap::new`]; never for a map from [`SceneDepths::load`].
    pub fn map(&self) -> Result<DepthMap<'_>, ProtocolError> {
        DepthMap::new(self.size, &self.depths)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_scene::camera_file::CameraRecord;

    use super::*;
    use crate::test_source::camera;

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
        let depths = depths.of_scene("s");
        let loaded = depths.load("0", &camera(0.0)).unwrap();
        assert_eq!((loaded.size, loaded.depths.len()), (ImageSize { width: 3, height: 2 }, 6));
        assert!(loaded.map().is_ok() && depths.load("deep/1.png", &camera(0.0)).is_ok());
        let two = depths.load("2", &camera(0.0)).unwrap_err().to_string();
        assert!(two.contains('Z') && two.contains("2.exr"), "{two}");
        std::fs::write(folder.path().join("s/3.exr"), b"no image").unwrap();
        assert!(depths.load("3", &camera(0.0)).unwrap_err().to_string().contains("3.exr"));
        assert!(depths.load("4", &camera(0.0)).unwrap_err().to_string().starts_with("reading a depth map"));
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
                let error = depths.of_scene("s").load("0", &camera(0.0)).map(|_| ()).map_err(|error| error.to_string());
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

    /// Of the planes of a render, that which states to be depth: `median-depth`, if it was rendered without `Z`.
    #[test]
    fn the_only_channel_of_depth_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let depths = DepthFolder::open(folder.path()).unwrap();
        let plane = |name: &str, values: &Values, sample: f32| Channel {
            name: name.to_owned(),
            values: values.clone(),
            samples: vec![sample; 6],
        };
        let (colour, depth) = (Values::DisplayReferred, Values::Depth);
        std::fs::create_dir(folder.path().join("s")).unwrap();
        let found = |planes: Vec<Channel>| {
            let bytes = exr::write(&Channels::new(3, 2, planes).unwrap()).unwrap();
            std::fs::write(folder.path().join("s/0.exr"), bytes).unwrap();
            depths.of_scene("s").load("0", &camera(0.0)).map(|loaded| loaded.depths[0].to_bits()).ok()
        };
        let median = || plane("median-depth", &depth, 3.0);
        assert_eq!(found(vec![plane("R", &colour, 1.0), median()]), Some(3f32.to_bits()));
        assert_eq!(found(vec![plane("Z", &depth, 2.0), median()]), Some(2f32.to_bits()));
        assert_eq!(found(vec![plane("R", &colour, 1.0), plane("near", &depth, 2.0), median()]), None);
    }

    /// Numbers of renders are not those that frames may be named by. The record is read once, and not for each frame.
    #[test]
    fn renders_of_the_frames_are_found_by_their_record() {
        let folder = tempfile::tempdir().unwrap();
        let depths = DepthFolder::open(folder.path()).unwrap();
        let scene = folder.path().join("s");
        write(&scene.join("000000.exr"), &["Z"]);
        write(&scene.join("000001.exr"), &["A", "Z"]);
        let size = ImageSize { width: 3, height: 2 };
        let view =
            |number: usize, name: &str, x: f64| CameraRecord::new(number, name.to_owned(), &camera(x), size, None);
        let views = [view(0, "000001", 5.0), view(1, "000000", 7.0), view(2, "twice", 0.0), view(3, "twice", 0.0)];
        std::fs::write(scene.join("render.json"), serde_json::json!({ "views": views }).to_string()).unwrap();
        let depths = depths.of_scene("s");
        std::fs::remove_file(scene.join("render.json")).unwrap();
        let first = |frame: &str, x: f64| {
            depths.load(frame, &camera(x)).map(|loaded| loaded.depths[0].to_bits()).map_err(|error| error.to_string())
        };
        assert_eq!(first("000001", 5.0), Ok(1f32.to_bits()));
        assert_eq!(first("000000", 7.0), Ok(2f32.to_bits()));
        for (frame, x, expected) in [
            ("000001", 7.0, "expected the camera of frame \"000001\", found another one, with the number 0"),
            ("twice", 0.0, "expected one view of frame \"twice\", found 2"),
            ("elsewhere", 0.0, "expected one view of frame \"elsewhere\", found 0"),
        ] {
            let error = first(frame, x).unwrap_err();
            assert!(error.contains(expected) && error.contains("render.json"), "{frame}: {error}");
        }
    }

    /// The error is not one of the scene: entries that need no depth, or fail before, keep their reason.
    #[test]
    fn a_record_that_cannot_be_read_is_an_error_of_each_frame() {
        let folder = tempfile::tempdir().unwrap();
        for scene in ["s", "whole"] {
            write(&folder.path().join(scene).join("000000.exr"), &["Z"]);
        }
        std::fs::write(folder.path().join("s/render.json"), "{").unwrap();
        let depths = DepthFolder::open(folder.path()).unwrap();
        let broken = depths.of_scene("s");
        for frame in ["000000", "000001"] {
            let error = broken.load(frame, &camera(0.0)).unwrap_err().to_string();
            assert!(error.contains("render.json"), "{frame}: {error}");
        }
        assert!(depths.of_scene("whole").load("000000", &camera(0.0)).is_ok());
    }

    #[test]
    fn rejects_paths_outside_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("0.exr"), &["Z"]);
        std::fs::create_dir(folder.path().join("depth")).unwrap();
        let depths = DepthFolder::open(&folder.path().join("depth")).unwrap();
        for (scene, frame) in [("..", "0"), ("s", "../../0"), ("", "0"), ("/", "0"), ("s", "/0")] {
            let error = depths.of_scene(scene).load(frame, &camera(0.0)).unwrap_err().to_string();
            assert!(error.contains("inside the folder"), "{scene:?} {frame:?}: {error}");
        }
        assert!(DepthFolder::open(&folder.path().join("nowhere")).is_err());
    }
}
