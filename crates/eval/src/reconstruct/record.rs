use std::path::PathBuf;

use atsplat_camera::{Distortion, Fallback, PoseNormalisation};
use atsplat_files::Sha256Digest;
use atsplat_model::network::{Processor, Reconstruction};
use atsplat_protocol::NearFar;
use atsplat_protocol::trial::{AppliedNormalisation, ImageDigests};
use atsplat_splat::Gaussians;
use serde::Serialize;

use super::Photos;

/// The input photos and their preprocessing.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct InputRecord {
    /// Path of the dataset as given by the user.
    pub data: PathBuf,
    /// Key of the scene.
    pub scene: String,
    /// Context views.
    pub views: Vec<ViewRecord>,
    /// Target views.
    pub targets: Vec<ViewRecord>,
    /// Identity of the trial: frames, source cameras, preprocessing, normalisation, near and far planes.
    pub trial: Sha256Digest,
    /// Identity of the data: bytes of the images of all views, and the source cameras with their lenses.
    pub data_sha256: Sha256Digest,
    /// The protocol whose recipe was used, if any.
    pub protocol: Option<String>,
    /// The colour, of 8 bits, that photos with alpha channels were composited over; otherwise these channels were dropped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub composited_over: Option<[u8; 3]>,
    /// Preprocessing of images and intrinsics.
    pub preprocessing: String,
    /// Normalisation of the poses.
    pub normalisation: NormalisationRecord,
    /// Near and far plane in the network's unit of length.
    pub near_far: NearFar,
}

/// A frame of the scene.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ViewRecord {
    /// Position in the scene.
    pub frame: usize,
    /// The dataset's name of the frame.
    pub name: String,
}

/// `network = scale · rotation · (scene − origin)`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct NormalisationRecord {
    /// How origin, axes and scale were chosen.
    pub rule: PoseNormalisation,
    /// Row-major.
    pub rotation: [[f64; 3]; 3],
    /// In scene units.
    pub origin: [f64; 3],
    /// Network units per scene unit.
    pub scale: f64,
    /// Fallbacks of the rule for degenerate views.
    pub fallbacks: Vec<Fallback>,
}

impl From<&AppliedNormalisation> for NormalisationRecord {
    fn from(applied: &AppliedNormalisation) -> Self {
        let change = &applied.new_from_old;
        Self {
            rule: applied.rule.clone(),
            rotation: change.rotation.transpose().to_cols_array_2d(),
            origin: change.origin.to_array(),
            scale: change.scale,
            fallbacks: applied.fallbacks.clone(),
        }
    }
}

/// Tokens before and after each decoder block.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct TokenRecord {
    /// Tokens that entered the decoder.
    pub initial: usize,
    /// One per decoder block.
    pub blocks: Vec<BlockRecord>,
    /// Tokens that left the decoder.
    pub r#final: usize,
    /// Gaussians of these tokens.
    pub gaussians: usize,
}

/// Tokens of one decoder block.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BlockRecord {
    /// Tokens that entered.
    pub entered: usize,
    /// Tokens that were expanded.
    pub expanded: usize,
    /// Tokens that left.
    pub left: usize,
    /// Gaussians that the head would make of the tokens that left.
    pub gaussians: usize,
    /// Minimum and maximum predicted uncertainty of the tokens that entered, if the block scores them.
    pub scores: Option<[f32; 2]>,
}

