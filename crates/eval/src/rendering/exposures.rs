use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use atsplat_files::{FileError, InvalidText, Malformed};
use atsplat_splat::{Exposure, LARGEST_CHANNEL};
use serde_json::Value;
use thiserror::Error;

use super::FrameRequest;

const WHAT: &str = "exposures";

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
        let bytes =
            atsplat_files::read(file).map_err(FileError::during::<ExposuresError>("reading exposures", file))?;
        let whole =
            |found: &dyn Display| Malformed::new(WHAT, "JSON", "a 3×4 array per view name", found).in_file(file);
        let Value::Object(arrays) = atsplat_scene::json::parse(&bytes).map_err(|error| whole(&error))? else {
            return Err(whole(&"another value than an object").into());
        };
        let of_view = |(name, array): (String, Value)| -> Result<(String, Exposure), ExposuresError> {
            let array = array_of(&name, &array).map_err(|error| error.in_file(file))?;
            Ok((name, Exposure::from_3dgs(array)))
        };
        let by_name = arrays.into_iter().map(of_view).collect::<Result<_, ExposuresError>>()?;
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

/// The 3×4 array of a view. Rows and columns are counted from 0.
fn array_of(view: &str, value: &Value) -> Result<[[f64; 4]; 3], Malformed> {
    let mut array = [[0.0; 4]; 3];
    let rows = items::<3>(&format!("view {view:?}"), "rows", value)?;
    for (row, (numbers, value)) in array.iter_mut().zip(rows).enumerate() {
        let location = format!("view {view:?}, row {row}");
        for (column, (number, value)) in numbers.iter_mut().zip(items::<4>(&location, "columns", value)?).enumerate() {
            let found = value.as_f64().filter(|found| found.abs() <= LARGEST_CHANNEL);
            *number = found.ok_or_else(|| {
                let expected = format!("a number from -{LARGEST_CHANNEL:e} to {LARGEST_CHANNEL:e}");
                Malformed::new(WHAT, format!("{location}, column {column}"), expected, value)
            })?;
        }
    }
    Ok(array)
}

/// The items of a list of `N`.
fn items<'a, const N: usize>(location: &str, of: &str, value: &'a Value) -> Result<&'a [Value; N], Malformed> {
    let items = value.as_array().and_then(|items| <&[Value; N]>::try_from(items.as_slice()).ok());
    items.ok_or_else(|| Malformed::new(WHAT, location, format!("{N} {of} of a 3×4 array"), value))
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
    fn an_error_of_a_file_names_view_row_and_column() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("exposure.json");
        let first = r#""a": [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]]"#;
        let read = |text: String| {
            std::fs::write(&file, text).unwrap();
            Exposures::read(&file)
        };
        let Exposures::Listed { by_name, .. } = read(format!("{{{first}}}")).unwrap() else { unreachable!() };
        assert_eq!(by_name["a"].offset.map(f64::to_bits), [4.0, 8.0, 12.0].map(f64::to_bits));
        for (second, expected) in [
            (
                r#"[[1, 0, 0, 0], [0, 1, 0, 0], [0, "x", 1, 0]]"#,
                r#"view "b", row 2, column 1: expected a number from -1e12 to 1e12, found "x""#,
            ),
            (
                "[[1, 0, 0, 0], [0, 1, 0, 2000000000000], [0, 0, 1, 0]]",
                r#"view "b", row 1, column 3: expected a number from -1e12 to 1e12, found 2000000000000"#,
            ),
            (
                "[[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0]]",
                r#"view "b", row 1: expected 4 columns of a 3×4 array, found [0,1,0]"#,
            ),
            (
                "[[1, 0, 0, 0], [0, 1, 0, 0]]",
                r#"view "b": expected 3 rows of a 3×4 array, found [[1,0,0,0],[0,1,0,0]]"#,
            ),
            ("7", r#"view "b": expected 3 rows of a 3×4 array, found 7"#),
        ] {
            let error = read(format!(r#"{{{first}, "b": {second}}}"#)).unwrap_err().to_string();
            assert_eq!(error, format!("exposures: {expected} ({})", file.display()));
        }
        let error = read("[1]".to_owned()).unwrap_err().to_string();
        assert!(error.contains("expected a 3×4 array per view name, found another value than an object"), "{error}");
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
