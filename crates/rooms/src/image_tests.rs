//! Images of scenes with analytic solutions: places and times of samples, light of lamps, and the order of the sensor's steps.

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::Tolerance;
use glam::{DMat3, DVec3, Vec3};

use crate::SceneKind;
use crate::effects::{Conditions, EffectChoice, EffectKind, Effects, SceneContext};
use crate::material::{Material, Pattern, srgb_encoded};
use crate::path::Shot;
use crate::render::{Frame, image_of_light};
use crate::rng::mix;
use crate::simulation::conditions;
use crate::sky::Sky;
use crate::world::{Builder, World};

const SIZE: ImageSize = ImageSize { width: 24, height: 20 };
const PLAIN: Conditions = Conditions { lens: [0.0; 2], shutter: 0.0, noise: 0.0, drift: 0.0, bounce: 0.0, seed: 1 };

/// A camera at `right`, up to the left or right of the origin, that looks along the world's +y.
fn pose(right: f64) -> WorldFromCamera {
    let upright = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
    WorldFromCamera::new(upright, DVec3::new(right, 0.0, 0.0)).unwrap()
}

/// A camera that moves to the right by `motion` until the next frame, 40 ms later.
fn shot(motion: f64) -> Shot {
    let intrinsics = NormalizedIntrinsics::new(0.9, 1.1, 0.5, 0.5).unwrap();
    let camera = Camera::pinhole(pose(0.0).inverse(), intrinsics);
    Shot { timestamp_micros: 0, camera, moving_to: pose(motion), frame_seconds: 0.04 }
}

/// A white plate at a distance of 2, with these half sides around the optical axis, in front of nothing.
fn plate(right: f64, up: f64) -> World {
    let mut builder = Builder::new();
    let white = builder.material(Material::matte(Pattern::Plain(Vec3::ONE), 0));
    builder.instance(DVec3::ZERO, 0.0);
    builder.block(DVec3::new(-right, 2.0, -up), DVec3::new(right, 2.1, up), white);
    builder.finish(Sky::BLACK, Vec3::ONE, [DVec3::splat(-9.0), DVec3::splat(9.0)])
}

fn effects(world: &World, conditions: &Conditions, shot: &Shot, kinds: &[EffectKind]) -> Effects {
    let scene = SceneContext { world, conditions, shots: &[*shot], size: SIZE, samples: 4 };
    Effects::choose(&scene, &EffectChoice::Only(kinds.to_vec()))
}

/// Light of each column and of each row, summed.
fn sums(light: &[Vec3]) -> [Vec<f64>; 2] {
    let (width, height) = (SIZE.width as usize, SIZE.height as usize);
    let at = |column: usize, row: usize| f64::from(light[row * width + column].x);
    let columns = (0..width).map(|column| (0..height).map(|row| at(column, row)).sum());
    let rows = (0..height).map(|row| (0..width).map(|column| at(column, row)).sum());
    [columns.collect(), rows.collect()]
}

/// The mean position of light, in pixels from the image's centre.
fn centroid(sums: &[f64]) -> f64 {
    let middle = sums.len() as f64 / 2.0;
    let weighted: f64 = sums.iter().enumerate().map(|(at, light)| (at as f64 + 0.5 - middle) * light).sum();
    weighted / sums.iter().sum::<f64>()
}

/// A plate around the optical axis looks the same from both sides, at edges anywhere in a pixel and for any number of rays.
#[test]
fn images_are_not_shifted_against_their_cameras() {
    const BEYOND: f64 = 5.0;
    for half in [0.31, 0.347, 0.392, 0.43] {
        for (axis, world) in [plate(half, BEYOND), plate(BEYOND, half)].into_iter().enumerate() {
            for samples in [1, 2, 3, 4, 5, 7, 16] {
                let effects = effects(&world, &PLAIN, &shot(0.0), &[]);
                let light = Frame::new(&world, &effects, &shot(0.0), SIZE, samples).unwrap().light().unwrap();
                let sums = &sums(&light)[axis];
                let mirrored = sums.iter().rev().copied();
                let what = format!("axis {axis}, {samples} rays, half side {half}");
                Tolerance::absolute(1e-4).assert(sums.iter().copied(), mirrored, &what);
            }
        }
    }
}

/// The exposure is half over at the frame's pose: the blurred plate stays in the middle, and its edges are as wide as the motion
/// while the shutter is open.
#[test]
fn motion_blur_is_centred_on_the_pose_and_lasts_as_long_as_the_shutter() {
    let world = plate(0.4, 0.4);
    let open = Conditions { shutter: 0.01, ..PLAIN };
    for motion in [0.6, -0.6] {
        let moving = shot(motion);
        let effects = effects(&world, &open, &moving, &[EffectKind::MotionBlur]);
        let light = Frame::new(&world, &effects, &moving, SIZE, 256).unwrap().light().unwrap();
        let [columns, rows] = sums(&light);
        Tolerance::absolute(0.1).assert([centroid(&columns), centroid(&rows)], [0.0; 2], "centre of the plate");
        // At a distance of 2, a motion of 0.15 in a quarter of the frame's time is 1.62 pixels. Light rises linearly over the
        // blurred edge, from 4.32 − 0.81 to 4.32 + 0.81 pixels from the centre.
        let full = columns[12];
        let edge = |from: f64, to: f64| {
            let lit = |x: f64| ((4.32 + 0.81 - x) / 1.62).clamp(0.0, 1.0);
            (0..1000).map(|n| lit(from + (to - from) * (f64::from(n) + 0.5) / 1000.0)).sum::<f64>() / 1000.0
        };
        for column in 12..24u32 {
            let from = f64::from(column) - 12.0;
            let found = columns[column as usize] / full;
            Tolerance::absolute(0.03).assert([found], [edge(from, from + 1.0)], &format!("column {column}, {motion}"));
        }
    }
}

