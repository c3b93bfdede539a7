//! `--round-trip`: what Gaussians lose when they are exported and imported again.

use anyhow::Context as _;
use atsplat_splat::Renderer;
use atsplat_splat::files::Output;
use atsplat_splat::round_trip::RoundTrips;

use super::inputs::Inputs;
use crate::progress::Progress;

/// Measures the loss of these formats, if there are any. The images are already written: a failure is recorded with them.
pub(super) fn measure(renderer: &mut dyn Renderer, inputs: &Inputs, formats: &[Output]) -> Option<RoundTrips> {
    if formats.is_empty() {
        return None;
    }
    let measured = try_measure(renderer, inputs, formats);
    Some(measured.unwrap_or_else(|error| RoundTrips::failed(format!("--round-trip: {error:#}"))))
}

fn try_measure(
    renderer: &mut dyn Renderer,
    Inputs { gaussians, requests, settings, .. }: &Inputs,
    formats: &[Output],
) -> anyhow::Result<RoundTrips> {
    let views: Vec<_> = requests.iter().map(|request| (request.view, request.exposed(&settings.options))).collect();
    let temporary = std::env::temp_dir();
    let scratch = tempfile::tempdir_in(&temporary)
        .with_context(|| format!("creating a folder for the round trip in {}", temporary.display()))?;
    let progress = Progress::new("views of the round trip", views.len());
    Ok(RoundTrips::measure(renderer, gaussians, &views, formats, scratch.path(), &mut || progress.step())?)
}
