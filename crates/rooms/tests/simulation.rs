//! Guarantees of simulated scenes: determinism, exact geometry, effects, given routes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_rooms::{
    EffectChoice, EffectKind, GENERATION, GENERATOR, Geometry, ImageDifference, Request, Route, SceneKind, SceneSeed,
    Simulation, Split,
};
use atsplat_tests::on_threads;
use glam::{DMat3, DVec3};
use sha2::{Digest, Sha256};

const SMALL: ImageSize = ImageSize { width: 48, height: 40 };

fn request(kind: SceneKind, number: u32) -> Request {
    Request { size: SMALL, ..Request::new(kind, SceneSeed { split: Split::Test, number }) }
}

fn digest(simulation: &Simulation, frames: &[usize]) -> [u8; 32] {
    let mut hash = Sha256::new();
    for &frame in frames {
        let (image, geometry) = (simulation.image(frame).unwrap(), simulation.geometry(frame).unwrap());
        image.samples().iter().for_each(|sample| hash.update(sample.to_le_bytes()));
        geometry.depth.iter().for_each(|depth| hash.update(depth.to_le_bytes()));
        geometry.normals.iter().flatten().for_each(|n| hash.update(n.to_le_bytes()));
        geometry.instances.iter().for_each(|id| hash.update(id.to_le_bytes()));
    }
    for shot in simulation.shots() {
        shot.camera.camera_from_world.to_rows().iter().for_each(|number| hash.update(number.to_le_bytes()));
    }
    hash.finalize().into()
}

#[test]
fn a_seed_gives_the_same_bytes_on_any_number_of_threads() {
    for kind in SceneKind::ALL {
        for effects in [EffectChoice::Auto, EffectChoice::All] {
            let request = Request { effects, ..request(kind, 3) };
            let on = |threads| on_threads(threads, || digest(&Simulation::new(request.clone()).unwrap(), &[0, 40]));
            let one = on(1);
            assert_eq!([on(2), on(5)], [one, one], "{kind} {:?}", request.effects);
            let other = Simulation::new(request.clone()).unwrap();
            other.image(7).unwrap();
            assert_eq!(digest(&other, &[0, 40]), one, "frames rendered before must not matter");
        }
    }
    let of = |number| digest(&Simulation::new(request(SceneKind::Rooms, number)).unwrap(), &[0]);
    assert_ne!(of(1), of(2));
}

/// Golden hashes: changing them changes every simulated dataset and requires raising [`GENERATOR`], by which results stores
/// recognise rows computed from these images.
///
/// Hashes cover images in 8 bits, depth in millimetres and instances instead of floats: sines and powers come from the
/// system's library, whose last bits differ between machines, and rounding almost always hides them.
#[test]
#[cfg(all(target_arch = "x86_64", target_os = "linux", target_env = "gnu"))]
fn golden_hashes_are_unchanged() {
    let mut found = Vec::new();
    for (kind, number) in [(SceneKind::Rooms, 2), (SceneKind::Yards, 0), (SceneKind::Yards, 3)] {
        let simulation = Simulation::new(Request { effects: EffectChoice::All, ..request(kind, number) }).unwrap();
        let mut hash = Sha256::new();
        for frame in [0, 60] {
            let (image, geometry) = (simulation.image(frame).unwrap(), simulation.geometry(frame).unwrap());
            hash.update(image.to_u8(atsplat_pixels::Rounding::Nearest).unwrap().samples());
            geometry.depth.iter().for_each(|depth| hash.update(format!("{:.0},", depth * 1e3)));
            geometry.instances.iter().for_each(|id| hash.update(id.to_le_bytes()));
        }
        let first = hash.finalize().first_chunk().copied().unwrap();
        found.push(format!("{} {:016x}", simulation.key(), u64::from_be_bytes(first)));
    }
    assert_eq!(found, GOLDEN);
    assert_eq!(GENERATOR, "atsplat rooms 2", "the generator of these hashes");
    assert_eq!(GENERATOR, format!("atsplat rooms {GENERATION}"));
}

#[cfg(all(target_arch = "x86_64", target_os = "linux", target_env = "gnu"))]
const GOLDEN: [&str; 3] = [
    "rooms-test-00000002 efce4dff3cff729e",
    "yards-test-00000000 81232be1412ed9ae",
    "yards-test-00000003 a21c61411376a5dc",
];

fn mean_difference(a: &Simulation, b: &Simulation, frame: usize) -> f64 {
    let (a, b) = (a.image(frame).unwrap(), b.image(frame).unwrap());
    let sum: f64 = a.samples().iter().zip(b.samples()).map(|(a, b)| f64::from((a - b).abs())).sum();
    sum / a.samples().len() as f64
}

