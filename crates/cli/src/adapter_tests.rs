//! Tests of graphics adapters as a user sees them: what is being done, and what came of it before.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use atsplat_splat::gpu::{AdapterDescription, ProbeStage, Verdict, VerdictKey, Watcher};
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};

use crate::output::{PendingFile, complain};

/// A line for a log after so much time in which nothing else was said.
const BEAT: Duration = Duration::from_secs(10);
/// Tests that are remembered; the oldest are forgotten.
const MOST: usize = 64;
/// A larger file is none of ours.
const LARGEST: u64 = 1 << 20;

/// Says what is done to adapters, and keeps verdicts in the user's cache folder.
#[derive(Debug)]
pub(crate) struct AdapterTests {
    file: Option<PathBuf>,
    /// Whether verdicts of before count.
    remembers: bool,
    ticker: Mutex<Option<Ticker>>,
}

/// The file of verdicts.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Verdicts {
    tests: Vec<Test>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Test {
    of: VerdictKey,
    verdict: Verdict,
}

impl AdapterTests {
    /// With the verdicts in the user's cache folder; tested again all the same where `again` is set.
    pub(crate) fn new(again: bool) -> Self {
        let file = cache_folder().map(|folder| folder.join("adapters.json"));
        let tests = Self { file, remembers: !again, ticker: Mutex::default() };
        tests.say("looking for graphics adapters".to_owned());
        tests
    }

    fn say(&self, doing: String) {
        let mut ticker = self.ticker.lock().unwrap_or_else(PoisonError::into_inner);
        // The one before ends before the next begins.
        ticker.take();
        *ticker = Some(Ticker::start(doing));
    }

    /// Says no more; for when the work is done.
    pub(crate) fn finish(&self) {
        self.ticker.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
}

impl Watcher for AdapterTests {
    fn begins(&self, adapter: &AdapterDescription, stage: ProbeStage) {
        let doing = match stage {
            ProbeStage::Opening => "opening the device",
            ProbeStage::Picture => "testing a picture; the driver compiles kernels first",
            ProbeStage::Derivative => "testing its derivative; the driver compiles kernels first",
        };
        self.say(format!("{adapter}: {doing}"));
    }

    fn recall(&self, key: &VerdictKey) -> Option<Verdict> {
        let file = self.file.as_deref().filter(|_| self.remembers)?;
        let known = read(file).unwrap_or_else(|error| {
            complain(&format!("warning: adapters are tested again: {error:#}"));
            Verdicts::default()
        });
        known.tests.into_iter().rev().find(|test| test.of == *key).map(|test| test.verdict)
    }

    fn keep(&self, key: &VerdictKey, verdict: &Verdict) {
        let Some(file) = &self.file else { return };
        if let Err(error) = add(file, Test { of: key.clone(), verdict: verdict.clone() }) {
            complain(&format!("warning: the test of {} is not remembered: {error:#}", key.adapter));
        }
    }
}

/// Verdicts that a file holds; none where there is no file.
fn read(file: &Path) -> anyhow::Result<Verdicts> {
    let reading = || format!("reading {}", file.display());
    let size = match file.metadata() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Verdicts::default()),
        data => data.with_context(reading)?.len(),
    };
    anyhow::ensure!(size <= LARGEST, "{}: expected at most {LARGEST} bytes, found {size}", file.display());
    serde_json::from_slice(&std::fs::read(file).with_context(reading)?).with_context(reading)
}

/// Adds a test; what cannot be read is begun anew.
fn add(file: &Path, test: Test) -> anyhow::Result<()> {
    let mut known = read(file).unwrap_or_default();
    known.tests.retain(|other| other.of != test.of);
    known.tests.push(test);
    let excess = known.tests.len().saturating_sub(MOST);
    known.tests.drain(..excess);
    PendingFile::open(file)?.finish(&serde_json::to_vec_pretty(&known)?)
}

