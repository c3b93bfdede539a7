use std::collections::BTreeMap;
use std::sync::Arc;

use atsplat_camera::{Camera, CameraError, ImageSize, WorldFromCamera, normalise};
use atsplat_scene::preprocess::{Plan, PreprocessError, Preprocessing};
use atsplat_scene::{Frame, FrameImage, ImageHeader, ImageMismatch, Scene, Warnings};

use super::images::LazyImage;
use super::{
    AppliedNormalisation, ContextView, Rejection, SkipReason, TargetImages, TargetView, Trial, TrialRecipe, hash,
};
use crate::IndexEntry;
use crate::extrapolation::FrameLabel;
use crate::preset::{DropReason, Dropped, NearFar};

/// Checks whether an entry of a scene gives a trial, without decoding an image, and pushes the irregularities of the
/// images' headers to `warnings`; [`super::Trials`] agrees in both.
///
/// # Errors
/// [`Rejection`] with the reason why it does not.
pub fn check(
    scene: &Arc<Scene>,
    entry: &IndexEntry,
    recipe: &TrialRecipe,
    warnings: &mut Warnings,
) -> Result<(), Rejection> {
    prepare(scene, 0, entry, recipe, warnings).map(drop)
}

/// Prepares the trial of one index entry; no image is decoded.
pub(super) fn prepare(
    scene: &Arc<Scene>,
    entry_number: usize,
    entry: &IndexEntry,
    recipe: &TrialRecipe,
    warnings: &mut Warnings,
) -> Result<(Trial, TargetImages), Rejection> {
    let views = Views::of(scene, entry, recipe, warnings)?;
    let images = lazy_images(scene, &views, recipe);
    #[expect(clippy::expect_used, reason = "the map was filled from the same views")]
    let image = |view: &View<'_>| Arc::clone(images.get(&view.position).expect("an image for every view"));
    let normalised = normalise(&poses(&views.context), &poses(&views.targets), &recipe.pose_normalisation)
        .map_err(|error| of_normalisation(normalisation_reason(&error), &error))?;
    let context = views.context.iter().zip(&normalised.context).map(|(view, pose)| ContextView {
        frame: view.position,
        camera: Camera { camera_from_world: pose.inverse(), ..view.camera },
        size: view.plan.output(),
        image: image(view),
        reservation: None,
    });
    #[expect(clippy::expect_used, reason = "poses are only normalised if there is a context view")]
    let label = |frame: usize| FrameLabel::of(entry, frame).expect("an entry with a context frame");
    let targets = views.targets.iter().zip(&normalised.targets).map(|(view, pose)| TargetView {
        frame: view.position,
        camera: Camera { camera_from_world: pose.inverse(), ..view.camera },
        size: view.plan.output(),
        label: label(view.position),
    });
    let sources: Vec<Camera> = views.context.iter().chain(&views.targets).map(|view| view.source).collect();
    let hash = hash::of_trial(&scene.key, entry, &sources, recipe)
        .map_err(|error| of_normalisation(SkipReason::PoseNormalisation, &error))?;
    let context: Vec<ContextView> = context.collect();
    let trial = Trial {
        scene: scene.key.clone(),
        // Known to the iterator over the index, which sets it.
        position: 0,
        entry_number,
        entry: entry.clone(),
        near_far: near_far(recipe, normalised.near_far_multiplier, &context),
        context,
        targets: targets.collect(),
        preprocessing: recipe.preprocessing.clone(),
        normalisation: AppliedNormalisation {
            rule: recipe.pose_normalisation.clone(),
            new_from_old: normalised.new_from_old,
            near_far_multiplier: normalised.near_far_multiplier,
            fallbacks: normalised.fallbacks,
        },
        hash,
        pose_hash: hash::of_poses(entry, &sources),
        data: hash::of_data(entry, &sources),
    };
    let images = views.targets.iter().map(image).collect();
    Ok((trial, TargetImages { trial: hash, images, reservation: None }))
}

/// An image for each frame of the views.
fn lazy_images(scene: &Arc<Scene>, views: &Views<'_>, recipe: &TrialRecipe) -> BTreeMap<usize, Arc<LazyImage>> {
    let mut images = BTreeMap::new();
    for view in views.context.iter().chain(&views.targets) {
        let lazy = || LazyImage::new(Arc::clone(scene), view.position, Arc::clone(&view.plan), recipe.decode_limits);
        images.entry(view.position).or_insert_with(|| Arc::new(lazy()));
    }
    images
}

fn poses(views: &[View<'_>]) -> Vec<WorldFromCamera> {
    views.iter().map(|view| view.frame.camera.camera_from_world.inverse()).collect()
}

/// The planes in the normalised world: by disparity where the recipe says so, or else its fixed ones times `multiplier`.
fn near_far(recipe: &TrialRecipe, multiplier: f64, context: &[ContextView]) -> NearFar {
    let fixed = NearFar { near: recipe.near_far.near * multiplier, far: recipe.near_far.far * multiplier };
    recipe.disparity_planes.zip(context.first()).map_or(fixed, |(planes, first)| {
        let cameras: Vec<Camera> = context.iter().map(|view| view.camera).collect();
        planes.of(&cameras, first.size)
    })
}

fn of_normalisation(reason: SkipReason, error: &impl ToString) -> Rejection {
    Rejection { reason, detail: error.to_string(), frame: None }
}

fn normalisation_reason(error: &CameraError) -> SkipReason {
    match error {
        CameraError::BaselineOutOfRange { .. } => SkipReason::Dropped(DropReason::Baseline),
        _ => SkipReason::PoseNormalisation,
    }
}

/// A frame with the preprocessing plan of its image, and its camera after preprocessing, before normalisation.
struct View<'a> {
    position: usize,
    frame: &'a Frame,
    plan: Arc<Plan>,
    /// The data's, as the protocol sees it.
    source: Camera,
    camera: Camera,
}

