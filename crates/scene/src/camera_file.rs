//! Reads cameras from files: any dataset that `scene` reads, the `cameras.json` of models trained with 3DGS, camera paths of
//! nerfstudio's viewer, lists of poses, and the `render.json` of `atsplat render`.

use std::path::{Path, PathBuf};

use atsplat_camera::{Camera, CameraError, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_files::{FileError, without_byte_order_mark};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::checks::cameras::{count_and_first, imperfect_rotation};
use crate::checks::intrinsics_unit::{far_off_middle, wrong_unit};
use crate::files::last_name;
use crate::nerfstudio::{camera_path, is_camera_path};
use crate::scene_key::{AmbiguousScene, scene_key};
use crate::trained_camera::trained_camera;
use crate::{SceneError, SceneSource as _, WarningKind, Warnings, json, poses};

/// Why cameras cannot be read from a file.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum CameraFileError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The file is not a camera file.
    #[error("reading cameras from {}: {problem}", path.display())]
    Malformed {
        path: PathBuf,
        /// Which camera, what was expected and found.
        problem: String,
    },
    /// Poses without a lens.
    #[error("{} contains camera matrices without intrinsics: set {missing}", path.display())]
    NoLens {
        path: PathBuf,
        /// What of the lens is not known, and the options that set it.
        missing: &'static str,
    },
    /// A field of view for cameras that have intrinsics.
    #[error("--fov conflicts with {}, which states the intrinsics of its cameras: leave out --fov", path.display())]
    HasLens { path: PathBuf },
    /// A key for cameras that belong to no scene.
    #[error("--key requires a dataset: {} has cameras without scenes", path.display())]
    NoScenes { path: PathBuf },
    /// No camera.
    #[error("{} has no cameras", path.display())]
    Empty { path: PathBuf },
    /// The lens for files that contain only poses is impossible.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The dataset cannot be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The dataset has several scenes.
    #[error(transparent)]
    Key(#[from] AmbiguousScene),
}

/// A camera read from a file.
#[derive(Clone, Debug)]
pub struct FileCamera {
    /// Number in the names of its image files.
    pub number: usize,
    /// Name in the camera file.
    pub name: String,
    /// Pose, intrinsics and lens distortion.
    pub camera: Camera,
    /// Size of the image in pixels, if known from the file or the image.
    pub size: Option<ImageSize>,
    /// The 3×4 array of 3DGS' exposure.
    pub exposure: Option<[[f64; 4]; 3]>,
    /// Its time in microseconds, if a dataset records times and does not only number its frames or name its images.
    pub timestamp_micros: Option<i64>,
}

/// The lens for files that contain only poses.
#[derive(Clone, Copy, Debug, Default)]
pub struct LensOfPoses {
    /// Horizontal field of view in degrees; an error for files with intrinsics.
    pub fov: Option<f64>,
    /// Image size in pixels.
    pub size: Option<ImageSize>,
}

/// A camera in `render.json`, without loss of precision.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct CameraRecord {
    number: usize,
    name: String,
    width: u32,
    height: u32,
    camera_from_world: [f64; 12],
    /// Relative to image width and height.
    intrinsics: NormalizedIntrinsics,
    #[serde(default)]
    distortion: Distortion,
    /// The 3×4 array of 3DGS' exposure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    exposure: Option<[[f64; 4]; 3]>,
}

