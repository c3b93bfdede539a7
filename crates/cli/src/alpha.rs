//! What becomes of the alpha channels of photos.

use atsplat_scene::Scene;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Alpha {
    /// Transparent pixels keep their stored colour.
    Drop,
    /// The photos are put over a colour.
    Composite,
}

impl Alpha {
    /// Its names on the command line.
    pub(crate) const NAMES: [(&'static str, Self); 2] =
        [(Self::Drop.name(), Self::Drop), (Self::Composite.name(), Self::Composite)];

    /// Its name on the command line.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Drop => "drop",
            Self::Composite => "composite",
        }
    }

    /// The scene with its photos as they are read; `background` is what transparent pixels are composited over.
    pub(crate) fn shown(self, scene: Scene, background: [u8; 3]) -> Scene {
        match self {
            Self::Drop => scene,
            Self::Composite => scene.composited_over(background),
        }
    }
}
