use std::fmt;

use serde::{Deserialize, Serialize};

use crate::rng::mix;

/// Kind of scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneKind {
    /// RE10K-like: one or two furnished rooms, a gliding camera.
    Rooms,
    /// DL3DV-like: courtyards and halls, a longer walk.
    Yards,
}

impl SceneKind {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::Rooms, Self::Yards];

    /// The name in keys, files and on command lines; it is the id of the dataset of these scenes too.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rooms => "rooms",
            Self::Yards => "yards",
        }
    }

    /// The kind with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl fmt::Display for SceneKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Split of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// For training.
    Train,
    /// For testing.
    Test,
}

impl Split {
    /// Both splits.
    pub const ALL: [Self; 2] = [Self::Train, Self::Test];

    /// The name in keys, files and on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
        }
    }

    /// The split with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|split| split.name() == name)
    }
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Seed of one scene. The split is the lowest bit of the number from which everything is drawn, so that training and test
/// scenes never coincide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SceneSeed {
    /// Split of the scene.
    pub split: Split,
    /// Number of the scene within the split.
    pub number: u32,
}

impl SceneSeed {
    /// The seed of all random streams of the scene: a bijection of split and number. The kind of scene is not part of it, but
    /// of the names of streams that both kinds would otherwise share.
    pub(crate) fn bits(self) -> u64 {
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
    use crate::Layout;

    /// The names that serde knows of a type, in its error for another one.
    fn known_to_serde<T: for<'de> Deserialize<'de>>() -> String {
        let unknown = serde_json::from_value::<T>("".into()).err().unwrap().to_string();
        unknown.rsplit_once("expected ").unwrap().1.replace("one of ", "").replace(" or ", ", ").replace('`', "")
    }

    #[test]
    fn lists_and_names_are_those_of_files() {
        assert_eq!(SceneKind::ALL.map(SceneKind::name).join(", "), known_to_serde::<SceneKind>());
        assert_eq!(Split::ALL.map(Split::name).join(", "), known_to_serde::<Split>());
        assert_eq!(Layout::ALL.map(Layout::name).join(", "), known_to_serde::<Layout>());
        assert_eq!((SceneKind::named("yards"), SceneKind::named("Yards")), (Some(SceneKind::Yards), None));
        assert_eq!((Split::named("train"), Split::named("")), (Some(Split::Train), None));
    }

    #[test]
    fn splits_have_different_seeds() {
        let seeds = |split| (0..20_000).map(move |number| SceneSeed { split, number }.bits());
        let train: BTreeSet<u64> = seeds(Split::Train).collect();
        assert_eq!(train.len(), 20_000);
        assert!(seeds(Split::Test).all(|seed| !train.contains(&seed)));
        assert_eq!(SceneSeed { split: Split::Test, number: 7 }.key(SceneKind::Yards), "yards-test-00000007");
    }
}
