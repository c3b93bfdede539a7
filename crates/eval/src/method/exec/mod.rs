//! Runs any method as a separate process, in an environment of its own.

mod files;
mod group;
mod npy;
mod pool;
mod process;
mod scratch;
mod wire;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use atsplat_files::Sha256Digest;
use atsplat_pixels::Image;
use atsplat_protocol::Preset;

use super::splatting::{Splatting, parameters};
use super::{Cost, Method, MethodError, Prediction, Rendered, Timed, TrialInput};
use crate::runner::{CONTEXT, TRUTH};
use crate::{EvalError, MethodRecord, differences};
use files::TrialFolder;
use pool::{Pool, Slot};
use process::Process;
use scratch::Scratch;
use wire::{Answer, Hello, OutputKind, Request, VERSION};

/// A method that runs as a process: it is started once, given one trial after the other, and answers with images or with
/// Gaussians (`docs/methods.md`).
///
/// If a process crashes, hangs or writes anything but an answer, the trial that it was given fails; the process is
/// killed, and another one is started for the next trial. All processes end when this value is dropped, and on Linux
/// when this process ends.
#[derive(Debug)]
pub struct Exec {
    words: Vec<String>,
    hello: Hello,
    limit: Duration,
    opacities_as_stored: bool,
    splatting: Splatting,
    record: MethodRecord,
    requests: AtomicU64,
    /// Before the folder: processes end before it is removed.
    pool: Pool,
    folder: Scratch,
}

/// How a method's process is started and read.
#[derive(Debug)]
pub struct ExecSettings {
    /// Program and arguments, quoted as for a POSIX shell; no other shell syntax is interpreted.
    pub command: String,
    /// The method's name in the rows; by default the one in its first line.
    pub name: Option<String>,
    /// How long it may take to start, and for each trial.
    pub limit: Duration,
    /// Maximum number of processes at once; at least 1.
    pub processes: usize,
    /// Whether a PLY file stores opacities themselves instead of logits.
    pub opacities_as_stored: bool,
    /// How its Gaussians are rendered.
    pub splatting: Splatting,
}

impl Exec {
    /// Starts the first process and reads the line in which it describes itself.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for an empty or wrongly quoted command; [`EvalError::NoMethod`] for a process that does not
    /// start or whose first line is invalid; [`EvalError::Io`] if a word of the command is a file that cannot be read, or no
    /// temporary folder can be created.
    pub fn start(settings: ExecSettings) -> Result<Self, EvalError> {
        let ExecSettings { command, name, limit, processes, opacities_as_stored, splatting } = settings;
        let words = words(&command)?;
        let refused = |why| EvalError::NoMethod { command: command.clone(), why };
        let (process, hello) = start(&words, 0, limit).map_err(refused)?;
        let name = name.unwrap_or_else(|| hello.name.clone());
        if name.trim().is_empty() || [TRUTH, CONTEXT].contains(&name.as_str()) {
            return Err(refused(format!("a method cannot have the name {name:?}; NAME=exec:… gives it another")));
        }
        let record = record(name, &command, &words, &hello, opacities_as_stored, &splatting)?;
        let temporary = std::env::temp_dir();
        let folder =
            Scratch::new_in(&temporary).map_err(EvalError::io("creating a folder for a method", &temporary))?;
        let (requests, pool) = (AtomicU64::new(0), Pool::new(processes, process));
        Ok(Self { words, hello, limit, opacities_as_stored, splatting, record, requests, pool, folder })
    }

    /// Sends a request and waits for the answer on a channel: a rayon thread that stole another trial while it waits
    /// might wait for the same process.
    fn ask(&self, slot: &mut Slot, request: &Request<'_>) -> Result<(Answer, Cost), MethodError> {
        if let Some(ended) = slot.process.take_if(Process::has_ended) {
            ended.kill();
        }
        let mut process = match slot.process.take() {
            Some(process) => process,
            None => self.restarted(slot.number).map_err(MethodError::Failed)?,
        };
        let begin = Instant::now();
        let line = process.ask(request.line(), self.limit).map_err(|fault| fault.to_string());
        match line.and_then(|line| Answer::parse(&line, request.trial)) {
            Ok((answer, stages)) => {
                let (secs, own_peak_bytes) = (begin.elapsed().as_secs_f64(), group::peak_bytes(process.id()));
                tracing::debug!(method = self.record.name, request.trial, secs, ?stages, own_peak_bytes, "answered");
                slot.process = Some(process);
                Ok((answer, Cost { stages, own_peak_bytes, ..Cost::default() }))
            }
            Err(why) => Err(MethodError::Failed(with_stderr_tail(&why, &process.kill()))),
        }
    }

    fn restarted(&self, number: usize) -> Result<Process, String> {
        let (process, hello) = start(&self.words, number, self.limit)?;
        if hello == self.hello {
            return Ok(process);
        }
        let differences = differences(&self.hello, &hello);
        Err(format!("the method's process: it describes itself differently after a restart: {differences}"))
    }
}

