use atsplat_numeric::Extremes;
use glam::{Vec2, Vec3};

use super::Spot;
use crate::noise::{edge, fractal_noise, lattice, unit, visible};

/// Tiles of slightly different colours in grout.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few tiles")]
pub(super) fn tiles([a, b, grout]: [Vec3; 3], size: Vec2, gap: f32, shift: f32, spot: &Spot, seed: u32) -> Vec3 {
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
