use atsplat_camera::{DirectionScale, ImageSize, Projector, Ray};
use atsplat_numeric::narrowed;
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::TargetView;
use atsplat_results::MethodRecord;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::nearest_view::nearest;
use super::{Method, MethodError, Prediction, Rendered, Timed, TrialInput, render_each};

/// A lower baseline: a plane sweep with a single plane that faces the target camera.
///
/// The plane's depth is an estimate of the scene's mean depth. Of 48 depths in geometric steps of 1.12, starting at 0.6
/// times the largest distance between context cameras, it is the one at which the context images agree best: smallest
/// mean absolute deviation of colours over a grid of 24² pixels of the target, of which at least a quarter must be seen by
/// two views. Without parallax between context views the depth is ten times the largest distance between any two cameras
/// of the trial.
///
/// A pixel is the mean over the context views that see it, weighted by the inverse squared distance of their cameras from
/// the target's, softened by a hundredth of the largest distance between context cameras. Pixels that no view sees are
/// copied from the same position in the nearest view.
#[derive(Clone, Copy, Debug, Default)]
pub struct Warp;

/// Number of candidate depths.
const DEPTHS: u32 = 48;
/// Factor from one depth to the next.
const STEP: f64 = 1.12;
/// The nearest depth in multiples of the largest distance between context cameras.
const NEAREST: f64 = 0.6;
/// Side of the pixel grid on which candidate depths are compared.
const GRID: u32 = 24;

impl Method for Warp {
    fn record(&self) -> MethodRecord {
        MethodRecord {
            name: "warp".to_owned(),
            kind: "warp".to_owned(),
            title: "plane warp".to_owned(),
            deterministic: true,
            ..MethodRecord::default()
        }
    }

    fn timed(&self) -> Timed {
        Timed::RENDERING
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let failed = |error: &dyn std::fmt::Display| MethodError::Failed(format!("a context camera: {error}"));
        let mut sources = Vec::with_capacity(input.images.len());
        for (view, image) in input.trial.context().iter().zip(input.images) {
            let projector = view.camera.projector().map_err(|error| failed(&error))?;
            let centre = view.camera.camera_from_world.inverse().centre();
            sources.push(Source { projector, centre, image: image.as_ref() });
        }
        Ok(Box::new(Warped { input, sources }))
    }
}

/// A context view.
struct Source<'a> {
    projector: Projector,
    centre: DVec3,
    image: &'a ImageU8,
}

struct Warped<'a> {
    input: TrialInput<'a>,
    sources: Vec<Source<'a>>,
}

impl Prediction for Warped<'_> {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        render_each(self.input.trial, targets, |target| self.image(target))
    }
}