fn words(command: &str) -> Result<Vec<String>, EvalError> {
    let words = shlex::split(command).filter(|words| !words.is_empty());
    words.ok_or_else(|| EvalError::Settings {
        what: "method exec",
        expected: "a program and its arguments, quoted as for a shell".to_owned(),
        found: format!("{command:?}"),
    })
}

/// Starts a process and reads the line in which it describes itself.
fn start(words: &[String], number: usize, limit: Duration) -> Result<(Process, Hello), String> {
    tracing::info!(?words, number, "starting a method's process");
    let mut process = Process::start(words, number).map_err(|fault| format!("the method's process: {fault}"))?;
    let line = process.line(limit).map_err(|fault| fault.to_string());
    match line.and_then(|line| Hello::parse(&line)) {
        Ok(hello) => Ok((process, hello)),
        Err(why) => Err(with_stderr_tail(&why, &process.kill())),
    }
}

fn with_stderr_tail(why: &str, lines: &[String]) -> String {
    match lines {
        [] => format!("the method's process: {why}; it wrote nothing to standard error"),
        lines => format!("the method's process: {why}; its last lines on standard error: {}", lines.join(" | ")),
    }
}

/// The record names the command, the version that the process states, and each file among the command's words with its hash:
/// results of a changed script are not mixed with those of the old one.
fn record(
    name: String,
    command: &str,
    words: &[String],
    hello: &Hello,
    opacities_as_stored: bool,
    splatting: &Splatting,
) -> Result<MethodRecord, EvalError> {
    let mut files = BTreeMap::new();
    for word in words.iter().filter(|word| Path::new(word).is_file()) {
        let path = Path::new(word);
        let bytes = std::fs::read(path).map_err(EvalError::io("reading a file of a method's command", path))?;
        files.insert(word.clone(), Sha256Digest::of(&bytes).to_string());
    }
    let mut record = MethodRecord {
        title: name.clone(),
        name,
        kind: "exec".to_owned(),
        parameters: parameters([
            ("command", command.into()),
            ("files", serde_json::json!(files)),
            ("states-name", hello.name.clone().into()),
            ("version", hello.version.clone().into()),
            ("setting", hello.setting.clone().into()),
            ("protocol", VERSION.into()),
        ]),
        weights_sha256: hello.weights_sha256.clone(),
        untrained: hello.untrained,
        ..MethodRecord::default()
    };
    if hello.gives == OutputKind::Gaussians {
        splatting.describe(&mut record);
        if opacities_as_stored {
            record.parameters.insert("opacities-as-stored".to_owned(), true.into());
        }
    }
    record.deterministic = hello.deterministic && (hello.gives == OutputKind::Images || record.deterministic);
    Ok(record)
}

impl Method for Exec {
    fn record(&self) -> MethodRecord {
        self.record.clone()
    }

    fn setting(&self) -> &str {
        self.hello.setting.as_deref().unwrap_or(Preset::OWN_METHOD)
    }

    fn timed(&self) -> Timed {
        // Its images are finished when it answers.
        Timed { encoding: true, rendering: self.hello.gives == OutputKind::Gaussians }
    }

    fn own_processor_secs(&self) -> Option<f64> {
        let each = self.pool.of_idle(|process| group::processor_secs(process.id()));
        each.into_iter().flatten().reduce(|sum, secs| sum + secs)
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let number = self.requests.fetch_add(1, Ordering::Relaxed);
        let (trial_folder, files) = TrialFolder::of(self.folder.path(), number, &input).map_err(MethodError::Failed)?;
        let request = Request::new(number, &input, trial_folder.path(), files);
        let (answer, cost) = self.ask(self.pool.take().slot(), &request)?;
        let why = match (answer, self.hello.gives) {
            (Answer::Images(name), OutputKind::Images) => {
                let images = trial_folder.images(&name, &input).map_err(MethodError::Failed)?;
                return Ok(Box::new(Images { images, cost }));
            }
            (Answer::Gaussians(name), OutputKind::Gaussians) => {
                let read = trial_folder.gaussians(&name, self.opacities_as_stored, self.splatting.mode);
                let (gaussians, notes) = read.map_err(MethodError::Failed)?;
                return Ok(self.splatting.predict(input, gaussians, Cost { notes, ..cost }));
            }
            (Answer::NotApplicable(why), _) => return Err(MethodError::NotApplicable(why)),
            (Answer::Error(why), _) => format!("the method says: {why}"),
            (other, gives) => {
                format!("expected {}, as announced at its start, found {}", gives.name(), other.name())
            }
        };
        Err(MethodError::Failed(why))
    }
}

/// Images of all targets, or why one is missing.
struct Images {
    images: Vec<Result<Image, String>>,
    cost: Cost,
}

impl Prediction for Images {
    fn cost(&self) -> Cost {
        self.cost.clone()
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |&target: &usize| {
            let image = self.images.get(target).cloned().ok_or_else(|| format!("no target {target}"))??;
            Ok(Rendered { image, drawn: None, effects: Vec::new() })
        };
        targets.iter().map(one).collect()
    }
}
