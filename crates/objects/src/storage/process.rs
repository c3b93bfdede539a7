//! Starts `atsplat-objects` and talks to it.

use std::collections::HashMap;
use std::ffi::OsString;
use std::io::{self, BufRead as _, BufReader, ErrorKind, Read, Write as _};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use atsplat_files::quoted;

use super::{Answer, Call, Content, Done, Download, Object, Request, Storage, Traffic, Upload, Version};
use crate::ObjectError;

const PROGRAM: &str = "atsplat-objects";

const NO_ANSWER: &str = "it ended without an answer";

/// The program's path, where it is neither next to this one nor on PATH.
const VARIABLE: &str = "ATSPLAT_OBJECTS";

/// Object storage behind a running `atsplat-objects`, which ends when this is dropped.
#[derive(Debug)]
pub(crate) struct Process {
    url: String,
    child: Child,
    input: Option<Mutex<Input>>,
    shared: Arc<Mutex<Shared>>,
    reader: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Input {
    pipe: ChildStdin,
    next: u64,
}

#[derive(Debug, Default)]
struct Shared {
    waiting: HashMap<u64, Sender<Content>>,
    traffic: Traffic,
    /// Why the program gives no more answers, once it gives none.
    ended: Option<String>,
}

impl Process {
    /// Starts the program; it has made no request when this returns.
    pub(crate) fn start(url: &str) -> Result<Self, ObjectError> {
        let url = url.trim_end_matches('/').to_owned();
        let named = std::env::var_os(VARIABLE).filter(|path| !path.is_empty());
        let program = named.clone().unwrap_or_else(program);
        let spawned = Command::new(program).arg(&url).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child = spawned.map_err(|error| match (named, error.kind()) {
            (Some(program), _) => {
                let (program, detail) = (program.to_string_lossy().into_owned(), error.to_string());
                ObjectError::NotStarted { url: url.clone(), program, detail }
            }
            (None, ErrorKind::NotFound) => ObjectError::NotInstalled { url: url.clone() },
            (None, _) => request_error(&url, "starting atsplat-objects", &error.to_string()),
        })?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let shared: Arc<Mutex<Shared>> = Arc::default();
        #[expect(clippy::disallowed_methods, reason = "it waits for answers and computes nothing")]
        let reader = output.map(|output| {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || read(output, &shared))
        });
        let input = input.map(|pipe| Mutex::new(Input { pipe, next: 0 }));
        Ok(Self { url, child, input, shared, reader })
    }

    /// Sends a call and gives the contents of its answers to `each`, until one ends it.
    fn call<T>(
        &self,
        call: Call,
        mut each: impl FnMut(Content) -> Result<Option<T>, ObjectError>,
    ) -> Result<T, ObjectError> {
        let answers = self.send(call).map_err(|error| self.ended(&error.to_string()))?;
        // Until the end also after an error of `each`, so that nothing is under way any more.
        let mut failed = None;
        loop {
            let content = answers.recv().map_err(|_closed| self.ended(&self.why_ended()))?;
            let is_last = !matches!(content, Content::Each(..));
            match (content, failed.take()) {
                (Content::Failed(error), earlier) => return Err(earlier.unwrap_or(error)),
                (_, Some(error)) if is_last => return Err(error),
                (_, Some(error)) => failed = Some(error),
                (content, None) => match each(content) {
                    Ok(Some(result)) => return Ok(result),
                    Ok(None) if is_last => return Err(self.ended("it gave another kind of answer")),
                    Ok(None) => {}
                    Err(error) => failed = Some(error),
                },
            }
        }
    }

    fn send(&self, call: Call) -> io::Result<Receiver<Content>> {
        let closed = || io::Error::from(ErrorKind::BrokenPipe);
        let mut input = self.input.as_ref().ok_or_else(closed)?.lock().unwrap_or_else(PoisonError::into_inner);
        let (id, (sender, receiver)) = (input.next, channel());
        input.next += 1;
        {
            let mut shared = lock(&self.shared);
            if let Some(why) = &shared.ended {
                return Err(io::Error::new(ErrorKind::BrokenPipe, why.clone()));
            }
            shared.waiting.insert(id, sender);
        }
        let mut line = serde_json::to_vec(&Request { id, call })?;
        line.push(b'\n');
        input.pipe.write_all(&line)?;
        Ok(receiver)
    }

    /// Why the channel of an answer is closed before its end.
    fn why_ended(&self) -> String {
        lock(&self.shared).ended.clone().unwrap_or_else(|| NO_ANSWER.to_owned())
    }

