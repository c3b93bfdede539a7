//! The frame of a token's patch, for the offsets and scales of its Gaussians (`head.frame = "patch"`).

use atsplat_numeric::narrowed;
use burn::Tensor;
use burn::tensor::{Device, TensorData};

use super::Views;
use crate::config::{Grid, HeadConfig};

/// Offset of a Gaussian for an output of 1, in footprints.
const REACH: f64 = 0.5;
/// Standard deviation for an output of 0, in cells.
const CELL_SHARE: f64 = 0.6;
/// Largest logarithm of a standard deviation in footprints.
const MAX_LOG_SCALE: f64 = 0.7;

/// The frame of each token, in which its Gaussians' offsets and scales are measured.
#[derive(Clone, Debug)]
pub struct PatchFrames {
    /// World directions of the camera's right, down and forward axes, one after the other, `[scenes, tokens, 9]`.
    pub axes: Tensor<3>,
    /// Width of the patch at the depth of the anchor, in scene units, `[scenes, tokens, 1]`.
    pub footprints: Tensor<3>,
}

impl PatchFrames {
    /// The frames of the patches of all views; sides are `patch` pixels, and `depths` of the anchors are
    /// `[scenes, views · patches, 1]`.
    pub(super) fn new(scenes: &[Views], grid: Grid, patch: usize, depths: &Tensor<3>, device: &Device) -> Self {
        let (mut axes, mut widths) = (Vec::new(), Vec::new());
        for views in scenes {
            for camera in &views.cameras {
                let axes_of_camera = camera.camera_from_world.inverse().rotation().to_cols_array().map(narrowed);
                let width = narrowed(patch as f64 / (camera.intrinsics.fx * views.size().width as f64));
                axes.extend(axes_of_camera.repeat(grid.len()));
                widths.extend(vec![width; grid.len()]);
            }
        }
        let [scenes, tokens, _] = depths.dims();
        let tensor =
            |values: Vec<f32>, width| Tensor::from_data(TensorData::new(values, [scenes, tokens, width]), device);
        Self { axes: tensor(axes, 9), footprints: depths.clone() * tensor(widths, 1) }
    }

    /// Applies a map of `[scenes, tokens, …]`, such as gathering, to the frames.
    pub(super) fn map(self, map: impl Fn(Tensor<3>) -> Tensor<3>) -> Self {
        Self { axes: map(self.axes), footprints: map(self.footprints) }
    }

    /// Raw outputs of the Gaussians, `[scenes, tokens · K, 3]`, as offsets from their anchors in the world frame.
    pub(super) fn offsets(&self, head: &HeadConfig, x: Tensor<3>) -> Tensor<3> {
        let shape = x.dims();
        let [scenes, tokens, _] = self.footprints.dims();
        let x = x.reshape([scenes, tokens, head.gaussians_per_token, 3]) * REACH;
        let x = (x + layout(head, &self.footprints.device())) * self.footprints.clone().unsqueeze_dim(3);
        let along = |axis: usize| {
            let direction = self.axes.clone().slice_dim(2, 3 * axis..3 * axis + 3).unsqueeze_dim::<4>(2);
            x.clone().slice_dim(3, axis..axis + 1) * direction
        };
        (along(0) + along(1) + along(2)).reshape(shape)
    }

    /// Raw outputs, `[scenes, tokens · K, 3]`, as logarithms of standard deviations in scene units.
    pub(super) fn log_scales(&self, head: &HeadConfig, x: Tensor<3>) -> Tensor<3> {
        let shape = x.dims();
        let [scenes, tokens, _] = self.footprints.dims();
        let x = (x + (CELL_SHARE / head.cells().columns as f64).ln()).clamp_max(MAX_LOG_SCALE);
        let unit = self.footprints.clone().log().unsqueeze_dim::<4>(3);
        (x.reshape([scenes, tokens, head.gaussians_per_token, 3]) + unit).reshape(shape)
    }
}

