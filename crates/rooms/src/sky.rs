use glam::{DVec3, Vec3};

use crate::noise::{fractal_noise, lattice, unit};

/// Radiance of rays that hit nothing: a gradient with clouds above, hills and treetops on the horizon, ground below.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sky {
    pub zenith: Vec3,
    pub horizon: Vec3,
    pub ground: Vec3,
    pub trees: Vec3,
    /// Share of the sky that clouds cover, in [0, 1].
    pub clouds: f32,
    pub seed: u32,
}

impl Sky {
    /// Radiance from a unit direction; `footprint` is a pixel's width in radians.
    #[expect(clippy::cast_possible_truncation, reason = "one of a few hundred treetops")]
    pub(crate) fn radiance(&self, direction: DVec3, footprint: f32) -> Vec3 {
        let d = direction.as_vec3();
        let around = d.y.atan2(d.x);
        let ridge = |height: f32, rough: f32, seed: u32| {
            let at = Vec3::new(around.cos(), around.sin(), 0.0) * rough;
            height + 0.6 * height * fractal_noise(at, 6, footprint * rough, seed)
        };
        if d.z < 0.0 {
            return self.ground;
        }
        if d.z < ridge(0.05, 14.0, self.seed) {
            return self.trees * (0.5 + 0.8 * unit(lattice((around * 60.0).floor() as i32, 0, 0, self.seed)));
        }
        if d.z < ridge(0.1, 3.0, self.seed ^ 0x4d) {
            return self.trees.lerp(self.horizon, 0.5);
        }
        let clear = self.horizon.lerp(self.zenith, d.z.sqrt());
        let layer = fractal_noise(d / (d.z + 0.15) * 1.3, 6, footprint * 4.0, self.seed ^ 9);
        let cover = ((layer + self.clouds - 0.4) * 2.5).clamp(0.0, 1.0);
        clear.lerp(Vec3::splat(self.horizon.max_element() * 1.1), cover)
    }
}
