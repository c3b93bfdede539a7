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
    #[cfg(test)]
    pub(crate) const BLACK: Self =
        Self { zenith: Vec3::ZERO, horizon: Vec3::ZERO, ground: Vec3::ZERO, trees: Vec3::ZERO, clouds: 0.0, seed: 0 };

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

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::DVec2;

    use super::*;
    use crate::rng::sphere_point;

    fn sky(clouds: f32) -> Sky {
        let (zenith, horizon) = (Vec3::Z, Vec3::Y);
        Sky { zenith, horizon, ground: Vec3::new(0.3, 0.2, 0.1), trees: Vec3::ZERO, clouds, seed: 1 }
    }

    /// Above the hills, clouds alone have red, 1.1 of it.
    #[test]
    fn clouds_cover_their_share_of_a_gradient() {
        for (clouds, expected) in [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)] {
            let cover = (0..2000u32).map(|n| {
                let place = DVec2::new(0.4 * (f64::from(n) + 0.5) / 2000.0, (f64::from(n) * 0.618_034).fract());
                let direction = sphere_point(place);
                let found = sky(clouds).radiance(direction, 0.004);
                if found.x <= 0.0 {
                    let high = direction.z.sqrt();
                    let clear = found.to_array().map(f64::from);
                    Tolerance::absolute(1e-6).assert(clear, [0.0, 1.0 - high, high], "clear sky");
                }
                f64::from(found.x) / 1.1
            });
            Tolerance::absolute(0.1).assert([cover.sum::<f64>() / 2000.0], [expected], &format!("{clouds}"));
        }
        assert_eq!(sky(0.5).radiance(DVec3::NEG_Z, 0.004), Vec3::new(0.3, 0.2, 0.1), "the ground");
    }
}
