use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use atsplat_files::{FileError, InvalidText, Malformed};
use atsplat_splat::{Exposure, LARGEST_CHANNEL};
use thiserror::Error;

use super::FrameRequest;

/// The exposure of each view.
#[derive(Debug)]
pub enum Exposures {
    /// From the camera file, if it has any.
    OfCameras,
    /// One for all views.
    Uniform(Exposure),
    /// By view name.
    Listed {
        /// Where they were read.
        file: PathBuf,
        /// The exposures.
        by_name: BTreeMap<String, Exposure>,
    },
}

/// Where exposures come from: one gain for all views, or a file.
#[derive(Clone, Debug, PartialEq)]
pub enum ExposureSource {
    /// Every channel is multiplied by it.
    Gain(f64),
    /// See [`Exposures::read`].
    File(PathBuf),
}

impl FromStr for ExposureSource {
    type Err = InvalidText;

    /// A gain, or a path that ends in `.json`.
    fn from_str(text: &str) -> Result<Self, InvalidText> {
        let path = PathBuf::from(text);
        if path.extension().is_some_and(|extension| extension == "json") {
            return Ok(Self::File(path));
        }
        let gain = text.parse().ok().filter(|gain| (0.0..=LARGEST_CHANNEL).contains(gain));
        let expected = || format!("a gain from 0 to {LARGEST_CHANNEL:e} or a path that ends in .json");
        gain.map(Self::Gain).ok_or_else(|| InvalidText::new(expected(), text))
    }
}

/// Why exposures cannot be read or applied.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ExposuresError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The file does not contain exposures.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// A view is not in the file.
    #[error("{} has no exposure for the view {view:?}", file.display())]
    Missing { file: PathBuf, view: String },
}

impl Exposures {
    /// The exposures of a source; those of the cameras without one.
    ///
    /// # Errors
    /// Those of [`Self::read`].
    pub fn of(source: Option<&ExposureSource>) -> Result<Self, ExposuresError> {
        match source {
            None => Ok(Self::OfCameras),
            Some(ExposureSource::Gain(gain)) => Ok(Self::Uniform(Exposure::uniform(*gain))),
            Some(ExposureSource::File(file)) => Self::read(file),
        }
    }

    /// Reads a file in the format of 3DGS' `exposure.json` (graphdeco-inria/gaussian-splatting `scene/__init__.py`): an
    /// object with a 3×4 array per view name. 3DGS names its views by their image files; [`Self::expose`] takes either name.
    ///
    /// # Errors
    /// [`ExposuresError::Io`], [`ExposuresError::Malformed`].
    pub fn read(file: &Path) -> Result<Self, ExposuresError> {
        let bytes = std::fs::read(file).map_err(FileError::during::<ExposuresError>("reading exposures", file))?;
        let arrays: BTreeMap<String, [[f64; 4]; 3]> = atsplat_scene::json::parse(&bytes)
            .and_then(serde_json::from_value)
            .map_err(|error| Malformed::new("exposures", "JSON", "a 3×4 array per view name", error).in_file(file))?;
        let by_name = arrays.into_iter().map(|(name, array)| (name, Exposure::from_3dgs(array))).collect();
        Ok(Self::Listed { file: file.to_owned(), by_name })
    }

    /// Sets the exposure of the views.
    ///
    /// # Errors
    /// [`ExposuresError::Missing`].
    pub fn expose(&self, requests: &mut [FrameRequest]) -> Result<(), ExposuresError> {
        for request in requests {
            match self {
                Self::OfCameras => {}
                Self::Uniform(exposure) => request.exposure = Some(*exposure),
                Self::Listed { file, by_name } => match named(by_name, &request.name) {
                    Some(exposure) => request.exposure = Some(exposure),
                    None => return Err(ExposuresError::Missing { file: file.clone(), view: request.name.clone() }),
                },
            }
        }
        Ok(())
    }
}

/// The exposure of this name, or of the only image file with this name before its extension.
fn named(by_name: &BTreeMap<String, Exposure>, view: &str) -> Option<Exposure> {
    let is_file_of = |name: &str| {
        let extension = name.strip_prefix(view).and_then(|rest| rest.strip_prefix('.'));
        extension.is_some_and(|extension| !extension.contains(['.', '/']))
    };
    let mut files = by_name.iter().filter(|(name, _)| is_file_of(name)).map(|(_, exposure)| *exposure);
    by_name.get(view).copied().or_else(|| files.next().filter(|_| files.next().is_none()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_is_known_by_its_name_or_that_of_its_image_file() {
        let gains = [("a", 1.0), ("a.jpg", 2.0), ("b.JPG", 3.0), ("left/c.png", 4.0), ("d.jpg", 5.0), ("d.png", 6.0)];
        let by_name = gains.map(|(name, gain)| (name.to_owned(), Exposure::uniform(gain))).into();
        let found = |view: &str| named(&by_name, view);
        for (view, gain) in [("a", 1.0), ("b", 3.0), ("left/c", 4.0)] {
            assert_eq!(found(view), Some(Exposure::uniform(gain)), "{view}");
        }
        assert_eq!([found("c"), found("d"), found("left")], [None; 3], "another folder, two files, no file");
    }

    #[test]
    fn parses_a_gain_or_a_path() {
        assert_eq!("1.5".parse(), Ok(ExposureSource::Gain(1.5)));
        assert_eq!("a/exposure.json".parse(), Ok(ExposureSource::File("a/exposure.json".into())));
        for broken in ["-1", "NaN", "inf", "1e13", "bright", ""] {
            assert!(broken.parse::<ExposureSource>().is_err(), "{broken:?}");
        }
    }
}
