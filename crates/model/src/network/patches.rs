//! Patches of views, as the network's branches read them.

use std::ops::Range;

use burn::Tensor;
use burn::tensor::{Device, TensorData};

use super::Views;
use super::views::RGB;
use crate::{ImageSize, ModelError};

const PLUCKER: usize = 6;

impl Views {
    /// Colours of every patch as `(rgb − mean) / deviation`, channel by channel within a patch, as in a convolution's kernel:
    /// `[views, patches, 3 · patch²]`.
    pub(super) fn standardised(
        &self,
        patch: usize,
        mean: [f32; RGB],
        deviation: [f32; RGB],
        device: &Device,
    ) -> Tensor<3> {
        let mut values = Vec::with_capacity(self.images.len());
        for rows in self.patches(patch) {
            for (channel, (mean, deviation)) in mean.into_iter().zip(deviation).enumerate() {
                for row in rows.clone() {
                    let of_channel = self.images[RGB * row.start..RGB * row.end].iter().skip(channel).step_by(RGB);
                    values.extend(of_channel.map(|value| (value - mean) / deviation));
                }
            }
        }
        self.tensor(values, patch * patch * RGB, device)
    }

    /// The pixels of each row of each patch: patches view by view and row by row.
    fn patches(&self, patch: usize) -> impl Iterator<Item = impl Iterator<Item = Range<usize>> + Clone> {
        let ImageSize { height, width } = self.size();
        let (rows, columns) = (height / patch, width / patch);
        assert_eq!([rows * patch, columns * patch], [height, width], "patches that divide the images");
        // Patches of all views are in rows below each other, as the views are.
        (0..self.len() * rows * columns).map(move |at| {
            let first = at / columns * patch * width + at % columns * patch;
            (0..patch).map(move |row| first + row * width..first + row * width + patch)
        })
    }

    /// Values of all patches as `[views, patches, width]`.
    fn tensor(&self, values: Vec<f32>, width: usize, device: &Device) -> Tensor<3> {
        let patches = values.len() / (self.len() * width).max(1);
        Tensor::from_data(TensorData::new(values, [self.len(), patches, width]), device)
    }
}

/// Views as a branch of the network sees them: what it reads of every pixel, patch by patch.
#[derive(Debug)]
pub(super) struct BranchInput<'a> {
    pub(super) views: &'a Views,
    /// Moment and direction of the ray of every pixel, in the order of the images.
    plucker: Vec<f32>,
}

impl<'a> BranchInput<'a> {
    /// Views of the size of the branch.
    pub(super) fn new(views: &'a Views) -> Result<Self, ModelError> {
        Ok(Self { views, plucker: views.plucker_maps()? })
    }

    /// [`Self::new`] of several scenes.
    pub(super) fn of_scenes(scenes: &'a [Views]) -> Result<Vec<Self>, ModelError> {
        scenes.iter().map(Self::new).collect()
    }

    /// Colours of every patch as `2 rgb − 1`: `[views, patches, patch² · 3]`, a patch row by row.
    pub(super) fn colours(&self, patch: usize, device: &Device) -> Tensor<3> {
        self.patches(patch, RGB, device, |values, row| values.extend(self.row_colours(row)))
    }

    /// Moment and direction of the ray of every pixel of every patch: `[views, patches, patch² · 6]`.
    pub(super) fn plucker(&self, patch: usize, device: &Device) -> Tensor<3> {
        let rays = |row: Range<usize>| &self.plucker[PLUCKER * row.start..PLUCKER * row.end];
        self.patches(patch, PLUCKER, device, |values, row| values.extend_from_slice(rays(row)))
    }

    /// Colours as `2 rgb − 1`, then moment and direction, of every pixel of every patch: `[views, patches, patch² · 9]`.
    pub(super) fn colours_and_plucker(&self, patch: usize, device: &Device) -> Tensor<3> {
        self.patches(patch, RGB + PLUCKER, device, |values, row| {
            for pixel in row {
                values.extend(self.row_colours(pixel..pixel + 1));
                values.extend_from_slice(&self.plucker[PLUCKER * pixel..PLUCKER * (pixel + 1)]);
            }
        })
    }

    fn row_colours(&self, row: Range<usize>) -> impl Iterator<Item = f32> {
        self.views.images[RGB * row.start..RGB * row.end].iter().map(|value| 2.0 * value - 1.0)
    }

