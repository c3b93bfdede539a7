use atsplat_camera::{DirectionScale, ImageSize, Projector, Ray};
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::TargetView;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::nearest_view::nearest;
use super::{Answer, Cost, Method, Question, Refusal, Rendered, Timed};
use crate::MethodRecord;

/// A floor: context pictures on one plane that faces the target camera, looked at from there.
///
/// The plane's depth stands for the scene's mean depth, which no sensor tells: of 48 depths in geometric steps
/// of 1.12, from 0.6 times the largest distance between context cameras on, it is the one at which the
/// context pictures agree best: the smallest mean absolute deviation of colours over a grid of 24² pixels of the
/// target, where at least a quarter of them is seen twice. Without parallax between context views, ten times the largest
/// distance between any two cameras of the question is taken.
///
/// A pixel is the mean over the context views that see it, weighted by the inverse squared distance of their cameras from
/// the target's, softened by a hundredth of the largest distance between context cameras. What no view sees comes from the
/// nearest view, at the same place in the picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Warp;

/// Depths that are tried.
const DEPTHS: u32 = 48;
/// Factor from one depth to the next.
const STEP: f64 = 1.12;
/// The nearest depth in multiples of the largest distance between context cameras.
const NEAREST: f64 = 0.6;
/// Pixels a side on which depths are compared.
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

    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        let failed = |error: &dyn std::fmt::Display| Refusal::Failed(format!("a context camera: {error}"));
        let mut sources = Vec::with_capacity(question.pictures.len());
        for (view, picture) in question.trial.context().iter().zip(question.pictures) {
            let projector = view.camera.projector().map_err(|error| failed(&error))?;
            let centre = view.camera.camera_from_world.inverse().centre();
            sources.push(Source { projector, centre, picture: picture.as_ref() });
        }
        Ok(Box::new(Warped { question, sources, cost: Cost::default() }))
    }
}

/// A context view.
struct Source<'a> {
    projector: Projector,
    centre: DVec3,
    picture: &'a ImageU8,
}

struct Warped<'a> {
    question: Question<'a>,
    sources: Vec<Source<'a>>,
    cost: Cost,
}

impl Answer for Warped<'_> {
    fn cost(&self) -> &Cost {
        &self.cost
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let views = self.question.trial.targets();
        let one = |position: &usize| {
            let target = views.get(*position).ok_or_else(|| format!("no target {position}"))?;
            self.picture(target).map(Rendered::plain)
        };
        targets.iter().map(one).collect()
    }
}

impl Warped<'_> {
    fn picture(&self, target: &TargetView) -> Result<Image, String> {
        let ImageSize { width, height } = target.size;
        let eye = target.camera.projector().map_err(|error| error.to_string())?;
        let place = target.camera.camera_from_world.inverse().centre();
        let depth = self.depth(&eye, place);
        let softness = 1e-2 * largest_distance(self.sources.iter().map(|source| source.centre));
        let weight = |source: &Source<'_>| {
            let squared = source.centre.distance_squared(place) + softness * softness;
            // One view alone may stand where the target does.
            if squared > 0.0 { 1.0 / squared } else { 1.0 }
        };
        let weights: Vec<f64> = self.sources.iter().map(weight).collect();
        let beside = nearest(&self.question, target).ok_or("no context view")?;
        let colour = |position: DVec2| {
            let ray = eye.ray(position, DirectionScale::UnitDepth).ok();
            let mean = ray.and_then(|ray| self.mean(&ray, depth, &weights));
            mean.unwrap_or_else(|| sample(beside, position)).to_array().map(narrowed)
        };
        let row = |row: u32| -> Vec<f32> {
            (0..width).flat_map(|column| colour(pixel_centre(column, row, target.size))).collect()
        };
        let rows: Vec<Vec<f32>> = (0..height).into_par_iter().map(row).collect();
        Image::new(width, height, rows.concat()).map_err(|error| error.to_string())
    }

    /// The weighted mean of what the context views see at a depth along a ray; `None` where none sees it.
    fn mean(&self, ray: &Ray, depth: f64, weights: &[f64]) -> Option<DVec3> {
        let (mut sum, mut total) = (DVec3::ZERO, 0.0);
        for (source, weight) in self.sources.iter().zip(weights) {
            if let Some(colour) = source.look(ray.at(depth)) {
                sum += *weight * colour;
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// The depth at which context pictures agree best.
    fn depth(&self, eye: &Projector, place: DVec3) -> f64 {
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
                let reach = largest_distance(self.sources.iter().map(|source| source.centre).chain([place]));
                if reach > 0.0 { 10.0 * reach } else { 1.0 }
            },
            |(_, depth)| depth,
        )
    }

    /// How far context pictures are from each other on a plane; `None` where too few rays are seen twice.
    fn deviation(&self, rays: &[Ray], depth: f64) -> Option<f64> {
        let (mut sum, mut seen) = (0.0, 0);
        for ray in rays {
            let colours: Vec<DVec3> = self.sources.iter().filter_map(|source| source.look(ray.at(depth))).collect();
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
    /// Colour of a point of the world; `None` where the view does not see it.
    fn look(&self, point: DVec3) -> Option<DVec3> {
        let projected = self.projector.project(point).ok()?;
        projected.is_inside().then(|| sample(self.picture, projected.position))
    }
}

/// Bilinear, in [0, 1], at a position in units of width and height; the border pixels reach beyond their centres.
fn sample(picture: &ImageU8, position: DVec2) -> DVec3 {
    let [x, right] = between(position.x, picture.width());
    let [y, down] = between(position.y, picture.height());
    let at = |column: f64, row: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::expect_used,
            reason = "kept inside the picture"
        )]
        let pixel = picture.pixel(column as u32, row as u32).expect("a place inside the picture");
        DVec3::from_array(pixel.map(|sample| f64::from(sample) / 255.0))
    };
    let (last_column, last_row) = (f64::from(picture.width()) - 1.0, f64::from(picture.height()) - 1.0);
    let (next_x, next_y) = ((x + 1.0).clamp(0.0, last_column), (y + 1.0).clamp(0.0, last_row));
    let above = at(x, y).lerp(at(next_x, y), right);
    let below = at(x, next_y).lerp(at(next_x, next_y), right);
    above.lerp(below, down)
}

/// The pixel whose centre is at or before a position, and the share of the next one.
fn between(position: f64, pixels: u32) -> [f64; 2] {
    let last = f64::from(pixels) - 1.0;
    let place = (position * f64::from(pixels) - 0.5).clamp(0.0, last);
    [place.floor(), place - place.floor()]
}

fn pixel_centre(column: u32, row: u32, size: ImageSize) -> DVec2 {
    let share = |at: u32, of: u32| (f64::from(at) + 0.5) / f64::from(of);
    DVec2::new(share(column, size.width), share(row, size.height))
}

fn largest_distance(places: impl IntoIterator<Item = DVec3>) -> f64 {
    let places: Vec<DVec3> = places.into_iter().collect();
    let pairs = places.iter().flat_map(|a| places.iter().map(|b| a.distance(*b)));
    pairs.fold(0.0, |largest, distance| if distance > largest { distance } else { largest })
}

#[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
const fn narrowed(value: f64) -> f32 {
    value as f32
}