/// Asserts that images with the effects that a scene needs are close to those with all; returns how many effects
/// were left out, and the largest difference.
fn assert_close_to_all(kind: SceneKind, number: u32, size: ImageSize, frame: usize) -> (usize, ImageDifference) {
    let simulation = Simulation::new(Request { size, ..request(kind, number) }).unwrap();
    let difference = simulation.difference_from_all(frame).unwrap();
    let close = difference.beyond <= 1e-3 && difference.psnr() >= 50.0;
    assert!(close, "{simulation}: {difference:?}, PSNR {} dB", difference.psnr());
    (EffectKind::ALL.len() - simulation.active_effects().len(), difference)
}

#[test]
fn skipped_effects_hardly_change_any_pixel() {
    let (mut skipped, mut largest) = (0, 0.0);
    for number in 0..10 {
        let kind = if number % 2 == 0 { SceneKind::Rooms } else { SceneKind::Yards };
        let (left_out, difference) = assert_close_to_all(kind, number, ImageSize { width: 96, height: 64 }, 20);
        skipped += left_out;
        largest = if difference.largest > largest { difference.largest } else { largest };
    }
    assert!(skipped >= 10, "only {skipped} effects were skipped in ten scenes");
    // The measure itself must see an effect that is missing.
    let none = Simulation::new(Request { effects: EffectChoice::None, ..request(SceneKind::Rooms, 2) }).unwrap();
    let difference = none.difference_from_all(20).unwrap();
    assert!(difference.beyond > 0.1 && difference.psnr() < 40.0 && difference.largest > largest, "{difference:?}");
}

/// Forty scenes of each kind; prints the rows of `benches/README.md`.
#[test]
#[ignore = "takes a minute: cargo test --release -p atsplat-rooms --test simulation -- --ignored --nocapture eighty"]
fn eighty_scenes_are_close_to_all_effects() {
    let size = ImageSize { width: 256, height: 256 };
    for kind in SceneKind::ALL {
        let found: Vec<_> = (0..40).map(|number| assert_close_to_all(kind, number, size, 60)).collect();
        let most = |read: fn(&ImageDifference) -> f64| found.iter().map(|(_, of)| read(of)).fold(0.0, f64::maximum_of);
        let (skipped, worst) = (found.iter().map(|(skipped, _)| skipped).sum::<usize>(), most(|of| of.mse));
        println!(
            "{kind}: {:.1} of 7 effects left out; in the worst scene {:.3} % of pixels above 1/255, PSNR {:.1} dB, at most {:.1} of 255",
            skipped as f64 / 40.0,
            most(|of| of.beyond) * 100.0,
            -10.0 * worst.log10(),
            most(|of| of.largest.into()) * 255.0
        );
    }
}

/// Each image has the exposure of its own effects: without shadows and light of other surfaces, a scene is brighter or darker.
#[test]
fn the_difference_from_all_effects_is_that_of_two_simulations() {
    let image = |effects| Simulation::new(Request { effects, ..request(SceneKind::Rooms, 2) }).unwrap();
    let all = image(EffectChoice::All);
    let shadows = EffectChoice::Only(vec![EffectKind::SoftShadows]);
    for simulation in [image(EffectChoice::None), image(shadows)] {
        let [left, right] = [&simulation, &all].map(|simulation| simulation.image(20).unwrap());
        let changes = left.samples().iter().zip(right.samples()).map(|(a, b)| (a - b).abs());
        let largest = changes.fold(0.0, f32::maximum_of);
        let found = simulation.difference_from_all(20).unwrap().largest;
        assert!(largest > 0.0 && found.to_bits() == largest.to_bits(), "{found}, {largest} of two images");
    }
}

/// The first yard's lens is in neither image.
#[test]
fn a_lens_that_was_left_out_is_no_difference_from_all_effects() {
    let seed = SceneSeed { split: Split::Train, number: 0 };
    let request = Request { size: SMALL, frames: 2, ..Request::new(SceneKind::Yards, seed) };
    let whole = Simulation::new(request.clone()).unwrap();
    assert!(whole.camera(0).unwrap().distortion != Distortion::None);
    let difference = Simulation::new(request).unwrap().without_lens().difference_from_all(1).unwrap();
    assert!(difference.beyond <= 1e-3, "{difference:?}");
}

/// A twentieth of a step of 8 bits.
const MIN_DIFFERENCE: f64 = 0.05 / 255.0;

