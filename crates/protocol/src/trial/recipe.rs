use atsplat_camera::PoseNormalisation;
use atsplat_pixels::DecodeLimits;
use atsplat_scene::preprocess::Preprocessing;

use crate::preset::{Filters, NearFar, Preset};

/// What makes trials out of index entries: the parts of a preset that touch cameras and pictures.
#[derive(Clone, Debug)]
pub struct TrialRecipe {
    /// What happens to pictures and intrinsics.
    pub preprocessing: Preprocessing,
    /// What happens to poses.
    pub pose_normalisation: PoseNormalisation,
    /// Near and far plane, before [`atsplat_camera::Normalised::near_far_multiplier`].
    pub near_far: NearFar,
    /// Which scenes the published loaders leave out.
    pub filters: Filters,
    /// Bounds on what a picture file may decode to.
    pub decode_limits: DecodeLimits,
    /// Whether an entry without pictures (a bare trajectory) makes a trial: its cameras are right, its
    /// pictures are errors. Off unless asked for.
    pub allow_absent_pictures: bool,
}

impl TrialRecipe {
    /// The recipe of a preset for one method: that method's published pose normalisation, near and far
    /// where the preset lists them, else the preset's own.
    pub fn of(preset: &Preset, method: &str) -> Self {
        let setting = preset.setting_of(method);
        Self {
            preprocessing: preset.preprocessing.clone(),
            pose_normalisation: setting.pose_normalisation.clone(),
            near_far: setting.near_far,
            filters: preset.filters.clone(),
            decode_limits: DecodeLimits::default(),
            allow_absent_pictures: false,
        }
    }
}
