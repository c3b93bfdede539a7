use atsplat_numeric::Extremes as _;
use bytemuck::{Pod, Zeroable};
use glam::DVec2;

use super::forward::TILE;
use crate::constants::{ClampedGradient, Extent, LARGEST_CHANNEL, ShAxes};
use crate::cpu::to_f32;
use crate::view::Optics;
use crate::{Exposure, RasterMode, RenderOptions, View};

/// `struct View` of `shaders/view.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ViewBlock {
    rotation: [[f32; 4]; 3],
    rotation_low: [[f32; 4]; 3],
    centre: [f32; 4],
    centre_low: [f32; 4],
    focal: [f32; 4],
    principal: [f32; 4],
    slopes: [f32; 4],
    depths: [f32; 4],
    rules: [f32; 4],
    alphas: [f32; 4],
    background: [f32; 4],
    exposure: [[f32; 4]; 3],
    lens: [f32; 4],
    lens_more: [f32; 4],
    image: [u32; 4],
    pub(super) part: [u32; 4],
    pub(super) tiles: [u32; 4],
    pub(super) window: [u32; 4],
    batch: [u32; 4],
}

/// Views of a batch at most, which wgpu's default uniform buffers of 64 KiB hold.
pub(super) const MAX_VIEWS: u32 = 160;

/// Views of a batch, all of whose blocks a uniform buffer of this many bytes holds.
pub(super) fn most_views(bytes: u64) -> u32 {
    let fitting = bytes / size_of::<ViewBlock>() as u64;
    u32::try_from(fitting).unwrap_or(u32::MAX).min(MAX_VIEWS)
}

macro_rules! flags {
    ($($name:ident: $bit:literal),+ $(,)?) => {
        /// Flags of a view, which kernels know by these names.
        pub(super) mod flag {
            $(pub(crate) const $name: u32 = 1 << $bit;)+
        }

        /// Names and values of the flags.
        pub(super) const FLAGS: &[(&str, u32)] = &[$((stringify!($name), flag::$name)),+];
    };
}

flags! {
    NEAR_IS_CULLED: 0,
    ANTIALIASED: 1,
    THREE_SIGMA: 2,
    E3NN: 3,
    HAS_FILTER: 4,
    HAS_SCALAR: 5,
    LENS_OPENCV: 6,
    LENS_FISHEYE: 7,
    CLAMP_PASSES: 8,
    SCALAR_STOPS: 9,
    DIRECTIONS_STOP: 10,
    EXTRAS: 11,
    HAS_OWNERS: 12,
    EXTRA_GRADIENTS: 13,
    APPLY_EXPOSURE: 14,
    EXPOSED_LOSS: 15,
    RESUMES: 16,
    ABSOLUTE: 17,
}

