//! What a render reads, and must not overwrite.

use std::path::{Path, PathBuf};

use atsplat_eval::rendering::{
    ExposureSource, Exposures, FrameRequest, PathRecord, RENDER_RECORD, RenderPlan, RenderSettings, frame_file_name,
    ignored_principal_points,
};
use atsplat_files::canonical_path;
use atsplat_scene::camera_file::FileCamera;
use atsplat_scene::{Frame, SceneSource as _, Warnings, scene_key};
use atsplat_splat::scene_file::{SceneFile, SceneFileRecord};
use atsplat_splat::{Cleaning, Gaussians, SplatError};

use super::{Args, FormatArg};
use crate::overwrite::{check_outputs, photos};
use crate::parse::named;

/// The scene file, and how broken Gaussians are handled.
#[derive(Debug, clap::Args)]
pub(crate) struct SceneArgs {
    /// Gaussians: PLY (3DGS' or PlayCanvas' compressed), SPZ or .splat.
    scene: PathBuf,

    /// How Gaussians that cannot be rendered are handled. `import` removes NaN and replaces infinite opacity logits by ±20;
    /// `repair` repairs what can be repaired; `reject` removes every Gaussian with a problem, infinite logits of a PLY included
    /// (other formats store opacities, of which 0 and 1 are valid).
    #[arg(long, value_name = "POLICY", default_value = "import", value_parser = named(POLICIES))]
    clean: Cleaning,

    /// Read stored opacities of a PLY file as opacities, not logits, as written by the exporters of pixelSplat and NoPoSplat. Files
    /// of pixelSplat's and DepthSplat's exporters are also rotated and scaled, and have no harmonics.
    #[arg(long)]
    opacities_as_stored: bool,
}

const POLICIES: [(&str, Cleaning); 3] =
    [("import", Cleaning::Import), ("repair", Cleaning::Repair), ("reject", Cleaning::Reject)];

impl SceneArgs {
    fn read(&self) -> Result<SceneFile, SplatError> {
        SceneFile::read(&self.scene, self.clean, self.opacities_as_stored)
    }
}

/// What is rendered, and how.
pub(super) struct Inputs {
    pub(super) gaussians: Gaussians,
    pub(super) requests: Vec<FrameRequest>,
    pub(super) settings: RenderSettings,
    /// Seconds of reading the scene.
    pub(super) reading_secs: f64,
}

/// Where [`Inputs`] come from, for the record.
pub(super) struct Origin {
    pub(super) scene: SceneFileRecord,
    pub(super) path: PathRecord,
    /// Warnings.
    pub(super) notes: Vec<String>,
}

impl Inputs {
    /// Reads the scene, and plans its views.
    pub(super) fn read(
        args: &Args,
        cameras: Option<Vec<FileCamera>>,
        exposures: &Exposures,
    ) -> anyhow::Result<(Self, Origin)> {
        let constants = args.settings.constants()?;
        let scene = args.scene.read()?;
        let options = args.settings.options(constants, &scene, args.writes(FormatArg::Exr))?;
        let settings = args.effects.settings(options);
        let plan = args.views.plan(cameras, &scene, args.exposure.is_some())?;
        let RenderPlan { mut requests, path, notes: plan_notes } = plan;
        exposures.expose(&mut requests)?;
        let SceneFile { gaussians, record, warnings, reading_secs } = scene;
        let mut notes = [warnings, plan_notes].concat();
        notes.extend(args.settings.warning(&gaussians, settings.options.mode).map(str::to_owned));
        notes.extend(ignored_principal_points(&settings.options.constants, &requests));
        notes.extend(settings.options.ignored_harmonics(&gaussians));
        notes.extend(settings.options.differing_harmonics(&gaussians));
        Ok((Self { gaussians, requests, settings, reading_secs }, Origin { scene: record, path, notes }))
    }
}

impl Args {
    /// Rejects outputs that would overwrite the scene, the cameras, the photos of their dataset, exposures or constants.
    pub(super) fn check_outputs(&self, cameras: Option<&[FileCamera]>) -> anyhow::Result<()> {
        let exists = |file: &Path| file.symlink_metadata().is_ok();
        let mut written = self.output_files(&self.views.numbers(cameras)?);
        written.retain(|file| exists(file));
        let preview = self.preview.preview.as_ref().filter(|file| exists(file));
        // All written files are in one folder.
        let outputs: Vec<&PathBuf> = written.first().into_iter().chain(preview).collect();
        if outputs.is_empty() {
            return Ok(());
        }
        let cameras = self.views.file();
        let photographed = cameras.as_deref().map_or_else(Vec::new, |file| self.frames_of(file, &outputs));
        let exposures = match &self.exposure {
            Some(ExposureSource::File(file)) => Some(file.as_path()),
            _ => None,
        };
        let files = [
            ("scene", Some(self.scene.scene.as_path())),
            ("cameras", cameras.as_deref()),
            ("exposures", exposures),
            ("constants", self.settings.constants_file()),
        ];
        let inputs = || files.into_iter().filter_map(|(what, file)| Some((what, file?))).chain(photos(&photographed));
        check_outputs("--out", written, inputs())?;
        check_outputs("--preview", preview.cloned(), inputs())
    }

    /// The files in the folder of --out: the frames with these numbers, and the record.
    fn output_files(&self, numbers: &[usize]) -> Vec<PathBuf> {
        let formats = [(FormatArg::Png, "png"), (FormatArg::Exr, "exr")].into_iter();
        let formats: Vec<&str> = formats.filter_map(|(format, name)| self.writes(format).then_some(name)).collect();
        let images = numbers.iter().flat_map(|number| formats.iter().map(|format| frame_file_name(*number, format)));
        images.chain([RENDER_RECORD.to_owned()]).map(|name| self.out.join(name)).collect()
    }

    /// The frames of the scene that the cameras are of; of all scenes of the dataset, if one of the outputs is in its folder.
    fn frames_of(&self, cameras: &Path, outputs: &[&PathBuf]) -> Vec<Frame> {
        // Their faults were, or will be, reported when the cameras are read. Lists of cameras are not datasets.
        let mut unread = Warnings::new();
        let Ok(dataset) = atsplat_scene::open(cameras, &mut unread) else { return Vec::new() };
        let folder = if cameras.is_dir() { Some(cameras) } else { cameras.parent() };
        let folder = folder.and_then(|folder| canonical_path(folder).ok());
        let is_inside = |file: &Path| {
            canonical_path(file).is_ok_and(|file| folder.as_ref().is_some_and(|folder| file.starts_with(folder)))
        };
        let keys: Vec<&str> = if outputs.iter().any(|file| is_inside(file)) {
            dataset.keys().iter().map(String::as_str).collect()
        } else {
            scene_key(&dataset, self.views.key()).into_iter().collect()
        };
        keys.into_iter().filter_map(|key| dataset.load(key, &mut unread).ok()).flat_map(|scene| scene.frames).collect()
    }
}
