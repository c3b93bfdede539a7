//! RE10K-like interiors: one room, or two joined by a doorway.

use atsplat_numeric::Extremes;
use glam::{DVec2, DVec3, Vec3};

use super::decor::{picture, railing, window};
use super::furniture::{Piece, shade};
use super::shell::{Opening, floor_material, wall, wall_material};
use super::{glossy, matte, sky};
use crate::lamp::Lamp;
use crate::material::{Material, Pattern};
use crate::noise::as_f32;
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::{Builder, World};

const THICK: f64 = 0.16;

/// A room on the floor plan.
#[derive(Clone, Copy, Debug)]
struct Room {
    low: DVec2,
    high: DVec2,
    height: f64,
}

/// One side of a room: the frame for [`wall`], its length, and its openings.
#[derive(Clone, Debug)]
struct Side {
    origin: DVec3,
    yaw: f64,
    length: f64,
    openings: Vec<Opening>,
    /// Whether the first opening is a doorway.
    door: bool,
}

pub(super) fn build(seed: u64) -> World {
    let rng = &mut Rng::for_part(seed, "house");
    let b = &mut Builder::new();
    let height = rng.within(2.4, 3.1);
    let first = Room { low: DVec2::ZERO, high: DVec2::new(rng.within(4.2, 7.5), rng.within(3.8, 6.5)), height };
    let mut rooms = vec![first];
    if rng.chance(0.6) {
        let low = DVec2::new(first.high.x + THICK, rng.within(-1.0, 1.0));
        let high = low + DVec2::new(rng.within(3.2, 5.5), rng.within(3.6, 5.5));
        rooms.push(Room { low, high, height });
    }
    let door = rooms.get(1).map(|second| {
        let (from, to) = (first.low.y.maximum_of(second.low.y), first.high.y.minimum_of(second.high.y));
        let wide = rng.within(0.9, 1.9).minimum_of(to - from - 1.0);
        let from = rng.within(from + 0.4, to - 0.4 - wide);
        [from, from + wide]
    });
    let shared = rng.chance(0.6).then(|| wall_material(rng));
    let one_floor = floor_material(rng);
    for (number, room) in rooms.iter().enumerate() {
        let floor = if rng.chance(0.6) { one_floor } else { floor_material(rng) };
        let walls = shared.unwrap_or_else(|| wall_material(rng));
        furnish(b, rng, room, number, door, [walls, floor]);
    }
    if rng.chance(0.35) {
        let direction = DVec3::new(rng.within(-1.0, 1.0), -rng.within(0.3, 1.0), rng.within(0.4, 0.9)).normalize();
        b.lamps.push(Lamp::Sun { direction, radius: 0.006, irradiance: Vec3::new(1.0, 0.9, 0.75) * 18.0 });
    }
    let low = rooms.iter().fold(DVec2::INFINITY, |low, room| low.min(room.low)).extend(0.0);
    let high = rooms.iter().fold(DVec2::NEG_INFINITY, |high, room| high.max(room.high)).extend(height);
    let ambient = Vec3::splat(as_f32(rng.within(0.35, 0.55)));
    let built = std::mem::replace(b, Builder::new());
    let daylight = as_f32(rng.within(3.0, 8.0));
    let mut world = built.finish(sky(rng, daylight), ambient, [low, high]);
    world.interiors = rooms.iter().map(|room| [room.low.extend(0.0), room.high.extend(height)]).collect();
    world
}