#[test]
fn each_needed_effect_changes_images() {
    let mut seen = Vec::new();
    for number in 0..30 {
        let kind = if number % 2 == 0 { SceneKind::Rooms } else { SceneKind::Yards };
        let auto = Simulation::new(request(kind, number)).unwrap();
        let kinds: Vec<EffectKind> = auto.active_effects().iter().map(|active| active.effect).collect();
        for &effect in kinds.iter().filter(|effect| !seen.contains(*effect)).collect::<Vec<_>>() {
            let others = kinds.iter().copied().filter(|other| *other != effect).collect();
            let without =
                Simulation::new(Request { effects: EffectChoice::Only(others), ..request(kind, number) }).unwrap();
            if mean_difference(&auto, &without, 20) > MIN_DIFFERENCE {
                seen.push(effect);
            }
        }
    }
    seen.sort();
    assert_eq!(seen, EffectKind::ALL, "every effect must show in some scene");
}

/// Its coefficients cancel in the corners, but not between.
#[test]
fn a_lens_that_moves_the_image_by_two_pixels_is_not_left_out() {
    let size = ImageSize { width: 480, height: 270 };
    let simulation = Simulation::new(Request { size, frames: 2, ..request(SceneKind::Yards, 1520) }).unwrap();
    let lens = simulation.active_effects().iter().find(|active| active.effect == EffectKind::LensDistortion);
    let reason = "k1 = -0.028, k2 = 0.018 move the image by up to 0.48 % of its width";
    assert_eq!(lens.map(|active| active.reason.as_str()), Some(reason));
    let camera = simulation.camera(0).unwrap();
    assert!(camera.distortion != Distortion::None, "{camera:?}");
}

/// Its lens would fold at 0.96 of the way to the corners.
#[test]
fn a_lens_that_would_fold_inside_the_image_is_weakened() {
    let size = ImageSize { width: 64, height: 36 };
    let seed = SceneSeed { split: Split::Train, number: 292 };
    let simulation = Simulation::new(Request { size, frames: 2, ..Request::new(SceneKind::Rooms, seed) }).unwrap();
    let Distortion::OpenCv { k1, k2, .. } = simulation.camera(0).unwrap().distortion else { panic!("no lens") };
    Tolerance::absolute(1e-4).assert([k1, k2], [-0.0861 / 2.0, -0.0083 / 2.0], "half of the drawn lens");
    assert!(simulation.geometry(0).is_ok() && simulation.image(1).is_ok());
}

#[test]
fn depth_maps_agree_with_traced_covisibility() {
    for kind in SceneKind::ALL {
        let size = ImageSize { width: 192, height: 160 };
        let simulation = Simulation::new(Request { size, ..request(kind, 5) }).unwrap();
        let (a, b) = (simulation.geometry(10).unwrap(), simulation.geometry(11).unwrap());
        let (from, into) = (simulation.camera(10).unwrap(), simulation.camera(11).unwrap());
        let covisible = simulation.covisibility(10, 11).unwrap();
        assert!(covisible.overlap() > 0.8, "neighbouring frames overlap: {covisible:?}");
        for (a, from, b, into, expected) in
            [(&a, &from, &b, &into, covisible.first_in_second), (&b, &into, &a, &from, covisible.second_in_first)]
        {
            let found = by_depth_maps(a, from, b, into);
            Tolerance::absolute(0.08).assert([found], [expected], "co-visibility by depth maps");
        }
        let itself = simulation.covisibility(10, 10).unwrap().overlap();
        assert!(itself > 0.995, "an image overlaps with itself: {itself}");
        for (depth, (normal, instance)) in a.depth.iter().zip(a.normals.iter().zip(&a.instances)) {
            assert_eq!(depth.is_finite(), *instance > 0);
            let length = DVec3::from(normal.map(f64::from)).length();
            Tolerance::F32_ROUND_TRIP.assert([length], [if *instance > 0 { 1.0 } else { 0.0 }], "unit normals");
        }
    }
}

/// The usual estimate: points of one depth map looked up in the other. The depth of distant ground varies by several per
/// cent within a pixel.
fn by_depth_maps(a: &Geometry, from: &Camera, b: &Geometry, into: &Camera) -> f64 {
    let (mut surfaces, mut seen) = (0.0, 0.0);
    let rays = from.pixel_rays(a.size, atsplat_camera::DirectionScale::UnitDepth).unwrap();
    for (ray, depth) in rays.iter().zip(&a.depth).filter(|(_, depth)| depth.is_finite()) {
        surfaces += 1.0;
        let Ok(projected) = into.project(ray.at(f64::from(*depth))) else { continue };
        if projected.is_inside() {
            let pixel = projected.pixel(b.size).floor();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
            let there = b.depth[pixel.y as usize * b.size.width as usize + pixel.x as usize];
            let near = (projected.depth - f64::from(there)).abs() < 0.06 * projected.depth;
            seen += f64::from(u8::from(near));
        }
    }
    seen / surfaces
}

