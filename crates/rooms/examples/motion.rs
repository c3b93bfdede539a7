//! How simulated RE10K-like clips move, beside the eleven real ones of `data/re10k_motion.json`: quantiles.
//!
//! `cargo run --release -p atsplat-rooms --example motion -- [CLIPS]`

#![expect(clippy::print_stdout, reason = "an example prints its table")]

use atsplat_camera::ImageSize;
use atsplat_rooms::{EffectChoice, Motion, Request, SceneKind, SceneSeed, Shot, Simulation, Split};

const MEASURES: [&str; 6] = ["speed", "turn °/s", "straightness", "baseline 45", "baseline 90", "baseline 135"];

fn main() -> anyhow::Result<()> {
    let clips: u32 = std::env::args().nth(1).map_or(Ok(64), |word| word.parse())?;
    let mut measured: [Vec<f64>; 6] = Default::default();
    let mut slowed = 0;
    for number in 0..clips {
        let request = Request::new(SceneKind::Rooms, SceneSeed { split: Split::Train, number });
        let size = ImageSize { width: 8, height: 8 };
        let simulation = Simulation::new(Request { size, effects: EffectChoice::None, ..request })?;
        slowed += u32::from(simulation.slowed_to() < 0.999);
        for (held, value) in measured.iter_mut().zip(measure(simulation.shots())) {
            held.push(value);
        }
    }
    println!("{clips} clips of 150 frames; {slowed} move slower than drawn, to fit their rooms");
    println!("{:14} {:>8} {:>8} {:>8} {:>8} {:>8}", "quantile", "10 %", "25 %", "50 %", "75 %", "90 %");
    for (name, values) in MEASURES.into_iter().zip(&mut measured) {
        values.sort_by(f64::total_cmp);
        row(&format!("simulated {name}"), values);
    }
    for (name, motion) in [("speed", Motion::SPEED), ("turn °/s", Motion::TURN), ("straightness", Motion::STRAIGHTNESS)]
    {
        row(&format!("real {name}"), &motion.observed);
    }
    Ok(())
}

fn row(name: &str, sorted: &[f64]) {
    print!("{name:24}");
    for percent in [10, 25, 50, 75, 90] {
        let value = sorted.get((sorted.len() - 1) * percent / 100).copied().unwrap_or(f64::NAN);
        print!(" {value:8.3}");
    }
    println!();
}

/// As `data/measure_motion.py` measures: at steps of a quarter and half a second.
fn measure(shots: &[Shot]) -> [f64; 6] {
    let poses: Vec<_> = shots.iter().map(|shot| shot.camera.camera_from_world.inverse()).collect();
    let seconds = |frames: usize| frames as f64 / 30.0;
    let steps: Vec<_> = poses.iter().step_by(7).collect();
    let pairs = || steps.iter().zip(steps.iter().skip(1));
    let arc: f64 = pairs().map(|(a, b)| a.centre().distance(b.centre())).sum();
    let turned: f64 = pairs()
        .map(|(a, b)| (a.rotation().transpose() * b.rotation()).to_cols_array_2d())
        .map(|m| (0.5 * (m[0][0] + m[1][1] + m[2][2] - 1.0)).clamp(-1.0, 1.0).acos().to_degrees())
        .sum();
    let span = seconds((steps.len().max(2) - 1) * 7);
    let chord = steps.first().zip(steps.last()).map_or(0.0, |(a, b)| a.centre().distance(b.centre()));
    let baseline = |frames: usize| {
        let pairs = poses.iter().zip(poses.iter().skip(frames));
        let (sum, count) = pairs.fold((0.0, 0), |(sum, n), (a, b)| (sum + a.centre().distance(b.centre()), n + 1));
        sum / f64::from(count)
    };
    [arc / span, turned / span, chord / arc, baseline(45), baseline(90), baseline(135)]
}