fn furnish(
    b: &mut Builder,
    rng: &mut Rng,
    room: &Room,
    number: usize,
    door: Option<[f64; 2]>,
    [walls, floor]: [Material; 2],
) {
    let Room { low, high, height } = *room;
    let floor = b.material(floor);
    b.instance(DVec3::ZERO, 0.0);
    let (corner, far) = ((low - DVec2::splat(THICK)).extend(-0.1), (high + DVec2::splat(THICK)).extend(0.0));
    b.block(corner, far, floor);
    let plaster = Vec3::splat(as_f32(rng.within(0.7, 0.85)));
    let ceiling = b.material(matte(rng, Pattern::Plain(plaster)));
    b.instance(DVec3::ZERO, 0.0);
    b.block(corner.with_z(height), far.with_z(height + 0.1), ceiling);
    if rng.chance(0.15) {
        let [light, dark] = rng.wood();
        let beam = b.material(matte(rng, Pattern::Planks { a: light, b: dark, width: 0.3, length: 6.0 }));
        for at in 1..5 {
            let x = low.x + (high.x - low.x) * f64::from(at) / 5.0;
            b.block(DVec3::new(x - 0.07, low.y, height - 0.2), DVec3::new(x + 0.07, high.y, height), beam);
        }
    }
    let mut taken: Vec<(DVec2, f64)> = Vec::new();
    for side in sides(rng, room, number, door) {
        build_side(b, rng, room, &side, walls, &mut taken);
    }
    middle(b, rng, room, &mut taken);
    ceiling_lamp(b, rng, room);
}

/// The south, east, north and west sides. The doorway is in the east of the first room and in the west of the second; the
/// rooms share the east wall of the first.
fn sides(rng: &mut Rng, room: &Room, number: usize, door: Option<[f64; 2]>) -> Vec<Side> {
    use std::f64::consts::{FRAC_PI_2, PI};
    let Room { low, high, height } = *room;
    let (wide, deep) = (high.x - low.x, high.y - low.y);
    let frames = [
        (DVec3::new(low.x, low.y - THICK, 0.0), 0.0, wide),
        (DVec3::new(high.x + THICK, low.y, 0.0), FRAC_PI_2, deep),
        (DVec3::new(high.x, high.y + THICK, 0.0), PI, wide),
        (DVec3::new(low.x - THICK, high.y, 0.0), -FRAC_PI_2, deep),
    ];
    let mut sides = Vec::new();
    for (at, (origin, yaw, length)) in frames.into_iter().enumerate() {
        let mut openings = Vec::new();
        let joined = door.filter(|_| at == if number == 0 { 1 } else { 3 });
        if let Some([from, to]) = joined {
            let along = if at == 1 { [from - low.y, to - low.y] } else { [high.y - to, high.y - from] };
            openings.push(Opening { along, height: [0.0, 2.1] });
        } else if rng.chance(0.6) {
            let (sill, top) = (rng.pick(0.85, &[0.4, 0.05, 1.1]), height - rng.within(0.25, 0.5));
            let count = rng.count(1, 2);
            for part in 0..count {
                let wide = rng.within(0.9, (length / count as f64 - 0.9).clamp(1.0, 2.6));
                let middle = length * (part as f64 + 0.5) / count as f64;
                openings.push(Opening { along: [middle - wide / 2.0, middle + wide / 2.0], height: [sill, top] });
            }
        }
        sides.push(Side { origin, yaw, length, openings, door: joined.is_some() });
    }
    sides
}

fn build_side(
    b: &mut Builder,
    rng: &mut Rng,
    room: &Room,
    side: &Side,
    walls: Material,
    taken: &mut Vec<(DVec2, f64)>,
) {
    let bold = rng.chance(0.15).then(|| wall_material(rng));
    let material = b.material(bold.unwrap_or(walls));
    b.instance(side.origin, side.yaw);
    wall(b, side.length, room.height, THICK, &side.openings, material);
    let trim = b.material(matte(rng, Pattern::Plain(Vec3::splat(0.72))));
    skirting(b, side, trim);
    for (at, opening) in side.openings.iter().enumerate() {
        b.instance(side.origin, side.yaw);
        if side.door && at == 0 {
            taken.push(door_frame(b, *opening, trim));
        } else {
            window(b, rng, *opening, THICK);
        }
    }
    furniture_along(b, rng, side, taken);
}