    /// `[views, patches, patch² · channels]` of what `append` adds for each row of a patch.
    fn patches(
        &self,
        patch: usize,
        channels: usize,
        device: &Device,
        append: impl Fn(&mut Vec<f32>, Range<usize>),
    ) -> Tensor<3> {
        let mut values = Vec::with_capacity(self.views.images.len() / RGB * channels);
        for row in self.views.patches(patch).flatten() {
            append(&mut values, row);
        }
        self.views.tensor(values, patch * patch * channels, device)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
    use glam::{DMat3, DVec3};

    use super::super::f32_values;
    use super::*;

    const SIZE: ImageSize = ImageSize::new(4, 6);
    const PATCH: usize = 2;

    /// Two views, of which every number is another.
    fn views() -> Views {
        let camera = |turn: f64| {
            let pose = WorldFromCamera::new(DMat3::from_rotation_y(turn), DVec3::new(turn, 2.0, -1.0)).unwrap();
            Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.7, 0.9, 0.5, 0.4).unwrap())
        };
        let images = (0u16..2 * 4 * 6 * 3).map(|at| f32::from(at) / 144.0).collect();
        Views::new(SIZE, images, vec![camera(0.1), camera(-0.3)]).unwrap()
    }

    /// View, row and column of the pixels of all patches, in order.
    fn pixels() -> impl Iterator<Item = [usize; 3]> {
        let patches = (0..2).flat_map(|view| (0..2).flat_map(move |row| (0..3).map(move |column| [view, row, column])));
        patches.flat_map(|[view, row, column]| {
            (0..PATCH * PATCH).map(move |at| [view, PATCH * row + at / PATCH, PATCH * column + at % PATCH])
        })
    }

    #[test]
    fn patches_have_the_colours_and_rays_of_their_pixels() {
        let (views, device) = (views(), Device::flex());
        let input = BranchInput::new(&views).unwrap();
        let size = atsplat_camera::ImageSize { width: 6, height: 4 };
        let maps: Vec<Vec<f32>> = views.cameras.iter().map(|camera| camera.plucker_map(size).unwrap()).collect();
        let rgb = |[view, row, column]: [usize; 3]| {
            let first = ((view * SIZE.height + row) * SIZE.width + column) * 3;
            [0, 1, 2].map(|channel| 2.0 * views.images[first + channel] - 1.0)
        };
        let ray = |[view, row, column]: [usize; 3]| maps[view][(row * SIZE.width + column) * 6..][..6].to_vec();
        let both = |pixel| [rgb(pixel).to_vec(), ray(pixel)].concat();
        for (found, channels, expected) in [
            (input.colours(PATCH, &device), 3, pixels().flat_map(rgb).collect::<Vec<f32>>()),
            (input.plucker(PATCH, &device), 6, pixels().flat_map(ray).collect()),
            (input.colours_and_plucker(PATCH, &device), 9, pixels().flat_map(both).collect()),
        ] {
            assert_eq!(found.dims(), [2, 6, PATCH * PATCH * channels]);
            assert_eq!(f32_values(found), expected, "{channels} channels");
        }
    }

    #[test]
    fn standardised_patches_are_channel_by_channel() {
        let views = views();
        let found = views.standardised(PATCH, [0.5, 0.25, 0.0], [1.0, 2.0, 4.0], &Device::flex());
        assert_eq!(found.dims(), [2, 6, 12]);
        let pixels: Vec<[usize; 3]> = pixels().collect();
        let value = |[view, row, column]: [usize; 3], channel: usize| {
            views.images[((view * SIZE.height + row) * SIZE.width + column) * 3 + channel]
        };
        let expected = pixels.chunks_exact(PATCH * PATCH).flat_map(|patch| {
            let of_channel = |channel: usize, mean: f32, deviation: f32| {
                patch.iter().map(|&pixel| (value(pixel, channel) - mean) / deviation).collect::<Vec<f32>>()
            };
            [of_channel(0, 0.5, 1.0), of_channel(1, 0.25, 2.0), of_channel(2, 0.0, 4.0)].concat()
        });
        assert_eq!(f32_values(found), expected.collect::<Vec<f32>>());
    }
}
