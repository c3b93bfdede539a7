use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

use atsplat_protocol::trial::Trial;
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_results::MethodRecord;
use atsplat_splat::files::ImportReport;
use atsplat_splat::{Gaussians, RasterMode, ShAxes, files};

use super::scene_names::SceneNames;
use super::splatting::{Splatting, parameters};
use super::{
    Cost, FoundFiles, Layout, Method, MethodError, Prediction, RequestedScene, Timed, TrialInput, below, folder_name,
    is_absent, is_file,
};
use crate::suspicious_notes::SuspiciousNote;
use crate::{EvalError, GaussianFrame};

/// Gaussians written by another program, one file per scene:
/// `<scene>.ply`, `<scene>/gaussians.ply`, `<scene>/point_cloud.ply`, or the same with `.spz` or `.splat`, or as 3DGS writes it
/// `<scene>/point_cloud/iteration_30000/point_cloud.ply`. If an index has several entries of a scene, the file of the first is named
/// `<scene>-0`, that of the second `<scene>-1`, and so on; that of an only entry `<scene>` or `<scene>-0`. The name of a scene of the
/// index refers to that scene alone. A scene with two of these files that differ in more than their extension, such as those of two
/// iterations, is a failed trial, and so is one where the system does not tell which of them there are.
#[derive(Clone, Debug)]
pub struct Ply {
    folder: PathBuf,
    name: String,
    title: Option<String>,
    names: SceneNames,
    frame: GaussianFrame,
    /// Whether a PLY file stores opacities themselves instead of logits.
    opacities_as_stored: bool,
    splatting: Splatting,
    /// The published method whose settings it has; `None` for the preset's own.
    setting: Option<String>,
    deterministic: bool,
}

impl Ply {
    /// The files below a folder; `name` is the method's name in the rows, by default the folder's.
    ///
    /// # Errors
    /// [`EvalError::Io`] if the folder cannot be read.
    pub fn new(
        folder: &Path,
        name: Option<&str>,
        frame: GaussianFrame,
        opacities_as_stored: bool,
        splatting: Splatting,
    ) -> Result<Self, EvalError> {
        fs::read_dir(folder).map_err(EvalError::io("reading the folder of Gaussians", folder))?;
        let name = name.map_or_else(|| folder_name(folder), str::to_owned);
        let names = SceneNames::default().below(folder);
        Ok(Self {
            folder: folder.to_owned(),
            name,
            title: None,
            names,
            frame,
            opacities_as_stored,
            splatting,
            setting: None,
            deterministic: false,
        })
    }

    /// Chooses the published method whose pose normalisation, planes and renderer the Gaussians have, as [`Method::setting`]; `None`
    /// for the preset's own, with a warning under presets that list others for a method of this name.
    #[must_use]
    pub fn with_setting(self, setting: Option<&str>) -> Self {
        Self { setting: setting.map(str::to_owned), ..self }
    }

    /// Its title in tables and plots; by default its name.
    #[must_use]
    pub fn titled(self, title: Option<&str>) -> Self {
        Self { title: title.map(str::to_owned), ..self }
    }

    /// Declares that whatever made the Gaussians gives the same bits every time. Nobody can tell that from files.
    #[must_use]
    pub fn deterministic(self, deterministic: bool) -> Self {
        Self { deterministic, ..self }
    }