#[test]
fn a_given_route_keeps_its_shape() {
    let k = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
    let pose = |at: f64| {
        CameraFromWorld::new(DMat3::from_rotation_y(0.3 * at), DVec3::new(0.4 * at - 3.0, 0.05 * at, 0.2 * at)).unwrap()
    };
    let given: Vec<(i64, Camera)> =
        (0..5i32).map(|at| (i64::from(at) * 1000, Camera::pinhole(pose(f64::from(at)), k))).collect();
    let request = Request { route: Route::Given(given.clone()), ..request(SceneKind::Rooms, 8) };
    let simulation = Simulation::new(request).unwrap();
    assert_eq!(simulation.shots().len(), 5);
    for (shot, (timestamp, camera)) in simulation.shots().iter().zip(&given) {
        assert_eq!((shot.timestamp_micros, shot.camera.intrinsics), (*timestamp, k));
        let seen = |first: &Camera, camera: &Camera| {
            first.camera_from_world.inverse().camera_from_other(&camera.camera_from_world.inverse())
        };
        let expected = seen(&given[0].1, camera).scaled_by(simulation.slowed_to()).unwrap();
        let found = seen(&simulation.shots()[0].camera, &shot.camera);
        Tolerance::F64.assert(found.to_rows(), expected.to_rows(), "relative poses");
    }
    let up = simulation.shots()[0].camera.camera_from_world.inverse().down();
    Tolerance::F64.assert([up.z], [-1.0], "the first camera is upright");
}

/// The second camera is far outside until a thousand kilometres have shrunk to the size of a room.
#[test]
fn the_share_of_the_given_speed_is_that_of_the_chosen_place() {
    let k = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
    let at = |z: f64| Camera::pinhole(CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(0.0, 0.0, z)).unwrap(), k);
    let route = Route::Given(vec![(0, at(0.0)), (33_333, at(-1e6))]);
    let request = Request { route, effects: EffectChoice::None, ..request(SceneKind::Rooms, 8) };
    let simulation = Simulation::new(request).unwrap();
    let [first, last] = [0, 1].map(|shot: usize| simulation.shots()[shot].camera.camera_from_world.inverse().centre());
    Tolerance::relative(1e-9).assert([first.distance(last)], [1e6 * simulation.slowed_to()], "length of the path");
    assert!(first.distance(last) < 20.0, "both are in the house, {} m apart", first.distance(last));
}

#[test]
fn paths_keep_clear_of_objects_at_almost_the_drawn_speed() {
    let mut slowed = 0;
    for number in 0..16 {
        let kind = if number % 2 == 0 { SceneKind::Rooms } else { SceneKind::Yards };
        let wide = Request { effects: EffectChoice::None, ..request(kind, number) };
        let simulation = Simulation::new(wide).unwrap();
        slowed += u32::from(simulation.slowed_to() < 0.5);
        for frame in (0..simulation.shots().len()).step_by(12) {
            let geometry = simulation.geometry(frame).unwrap();
            let nearest = geometry.depth.iter().fold(f32::INFINITY, |least, d| if *d < least { *d } else { least });
            assert!(nearest > 0.12, "{} frame {frame}: something at {nearest} m", simulation.key());
        }
    }
    assert!(slowed <= 4, "{slowed} of 16 clips had to slow down by half");
}

#[test]
fn rejects_invalid_requests() {
    let message = |change: &dyn Fn(&mut Request)| {
        let mut request = request(SceneKind::Rooms, 0);
        change(&mut request);
        Simulation::new(request).unwrap_err().to_string()
    };
    assert!(message(&|r| r.frames = 0).starts_with("frames: expected at least 1"));
    assert!(message(&|r| r.size.width = 0).starts_with("size"));
    assert!(message(&|r| r.size.height = 1 << 20).starts_with("size"));
    assert!(message(&|r| r.samples = 0).starts_with("samples"));
    assert!(message(&|r| r.route = Route::Given(Vec::new())).starts_with("trajectory"));
    let simulation = Simulation::new(request(SceneKind::Rooms, 0)).unwrap();
    assert!(simulation.image(150).unwrap_err().to_string().contains("expected a frame below 150, found 150"));
}
