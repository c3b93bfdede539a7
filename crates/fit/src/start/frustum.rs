use atsplat_camera::{CentreSpread, DirectionScale, Projector, WorldFromCamera};
use atsplat_splat::Gaussians;
use glam::{DMat3, DVec2, DVec3};

use super::{Point, from_points};
use crate::random::{Purpose, stream};
use crate::{FitError, Strategy, TrainingView, camera_extent};

/// Most draws of a pixel for each point, on average.
const MAX_DRAWS: usize = 100;

/// Random points seen by the training cameras, each with the colour of the pixel that it was drawn for: a random pixel of a
/// random view, at a depth within `depths` whose logarithm is uniform. `None` takes depths from a third to three times the
/// distance of the point that the cameras look at; without such a point, 1 to 30 times the cameras' extent. A pixel outside
/// the lens's field of view, which has no ray, is drawn again. `near_plane` is the depth of the renderer's near plane.
///
/// # Errors
/// [`FitError::Setting`] for depths out of range, or none for cameras in one place, or so near to one that the default depths do not
/// reach the near plane; [`FitError::Start`] if nearly all pixels are outside the field of view; as [`from_points`].
pub fn in_frustums(
    views: &[TrainingView],
    count: usize,
    depths: Option<[f64; 2]>,
    near_plane: f64,
    seed: u64,
    strategy: Strategy,
) -> Result<Gaussians, FitError> {
    let cameras = views.iter().map(|view| view.view.camera.projector()).collect::<Result<Vec<_>, _>>()?;
    let [near, far] = match depths {
        Some(depths) => depths,
        None => default_depths(views, near_plane).map_err(out_of_range)?,
    };
    let is_range = near > 0.0 && far >= near && far.is_finite();
    if !is_range {
        return Err(out_of_range(format!("{near} to {far}")));
    }
    let mut random = stream(seed, Purpose::Start, 0);
    let mut points = Vec::with_capacity(count);
    for _ in 0..count.saturating_mul(MAX_DRAWS) {
        if points.len() == count {
            break;
        }
        let [view, row, column, depth] = std::array::from_fn(|_| random.unit());
        let depth = near * (far / near).powf(depth);
        points.extend(point(views, &cameras, view, DVec2::new(column, row), depth));
    }
    if points.len() < count {
        let found = format!("{} of {count} in {MAX_DRAWS} draws for each", points.len());
        return Err(FitError::Start { expected: "random pixels within the lens's field of view", found });
    }
    from_points(&points, strategy)
}

fn out_of_range(found: String) -> FitError {
    let expected = "positive depths, the nearer first (the default needs cameras in several places)".to_owned();
    FitError::Setting { name: "depths", expected, found }
}