/// `atsplat` in the user's folder for what can be made again; `None` where the system names none.
fn cache_folder() -> Option<PathBuf> {
    let of = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = if cfg!(target_os = "windows") {
        of("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        of("HOME").map(|home| home.join("Library/Caches"))
    } else {
        of("XDG_CACHE_HOME").or_else(|| of("HOME").map(|home| home.join(".cache")))
    };
    Some(folder?.join("atsplat"))
}

/// A line at once, and signs of life until it is dropped: a clock on a terminal, a line now and then elsewhere.
#[derive(Debug)]
struct Ticker {
    bar: ProgressBar,
    over: Arc<(Mutex<bool>, Condvar)>,
    beat: Option<JoinHandle<()>>,
}

impl Ticker {
    /// Says what is being done.
    fn start(doing: String) -> Self {
        let bar = ProgressBar::new_spinner();
        let over = Arc::new((Mutex::new(false), Condvar::new()));
        if !bar.is_hidden() {
            bar.set_message(doing);
            bar.enable_steady_tick(Duration::from_millis(200));
            return Self { bar, over, beat: None };
        }
        complain(&doing);
        let shared = Arc::clone(&over);
        #[expect(
            clippy::disallowed_methods,
            reason = "a clock that prints, beside a driver that keeps rayon's threads waiting"
        )]
        let beat = std::thread::spawn(move || {
            let start = Instant::now();
            let (over, bell) = &*shared;
            let mut is_over = over.lock().unwrap_or_else(PoisonError::into_inner);
            while !*is_over {
                let waited = bell.wait_timeout(is_over, BEAT).unwrap_or_else(PoisonError::into_inner);
                is_over = waited.0;
                if waited.1.timed_out() && !*is_over {
                    complain(&format!("{doing}, {} s so far", start.elapsed().as_secs()));
                }
            }
        });
        Self { bar, over, beat: Some(beat) }
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        let (over, bell) = &*self.over;
        *over.lock().unwrap_or_else(PoisonError::into_inner) = true;
        bell.notify_all();
        if let Some(beat) = self.beat.take() {
            // A thread that only prints has nothing to say of its end.
            beat.join().ok();
        }
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(driver: &str) -> VerdictKey {
        let [adapter, backend, version] = ["llvmpipe", "Vulkan", "0123"].map(str::to_owned);
        VerdictKey { adapter, backend, driver: driver.to_owned(), version }
    }

    fn tests(file: &Path, remembers: bool) -> AdapterTests {
        AdapterTests { file: Some(file.to_owned()), remembers, ticker: Mutex::default() }
    }

    #[test]
    fn verdicts_are_kept_for_one_driver_and_survive_a_broken_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cache/adapters.json");
        let passed = Verdict { fault: None };
        let remembering = tests(&file, true);
        assert_eq!(remembering.recall(&key("Mesa 22")), None);
        remembering.keep(&key("Mesa 22"), &passed);
        assert_eq!(remembering.recall(&key("Mesa 22")), Some(passed.clone()));
        assert_eq!(remembering.recall(&key("Mesa 23")), None, "another driver is another test");
        assert_eq!(tests(&file, false).recall(&key("Mesa 22")), None, "tested again where that is asked for");
        std::fs::write(&file, "{\"tests\": [{\"of\"").unwrap();
        assert_eq!(remembering.recall(&key("Mesa 22")), None, "a corrupt file remembers nothing");
        remembering.keep(&key("Mesa 22"), &passed);
        assert_eq!(remembering.recall(&key("Mesa 22")), Some(passed), "and is replaced");
    }

    #[test]
    fn the_oldest_tests_are_forgotten() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("adapters.json");
        let remembering = tests(&file, true);
        for driver in 0..=MOST {
            remembering.keep(&key(&driver.to_string()), &Verdict { fault: None });
        }
        assert_eq!((remembering.recall(&key("0")), read(&file).unwrap().tests.len()), (None, MOST));
        assert!(remembering.recall(&key(&MOST.to_string())).is_some());
    }
}
