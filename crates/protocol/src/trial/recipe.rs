use atsplat_camera::PoseNormalisation;
use atsplat_pixels::DecodeLimits;
use atsplat_scene::preprocess::Preprocessing;

use crate::preset::{DisparityPlanes, Filters, LensDistortion, NearFar, Preset};

/// How index entries become trials: the parts of a preset that affect cameras and images.
#[derive(Clone, Debug)]
pub struct TrialRecipe {
    /// How images and intrinsics are preprocessed.
    pub preprocessing: Preprocessing,
    /// Whether lens distortion that the data state is used.
    pub lens_distortion: LensDistortion,
    /// How poses are normalised.
    pub pose_normalisation: PoseNormalisation,
    /// Near and far plane, before [`atsplat_camera::Normalised::near_far_multiplier`].
    pub near_far: NearFar,
    /// What replaces them.
    pub disparity_planes: Option<DisparityPlanes>,
    /// Which scenes the published loaders drop.
    pub filters: Filters,
    /// Limits for decoding image files.
    pub decode_limits: DecodeLimits,
    /// Whether an entry without images (a bare trajectory) gives a trial: its cameras are valid, its images are
    /// errors. Off by default.
    pub allow_absent_images: bool,
}

impl TrialRecipe {
    /// The recipe of a preset for a method: with the method's published pose normalisation, near and far if the preset
    /// lists them, or else the preset's.
    pub fn of(preset: &Preset, method: &str) -> Self {
        let setting = preset.setting_for(method);
        Self {
            preprocessing: preset.preprocessing.clone(),
            lens_distortion: preset.lens_distortion,
            pose_normalisation: setting.pose_normalisation.clone(),
            near_far: setting.near_far,
            disparity_planes: setting.disparity_planes,
            filters: preset.filters.clone(),
            decode_limits: DecodeLimits::default(),
            allow_absent_images: false,
        }
    }
}