impl ViewBlock {
    pub(super) fn new(view: &View, optics: &Optics, options: &RenderOptions) -> Self {
        let constants = &options.constants;
        let rows = optics.rotation.transpose();
        let rotation = [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.to_array().map(split));
        let centre = optics.centre.to_array().map(split);
        let high = |row: [[f32; 2]; 3]| [row[0][0], row[1][0], row[2][0], 0.0];
        let low = |row: [[f32; 2]; 3]| [row[0][1], row[1][1], row[2][1], 0.0];
        let two = |value: DVec2| {
            let [x, y] = value.to_array().map(split);
            [x[0], y[0], x[1], y[1]]
        };
        let [least, greatest] = optics.jacobian_range.map(|slope| slope.to_array().map(bounded));
        let (lens, lens_more, lens_flag) = lens(view, optics);
        let [red, green, blue] = options.background.map(to_f32);
        let flags = [
            (constants.near_is_culled, flag::NEAR_IS_CULLED),
            (options.mode == RasterMode::Antialiased, flag::ANTIALIASED),
            (constants.extent == Extent::ThreeSigmaTiles, flag::THREE_SIGMA),
            (constants.sh_axes == ShAxes::E3nn, flag::E3NN),
            (constants.clamped_gradient == ClampedGradient::Inria, flag::CLAMP_PASSES),
            (options.gradients.scalar_stops, flag::SCALAR_STOPS),
            (options.gradients.directions_stop, flag::DIRECTIONS_STOP),
        ];
        let flags = flags.into_iter().filter(|(on, _)| *on).fold(lens_flag, |all, (_, one)| all | one);
        Self {
            rotation: rotation.map(high),
            rotation_low: rotation.map(low),
            centre: high(centre),
            centre_low: low(centre),
            focal: two(optics.focal),
            principal: two(optics.principal),
            slopes: [least[0], least[1], greatest[0], greatest[1]],
            depths: two(DVec2::new(constants.near, constants.far.minimum_of(LARGEST_CHANNEL))),
            rules: [
                bounded(constants.blur),
                bounded(constants.min_alpha.ln()),
                bounded(constants.min_alpha),
                bounded(constants.min_compensation),
            ],
            alphas: [constants.max_alpha, constants.min_alpha, constants.min_transmittance, 0.0].map(bounded),
            background: [red, green, blue, 0.0],
            exposure: exposure(options.exposure.unwrap_or(Exposure::IDENTITY)),
            lens,
            lens_more,
            image: [view.size.width, view.size.height, flags, 0],
            part: [0; 4],
            tiles: [0; 4],
            window: [0; 4],
            // No index reaches a second image.
            batch: [u32::MAX, u32::MAX, 1, 1],
        }
    }

    /// As a view in a batch of `images` with `splats` each.
    pub(super) const fn in_batch(mut self, splats: u32, views_of_scene: u32, images: u32) -> Self {
        let [width, height, ..] = self.image;
        self.batch = [splats, width.div_ceil(TILE) * height.div_ceil(TILE), images, views_of_scene];
        self
    }

    pub(super) const fn with_flag(mut self, flag: u32, on: bool) -> Self {
        if on {
            self.image[2] |= flag;
        }
        self
    }

    pub(super) const fn flags(&self) -> u32 {
        self.image[2]
    }

    pub(super) fn bytes(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }
}

fn lens(view: &View, optics: &Optics) -> ([f32; 4], [f32; 4], u32) {
    let limit = optics.lens.map_or(0.0, |lens| lens.angle_limit());
    match view.camera.distortion {
        atsplat_camera::Distortion::None => ([0.0; 4], [0.0; 4], 0),
        atsplat_camera::Distortion::OpenCv { k1, k2, k3, p1, p2 } => {
            ([k1, k2, k3, 0.0].map(bounded), [p2, p1, limit.tan(), 0.0].map(bounded), flag::LENS_OPENCV)
        }
        atsplat_camera::Distortion::Fisheye { k } => {
            (k.map(bounded), [0.0, 0.0, bounded(limit), 0.0], flag::LENS_FISHEYE)
        }
    }
}

/// Rows of the matrix, followed by the offset.
fn exposure(exposure: Exposure) -> [[f32; 4]; 3] {
    let [rows, offset] = [exposure.matrix, [exposure.offset; 3]];
    std::array::from_fn(|at| {
        let [red, green, blue] = rows[at].map(bounded);
        [red, green, blue, bounded(offset[at][at])]
    })
}

/// Splits into the nearest f32 and the remainder.
fn split(value: f64) -> [f32; 2] {
    let high = bounded(value);
    [high, bounded(value - f64::from(high))]
}

/// The nearest f32 of at most 3e38 in magnitude, to leave headroom.
fn bounded(value: f64) -> f32 {
    to_f32(value.clamp(-3e38, 3e38))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_of_a_batch_fit_the_uniform_buffer() {
        let found = [400, 799, 16 << 10, 63_999, 64 << 10, u64::MAX].map(most_views);
        assert_eq!(found, [1, 1, 40, 159, 160, 160]);
    }
}
