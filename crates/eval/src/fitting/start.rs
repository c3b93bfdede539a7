use std::path::{Path, PathBuf};
use std::str::FromStr;

use atsplat_files::InvalidText;
use atsplat_fit::start::{Point, from_points, in_frustums};
use atsplat_fit::{FitConfig, FitError, Strategy, TrainingViews};
use atsplat_scene::colmap::{ColmapPoint, Displacement, displacement, points_folder, read_points};
use atsplat_scene::nerfstudio::AppliedTransform;
use atsplat_scene::{Scene, SceneError};
use atsplat_splat::{Cleaning, Gaussians, SplatError, Validation, files};
use thiserror::Error;

/// Largest median distance between COLMAP's cameras and the scene's, in extents of the scene. Cameras that were refined after
/// COLMAP are closer, those of another world are not.
const CLOSE: f64 = 0.05;

/// What an optimisation starts from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Start {
    /// This many random points that the cameras see.
    Random(usize),
    /// The points of the dataset's COLMAP model.
    Points,
    /// A folder with COLMAP's points, or a file of Gaussians.
    At(PathBuf),
}

/// Where COLMAP's points of a scene are read, and where they are in space.
#[derive(Clone, Copy, Debug)]
pub struct PointsOf<'a> {
    /// The dataset: a capture, a file in it, or a folder of captures.
    pub data: &'a Path,
    /// The scene, in whose world the points must be.
    pub scene: &'a Scene,
    /// What was done to these cameras, but not to COLMAP's points
    /// ([`applied_transform`](atsplat_scene::SceneSource::applied_transform)).
    pub applied: Option<AppliedTransform>,
}

/// The Gaussians of a [`Start`].
#[derive(Clone, Debug)]
pub struct StartGaussians {
    /// Those that can be optimised.
    pub gaussians: Gaussians,
    /// Gaussians of their file that were removed because they cannot be repaired.
    pub removed: usize,
    /// What a user should know of their file.
    pub warnings: Vec<String>,
}

impl From<Gaussians> for StartGaussians {
    fn from(gaussians: Gaussians) -> Self {
        Self { gaussians, removed: 0, warnings: Vec::new() }
    }
}

/// Why there is nothing to start from.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum StartError {
    /// COLMAP's points cannot be read.
    #[error("COLMAP's points: {0}")]
    Points(#[from] SceneError),
    /// There are no points.
    #[error(
        "expected points3D.bin or points3D.txt in the folder, its sparse/0/, sparse/ or colmap/sparse/0/, found none \
         ({})",
        .0.display()
    )]
    NoPoints(PathBuf),
    /// No Gaussians can be made of the points.
    #[error("COLMAP's points: {error} ({})", folder.display())]
    Unusable { folder: PathBuf, error: Box<FitError> },
    /// The points are in another world than the scene's cameras.
    #[error(
        "{}: the cameras of {images} images differ from the dataset's, in the median by {percent:.0} % of its extent: the \
         dataset's cameras were moved without an applied_transform, as by instant-ngp's colmap2nerf.py, or the points belong \
         to another capture",
        folder.display()
    )]
    Elsewhere {
        folder: PathBuf,
        /// Images that are frames of the scene.
        images: usize,
        /// Median distance of their cameras.
        percent: f64,
    },
    /// A file of Gaussians cannot be read.
    #[error(transparent)]
    Gaussians(#[from] SplatError),
    /// Gaussians cannot be created.
    #[error(transparent)]
    Fit(#[from] FitError),
}

impl FromStr for Start {
    type Err = InvalidText;

    /// `random:N`, `points` or a path.
    fn from_str(text: &str) -> Result<Self, InvalidText> {
        match text.strip_prefix("random:") {
            Some(count) => {
                let count = count.parse().ok().filter(|count| *count > 0);
                count.map(Self::Random).ok_or_else(|| InvalidText::new("random:N", text))
            }
            None if text == "points" => Ok(Self::Points),
            None => Ok(Self::At(PathBuf::from(text))),
        }
    }
}

impl Start {
    /// Whether this start reads COLMAP's points.
    pub fn reads_points(&self) -> bool {
        match self {
            Self::Random(_) => false,
            Self::Points => true,
            Self::At(path) => path.is_dir(),
        }
    }

    /// The Gaussians for these views of a scene, to be optimised with a configuration, within whose limits on number and memory
    /// random points are made. They are between two `depths`, by default around the point that the cameras look at. With
    /// `opacities_as_stored`, a PLY file contains opacities instead of logits.
    ///
    /// # Errors
    /// [`StartError`].
    pub fn gaussians(
        &self,
        views: &TrainingViews,
        of: PointsOf<'_>,
        depths: Option<[f64; 2]>,
        opacities_as_stored: bool,
        config: &FitConfig,
    ) -> Result<StartGaussians, StartError> {
        let strategy = config.strategy;
        let folder = match self {
            Self::Random(count) => {
                // Before there is memory for them.
                config.check_start(views, *count)?;
                let near = config.constants.near;
                return Ok(in_frustums(views, *count, depths, near, config.seed, strategy)?.into());
            }
            Self::At(file) if !file.is_dir() => return Ok(read_gaussians(file, opacities_as_stored, strategy)?),
            Self::At(folder) => points_folder(folder).ok_or_else(|| StartError::NoPoints(folder.clone()))?,
            Self::Points => points_of_scene(of.data, &of.scene.key)?,
        };
        let warnings = of.check(&folder)?;
        let point = |point: ColmapPoint| Point {
            position: of.applied.map_or(point.position, |applied| applied.saved_point(point.position)).to_array(),
            colour: point.color.map(|channel| f64::from(channel) / 255.0),
        };
        let points: Vec<Point> = read_points(&folder)?.into_iter().map(point).collect();
        let gaussians = from_points(&points, strategy);
        let gaussians = gaussians.map_err(|error| StartError::Unusable { folder, error: Box::new(error) })?;
        Ok(StartGaussians { gaussians, removed: 0, warnings })
    }
}

impl PointsOf<'_> {
    /// Compares the model's cameras with the scene's; warns if that cannot be done.
    fn check(&self, folder: &Path) -> Result<Vec<String>, StartError> {
        match displacement(folder, self.scene, self.applied)? {
            Some(Displacement { distance, .. }) if distance <= CLOSE => Ok(Vec::new()),
            Some(Displacement { images, distance }) => {
                Err(StartError::Elsewhere { folder: folder.to_owned(), images, percent: 100.0 * distance })
            }
            None => Ok(vec![format!(
                "whether COLMAP's points are in the cameras' world is not known: {} has no images.bin or images.txt with two \
                 frames of the scene",
                folder.display()
            )]),
        }
    }
}