    fn find(&self, trial: &Trial) -> Result<PathBuf, String> {
        let (scene, entry) = (trial.scene(), trial.entry_number());
        let names = self.names.accepted(scene, entry);
        let all = names.iter().flat_map(|name| candidates(&self.folder, name, scene, &self.names));
        let mut found = Vec::new();
        for (path, _) in all {
            if is_file(&path)? {
                found.push(path);
            }
        }
        for name in &names {
            let trained = trained(&self.folder, name, scene, &self.names)?;
            found.extend(trained.into_iter().map(|(path, _)| path));
        }
        let Some((first, others)) = found.split_first() else {
            let (folder, note) = (self.folder.display(), self.names.note(scene, entry));
            let (request, name) = (self.names.request(scene, entry), self.names.expected(scene, entry));
            return Err(format!(
                "no Gaussians of scene {scene}: {request} {name}.ply or {name}/gaussians.ply below {folder}{note}"
            ));
        };
        match others.iter().find(|other| other.with_extension("") != first.with_extension("")) {
            Some(other) => {
                let (first, other) = (first.display(), other.display());
                Err(format!("two files of Gaussians of scene {scene}: {first} and {other}"))
            }
            None => Ok(first.clone()),
        }
    }

    /// The Gaussians in the trial's world frame, and remarks on their file; `axes` are those of their spherical harmonics.
    fn read(&self, trial: &Trial, axes: ShAxes) -> Result<(Gaussians, Vec<String>), String> {
        let path = self.find(trial)?;
        let (mut gaussians, notes) = read(&path, &path, self.opacities_as_stored, self.splatting.mode)?;
        if self.frame == GaussianFrame::Dataset {
            let moved = gaussians.transformed_in(&trial.normalisation().new_from_old, axes);
            gaussians = moved.map_err(|error| error.to_string())?;
        }
        Ok((gaussians, notes))
    }

    /// Length in the trial's world of the unit of the Gaussians' frame.
    const fn unit(&self, trial: &Trial) -> f64 {
        match self.frame {
            GaussianFrame::Dataset => trial.normalisation().new_from_old.scale,
            GaussianFrame::Trial => 1.0,
        }
    }
}

/// The files that [`candidates`] and [`trained`] look for, in words.
const EXPECTED: &str = "SCENE.ply, SCENE/gaussians.ply or SCENE/point_cloud.ply, or .spz or .splat, or \
                        SCENE/point_cloud/iteration_30000/point_cloud.ply";

/// Candidate files of a scene under one of its names in order of preference, each with what follows the name.
fn candidates(folder: &Path, name: &str, scene: &str, names: &SceneNames) -> impl Iterator<Item = (PathBuf, String)> {
    let stems = ["", "/gaussians", "/point_cloud"].into_iter();
    let stems = stems.filter(move |stem| names.may_be_of(scene, &format!("{name}{stem}")));
    let endings = stems.flat_map(|stem| files::EXTENSIONS.map(|extension| format!("{stem}.{extension}")));
    endings.filter_map(move |ending| Some((below(folder, &format!("{name}{ending}"))?, ending)))
}

/// The files of each iteration that the trainer of 3DGS has saved, each with what follows the scene's name.
///
/// # Errors
/// The system's error if the folder cannot be read.
fn trained(folder: &Path, name: &str, scene: &str, names: &SceneNames) -> Result<Vec<(PathBuf, String)>, String> {
    let Some(parent) = below(folder, &format!("{name}/point_cloud")) else { return Ok(Vec::new()) };
    let failed = |error: io::Error| format!("{error} ({})", parent.display());
    let entries = match fs::read_dir(&parent) {
        Err(error) if is_absent(&error) => return Ok(Vec::new()),
        entries => entries.map_err(failed)?,
    };
    let mut iterations = Vec::new();
    for entry in entries {
        let Ok(iteration) = entry.map_err(failed)?.file_name().into_string() else { continue };
        let stem = format!("/point_cloud/{iteration}/point_cloud");
        if iteration.starts_with("iteration_") && names.may_be_of(scene, &format!("{name}{stem}")) {
            iterations.push((parent.join(iteration).join("point_cloud.ply"), format!("{stem}.ply")));
        }
    }
    iterations.sort();
    let mut found = Vec::new();
    for (path, ending) in iterations {
        if is_file(&path)? {
            found.push((path, ending));
        }
    }
    Ok(found)
}

