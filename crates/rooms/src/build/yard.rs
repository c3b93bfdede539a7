//! DL3DV-like courtyards: façades around an open square with trees, benches, railings and other objects.

use glam::{DVec3, Vec2, Vec3};

use super::decor::{picture, railing};
use super::furniture::Piece;
use super::plants::{rod, tree};
use super::shell::{Opening, wall, wall_material};
use super::{glossy, matte, sky};
use crate::lamp::Lamp;
use crate::material::Pattern;
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::{Builder, World};

pub(super) fn build(seed: u64) -> World {
    let rng = &mut Rng::for_part(seed, "yard");
    let mut b = Builder::new();
    let half = DVec3::new(rng.within(8.0, 16.0), rng.within(8.0, 14.0), 0.0);
    ground(&mut b, rng, half);
    let height = rng.within(3.0, 9.0);
    for side in 0..4 {
        facade(&mut b, rng, half, height, side);
    }
    for _ in 0..rng.count(3, 7) {
        let (x, y) = (rng.within(-0.75, 0.75) * half.x, rng.within(-0.75, 0.75) * half.y);
        b.instance(DVec3::new(x, y, 0.0), rng.within(0.0, 6.0));
        let height = rng.within(2.6, 5.5);
        tree(&mut b, rng, height);
    }
    for _ in 0..rng.count(12, 22) {
        let (x, y) = (rng.within(-0.8, 0.8) * half.x, rng.within(-0.8, 0.8) * half.y);
        b.instance(DVec3::new(x, y, 0.0), rng.within(0.0, 6.0));
        match rng.count(0, 8) {
            0 => bench(&mut b, rng),
            1 => fountain(&mut b, rng),
            2 => {
                let end = rng.within(0.5, 2.5);
                railing(&mut b, rng, DVec3::X * -1.5, DVec3::X * end);
            }
            3 => sculpture(&mut b, rng),
            4 => Piece::Boxes.build(&mut b, rng),
            5 => lamp_post(&mut b, rng),
            6 => Piece::Table.build(&mut b, rng),
            7 => board(&mut b, rng),
            _ => hedge(&mut b, rng),
        }
    }
    if rng.chance(0.65) {
        let direction = DVec3::new(rng.within(-1.0, 1.0), rng.within(-1.0, 1.0), rng.within(0.5, 1.2)).normalize();
        b.lamps.push(Lamp::Sun { direction, radius: 0.005, irradiance: Vec3::new(1.0, 0.92, 0.8) * 6.0 });
    }
    let space = [(-half).with_z(0.0), half.with_z(4.0)];
    b.finish(sky(rng, 1.0), Vec3::new(0.5, 0.55, 0.62), space)
}

fn ground(b: &mut Builder, rng: &mut Rng, half: DVec3) {
    let [stone, dark] = rng.stone();
    let [a, green] = rng.leaves();
    let grass = Pattern::Grain { a: a * 0.8, b: green * 0.6, feature: 0.12, octaves: 7 };
    let paving = match rng.count(0, 2) {
        0 => Pattern::Tiles { a: stone, b: dark, grout: dark * 0.5, size: Vec2::new(0.6, 0.4), gap: 0.012, shift: 0.5 },
        1 => Pattern::Tiles {
            a: stone * 0.8,
            b: dark * 0.7,
            grout: dark * 0.4,
            size: Vec2::new(0.2, 0.1),
            gap: 0.008,
            shift: 0.5,
        },
        _ => Pattern::Grain { a: stone, b: dark * 0.7, feature: 0.03, octaves: 4 },
    };
    let (grass, paving) = (matte(rng, grass), matte(rng, paving));
    let (grass, paving) = (b.material(grass), b.material(paving));
    b.instance(DVec3::ZERO, 0.0);
    b.block(DVec3::new(-half.x - 1.0, -half.y - 1.0, -0.3), DVec3::new(half.x + 1.0, half.y + 1.0, 0.0), grass);
    b.instance(DVec3::ZERO, 0.0);
    let (x, y) = (half.x * rng.within(0.3, 0.9), half.y * rng.within(0.3, 0.9));
    b.block(DVec3::new(-x, -y, -0.1), DVec3::new(x, y, 0.02), paving);
    b.block(DVec3::new(-half.x, -0.9, -0.1), DVec3::new(half.x, 0.9, 0.021), paving);
}

