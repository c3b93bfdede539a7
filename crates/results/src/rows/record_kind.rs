/// What a method is, by [`crate::MethodRecord::kind`]: what is true of all methods of a kind is said here, and nowhere by comparing
/// names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordKind {
    /// A network of this toolkit.
    Network,
    /// A network whose Gaussians are refined on each trial.
    Refined,
    /// Gaussians that are optimised on each trial from random points.
    Optimised,
    /// The nearest context image.
    NearestView,
    /// Context images warped by depth.
    Warp,
    /// Imported images.
    Renders,
    /// Imported Gaussians.
    Ply,
    /// A process of its own.
    Exec,
    /// A Python callable.
    Python,
    /// A kind of another version, or of a program that implements its own.
    Other,
}

/// The kinds by their names in records. Optimisations have the names of their strategies.
const NAMES: [(&str, RecordKind); 12] = [
    ("atsplat", RecordKind::Network),
    ("atsplat+refine", RecordKind::Refined),
    ("3dgs", RecordKind::Optimised),
    ("mip-splatting", RecordKind::Optimised),
    ("mcmc", RecordKind::Optimised),
    ("fixed", RecordKind::Optimised),
    ("nearest-view", RecordKind::NearestView),
    ("warp", RecordKind::Warp),
    ("renders", RecordKind::Renders),
    ("ply", RecordKind::Ply),
    ("exec", RecordKind::Exec),
    ("python", RecordKind::Python),
];

impl RecordKind {
    /// The kind of this name.
    pub fn of(name: &str) -> Self {
        NAMES.iter().find(|(known, _)| *known == name).map_or(Self::Other, |(_, kind)| *kind)
    }

    /// The names of known kinds.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(name, _)| *name)
    }

    /// Whether it imports files of another program: images or Gaussians.
    pub const fn imports_files(self) -> bool {
        match self {
            Self::Renders | Self::Ply => true,
            Self::Network
            | Self::Refined
            | Self::Optimised
            | Self::NearestView
            | Self::Warp
            | Self::Exec
            | Self::Python
            | Self::Other => false,
        }
    }

    /// Whether its images come from files or another program, which may have written others than it meant.
    pub const fn is_from_outside(self) -> bool {
        match self {
            Self::Renders | Self::Ply | Self::Exec | Self::Python => true,
            Self::Network | Self::Refined | Self::Optimised | Self::NearestView | Self::Warp | Self::Other => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_say_where_images_come_from() {
        let of = |name: &str| {
            let kind = RecordKind::of(name);
            [kind.imports_files(), kind.is_from_outside()]
        };
        assert_eq!(["renders", "ply"].map(of), [[true, true]; 2]);
        assert_eq!(["exec", "python"].map(of), [[false, true]; 2]);
        let inside = ["atsplat", "atsplat+refine", "mip-splatting", "fixed", "nearest-view", "warp"];
        assert_eq!(inside.map(of), [[false, false]; 6]);
        assert_eq!(RecordKind::of("renders2"), RecordKind::Other);
        assert!(RecordKind::names().all(|name| RecordKind::of(name) != RecordKind::Other));
    }
}
