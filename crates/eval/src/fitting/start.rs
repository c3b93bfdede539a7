use std::path::{Path, PathBuf};
use std::str::FromStr;

use atsplat_files::InvalidText;
use atsplat_fit::start::{Point, from_points, in_frustums};
use atsplat_fit::{FitError, Strategy, TrainingView};
use atsplat_scene::SceneError;
use atsplat_scene::colmap::read_points;
use atsplat_splat::{Gaussians, SplatError, files};
use thiserror::Error;

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

/// Why there is nothing to start from.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StartError {
    /// COLMAP's points cannot be read.
    #[error("COLMAP's points: {0}")]
    Points(#[from] SceneError),
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
    /// The Gaussians for these views of a dataset. Random points are between two `depths`, by default around the point that the
    /// cameras look at.
    ///
    /// # Errors
    /// [`StartError`].
    pub fn gaussians(
        &self,
        views: &[TrainingView],
        data: &Path,
        depths: Option<[f64; 2]>,
        (seed, strategy): (u64, Strategy),
    ) -> Result<Gaussians, StartError> {
        let path: &Path = match self {
            Self::Random(count) => return Ok(in_frustums(views, *count, depths, seed, strategy)?),
            Self::Points => data,
            Self::At(path) => path,
        };
        if !path.is_dir() {
            return Ok(files::read(path)?.0);
        }
        let folders = [path.to_owned(), path.join("sparse/0"), path.join("colmap/sparse/0")];
        let holds = |folder: &&PathBuf| folder.join("points3D.bin").is_file() || folder.join("points3D.txt").is_file();
        let points = read_points(folders.iter().find(holds).map_or(path, PathBuf::as_path))?;
        let point = |point: atsplat_scene::colmap::ColmapPoint| Point {
            position: point.position.to_array(),
            colour: point.color.map(|channel| f64::from(channel) / 255.0),
        };
        Ok(from_points(&points.into_iter().map(point).collect::<Vec<_>>(), strategy)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
