//! What imported images cost, as their user states it.

use atsplat_files::InvalidText;
use atsplat_results::{StatedCost, StatedSeconds};

use crate::parse;
use crate::requirements::GivenOption;

#[derive(Debug, clap::Args)]
pub(super) struct StatedCostArgs {
    /// Mean number of Gaussians of a trial under the command's protocols, for tables and `tradeoff`: images do not contain it. Tables
    /// say that it was stated.
    #[arg(id = "stated-gaussians", long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    gaussians: Option<u64>,

    /// Mean seconds of a trial, from its context images to Gaussians, measured on the machine of --stated-machine. They are shown with
    /// and compared with those of other methods for which the same machine is stated, unless something was timed here.
    #[arg(id = "stated-seconds", long, value_name = "SECONDS", value_parser = parse::stated_seconds, requires = "stated-machine")]
    encode: Option<f64>,

    /// Mean seconds per rendered image on the same machine. Without it, the time to the first image is that of the Gaussians alone, and
    /// `tradeoff` says so.
    #[arg(id = "stated-render-seconds", long, value_name = "SECONDS", value_parser = parse::stated_seconds, requires = "stated-seconds")]
    render: Option<f64>,

    /// Name of the machine of the stated seconds, such as "NVIDIA A100".
    #[arg(id = "stated-machine", long, value_name = "NAME", value_parser = machine_name, requires = "stated-seconds")]
    machine: Option<String>,
}

impl StatedCostArgs {
    pub(super) fn options(&self) -> [GivenOption; 4] {
        [
            ("--stated-gaussians", self.gaussians.is_some()),
            ("--stated-seconds", self.encode.is_some()),
            ("--stated-render-seconds", self.render.is_some()),
            ("--stated-machine", self.machine.is_some()),
        ]
    }

    /// `None` if nothing is stated.
    pub(super) fn cost(&self) -> Option<StatedCost> {
        let seconds = self.encode.zip(self.machine.clone());
        let seconds = seconds.map(|(encode, machine)| StatedSeconds { encode, render: self.render, machine });
        let is_stated = self.gaussians.is_some() || seconds.is_some();
        is_stated.then_some(StatedCost { gaussians: self.gaussians, seconds })
    }
}

fn machine_name(text: &str) -> Result<String, InvalidText> {
    parse::short_line(text, "a name of at most 80 characters")
}
