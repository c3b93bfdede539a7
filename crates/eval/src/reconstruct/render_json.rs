use std::path::Path;

use atsplat_scene::camera_file::{self, CameraFileError, FileCamera, LensOfPoses};
use atsplat_scene::{Frame, FrameImage, Scene, Warnings};

use crate::rendering::frame_file_name;

/// Output of `atsplat render` as a scene; `None` for anything but a `render.json` or a folder with one.
///
/// # Errors
/// [`CameraFileError`] if its cameras cannot be read.
pub fn rendered_scene(path: &Path) -> Result<Option<Scene>, CameraFileError> {
    const RECORD: &str = "render.json";
    let file = if path.is_dir() { path.join(RECORD) } else { path.to_owned() };
    if !file.is_file() || file.file_name().is_none_or(|name| name != RECORD) {
        return Ok(None);
    }
    let folder = file.parent().unwrap_or(Path::new("."));
    let cameras = camera_file::read(&file, None, LensOfPoses::default(), &mut Warnings::new())?;
    let frame = |FileCamera { number, name, camera, size, .. }: FileCamera| {
        let image = folder.join(frame_file_name(number, "png"));
        Frame {
            name,
            timestamp_micros: None,
            camera,
            stated_size: size,
            image: if image.is_file() { FrameImage::File(image) } else { FrameImage::Missing(image) },
        }
    };
    let frames = cameras.into_iter().map(frame).collect();
    Ok(Some(Scene { key: "render".to_owned(), url: None, frames }))
}
