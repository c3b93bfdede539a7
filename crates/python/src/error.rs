//! Errors of the libraries as Python exceptions, with the file and the field where an error names them.

use std::error::Error;
use std::path::{Path, PathBuf};

use atsplat_camera::CameraError;
use atsplat_drift::DriftError;
use atsplat_eval::EvalError;
use atsplat_files::{FileError, LockError, Malformed};
use atsplat_metrics::MetricError;
use atsplat_metrics::learned::LoadError;
use atsplat_pixels::PixelError;
use atsplat_protocol::ProtocolError;
use atsplat_report::ReportError;
use atsplat_results::ResultsError;
use atsplat_scene::{SceneError, UnreadOption};
use atsplat_splat::SplatError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// An error of a library, or one that Python raised.
#[derive(Debug)]
pub(crate) enum Failure {
    Library { message: String, place: Place },
    Python(PyErr),
}

/// Where an error is.
#[derive(Debug, Default)]
pub(crate) struct Place {
    file: Option<PathBuf>,
    /// A setting, an array, or a line or field in the file.
    field: Option<String>,
    /// The system's error, if a file operation failed.
    system: Option<i32>,
    is_system: bool,
}

impl Place {
    fn io(path: &Path, source: &std::io::Error) -> Self {
        Self { file: Some(path.to_owned()), field: None, system: source.raw_os_error(), is_system: true }
    }

    fn file(path: &Path) -> Self {
        Self { file: Some(path.to_owned()), ..Self::default() }
    }

    fn field(field: &str) -> Self {
        Self { field: Some(field.to_owned()), ..Self::default() }
    }

    fn at(self, field: &str) -> Self {
        Self { field: Some(field.to_owned()), ..self }
    }
}

/// How a difference begins of the rules by which methods are hashed (`rules` of `_identity.py`).
const RULES: &str = "parameters.identity.(rules): ";

impl Failure {
    /// Names the argument to which the error is due, where there is more to it than one.
    #[must_use]
    pub(crate) fn of_argument(mut self, argument: &str) -> Self {
        if let Self::Library { place, .. } = &mut self {
            place.field = Some(argument.to_owned());
        }
        self
    }

    /// A store with the results of another run: what differs, and the argument that decides about it.
    pub(crate) fn of_store(error: ResultsError, folder: &Path) -> Self {
        let ResultsError::Differences { what, name, differences, .. } = &error else { return error.into() };
        let field = match *what {
            "methods" => "method",
            "presets" => "protocols",
            "metrics" => "metrics",
            "limits" => "limit",
            "shards" => "shard",
            _ => "out",
        };
        let (at, folder) = (Place::file(folder).at(field), folder.display());
        let advice = match name {
            Some(name) if field == "method" && differences.contains(RULES) => format!(
                "the results of {name} in {folder} were recorded by another version of atsplat, which hashed methods in another way, so \
                 that nobody knows whether it is the same method: {differences}; give another folder (out), or remove that one"
            ),
            Some(name) if field == "method" => format!(
                "the results of {name} in {folder} were made by another method: {differences}; give another folder (out), or remove that \
                 one. From the first run on, version=… can identify a method instead of its code and values"
            ),
            _ => {
                let of = name.as_ref().map_or_else(|| (*what).to_owned(), |name| format!("{what} {name}"));
                let remedy = match field {
                    "metrics" => "request the metrics of these results too, with the same weights, or ",
                    "limit" => {
                        "no limit, or a multiple of theirs, adds scenes to results that are not a shard; otherwise "
                    }
                    _ => "",
                };
                format!("{of} of the results in {folder} differ: {differences}; {remedy}give another folder (out)")
            }
        };
        Self::Library { message: format!("{field}: {advice}"), place: at }
    }

    /// Stores that cannot be merged, with the one that does not fit those before it.
    pub(crate) fn of_merge(error: ResultsError, store: Option<&Path>) -> Self {
        let mut failure = Self::from(error).of_argument("stores");
        if let (Self::Library { message, place }, Some(store)) = (&mut failure, store) {
            *message = format!("merging {}: {message}", store.display());
            place.file.get_or_insert_with(|| store.to_owned());
        }
        failure
    }

