//! Methods under evaluation that are written in Python.

use std::sync::Arc;

use atsplat_eval::method::{Cost, Method, MethodError, Prediction, Rendered, Splatting, TrialInput, check_range};
use atsplat_protocol::trial::Trial;
use atsplat_results::MethodRecord;
use atsplat_splat::Problem;

use crate::array::Images;
use crate::exchange::Calls;

/// What a method made of a trial.
#[derive(Debug)]
pub(crate) enum Output {
    /// An image of each target.
    Images(Images),
    /// Gaussians in the trial's world.
    Gaussians(Arc<atsplat_splat::Gaussians>),
}

/// A Python callable.
#[derive(Debug)]
pub(crate) struct PythonMethod {
    record: MethodRecord,
    setting: String,
    splatting: Splatting,
    /// An argument of the evaluation that requires Gaussians, if one is given.
    chosen: Option<&'static str>,
    calls: Calls,
}

impl PythonMethod {
    pub(crate) const fn new(
        record: MethodRecord,
        setting: String,
        splatting: Splatting,
        chosen: Option<&'static str>,
        calls: Calls,
    ) -> Self {
        Self { record, setting, splatting, chosen, calls }
    }
}

impl Method for PythonMethod {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn setting(&self) -> &str {
        &self.setting
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let output = self.calls.call(input.trial)?;
        // The record states how they are rendered.
        if let (Output::Images(_), Some(argument)) = (&output, self.chosen) {
            return Err(MethodError::Failed(format!("expected Gaussians, because {argument} is given, found images")));
        }
        prediction(&self.splatting, input, output)
    }
}

/// Output that was computed before, of one trial.
#[derive(Debug)]
pub(crate) struct Precomputed {
    record: MethodRecord,
    setting: String,
    splatting: Splatting,
    output: Output,
}

impl Precomputed {
    /// `setting` is that of the trial, whose renderer it also chooses.
    pub(crate) fn new(record: MethodRecord, setting: String, output: Output) -> Self {
        Self { record, setting, splatting: Splatting::default(), output }
    }
}

impl Method for Precomputed {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn setting(&self) -> &str {
        &self.setting
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let output = match &self.output {
            Output::Images(images) => Output::Images(images.clone()),
            Output::Gaussians(gaussians) => Output::Gaussians(Arc::clone(gaussians)),
        };
        prediction(&self.splatting, input, output)
    }
}

fn prediction<'a>(
    splatting: &'a Splatting,
    input: TrialInput<'a>,
    output: Output,
) -> Result<Box<dyn Prediction + 'a>, MethodError> {
    match output {
        Output::Images(images) => {
            check(input.trial, &images)?;
            Ok(Box::new(images))
        }
        Output::Gaussians(gaussians) => {
            check_numbers(&gaussians)?;
            Ok(splatting.predict(input, Arc::unwrap_or_clone(gaussians), Cost::default()))
        }
    }
}

/// No NaN, which renderers would leave out. Other Gaussians that they do not draw are in the trial's notes.
fn check_numbers(gaussians: &atsplat_splat::Gaussians) -> Result<(), MethodError> {
    let found = gaussians.validate();
    let nan = found.findings.iter().filter(|finding| finding.problem == Problem::NotANumber);
    let nan: Vec<String> = nan.map(ToString::to_string).collect();
    if nan.is_empty() {
        return Ok(());
    }
    Err(MethodError::Failed(format!("Gaussians: {}, of {}", nan.join("; "), found.total)))
}

/// One image of each target, of its size.
fn check(trial: &Trial, images: &Images) -> Result<(), MethodError> {
    let Images { count, width, height, .. } = *images;
    let targets = trial.targets();
    let mut sizes: Vec<String> =
        targets.iter().map(|target| format!("{} × {}", target.size.height, target.size.width)).collect();
    sizes.dedup();
    let size = if sizes.len() == 1 { sizes.concat() } else { format!("({})", sizes.join(", ")) };
    let (expected, found) = (format!("{} × {size} × 3", targets.len()), format!("{count} × {height} × {width} × 3"));
    if expected == found {
        return Ok(());
    }
    Err(MethodError::Failed(format!("images: expected targets × height × width × 3 of {expected}, found {found}")))
}

impl Prediction for Images {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |at: &usize| {
            let image = self.image(*at).map_err(|error| error.to_string())?;
            check_range(&image)?;
            Ok(Rendered { image, drawn: None, effects: Vec::new() })
        };
        targets.iter().map(one).collect()
    }
}
