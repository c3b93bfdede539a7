//! Furniture about the origin of an instance's frame, on z = 0, with its back at y = 0 and its front to +y.

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::{glossy, matte, plants};
use crate::lamp::Lamp;
use crate::material::{Material, Pattern};
use crate::noise::as_f32;
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::Builder;

/// A piece of furniture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Piece {
    Bookshelf,
    Sideboard,
    Sofa,
    Bed,
    Desk,
    Kitchen,
    Radiator,
    Pot,
    FloorLamp,
    Table,
    Boxes,
}

impl Piece {
    /// Width along x and depth along y, in metres.
    pub(super) const fn size(self) -> [f64; 2] {
        match self {
            Self::Bookshelf => [1.2, 0.35],
            Self::Sideboard => [1.8, 0.45],
            Self::Sofa => [2.1, 0.95],
            Self::Bed => [1.7, 2.1],
            Self::Desk => [1.5, 1.2],
            Self::Kitchen => [2.4, 0.62],
            Self::Radiator => [1.0, 0.14],
            Self::Pot => [0.6, 0.6],
            Self::FloorLamp => [0.45, 0.45],
            Self::Table => [1.9, 1.9],
            Self::Boxes => [0.9, 0.6],
        }
    }

    pub(super) fn build(self, b: &mut Builder, rng: &mut Rng) {
        match self {
            Self::Bookshelf => bookshelf(b, rng),
            Self::Sideboard => sideboard(b, rng),
            Self::Sofa => sofa(b, rng),
            Self::Bed => bed(b, rng),
            Self::Desk => desk(b, rng),
            Self::Kitchen => kitchen(b, rng),
            Self::Radiator => radiator(b, rng),
            Self::Pot => plants::potted(b, rng, DVec3::new(0.0, 0.3, 0.0)),
            Self::FloorLamp => floor_lamp(b, rng),
            Self::Table => table(b, rng),
            Self::Boxes => boxes(b, rng),
        }
    }
}

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn wooden(b: &mut Builder, rng: &mut Rng) -> usize {
    let [light, dark] = rng.wood();
    let painted = rng.chance(0.3);
    let paint = rng.paint();
    let pattern =
        if painted { Pattern::Plain(paint) } else { Pattern::Planks { a: light, b: dark, width: 0.25, length: 4.0 } };
    let material = glossy(rng, pattern, 0.03);
    b.material(material)
}

fn cloth(b: &mut Builder, rng: &mut Rng) -> usize {
    let [x, y] = rng.pair();
    let pattern = match rng.count(0, 4) {
        0 => Pattern::Plain(x),
        1 => Pattern::Weave { a: x, b: y, period: 0.012 },
        2 => Pattern::Stripes { a: x, b: y, period: 0.09 },
        3 => Pattern::Motif { a: x, b: y, period: 0.16 },
        _ => Pattern::Grain { a: x, b: x * 0.6, feature: 0.05, octaves: 5 },
    };
    let material = matte(rng, pattern);
    b.material(material)
}

fn metal(b: &mut Builder, rng: &mut Rng) -> usize {
    let grey = Vec3::splat(if rng.chance(0.5) { 0.05 } else { 0.45 });
    let material = glossy(rng, Pattern::Plain(grey), 0.2);
    b.material(material)
}

fn legs(b: &mut Builder, half: [f64; 2], centre: DVec3, height: f64, radius: f64, material: usize) {
    for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let shape = Shape::Cylinder { radius, half_height: height * 0.5 };
        b.put(shape, centre + v(sx * half[0], sy * half[1], height * 0.5), material);
    }
}