/// A wall with rows of windows and a cornice, or sometimes only a low wall with a railing.
fn facade(b: &mut Builder, rng: &mut Rng, half: DVec3, height: f64, side: u8) {
    let yaw = f64::from(side) * std::f64::consts::FRAC_PI_2;
    let (far, wide) = if side.is_multiple_of(2) { (half.y, half.x) } else { (half.x, half.y) };
    let turn = glam::DMat3::from_rotation_z(yaw);
    let origin = turn * DVec3::new(-wide, -far - 0.3, 0.0);
    let material = b.material(wall_material(rng));
    b.instance(origin, yaw);
    if rng.chance(0.25) {
        wall(b, 2.0 * wide, 0.8, 0.3, &[], material);
        b.instance(origin, yaw);
        railing(b, rng, DVec3::new(0.0, 0.15, 0.8), DVec3::new(2.0 * wide, 0.15, 0.8));
        return;
    }
    let pitch = rng.within(1.9, 3.2);
    let glass = b.material(glossy(rng, Pattern::Plain(Vec3::splat(0.03)), 0.12));
    let trim = b.material(matte(rng, Pattern::Plain(Vec3::splat(0.65))));
    let storeys = ((height - 0.4) / 2.8).floor();
    let mut z = 0.0;
    for _ in 0..4 {
        if z + 2.8 > storeys * 2.8 + 0.1 {
            break;
        }
        b.instance(origin + DVec3::Z * z, yaw);
        let mut openings = Vec::new();
        let mut x = 0.8;
        while x + 1.1 < 2.0 * wide {
            openings.push(Opening { along: [x, x + 1.1], height: [0.9, 2.3] });
            x += pitch;
        }
        wall(b, 2.0 * wide, 2.8, 0.3, &openings, material);
        for opening in &openings {
            let [left, right] = opening.along;
            b.block(DVec3::new(left, 0.1, 0.9), DVec3::new(right, 0.13, 2.3), glass);
            b.block(DVec3::new(left + 0.53, 0.09, 0.9), DVec3::new(left + 0.57, 0.16, 2.3), trim);
            b.block(DVec3::new(left - 0.08, 0.2, 0.84), DVec3::new(right + 0.08, 0.4, 0.9), trim);
        }
        z += 2.8;
    }
    b.instance(origin + DVec3::Z * z, yaw);
    wall(b, 2.0 * wide, (height - z).clamp(0.2, 4.0), 0.3, &[], material);
    b.block(DVec3::new(0.0, 0.3, 0.0), DVec3::new(2.0 * wide, 0.42, 0.12), trim);
    for _ in 0..rng.count(0, 3) {
        b.instance(origin, yaw);
        let x = rng.within(1.0, 2.0 * wide - 1.0);
        picture(b, rng, DVec3::new(x, 0.3, 1.5));
    }
}

fn bench(b: &mut Builder, rng: &mut Rng) {
    let [light, dark] = rng.wood();
    let slats = b.material(matte(rng, Pattern::Planks { a: light, b: dark, width: 0.5, length: 5.0 }));
    for slat in 0..5 {
        let y = 0.1 * f64::from(slat);
        b.block(DVec3::new(-0.9, y, 0.43), DVec3::new(0.9, y + 0.08, 0.46), slats);
        if slat < 3 {
            b.block(DVec3::new(-0.9, 0.0, 0.55 + y), DVec3::new(0.9, 0.025, 0.62 + y), slats);
        }
    }
    for x in [-0.7, 0.7] {
        b.block(DVec3::new(x - 0.03, 0.02, 0.0), DVec3::new(x + 0.03, 0.46, 0.43), slats);
    }
}

fn hedge(b: &mut Builder, rng: &mut Rng) {
    let [a, dark] = rng.leaves();
    let leaves = b.material(matte(rng, Pattern::Grain { a, b: dark * 0.3, feature: 0.04, octaves: 4 }));
    let half = DVec3::new(rng.within(0.6, 2.0), rng.within(0.2, 0.4), rng.within(0.3, 0.7));
    b.put(Shape::Box(half), DVec3::Z * half.z, leaves);
    for _ in 0..60 {
        let place = DVec3::new(rng.within(-1.0, 1.0) * half.x, rng.sign() * half.y, rng.unit() * 2.0 * half.z);
        let turn = glam::DMat3::from_axis_angle(rng.direction(), rng.within(0.0, 3.0));
        b.put_turned(Shape::Leaf(glam::DVec2::new(0.08, 0.05)), place, turn, leaves);
    }
}

