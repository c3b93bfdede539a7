//! Plants with thin stems and many leaves.

use glam::{DMat3, DVec2, DVec3};

use super::{glossy, matte};
use crate::material::Pattern;
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::Builder;

/// A rotation that takes +z to a unit direction.
pub(super) fn upright_to(direction: DVec3) -> DMat3 {
    DMat3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, direction))
}

/// A rod between two points of the instance's frame.
pub(super) fn rod(b: &mut Builder, from: DVec3, to: DVec3, radius: f64, material: usize) {
    let way = to - from;
    let shape = Shape::Cylinder { radius, half_height: way.length() * 0.5 };
    b.put_turned(shape, (from + to) * 0.5, upright_to(way.normalize_or(DVec3::Z)), material);
}

/// A potted plant at `at`.
pub(super) fn potted(b: &mut Builder, rng: &mut Rng, at: DVec3) {
    let size = if at.z > 0.1 { rng.within(0.12, 0.3) } else { rng.within(0.4, 0.8) };
    let [x, y] = rng.pair();
    let pot = b.material(glossy(rng, Pattern::Grain { a: x, b: y, feature: 0.1, octaves: 4 }, 0.03));
    let [a, dark] = rng.leaves();
    let leaf = b.material(matte(rng, Pattern::Stripes { a, b: dark, period: 0.03 }));
    b.put(Shape::Cylinder { radius: 0.2 * size, half_height: 0.18 * size }, at + DVec3::Z * (0.18 * size), pot);
    let root = at + DVec3::Z * (0.36 * size);
    for _ in 0..rng.count(7, 16) {
        let out = rng.direction();
        let tip = root + DVec3::new(out.x * 0.45, out.y * 0.45, 0.45 + 0.5 * out.z.abs()) * size;
        rod(b, root, tip, 0.004 + 0.004 * size, leaf);
        for _ in 0..rng.count(1, 3) {
            let turn = DMat3::from_axis_angle(rng.direction(), rng.within(0.0, 1.2));
            let half = DVec2::new(rng.within(0.1, 0.2), rng.within(0.04, 0.09)) * size;
            let place = root.lerp(tip, rng.within(0.6, 1.05));
            b.put_turned(Shape::Leaf(half), place, turn * DMat3::from_rotation_z(out.y.atan2(out.x)), leaf);
        }
    }
}

/// A tree of the given height: trunk, branches and a crown of leaves.
pub(super) fn tree(b: &mut Builder, rng: &mut Rng, height: f64) {
    let [light, dark] = rng.wood();
    let bark = b.material(matte(rng, Pattern::Grain { a: light * 0.4, b: dark * 0.25, feature: 0.06, octaves: 5 }));
    let kinds: Vec<usize> = (0..2)
        .map(|_| {
            let [a, dark] = rng.leaves();
            let leaf = matte(rng, Pattern::Grain { a, b: dark, feature: 0.05, octaves: 3 });
            b.material(leaf)
        })
        .collect();
    let fork = DVec3::new(rng.within(-0.2, 0.2), rng.within(-0.2, 0.2), height * 0.45);
    rod(b, DVec3::ZERO, fork, 0.03 * height, bark);
    for _ in 0..rng.count(6, 9) {
        let out = rng.direction();
        let tip = fork + DVec3::new(out.x * 0.32, out.y * 0.32, 0.18 + 0.3 * out.z.abs()) * height;
        rod(b, fork, tip, 0.011 * height, bark);
        for _ in 0..28 {
            let place = tip + rng.direction() * (rng.unit().sqrt() * 0.17 * height);
            let turn = DMat3::from_axis_angle(rng.direction(), rng.within(0.0, 3.0));
            let half = DVec2::new(rng.within(0.03, 0.06), rng.within(0.02, 0.04)) * height;
            let kind = rng.count(0, 1);
            b.put_turned(Shape::Leaf(half), place, turn, kinds[kind]);
        }
    }
}