/// Reads every camera of a file or folder; `key` selects a scene of a dataset, if there are several. Images may be missing.
///
/// # Errors
/// [`CameraFileError`] naming the file, the camera, and what was expected.
pub fn read(
    path: &Path,
    key: Option<&str>,
    lens: LensOfPoses,
    warnings: &mut Warnings,
) -> Result<Vec<FileCamera>, CameraFileError> {
    let malformed = |problem| CameraFileError::Malformed { path: path.to_owned(), problem };
    let json = if path.exists() && !path.is_dir() { parse_if_json(path)? } else { None };
    let is_dataset = match &json {
        None => true,
        Some(path_of_viewer) if is_camera_path(path_of_viewer) => false,
        // Files of OpenMVG also have a field `views`.
        Some(Value::Object(object)) => !object.contains_key("views") || object.contains_key("sfm_data_version"),
        Some(_) => false,
    };
    if key.is_some() && !is_dataset {
        return Err(CameraFileError::NoScenes { path: path.to_owned() });
    }
    if let Some(list @ Value::Array(entries)) = &json
        && poses::is_list_of_poses(list)
    {
        let cameras = cameras_from_poses(entries, path, lens)?;
        report_rotations(path, &cameras, warnings);
        return Ok(cameras);
    }
    let cameras = match json {
        Some(path_of_viewer) if is_camera_path(&path_of_viewer) => camera_path(&path_of_viewer, path, warnings)?,
        Some(list @ Value::Array(_)) => {
            let cameras = cameras_from_3dgs(&list).map_err(malformed)?;
            report_implausible(path, &cameras, warnings);
            cameras
        }
        Some(Value::Object(mut object)) if !is_dataset => {
            let views = object.remove("views").unwrap_or(Value::Null);
            let views: Vec<Value> =
                serde_json::from_value(views).map_err(|error| malformed(format!("views: {error}")))?;
            cameras_from_records(views).map_err(malformed)?
        }
        _ => {
            let mut found = Warnings::new();
            let cameras = cameras_of_dataset(path, key, &mut found);
            warnings.merge(found.about_cameras());
            cameras?
        }
    };
    if !is_dataset {
        report_rotations(path, &cameras, warnings);
    }
    if cameras.is_empty() {
        return Err(CameraFileError::Empty { path: path.to_owned() });
    }
    // Of a file that cannot be read, nobody knows whether it has intrinsics.
    if lens.fov.is_some() {
        return Err(CameraFileError::HasLens { path: path.to_owned() });
    }
    Ok(cameras)
}

/// Parses the file if it looks like JSON.
fn parse_if_json(path: &Path) -> Result<Option<Value>, CameraFileError> {
    let bytes = atsplat_files::read(path).map_err(FileError::during::<CameraFileError>("reading cameras", path))?;
    let text = without_byte_order_mark(&bytes);
    if !matches!(text.trim_ascii_start().first(), Some(b'[' | b'{')) {
        return Ok(None);
    }
    let parsed = json::parse(text).map(Some);
    parsed.map_err(|error| CameraFileError::Malformed {
        path: path.to_owned(),
        problem: format!("expected JSON: {error}"),
    })
}

/// Reads 3DGS' list of cameras.
fn cameras_from_3dgs(list: &Value) -> Result<Vec<FileCamera>, String> {
    let is_trained = |camera: &Value| camera.get("position").is_some() && camera.get("rotation").is_some();
    match list {
        Value::Array(entries) if entries.first().is_some_and(is_trained) => {
            entries.iter().enumerate().map(|(at, entry)| trained_camera(at, entry)).collect()
        }
        other => Err(format!(
            "expected a dataset's cameras, a render.json, 3DGS' cameras.json, a camera path of nerfstudio's viewer or a list of \
             camera matrices, found {}",
            json::describe(other)
        )),
    }
}

/// Counts the cameras whose intrinsics are in another unit or for another size, as for those of datasets.
fn report_implausible(path: &Path, cameras: &[FileCamera], warnings: &mut Warnings) {
    let problem = |FileCamera { camera, size, .. }: &FileCamera| {
        wrong_unit(&camera.intrinsics, *size).or_else(|| far_off_middle(&camera.intrinsics))
    };
    if let Some(detail) = count_and_first(cameras, "cameras", problem) {
        warnings.push(WarningKind::ImplausibleIntrinsics, last_name(path), detail);
    }
}

/// Counts the cameras whose rotation is farther from one than by rounding, as for those of datasets.
fn report_rotations(path: &Path, cameras: &[FileCamera], warnings: &mut Warnings) {
    let problem = |camera: &FileCamera| imperfect_rotation(&camera.camera.camera_from_world);
    if let Some(detail) = count_and_first(cameras, "cameras", problem) {
        warnings.push(WarningKind::ImperfectRotation, last_name(path), detail);
    }
}

