//! `--exposure`: the exposure applied to colour after compositing.

use std::path::PathBuf;
use std::str::FromStr;

use atsplat_eval::rendering::{Exposures, ExposuresError};
use atsplat_splat::{Exposure, LARGEST_CHANNEL};

/// One gain for all views, or a file of matrices.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ExposureArg {
    Gain(f64),
    File(PathBuf),
}

impl FromStr for ExposureArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        if path.extension().is_some_and(|extension| extension == "json") {
            return Ok(Self::File(path));
        }
        let gain = text.parse().ok().filter(|gain| (0.0..=LARGEST_CHANNEL).contains(gain));
        gain.map(Self::Gain).ok_or_else(|| {
            format!("expected a gain from 0 to {LARGEST_CHANNEL:e} or a path that ends in .json, found {text:?}")
        })
    }
}

impl ExposureArg {
    /// The exposures; those of the cameras without an argument.
    pub(crate) fn read(arg: Option<&Self>) -> Result<Exposures, ExposuresError> {
        match arg {
            None => Ok(Exposures::OfCameras),
            Some(Self::Gain(gain)) => Ok(Exposures::Uniform(Exposure::uniform(*gain))),
            Some(Self::File(file)) => Exposures::read(file),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_a_gain_or_a_path() {
        assert_eq!("1.5".parse(), Ok(ExposureArg::Gain(1.5)));
        assert_eq!("a/exposure.json".parse(), Ok(ExposureArg::File("a/exposure.json".into())));
        for broken in ["-1", "NaN", "inf", "1e13", "bright", ""] {
            assert!(broken.parse::<ExposureArg>().is_err(), "{broken:?}");
        }
    }
}