    /// A wrong setting or argument.
    pub(crate) fn invalid(field: &str, problem: impl std::fmt::Display) -> Self {
        Self::Library { message: format!("{field}: {problem}"), place: Place::field(field) }
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Python(error) => error,
            Failure::Library { message, place } => {
                Python::attach(|py| raised(py, &message, place).unwrap_or_else(|error| error))
            }
        }
    }
}

fn raised(py: Python<'_>, message: &str, place: Place) -> PyResult<PyErr> {
    let Place { file, field, system, is_system } = place;
    let class = if is_system { "FileError" } else { "InvalidError" };
    let raised = py.import("atsplat.errors")?.getattr(class)?.call1((message,))?;
    raised.setattr("file", file.map(|file| file.to_string_lossy().into_owned()))?;
    raised.setattr("field", field)?;
    if is_system {
        raised.setattr("errno", system)?;
    }
    Ok(PyErr::from_value(raised))
}

/// The message with those of its causes that it does not quote.
fn message(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let reason = error.to_string();
        if !text.contains(&reason) {
            text = format!("{text}: {reason}");
        }
        cause = error.source();
    }
    text
}

macro_rules! failures {
    ($($error:ty => $place:expr),* $(,)?) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                let place: fn(&$error) -> Place = $place;
                Self::Library { message: message(&error), place: place(&error) }
            }
        }
    )*};
}

failures! {
    CameraError => of_camera,
    DriftError => |error| match error {
        DriftError::Io(error) => of_file(error),
        DriftError::Malformed(error) => of_malformed(error),
        DriftError::Invalid { what, .. } => Place::field(what),
        _ => Place::default(),
    },
    LoadError => |error| match error {
        LoadError::Absent(_) => Place::field("weights"),
        LoadError::Mismatch { tensor, .. } => Place::field(tensor),
        _ => Place::default(),
    },
    LockError => |error| match error {
        LockError::Io(error) => of_file(error),
        LockError::InUse { folder, .. } => Place::file(folder),
    },
    MetricError => |error| match error {
        MetricError::SizeMismatch { .. } => Place::field("truth"),
        _ => Place::field("images"),
    },
    PixelError => |_| Place::field("images"),
    ProtocolError => of_protocol,
    SceneError => of_scene,
    SplatError => |error| match error {
        SplatError::Io(error) => of_file(error),
        SplatError::Format { path, location, .. } => Place::file(path).at(location),
        SplatError::LfsPointer { path } => Place::file(path),
        SplatError::Length { field, .. } | SplatError::Constants { field, .. } => Place::field(field),
        SplatError::View { what, .. } => Place::field(what),
        SplatError::Camera(error) => of_camera(error),
        _ => Place::default(),
    },
    ReportError => |error| match error {
        ReportError::UnknownTable { .. } => Place::field("table"),
        ReportError::Io(error) => of_file(error),
        ReportError::InUse { folder, .. } => Place::file(folder),
        ReportError::Protocol(error) => of_protocol(error),
        ReportError::Store(error) => of_store(error),
        _ => Place::default(),
    },
}

impl From<UnreadOption> for Failure {
    /// Names the argument, which has underscores.
    fn from(unread: UnreadOption) -> Self {
        let argument = unread.option.replace('-', "_");
        let message = unread.to_string().replacen(unread.option, &argument, 1);
        Self::Library { message, place: Place::field(&argument) }
    }
}

impl From<EvalError> for Failure {
    fn from(error: EvalError) -> Self {
        match error {
            EvalError::Stopped => Self::Python(PyKeyboardInterrupt::new_err(())),
            EvalError::Results(error) => error.into(),
            error => Self::Library { message: in_python(&error), place: of_evaluation(&error) },
        }
    }
}

impl From<ResultsError> for Failure {
    fn from(error: ResultsError) -> Self {
        Self::Library { message: store_in_python(&error), place: of_store(&error) }
    }
}