/// Centres of the cells of a token's Gaussians relative to the centre of its patch, in footprints: right, down, forward;
/// `[1, 1, K, 3]`.
fn layout(head: &HeadConfig, device: &Device) -> Tensor<4> {
    let (cells, count) = (head.cells(), head.gaussians_per_token);
    let centre = |at: usize, count: usize| narrowed((at as f64 + 0.5) / count as f64 - 0.5);
    let place =
        |cell: usize| [centre(cell % cells.columns, cells.columns), centre(cell / cells.columns, cells.rows), 0.0];
    let values: Vec<f32> = (0..count).flat_map(place).collect();
    Tensor::from_data(TensorData::new(values, [1, 1, count, 3]), device)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::ImageSize;
    use crate::config::ModelConfig;

    const CLOSE: Tolerance = Tolerance { absolute: 1e-6, relative: 1e-6 };

    /// Two Gaussians are in one row of cells, six in two rows.
    fn head(gaussians_per_token: usize) -> HeadConfig {
        HeadConfig { gaussians_per_token, ..ModelConfig::named("micro").unwrap().head }
    }

    fn numbers(tensor: Tensor<3>) -> Vec<f64> {
        tensor.into_data_as::<f64>().as_slice::<f64>().unwrap().to_vec()
    }

    /// One view of two patches of 32×32 in an image of 32×64; the camera looks along the world's x, and its right is the
    /// world's −z. The first footprint is 3 · 32 / (0.75 · 64) = 2.
    fn frames(device: &Device) -> PatchFrames {
        frames_at(&Tensor::<1>::from_floats([3.0, 6.0], device).reshape([1, 2, 1]), device)
    }

    fn frames_at(depths: &Tensor<3>, device: &Device) -> PatchFrames {
        let rotation = DMat3::from_cols(DVec3::NEG_Z, DVec3::Y, DVec3::X);
        let pose = WorldFromCamera::new(rotation, DVec3::new(5.0, 6.0, 7.0)).unwrap();
        let camera = Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.75, 1.5, 0.5, 0.5).unwrap());
        let size = ImageSize::new(32, 64);
        let views = Views::new(size, vec![0.5; 32 * 64 * 3], vec![camera]).unwrap();
        PatchFrames::new(&[views], Grid { rows: 1, columns: 2 }, 32, depths, device)
    }

    #[test]
    fn offsets_are_cells_of_the_patch_rotated_by_its_camera() {
        let device = Device::flex();
        let raw = [0.0, 0.0, 0.0, 1.0, -2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let raw = Tensor::<1>::from_floats(raw, &device).reshape([1, 4, 3]);
        let found = numbers(frames(&device).offsets(&head(2), raw));
        // In the camera frame: (-0.25, 0, 0) and (0.25 + 0.5, -1, 1.5), times 2; the second patch has a footprint of 4.
        let expected = [0.0, 0.0, 0.5, 3.0, -2.0, -1.5, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0];
        CLOSE.assert(found, expected, "offsets");
    }

    /// A footprint is depth · 2/3 here, so that a derivative with respect to depth is 2/3 of that by the footprint.
    #[test]
    fn derivatives_reach_depths_and_outputs() {
        let device = Device::flex().autodiff();
        let head = head(2);
        let depths = Tensor::<1>::from_floats([3.0, 6.0], &device).reshape([1, 2, 1]).require_grad();
        let raw = [0.0, 9.0, -1.0, 0.5, 0.25, -0.75, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0];
        let raw = Tensor::<1>::from_floats(raw, &device).reshape([1, 4, 3]).require_grad();
        let frames = frames_at(&depths, &device);
        let weights = Tensor::<1>::from_floats([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0], &device);
        let weights = weights.reshape([1, 4, 3]);
        let gradients = (frames.offsets(&head, raw.clone()) * weights.clone()).sum().backward();
        // With respect to a footprint: weights · rotation · (cell + raw / 2); the rotated offsets are (−0.5, 4.5, 0.25),
        // (−0.375, 0.125, −0.5), (1.5, 1, −0.25) and (0, 0, −0.25).
        let offsets = [[-0.5, 4.5, 0.25], [-0.375, 0.125, -0.5], [1.5, 1.0, -0.25], [0.0, 0.0, -0.25]];
        let by_footprint =
            |at: usize| -> f64 { offsets[at].iter().enumerate().map(|(k, offset)| offset * (3 * at + k) as f64).sum() };
        let slope = 2.0 / 3.0;
        let expected = [slope * (by_footprint(0) + by_footprint(1)), slope * (by_footprint(2) + by_footprint(3))];
        CLOSE.assert(numbers(depths.grad(&gradients).unwrap()), expected, "offsets by depths");
        // With respect to an output: half a footprint along its axis; right is −z, down is y, forward is x.
        let expected = [-2.0, 1.0, 0.0, -5.0, 4.0, 3.0, -16.0, 14.0, 12.0, -22.0, 20.0, 18.0];
        CLOSE.assert(numbers(raw.grad(&gradients).unwrap()), expected, "offsets by outputs");

        let gradients = (frames_at(&depths, &device).log_scales(&head, raw.clone()) * weights).sum().backward();
        CLOSE.assert(numbers(depths.grad(&gradients).unwrap()), [15.0 / 3.0, 51.0 / 6.0], "scales by depths");
        let expected = [0.0, 0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 9.0, 10.0, 11.0];
        CLOSE.assert(numbers(raw.grad(&gradients).unwrap()), expected, "scales by outputs, two of which are clamped");
    }

    #[test]
    fn scales_are_clamped_before_conversion_to_scene_units() {
        let device = Device::flex();
        let raw = [0.0, 9.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let raw = Tensor::<1>::from_floats(raw, &device).reshape([1, 4, 3]);
        let found = numbers(frames(&device).log_scales(&head(2), raw));
        let expected = [0.6f64.ln(), 0.7 + 2.0f64.ln(), 0.6f64.ln() - 1.0];
        CLOSE.assert(found[..3].iter().copied(), expected, "log scales");
        CLOSE.assert(found[6..7].iter().copied(), [1.2f64.ln()], "the patch at twice the depth");
    }

    /// The first four of six cells: all of the upper row and one of the lower.
    #[test]
    fn the_first_gaussians_of_a_token_keep_their_places_and_sizes() {
        let device = Device::flex();
        let (whole, few) = (head(6), head(6).keeping_first(4));
        let rows: Vec<[f32; 3]> = (0..12).map(|row: u8| [0.5, -1.0, 2.0].map(|x| x * f32::from(row) / 8.0)).collect();
        let raw =
            |rows: &[[f32; 3]]| Tensor::<1>::from_floats(rows.as_flattened(), &device).reshape([1, rows.len(), 3]);
        let kept: Vec<[f32; 3]> = rows.chunks_exact(6).flat_map(|token| token[..4].to_vec()).collect();
        let frames = frames(&device);
        for [all, first] in [
            [frames.offsets(&whole, raw(&rows)), frames.offsets(&few, raw(&kept))],
            [frames.log_scales(&whole, raw(&rows)), frames.log_scales(&few, raw(&kept))],
        ] {
            let expected: Vec<f64> =
                numbers(all).chunks_exact(6 * 3).flat_map(|token| token[..4 * 3].to_vec()).collect();
            Tolerance::EXACT.assert(numbers(first), expected, "the first four of each token");
        }
    }
}
