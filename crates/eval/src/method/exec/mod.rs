//! Runs any method as a separate process, in another environment.

mod array;
mod command;
mod files;
mod group;
mod pool;
mod process;
mod scratch;
mod wire;

use std::collections::BTreeMap;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use atsplat_files::FileError;
use atsplat_pixels::Image;
use atsplat_protocol::Preset;
use atsplat_results::{MethodRecord, differences};

use super::splatting::{Splatting, parameters};
use super::{Cost, Method, MethodError, MethodSpec, Prediction, Rendered, Timed, TrialInput};
use crate::EvalError;
use files::{TrialFolder, without_folders};
use pool::{Pool, Slot};
use process::Process;
use scratch::Scratch;
use wire::{Answer, Hello, OutputKind, Request, VERSION, check_seconds};

/// How long to wait before a process that did not start is started once more.
const PAUSE: Duration = Duration::from_secs(1);

/// A method that runs as a process: it is started once, given one trial after the other, and answers with images or with
/// Gaussians (`docs/methods.md`).
///
/// If a process crashes, hangs or writes anything but an answer, the trial that it was given fails; the process is
/// killed, and another one is started for the next trial; if it does not start as the first one did, not even at a second attempt,
/// the run stops. All processes end when this value is dropped, and on Unix when this process ends.
#[derive(Debug)]
pub struct Exec {
    words: Vec<String>,
    /// The files that the command names, each with its SHA-256 at the first start.
    files: BTreeMap<String, String>,
    hello: Hello,
    limit: Duration,
    opacities_as_stored: bool,
    splatting: Splatting,
    record: MethodRecord,
    /// Number of requests so far. A timing pass repeats trials, but no two requests share a folder.
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
    /// start or whose first line is invalid; [`EvalError::Io`] if the command names a file that cannot be read, or no
    /// temporary folder can be created.
    pub fn start(settings: ExecSettings) -> Result<Self, EvalError> {
        let ExecSettings { command, name, limit, processes, opacities_as_stored, splatting } = settings;
        let words = command::words(&command)?;
        // Before the start: what is edited while the process loads is not what it runs.
        let files = command::files(&words)?;
        let no_method = |why| EvalError::NoMethod { command: command.clone(), why };
        let process = Process::start(&words, 0)
            .map_err(|error| no_method(format!("the method's process: it cannot be started: {error}")))?;
        let (process, hello) = described(process, limit).map_err(no_method)?;
        let name = MethodSpec::name_of(name.as_deref().unwrap_or(&hello.name))
            .map_err(|error| no_method(format!("the method's name: {error}; NAME=exec:… gives it another")))?;
        let record = record(name, &command, &files, &hello, opacities_as_stored, &splatting);
        let temporary = std::env::temp_dir();
        let folder =
            Scratch::new_in(&temporary).map_err(EvalError::io("creating a folder for a method", &temporary))?;
        let (requests, pool) = (AtomicU64::new(0), Pool::new(processes, process));
        Ok(Self { words, files, hello, limit, opacities_as_stored, splatting, record, requests, pool, folder })
    }

    /// Sends a request and waits for the answer on a channel: a rayon thread that stole another trial while it waits
    /// might wait for the same process.
    fn ask(&self, slot: &mut Slot, request: &Request<'_>) -> Result<(Answer, Cost), MethodError> {
        let mut process = self.process_of(slot)?;
        let begin = Instant::now();
        let line = process.ask(request.line(), self.limit).map_err(|fault| fault.to_string());
        let secs = begin.elapsed().as_secs_f64();
        match line.and_then(|line| Answer::parse(&line, request.trial)) {
            Ok((answer, stages)) => {
                let peak_bytes = group::peak_bytes(process.id());
                tracing::debug!(method = self.record.name, request.trial, secs, ?stages, peak_bytes, "answered");
                process.has_answered(&request.label());
                slot.process = Some(process);
                check_seconds(&stages, secs)
                    .map_err(|why| MethodError::Failed(format!("the method's answer: {why}")))?;
                Ok((answer, Cost { stages, process_peak_bytes: peak_bytes, ..Cost::default() }))
            }
            Err(why) => Err(MethodError::Failed(with_stderr_tail(&why, &process.kill()))),
        }
    }

    /// The slot's process, or a new one if it has ended; an error if it wrote a line that nobody asked for.
    fn process_of(&self, slot: &mut Slot) -> Result<Process, MethodError> {
        let Some(mut process) = slot.process.take() else { return self.restarted(slot.number) };
        if let Some(why) = process.extra_line() {
            return Err(MethodError::Failed(with_stderr_tail(&why, &process.kill())));
        }
        if process.has_ended() {
            process.kill();
            return self.restarted(slot.number);
        }
        Ok(process)
    }

