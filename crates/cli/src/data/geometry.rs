//! The geometry check of `data inspect`, in builds with OpenCV.

use atsplat_scene::{Dataset, Warnings};

#[cfg(feature = "opencv")]
pub(super) use atsplat_opencv::GeometryCheck as GeometryReport;

/// Checks at most `max_scenes` scenes, at least 1, evenly spread over the dataset, one after the other: OpenCV has its own
/// threads.
#[cfg(feature = "opencv")]
pub(super) fn check(
    dataset: &Dataset,
    max_scenes: usize,
    pairs: &[(usize, usize)],
    warnings: &mut Warnings,
) -> anyhow::Result<Vec<GeometryReport>> {
    use atsplat_numeric::spread;
    use atsplat_opencv::{GeometryCheckOptions, PairChoice, check_geometry};
    use atsplat_pixels::DecodeLimits;
    use atsplat_scene::{SceneSource as _, WarningKind};

    let keys = dataset.keys();
    let limits = DecodeLimits::default();
    let mut options = GeometryCheckOptions::default();
    if !pairs.is_empty() {
        options.pairs = PairChoice::Listed(pairs.to_vec());
    }
    let mut reports = Vec::new();
    for key in spread(keys.len(), max_scenes).into_iter().map(|at| &keys[at]) {
        let scene = match dataset.load(key, warnings) {
            Ok(scene) => scene,
            Err(error) => {
                warnings.push(WarningKind::UnreadableScene, key, error.to_string());
                continue;
            }
        };
        reports.push(check_geometry(&scene, |frame| scene.decode_any_shape(frame, &limits), &options, warnings)?);
    }
    Ok(reports)
}

/// Builds without OpenCV have no such report.
#[cfg(not(feature = "opencv"))]
#[derive(Debug, serde::Serialize)]
pub(super) enum GeometryReport {}

#[cfg(not(feature = "opencv"))]
impl std::fmt::Display for GeometryReport {
    fn fmt(&self, _: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {}
    }
}

#[cfg(not(feature = "opencv"))]
pub(super) fn check(
    _: &Dataset,
    _: usize,
    _: &[(usize, usize)],
    _: &mut Warnings,
) -> anyhow::Result<Vec<GeometryReport>> {
    Err(super::needs_opencv("--check-geometry"))
}