fn lamp_post(b: &mut Builder, rng: &mut Rng) {
    let iron = b.material(glossy(rng, Pattern::Plain(Vec3::splat(0.03)), 0.08));
    let globe = b.material(glossy(rng, Pattern::Plain(Vec3::splat(0.8)), 0.04));
    let height = rng.within(2.6, 3.6);
    rod(b, DVec3::ZERO, DVec3::Z * height, 0.04, iron);
    b.put(Shape::Cylinder { radius: 0.1, half_height: 0.15 }, DVec3::Z * 0.15, iron);
    b.put(Shape::Sphere(0.18), DVec3::Z * (height + 0.15), globe);
}

/// A notice board on two posts.
fn board(b: &mut Builder, rng: &mut Rng) {
    let [light, dark] = rng.wood();
    let post = b.material(matte(rng, Pattern::Planks { a: light, b: dark, width: 0.2, length: 3.0 }));
    let [ink, paper] = rng.pair();
    let half = Vec2::new(0.6, 0.4);
    let notice = b.material(matte(rng, Pattern::Text { ink: ink * 0.2, paper, half, line: 0.09 }));
    for x in [-0.55, 0.55] {
        rod(b, DVec3::new(x, 0.0, 0.0), DVec3::new(x, 0.0, 1.7), 0.035, post);
    }
    b.put(Shape::Box(DVec3::new(0.6, 0.02, 0.4)), DVec3::Z * 1.25, notice);
}

fn fountain(b: &mut Builder, rng: &mut Rng) {
    let [stone, dark] = rng.stone();
    let rock = b.material(matte(rng, Pattern::Grain { a: stone, b: dark, feature: 0.08, octaves: 6 }));
    let water = b.material(glossy(
        rng,
        Pattern::Grain { a: Vec3::new(0.05, 0.12, 0.14), b: Vec3::splat(0.03), feature: 0.1, octaves: 3 },
        0.1,
    ));
    for stone in 0..20 {
        let angle = f64::from(stone) * std::f64::consts::TAU / 20.0;
        let place = DVec3::new(1.3 * angle.cos(), 1.3 * angle.sin(), 0.25);
        let turn = glam::DMat3::from_rotation_z(angle);
        b.put_turned(Shape::Box(DVec3::new(0.15, 0.2, 0.25)), place, turn, rock);
    }
    b.put(Shape::Cylinder { radius: 1.2, half_height: 0.18 }, DVec3::Z * 0.18, water);
    rod(b, DVec3::ZERO, DVec3::Z * 1.2, 0.12, rock);
    b.put(Shape::Cylinder { radius: 0.5, half_height: 0.05 }, DVec3::Z * 1.2, rock);
    b.put(Shape::Sphere(0.16), DVec3::Z * 1.4, rock);
}

fn sculpture(b: &mut Builder, rng: &mut Rng) {
    let [stone, dark] = rng.stone();
    let plinth = b.material(matte(rng, Pattern::Grain { a: stone, b: dark, feature: 0.2, octaves: 6 }));
    let [x, y] = rng.pair();
    let body = b.material(glossy(rng, Pattern::Marble { a: x, b: y, feature: 0.3 }, 0.06));
    b.put(Shape::Box(DVec3::new(0.4, 0.4, 0.4)), DVec3::Z * 0.4, plinth);
    let mut z = 0.8;
    for _ in 0..rng.count(2, 5) {
        let size = rng.within(0.12, 0.35);
        let shape = match rng.count(0, 2) {
            0 => Shape::Sphere(size),
            1 => Shape::Cylinder { radius: size * 0.6, half_height: size },
            _ => Shape::Box(DVec3::new(size, size * 0.6, size)),
        };
        b.put_turned(shape, DVec3::Z * (z + size), glam::DMat3::from_rotation_z(rng.within(0.0, 3.0)), body);
        z += 2.0 * size;
    }
}