    /// A process in place of one that has ended, or in an empty slot. If there is none, that is no result of a trial: it stops the run.
    /// One that does not start is started once more: the memory of the one before may be freed late.
    fn restarted(&self, number: usize) -> Result<Process, MethodError> {
        self.require_same_files()?;
        let (process, hello) = match self.started(number) {
            Ok(started) => started,
            Err(error) => {
                tracing::warn!("{error}; it is started once more");
                thread::sleep(PAUSE);
                self.require_same_files()?;
                self.started(number)?
            }
        };
        if hello == self.hello {
            return Ok(process);
        }
        let differences = differences(&self.hello, &hello);
        Err(self.rejected(format!("it describes itself differently after a restart: {differences}")))
    }

    fn started(&self, number: usize) -> Result<(Process, Hello), MethodError> {
        let process = Process::start(&self.words, number).map_err(|error| self.not_started(error))?;
        described(process, self.limit).map_err(|why| self.rejected(why))
    }

    /// An error if files that its command names have changed since its first start.
    fn require_same_files(&self) -> Result<(), MethodError> {
        let files = command::hashed(self.files.keys().cloned()).map_err(|error| self.rejected(error.to_string()))?;
        if files == self.files {
            return Ok(());
        }
        let differences = differences(&self.files, &files);
        Err(self.rejected(format!("files of its command have changed since its first start: {differences}")))
    }

    fn rejected(&self, why: String) -> MethodError {
        self.not_started(io::Error::other(why))
    }

    fn not_started(&self, error: io::Error) -> MethodError {
        let program = self.words.first().map_or("", String::as_str);
        FileError::during("starting a method's process", program)(error)
    }

    /// What the process makes of a trial.
    fn answered<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        let number = self.requests.fetch_add(1, Ordering::Relaxed);
        let (trial_folder, files) = TrialFolder::of(self.folder.path(), number, &input)?;
        let request = Request::new(&input, trial_folder.path(), files);
        let (answer, cost) = self.ask(self.pool.take().slot(), &request)?;
        let why = match (answer, self.hello.gives) {
            (Answer::Images(name), OutputKind::Images) => {
                let images = trial_folder.images(&name, &input).map_err(MethodError::Failed)?.into_iter();
                let images = images.map(|image| image.map_err(|why| self.without_folders(&why))).collect();
                return Ok(Box::new(Images { images, cost }));
            }
            (Answer::Gaussians(name), OutputKind::Gaussians) => {
                let read = trial_folder.gaussians(&name, self.opacities_as_stored, self.splatting.mode);
                let (gaussians, notes) = read.map_err(MethodError::Failed)?;
                let notes = notes.iter().map(|note| self.without_folders(note)).collect();
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

    fn without_folders(&self, message: &str) -> String {
        without_folders(message, self.folder.path())
    }
}

/// Reads the line in which a process describes itself.
fn described(mut process: Process, limit: Duration) -> Result<(Process, Hello), String> {
    let line = process.line(limit).map_err(|fault| fault.to_string());
    match line.and_then(|line| Hello::parse(&line)) {
        Ok(hello) => Ok((process, hello)),
        Err(why) => Err(with_stderr_tail(&why, &process.kill())),
    }
}

fn with_stderr_tail(why: &str, lines: &[String]) -> String {
    match lines {
        [] => format!("the method's process: {why}; it wrote nothing to standard error"),
        lines => {
            // Of a program that is not there: the user has never heard of what starts it.
            let lines: Vec<&str> = lines.iter().map(|line| group::without_starter(line)).collect();
            format!("the method's process: {why}; its last lines on standard error: {}", lines.join(" | "))
        }
    }
}

/// The record names the command with its files, and the version that the process states.
fn record(
    name: String,
    command: &str,
    files: &BTreeMap<String, String>,
    hello: &Hello,
    opacities_as_stored: bool,
    splatting: &Splatting,
) -> MethodRecord {
    let mut record = MethodRecord {
        title: name.clone(),
        name,
        kind: "exec".to_owned(),
        parameters: parameters([
            ("command", command.into()),
            ("files", serde_json::json!(files)),
            ("states-name", hello.name.clone().into()),
            ("version", hello.version.clone().into()),
            ("protocol", VERSION.into()),
        ]),
        weights_sha256: hello.weights_sha256.clone(),
        untrained: hello.untrained,
        ..MethodRecord::default()
    };
    record.record_setting(hello.setting.as_deref());
    if hello.gives == OutputKind::Gaussians {
        splatting.describe(&mut record);
        if opacities_as_stored {
            record.parameters.insert("opacities-as-stored".to_owned(), true.into());
        }
    }
    record.deterministic = hello.deterministic && (hello.gives == OutputKind::Images || record.deterministic);
    record
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

    fn process_secs(&self) -> Option<f64> {
        let each = self.pool.of_idle(|process| group::processor_secs(process.id()));
        each.into_iter().flatten().reduce(|sum, secs| sum + secs)
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        self.answered(input).map_err(|error| match error {
            MethodError::NotApplicable(why) => MethodError::NotApplicable(self.without_folders(&why)),
            MethodError::Failed(why) => MethodError::Failed(self.without_folders(&why)),
            MethodError::Io(error) => MethodError::Io(error),
        })
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
