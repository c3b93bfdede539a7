//! The process of a method: started once, asked line by line, killed when it no longer answers.

use std::collections::VecDeque;
use std::io::{self, BufRead as _, BufReader, Read, Write as _};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use thiserror::Error;

use super::group;
use super::wire::quoted;

/// Longest line that is read.
const MAX_LINE: u64 = 1 << 20;
/// Last lines on standard error that are kept for messages, and their longest length in bytes.
const KEPT_LINES: usize = 6;
const KEPT_BYTES: u64 = 300;
/// How long a process may take to end after its standard input was closed, and its last line to arrive after it has ended.
const GRACE: Duration = Duration::from_secs(2);
/// How often a process that does not answer is asked whether it has ended.
const INTERVAL: Duration = Duration::from_millis(100);
/// How long to wait for the status and the last lines of a process that has ended.
const END_TIMEOUT: Duration = Duration::from_millis(500);
/// Tells copies of a process apart, for instance to choose a graphics card: 0, 1 and so on.
const NUMBER: &str = "ATSPLAT_PROCESS";

/// Why there is no line from a process.
#[derive(Debug, Error)]
pub(super) enum Fault {
    #[error("it did not answer within {} s and was killed", limit.as_secs_f64())]
    TimedOut { limit: Duration },
    #[error("it ended with {0}")]
    Ended(ExitStatus),
    #[error("it closed its standard output and was killed")]
    Closed,
    #[error("expected a line of text of at most {MAX_LINE} bytes on its standard output, found {0}; it was killed")]
    Line(&'static str),
}

/// A line of standard output.
#[derive(Debug)]
struct Line {
    text: String,
    /// Whether more was written with it.
    is_followed: bool,
}

/// A running process.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    /// Lines for its standard input, which is closed when this is dropped.
    requests: Option<Sender<String>>,
    lines: Receiver<Result<Line, &'static str>>,
    stderr_tail: StderrTail,
    /// The last line that it was asked for, in messages.
    said: String,
    /// Whether more was written with that line.
    said_more: bool,
    /// Ends the thread that started the process; see [`spawn_and_write`].
    _alive: Sender<()>,
}

impl Process {
    /// Starts the program `words[0]` with the other words as its arguments.
    pub(super) fn start(words: &[String], number: usize) -> io::Result<Self> {
        let (started, start) = channel();
        let (requests, for_child) = channel();
        let (alive, ending) = channel();
        let words = words.to_vec();
        tracing::info!(?words, number, "starting a method's process");
        waiting_thread(move || spawn_and_write(command(&words, number), &started, &for_child, &ending));
        let mut child: Child = start.recv().unwrap_or_else(|_gone| Err(io::ErrorKind::Other.into()))?;
        let (sender, lines) = channel();
        if let Some(stdout) = child.stdout.take() {
            waiting_thread(move || read_lines(stdout, &sender));
        }
        let stderr_tail = StderrTail::of(child.stderr.take());
        let said = "its first line".to_owned();
        Ok(Self { child, requests: Some(requests), lines, stderr_tail, said, said_more: false, _alive: alive })
    }

    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Closes its standard input, which asks it to end.
    pub(super) fn close(&mut self) {
        self.requests = None;
    }

    /// Closes its standard input and waits until it has ended; why it is wrong that it wrote one more line, if it did.
    pub(super) fn end(&mut self) -> Option<String> {
        self.finish();
        // The line may still be on its way.
        self.lines.recv_timeout(END_TIMEOUT).ok().map(|line| self.unasked(line))
    }

    /// Notes the trial that it has answered, for messages.
    pub(super) fn has_answered(&mut self, trial: &str) {
        self.said = format!("the answer to the previous trial, {trial}");
    }

    /// Why it is wrong that it wrote a line that nobody asked for, if one has arrived.
    pub(super) fn extra_line(&self) -> Option<String> {
        let wait = if self.said_more { END_TIMEOUT } else { Duration::ZERO };
        self.lines.recv_timeout(wait).ok().map(|line| self.unasked(line))
    }

    fn unasked(&self, line: Result<Line, &'static str>) -> String {
        let found = line.map_or_else(str::to_owned, |line| quoted(&line.text));
        format!("expected no line without a request, found an extra line after {}: {found}", self.said)
    }

    /// Whether it has ended.
    pub(super) fn has_ended(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(Some(_)))
    }

    /// Writes a line and waits for the next one.
    pub(super) fn ask(&mut self, request: String, limit: Duration) -> Result<String, Fault> {
        // A thread that has ended has seen the process end, which the missing answer shows.
        self.requests.as_ref().map(|requests| requests.send(request).ok());
        self.line(limit)
    }

    /// Waits for its next line. If it has ended, those that it started are killed: they may keep its output open.
    pub(super) fn line(&mut self, limit: Duration) -> Result<String, Fault> {
        let begin = Instant::now();
        loop {
            let left = limit.saturating_sub(begin.elapsed());
            let has_ended = self.has_ended();
            if has_ended {
                self.kill_all();
            }
            let wait = if has_ended { GRACE } else { left.min(INTERVAL) };
            match self.lines.recv_timeout(wait) {
                Ok(line) => {
                    let Line { text, is_followed } = line.map_err(Fault::Line)?;
                    self.said_more = is_followed;
                    return Ok(text);
                }
                Err(RecvTimeoutError::Timeout) if !has_ended && left > INTERVAL => {}
                Err(RecvTimeoutError::Timeout) if !has_ended => return Err(Fault::TimedOut { limit }),
                Err(_) => return Err(self.status(END_TIMEOUT).map_or(Fault::Closed, Fault::Ended)),
            }
        }
    }

    /// Kills it; its last lines on standard error.
    pub(super) fn kill(mut self) -> Vec<String> {
        self.kill_all();
        self.stderr_tail.take()
    }

    /// Waits until it has ended; `None` if it is still running.
    fn status(&mut self, limit: Duration) -> Option<ExitStatus> {
        let deadline = Instant::now() + limit;
        loop {
            match self.child.try_wait() {
                Ok(None) if Instant::now() < deadline => thread::sleep(Duration::from_millis(5)),
                outcome => return outcome.ok().flatten(),
            }
        }
    }

    /// Asks it to end, and kills it if it does not.
    fn finish(&mut self) {
        self.close();
        if self.status(GRACE).is_none() {
            self.kill_all();
        }
    }

    /// Kills the process, and those that it started even if it has ended itself.
    fn kill_all(&mut self) {
        group::kill(self.child.id());
        if !self.has_ended() {
            self.child.kill().ok();
            self.child.wait().ok();
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.finish();
    }
}

