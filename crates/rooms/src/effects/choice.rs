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
        assert_eq!("motion-blur,soft-shadows".parse(), Ok(only));
        let message = "fog".parse::<EffectChoice>().unwrap_err().to_string();
        assert!(message.contains("sensor-noise") && message.contains("\"fog\""), "{message}");
    }
}
