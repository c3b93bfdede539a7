//! What a render reads, and does not replace.

use std::path::{Path, PathBuf};

use atsplat_eval::rendering::{ExposureSource, RENDER_RECORD, frame_file_name};
use atsplat_scene::camera_file::FileCamera;
use atsplat_scene::{Frame, SceneSource as _, Warnings, scene_key};

use super::{Args, FormatArg};
use crate::paths::canonical_path;
use crate::replaced::{photos, refuse_replacing};

impl Args {
    /// Refuses files in the place of the scene, the cameras, the photos of their dataset, exposures and constants.
    pub(super) fn check_inputs(&self, cameras: Option<&[FileCamera]>) -> anyhow::Result<()> {
        let numbers = self.views.numbers(cameras)?;
        let formats = [(FormatArg::Png, "png"), (FormatArg::Exr, "exr")].into_iter();
        let formats: Vec<&str> = formats.filter_map(|(format, name)| self.writes(format).then_some(name)).collect();
        let names = numbers.iter().flat_map(|number| formats.iter().map(|format| frame_file_name(*number, format)));
        let names = names.chain([RENDER_RECORD.to_owned()]);
        let written: Vec<PathBuf> =
            names.map(|name| self.out.join(name)).filter(|file| file.symlink_metadata().is_ok()).collect();
        let preview: Vec<PathBuf> =
            self.preview.preview.iter().filter(|file| file.symlink_metadata().is_ok()).cloned().collect();
        if written.is_empty() && preview.is_empty() {
            return Ok(());
        }
        let cameras = self.views.file();
        let frames = cameras.as_deref().map_or_else(Vec::new, |file| self.frames_of(file, &written, &preview));
        let exposures = match &self.exposure {
            Some(ExposureSource::File(file)) => Some(file.as_path()),
            _ => None,
        };
        let files = [
            ("the scene", Some(self.scene.scene.as_path())),
            ("the cameras in", cameras.as_deref()),
            ("the exposures in", exposures),
            ("the constants in", self.settings.constants_file()),
        ];
        let read = || files.into_iter().filter_map(|(what, file)| Some((what, file?))).chain(photos(&frames));
        refuse_replacing("--out", written, read())?;
        refuse_replacing("--preview", preview, read())
    }

    /// The frames of the scene that the cameras are of; of all scenes of the dataset, if something is written in its folder.
    fn frames_of(&self, cameras: &Path, written: &[PathBuf], preview: &[PathBuf]) -> Vec<Frame> {
        // Their faults were, or will be, reported when the cameras are read. Lists of cameras are no dataset.
        let mut unread = Warnings::new();
        let Ok(dataset) = atsplat_scene::open(cameras, &mut unread) else { return Vec::new() };
        let folder = if cameras.is_dir() { Some(cameras) } else { cameras.parent() };
        let folder = folder.and_then(|folder| canonical_path(folder).ok());
        let is_inside = |file: &Path| {
            canonical_path(file).is_ok_and(|file| folder.as_ref().is_some_and(|folder| file.starts_with(folder)))
        };
        let keys: Vec<&str> = if [written, preview].iter().filter_map(|files| files.first()).any(|file| is_inside(file))
        {
            dataset.keys().iter().map(String::as_str).collect()
        } else {
            scene_key(&dataset, self.views.key()).into_iter().collect()
        };
        keys.into_iter().filter_map(|key| dataset.load(key, &mut unread).ok()).flat_map(|scene| scene.frames).collect()
    }
}
