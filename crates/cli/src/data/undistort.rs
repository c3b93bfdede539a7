use std::path::PathBuf;

use clap::ValueEnum;

use crate::dataset_args::DatasetArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    dataset: DatasetArgs,

    /// Folder for `<key>/images/<frame>.png` and `<key>/transforms.json`.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,

    /// Pinhole camera of the new images.
    #[arg(long, value_enum, default_value_t = Mode::KeepK)]
    mode: Mode,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Pinhole camera of the undistorted images.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum Mode {
    /// The same intrinsics; the border may be black.
    KeepK,
    /// New intrinsics without a black border, as Long-LRM and iLRM-wide undistort DL3DV.
    LongLrm,
}

#[cfg(not(feature = "opencv"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<bool> {
    Err(super::needs_opencv("data undistort"))
}

#[cfg(feature = "opencv")]
pub(crate) use with_opencv::run;

#[cfg(feature = "opencv")]
mod with_opencv {
    use std::collections::BTreeSet;
    use std::fmt;
    use std::path::Path;

    use anyhow::Context as _;
    use atsplat_camera::{Camera, ImageSize};
    use atsplat_opencv::{UndistortMode, Undistorter};
    use atsplat_pixels::{DecodeLimits, encode_png};
    use atsplat_scene::{Frame, Picture, Scene, SceneSource as _, WarningKind, Warnings, is_plain_name};
    use serde::Serialize;
    use serde_json::{Value, json};

    use super::{Args, Mode};
    use crate::output::{PendingFile, print_report, print_warnings};
    use crate::progress::Progress;

    #[derive(Serialize)]
    #[serde(rename_all = "kebab-case")]
    struct Report {
        /// Images.
        written: u64,
        /// Scenes, and frames of other scenes.
        skipped: u64,
    }

    impl fmt::Display for Report {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            writeln!(f, "{} pictures written, {} scenes or frames skipped", self.written, self.skipped)
        }
    }

    pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
        let mode = match args.mode {
            Mode::KeepK => UndistortMode::KeepK,
            Mode::LongLrm => UndistortMode::LongLrm,
        };
        std::fs::create_dir_all(&args.out).with_context(|| format!("creating the folder {}", args.out.display()))?;
        let mut warnings = Warnings::new();
        let dataset = args.dataset.open(&mut warnings)?;
        let (mut written, mut skipped) = (0u64, 0u64);
        for key in dataset.keys() {
            if !is_plain_name(key) {
                skipped += 1;
                warnings.push(WarningKind::UnreadableScene, key, "its key is not a folder name");
                continue;
            }
            match dataset.load(key, &mut warnings) {
                Ok(scene) => {
                    let (of_scene, missing) = undistort_scene(&scene, mode, &args.out, &mut warnings)?;
                    written += of_scene;
                    skipped += missing;
                }
                Err(error) => {
                    skipped += 1;
                    warnings.push(WarningKind::UnreadableScene, key, error.to_string());
                }
            }
        }
        print_report(&Report { written, skipped }, args.json)?;
        print_warnings(&warnings);
        Ok(skipped == 0)
    }

    /// Writes the images and `transforms.json` of a scene; returns the numbers of images written and frames skipped.
    fn undistort_scene(
        scene: &Scene,
        mode: UndistortMode,
        out: &Path,
        warnings: &mut Warnings,
    ) -> anyhow::Result<(u64, u64)> {
        let folder = out.join(&scene.key);
        let list = PendingFile::open(&folder.join("transforms.json"))?;
        let progress = Progress::new("frames", scene.frames.len());
        let limits = DecodeLimits::default();
        let mut undistorter: Option<(Camera, ImageSize, Undistorter)> = None;
        let mut frames = Vec::new();
        let mut names = BTreeSet::new();
        let mut skipped = 0;
        for (position, frame) in scene.frames.iter().enumerate() {
            progress.step();
            if matches!(frame.picture, Picture::Absent | Picture::Missing(_)) {
                skipped += 1;
                continue;
            }
            let picture = match scene.decode(position, &limits) {
                Ok(picture) => picture,
                Err(error) => {
                    skipped += 1;
                    warnings.push(WarningKind::UnreadablePicture, &scene.key, error.to_string());
                    continue;
                }
            };
            let size = ImageSize { width: picture.width(), height: picture.height() };
            let fits = |(camera, of_size, _): &(Camera, ImageSize, Undistorter)| {
                camera.intrinsics == frame.camera.intrinsics
                    && camera.distortion == frame.camera.distortion
                    && *of_size == size
            };
            // Frames with the same lens share a map.
            let current = match undistorter.take().filter(fits) {
                Some(current) => current,
                None => (frame.camera, size, Undistorter::new(&frame.camera, size, mode)?),
            };
            let straight = current.2.undistort(&picture)?;
            let name = format!("images/{}.png", unique_name(frame, position, &mut names));
            PendingFile::open(&folder.join(&name))?.finish(&encode_png(&straight)?)?;
            frames.push(frame_json(frame, &name, size, &current.2));
            undistorter = Some(current);
        }
        let written = frames.len() as u64;
        let transforms = json!({ "camera_model": "PINHOLE", "frames": frames });
        list.finish(serde_json::to_string_pretty(&transforms)?.as_bytes())?;
        Ok((written, skipped))
    }

    /// The frame's name, with its position if the name is taken or is not a file name.
    fn unique_name(frame: &Frame, position: usize, taken: &mut BTreeSet<String>) -> String {
        let mut name = if is_plain_name(&frame.name) { frame.name.clone() } else { "frame".to_owned() };
        while !taken.insert(name.clone()) {
            name = format!("{name}_{position:06}");
        }
        name
    }

    /// A frame in nerfstudio's format: OpenGL camera-to-world, pinhole intrinsics in pixels.
    fn frame_json(frame: &Frame, name: &str, size: ImageSize, undistorter: &Undistorter) -> Value {
        let pose = frame.camera.camera_from_world.inverse().opengl_from_opencv().to_rows();
        let mut matrix: Vec<Vec<f64>> = pose.chunks(4).map(<[f64]>::to_vec).collect();
        matrix.push(vec![0.0, 0.0, 0.0, 1.0]);
        let k = undistorter.intrinsics().pixel_from_normalized(size);
        json!({
            "file_path": name,
            "w": size.width, "h": size.height,
            "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
            "transform_matrix": matrix,
        })
    }
}