fn bookshelf(b: &mut Builder, rng: &mut Rng) {
    let frame = wooden(b, rng);
    let (shelves, pitch) = (rng.count(4, 6), 0.34);
    let height = shelves as f64 * pitch;
    for x in [-0.6, 0.58] {
        b.block(v(x, 0.0, 0.0), v(x + 0.02, 0.3, height), frame);
    }
    b.block(v(-0.58, 0.0, 0.0), v(0.58, 0.02, height), frame);
    for shelf in 0..=shelves {
        let z = shelf as f64 * pitch;
        b.block(v(-0.58, 0.02, z), v(0.58, 0.3, z + 0.02), frame);
        if shelf < shelves && rng.chance(0.8) {
            let spines = b.material(matte(rng, Pattern::Books { height: 0.28 }));
            let (left, right) = (rng.within(-0.58, -0.3), rng.within(0.1, 0.57));
            b.block(v(left, 0.03, z + 0.02), v(right, rng.within(0.2, 0.27), z + 0.3), spines);
        } else if shelf < shelves {
            let [x, _] = rng.pair();
            let glazed = b.material(glossy(rng, Pattern::Plain(x), 0.06));
            let radius = rng.within(0.06, 0.12);
            b.put(Shape::Sphere(radius), v(rng.within(-0.4, 0.4), 0.16, z + 0.02 + radius), glazed);
        }
    }
}

fn sideboard(b: &mut Builder, rng: &mut Rng) {
    let (body, knobs) = (wooden(b, rng), metal(b, rng));
    let height = rng.within(0.45, 0.9);
    b.block(v(-0.9, 0.0, 0.1), v(0.9, 0.42, height), body);
    legs(b, [0.8, 0.15], v(0.0, 0.21, 0.0), 0.1, 0.02, knobs);
    for door in 0..4 {
        let x = -0.9 + 0.45 * f64::from(door);
        b.block(v(x + 0.01, 0.42, 0.12), v(x + 0.44, 0.435, height - 0.02), body);
        b.put(Shape::Sphere(0.018), v(x + 0.38, 0.45, height * 0.6), knobs);
    }
    if rng.chance(0.5) {
        let screen = b.material(glossy(rng, Pattern::Plain(Vec3::splat(0.012)), 0.06));
        b.block(v(-0.6, 0.15, height + 0.06), v(0.6, 0.19, height + 0.76), screen);
        b.block(v(-0.15, 0.1, height), v(0.15, 0.25, height + 0.06), screen);
    } else {
        plants::potted(b, rng, v(-0.5, 0.22, height));
        let [x, _] = rng.pair();
        let vase = b.material(glossy(rng, Pattern::Plain(x), 0.05));
        b.put(Shape::Cylinder { radius: 0.07, half_height: 0.15 }, v(0.4, 0.2, height + 0.15), vase);
    }
}

fn sofa(b: &mut Builder, rng: &mut Rng) {
    let (fabric, cushion, feet) = (cloth(b, rng), cloth(b, rng), metal(b, rng));
    b.block(v(-0.87, 0.05, 0.12), v(0.87, 0.9, 0.42), fabric);
    b.block(v(-0.87, 0.05, 0.42), v(0.87, 0.25, 0.85), fabric);
    for x in [-1.05, 0.87] {
        b.block(v(x, 0.05, 0.12), v(x + 0.18, 0.9, 0.62), fabric);
    }
    legs(b, [0.9, 0.35], v(0.0, 0.48, 0.0), 0.12, 0.025, feet);
    for at in 0..rng.count(1, 4) {
        let tilt = DMat3::from_rotation_x(-0.35) * DMat3::from_rotation_y(rng.within(-0.4, 0.4));
        let x = -0.65 + 0.42 * at as f64 + rng.within(-0.05, 0.05);
        b.put_turned(Shape::Box(v(0.2, 0.06, 0.2)), v(x, 0.36, 0.62), tilt, cushion);
    }
}

fn bed(b: &mut Builder, rng: &mut Rng) {
    let (frame, sheet, pillow) = (wooden(b, rng), cloth(b, rng), cloth(b, rng));
    b.block(v(-0.85, 0.0, 0.0), v(0.85, 0.06, rng.within(0.8, 1.2)), frame);
    b.block(v(-0.83, 0.06, 0.15), v(0.83, 2.08, 0.32), frame);
    legs(b, [0.78, 0.9], v(0.0, 1.07, 0.0), 0.15, 0.03, frame);
    b.block(v(-0.8, 0.08, 0.32), v(0.8, 2.05, 0.52), sheet);
    b.block(v(-0.82, 0.8, 0.3), v(0.82, 2.07, 0.56), pillow);
    for x in [-0.4, 0.4] {
        b.put_turned(Shape::Box(v(0.32, 0.2, 0.08)), v(x, 0.32, 0.62), DMat3::from_rotation_x(0.4), pillow);
    }
}

