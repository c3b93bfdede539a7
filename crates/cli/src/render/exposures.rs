//! `--exposure`: the exposure applied to colour after compositing.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context as _, bail};
use atsplat_splat::{Exposure, LARGEST_CHANNEL};

use super::views::Shot;

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

/// The exposure of each view.
#[derive(Debug)]
pub(crate) enum Exposures {
    /// From the camera file, if it has any.
    OfCameras,
    Uniform(Exposure),
    /// By view name.
    Listed {
        file: PathBuf,
        by_name: BTreeMap<String, Exposure>,
    },
}

impl Exposures {
    /// Reads the file, if given, in the format of 3DGS' `exposure.json` (graphdeco-inria/gaussian-splatting
    /// `scene/__init__.py`): an object with a 3×4 array per view name.
    pub(crate) fn read(arg: Option<&ExposureArg>) -> anyhow::Result<Self> {
        let file = match arg {
            None => return Ok(Self::OfCameras),
            Some(ExposureArg::Gain(gain)) => return Ok(Self::Uniform(Exposure::uniform(*gain))),
            Some(ExposureArg::File(file)) => file.clone(),
        };
        let reading = || format!("reading exposures from {}", file.display());
        let bytes = std::fs::read(&file).with_context(reading)?;
        let arrays: BTreeMap<String, [[f64; 4]; 3]> = atsplat_scene::json::parse(&bytes)
            .and_then(serde_json::from_value)
            .with_context(|| format!("{}: expected a 3×4 array per view name", reading()))?;
        let by_name = arrays.into_iter().map(|(name, array)| (name, Exposure::from_3dgs(array))).collect();
        Ok(Self::Listed { file, by_name })
    }

    /// Sets the exposure of the views.
    pub(crate) fn expose(&self, shots: &mut [Shot]) -> anyhow::Result<()> {
        for shot in shots {
            match self {
                Self::OfCameras => {}
                Self::Uniform(exposure) => shot.exposure = Some(*exposure),
                Self::Listed { file, by_name } => match by_name.get(&shot.name) {
                    Some(exposure) => shot.exposure = Some(*exposure),
                    None => bail!("{} has no exposure for the view {:?}", file.display(), shot.name),
                },
            }
        }
        Ok(())
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