/// [`depths_of`] the views, or what is found instead.
fn default_depths(views: &[TrainingView], near_plane: f64) -> Result<[f64; 2], String> {
    match (depths_of(views), views) {
        (Some([near, far]), _) if far <= near_plane => Err(format!(
            "{near} to {far} for cameras this close together, before the near plane at a depth of {near_plane}"
        )),
        (Some(depths), _) => Ok(depths),
        (None, [one]) => Err(format!("none: {} is the only view", one.name)),
        (None, several) => Err(format!("none: {} cameras in one place", several.len())),
    }
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

/// Depths around the point that is nearest to all optical axes, if the cameras look at one; `None` for cameras in one place, as far as
/// f32 tells, in which Gaussians are stored.
fn depths_of(views: &[TrainingView]) -> Option<[f64; 2]> {
    let poses: Vec<WorldFromCamera> = views.iter().map(|view| view.view.camera.camera_from_world.inverse()).collect();
    if CentreSpread::of(&poses) != CentreSpread::Apart {
        return None;
    }
    let axes: Vec<(DVec3, DVec3)> = poses.iter().map(|pose| (pose.centre(), pose.transform_vector(DVec3::Z))).collect();
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

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, Distortion, ImageSize, NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use atsplat_splat::View;
    use glam::DQuat;

    use super::*;

    fn looking_along(axis: DVec3, centre: DVec3) -> TrainingView {
        let rotation = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, axis));
        let pose = WorldFromCamera::new(rotation, centre).unwrap().inverse();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
        let view = View { camera, size: ImageSize { width: 1, height: 1 } };
        TrainingView { name: String::new(), view, rgb: vec![[0.5; 3]] }
    }

    /// Views whose axes meet in one point, at these distances from it.
    fn meeting(distances: [f64; 3]) -> Vec<TrainingView> {
        let point = DVec3::new(1.0, -2.0, 3.0);
        let axes = [DVec3::new(-2.0, 3.0, 6.0), DVec3::new(6.0, 2.0, -3.0), DVec3::new(1.0, 2.0, 2.0)];
        let view =
            |(axis, distance): (DVec3, f64)| looking_along(axis.normalize(), point - distance * axis.normalize());
        axes.into_iter().zip(distances).map(view).collect()
    }

    #[test]
    fn depths_are_around_the_point_that_the_cameras_look_at() {
        let depths = depths_of(&meeting([9.0, 3.0, 4.5])).unwrap();
        Tolerance::F64.assert(depths, [1.5, 13.5], "a third and three times the median distance");
    }

    #[test]
    fn without_a_common_point_depths_are_multiples_of_the_extent() {
        let at_x = |x: f64| looking_along(DVec3::Z, DVec3::new(x, 0.0, 0.0));
        let depths = depths_of(&[at_x(5.0), at_x(7.0)]).unwrap();
        Tolerance::F64.assert(depths, [1.1, 33.0], "parallel");
        let away = meeting([9.0, 3.0, -4.5]);
        let extent = camera_extent(away.iter().map(|view| &view.view));
        Tolerance::F64.assert(depths_of(&away).unwrap(), [extent, 30.0 * extent], "behind one of them");
        assert_eq!(depths_of(&[at_x(5.0)]), None, "one camera");
    }

    /// Centres of cameras that only turn differ by rounding, and those a little apart have depths that no renderer draws.
    #[test]
    fn cameras_in_one_place_need_depths() {
        let centre = DVec3::new(1.3, -2.7, 3.1);
        let axes = [DVec3::new(-2.0, 3.0, 6.0), DVec3::new(-1.0, 2.0, 2.0), DVec3::new(2.0, 3.0, 6.0)];
        let start = |step: f64, depths: Option<[f64; 2]>| {
            let view = |(at, axis): (u32, DVec3)| {
                looking_along(axis.normalize(), centre + DVec3::new(f64::from(at) * step, 0.0, 0.0))
            };
            let views: Vec<TrainingView> = (0..).zip(axes).map(view).collect();
            let made = in_frustums(&views, 9, depths, 0.01, 3, Strategy::Gaussians3d);
            made.map(|_| ()).map_err(|error| error.to_string())
        };
        for step in [0.0, 1e-15, 1e-7] {
            let error = start(step, None).unwrap_err();
            assert!(error.ends_with("found none: 3 cameras in one place"), "{step}: {error}");
            assert_eq!(start(step, Some([1.0, 4.0])), Ok(()));
        }
        let error = start(1e-5, None).unwrap_err();
        assert!(error.ends_with("before the near plane at a depth of 0.01"), "{error}");
        assert_eq!(start(1.0, None), Ok(()));
        assert_eq!(start(1e-5, Some([1e-5, 1e-4])), Ok(()), "others may see what is nearer than the plane");
    }

    /// With this lens, corners of the image are outside the field of view.
    #[test]
    fn pixels_outside_the_field_of_view_are_drawn_again() {
        let lens = |k1| Distortion::OpenCv { k1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        let drawn = |distortion: Distortion, count: usize| {
            let mut views = meeting([9.0, 3.0, 4.5]);
            for view in &mut views {
                view.view.camera.distortion = distortion;
            }
            in_frustums(&views, count, Some([1.0, 4.0]), 0.01, 3, Strategy::Gaussians3d).map(Gaussians::into_parts)
        };
        let half = lens(-0.9);
        let [few, many, whole] =
            [(half, 40), (half, 80), (Distortion::None, 80)].map(|(lens, count)| drawn(lens, count).unwrap().means);
        assert_eq!((few.len(), many.len()), (40, 80));
        assert_eq!(few, many[..40], "in the order of the draws");
        assert_ne!(many, whole);
        let found = drawn(lens(-1e6), 40).unwrap_err().to_string();
        let expected = "random pixels within the lens's field of view, found 0 of 40 in 100 draws for each";
        assert!(found.ends_with(expected), "{found}");
    }
}