/// How a scene's Gaussians are stored below a folder.
fn layout(folder: &Path, requested: &RequestedScene<'_>, names: &SceneNames) -> Result<Option<Layout>, String> {
    let scene = requested.scene;
    for name in names.accepted(scene, 0) {
        let layout = |ending: &str| Layout(format!("SCENE{}{ending}", if name == scene { "" } else { "-0" }));
        for (path, ending) in candidates(folder, &name, scene, names) {
            if is_file(&path)? {
                return Ok(Some(layout(&ending)));
            }
        }
        if let Some((_, ending)) = trained(folder, &name, scene, names)?.first() {
            return Ok(Some(layout(ending)));
        }
    }
    Ok(None)
}

/// The Gaussians of a file, which remarks call `name`, and remarks on it. With `as_stored`, a PLY file contains opacities
/// instead of logits. `mode` is the one that was chosen for drawing them, if any was.
pub(super) fn read(
    path: &Path,
    name: &Path,
    as_stored: bool,
    mode: Option<RasterMode>,
) -> Result<(Gaussians, Vec<String>), String> {
    let (gaussians, import) = files::read(path).map_err(|error| error.to_string())?;
    let mut notes = notes(&import, name);
    if import.antialiased == Some(true) && mode.is_none() {
        let kind = SuspiciousNote::DrawnClassic;
        notes.push(format!(
            "{kind}: the file says that its Gaussians were trained with antialiasing; see --mode antialiased of run and score, in \
             Python antialiased=True"
        ));
    }
    let interpreted = files::interpret(gaussians, &import, as_stored, path).map_err(|error| error.to_string())?;
    notes.extend(interpreted.1);
    Ok((interpreted.0, notes))
}

/// Defects of a file that do not prevent rendering.
fn notes(import: &ImportReport, path: &Path) -> Vec<String> {
    let mut notes = Vec::new();
    let found = &import.validation;
    if !found.is_clean() {
        let kinds: Vec<String> = found.findings.iter().map(ToString::to_string).collect();
        let (kinds, path) = (kinds.join("; "), path.display());
        let as_stored = found.invalid.saturating_sub(found.rejected + found.repaired);
        let outcomes = [
            (found.rejected, "with NaN not drawn"),
            (found.repaired, "repaired"),
            (as_stored, "drawn only if the renderer can"),
        ];
        let outcomes = outcomes.into_iter().filter(|(count, _)| *count > 0);
        let outcomes: Vec<String> = outcomes.map(|(count, outcome)| format!("{count} {outcome}")).collect();
        let (invalid, total, outcomes) = (found.invalid, found.total, outcomes.join(", "));
        let broken = SuspiciousNote::BrokenGaussians;
        notes.push(format!("{broken}: {invalid} of {total} ({outcomes}): {kinds} ({path})"));
    }
    if !import.unused.is_empty() {
        notes.push(format!("unused parts of a file: {} ({})", import.unused.join(", "), path.display()));
    }
    notes
}

impl Method for Ply {
    fn record(&self) -> MethodRecord {
        let mut record = MethodRecord {
            name: self.name.clone(),
            kind: "ply".to_owned(),
            title: self.title.as_ref().unwrap_or(&self.name).clone(),
            parameters: parameters([
                ("folder", self.folder.display().to_string().into()),
                ("frame", self.frame.name().into()),
                ("opacities-as-stored", self.opacities_as_stored.into()),
            ]),
            ..MethodRecord::default()
        };
        self.splatting.describe(&mut record);
        if self.frame == GaussianFrame::Dataset && self.splatting.constants.changes_planes() {
            record.parameters.insert("planes".to_owned(), "in the dataset's unit".into());
        }
        // Records of stores without a chosen setting stay as they are.
        if self.setting.is_some() {
            record.record_setting(self.setting.as_deref());
        }
        record.deterministic &= self.deterministic;
        record
    }

    fn setting(&self) -> &str {
        self.setting.as_deref().unwrap_or(Preset::OWN_METHOD)
    }

