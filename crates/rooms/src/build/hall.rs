//! Halls: high rooms with columns, galleries, long rows of windows and a few objects on the floor.

use glam::{DVec3, Vec2, Vec3};

use super::decor::{picture, railing};
use super::furniture::Piece;
use super::shell::{Opening, floor_material, wall, wall_material};
use super::{matte, sky};
use crate::lamp::Lamp;
use crate::material::{Material, Pattern};
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::{Builder, World};

pub(super) fn build(seed: u64) -> World {
    let rng = &mut Rng::for_part(seed, "hall");
    let mut b = Builder::new();
    let (long, wide, height) = (rng.within(14.0, 26.0), rng.within(8.0, 13.0), rng.within(4.5, 7.5));
    let floor = b.material(floor_material(rng));
    b.instance(DVec3::ZERO, 0.0);
    b.block(DVec3::new(-0.3, -0.3, -0.2), DVec3::new(long + 0.3, wide + 0.3, 0.0), floor);
    let [light, dark] = rng.wood();
    let ceiling = if rng.chance(0.5) {
        Pattern::Planks { a: light, b: dark, width: 0.3, length: 4.0 }
    } else {
        Pattern::Grain { a: Vec3::splat(0.7), b: Vec3::splat(0.6), feature: 0.5, octaves: 6 }
    };
    let ceiling = b.material(matte(rng, ceiling));
    b.instance(DVec3::ZERO, 0.0);
    b.block(DVec3::new(-0.3, -0.3, height), DVec3::new(long + 0.3, wide + 0.3, height + 0.2), ceiling);
    let bays = bays(long);
    for bay in 0..=bays {
        let x = long * f64::from(bay) / f64::from(bays);
        b.block(DVec3::new(x - 0.1, 0.0, height - 0.35), DVec3::new(x + 0.1, wide, height), ceiling);
    }
    walls(&mut b, rng, [long, wide, height], bays);
    columns(&mut b, rng, [long, wide, height], bays);
    for _ in 0..rng.count(9, 16) {
        let (x, y) = (rng.within(0.1, 0.9) * long, rng.within(0.15, 0.85) * wide);
        b.instance(DVec3::new(x, y, 0.0), rng.within(0.0, 6.0));
        let pieces = [Piece::Pot, Piece::Boxes, Piece::Sofa, Piece::Bookshelf, Piece::Desk];
        rng.pick(Piece::Table, &pieces).build(&mut b, rng);
    }
    if rng.chance(0.6) {
        b.instance(DVec3::ZERO, 0.0);
        let x = rng.within(0.2, 0.5) * long;
        let end = x + rng.within(2.0, 5.0);
        railing(&mut b, rng, DVec3::new(x, wide * 0.3, 0.0), DVec3::new(end, wide * 0.3, 0.0));
    }
    for bay in 0..bays {
        let glow = Vec3::new(1.0, 0.9, 0.75) * 9.0;
        let panel = Material { emission: glow, ..matte(rng, Pattern::Plain(Vec3::splat(0.7))) };
        if bay % 2 == 1 {
            let panel = b.material(panel);
            b.instance(DVec3::new(long * (f64::from(bay) + 0.5) / f64::from(bays), wide / 2.0, height - 0.4), 0.0);
            b.put(Shape::Box(DVec3::new(0.2, 1.2, 0.03)), DVec3::ZERO, panel);
            let centre = b.to_world(DVec3::Z * -0.04);
            b.lamps.push(Lamp::Panel { centre, half_u: DVec3::Y * 1.2, half_v: DVec3::X * 0.2, radiance: glow });
        }
    }
    let space = [DVec3::ZERO, DVec3::new(long, wide, height)];
    b.finish(sky(rng, 8.0), Vec3::splat(0.4), space)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a hall has few bays")]
fn bays(long: f64) -> u32 {
    (long / 3.2).clamp(3.0, 9.0) as u32
}

/// Long walls with a window in each bay.
fn walls(b: &mut Builder, rng: &mut Rng, [long, wide, height]: [f64; 3], bays: u32) {
    use std::f64::consts::{FRAC_PI_2, PI};
    let material = wall_material(rng);
    let sill = rng.within(0.8, 2.2);
    let frames = [
        (DVec3::new(0.0, -0.3, 0.0), 0.0, long, true),
        (DVec3::new(long + 0.3, 0.0, 0.0), FRAC_PI_2, wide, false),
        (DVec3::new(long, wide + 0.3, 0.0), PI, long, rng.chance(0.5)),
        (DVec3::new(-0.3, wide, 0.0), -FRAC_PI_2, wide, false),
    ];
    for (origin, yaw, length, windows) in frames {
        let plaster = b.material(material);
        b.instance(origin, yaw);
        let pitch = length / f64::from(bays);
        let window = |bay: u32| {
            let middle = pitch * (f64::from(bay) + 0.5);
            Opening { along: [middle - 0.3 * pitch, middle + 0.3 * pitch], height: [sill, height - 0.8] }
        };
        let openings: Vec<Opening> = if windows { (0..bays).map(window).collect() } else { Vec::new() };
        wall(b, length, height, 0.3, &openings, plaster);
        let bars = b.material(matte(rng, Pattern::Plain(Vec3::splat(0.08))));
        for opening in &openings {
            let ([left, right], [low, high]) = (opening.along, opening.height);
            b.instance(origin, yaw);
            for bar in 1..4 {
                let share = f64::from(bar) / 4.0;
                let (x, z) = (left + (right - left) * share, low + (high - low) * share);
                b.block(DVec3::new(x - 0.015, 0.13, low), DVec3::new(x + 0.015, 0.17, high), bars);
                b.block(DVec3::new(left, 0.13, z - 0.015), DVec3::new(right, 0.17, z + 0.015), bars);
            }
        }
        if !windows {
            for _ in 0..rng.count(1, 4) {
                b.instance(origin, yaw);
                let place = DVec3::new(rng.within(1.0, length - 1.0), 0.3, rng.within(1.4, 2.2));
                picture(b, rng, place);
            }
        }
    }
}

fn columns(b: &mut Builder, rng: &mut Rng, [long, wide, height]: [f64; 3], bays: u32) {
    let [stone, dark] = rng.stone();
    let pattern = match rng.count(0, 2) {
        0 => Pattern::Marble { a: stone, b: dark * 0.6, feature: 0.5 },
        1 => Pattern::Tiles { a: stone, b: dark, grout: dark * 0.5, size: Vec2::new(0.5, 0.35), gap: 0.01, shift: 0.5 },
        _ => Pattern::Grain { a: stone, b: dark, feature: 0.2, octaves: 7 },
    };
    let shaft = b.material(matte(rng, pattern));
    let radius = rng.within(0.15, 0.3);
    for bay in 1..bays {
        let x = long * f64::from(bay) / f64::from(bays);
        for y in [wide * 0.2, wide * 0.8] {
            b.instance(DVec3::new(x, y, 0.0), 0.0);
            b.put(Shape::Cylinder { radius, half_height: height / 2.0 }, DVec3::Z * (height / 2.0), shaft);
            for z in [0.1, height - 0.45] {
                b.put(Shape::Box(DVec3::new(radius * 1.35, radius * 1.35, 0.1)), DVec3::Z * z, shaft);
            }
        }
    }
}
