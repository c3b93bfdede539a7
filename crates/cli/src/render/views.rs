use std::f64::consts::PI;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_camera::{Camera, Distortion, ImageSize, NormalizedIntrinsics, Turntable};
use atsplat_eval::rendering::{FrameRequest, PathRecord, PathSpacing, RenderPlan};
use atsplat_scene::camera_file::{self, CameraFileError, FileCamera, LensOfPoses};
use atsplat_scene::{FrameSelection, Warnings, is_scaled_copy, pixel_mismatch};
use atsplat_splat::scene_file::{SceneFile, SceneFileRecord};
use atsplat_splat::{Exposure, View, framing};
use clap::ArgGroup;

use super::spline;
use crate::parse::{self, Axis};

/// Image size of an orbit.
const ORBIT_SIZE: ImageSize = ImageSize { width: 960, height: 540 };
/// Horizontal field of view of an orbit in degrees.
const ORBIT_FOV: f64 = 50.0;
const DEFAULT_FRAMES: &str = "60";

/// The camera path.
#[derive(Debug, clap::Args)]
#[group(skip)]
#[command(group = ArgGroup::new("path").required(true).args(["cameras", "orbit", "spline"]))]
pub(crate) struct ViewArgs {
    /// Every camera of FILE: any dataset that `data inspect` reads, 3DGS' `cameras.json`, a camera path of nerfstudio's viewer, a
    /// `render.json`, or a JSON list of `camera_from_world` matrices, as in MotionCtrl (with --fov and --size).
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,

    /// N views on a circle around the scene; 60 by default.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = DEFAULT_FRAMES, value_parser = parse::frames)]
    orbit: Option<usize>,

    /// N views on a smooth path through the cameras of FILE; 60 by default.
    #[arg(long, value_names = ["FILE", "N"], num_args = 1..=2)]
    spline: Option<Vec<String>>,

    /// Which cameras of FILE, counted from 0: `0,29,100..200:10`.
    #[arg(long, value_name = "SEL", conflicts_with = "orbit")]
    frames: Option<FrameSelection>,

    /// Which scene of FILE, if it contains several.
    #[arg(long, value_name = "KEY", conflicts_with = "orbit")]
    key: Option<String>,

    /// Image size; by default that of FILE, and 960x540 for an orbit.
    #[arg(long, value_name = "WxH")]
    size: Option<ImageSize>,

    /// Ignore lens distortion in FILE.
    #[arg(long, conflicts_with = "orbit")]
    no_distortion: bool,

    /// Close the path from the last camera back to the first.
    #[arg(long, conflicts_with_all = ["cameras", "orbit"])]
    closed: bool,

    /// Sample the path evenly by distance travelled, by the times that FILE records for its cameras, or with as many views between
    /// any two cameras (even).
    #[arg(long, value_name = "BY", conflicts_with_all = ["cameras", "orbit"], default_value = "distance", value_parser = parse::named(SPACINGS))]
    spacing: PathSpacing,

    /// Degrees above the horizon.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "15", value_parser = parse::elevation)]
    elevation: f64,

    /// Distance in multiples of the one that just frames the bulk of the scene.
    #[arg(long, value_name = "FACTOR", conflicts_with_all = ["cameras", "spline"], default_value = "1", value_parser = parse::positive)]
    distance: f64,

    /// Up direction of the scene; -y in the axes of OpenCV and 3DGS.
    #[arg(long, value_name = "AXIS", conflicts_with_all = ["cameras", "spline"], default_value = "-y", allow_hyphen_values = true)]
    up: Axis,

    /// Horizontal field of view in degrees: of an orbit, 50 by default, or of cameras whose file contains only poses.
    #[arg(long, value_name = "DEGREES", value_parser = parse::angle)]
    fov: Option<f64>,

    /// Start of the orbit in degrees, towards the camera's right.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "0", value_parser = parse::finite)]
    azimuth: f64,

    /// Extent of the orbit in degrees.
    #[arg(long, value_name = "DEGREES", conflicts_with_all = ["cameras", "spline"], default_value = "360", value_parser = parse::finite)]
    sweep: f64,
}

const SPACINGS: [(&str, PathSpacing); 3] =
    [("distance", PathSpacing::ArcLength), ("time", PathSpacing::Time), ("even", PathSpacing::Even)];

impl ViewArgs {
    /// Rejects invalid values before any file is read.
    pub(crate) fn check(&self) -> Result<(), String> {
        if self.closed && self.spacing == PathSpacing::Time {
            let text = "no file records a time for the way from the last camera back to the first";
            return Err(format!("--closed --spacing time: {text}; use --spacing distance or even"));
        }
        self.spline_frames().map(|_| ())
    }

    fn spline_frames(&self) -> Result<usize, String> {
        let count = self.spline.as_ref().and_then(|values| values.get(1)).map_or(DEFAULT_FRAMES, String::as_str);
        parse::frames(count).map_err(|error| format!("--spline: {error}"))
    }