impl Warped<'_> {
    fn image(&self, target: &TargetView) -> Result<Image, String> {
        let ImageSize { width, height } = target.size;
        let eye = target.camera.projector().map_err(|error| error.to_string())?;
        let centre = target.camera.camera_from_world.inverse().centre();
        let depth = self.depth(&eye, centre);
        let softness = 1e-2 * largest_distance(self.sources.iter().map(|source| source.centre));
        let weight = |source: &Source<'_>| {
            let squared = source.centre.distance_squared(centre) + softness * softness;
            // A single view has no softness, and its camera may coincide with the target's.
            if squared > 0.0 { 1.0 / squared } else { 1.0 }
        };
        let weights: Vec<f64> = self.sources.iter().map(weight).collect();
        let fallback = nearest(&self.input, target).ok_or("no context view")?;
        let colour = |position: DVec2| {
            let ray = eye.ray(position, DirectionScale::UnitDepth).ok();
            let mean = ray.and_then(|ray| self.mean(&ray, depth, &weights));
            mean.unwrap_or_else(|| sample(fallback, position)).to_array().map(narrowed)
        };
        let row = |row: u32| -> Vec<f32> {
            (0..width).flat_map(|column| colour(pixel_centre(column, row, target.size))).collect()
        };
        let rows: Vec<Vec<f32>> = (0..height).into_par_iter().map(row).collect();
        Image::new(width, height, rows.concat()).map_err(|error| error.to_string())
    }

    /// Weighted mean colour of the context views at a depth along a ray; `None` if no view sees the point.
    fn mean(&self, ray: &Ray, depth: f64, weights: &[f64]) -> Option<DVec3> {
        let (mut sum, mut total) = (DVec3::ZERO, 0.0);
        for (source, weight) in self.sources.iter().zip(weights) {
            if let Some(colour) = source.colour_at(ray.at(depth)) {
                sum += *weight * colour;
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// The depth at which context images agree best.
    fn depth(&self, eye: &Projector, centre: DVec3) -> f64 {
        let grid = ImageSize { width: GRID, height: GRID };
        let positions = (0..GRID).flat_map(|row| (0..GRID).map(move |column| pixel_centre(column, row, grid)));
        let rays: Vec<Ray> =
            positions.filter_map(|position| eye.ray(position, DirectionScale::UnitDepth).ok()).collect();
        let baseline = largest_distance(self.sources.iter().map(|source| source.centre));
        let mut best = None;
        let mut depth = NEAREST * baseline;
        for _ in 0..DEPTHS {
            if let Some(deviation) = self.deviation(&rays, depth).filter(|_| baseline > 0.0)
                && best.is_none_or(|(least, _)| deviation < least)
            {
                best = Some((deviation, depth));
            }
            depth *= STEP;
        }
        best.map_or_else(
            || {
                let largest = largest_distance(self.sources.iter().map(|source| source.centre).chain([centre]));
                if largest > 0.0 { 10.0 * largest } else { 1.0 }
            },
            |(_, depth)| depth,
        )
    }

    /// Mean absolute deviation of the context images on a plane; `None` if too few rays are seen by two views.
    fn deviation(&self, rays: &[Ray], depth: f64) -> Option<f64> {
        let (mut sum, mut seen) = (0.0, 0);
        for ray in rays {
            let colours: Vec<DVec3> =
                self.sources.iter().filter_map(|source| source.colour_at(ray.at(depth))).collect();
            if colours.len() > 1 {
                let mean = colours.iter().sum::<DVec3>() / colours.len() as f64;
                let apart = colours.iter().map(|colour| (*colour - mean).abs().element_sum()).sum::<f64>();
                sum += apart / colours.len() as f64;
                seen += 1;
            }
        }
        (seen * 4 >= rays.len() && seen > 0).then(|| sum / seen as f64)
    }
}

impl Source<'_> {
    /// Colour of a world point; `None` if it projects outside the image.
    fn colour_at(&self, point: DVec3) -> Option<DVec3> {
        let projected = self.projector.project(point).ok()?;
        projected.is_inside().then(|| sample(self.image, projected.position))
    }
}

/// Bilinear sample in [0, 1] at a position in units of width and height; borders are clamped.
fn sample(image: &ImageU8, position: DVec2) -> DVec3 {
    let [x, right] = between(position.x, image.width());
    let [y, down] = between(position.y, image.height());
    let at = |column: f64, row: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::expect_used,
            reason = "coordinates are clamped to the image"
        )]
        let pixel = image.pixel(column as u32, row as u32).expect("clamped coordinates");
        DVec3::from_array(pixel.map(|sample| f64::from(sample) / 255.0))
    };
    let (last_column, last_row) = (f64::from(image.width()) - 1.0, f64::from(image.height()) - 1.0);
    let (next_x, next_y) = ((x + 1.0).clamp(0.0, last_column), (y + 1.0).clamp(0.0, last_row));
    let above = at(x, y).lerp(at(next_x, y), right);
    let below = at(x, next_y).lerp(at(next_x, next_y), right);
    above.lerp(below, down)
}

/// The pixel whose centre is at or before a position, and the weight of the next one.
fn between(position: f64, pixels: u32) -> [f64; 2] {
    let last = f64::from(pixels) - 1.0;
    let position = (position * f64::from(pixels) - 0.5).clamp(0.0, last);
    [position.floor(), position - position.floor()]
}

fn pixel_centre(column: u32, row: u32, size: ImageSize) -> DVec2 {
    let share = |at: u32, of: u32| (f64::from(at) + 0.5) / f64::from(of);
    DVec2::new(share(column, size.width), share(row, size.height))
}

fn largest_distance(positions: impl IntoIterator<Item = DVec3>) -> f64 {
    let positions: Vec<DVec3> = positions.into_iter().collect();
    let pairs = positions.iter().flat_map(|a| positions.iter().map(|b| a.distance(*b)));
    pairs.fold(0.0, |largest, distance| if distance > largest { distance } else { largest })
}