/// A skirting board along a side, except at openings that reach the floor.
fn skirting(b: &mut Builder, side: &Side, trim: usize) {
    b.instance(side.origin, side.yaw);
    let mut from = 0.0;
    for end in side.openings.iter().filter(|o| o.height[0] < 0.1).map(|o| o.along).chain([[side.length, side.length]]) {
        b.block(DVec3::new(from, THICK, 0.0), DVec3::new(end[0], THICK + 0.015, 0.09), trim);
        from = end[1];
    }
}

/// The frame of a doorway; returns the position and radius on the floor to keep free.
fn door_frame(b: &mut Builder, opening: Opening, trim: usize) -> (DVec2, f64) {
    let [left, right] = opening.along;
    for x in [left, right - 0.06] {
        b.block(DVec3::new(x, -0.02, 0.0), DVec3::new(x + 0.06, THICK + 0.02, 2.1), trim);
    }
    b.block(DVec3::new(left, -0.02, 2.04), DVec3::new(right, THICK + 0.02, 2.1), trim);
    (b.to_world(DVec3::new(f64::midpoint(left, right), THICK, 0.0)).truncate(), 0.9)
}

/// Furniture along a side where the floor is free, with pictures above it or in its place.
fn furniture_along(b: &mut Builder, rng: &mut Rng, side: &Side, taken: &mut Vec<(DVec2, f64)>) {
    let solid = |x: f64| side.openings.iter().all(|o| x < o.along[0] - 0.1 || x > o.along[1] + 0.1);
    let fits_picture = |x: f64| solid(x) && solid(x + 0.6) && solid(x - 0.6);
    let mut x = rng.within(0.3, 0.8);
    while x < side.length - 0.6 {
        let low_wall = side.openings.iter().any(|o| x > o.along[0] - 1.0 && x < o.along[1] + 1.0);
        let pieces = [Piece::Sofa, Piece::Bed, Piece::Desk, Piece::Radiator, Piece::Pot, Piece::Boxes];
        let tall = [Piece::Bookshelf, Piece::Kitchen, Piece::FloorLamp, Piece::Sideboard, Piece::Bookshelf];
        let piece =
            if low_wall || rng.chance(0.5) { rng.pick(Piece::Pot, &pieces) } else { rng.pick(Piece::Sideboard, &tall) };
        let [wide, deep] = piece.size();
        let middle = x + wide / 2.0;
        b.instance(side.origin, side.yaw);
        let place = b.to_world(DVec3::new(middle, THICK + deep / 2.0, 0.0)).truncate();
        let radius = 0.5 * (wide.maximum_of(deep));
        let free = taken.iter().all(|(other, far)| other.distance(place) > radius + far + 0.05);
        if free && middle + wide / 2.0 < side.length - 0.1 && rng.chance(0.85) {
            let origin = b.to_world(DVec3::new(middle, THICK + 0.03, 0.0));
            b.instance(origin, side.yaw);
            piece.build(b, rng);
            taken.push((place, radius));
            let above = matches!(piece, Piece::Sofa | Piece::Bed | Piece::Radiator | Piece::Boxes);
            if above && solid(middle) && solid(middle - 0.5) && solid(middle + 0.5) {
                b.instance(side.origin, side.yaw);
                let up = rng.within(1.5, 1.75);
                picture(b, rng, DVec3::new(middle, THICK, up));
            }
        } else if fits_picture(x) && rng.chance(0.7) {
            let place = DVec3::new(x.clamp(0.7, side.length - 0.7), THICK, rng.within(1.4, 1.7));
            // Between a corner and a window there may be no place; it is drawn all the same, for the draws that follow.
            let mut nowhere = Builder::new();
            let onto = if fits_picture(place.x) { &mut *b } else { &mut nowhere };
            onto.instance(side.origin, side.yaw);
            picture(onto, rng, place);
        }
        x += wide + rng.within(0.15, 0.9);
    }
}

