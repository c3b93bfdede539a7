//! Trains a network as a configuration says and resumes where an earlier call stopped:
//! `train_in_folder CONFIG.toml FOLDER STEPS [PROCESSOR]`, the processor as `atsplat train --device` takes it.

#![expect(clippy::print_stdout, reason = "an example prints its progress")]

use std::path::Path;

use atsplat_model::network::Processor;
use atsplat_train::{Event, Limits, Start, TrainConfig, Trainer};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [config, folder, steps, processor @ ..] = arguments.as_slice() else {
        return Err("usage: train_in_folder CONFIG.toml FOLDER STEPS [PROCESSOR]".into());
    };
    let processor: Processor = processor.first().map_or(Ok(Processor::Cpu), |name| name.parse())?;
    let folder = Path::new(folder);
    let start = if folder.exists() { Start::Resume } else { Start::Fresh };
    let mut trainer = Trainer::on(processor, None, TrainConfig::read(Path::new(config))?, folder, &start)?;
    let limits = Limits { steps: Some(steps.parse()?), ..Limits::default() };
    let finished = trainer.run(limits, &mut |event| {
        if let Event::Step(step) = event {
            println!("{step:?}");
        }
    })?;
    trainer.write_checkpoint()?;
    println!("{}: {}", folder.display(), if finished { "finished" } else { "can be resumed" });
    Ok(())
}