/// Cameras from poses that share one lens.
fn cameras_from_poses(
    entries: &[Value],
    path: &Path,
    LensOfPoses { fov, size }: LensOfPoses,
) -> Result<Vec<FileCamera>, CameraFileError> {
    let no_lens = |missing| CameraFileError::NoLens { path: path.to_owned(), missing };
    let (fov, size) = match (fov, size) {
        (Some(fov), Some(size)) => (fov, size),
        (Some(_), None) => return Err(no_lens("the image size with --size")),
        (None, Some(_)) => return Err(no_lens("the field of view with --fov")),
        (None, None) => return Err(no_lens("the field of view with --fov and the image size with --size")),
    };
    let intrinsics = NormalizedIntrinsics::with_horizontal_view(fov.to_radians(), size)?;
    let camera = |(number, pose)| FileCamera {
        number,
        name: number.to_string(),
        camera: Camera::pinhole(pose, intrinsics),
        size: Some(size),
        exposure: None,
        timestamp_micros: None,
    };
    Ok(poses::poses(entries, path)?.into_iter().enumerate().map(camera).collect())
}

/// Reads the views of a `render.json`.
fn cameras_from_records(views: Vec<Value>) -> Result<Vec<FileCamera>, String> {
    let one = |(at, view)| {
        let record = serde_json::from_value(view).map_err(|error| format!("camera {at}: {error}"))?;
        camera_from_record(record).map_err(|error| format!("camera {at}: {error}"))
    };
    views.into_iter().enumerate().map(one).collect()
}

fn camera_from_record(entry: CameraRecord) -> Result<FileCamera, CameraError> {
    let size = ImageSize { width: entry.width, height: entry.height };
    if ![size.width, size.height].iter().all(|side| (1..=ImageSize::MAX_SIDE).contains(side)) {
        return Err(CameraError::InvalidSize { found: size.to_string() });
    }
    let NormalizedIntrinsics { fx, fy, cx, cy } = entry.intrinsics;
    let camera = Camera {
        camera_from_world: CameraFromWorld::from_rows(&entry.camera_from_world)?,
        intrinsics: NormalizedIntrinsics::new(fx, fy, cx, cy)?,
        distortion: entry.distortion,
    };
    Ok(FileCamera {
        number: entry.number,
        name: entry.name,
        camera,
        size: Some(size),
        exposure: entry.exposure,
        timestamp_micros: None,
    })
}

impl CameraRecord {
    /// Records a camera with images of `size` pixels, and the 3×4 array of 3DGS' exposure.
    pub fn new(number: usize, name: String, camera: &Camera, size: ImageSize, exposure: Option<[[f64; 4]; 3]>) -> Self {
        Self {
            number,
            name,
            width: size.width,
            height: size.height,
            camera_from_world: camera.camera_from_world.to_rows(),
            intrinsics: camera.intrinsics,
            distortion: camera.distortion,
            exposure,
        }
    }
}

