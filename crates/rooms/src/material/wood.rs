use atsplat_numeric::Extremes;
use glam::{Vec2, Vec3};

use super::Spot;
use crate::noise::{edge, fractal_noise, lattice, unit, visible};

/// Boards along v, each of its own shade and grain, with dark joints.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few boards")]
pub(super) fn planks([a, b]: [Vec3; 2], width: f32, length: f32, spot: &Spot, seed: u32) -> Vec3 {
    let uv = spot.uv;
    let board = (uv.x / width).floor();
    let stagger = unit(lattice(board as i32, 0, 1, seed));
    let along = uv.y / length + stagger;
    let piece = along.floor();
    let shade = unit(lattice(board as i32, piece as i32, 2, seed));
    let apart = Vec2::new(uv.x / width - board, along - piece);
    let to_joint =
        (apart.x.abs().minimum_of(1.0 - apart.x) * width).minimum_of(apart.y.minimum_of(1.0 - apart.y) * length);

    let fine = Vec3::new(uv.x * 90.0, uv.y * 3.0, shade * 37.0);
    let grain = fractal_noise(fine, 3, spot.footprint * 45.0, seed);
    let broad = fractal_noise(fine * 0.17, 2, spot.footprint * 8.0, seed ^ 5);
    let wood = a.lerp(b, (0.25 + 0.5 * shade + 0.6 * grain + 0.3 * broad).clamp(0.0, 1.0));
    let calm = wood.lerp(a.lerp(b, 0.5), 1.0 - visible(width, spot.footprint));
    let joint = (1.0 - edge(to_joint - 0.0015, spot.footprint)) * visible(0.012, spot.footprint);
    calm * (1.0 - 0.6 * joint)
}
