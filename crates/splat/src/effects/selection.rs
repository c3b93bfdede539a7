use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use super::EFFECTS;
use crate::SplatError;

/// Which effects of a request run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum EffectSelection {
    /// Those that can change an image by more than the tolerance.
    #[default]
    Auto,
    /// Everything requested.
    All,
    /// None.
    Nothing,
    /// The requested effects in this list of names.
    Only(Vec<&'static str>),
}

impl EffectSelection {
    /// Whether the effect of this name may run if requested.
    pub fn allows(&self, effect: &str) -> bool {
        match self {
            Self::Auto | Self::All => true,
            Self::Nothing => false,
            Self::Only(names) => names.contains(&effect),
        }
    }
}

impl FromStr for EffectSelection {
    type Err = SplatError;

    /// `auto`, `all`, `none`, or names separated by commas.
    fn from_str(text: &str) -> Result<Self, SplatError> {
        match text {
            "auto" => return Ok(Self::Auto),
            "all" => return Ok(Self::All),
            "none" => return Ok(Self::Nothing),
            _ => {}
        }
        let known = |word: &str| EFFECTS.iter().map(|effect| effect.name()).find(|name| *name == word.trim());
        let name = |word: &str| known(word).ok_or_else(|| SplatError::Effect { found: word.to_owned() });
        text.split(',').map(name).collect::<Result<_, _>>().map(Self::Only)
    }
}

impl Display for EffectSelection {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::All => f.write_str("all"),
            Self::Nothing => f.write_str("none"),
            Self::Only(names) => f.write_str(&names.join(",")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_round_trip_through_text() {
        for text in ["auto", "all", "none", "lens", "view-dependence,background"] {
            assert_eq!(text.parse::<EffectSelection>().unwrap().to_string(), text);
        }
        assert_eq!("lens, scalar".parse::<EffectSelection>().unwrap(), EffectSelection::Only(vec!["lens", "scalar"]));
        let list: EffectSelection = "depth,lens".parse().unwrap();
        assert!(list.allows("lens") && !list.allows("scalar") && !EffectSelection::Nothing.allows("lens"));
        for wrong in ["", "Auto", "lens,,scalar", "blur"] {
            let error = wrong.parse::<EffectSelection>().unwrap_err().to_string();
            assert!(error.contains("auto, all, none") && error.contains("median-depth"), "{error}");
        }
    }
}
