use atsplat_numeric::Extremes;
use glam::{Vec2, Vec3};

use super::TexturePoint;
use crate::noise::{edge, fractal_noise, lattice, unit, visible};

/// Tiles of slightly different colours in grout.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few tiles")]
pub(super) fn tiles(
    [a, b, grout]: [Vec3; 3],
    size: Vec2,
    gap: f32,
    shift: f32,
    spot: &TexturePoint,
    seed: u32,
) -> Vec3 {
    let row = (spot.uv.y / size.y).floor();
    let along = spot.uv.x / size.x + shift * row;
    let column = along.floor();
    let shade = unit(lattice(column as i32, row as i32, 3, seed));
    let within = Vec2::new(along - column, spot.uv.y / size.y - row);
    let inner = Vec2::new(within.x.minimum_of(1.0 - within.x), within.y.minimum_of(1.0 - within.y)) * size;
    let to_gap = inner.x.minimum_of(inner.y) - 0.5 * gap;

    let grit = fractal_noise(spot.local * 55.0, 3, spot.footprint * 55.0, seed);
    let tile = a.lerp(b, (shade + 0.5 * grit).clamp(0.0, 1.0));
    let seen = visible(size.x.minimum_of(size.y), spot.footprint);
    let covered = 1.0 - gap / size.x.minimum_of(size.y);
    let sharp = grout.lerp(tile, edge(to_gap, spot.footprint));
    grout.lerp(a.lerp(b, 0.5), covered).lerp(sharp, seen)
}

/// Boards along v, each with its own shade and grain, with dark joints.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few boards")]
pub(super) fn planks([a, b]: [Vec3; 2], width: f32, length: f32, spot: &TexturePoint, seed: u32) -> Vec3 {
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