/// Every ray of a pixel tests another part of a lamp, all parts with equal weight for any number of rays; other pixels, frames
/// and scenes test other points.
#[test]
fn rays_of_a_pixel_cover_lamps_evenly() {
    let world = plate(0.4, 0.4);
    let places = |seed: u64, micros: i64, pixel: [u32; 2], samples: u32| {
        let moment = Shot { timestamp_micros: micros, ..shot(0.0) };
        let effects = effects(&world, &Conditions { seed, ..PLAIN }, &moment, &[]);
        let frame = Frame::new(&world, &effects, &moment, SIZE, samples).unwrap();
        let plane = frame.pixel(pixel[0], pixel[1]).unwrap();
        (0..samples).map(|sample| frame.ray(pixel, plane, sample).place_on_lamps.to_array()).collect::<Vec<_>>()
    };
    for samples in [1, 3, 4, 6] {
        let found = places(1, 0, [5, 7], samples);
        for axis in [0, 1] {
            let mut sorted: Vec<f64> = found.iter().map(|place| place[axis] * f64::from(samples)).collect();
            sorted.sort_by(f64::total_cmp);
            let expected = (0..samples).map(|n| sorted[0] + f64::from(n));
            Tolerance::absolute(1e-9).assert(sorted.clone(), expected.collect::<Vec<_>>(), "one ray for each part");
            assert!(sorted.iter().all(|place| (0.0..f64::from(samples)).contains(place)), "{sorted:?}");
        }
    }
    let first = places(1, 0, [5, 7], 4);
    for other in [places(2, 0, [5, 7], 4), places(1, 33_333, [5, 7], 4), places(1, 0, [7, 5], 4)] {
        assert_ne!(first, other);
    }
}

/// The sensor measures light before the tone curve compresses it: an exposure of one stop more is the image of twice the light,
/// and noise in highlights is compressed with them.
#[test]
fn exposure_and_noise_act_on_light_before_the_tone_curve() {
    let world = plate(0.4, 0.4);
    let pixels = (SIZE.width * SIZE.height) as usize;
    let image = |conditions: &Conditions, kinds: &[EffectKind], light: f32| {
        let effects = effects(&world, conditions, &shot(0.0), kinds);
        image_of_light(&vec![Vec3::splat(light); pixels], &effects, &shot(0.0), SIZE, 1.0).unwrap().samples().to_vec()
    };
    let drifting = Conditions { drift: 1.0, ..PLAIN };
    let phase = atsplat_numeric::unit_of_bits(mix(PLAIN.seed ^ 0x15)) * std::f64::consts::TAU;
    #[expect(clippy::cast_possible_truncation, reason = "a gain near 1")]
    let gain = phase.sin().exp2() as f32;
    assert!(!(0.8..1.25).contains(&gain), "the exposure is changed: {gain}");
    for light in [0.2, 0.9, 2.0] {
        let drifted = image(&drifting, &[EffectKind::ExposureDrift], light);
        let expected = image(&PLAIN, &[], light * gain);
        let wide = |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<_>>();
        Tolerance::absolute(1e-6).assert(wide(drifted), wide(expected), "drift");
    }
    let noisy = Conditions { noise: 0.02, ..PLAIN };
    let deviation = |light: f32| {
        let clean = f64::from(image(&PLAIN, &[], light)[0]);
        let found = image(&noisy, &[EffectKind::SensorNoise], light);
        (found.iter().map(|value| (f64::from(*value) - clean).powi(2)).sum::<f64>() / found.len() as f64).sqrt()
    };
    // Where the tone curve is linear: the noise times the slope of the encoding.
    let slope = f64::from(srgb_encoded(0.51) - srgb_encoded(0.49)) / 0.02;
    Tolerance::relative(0.05).assert([deviation(0.5)], [0.02 * 0.6f64.sqrt() * slope], "noise of 0.5");
    assert!(deviation(2.0) < 0.1 * deviation(0.5), "{} in highlights, {}", deviation(2.0), deviation(0.5));
}

#[test]
fn rooms_and_yards_of_one_number_are_filmed_independently() {
    let drawn = |kind| (0..400).map(|seed| conditions(kind, mix(seed)).noise > 0.0).collect::<Vec<_>>();
    let (rooms, yards) = (drawn(SceneKind::Rooms), drawn(SceneKind::Yards));
    let both = rooms.iter().zip(&yards).filter(|(room, yard)| **room && **yard).count();
    // 0.35² of 400 are 49, with a deviation of 6.6; equal draws would be 140.
    assert!((20..=80).contains(&both), "{both} of 400");
}