    /// FILE of the cameras, or of those along the path.
    pub(super) fn file(&self) -> Option<PathBuf> {
        self.cameras.clone().or_else(|| Some(PathBuf::from(self.spline.as_ref()?.first()?)))
    }

    /// Which scene of FILE.
    pub(super) fn key(&self) -> Option<&str> {
        self.key.as_deref()
    }

    /// Numbers in the names of the images, of cameras that were read from FILE.
    pub(super) fn numbers(&self, cameras: Option<&[FileCamera]>) -> anyhow::Result<Vec<usize>> {
        Ok(match cameras.filter(|_| self.cameras.is_some()) {
            Some(cameras) => cameras.iter().map(|camera| camera.number).collect(),
            None => (0..self.orbit.map_or_else(|| self.spline_frames(), Ok).map_err(anyhow::Error::msg)?).collect(),
        })
    }

    /// Reads the cameras of FILE.
    pub(crate) fn read(&self, warnings: &mut Warnings) -> anyhow::Result<Option<Vec<FileCamera>>> {
        let Some(file) = self.file() else { return Ok(None) };
        let lens = LensOfPoses { fov: self.fov, size: self.size };
        let mut cameras = match camera_file::read(&file, self.key.as_deref(), lens, warnings) {
            Err(error @ CameraFileError::NoScenes { .. }) => return Err(parse::usage_error(error).into()),
            cameras => cameras?,
        };
        if let Some(selection) = &self.frames {
            let picked = selection.of(cameras.len()).context("--frames")?;
            cameras = picked.into_iter().filter_map(|position| cameras.get(position).cloned()).collect();
        }
        if self.no_distortion {
            for camera in &mut cameras {
                camera.camera.distortion = Distortion::None;
            }
        }
        Ok(Some(cameras))
    }

    /// Plans the views from which the Gaussians are rendered.
    pub(crate) fn plan(
        &self,
        cameras: Option<Vec<FileCamera>>,
        scene: &SceneFile,
        has_exposure: bool,
    ) -> anyhow::Result<RenderPlan> {
        let mut notes = Vec::new();
        let Some(cameras) = cameras else { return self.orbit(scene) };
        if let Some(file) = &self.cameras {
            let requests = self.requests_of(cameras, &mut notes)?;
            return Ok(RenderPlan { requests, path: PathRecord::Cameras { file: file.clone() }, notes });
        }
        let size = self.size_of(cameras.first(), &mut notes)?;
        let file = self.file().context("a path along a spline requires a camera file")?;
        let count = self.spline_frames().map_err(anyhow::Error::msg)?;
        let views = spline::sample(&file, &cameras, self.spacing, self.closed, count)
            .with_context(|| format!("--spline {}", file.display()))?;
        if !has_exposure && cameras.iter().any(|key| key.exposure.is_some()) {
            notes.push("a path between cameras ignores their exposures: see --exposure".to_owned());
        }
        let path = PathRecord::Spline { file, keys: cameras.len(), closed: self.closed, spacing: self.spacing };
        Ok(RenderPlan { requests: FrameRequest::numbered(views, size), path, notes })
    }

    fn requests_of(&self, cameras: Vec<FileCamera>, notes: &mut Vec<String>) -> anyhow::Result<Vec<FrameRequest>> {
        let mut requests: Vec<FrameRequest> = Vec::with_capacity(cameras.len());
        for camera in cameras {
            let size = self.size_of(Some(&camera), notes)?;
            if let Some(other) = requests.iter().find(|request| request.number == camera.number) {
                bail!("cameras {:?} and {:?} both have the number {}", other.name, camera.name, camera.number);
            }
            let FileCamera { number, name, camera, exposure, .. } = camera;
            let exposure = exposure.map(Exposure::from_3dgs);
            requests.push(FrameRequest { number, name, view: View { camera, size }, exposure });
        }
        Ok(requests)
    }

    /// The requested size, or that of the file; a change of aspect ratio is reported once.
    fn size_of(&self, camera: Option<&FileCamera>, notes: &mut Vec<String>) -> anyhow::Result<ImageSize> {
        let stated = camera.and_then(|camera| camera.size);
        let squeezed = match (self.size, stated, camera) {
            (Some(requested), Some(stated), _)
                if !is_scaled_copy(requested, stated) && !is_scaled_copy(stated, requested) =>
            {
                Some(format!("--size {requested} squeezes images of {stated}: its aspect ratio differs"))
            }
            (Some(requested), None, Some(FileCamera { camera, .. })) => pixel_mismatch(&camera.intrinsics, requested)
                .map(|mismatch| format!("--size {requested} squeezes images: {mismatch}")),
            _ => None,
        };
        if notes.is_empty() {
            notes.extend(squeezed);
        }
        self.size.or(stated).context("the cameras have no image size: set it with --size")
    }