fn chair(b: &mut Builder, rng: &mut Rng, at: DVec3, yaw: f64, frame: usize, seat: usize) {
    let turn = DMat3::from_rotation_z(yaw);
    let mut put = |shape: Shape, p: DVec3| b.put_turned(shape, at + turn * p, turn, frame);
    for (x, y) in [(-0.19, -0.19), (0.19, -0.19), (-0.19, 0.19), (0.19, 0.19)] {
        put(Shape::Cylinder { radius: 0.016, half_height: 0.22 }, v(x, y, 0.22));
    }
    for bar in 0..rng.count(3, 6) {
        put(Shape::Cylinder { radius: 0.009, half_height: 0.22 }, v(-0.17 + 0.075 * bar as f64, -0.19, 0.68));
    }
    put(Shape::Box(v(0.2, 0.015, 0.05)), v(0.0, -0.19, 0.88));
    b.put_turned(Shape::Box(v(0.21, 0.21, 0.025)), at + v(0.0, 0.0, 0.46), turn, seat);
}

fn clutter(b: &mut Builder, rng: &mut Rng, half: [f64; 2], centre: DVec3) {
    for _ in 0..rng.count(1, 4) {
        let at = centre + v(rng.within(-half[0], half[0]), rng.within(-half[1], half[1]), 0.0);
        let [x, y] = rng.pair();
        match rng.count(0, 3) {
            0 => {
                let cup = b.material(glossy(rng, Pattern::Plain(x), 0.05));
                b.put(Shape::Cylinder { radius: 0.04, half_height: 0.05 }, at + v(0.0, 0.0, 0.05), cup);
            }
            1 => {
                let half = Vec2::new(0.11, 0.15);
                let page =
                    b.material(matte(rng, Pattern::Text { ink: y * 0.2, paper: Vec3::splat(0.8), half, line: 0.02 }));
                let turn = DMat3::from_rotation_z(rng.within(-1.0, 1.0));
                b.put_turned(Shape::Box(v(0.11, 0.15, 0.008)), at + v(0.0, 0.0, 0.008), turn, page);
            }
            2 => {
                let fruit = b.material(glossy(rng, Pattern::Grain { a: x, b: y, feature: 0.05, octaves: 4 }, 0.03));
                for ball in 0..3 {
                    let shift = v(0.07 * f64::from(ball % 2), 0.06 * f64::from(ball / 2), 0.04);
                    b.put(Shape::Sphere(0.04), at + shift, fruit);
                }
            }
            _ => plants::potted(b, rng, at),
        }
    }
}

fn desk(b: &mut Builder, rng: &mut Rng) {
    let (top, frame, seat) = (wooden(b, rng), metal(b, rng), cloth(b, rng));
    b.block(v(-0.75, 0.0, 0.72), v(0.75, 0.65, 0.75), top);
    legs(b, [0.7, 0.28], v(0.0, 0.33, 0.0), 0.72, 0.02, frame);
    let screen = glossy(
        rng,
        Pattern::Text {
            ink: Vec3::splat(0.02),
            paper: Vec3::new(0.5, 0.6, 0.7),
            half: Vec2::new(0.28, 0.17),
            line: 0.025,
        },
        0.04,
    );
    let screen = b.material(Material { emission: Vec3::splat(0.05), ..screen });
    b.block(v(-0.28, 0.2, 0.85), v(0.28, 0.22, 1.19), screen);
    b.put(Shape::Cylinder { radius: 0.02, half_height: 0.06 }, v(0.0, 0.21, 0.81), frame);
    clutter(b, rng, [0.6, 0.12], v(0.0, 0.48, 0.75));
    let (x, turned) = (rng.within(-0.2, 0.2), std::f64::consts::PI + rng.within(-0.5, 0.5));
    chair(b, rng, v(x, 0.9, 0.0), turned, frame, seat);
}

