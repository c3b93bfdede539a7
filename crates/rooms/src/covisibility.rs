use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::render::Rays;
use crate::{RoomsError, Simulation};

/// Shares of two images that show the same surfaces, by ray tracing.
///
/// Of the pixels of one image whose centre shows a surface, those count whose surface point is inside the other image
/// and is visible from there. No depth maps or depth tolerances are involved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covisibility {
    /// Share of the first image's surface pixels that are visible in the second, in [0, 1]; 0 if it shows only sky.
    pub first_in_second: f64,
    /// Share of the second image's surface pixels that are visible in the first.
    pub second_in_first: f64,
}

impl Covisibility {
    /// Overlap of the two images: the smaller of both shares.
    pub fn overlap(&self) -> f64 {
        if self.second_in_first < self.first_in_second { self.second_in_first } else { self.first_in_second }
    }
}

impl Simulation {
    /// True co-visibility of two frames.
    ///
    /// # Errors
    /// As [`Simulation::geometry`].
    pub fn covisibility(&self, first: usize, second: usize) -> Result<Covisibility, RoomsError> {
        Ok(Covisibility {
            first_in_second: self.visible_share(first, second)?,
            second_in_first: self.visible_share(second, first)?,
        })
    }

    fn visible_share(&self, from: usize, into: usize) -> Result<f64, RoomsError> {
        let (camera, other) = (self.camera(from)?, self.camera(into)?.projector()?);
        let (pose, eye) =
            (camera.camera_from_world.inverse(), self.shot(into)?.camera.camera_from_world.inverse().centre());
        let size = self.request().size;
        let rays = Rays::new(self.shot(from)?, camera.distortion, size)?;
        let count = |row: u32| {
            let (mut surfaces, mut seen) = (0u64, 0u64);
            for column in 0..size.width {
                let plane: DVec2 = rays.centre(column, row)?;
                let direction = pose.transform_vector(plane.extend(1.0)).normalize();
                let Some(surface) = self.world.trace(pose.centre(), direction) else { continue };
                surfaces += 1;
                // A point that the lens cannot map or that is behind the camera is not in the image.
                let inside = other.project(surface.point).is_ok_and(|projected| projected.is_inside());
                let to_eye: DVec3 = eye - surface.point;
                let faces = surface.normal.dot(to_eye) > 0.0;
                let start = surface.leave();
                seen += u64::from(inside && faces && !self.world.blocked(start, eye - start));
            }
            Ok((surfaces, seen))
        };
        let rows = (0..size.height).into_par_iter().map(count).collect::<Result<Vec<_>, RoomsError>>()?;
        let (surfaces, seen) = rows.iter().fold((0, 0), |(a, b), (surfaces, seen)| (a + surfaces, b + seen));
        Ok(if surfaces == 0 { 0.0 } else { seen as f64 / surfaces as f64 })
    }
}
