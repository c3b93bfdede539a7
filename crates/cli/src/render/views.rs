use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_camera::{Camera, CameraSpline, Distortion, ImageSize, NormalizedIntrinsics, Spacing, Turntable};
use atsplat_scene::Warnings;
use atsplat_splat::{Exposure, Gaussians, RenderOptions, View};
use clap::{ArgGroup, Args, ValueEnum};
use serde::Serialize;

use super::camera_file::{self, FileCamera, LensOfPoses};
use super::framing;
use super::words::{self, Axis};
use crate::selection::Selection;

/// Size of pictures of an orbit.
const ORBIT_SIZE: ImageSize = ImageSize { width: 960, height: 540 };
/// Degrees from the left edge of those to the right.
const ORBIT_FOV: f64 = 50.0;
const DEFAULT_FRAMES: &str = "60";

/// Where the cameras come from.
#[derive(Debug, Args)]
#[group(skip)]
#[command(group = ArgGroup::new("path").required(true).args(["cameras", "orbit", "spline"]))]
pub(crate) struct ViewWords {
    /// Every camera of FILE: any dataset that `data inspect` reads, 3DGS' `cameras.json`, a `render.json`, or a JSON list of
    /// matrices from the world to the camera, as MotionCtrl has them (with --fov and --size).
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,

    /// N views on a circle around the scene.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = DEFAULT_FRAMES, value_parser = words::frames)]
    orbit: Option<usize>,

    /// N views on a smooth path through the cameras of FILE; 60 by default.
    #[arg(long, value_names = ["FILE", "N"], num_args = 1..=2)]
    spline: Option<Vec<String>>,

    /// Which cameras of FILE, counted from 0: `0,29,100..200:10`.
    #[arg(long, value_name = "SEL", conflicts_with = "orbit")]
    frames: Option<Selection>,

    /// Which scene of FILE, where it holds several.
    #[arg(long, value_name = "KEY", conflicts_with = "orbit")]
    key: Option<String>,

    /// Pixels; by default what FILE says, 960x540 for an orbit.
    #[arg(long, value_name = "WxH", value_parser = words::size)]
    size: Option<ImageSize>,

    /// Take cameras for pinholes, whatever FILE says of their lenses.
    #[arg(long, conflicts_with = "orbit")]
    no_distortion: bool,

    /// Close the path: after the last camera back to the first.
    #[arg(long, conflicts_with_all = ["cameras", "orbit"])]
    closed: bool,

    /// What is even along the path: the way between views, or the time between cameras.
    #[arg(long, value_name = "WHAT", conflicts_with_all = ["cameras", "orbit"], default_value = "way")]
    spacing: SpacingWord,

    /// Degrees above the horizon.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "15", allow_negative_numbers = true, value_parser = words::elevation)]
    elevation: f64,

    /// Distance in multiples of that which just frames the bulk of the scene.
    #[arg(long, value_name = "FACTOR", conflicts_with_all = ["cameras", "spline"], default_value = "1", value_parser = words::positive)]
    distance: f64,

    /// Upwards in the scene; -y is that of OpenCV's and 3DGS' axes.
    #[arg(long, value_name = "AXIS", conflicts_with_all = ["cameras", "spline"], default_value = "-y", allow_hyphen_values = true)]
    up: Axis,

    /// Degrees from the left edge to the right: of an orbit, where it is 50 by default, and of cameras whose file holds
    /// poses alone.
    #[arg(long, value_name = "DEGREES", value_parser = words::angle)]
    fov: Option<f64>,

    /// Degrees at which the orbit begins, to the camera's right.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "0", allow_negative_numbers = true, value_parser = words::finite)]
    azimuth: f64,

    /// Degrees around.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "360", allow_negative_numbers = true, value_parser = words::finite)]
    sweep: f64,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SpacingWord {
    Way,
    Time,
}

/// One picture to take.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// Names its files.
    pub(crate) number: usize,
    pub(crate) name: String,
    pub(crate) view: View,
    pub(crate) exposure: Option<Exposure>,
}

impl Shot {
    /// The same options with this picture's exposure.
    pub(crate) fn exposed(&self, options: &RenderOptions) -> RenderOptions {
        RenderOptions { exposure: self.exposure, ..options.clone() }
    }
}

/// The pictures to take, and how their cameras were found.
#[derive(Debug)]
pub(crate) struct Plan {
    pub(crate) shots: Vec<Shot>,
    pub(crate) path: PathRecord,
    /// What a user should know.
    pub(crate) notes: Vec<String>,
}

/// How the cameras were found.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(crate) enum PathRecord {
    Cameras {
        file: PathBuf,
    },
    Orbit {
        target: [f64; 3],
        up: [f64; 3],
        distance: f64,
        framed_radius: f64,
        elevation_degrees: f64,
        azimuth_degrees: f64,
        sweep_degrees: f64,
    },
    Spline {
        file: PathBuf,
        keys: usize,
        closed: bool,
        spacing: Spacing,
    },
}

impl ViewWords {
    /// What can be told wrong before any file is read.
    pub(crate) fn check(&self) -> Result<(), String> {
        self.spline_frames().map(|_| ())
    }

    fn spline_frames(&self) -> Result<usize, String> {
        let count = self.spline.as_ref().and_then(|words| words.get(1)).map_or(DEFAULT_FRAMES, String::as_str);
        words::frames(count).map_err(|error| format!("--spline: {error}"))
    }

    fn file(&self) -> Option<PathBuf> {
        self.cameras.clone().or_else(|| Some(PathBuf::from(self.spline.as_ref()?.first()?)))
    }

