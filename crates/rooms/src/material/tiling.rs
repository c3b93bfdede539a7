use atsplat_numeric::Extremes;
use glam::{Vec2, Vec3};

use super::TexturePoint;
use crate::noise::{edge, faded, fractal_noise, lattice, unit};

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
    let grit = fractal_noise(spot.local * 55.0, 3, spot.footprint * 55.0, seed);
    let shade = faded((shade + 0.5 * grit).clamp(0.0, 1.0), 0.5, size.x.minimum_of(size.y), spot.footprint);
    a.lerp(b, shade).lerp(grout, joints(within, size, gap, spot.footprint))
}

/// Share of a pixel that is joint, `gap` wide, between tiles of this size; `within` is the position in the tile, in [0, 1)².
fn joints(within: Vec2, size: Vec2, gap: f32, footprint: f32) -> f32 {
    // A line spread over a footprint is weaker as it is wider, so that its mean stays.
    let clear = |within: f32, size: f32| {
        let distance = within.minimum_of(1.0 - within) * size;
        1.0 - edge(distance + 0.5 * gap, footprint) + edge(distance - 0.5 * gap, footprint)
    };
    let sharp = 1.0 - clear(within.x, size.x) * clear(within.y, size.y);
    let mean = 1.0 - (1.0 - gap / size.x) * (1.0 - gap / size.y);
    faded(sharp, mean, size.x.minimum_of(size.y), footprint)
}

/// Features of grain per metre across a board, and how much fewer broad ones there are.
const FINE: f32 = 90.0;
const BROAD: f32 = 0.17;

/// Boards along v, each with its own shade and grain, with dark joints.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few boards")]
pub(super) fn planks([a, b]: [Vec3; 2], width: f32, length: f32, spot: &TexturePoint, seed: u32) -> Vec3 {
    let uv = spot.uv;
    let board = (uv.x / width).floor();
    let stagger = unit(lattice(board as i32, 0, 1, seed));
    let along = uv.y / length + stagger;
    let piece = along.floor();
    let shade = unit(lattice(board as i32, piece as i32, 2, seed));
    let within = Vec2::new(uv.x / width - board, along - piece);

    let fine = Vec3::new(uv.x * FINE, uv.y * 3.0, shade * 37.0);
    let grain = fractal_noise(fine, 3, spot.footprint * FINE, seed);
    let broad = fractal_noise(fine * BROAD, 2, spot.footprint * FINE * BROAD, seed ^ 5);
    let shade = (0.25 + 0.5 * shade + 0.6 * grain + 0.3 * broad).clamp(0.0, 1.0);
    let wood = a.lerp(b, faded(shade, 0.5, width, spot.footprint));
    wood * (1.0 - 0.6 * joints(within, Vec2::new(width, length), 0.003, spot.footprint))
}
