//! Procedural worlds from seeds.

mod decor;
mod furniture;
mod hall;
mod house;
mod plants;
mod shell;
mod yard;

use crate::SceneKind;
use glam::Vec3;

use crate::material::{Material, Pattern};
use crate::noise;
use crate::rng::Rng;
use crate::sky::Sky;
use crate::world::World;

/// The world of a seed.
pub(crate) fn world(kind: SceneKind, seed: u64) -> World {
    match kind {
        SceneKind::Rooms => house::build(seed),
        SceneKind::Yards if Rng::for_part(seed, "yard or hall").chance(0.6) => yard::build(seed),
        SceneKind::Yards => hall::build(seed),
    }
}

/// A diffuse surface with this pattern.
fn matte(rng: &mut Rng, pattern: Pattern) -> Material {
    Material::matte(pattern, rng.seed())
}

/// A surface that reflects this share of light specularly.
fn glossy(rng: &mut Rng, pattern: Pattern, mirror: f32) -> Material {
    Material { mirror, ..Material::matte(pattern, rng.seed()) }
}

/// A sky with this brightness at the zenith.
fn sky(rng: &mut Rng, brightness: f32) -> Sky {
    let [trees, _] = rng.leaves();
    let [ground, _] = rng.stone();
    let haze = 0.6 + 0.4 * noise::unit(rng.seed());
    Sky {
        zenith: Vec3::new(0.25, 0.45, 0.95) * brightness * haze,
        horizon: Vec3::new(0.85, 0.92, 1.0) * brightness * haze,
        ground: ground * (0.35 * brightness),
        trees: trees * (0.6 * brightness),
        clouds: noise::unit(rng.seed()),
        seed: rng.seed(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Shape;

    #[test]
    fn worlds_are_valid() {
        for seed in 0..24 {
            for kind in SceneKind::ALL {
                let world = world(kind, crate::rng::mix(seed));
                assert!(world.objects.len() > 30, "{kind:?} {seed}: {} objects", world.objects.len());
                for object in &world.objects {
                    assert!(object.centre.is_finite() && object.material < world.materials.len());
                    let sizes = match object.shape {
                        Shape::Box(half) => half,
                        Shape::Sphere(radius) => glam::DVec3::splat(radius),
                        Shape::Cylinder { radius, half_height } => glam::DVec3::new(radius, radius, half_height),
                        Shape::Leaf(half) => half.extend(1.0),
                    };
                    assert!(sizes.cmpgt(glam::DVec3::ZERO).all(), "{kind:?} {seed}: {object:?}");
                }
            }
        }
    }
}
