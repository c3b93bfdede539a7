use atsplat_camera::{Camera, ImageSize};
use glam::DVec2;

/// Exact distances of the surfaces that a view's patches show, from its camera along the rays.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchDistances {
    /// Patches in a row.
    pub columns: usize,
    /// View by view, row by row: the median over a patch's pixels, infinite where that is sky.
    pub distances: Vec<f32>,
}

impl PatchDistances {
    /// Distances scaled with the world.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "distances are f32")]
        self.distances.iter_mut().for_each(|distance| *distance = (f64::from(*distance) * factor) as f32);
        self
    }

    /// Distances of the mirrored views.
    pub(super) fn mirrored(&self) -> Self {
        let rows = self.distances.chunks(self.columns.max(1));
        Self { columns: self.columns, distances: rows.flat_map(|row| row.iter().rev()).copied().collect() }
    }
}

/// Distances of one view's patches, row by row, from `depth` along the camera's z axis at the pixels' centres. The camera
/// has no lens distortion.
pub(super) fn patch_distances(camera: &Camera, size: ImageSize, depth: &[f32], patch: usize) -> Vec<f32> {
    let intrinsics = camera.intrinsics.pixel_from_normalized(size);
    let [width, height] = [size.width, size.height].map(|side| side as usize);
    let distance = |row: usize, column: usize| {
        let pixel = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        let on_plane = DVec2::new((pixel.x - intrinsics.cx) / intrinsics.fx, (pixel.y - intrinsics.cy) / intrinsics.fy);
        depth.get(row * width + column).map(|depth| f64::from(*depth) * on_plane.extend(1.0).length())
    };
    let median = |row: usize, column: usize| {
        let pixels = (0..patch).flat_map(|y| (0..patch).map(move |x| (row * patch + y, column * patch + x)));
        let mut distances: Vec<f64> = pixels.filter_map(|(row, column)| distance(row, column)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        // The lower of the two middle values: a mean of a wall and the sky would be neither.
        let middle = distances.get(distances.len().saturating_sub(1) / 2).copied();
        #[expect(clippy::cast_possible_truncation, clippy::expect_used, reason = "f32 is stored; patches have pixels")]
        let middle = middle.expect("a patch inside the image") as f32;
        middle
    };
    (0..height / patch)
        .flat_map(|row| (0..width / patch).map(move |column| (row, column)))
        .map(|(row, column)| median(row, column))
        .collect()
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};

    use super::*;

    /// A wall at z = 2 in a view of 2 × 4 pixels, a quarter of it sky; the right half of the lower row is further away.
    #[test]
    fn medians_of_patches_are_distances_along_rays() {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        // Centre on the left edge, so that the rays' slopes are 0.5, 1.5, 2.5, 3.5 in x and ∓0.5 in y.
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.25, 0.5, 0.0, 0.5).unwrap());
        let size = ImageSize { width: 4, height: 2 };
        let sky = f32::INFINITY;
        let depth = [2.0, 2.0, sky, sky, 2.0, 2.0, 8.0, sky];
        let found = patch_distances(&camera, size, &depth, 2);
        // Left: 2·√(x² + ¼ + 1) for x = ½ twice and 3⁄2 twice, of which the second; right: 8 and three times sky.
        assert_eq!(found.len(), 2);
        Tolerance::relative(1e-6).assert([f64::from(found[0])], [2.0 * 1.5f64.sqrt()], "left");
        assert!(found[1].is_infinite());
        let both = PatchDistances { columns: 2, distances: found };
        assert!(both.mirrored().distances[0].is_infinite());
        Tolerance::relative(1e-6).assert([f64::from(both.scaled(3.0).distances[0])], [6.0 * 1.5f64.sqrt()], "scaled");
    }

    /// Four patches of 2 × 2 pixels, each at another depth; rays from the upper left corner have the slopes ½, 3⁄2, 5⁄2, 7⁄2 in x
    /// and half of these in y.
    #[test]
    fn patches_are_those_of_their_rows_and_columns() {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.25, 0.5, 0.0, 0.0).unwrap());
        let depth = [[2.0, 2.0, 3.0, 3.0], [2.0, 2.0, 3.0, 3.0], [5.0, 5.0, 7.0, 7.0], [5.0, 5.0, 7.0, 7.0]];
        let found = patch_distances(&camera, ImageSize { width: 4, height: 4 }, depth.as_flattened(), 2);
        // The second shortest of each patch's rays, as (½, ¾) of the first.
        let rays = [(2.0, 0.5, 0.75), (3.0, 2.5, 0.75), (5.0, 0.5, 1.75), (7.0, 2.5, 1.75)];
        let expected = rays.map(|(depth, x, y)| depth * DVec3::new(x, y, 1.0).length());
        Tolerance::relative(1e-6).assert(found.into_iter().map(f64::from), expected, "distances");
    }
}