fn cameras_of_dataset(
    path: &Path,
    key: Option<&str>,
    warnings: &mut Warnings,
) -> Result<Vec<FileCamera>, CameraFileError> {
    let dataset = crate::open(path, warnings)?;
    let key = scene_key(&dataset, key)?;
    let scene = dataset.load(key, warnings)?;
    // Leaving out a frame would change the positions of others.
    scene.frames.iter().enumerate().try_for_each(|(at, frame)| frame.require_pose(key, at))?;
    let has_times = scene.has_times(dataset.times());
    let cameras = scene.frames.iter().enumerate().map(|(number, frame)| {
        // The size of the image file, because it may be a downscaled copy; if it cannot be read or does not fit, the
        // stated size.
        let of_image = if frame.image.is_available() { frame.size(key, number).ok() } else { None };
        let size = of_image.filter(|found| frame.mismatch(*found).is_none()).or(frame.stated_size).or(of_image);
        let timestamp_micros = frame.timestamp_micros.filter(|_| has_times);
        FileCamera { number, name: frame.name.clone(), camera: frame.camera, size, exposure: None, timestamp_micros }
    });
    Ok(cameras.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use serde_json::json;

    fn read_text(text: &str) -> Result<Vec<FileCamera>, CameraFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.json");
        std::fs::write(&path, text).unwrap();
        let lens = LensOfPoses { fov: Some(60.0), size: Some(ImageSize { width: 64, height: 48 }) };
        read(&path, None, lens, &mut Warnings::new())
    }

    /// Datasets alone have scenes to choose from.
    #[test]
    fn a_key_is_rejected_for_cameras_without_scenes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        let poses = "[[1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0]]";
        let (trained, record) = (r#"[{ "position": [0, 0, 0], "rotation": [] }]"#, r#"{ "views": [] }"#);
        let dataset = r#"{ "views": [], "sfm_data_version": "0.3" }"#;
        let of_viewer = r#"{ "camera_path": [] }"#;
        for (text, is_rejected) in [(poses, true), (trained, true), (record, true), (of_viewer, true), (dataset, false)]
        {
            std::fs::write(&path, text).unwrap();
            let error = read(&path, Some("garden"), LensOfPoses::default(), &mut Warnings::new()).unwrap_err();
            assert_eq!(matches!(error, CameraFileError::NoScenes { .. }), is_rejected, "{text}: {error}");
        }
    }

    /// What is missing is named, and a file is only said to have intrinsics after it was read.
    #[test]
    fn a_lens_that_is_missing_or_given_twice_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        let fov = Some(60.0);
        let size = Some(ImageSize { width: 64, height: 48 });
        let refused = |lens: LensOfPoses| read(&path, None, lens, &mut Warnings::new()).unwrap_err().to_string();
        let gone = refused(LensOfPoses { fov, size });
        assert!(gone.contains("cameras.json") && !gone.contains("intrinsics"), "{gone}");
        std::fs::write(&path, "[[1, 2, 3]]").unwrap();
        let odd = refused(LensOfPoses { fov, size });
        assert!(odd.contains("found a list of 1") && !odd.contains("--fov"), "{odd}");
        std::fs::write(&path, "[[1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0]]").unwrap();
        for (lens, missing) in [
            (LensOfPoses { fov, size: None }, "set the image size with --size"),
            (LensOfPoses { fov: None, size }, "set the field of view with --fov"),
            (LensOfPoses::default(), "set the field of view with --fov and the image size with --size"),
        ] {
            let error = refused(lens);
            assert!(error.ends_with(missing), "{error}");
        }
        let trained = r#"[{"img_name": "a", "width": 40, "height": 30, "fx": 32, "fy": 32, "position": [0, 0, 0],
                           "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}]"#;
        std::fs::write(&path, trained).unwrap();
        let both = refused(LensOfPoses { fov, size });
        assert!(both.starts_with("--fov conflicts with") && both.ends_with("leave out --fov"), "{both}");
    }

    /// One has a focal length of an impossible number of sides, one the principal point of an image twice as large, one an impossible size.
    #[test]
    fn cameras_of_3dgs_with_impossible_lenses_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        let camera = |width: &str, fx: &str| {
            let rotation = "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]";
            format!(
                r#"{{"img_name": "a", "width": {width}, "height": 30, "position": [0, 0, 0], "rotation": {rotation},
                     "fx": {fx}, "fy": 32}}"#
            )
        };
        let outcome = |cameras: &[String]| {
            std::fs::write(&path, format!("[{}]", cameras.join(", "))).unwrap();
            let mut warnings = Warnings::new();
            let found = read(&path, None, LensOfPoses::default(), &mut warnings);
            (found.map(|cameras| cameras.len()).map_err(|error| error.to_string()), warnings)
        };
        let (count, none) = outcome(&[camera("40", "32")]);
        assert_eq!((count, none.total()), (Ok(1), 0));
        let (count, warnings) = outcome(&[camera("40", "32"), camera("40", "1e300")]);
        let [warning] = warnings.kept() else { panic!("{warnings:?}") };
        assert_eq!((count, warning.kind), (Ok(2), WarningKind::ImplausibleIntrinsics));
        assert!(
            warning.scene == "cameras.json" && warning.detail.starts_with("1 of 2 cameras, first 1: "),
            "{warning}"
        );
        let of_larger = camera("40", "32, \"cx\": 40, \"cy\": 30");
        let (count, warnings) = outcome(&[camera("40", "32, \"cx\": 18, \"cy\": 16"), of_larger]);
        let [warning] = warnings.kept() else { panic!("{warnings:?}") };
        assert_eq!((count, warning.kind), (Ok(2), WarningKind::ImplausibleIntrinsics));
        assert!(warning.detail.starts_with("1 of 2 cameras, first 1: expected a principal point near"), "{warning}");
        let (error, _) = outcome(&[camera("40", "32"), camera("70000", "32")]);
        assert!(error.unwrap_err().ends_with("camera 1, width: expected 1 to 65535 pixels, found 70000"));
    }

    /// Of two cameras, the second is sheared; the first is rounded to six decimals, as text is.
    #[test]
    fn rotations_that_are_none_are_counted_in_every_kind_of_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cameras.json");
        let rounded = [[0.955_336, 0.0, 0.295_52], [0.0, 1.0, 0.0], [-0.295_52, 0.0, 0.955_336]];
        let sheared = [[1.0, 0.004, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let lens = LensOfPoses { fov: Some(60.0), size: Some(ImageSize { width: 40, height: 30 }) };
        let matrix = |rotation: [[f64; 3]; 3]| -> Vec<f64> {
            let with_translation = |row: [f64; 3]| [row[0], row[1], row[2], 0.5];
            rotation.map(with_translation).concat()
        };
        let trained = |rotation: [[f64; 3]; 3]| {
            json!({
                "img_name": "a", "width": 40, "height": 30, "fx": 32, "fy": 32, "position": [0, 0, 0], "rotation": rotation,
            })
        };
        let record = |rotation: [[f64; 3]; 3]| {
            json!({
                "number": 0, "name": "a", "width": 40, "height": 30, "camera-from-world": matrix(rotation),
                "intrinsics": { "fx": 0.8, "fy": 1.0, "cx": 0.5, "cy": 0.5 },
            })
        };
        let viewed = |rotation: [[f64; 3]; 3]| {
            let rows = [matrix(rotation), vec![0.0, 0.0, 0.0, 1.0]].concat();
            json!({ "camera_to_world": rows, "fov": 60 })
        };
        let path_of = |cameras: [Value; 2]| json!({ "render_width": 40, "render_height": 30, "camera_path": cameras });
        for (file, lens) in [
            (json!([matrix(rounded), matrix(sheared)]), lens),
            (json!([trained(rounded), trained(sheared)]), LensOfPoses::default()),
            (json!({ "views": [record(rounded), record(sheared)] }), LensOfPoses::default()),
            (path_of([viewed(rounded), viewed(sheared)]), LensOfPoses::default()),
        ] {
            std::fs::write(&path, file.to_string()).unwrap();
            let mut warnings = Warnings::new();
            assert_eq!(read(&path, None, lens, &mut warnings).unwrap().len(), 2, "{file}");
            let [warning] = warnings.kept() else { panic!("{file}: {warnings:?}") };
            let expected = "1 of 2 cameras, first 1: expected R Rᵀ = I, found a deviation of 4.0e-3; det(R) is 1";
            let found = (warning.kind, warning.scene.as_str(), warning.detail.as_str());
            assert_eq!(found, (WarningKind::ImperfectRotation, "cameras.json", expected), "{file}");
        }
    }

    /// Leaving it out would move those behind it.
    #[test]
    fn a_frame_of_a_dataset_without_a_pose_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.txt");
        let row = |time: u32, x: &str| format!("{time} 0.9 0.9 0.5 0.5 0 0 {x} 0 0 0 0 1 0 0 0 0 1 0\n");
        std::fs::write(&path, [row(0, "1"), row(7, "-1"), row(9, "1")].concat()).unwrap();
        let error = read(&path, None, LensOfPoses::default(), &mut Warnings::new()).unwrap_err().to_string();
        assert!(error.contains("frame 1 of scene \"clip\" has no usable pose: line 2: rotation: "), "{error}");
    }

    /// Reading it would wait for whoever writes to it.
    #[cfg(unix)]
    #[test]
    fn a_pipe_is_not_a_camera_file() {
        let folder = tempfile::tempdir().unwrap();
        let [pipe, link] = ["cameras", "cameras.json"].map(|name| folder.path().join(name));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        for path in [&pipe, &link] {
            let refused = read(path, None, LensOfPoses::default(), &mut Warnings::new()).unwrap_err();
            assert!(matches!(refused, CameraFileError::Io(_)), "{refused}");
            let expected = format!("found a pipe, a socket or a device ({})", path.display());
            assert!(refused.to_string().ends_with(&expected), "{refused}");
        }
    }

    #[test]
    fn a_byte_order_mark_and_blank_lines_change_nothing() {
        let poses = "[[1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0]]";
        for before in ["", "\u{feff}", "\n ", "\u{feff}\n"] {
            let cameras = read_text(&format!("{before}{poses}")).unwrap();
            assert_eq!(cameras[0].camera.camera_from_world.translation(), DVec3::new(5.0, 0.0, 0.0), "{before:?}");
        }
        let error = read_text("\u{feff}\n[1,\n}").unwrap_err().to_string();
        assert!(error.contains("line 3"), "{error}");
    }
}
