use glam::{Vec2, Vec3};

use crate::noise::{edge, faded, lattice, unit, visible};

/// Signed distance to the nearest border of intervals of half a period, positive in every other one.
fn alternating(x: f32) -> f32 {
    0.25 - (x - (x + 0.5).floor()).abs()
}

/// Two colours along `x`, one period per unit.
pub(super) fn stripes(a: Vec3, b: Vec3, x: f32, footprint: f32) -> Vec3 {
    let share = edge(alternating(x), footprint);
    b.lerp(a, 0.5 + (share - 0.5) * visible(0.5, footprint))
}

/// Squares, one period per unit.
pub(super) fn checks(a: Vec3, b: Vec3, p: Vec2, footprint: f32) -> Vec3 {
    let (x, y) = (2.0 * edge(alternating(p.x), footprint) - 1.0, 2.0 * edge(alternating(p.y), footprint) - 1.0);
    b.lerp(a, 0.5 + 0.5 * x * y * visible(0.5, footprint))
}

/// A lattice of flowers with eight petals and dots between them.
pub(super) fn motif(a: Vec3, b: Vec3, p: Vec2, footprint: f32) -> Vec3 {
    let row = p.y.floor();
    let within = Vec2::new(p.x + 0.5 * row - (p.x + 0.5 * row).floor(), p.y - row) - Vec2::splat(0.5);
    let (radius, angle) = (within.length(), within.y.atan2(within.x));
    let petals = 0.3 + 0.09 * (8.0 * angle).cos() - radius;
    let ring = 0.025 - (radius - 0.16).abs();
    let corner = 0.08 - (within.abs() - Vec2::splat(0.5)).length();
    let ink = edge(petals, footprint) * (1.0 - edge(ring, footprint)) + edge(corner, footprint);
    // The mean over a flower and its dot.
    a.lerp(b, faded(ink.clamp(0.0, 1.0), 0.265, 0.4, footprint))
}

/// Woven threads, one period per unit, each with its own shade.
#[expect(clippy::cast_possible_truncation, reason = "a surface has few threads")]
pub(super) fn weave(a: Vec3, b: Vec3, p: Vec2, footprint: f32, seed: u32) -> Vec3 {
    let cell = p.floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    let within = p - cell - Vec2::splat(0.5);
    let over = (x + y).rem_euclid(2) == 0;
    let (across, thread) = if over { (within.x, lattice(x, 0, 4, seed)) } else { (within.y, lattice(0, y, 5, seed)) };
    let round = 1.0 - 2.4 * across * across;
    let colour = if over { a } else { b } * round * (0.8 + 0.4 * unit(thread));
    (0.4 * (a + b)).lerp(colour, visible(1.0, footprint))
}