fn kitchen(b: &mut Builder, rng: &mut Rng) {
    let (front, knobs) = (wooden(b, rng), metal(b, rng));
    let [stone, dark] = rng.stone();
    let top = b.material(glossy(rng, Pattern::Marble { a: stone, b: dark * 0.6, feature: 0.4 }, 0.06));
    let tile = Pattern::Tiles {
        a: stone,
        b: stone * 0.8,
        grout: Vec3::splat(0.6),
        size: Vec2::new(0.15, 0.075),
        gap: 0.004,
        shift: 0.5,
    };
    let tile = b.material(glossy(rng, tile, 0.05));
    b.block(v(-1.2, 0.0, 0.0), v(1.2, 0.58, 0.86), front);
    b.block(v(-1.2, 0.0, 0.86), v(1.2, 0.62, 0.9), top);
    b.block(v(-1.2, 0.0, 0.9), v(1.2, 0.012, 1.5), tile);
    b.block(v(-1.2, 0.0, 1.5), v(0.5, 0.34, 2.2), front);
    for door in 0..4 {
        let x = -1.2 + 0.6 * f64::from(door);
        b.block(v(x + 0.01, 0.58, 0.1), v(x + 0.59, 0.6, 0.84), front);
        let handle = Shape::Cylinder { radius: 0.008, half_height: 0.1 };
        b.put(handle, v(x + 0.52, 0.62, 0.65), knobs);
        if door < 3 {
            b.put(handle, v(x + 0.52, 0.36, 1.65), knobs);
        }
    }
    clutter(b, rng, [1.0, 0.15], v(0.0, 0.35, 0.9));
}

fn radiator(b: &mut Builder, rng: &mut Rng) {
    let white = b.material(glossy(rng, Pattern::Plain(Vec3::splat(0.75)), 0.03));
    for fin in 0..16 {
        let x = -0.48 + 0.064 * f64::from(fin);
        b.put(Shape::Cylinder { radius: 0.02, half_height: 0.28 }, v(x, 0.08, 0.42), white);
    }
    for z in [0.16, 0.68] {
        b.block(v(-0.5, 0.06, z - 0.02), v(0.5, 0.1, z + 0.02), white);
    }
}

fn floor_lamp(b: &mut Builder, rng: &mut Rng) {
    let pole = metal(b, rng);
    let height = rng.within(1.3, 1.6);
    b.put(Shape::Cylinder { radius: 0.15, half_height: 0.015 }, v(0.0, 0.22, 0.015), pole);
    b.put(Shape::Cylinder { radius: 0.012, half_height: height / 2.0 }, v(0.0, 0.22, height / 2.0), pole);
    shade(b, rng, v(0.0, 0.22, height + 0.12));
}

/// A lampshade that glows over its whole surface. It lights the room as a ball around it, at which shadow rays end before they
/// meet the shade; both emit the same power, radiance times area.
pub(super) fn shade(b: &mut Builder, rng: &mut Rng, centre: DVec3) {
    let (radius, half_height, ball) = (0.17, 0.12, 0.215);
    let radiance = Vec3::new(1.0, 0.78, 0.5) * 6.0;
    let ball_per_shade = 2.0 * ball * ball / (radius * (radius + 2.0 * half_height));
    let emission = radiance * as_f32(ball_per_shade);
    let glowing = Material { emission, ..matte(rng, Pattern::Plain(Vec3::splat(0.6))) };
    let glowing = b.material(glowing);
    b.put(Shape::Cylinder { radius, half_height }, centre, glowing);
    let centre = b.to_world(centre);
    b.lamps.push(Lamp::Bulb { centre, radius: ball, radiance });
}