    fn has_no_chosen_setting(&self) -> bool {
        self.setting.is_none()
    }

    fn files(&self, trial: &Trial) -> Vec<Option<PathBuf>> {
        vec![self.find(trial).ok()]
    }

    fn for_scenes_of(&self, indices: &[&EvaluationIndex]) -> Option<Arc<dyn Method>> {
        Some(Arc::new(Self { names: self.names.among(indices), ..self.clone() }))
    }

    fn find_files(&self, requested: &[RequestedScene<'_>]) -> Option<FoundFiles> {
        // One file is for all frames.
        let requested: Vec<_> = requested.iter().map(|of| RequestedScene { frames: &[], ..*of }).collect();
        Some(FoundFiles::of(("folder of Gaussians", EXPECTED), &self.folder, &self.names, &requested, layout))
    }

    fn timed(&self) -> Timed {
        Timed::RENDERING
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let constants = self.splatting.constants_in(input, self.unit(input.trial));
        let (gaussians, notes) = self.read(input.trial, constants.sh_axes).map_err(MethodError::Failed)?;
        Ok(self.splatting.predict_with(input, gaussians, constants, Cost { notes, ..Cost::default() }))
    }
}

#[cfg(test)]
mod tests {
    use atsplat_splat::GaussianParts;
    use atsplat_splat::files::Output;

    use super::*;

    #[test]
    fn files_of_every_extension_are_looked_for_and_named_in_messages() {
        let names = SceneNames::default();
        let found: Vec<String> =
            candidates(Path::new("f"), "a", "a", &names).map(|(path, _)| path.display().to_string()).collect();
        for extension in files::EXTENSIONS {
            assert!(found.contains(&format!("f/a.{extension}")), "{extension}: {found:?}");
            assert!(found.contains(&format!("f/a/gaussians.{extension}")), "{extension}: {found:?}");
            assert!(EXPECTED.contains(&format!(".{extension}")), "{extension}");
        }
    }

    /// Tables look for the notes by their beginnings.
    #[test]
    fn suspicions_about_a_file_are_known_to_tables() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let parts = GaussianParts {
            means: vec![[0.0, 0.0, 2.0]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.5; 3]],
            opacity_logits: vec![0.75],
            sh: vec![[0.25, 0.5, 0.0]],
            ..GaussianParts::default()
        };
        let gaussians = Gaussians::new(parts).unwrap();
        files::write(&path, &gaussians, Output::Ply(files::Encoding::BinaryLittleEndian)).unwrap();
        let (_, noted) = read(&path, Path::new("a.ply"), false, None).unwrap();
        let expected = [SuspiciousNote::Opacities, SuspiciousNote::LogScales, SuspiciousNote::Colours];
        assert_eq!(noted.len(), expected.len(), "{noted:?}");
        assert!(noted.iter().zip(expected).all(|(note, kind)| kind.is(note)), "{noted:?}");
    }

    #[test]
    fn a_file_of_antialiased_training_is_noted_unless_a_mode_is_chosen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.spz");
        let parts = GaussianParts {
            means: vec![[0.0, 0.0, 2.0]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-2.0; 3]],
            opacity_logits: vec![2.0],
            sh: vec![[0.5; 3]],
            ..GaussianParts::default()
        };
        let notes = |antialiased, mode| {
            files::write(&path, &Gaussians::new(parts.clone()).unwrap(), Output::Spz3 { antialiased }).unwrap();
            read(&path, Path::new("a.spz"), false, mode).unwrap().1
        };
        let noted = notes(true, None);
        assert!(matches!(&noted[..], [note] if SuspiciousNote::DrawnClassic.is(note)), "{noted:?}");
        assert_eq!(notes(true, Some(RasterMode::Classic)), [""; 0]);
        assert_eq!(notes(true, Some(RasterMode::Antialiased)), [""; 0]);
        assert_eq!(notes(false, None), [""; 0]);
    }
}