/// The message; where the library's gives advice about options of the command line, with advice about arguments instead.
fn in_python(error: &EvalError) -> String {
    let EvalError::NoIndex { data, accepted, sampler } = error else { return message(error) };
    let file =
        if accepted.is_empty() { "an index".to_owned() } else { format!("the file of {}", accepted.join(" or ")) };
    let rule = sampler.as_ref().map_or_else(|| "…".to_owned(), |name| format!("{name:?}"));
    format!(
        "no evaluation index in {}: give {file} (index=…), or a sampling rule for data without an index (sampler={rule})",
        data.display()
    )
}

/// As [`in_python`].
fn store_in_python(error: &ResultsError) -> String {
    match error {
        ResultsError::InUse { folder, by } => format!(
            "{} is being written by {by}: wait until that run ends; or let each process write a part of the scenes into a folder of \
             its own, with shard=(1, 2) and shard=(2, 2), and merge the parts with atsplat.merge",
            folder.display()
        ),
        ResultsError::HasResults { folder, found } => {
            format!("out: expected a folder without results, found {found} in {}", folder.display())
        }
        _ => message(error),
    }
}

fn of_evaluation(error: &EvalError) -> Place {
    match error {
        EvalError::Io(error) => of_file(error),
        EvalError::Malformed(error) => of_malformed(error),
        EvalError::NoIndex { data, .. } => Place::file(data).at("index"),
        EvalError::Unknown { what, .. } | EvalError::Settings { what, .. } => Place::field(what),
        EvalError::NoPublishedIndex { .. } => Place::field("evaluation index"),
        EvalError::Protocol(error) => of_protocol(error),
        _ => Place::default(),
    }
}

fn of_store(error: &ResultsError) -> Place {
    match error {
        ResultsError::Io(error) => of_file(error),
        ResultsError::Malformed(error) => of_malformed(error),
        ResultsError::TooNew { path, .. } | ResultsError::SchemaHash { path, .. } => {
            Place::file(path).at("schema-version")
        }
        ResultsError::NoStore { folder } | ResultsError::InUse { folder, .. } => Place::file(folder),
        ResultsError::HasResults { folder, .. } => Place::file(folder).at("out"),
        ResultsError::Different { what, .. }
        | ResultsError::Differences { what, .. }
        | ResultsError::Invalid { what, .. } => Place::field(what),
        ResultsError::NotFinite { field, .. } | ResultsError::Disagreement { field, .. } => Place::field(field),
        ResultsError::Digests(error) => of_protocol(error),
        _ => Place::default(),
    }
}

fn of_protocol(error: &ProtocolError) -> Place {
    match error {
        ProtocolError::Io(error) => of_file(error),
        ProtocolError::Malformed(error) => of_malformed(error),
        ProtocolError::InFile { path, source } => Place { file: Some(path.clone()), ..of_protocol(source) },
        ProtocolError::Scene(error) => of_scene(error),
        ProtocolError::Image(error) => of_protocol(error),
        ProtocolError::UnknownPreset { .. } => Place::field("protocol"),
        _ => Place::default(),
    }
}

fn of_scene(error: &SceneError) -> Place {
    match error {
        SceneError::Io(error) => of_file(error),
        SceneError::Malformed(error) => of_malformed(error),
        SceneError::Camera { path, location, .. }
        | SceneError::OutsideScene { path, location, .. }
        | SceneError::UnsupportedCameraModel { path, location, .. } => Place::file(path).at(location),
        SceneError::LfsPointer { path, .. }
        | SceneError::UnknownScene { path, .. }
        | SceneError::Unrecognized { path, .. }
        | SceneError::Torch { path, .. } => Place::file(path),
        _ => Place::default(),
    }
}

fn of_file(error: &FileError) -> Place {
    Place::io(&error.path, &error.source)
}

fn of_malformed(error: &Malformed) -> Place {
    Place { file: error.path.as_deref().map(Path::to_path_buf), ..Place::field(&error.location) }
}

fn of_camera(error: &CameraError) -> Place {
    match error {
        CameraError::NonFinite { field, .. } | CameraError::NotPositive { field, .. } => Place::field(field),
        CameraError::NotARotation { .. } => Place::field("rotation"),
        _ => Place::default(),
    }
}