    /// Refuses to replace the cameras by their record, which may hold fewer.
    pub(crate) fn spare(&self, record: &Path) -> anyhow::Result<()> {
        let (file, record) = (self.file().and_then(|file| file.canonicalize().ok()), record.canonicalize().ok());
        match file.filter(|file| Some(file) == record.as_ref()) {
            Some(file) => bail!("--out would replace the cameras in {}: choose another folder", file.display()),
            None => Ok(()),
        }
    }

    /// The cameras of FILE, read before the scene is.
    pub(crate) fn read(&self, warnings: &mut Warnings) -> anyhow::Result<Option<Vec<FileCamera>>> {
        let Some(file) = self.file() else { return Ok(None) };
        let lens = LensOfPoses { fov: self.fov, size: self.size };
        let mut cameras = camera_file::read(&file, self.key.as_deref(), lens, warnings)?;
        if let Some(selection) = &self.frames {
            let picked = selection.of("--frames", cameras.len())?;
            cameras = picked.into_iter().filter_map(|position| cameras.get(position).cloned()).collect();
        }
        if self.no_distortion {
            for camera in &mut cameras {
                camera.camera.distortion = Distortion::None;
            }
        }
        Ok(Some(cameras))
    }

    /// The pictures to take of these Gaussians.
    pub(crate) fn plan(&self, cameras: Option<Vec<FileCamera>>, gaussians: &Gaussians) -> anyhow::Result<Plan> {
        let mut notes = Vec::new();
        let Some(cameras) = cameras else { return self.orbit(gaussians) };
        if let Some(file) = &self.cameras {
            let shots = self.along(cameras, &mut notes)?;
            return Ok(Plan { shots, path: PathRecord::Cameras { file: file.clone() }, notes });
        }
        let size = self.size_of(cameras.first(), &mut notes)?;
        if cameras.iter().any(|key| key.exposure.is_some()) {
            notes.push("a path between cameras takes none of their exposures: see --exposure".to_owned());
        }
        let keys: Vec<Camera> = cameras.iter().map(|key| key.camera).collect();
        let count = self.spline_frames().map_err(anyhow::Error::msg)?;
        let spacing = match self.spacing {
            SpacingWord::Way => Spacing::ArcLength,
            SpacingWord::Time => Spacing::Time,
        };
        let file = self.file().unwrap_or_default();
        let path = PathRecord::Spline { file, keys: keys.len(), closed: self.closed, spacing };
        let spline = if self.closed { CameraSpline::closed(keys)? } else { CameraSpline::open(keys)? };
        let views = spline.resampled(count, spacing)?;
        Ok(Plan { shots: numbered(views, size), path, notes })
    }

    fn along(&self, cameras: Vec<FileCamera>, notes: &mut Vec<String>) -> anyhow::Result<Vec<Shot>> {
        let mut shots: Vec<Shot> = Vec::with_capacity(cameras.len());
        for camera in cameras {
            let size = self.size_of(Some(&camera), notes)?;
            if let Some(other) = shots.iter().find(|shot| shot.number == camera.number) {
                bail!("cameras {:?} and {:?} both have the number {}", other.name, camera.name, camera.number);
            }
            let FileCamera { number, name, camera, exposure, .. } = camera;
            shots.push(Shot { number, name, view: View { camera, size }, exposure });
        }
        Ok(shots)
    }

    /// What was asked for, or what the file says; a picture squeezed in one direction is told once.
    fn size_of(&self, camera: Option<&FileCamera>, notes: &mut Vec<String>) -> anyhow::Result<ImageSize> {
        let stated = camera.and_then(|camera| camera.size);
        let shape = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
        if let (Some(asked), Some(stated)) = (self.size, stated)
            && (shape(asked) / shape(stated) - 1.0).abs() > 0.01
            && notes.is_empty()
        {
            notes.push(format!("--size {asked} squeezes what the cameras see at {stated}: its shape is another"));
        }
        self.size.or(stated).context("the cameras come without a picture size: say which with --size")
    }

    fn orbit(&self, gaussians: &Gaussians) -> anyhow::Result<Plan> {
        let count = self.orbit.unwrap_or(1);
        let sphere = framing::bulk(gaussians).context("the scene has no visible Gaussian to orbit")?;
        let size = self.size.unwrap_or(ORBIT_SIZE);
        let intrinsics = NormalizedIntrinsics::with_horizontal_view(radians(self.fov.unwrap_or(ORBIT_FOV)), size)?;
        let distance = self.distance * intrinsics.distance_that_frames(sphere.radius)?;
        let table = Turntable {
            target: sphere.centre,
            up: self.up.vector(),
            distance,
            elevation: radians(self.elevation),
            azimuth: radians(self.azimuth),
            sweep: radians(self.sweep),
        };
        let poses = table.poses(count)?;
        let views = poses.iter().map(|pose| Camera::pinhole(pose.inverse(), intrinsics)).collect();
        let path = PathRecord::Orbit {
            target: table.target.to_array(),
            up: table.up.to_array(),
            distance,
            framed_radius: sphere.radius,
            elevation_degrees: self.elevation,
            azimuth_degrees: self.azimuth,
            sweep_degrees: self.sweep,
        };
        Ok(Plan { shots: numbered(views, size), path, notes: Vec::new() })
    }
}

fn radians(degrees: f64) -> f64 {
    degrees * (PI / 180.0)
}

fn numbered(cameras: Vec<Camera>, size: ImageSize) -> Vec<Shot> {
    let shot =
        |(number, camera)| Shot { number, name: format!("{number}"), view: View { camera, size }, exposure: None };
    cameras.into_iter().enumerate().map(shot).collect()
}
