use atsplat_camera::{DirectionScale, Projector};
use atsplat_splat::Gaussians;
use glam::{DMat3, DVec2, DVec3};

use super::{Point, from_points};
use crate::random::{Purpose, stream, uniform};
use crate::{FitError, Strategy, TrainingView, camera_extent};

/// Random points seen by the training cameras, each with the colour of the pixel that it was drawn for: a random pixel of a
/// random view, at a depth within `depths` whose logarithm is uniform. `None` takes depths from a third to three times the
/// distance of the point that the cameras look at; without such a point, 1 to 30 times the cameras' extent.
///
/// # Errors
/// [`FitError::Setting`] for depths out of range, or none for a single camera; as [`from_points`].
pub fn in_frustums(
    views: &[TrainingView],
    count: usize,
    depths: Option<[f64; 2]>,
    seed: u64,
    strategy: Strategy,
) -> Result<Gaussians, FitError> {
    let cameras = views.iter().map(|view| view.view.camera.projector()).collect::<Result<Vec<_>, _>>()?;
    let [near, far] = match depths.or_else(|| depths_of(views)) {
        Some([near, far]) if near > 0.0 && far >= near && far.is_finite() => [near, far],
        found => {
            let none = match views {
                [one] => format!("none: {} is the only view", one.name),
                several => format!("none: {} cameras in one place", several.len()),
            };
            let found = found.map_or(none, |[near, far]| format!("{near} to {far}"));
            let expected = "positive depths, the nearer first, which cameras in several places suggest".to_owned();
            return Err(FitError::Setting { name: "depths", expected, found });
        }
    };
    let mut random = stream(seed, Purpose::Start, 0);
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let [view, row, column, depth] = std::array::from_fn(|_| uniform(&mut random));
        let depth = near * (far / near).powf(depth);
        points.extend(point(views, &cameras, view, DVec2::new(column, row), depth));
    }
    from_points(&points, strategy)
}

/// The point at a depth behind a position in a view; none outside the lens's field of view.
fn point(views: &[TrainingView], cameras: &[Projector], view: f64, position: DVec2, depth: f64) -> Option<Point> {
    let number = floor(view * views.len() as f64);
    let (view, camera) = (views.get(number)?, cameras.get(number)?);
    let ray = camera.ray(position, DirectionScale::UnitDepth).ok()?;
    let size = view.view.size;
    let (column, row) = (floor(position.x * f64::from(size.width)), floor(position.y * f64::from(size.height)));
    let colour = view.rgb.get(row * size.width as usize + column)?.map(f64::from);
    Some(Point { position: ray.at(depth).to_array(), colour })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive number below a count")]
const fn floor(value: f64) -> usize {
    value as usize
}

/// Depths around the point that is nearest to all optical axes, if the cameras look at one.
fn depths_of(views: &[TrainingView]) -> Option<[f64; 2]> {
    let axes: Vec<(DVec3, DVec3)> = views
        .iter()
        .map(|view| {
            let pose = view.view.camera.camera_from_world.inverse();
            (pose.centre(), pose.transform_vector(DVec3::Z))
        })
        .collect();
    let extent = camera_extent(views.iter().map(|view| &view.view));
    let mut normal = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for (centre, axis) in &axes {
        let across = DMat3::IDENTITY - DMat3::from_cols(*axis * axis.x, *axis * axis.y, *axis * axis.z);
        normal += across;
        right += across * *centre;
    }
    // The smallest eigenvalue of a sum of n projections is near n times the squared angle between the axes.
    let conditioned = normal.determinant() > 1e-3 * (axes.len() as f64).powi(3);
    let focus = conditioned.then(|| normal.inverse() * right);
    let distances =
        focus.map(|focus| axes.iter().map(|(centre, axis)| (focus - *centre).dot(*axis)).collect::<Vec<_>>());
    match distances.filter(|distances| distances.iter().all(|distance| *distance > 0.0)) {
        Some(distances) => atsplat_numeric::median(distances).map(|distance| [distance / 3.0, 3.0 * distance]),
        None => (extent > 0.0).then_some([extent, 30.0 * extent]),
    }
}
