use std::fmt;

use serde::{Deserialize, Serialize};

use crate::rng::mix;

/// What kind of place a scene shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneKind {
    /// RE10K-like: one or two furnished rooms, a gliding camera.
    Rooms,
    /// DL3DV-like: courtyards and halls, a longer walk.
    Yards,
}

impl fmt::Display for SceneKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Rooms => "rooms",
            Self::Yards => "yards",
        })
    }
}

/// What a scene is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// To learn from.
    Train,
    /// To be judged by.
    Test,
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "train",
            Self::Test => "test",
        })
    }
}

/// One scene of endlessly many. The split is the lowest bit of the number that everything is drawn from, so that no
/// training scene is a test scene whatever numbers are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SceneSeed {
    /// What the scene is for.
    pub split: Split,
    /// Which scene of the split.
    pub number: u32,
}

impl SceneSeed {
    /// The word that all streams of the scene start from: a bijection of split and number.
    pub(crate) fn word(self) -> u64 {
        mix(u64::from(self.number) << 1 | u64::from(self.split == Split::Test))
    }

    /// The scene's name: `rooms-train-00000012`.
    pub fn key(self, kind: SceneKind) -> String {
        format!("{kind}-{}-{:08}", self.split, self.number)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn splits_never_meet() {
        let words = |split| (0..20_000).map(move |number| SceneSeed { split, number }.word());
        let train: BTreeSet<u64> = words(Split::Train).collect();
        assert_eq!(train.len(), 20_000);
        assert!(words(Split::Test).all(|word| !train.contains(&word)));
        assert_eq!(SceneSeed { split: Split::Test, number: 7 }.key(SceneKind::Yards), "yards-test-00000007");
    }
}