/// The folder of a scene's points: `data` is its capture or a file in it, or a folder of captures.
fn points_of_scene(data: &Path, scene: &str) -> Result<PathBuf, StartError> {
    let folder = if data.is_dir() { data } else { data.parent().unwrap_or(data) };
    let found = points_folder(folder).or_else(|| points_folder(&folder.join(scene)));
    found.ok_or_else(|| StartError::NoPoints(folder.to_owned()))
}

/// The Gaussians of a file that can be optimised, repaired as [`Fit::new`](atsplat_fit::Fit::new) repairs them.
fn read_gaussians(path: &Path, opacities_as_stored: bool, strategy: Strategy) -> Result<StartGaussians, SplatError> {
    let (gaussians, import) = files::read(path)?;
    let stored = import.validation.total;
    let (gaussians, mut warnings) = files::interpret(gaussians, &import, opacities_as_stored, path)?;
    if import.antialiased == Some(true) && strategy != Strategy::MipSplatting {
        warnings.push(format!(
            "the file says that its Gaussians were trained with antialiasing, but the strategy {} draws them without it, in the \
             classic mode: see --strategy {}",
            strategy.name(),
            Strategy::MipSplatting.name()
        ));
    }
    let (gaussians, found) = gaussians.into_cleaned(Cleaning::Repair);
    let removed = stored.saturating_sub(gaussians.len());
    // Those that were kept on import are found again.
    let broken = import.validation.invalid.max(import.validation.rejected + found.invalid);
    let first = if import.validation.is_clean() { found } else { import.validation };
    let repaired = broken.saturating_sub(removed);
    let both = Validation { total: stored, invalid: broken, rejected: removed, repaired, ..first };
    warnings.extend(both.warning("Gaussians"));
    if !import.unused.is_empty() {
        warnings.push(format!("unused parts of the file: {}", import.unused.join(", ")));
    }
    Ok(StartGaussians { gaussians, removed, warnings })
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use atsplat_scene::colmap::MODEL_FOLDERS;
    use atsplat_scene::{SceneSource as _, Warnings};
    use atsplat_splat::GaussianParts;
    use atsplat_splat::files::{Encoding, Output};

    use super::*;

    fn scene_without_frames(key: &str) -> Scene {
        Scene { key: key.to_owned(), url: None, frames: Vec::new() }
    }

    fn parts(count: usize) -> GaussianParts {
        GaussianParts {
            means: vec![[0.5; 3]; count],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[-3.0; 3]; count],
            opacity_logits: vec![2.0; count],
            sh_degree: 0,
            sh: vec![[0.25; 3]; count],
            scalars: None,
            filter_3d: None,
        }
    }

    fn read(parts: GaussianParts, opacities_as_stored: bool) -> StartGaussians {
        read_for(Strategy::Fixed, parts, Output::Ply(Encoding::BinaryLittleEndian), opacities_as_stored)
    }

    fn read_for(strategy: Strategy, parts: GaussianParts, output: Output, opacities_as_stored: bool) -> StartGaussians {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("start");
        files::write(&path, &Gaussians::new(parts).unwrap(), output).unwrap();
        read_file(folder.path(), strategy, opacities_as_stored)
    }

    /// The file `start` of a folder.
    fn read_file(folder: &Path, strategy: Strategy, opacities_as_stored: bool) -> StartGaussians {
        let start = Start::At(folder.join("start"));
        let of = PointsOf { data: folder, scene: &scene_without_frames("scene"), applied: None };
        start.gaussians(&TrainingViews::default(), of, None, opacities_as_stored, &FitConfig::new(strategy, 1)).unwrap()
    }

    #[test]
    fn a_file_with_broken_gaussians_is_repaired_with_a_warning() {
        assert_eq!(read(parts(5), false).warnings, Vec::<String>::new());
        let mut broken = parts(5);
        broken.means[1][2] = f32::NAN;
        broken.means[2][0] = f32::INFINITY;
        broken.quaternions[4] = [0.0; 4];
        let start = read(broken, false);
        assert_eq!((start.gaussians.len(), start.removed, start.warnings.len()), (3, 2, 1));
        let expected = "3 of 5 Gaussians are broken, of which 2 are removed and 1 repaired: means ";
        assert!(start.warnings[0].starts_with(expected), "{}", start.warnings[0]);
        assert!(start.gaussians.validate().is_clean());
    }

    /// SPZ stores opacities: those of 0 and 1 are read as finite logits.
    #[test]
    fn opaque_and_transparent_gaussians_are_broken_only_as_logits() {
        let with = |logits: [f32; 3]| GaussianParts { opacity_logits: logits.to_vec(), ..parts(3) };
        let spz = Output::Spz3 { antialiased: false };
        let start = read_for(Strategy::Fixed, with([20.0, 2.0, -20.0]), spz, false);
        assert_eq!((start.warnings, start.gaussians.len(), start.removed), (Vec::<String>::new(), 3, 0));
        let [opaque, seen, transparent] = start.gaussians.parts().opacity_logits.as_slice() else { panic!("three") };
        assert!(*opaque > 10.0 && (*seen - 2.0).abs() < 0.1 && *transparent < -10.0, "{opaque} {seen} {transparent}");
        // A PLY stores logits; this toolkit writes none that is infinite.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("start");
        let ply = Output::Ply(Encoding::Ascii);
        files::write(&path, &Gaussians::new(with([20.0, 2.0, 3.0])).unwrap(), ply).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let infinite = text.replacen(" 20.0 ", " inf ", 1);
        assert_ne!(infinite, text);
        std::fs::write(&path, infinite).unwrap();
        let as_logits = read_file(folder.path(), Strategy::Fixed, false);
        let expected = "1 of 3 Gaussians are broken, of which 0 are removed and 1 repaired: opacity logits infinite ";
        assert!(matches!(&as_logits.warnings[..], [text] if text.starts_with(expected)), "{:?}", as_logits.warnings);
    }

    #[test]
    fn opacities_that_may_be_no_logits_are_warned_of_or_converted() {
        let opacities = || GaussianParts { opacity_logits: vec![0.75; 2], ..parts(2) };
        let as_logits = read(opacities(), false);
        assert!(as_logits.warnings.len() == 1 && as_logits.warnings[0].contains("--opacities-as-stored"));
        assert_eq!(as_logits.gaussians.parts().opacity_logits, [0.75; 2]);
        let converted = read(opacities(), true);
        assert!(converted.warnings.is_empty() && converted.removed == 0, "{:?}", converted.warnings);
        assert_eq!(converted.gaussians.parts().opacity_logits, [3.0f32.ln(); 2]);
    }

    #[test]
    fn scales_that_may_have_no_logarithm_are_warned_of() {
        let scales = GaussianParts { log_scales: vec![[0.01, 0.5, 1.0]; 2], ..parts(2) };
        let warnings = read(scales.clone(), false).warnings;
        assert_eq!(
            warnings,
            ["every log-scale of the file lies in (0, 1]: they may be scales without their logarithm"]
        );
        let one_is_none = GaussianParts { log_scales: vec![[0.01, 0.5, 1.0], [0.01, -0.5, 1.0]], ..scales };
        assert_eq!(read(one_is_none, false).warnings, [""; 0]);
    }

    #[test]
    fn a_file_of_antialiased_training_is_noted_where_the_strategy_draws_without() {
        let warnings = |strategy, output| read_for(strategy, parts(2), output, false).warnings;
        for strategy in Strategy::ALL {
            let noted = warnings(strategy, Output::Spz3 { antialiased: true });
            if strategy == Strategy::MipSplatting {
                assert_eq!(noted, [""; 0]);
            } else {
                let name = format!("the strategy {} draws", strategy.name());
                let is_noted = |note: &String| note.contains(&name) && note.contains("--strategy mip-splatting");
                assert!(matches!(&noted[..], [note] if is_noted(note)), "{noted:?}");
            }
            assert_eq!(warnings(strategy, Output::Spz3 { antialiased: false }), [""; 0]);
        }
    }

    /// Where the reader of COLMAP's models looks, with the data as it accepts them.
    #[test]
    fn points_are_found_in_captures_and_their_folder() {
        let folder = tempfile::tempdir().unwrap();
        let garden = folder.path().join("garden");
        std::fs::create_dir_all(garden.join("sparse")).unwrap();
        let rows = (0..5).map(|at| format!("{at} {at} 0 1 255 0 0 0.5\n")).collect::<Vec<_>>().concat();
        std::fs::write(garden.join("sparse/points3D.txt"), rows).unwrap();
        let points = |start: &Start, data: &Path, scene: &str| {
            let of = PointsOf { data, scene: &scene_without_frames(scene), applied: None };
            let made = start.gaussians(&TrainingViews::default(), of, None, false, &FitConfig::new(Strategy::Fixed, 1));
            made.map(|made| made.gaussians.len()).map_err(|error| error.to_string())
        };
        let file = garden.join("transforms.json");
        for (data, scene) in [(folder.path(), "garden"), (garden.as_path(), "garden"), (file.as_path(), "other")] {
            assert_eq!(points(&Start::Points, data, scene), Ok(5), "{}", data.display());
        }
        assert_eq!(points(&Start::At(garden.clone()), folder.path(), "other"), Ok(5));
        let error = points(&Start::Points, folder.path(), "other").unwrap_err();
        assert!(error.contains(&folder.path().display().to_string()), "{error}");
        assert!(MODEL_FOLDERS.into_iter().skip(1).all(|place| error.contains(&format!(" {place}/"))), "{error}");
        std::fs::write(garden.join("sparse/points3D.txt"), "1 1 0 1 255 0 0 0.5\n").unwrap();
        let error = points(&Start::Points, folder.path(), "garden").unwrap_err();
        let sparse = garden.join("sparse");
        assert!(error.contains("at least four points, found 1") && error.contains(sparse.to_str().unwrap()), "{error}");
    }

    /// As `ns-process-data` leaves a capture: its cameras are turned, then moved, then scaled; COLMAP's model is not.
    #[test]
    fn points_move_as_the_cameras_of_their_capture_did() {
        let folder = tempfile::tempdir().unwrap();
        let capture = folder.path().join("garden");
        let model = capture.join("colmap/sparse/0");
        std::fs::create_dir_all(&model).unwrap();
        let rows = (1..=5).map(|at| format!("{at} {at} 20 300 255 0 0 0.5\n")).collect::<Vec<_>>().concat();
        std::fs::write(model.join("points3D.txt"), rows).unwrap();
        let points = |applied: &str| {
            let camera = r#""w": 8, "h": 6, "fl_x": 5, "fl_y": 5, "cx": 4, "cy": 3, "frames": [{ "file_path": "a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]] }]"#;
            std::fs::write(capture.join("transforms.json"), format!("{{ {applied} {camera} }}")).unwrap();
            let dataset = atsplat_scene::open(folder.path(), &mut Warnings::new()).unwrap();
            let scene = dataset.load("garden", &mut Warnings::new()).unwrap();
            let applied = dataset.applied_transform("garden").unwrap();
            [Start::Points, Start::At(capture.clone())].map(|start| {
                assert!(start.reads_points());
                let of = PointsOf { data: folder.path(), scene: &scene, applied };
                let config = FitConfig::new(Strategy::Fixed, 1);
                let made = start.gaussians(&TrainingViews::default(), of, None, false, &config).unwrap();
                assert!(made.warnings[0].contains("has no images.bin or images.txt"), "{:?}", made.warnings);
                made.gaussians.parts().means.iter().map(|mean| mean.map(f64::from)).collect::<Vec<_>>()
            })
        };
        let turn = r#""applied_transform": [[0, 1, 0, 5], [0, 0, 1, 6], [1, 0, 0, 7]],"#;
        for (applied, expected) in [
            (format!(r#"{turn} "applied_scale": 2,"#), [50.0, 612.0, 16.0]),
            (turn.to_owned(), [25.0, 306.0, 8.0]),
            (r#""applied_scale": 2,"#.to_owned(), [2.0, 40.0, 600.0]),
            (String::new(), [1.0, 20.0, 300.0]),
        ] {
            for found in points(&applied) {
                Tolerance::absolute(1e-4).assert(found[0], expected, &applied);
            }
        }
        assert!(!Start::Random(1).reads_points() && !Start::At("start.ply".into()).reads_points());
    }

    /// The capture's world is COLMAP's turned by a quarter, moved and scaled; a camera was refined, and one is not COLMAP's.
    #[test]
    fn points_of_another_world_than_the_cameras_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("sparse/0");
        std::fs::create_dir_all(&model).unwrap();
        let image =
            |id: u32, x: f64, y: f64, z: f64| format!("{id} 1 0 0 0 {} {} {} 1 photos/{id}.jpg\n\n", -x, -y, -z);
        let images =
            [image(1, 0.0, 0.0, 0.0), image(2, 8.0, 0.0, 0.0), image(3, 0.0, 6.0, 0.0), image(9, 1.0, 1.0, 1.0)];
        std::fs::write(model.join("images.txt"), images.concat()).unwrap();
        std::fs::write(
            model.join("points3D.txt"),
            (1..=5).map(|at| format!("{at} {at} 6 7 255 0 0 0.5\n")).collect::<Vec<_>>().concat(),
        )
        .unwrap();
        let transforms = r#"{ "applied_transform": [[0, 1, 0, 5], [0, 0, 1, 6], [1, 0, 0, 7]], "applied_scale": 2,
            "w": 8, "h": 6, "fl_x": 5, "fl_y": 5, "cx": 4, "cy": 3, "frames": [
            { "file_path": "1.png", "transform_matrix": [[1,0,0,10],[0,1,0,12],[0,0,1,14]] },
            { "file_path": "2.png", "transform_matrix": [[1,0,0,10],[0,1,0,12],[0,0,1,30]] },
            { "file_path": "3.png", "transform_matrix": [[1,0,0,22.3],[0,1,0,12],[0,0,1,14]] },
            { "file_path": "4.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]] } ] }"#;
        std::fs::write(folder.path().join("transforms.json"), transforms).unwrap();
        let dataset = atsplat_scene::open(folder.path(), &mut Warnings::new()).unwrap();
        let key = dataset.keys()[0].clone();
        let scene = dataset.load(&key, &mut Warnings::new()).unwrap();
        let started = |applied| {
            let of = PointsOf { data: folder.path(), scene: &scene, applied };
            Start::Points
                .gaussians(&TrainingViews::default(), of, None, false, &FitConfig::new(Strategy::Fixed, 1))
                .map_err(|error| error.to_string())
        };
        let applied = dataset.applied_transform(&key).unwrap();
        assert!(applied.is_some());
        assert_eq!(started(applied).unwrap().warnings, Vec::<String>::new());
        // By hand: 21.0, 32.4 and 27.0 units, and the diagonal of the box is 20.2.
        let error = started(None).unwrap_err();
        assert!(error.contains("cameras of 3 images") && error.contains("by 134 % of its extent"), "{error}");
    }

    #[test]
    fn parses_random_points_and_paths() {
        assert_eq!("random:7".parse(), Ok(Start::Random(7)));
        assert_eq!(("points".parse(), "a/b.ply".parse()), (Ok(Start::Points), Ok(Start::At("a/b.ply".into()))));
        for broken in ["random:", "random:0", "random:-1", "random:x"] {
            let error = broken.parse::<Start>().unwrap_err().to_string();
            assert_eq!(error, format!("expected random:N, found {broken:?}"));
        }
    }
}
