//! Goes through a protocol's trials as an evaluation does: `iterate_trials PRESET DATA INDEX.json`. For each trial a method gets
//! the context views, with images, and the cameras of the target views.

#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::path::Path;
use std::sync::Arc;

use atsplat_protocol::trial::{Prefetch, TrialRecipe, Trials};
use atsplat_protocol::{IndexFile, Preset};
use atsplat_scene::Warnings;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [preset, data, index] = arguments.as_slice() else {
        anyhow::bail!("usage: iterate_trials PRESET DATA INDEX.json")
    };
    let preset = Preset::resolve(preset)?;
    let index = IndexFile::read(Path::new(index))?.index;
    let mut warnings = Warnings::new();
    let dataset = Arc::new(atsplat_scene::open(data, &mut warnings)?);

    let mut trials = Trials::new(dataset, &index, TrialRecipe::of(&preset, "my method"), Prefetch::default());
    for trial in &mut trials {
        match trial {
            Ok((trial, truth)) => {
                println!(
                    "{}: {} context views, {} targets",
                    trial.scene(),
                    trial.context().len(),
                    trial.targets().len()
                );
                for view in trial.context() {
                    let image = view.image()?;
                    let centre = view.camera.camera_from_world.inverse().centre();
                    println!("  frame {}: {}x{}, camera at {centre:.3}", view.frame, image.width(), image.height());
                }
                println!("  {} images to compare with", truth.len());
            }
            Err(skipped) => println!("{}: skipped, {}", skipped.scene, skipped.detail),
        }
    }
    for (kind, count) in warnings.counts() {
        println!("warning: {count} × {kind}");
    }
    Ok(())
}