impl<'a> View<'a> {
    /// `header` is that of the image, or why it is unknown.
    fn of(
        position: usize,
        frame: &'a Frame,
        header: Result<ImageHeader, String>,
        recipe: &TrialRecipe,
        plans: &mut Plans,
    ) -> Result<Self, Rejection> {
        let rejected = |reason: SkipReason, detail: String| Rejection { reason, detail, frame: Some(position) };
        if matches!(frame.image, FrameImage::Absent) && !recipe.allow_absent_images {
            let detail = format!("frame {position}: the trajectory has no images");
            return Err(rejected(SkipReason::Dropped(DropReason::ImageMissing), detail));
        }
        let header = header.map_err(|detail| rejected(SkipReason::ImageUnreadable, detail))?;
        let size = header.size;
        // Whoever made an image of the protocol's size made it for these intrinsics, as published loaders assume.
        let is_accepted = |mismatch: &ImageMismatch| {
            matches!(mismatch, ImageMismatch::Pixels { .. }) && recipe.preprocessing.expected_size == Some(size)
        };
        let is_fatal = |mismatch: &ImageMismatch| mismatch.is_fatal() && !is_accepted(mismatch);
        if let Some(mismatch) = frame.mismatch(size).filter(is_fatal).filter(|_| frame.image.is_available()) {
            let turned = header.orientation.map_or_else(String::new, |orientation| {
                format!("; the image is {orientation}, and the stored pixels are used")
            });
            let detail = format!("frame {position}: {mismatch}{turned}");
            return Err(rejected(SkipReason::ImageMisfit, detail));
        }
        let unfit = |error: PreprocessError| rejected(SkipReason::Preprocessing, format!("frame {position}: {error}"));
        let plan = plan_for(plans, &recipe.preprocessing, size).map_err(unfit)?;
        let source = recipe.lens_distortion.seen(&frame.camera);
        let camera = plan.camera(&source).map_err(unfit)?;
        Ok(Self { position, frame, plan, source, camera })
    }
}

struct Views<'a> {
    context: Vec<View<'a>>,
    targets: Vec<View<'a>>,
}

impl<'a> Views<'a> {
    fn of(
        scene: &'a Scene,
        entry: &IndexEntry,
        recipe: &TrialRecipe,
        warnings: &mut Warnings,
    ) -> Result<Self, Rejection> {
        let expected_size = recipe.preprocessing.expected_size;
        let headers = image_headers(scene, entry, recipe, warnings);
        let known_size = |frame: &Frame| {
            let (_, header) = headers.values().find(|(known, _)| std::ptr::eq(*known, frame))?;
            header.as_ref().ok().map(|header| header.size)
        };
        if let Some(dropped) = recipe.filters.drop_reason(scene, entry, expected_size, &known_size) {
            return Err(dropped.into());
        }
        let mut plans = Plans::new();
        let mut view = |position: &usize| -> Result<View<'a>, Rejection> {
            let (frame, header) = headers.get(position).ok_or_else(|| {
                let detail = format!("frame {position} of {}", scene.frames.len());
                Dropped { reason: DropReason::FrameOutOfRange, detail }
            })?;
            frame.require_pose(&scene.key, *position).map_err(|error| Rejection {
                reason: SkipReason::PoseUnusable,
                detail: error.to_string(),
                frame: Some(*position),
            })?;
            View::of(*position, frame, header.clone(), recipe, &mut plans)
        };
        let context = entry.context.iter().map(&mut view).collect::<Result<_, _>>()?;
        let targets = entry.target.iter().map(&mut view).collect::<Result<_, _>>()?;
        Ok(Self { context, targets })
    }
}

/// The frames of the entry that the scene has, with the header of their image or why it is unknown.
type ImageHeaders<'a> = BTreeMap<usize, (&'a Frame, Result<ImageHeader, String>)>;

/// Reads the headers of images; sizes of absent ones are as stated by the frame or expected by the protocol. A size beyond the limits of
/// decoding, as a damaged header may state, is an error before anyone renders an image of it. Other irregularities of a header are
/// counted as warnings.
fn image_headers<'a>(
    scene: &'a Scene,
    entry: &IndexEntry,
    recipe: &TrialRecipe,
    warnings: &mut Warnings,
) -> ImageHeaders<'a> {
    let mut headers = ImageHeaders::new();
    for position in entry.context.iter().chain(&entry.target) {
        let Some(frame) = scene.frames.get(*position) else { continue };
        headers.entry(*position).or_insert_with(|| {
            let header = match frame.image {
                FrameImage::Absent => frame
                    .stated_size
                    .or(recipe.preprocessing.expected_size)
                    .map(ImageHeader::upright)
                    .ok_or_else(|| format!("frame {position}: the size of its absent image is not stated")),
                _ => frame
                    .header_within(&scene.key, *position, &recipe.decode_limits)
                    .inspect(|header| frame.report(&scene.key, *position, header, warnings))
                    .map_err(|error| error.to_string()),
            };
            (frame, header)
        });
    }
    headers
}

/// Plans by the size of images; those of equal size share one.
type Plans = BTreeMap<ImageSize, Arc<Plan>>;

fn plan_for(plans: &mut Plans, preprocessing: &Preprocessing, size: ImageSize) -> Result<Arc<Plan>, PreprocessError> {
    if let Some(plan) = plans.get(&size) {
        return Ok(Arc::clone(plan));
    }
    let plan = Arc::new(preprocessing.plan(size)?);
    plans.insert(size, Arc::clone(&plan));
    Ok(plan)
}