fn table(b: &mut Builder, rng: &mut Rng) {
    let (top, frame, seat) = (wooden(b, rng), wooden(b, rng), cloth(b, rng));
    let centre = v(0.0, 0.95, 0.0);
    if rng.chance(0.3) {
        b.put(Shape::Cylinder { radius: 0.6, half_height: 0.02 }, centre + v(0.0, 0.0, 0.73), top);
        b.put(Shape::Cylinder { radius: 0.05, half_height: 0.36 }, centre + v(0.0, 0.0, 0.36), frame);
    } else {
        b.put(Shape::Box(v(0.75, 0.45, 0.02)), centre + v(0.0, 0.0, 0.73), top);
        legs(b, [0.68, 0.38], centre, 0.71, 0.03, frame);
    }
    clutter(b, rng, [0.45, 0.3], centre + v(0.0, 0.0, 0.75));
    for (x, y, yaw) in [(-0.35, -0.62, 0.0), (0.35, -0.62, 0.0), (-0.35, 0.62, 1.0), (0.35, 0.62, 1.0)] {
        if rng.chance(0.8) {
            let turned = yaw * std::f64::consts::PI + rng.within(-0.3, 0.3);
            chair(b, rng, centre + v(x, y, 0.0), turned, frame, seat);
        }
    }
}

fn boxes(b: &mut Builder, rng: &mut Rng) {
    let [x, _] = rng.wood();
    let mut z = 0.0;
    for _ in 0..rng.count(1, 3) {
        let half = v(rng.within(0.15, 0.32), rng.within(0.12, 0.26), rng.within(0.1, 0.2));
        let label = Pattern::Text { ink: x * 0.3, paper: x, half: Vec2::new(0.16, 0.1), line: 0.045 };
        let label = b.material(matte(rng, label));
        let turn = DMat3::from_rotation_z(rng.within(-0.3, 0.3));
        b.put_turned(Shape::Box(half), v(0.0, 0.3, z + half.z), turn, label);
        z += 2.0 * half.z;
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::world::World;

    fn built(put: impl FnOnce(&mut Builder, &mut Rng)) -> World {
        let (mut b, mut rng) = (Builder::new(), Rng::new(5));
        b.instance(DVec3::ZERO, 0.0);
        put(&mut b, &mut rng);
        b.finish(crate::build::sky(&mut rng, 1.0), Vec3::ONE, [DVec3::splat(-3.0), DVec3::splat(3.0)])
    }

    /// Where boxes overlap, sides in one plane would hide each other by chance.
    #[test]
    fn boxes_of_sofas_and_bookshelves_do_not_overlap() {
        for (piece, least) in [(Piece::Sofa, 4), (Piece::Bookshelf, 8)] {
            let world = built(|b, rng| piece.build(b, rng));
            let upright = world.objects.iter().filter(|object| object.world_from_local == DMat3::IDENTITY);
            let boxes: Vec<(DVec3, DVec3)> = upright
                .filter_map(|object| match object.shape {
                    Shape::Box(half) => Some((object.centre, half)),
                    _ => None,
                })
                .collect();
            assert!(boxes.len() >= least, "{piece:?}: {} boxes", boxes.len());
            for (at, (centre, half)) in boxes.iter().enumerate() {
                for (other, reach) in &boxes[..at] {
                    let gap = (*centre - *other).abs() - *half - *reach;
                    assert!(gap.max_element() > -1e-9, "{piece:?}: boxes at {centre} and {other}");
                }
            }
        }
    }

    /// The area of the shade is 2π · 0.17 · 0.24 m² and two caps of π · 0.17² m².
    #[test]
    fn a_lampshade_emits_the_power_that_lights_the_room() {
        let world = built(|b, rng| shade(b, rng, v(0.3, -0.2, 1.5)));
        let emission = world.materials[world.objects[0].material].emission.as_dvec3();
        let Lamp::Bulb { centre, radius, radiance } = world.lamps[0] else { panic!("{:?}", world.lamps) };
        let power = radiance.as_dvec3() * (4.0 * std::f64::consts::PI * radius * radius);
        Tolerance::relative(1e-4).assert((emission * 0.437_938).to_array(), power.to_array(), "power");
        let lights = radiance.to_array().map(f64::from);
        Tolerance::absolute(1e-5).assert(lights, [6.0, 4.68, 3.0], "light of the room");
        assert!(centre == v(0.3, -0.2, 1.5) && radius > 0.17f64.hypot(0.12), "the ball encloses the shade");
    }
}