impl TokenRecord {
    /// Counts the tokens of a reconstruction.
    pub fn of(reconstruction: &Reconstruction) -> Self {
        let budget = &reconstruction.budget;
        let per_token = budget.gaussians_per_token();
        let mut entered = budget.initial_tokens;
        let rows = budget.expanded.iter().zip(&budget.tokens).zip(&reconstruction.blocks);
        let blocks = rows.map(|((&expanded, &left), outcome)| {
            let scores = outcome.scores.as_ref().and_then(|scores| {
                let minimum = scores.iter().copied().min_by(f32::total_cmp)?;
                Some([minimum, scores.iter().copied().max_by(f32::total_cmp)?])
            });
            let row = BlockRecord { entered, expanded, left, gaussians: per_token * left, scores };
            entered = left;
            row
        });
        let blocks = blocks.collect();
        let (initial, r#final, gaussians) = (budget.initial_tokens, budget.final_tokens, budget.gaussians);
        Self { initial, blocks, r#final, gaussians }
    }
}

#[expect(clippy::expect_used, reason = "photos keep the names of all frames of their trial")]
fn view_record(photos: &Photos, frame: usize) -> ViewRecord {
    ViewRecord { frame, name: photos.name(frame).expect("a name for every frame of the trial").to_owned() }
}

impl InputRecord {
    /// Records photos of the dataset `data`, prepared with the recipe of `protocol` if there is one.
    pub fn new(photos: &Photos, data: PathBuf, protocol: Option<String>) -> Self {
        let trial = photos.trial();
        let view = |frame: usize| view_record(photos, frame);
        Self {
            data,
            scene: trial.scene().to_owned(),
            views: trial.context().iter().map(|context| view(context.frame)).collect(),
            targets: trial.targets().iter().map(|target| view(target.frame)).collect(),
            trial: trial.hash(),
            data_sha256: trial.data_hash(photos.ground_truth(), &ImageDigests::default()),
            protocol,
            composited_over: None,
            preprocessing: trial.preprocessing().to_string(),
            normalisation: trial.normalisation().into(),
            near_far: trial.near_far(),
        }
    }
}

/// Warnings about photos and result: degenerate normalisation, lens distortion, invalid Gaussians, and a device that cannot
/// render.
pub fn warnings(reconstruction: &Reconstruction, photos: &Photos, processor: Processor) -> Vec<String> {
    let refused = |why| format!("the GPU cannot render the network's Gaussians: {why}");
    let mut warnings: Vec<String> = processor.render_error().map(refused).into_iter().collect();
    let fallbacks = &photos.trial().normalisation().fallbacks;
    if !fallbacks.is_empty() {
        let names: Vec<String> = fallbacks.iter().map(ToString::to_string).collect();
        warnings.push(format!("the pose normalisation is not stable for these views: {}", names.join("; ")));
    }
    let distorted = photos.trial().context().iter().filter(|view| view.camera.distortion != Distortion::None).count();
    warnings.extend(distortion_warning(distorted));
    let found = reconstruction.gaussians.validate();
    if !found.is_clean() {
        let (invalid, total) = (found.invalid, found.total);
        warnings.push(format!("{invalid} of {total} Gaussians are invalid; `atsplat render` lists the problems"));
    }
    warnings
}

/// The warning about this many views through a lens.
fn distortion_warning(distorted: usize) -> Option<String> {
    (distorted > 0).then(|| {
        format!(
            "{distorted} views have lens distortion: their rays follow it, which the papers' networks were never trained on; \
             `atsplat data undistort`, of a build with `--features opencv`, removes it from the photos, --no-distortion ignores it"
        )
    })
}

/// The warning about Gaussians in a scene's frame that f32, the number format of every file of Gaussians, displaces visibly: a
/// capture with georeferenced positions, for example.
pub fn rounding_warning(in_scene: &Gaussians) -> Option<String> {
    let (coarse, all) = (in_scene.coarsely_placed(), in_scene.len());
    // A few are tiny in every scene.
    (coarse > all / 100).then(|| {
        format!(
            "{coarse} of {all} Gaussians are so far from the scene's origin that their 32-bit positions are off by more than an \
             eighth of their size: move the origin of the capture's cameras into the scene"
        )
    })
}

#[cfg(test)]
mod tests {
    use atsplat_splat::GaussianParts;

    use super::*;

    /// Other builds do not have that command.
    #[test]
    fn views_with_distortion_are_counted_and_the_build_that_removes_it_is_named() {
        assert_eq!(distortion_warning(0), None);
        let warning = distortion_warning(3).unwrap();
        assert!(warning.starts_with("3 views have") && warning.contains("`--features opencv`"), "{warning}");
    }

    #[test]
    fn warns_of_more_than_a_few_gaussians_far_from_the_origin() {
        let placed = |far: usize| {
            let mean = |number| if number < far { [400_000.0, 5.4e6, 100.0] } else { [1.0, 2.0, 3.0] };
            let parts = GaussianParts {
                means: (0..300).map(mean).collect(),
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 300],
                log_scales: vec![[-3.0; 3]; 300],
                opacity_logits: vec![0.0; 300],
                sh: vec![[0.0; 3]; 300],
                ..GaussianParts::default()
            };
            rounding_warning(&Gaussians::new(parts).unwrap())
        };
        assert_eq!(placed(3), None);
        assert!(placed(4).unwrap().starts_with("4 of 300 Gaussians are so far from the scene's origin"));
    }
}
