//! Walls with openings, floors and ceilings.

use glam::{DVec3, Vec2, Vec3};

use super::{glossy, matte};
use crate::material::{Material, Pattern};
use crate::rng::Rng;
use crate::world::Builder;

/// An opening in a wall: its extent along the wall and in height, in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub along: [f64; 2],
    pub height: [f64; 2],
}

/// A wall along x of the current instance's frame from 0 to `length`, from y = 0 to y = `thick`, with ordered openings that
/// do not overlap.
pub(super) fn wall(builder: &mut Builder, length: f64, height: f64, thick: f64, openings: &[Opening], material: usize) {
    let mut solid = |x: [f64; 2], z: [f64; 2]| {
        if x[1] - x[0] > 1e-6 && z[1] - z[0] > 1e-6 {
            builder.block(DVec3::new(x[0], 0.0, z[0]), DVec3::new(x[1], thick, z[1]), material);
        }
    };
    let mut done = 0.0;
    for opening in openings {
        solid([done, opening.along[0]], [0.0, height]);
        solid(opening.along, [0.0, opening.height[0]]);
        solid(opening.along, [opening.height[1], height]);
        done = opening.along[1];
    }
    solid([done, length], [0.0, height]);
}

/// Paint, plaster, wallpaper, brick or panelling.
pub(super) fn wall_material(rng: &mut Rng) -> Material {
    let paint = rng.paint();
    let [a, b] = rng.pair();
    let [stone, dark] = rng.stone();
    let pattern = match rng.count(0, 9) {
        0..=3 => Pattern::Plain(paint),
        4..=5 => Pattern::Grain { a: paint, b: paint * 0.82, feature: 0.25, octaves: 7 },
        6 => Pattern::Motif { a: paint, b: paint.lerp(a, 0.6), period: 0.35 },
        7 => Pattern::Stripes { a: paint, b: paint.lerp(b, 0.4), period: 0.24 },
        8 => Pattern::Tiles {
            a: stone,
            b: dark,
            grout: Vec3::splat(0.55),
            size: Vec2::new(0.22, 0.075),
            gap: 0.012,
            shift: 0.5,
        },
        _ => Pattern::Planks { a: paint, b: paint * 0.8, width: 0.14, length: 3.0 },
    };
    matte(rng, pattern)
}

/// Boards, tiles, carpet or stone.
pub(super) fn floor_material(rng: &mut Rng) -> Material {
    let [light, dark] = rng.wood();
    let [stone, shade] = rng.stone();
    let [a, b] = rng.pair();
    match rng.count(0, 5) {
        0..=1 => glossy(rng, Pattern::Planks { a: light, b: dark, width: 0.14, length: 1.4 }, 0.03),
        2 => {
            let tiles = Pattern::Tiles {
                a: stone,
                b: shade,
                grout: shade * 0.5,
                size: Vec2::splat(0.45),
                gap: 0.008,
                shift: 0.0,
            };
            glossy(rng, tiles, 0.035)
        }
        3 => matte(rng, Pattern::Grain { a: a * 0.8, b: b * 0.5, feature: 0.02, octaves: 3 }),
        4 => glossy(rng, Pattern::Checks { a: stone, b: shade * 0.3, period: 0.8 }, 0.03),
        _ => matte(rng, Pattern::Grain { a: stone, b: shade * 0.7, feature: 0.15, octaves: 6 }),
    }
}