/// The command of a process that ends with this one where the system allows it, in a new group.
fn command(words: &[String], number: usize) -> Command {
    let mut words = words.iter();
    let mut command = Command::new(words.next().map_or("", String::as_str));
    command.args(words);
    let mut command = group::ending_with_this_thread(command);
    command.env(NUMBER, number.to_string());
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Starts a process and writes the requests to it. The calling thread must live as long as the process: for Linux, the
/// parent of a process is the thread that started it, and the process is killed when that thread ends.
fn spawn_and_write(
    mut command: Command,
    started: &Sender<io::Result<Child>>,
    requests: &Receiver<String>,
    ending: &Receiver<()>,
) {
    let mut stdin = None;
    let child = command.spawn().map(|mut child| {
        stdin = child.stdin.take();
        child
    });
    let _guard = child.as_ref().ok().and_then(|child| group::Guard::of(child.id()));
    if started.send(child).is_err() {
        return;
    }
    if let Some(mut stdin) = stdin {
        for request in requests {
            if stdin.write_all(request.as_bytes()).and_then(|()| stdin.flush()).is_err() {
                break;
            }
        }
    }
    ending.recv().ok();
}

/// A thread that waits for a pipe or a process, and computes nothing.
#[expect(clippy::disallowed_methods, reason = "rayon's threads are for work; these wait")]
fn waiting_thread(wait: impl FnOnce() + Send + 'static) {
    thread::spawn(wait);
}

/// Sends the lines of standard output until it ends, or until a line is too long or not UTF-8.
fn read_lines(stdout: ChildStdout, lines: &Sender<Result<Line, &'static str>>) {
    let mut reader = BufReader::new(stdout);
    loop {
        let mut bytes = Vec::new();
        match reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let line = match String::from_utf8(bytes) {
            Ok(text) if text.ends_with('\n') => Ok(Line { text, is_followed: !reader.buffer().is_empty() }),
            Ok(line) if line.len() as u64 >= MAX_LINE => Err("a longer one"),
            Ok(_unfinished) => return,
            Err(_bytes) => Err("bytes that are not UTF-8"),
        };
        let is_last = line.is_err();
        if lines.send(line).is_err() || is_last {
            return;
        }
    }
}

/// The last lines that a process wrote to standard error.
#[derive(Debug)]
struct StderrTail {
    lines: Arc<Mutex<VecDeque<String>>>,
    /// Disconnected when standard error has ended.
    end: Receiver<()>,
}

impl StderrTail {
    fn of(stderr: Option<ChildStderr>) -> Self {
        let lines = Arc::new(Mutex::new(VecDeque::new()));
        let (at_end, end) = channel();
        if let Some(stderr) = stderr {
            let lines = Arc::clone(&lines);
            waiting_thread(move || {
                read_last(stderr, &lines);
                drop(at_end);
            });
        }
        Self { lines, end }
    }

    fn take(&self) -> Vec<String> {
        // A child of the process may keep standard error open.
        self.end.recv_timeout(END_TIMEOUT).ok();
        self.lines.lock().unwrap_or_else(PoisonError::into_inner).drain(..).collect()
    }
}

fn read_last(stderr: ChildStderr, lines: &Mutex<VecDeque<String>>) {
    let mut reader = BufReader::new(stderr);
    loop {
        let mut bytes = Vec::new();
        // A longer line is continued as another one.
        match reader.by_ref().take(KEPT_BYTES).read_until(b'\n', &mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&bytes).trim_end().to_owned();
        tracing::debug!(line, "a method's standard error");
        if line.is_empty() {
            continue;
        }
        let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
        if lines.len() == KEPT_LINES {
            lines.pop_front();
        }
        lines.push_back(line);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_nobody_asked_for_is_found_at_the_end_too() {
        let at_the_end = |script: &str, trial: Option<&str>| {
            let mut process = Process::start(&["sh", "-c", script].map(str::to_owned), 0).unwrap();
            assert_eq!(process.line(Duration::from_mins(1)).unwrap(), "ready\n");
            if let Some(trial) = trial {
                process.has_answered(trial);
            }
            process.end()
        };
        assert_eq!(at_the_end("echo ready; read -r line", None), None);
        let extra = "expected no line without a request, found an extra line after";
        let first = at_the_end("echo ready; read -r line; echo done", None).unwrap();
        assert_eq!(first, format!("{extra} its first line: \"done\""));
        let later = at_the_end("echo ready; echo done", Some("7 (scene \"a\", entry 0)")).unwrap();
        assert_eq!(later, format!("{extra} the answer to the previous trial, 7 (scene \"a\", entry 0): \"done\""));
    }
}