/// A rug, a table, perhaps a railing as along a stair.
fn middle(b: &mut Builder, rng: &mut Rng, room: &Room, taken: &mut Vec<(DVec2, f64)>) {
    let centre = (room.low + room.high) / 2.0;
    if rng.chance(0.65) {
        let [x, y] = rng.pair();
        let rug = match rng.count(0, 2) {
            0 => Pattern::Motif { a: x, b: y, period: 0.3 },
            1 => Pattern::Stripes { a: x, b: y, period: 0.2 },
            _ => Pattern::Weave { a: x, b: y, period: 0.05 },
        };
        let rug = b.material(matte(rng, rug));
        b.instance(centre.extend(0.0), rng.within(-0.2, 0.2));
        b.put(Shape::Box(DVec3::new(rng.within(0.9, 1.5), rng.within(0.6, 1.0), 0.006)), DVec3::Z * 0.006, rug);
    }
    for _ in 0..3 {
        let place = centre + DVec2::new(rng.within(-1.2, 1.2), rng.within(-1.0, 1.0));
        if taken.iter().all(|(other, far)| other.distance(place) > far + 1.0) && rng.chance(0.6) {
            b.instance((place - DVec2::new(0.0, 0.95)).extend(0.0), 0.0);
            Piece::Table.build(b, rng);
            taken.push((place, 1.0));
            break;
        }
    }
    if rng.chance(0.2) {
        let from = DVec3::new(room.low.x + 0.5, room.low.y + 1.1, 0.0);
        let to = from + DVec3::X * rng.within(1.2, 2.2);
        b.instance(DVec3::ZERO, 0.0);
        railing(b, rng, from, to);
    }
}

fn ceiling_lamp(b: &mut Builder, rng: &mut Rng, room: &Room) {
    let middle = (room.low + room.high) / 2.0;
    b.instance(middle.extend(room.height), 0.0);
    match rng.count(0, 3) {
        0 => {
            let drop = rng.within(0.5, 0.9);
            let cord = b.material(matte(rng, Pattern::Plain(Vec3::splat(0.02))));
            super::plants::rod(b, DVec3::ZERO, DVec3::Z * -drop, 0.004, cord);
            shade(b, rng, DVec3::Z * -(drop + 0.1));
        }
        1 | 2 => {
            let (wide, deep) = (rng.within(0.2, 0.6), rng.within(0.2, 0.4));
            let glow = Vec3::new(1.0, 0.93, 0.82) * 6.0;
            let panel = Material { emission: glow, ..glossy(rng, Pattern::Plain(Vec3::splat(0.8)), 0.0) };
            let panel = b.material(panel);
            b.put(Shape::Box(DVec3::new(wide, deep, 0.02)), DVec3::Z * -0.02, panel);
            let centre = b.to_world(DVec3::Z * -0.045);
            b.lamps.push(Lamp::Panel { centre, half_u: DVec3::Y * deep, half_v: DVec3::X * wide, radiance: glow });
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No furniture fits, and a window begins 1.1 m from the corner: some pictures would have to be moved over it.
    #[test]
    fn pictures_in_a_corner_do_not_hang_over_a_window() {
        let opening = Opening { along: [1.1, 2.0], height: [0.8, 2.2] };
        let side = Side { origin: DVec3::ZERO, yaw: 0.0, length: 5.0, openings: vec![opening], door: false };
        let mut hung = 0;
        for seed in 0..300 {
            let (mut b, mut rng) = (Builder::new(), Rng::new(seed));
            furniture_along(&mut b, &mut rng, &side, &mut vec![(DVec2::ZERO, 100.0)]);
            let world = b.finish(sky(&mut rng, 1.0), Vec3::ONE, [DVec3::ZERO, DVec3::ONE]);
            for object in &world.objects {
                let Shape::Box(half) = object.shape else { continue };
                // The picture, not its frame.
                if (half.y - 0.012).abs() < 1e-9 {
                    let [left, right] = [object.centre.x - half.x, object.centre.x + half.x];
                    assert!(right < 1.1 || left > 2.0, "seed {seed}: from {left} to {right}");
                    hung += 1;
                }
            }
        }
        assert!(hung > 50, "{hung} pictures");
    }
}