    fn ended(&self, detail: &str) -> ObjectError {
        request_error(&self.url, "asking atsplat-objects", detail)
    }

    fn each(&self, call: Call, done: Done<'_>) -> Result<(), ObjectError> {
        self.call(call, |content| match content {
            Content::Each(name, version) => done(&name, version).map(|()| None),
            Content::Done => Ok(Some(())),
            _ => Ok(None),
        })
    }
}

impl Storage for Process {
    fn url(&self) -> &str {
        &self.url
    }

    fn traffic(&self) -> Traffic {
        lock(&self.shared).traffic
    }

    fn list(&self) -> Result<Vec<Object>, ObjectError> {
        self.call(Call::List, |content| Ok(if let Content::Objects(objects) = content { Some(objects) } else { None }))
    }

    fn download(&self, downloads: Vec<Download>, done: Done<'_>) -> Result<(), ObjectError> {
        self.each(Call::Download(downloads), done)
    }

    fn get(&self, name: &str) -> Result<Option<(String, Version)>, ObjectError> {
        self.call(Call::Get(name.to_owned()), |content| {
            Ok(if let Content::Text(text) = content { Some(text) } else { None })
        })
    }

    fn put(&self, uploads: Vec<Upload>, done: Done<'_>) -> Result<(), ObjectError> {
        self.each(Call::Put(uploads), done)
    }

    fn delete(&self, name: &str) -> Result<(), ObjectError> {
        self.call(Call::Delete(name.to_owned()), |content| Ok(matches!(content, Content::Done).then_some(())))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The program ends with its input.
        drop(self.input.take());
        if let Some(reader) = self.reader.take() {
            reader.join().ok();
        }
        self.child.wait().ok();
    }
}

/// Passes answers on until the program closes its output, or something else than an answer is read.
fn read(output: impl Read, shared: &Mutex<Shared>) {
    let mut why = NO_ANSWER.to_owned();
    for answer in BufReader::new(output).lines().map(parse) {
        let Answer { id, traffic, content } = match answer {
            Ok(answer) => answer,
            Err(detail) => {
                why = detail;
                break;
            }
        };
        let mut shared = lock(shared);
        shared.traffic = traffic;
        let is_last = !matches!(content, Content::Each(..));
        if let Some(waiting) = shared.waiting.get(&id) {
            waiting.send(content).ok();
        }
        if is_last {
            shared.waiting.remove(&id);
        }
    }
    let mut shared = lock(shared);
    shared.ended = Some(why);
    // Whoever waits finds the channel closed.
    shared.waiting.clear();
}

fn parse(line: io::Result<String>) -> Result<Answer, String> {
    let line = line.map_err(|error| format!("reading its answers: {error}"))?;
    serde_json::from_str(&line)
        .map_err(|error| format!("expected an answer, found {}: {error}", quoted(line.as_bytes())))
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn request_error(url: &str, action: &str, detail: &str) -> ObjectError {
    ObjectError::Request { url: url.to_owned(), action: action.to_owned(), detail: detail.to_owned() }
}

/// What to start unless [`VARIABLE`] names it: the program next to this one, or the one on PATH.
fn program() -> OsString {
    let name = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    let neighbour = || -> Option<PathBuf> {
        let path = std::env::current_exe().ok()?.with_file_name(&name);
        path.is_file().then_some(path)
    };
    neighbour().map_or_else(|| PROGRAM.into(), PathBuf::into_os_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a call with the number 3 gets, and why there are no more answers.
    fn outcome(output: &[u8]) -> (usize, String) {
        let (shared, (sender, answers)) = (Mutex::<Shared>::default(), channel());
        lock(&shared).waiting.insert(3, sender);
        read(output, &shared);
        let why = lock(&shared).ended.clone().unwrap();
        (answers.iter().count(), why)
    }

    #[test]
    fn what_is_no_answer_is_named() {
        let content = Content::Text(None);
        let answer = serde_json::to_string(&Answer { id: 3, traffic: Traffic::default(), content }).unwrap();
        let with = |more: &[u8]| outcome(&[answer.as_bytes(), b"\n", more].concat());
        assert_eq!(with(b""), (1, NO_ANSWER.to_owned()));
        assert_eq!(outcome(b""), (0, NO_ANSWER.to_owned()));
        let (count, why) = with(b"warning: no region\n");
        assert!(count == 1 && why.starts_with("expected an answer, found \"warning: no region\": "), "{why}");
        let (count, why) = outcome(b"\xff\xfe\n");
        assert!(count == 0 && why.starts_with("reading its answers: ") && why.contains("UTF-8"), "{why}");
    }
}
