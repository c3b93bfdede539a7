use std::fmt;
use std::str::FromStr;

use atsplat_files::InvalidText;
use serde::Serialize;

use super::EffectKind;

/// Choice of effects.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectChoice {
    /// The effects that the scene needs.
    #[default]
    Auto,
    /// All effects.
    All,
    /// No effects.
    None,
    /// Exactly these effects.
    Only(Vec<EffectKind>),
}

impl EffectChoice {
    /// Whether an effect is requested, whatever the scene needs.
    pub fn requests(&self, effect: EffectKind) -> bool {
        match self {
            Self::All => true,
            Self::Only(kinds) => kinds.contains(&effect),
            Self::Auto | Self::None => false,
        }
    }
}

impl fmt::Display for EffectChoice {
    /// As it is parsed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::All => f.write_str("all"),
            Self::None => f.write_str("none"),
            Self::Only(kinds) => f.write_str(&kinds.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(",")),
        }
    }
}

impl FromStr for EffectChoice {
    type Err = InvalidText;

    /// `auto`, `all`, `none`, or names separated by commas.
    fn from_str(text: &str) -> Result<Self, InvalidText> {
        let kind = |name: &str| {
            EffectKind::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
                let names = EffectKind::ALL.map(EffectKind::name).join(", ");
                InvalidText::new(format!("auto, all, none, or a list of {names}"), name)
            })
        };
        match text {
            "auto" => Ok(Self::Auto),
            "all" => Ok(Self::All),
            "none" => Ok(Self::None),
            list => list.split(',').map(kind).collect::<Result<_, _>>().map(Self::Only),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_names_in_their_order() {
        let only = EffectChoice::Only(vec![EffectKind::MotionBlur, EffectKind::SoftShadows]);
        assert_eq!("motion-blur,soft-shadows".parse(), Ok(only.clone()));
        for choice in [EffectChoice::Auto, EffectChoice::All, EffectChoice::None, only] {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        let message = "fog".parse::<EffectChoice>().unwrap_err().to_string();
        assert!(message.contains("sensor-noise") && message.contains("\"fog\""), "{message}");
    }
}
