//! Pictures, windows and railings. The frame is a wall's: x along it, +y into the room.

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::plants::rod;
use super::shell::Opening;
use super::{glossy, matte};
use crate::material::Pattern;
use crate::noise::as_f32;
use crate::rng::Rng;
use crate::shape::Shape;
use crate::world::Builder;

/// A framed painting or a panel with text, centred at `centre` on the wall.
pub(super) fn picture(b: &mut Builder, rng: &mut Rng, centre: DVec3) {
    let half = Vec2::new(0.18 + 0.4 * as_f32(rng.unit()), 0.16 + 0.3 * as_f32(rng.unit()));
    let [light, dark] = rng.wood();
    let frame = b.material(glossy(rng, Pattern::Planks { a: light, b: dark * 0.5, width: 0.2, length: 3.0 }, 0.04));
    let [ink, paper] = rng.pair();
    let shown = if rng.chance(0.72) {
        Pattern::Painting { half }
    } else {
        Pattern::Text {
            ink: ink * 0.15,
            paper: paper.lerp(Vec3::ONE, 0.6),
            half,
            line: 0.02 + 0.05 * as_f32(rng.unit()),
        }
    };
    let glass = if rng.chance(0.4) { 0.04 } else { 0.0 };
    let shown = b.material(glossy(rng, shown, glass));
    let (x, z, rim) = (f64::from(half.x), f64::from(half.y), rng.within(0.015, 0.05));
    b.put(Shape::Box(DVec3::new(x, 0.012, z)), centre + DVec3::Y * 0.012, shown);
    for side in [-1.0, 1.0] {
        b.put(
            Shape::Box(DVec3::new(rim, 0.02, z + 2.0 * rim)),
            centre + DVec3::new(side * (x + rim), 0.02, 0.0),
            frame,
        );
        b.put(Shape::Box(DVec3::new(x, 0.02, rim)), centre + DVec3::new(0.0, 0.02, side * (z + rim)), frame);
    }
}

/// The frame, bars, sill and perhaps blinds or curtains of a window.
pub(super) fn window(b: &mut Builder, rng: &mut Rng, opening: Opening, thick: f64) {
    let white = b.material(matte(rng, Pattern::Plain(Vec3::splat(0.7))));
    let ([left, right], [low, high]) = (opening.along, opening.height);
    let (width, height) = (right - left, high - low);
    let middle = DVec3::new((left + right) * 0.5, thick * 0.5, (low + high) * 0.5);
    for x in [left + 0.03, right - 0.03] {
        b.put(Shape::Box(DVec3::new(0.03, 0.03, height * 0.5)), DVec3::new(x, thick * 0.5, middle.z), white);
    }
    for z in [low + 0.03, high - 0.03] {
        b.put(Shape::Box(DVec3::new(width * 0.5 - 0.06, 0.03, 0.03)), DVec3::new(middle.x, thick * 0.5, z), white);
    }
    let panes = rng.count(1, 4);
    for bar in 1..panes {
        let x = left + width * bar as f64 / panes as f64;
        b.put(Shape::Box(DVec3::new(0.012, 0.012, height * 0.5 - 0.06)), DVec3::new(x, thick * 0.5, middle.z), white);
    }
    b.block(DVec3::new(left - 0.05, thick - 0.02, low - 0.03), DVec3::new(right + 0.05, thick + 0.14, low), white);
    let slats = rng.chance(0.3);
    if slats {
        let drop = rng.within(0.3, 1.0) * height;
        let tilt = DMat3::from_rotation_x(rng.within(-0.7, 0.7));
        for slat in 0..count(drop / 0.045) {
            let z = high - 0.03 - 0.045 * f64::from(slat);
            let shape = Shape::Box(DVec3::new(width * 0.5, 0.02, 0.0012));
            b.put_turned(shape, DVec3::new(middle.x, thick + 0.03, z), tilt, white);
        }
        for x in [left + 0.15, right - 0.15] {
            rod(b, DVec3::new(x, thick + 0.03, high - drop), DVec3::new(x, thick + 0.03, high), 0.002, white);
        }
    } else if rng.chance(0.6) {
        let [x, y] = rng.pair();
        let cloth = b.material(matte(rng, Pattern::Weave { a: x, b: y, period: 0.02 }));
        for (from, sign) in [(left - 0.25, 1.0), (right + 0.25, -1.0)] {
            for fold in 0..7 {
                let x = from + sign * 0.06 * f64::from(fold);
                let shape = Shape::Cylinder { radius: 0.034, half_height: (high + 0.1 - 0.05) * 0.5 };
                b.put(shape, DVec3::new(x, thick + 0.08 + 0.015 * f64::from(fold % 2), (high + 0.15) * 0.5), cloth);
            }
        }
        let (from, to) =
            (DVec3::new(left - 0.4, thick + 0.08, high + 0.14), DVec3::new(right + 0.4, thick + 0.08, high + 0.14));
        rod(b, from, to, 0.012, white);
    }
}

/// A railing of thin balusters between two points on the floor.
pub(super) fn railing(b: &mut Builder, rng: &mut Rng, from: DVec3, to: DVec3) {
    let grey = if rng.chance(0.6) { 0.03 } else { 0.6 };
    let iron = b.material(glossy(rng, Pattern::Plain(Vec3::splat(grey)), 0.08));
    let height = DVec3::Z * rng.within(0.85, 1.05);
    let posts = count((to - from).length() / rng.within(0.1, 0.16)) + 1;
    for post in 0..=posts {
        let foot = from.lerp(to, f64::from(post) / f64::from(posts));
        let radius = if post == 0 || post == posts { 0.025 } else { 0.008 };
        rod(b, foot, foot + height, radius, iron);
    }
    rod(b, from + height, to + height, 0.025, iron);
    rod(b, from + height * 0.1, to + height * 0.1, 0.012, iron);
}

/// Number of whole steps that fit.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a small count")]
fn count(steps: f64) -> u32 {
    steps.clamp(1.0, 400.0) as u32
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn bars_divide_a_window_evenly() {
        let opening = Opening { along: [0.4, 2.0], height: [0.9, 2.1] };
        let mut windows = [0; 4];
        for seed in 0..60 {
            let (mut b, mut rng) = (Builder::new(), Rng::new(seed));
            b.instance(DVec3::ZERO, 0.0);
            window(&mut b, &mut rng, opening, 0.16);
            let world = b.finish(crate::build::sky(&mut rng, 1.0), Vec3::ONE, [DVec3::ZERO, DVec3::ONE]);
            let is_bar = |shape: Shape| matches!(shape, Shape::Box(half) if (half.x - 0.012).abs() < 1e-9);
            let bars = world.objects.iter().filter(|object| is_bar(object.shape)).map(|object| object.centre.x);
            let bars: Vec<f64> = bars.collect();
            windows[bars.len()] += 1;
            let pane = 1.6 / (bars.len() + 1) as f64;
            let even = (1..=bars.len()).map(|bar| 0.4 + pane * bar as f64);
            Tolerance::F64.assert(bars.iter().copied(), even, &format!("seed {seed}"));
        }
        assert!(windows.iter().all(|count| *count > 0), "{windows:?}");
    }
}