    fn orbit(&self, scene: &SceneFile) -> anyhow::Result<RenderPlan> {
        #[expect(clippy::expect_used, reason = "clap requires one of the three")]
        let count = self.orbit.expect("--cameras, --spline or --orbit is given");
        let sphere = framing::visible_bulk(&scene.gaussians).with_context(|| nothing_to_orbit(&scene.record))?;
        let size = self.size.unwrap_or(ORBIT_SIZE);
        let intrinsics = NormalizedIntrinsics::with_horizontal_view(radians(self.fov.unwrap_or(ORBIT_FOV)), size)?;
        let distance = self.distance * intrinsics.distance_that_frames(sphere.radius)?;
        let turntable = Turntable {
            target: sphere.centre,
            up: self.up.vector(),
            distance,
            elevation: radians(self.elevation),
            azimuth: radians(self.azimuth),
            sweep: radians(self.sweep),
        };
        let poses = turntable.poses(count)?;
        let views = poses.iter().map(|pose| Camera::pinhole(pose.inverse(), intrinsics)).collect();
        let path = PathRecord::Orbit {
            target: turntable.target.to_array(),
            up: turntable.up.to_array(),
            distance,
            framed_radius: sphere.radius,
            elevation_degrees: self.elevation,
            azimuth_degrees: self.azimuth,
            sweep_degrees: self.sweep,
        };
        Ok(RenderPlan { requests: FrameRequest::numbered(views, size), path, notes: Vec::new() })
    }
}

/// Whether one size is a multiple of the other, up to the rounding of small sizes to pixels.
pub(super) fn same_aspect_ratio(a: ImageSize, b: ImageSize) -> bool {
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    (aspect(a) / aspect(b) - 1.0).abs() <= 0.01
}

/// What the file contains and what was removed from it, as the reason for the error.
fn nothing_to_orbit(record: &SceneFileRecord) -> String {
    let record = record.to_string();
    let found: Vec<&str> = record.lines().map(str::trim).collect();
    let expected = "one with an opacity of at least 1/255 and log-scales of at most 43.5";
    format!("the scene has no visible Gaussian to orbit: expected {expected}, found {}", found.join("; "))
}

fn radians(degrees: f64) -> f64 {
    degrees * (PI / 180.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use atsplat_camera::CameraFromWorld;
    use atsplat_splat::Cleaning;
    use clap::Parser as _;
    use glam::{DMat3, DVec3};

    use super::*;

    #[derive(clap::Parser)]
    struct Command {
        #[command(flatten)]
        views: ViewArgs,
    }

    fn key(number: usize, size: Option<(u32, u32)>) -> FileCamera {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(number as f64, 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        FileCamera {
            number,
            name: format!("camera {number}"),
            camera: Camera::pinhole(pose, intrinsics),
            size: size.map(|(width, height)| ImageSize { width, height }),
            exposure: None,
            timestamp_micros: None,
        }
    }

    /// Neither size need be exact: both are whole pixels.
    #[test]
    fn every_squeeze_beyond_the_rounding_to_pixels_is_noted() {
        let notes = |requested: &str, stated: (u32, u32)| {
            let views = Command::parse_from(["render", "--cameras", "keys.json", "--size", requested]).views;
            let mut notes = Vec::new();
            views.size_of(Some(&key(0, Some(stated))), &mut notes).unwrap();
            notes
        };
        for (requested, stated) in [("480x270", (960, 540)), ("455x256", (640, 360)), ("1920x1080", (57, 32))] {
            assert_eq!(notes(requested, stated), Vec::<String>::new(), "{requested}");
        }
        for requested in ["956x540", "960x546", "540x960"] {
            let [width, height] = [0, 1].map(|at| requested.split('x').nth(at).unwrap());
            let expected = format!("--size {width}×{height} squeezes images of 960×540: its aspect ratio differs");
            assert_eq!(notes(requested, (960, 540)), [expected]);
        }
    }

    #[test]
    fn a_path_through_images_of_several_shapes_is_an_error() {
        let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../splat/tests/fixtures/files/degree1_ascii.ply");
        let scene = SceneFile::read(Path::new(scene), Cleaning::Import, false).unwrap();
        let plan = |last: Option<(u32, u32)>, args: &[&str]| {
            let args = [&["render", "--spline", "keys.json", "3"][..], args].concat();
            let keys = vec![key(0, Some((400, 300))), key(1, Some((200, 150))), key(2, last)];
            let plan = Command::parse_from(args).views.plan(Some(keys), &scene, false);
            plan.map(|plan| plan.requests.len()).map_err(|error| format!("{error:#}"))
        };
        for same in [Some((400, 300)), Some((100, 75)), Some((133, 100)), None] {
            assert_eq!(plan(same, &[]), Ok(3), "{same:?}");
        }
        for args in [&[][..], &["--size", "400x300"]] {
            let error = plan(Some((300, 400)), args).unwrap_err();
            for part in ["--spline keys.json", "300×400 of \"camera 2\"", "400×300 of \"camera 0\""] {
                assert!(error.contains(part), "{part}: {error}");
            }
        }
    }
}
