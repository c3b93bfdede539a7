//! Reports the progress of adapter tests and caches their verdicts.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use atsplat_splat::gpu::{AdapterDescription, ProbeStage, Verdict, VerdictKey, Watcher};
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};

use crate::output::{PendingFile, warn};

/// Interval of log lines while a test is running.
const LOG_INTERVAL: Duration = Duration::from_secs(10);
/// Capacity of the cache; the oldest tests are dropped.
const MAX_TESTS: usize = 64;
/// A larger file was not written by this program.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Reports progress on standard error, and keeps verdicts in the user's cache folder.
#[derive(Debug)]
pub(crate) struct AdapterTests {
    file: Option<PathBuf>,
    /// Whether cached verdicts are used.
    use_cache: bool,
    ticker: Mutex<Option<Ticker>>,
}

/// The cache file.
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
    /// Uses the verdicts in the user's cache folder, unless `again` is set.
    pub(crate) fn new(again: bool) -> Self {
        let file = cache_folder().map(|folder| folder.join("adapters.json"));
        let tests = Self { file, use_cache: !again, ticker: Mutex::default() };
        tests.report("looking for graphics adapters".to_owned());
        tests
    }

    fn report(&self, activity: String) {
        let mut ticker = self.ticker.lock().unwrap_or_else(PoisonError::into_inner);
        // The previous ticker ends before the next one starts.
        ticker.take();
        *ticker = Some(Ticker::start(activity));
    }

    /// Stops reporting.
    pub(crate) fn finish(&self) {
        self.ticker.lock().unwrap_or_else(PoisonError::into_inner).take();
    }
}

impl Watcher for AdapterTests {
    fn begins(&self, adapter: &AdapterDescription, stage: ProbeStage) {
        let activity = match stage {
            ProbeStage::Opening => "opening the device",
            ProbeStage::Picture => "rendering a test image; the driver compiles kernels first",
            ProbeStage::Derivative => "testing gradients; the driver compiles kernels first",
        };
        self.report(format!("{adapter}: {activity}"));
    }

    fn recall(&self, key: &VerdictKey) -> Option<Verdict> {
        let file = self.file.as_deref().filter(|_| self.use_cache)?;
        let cached = read(file).unwrap_or_else(|error| {
            warn(&format!("warning: the cached adapter tests are ignored: {error:#}"));
            Verdicts::default()
        });
        cached.tests.into_iter().rev().find(|test| test.of == *key).map(|test| test.verdict)
    }

    fn keep(&self, key: &VerdictKey, verdict: &Verdict) {
        let Some(file) = &self.file else { return };
        if let Err(error) = add(file, Test { of: key.clone(), verdict: verdict.clone() }) {
            warn(&format!("warning: the test of {} was not cached: {error:#}", key.adapter));
        }
    }
}

/// Reads the cache; a missing file is an empty cache.
fn read(file: &Path) -> anyhow::Result<Verdicts> {
    let reading = || format!("reading {}", file.display());
    let size = match file.metadata() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Verdicts::default()),
        data => data.with_context(reading)?.len(),
    };
    anyhow::ensure!(
        size <= MAX_FILE_BYTES,
        "{}: expected at most {MAX_FILE_BYTES} bytes, found {size}",
        file.display()
    );
    serde_json::from_slice(&std::fs::read(file).with_context(reading)?).with_context(reading)
}

/// Adds a test; a cache that cannot be read is replaced.
fn add(file: &Path, test: Test) -> anyhow::Result<()> {
    let mut cache = read(file).unwrap_or_default();
    cache.tests.retain(|other| other.of != test.of);
    cache.tests.push(test);
    let excess = cache.tests.len().saturating_sub(MAX_TESTS);
    cache.tests.drain(..excess);
    PendingFile::open(file)?.finish(&serde_json::to_vec_pretty(&cache)?)
}

/// `atsplat` in the user's cache folder; `None` if the environment does not name one.
fn cache_folder() -> Option<PathBuf> {
    let folder_in = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = if cfg!(target_os = "windows") {
        folder_in("LOCALAPPDATA")
    } else if cfg!(target_os = "macos") {
        folder_in("HOME").map(|home| home.join("Library/Caches"))
    } else {
        folder_in("XDG_CACHE_HOME").or_else(|| folder_in("HOME").map(|home| home.join(".cache")))
    };
    Some(folder?.join("atsplat"))
}

/// Shows an activity until dropped: a spinner on a terminal, a line every [`LOG_INTERVAL`] elsewhere.
#[derive(Debug)]
struct Ticker {
    bar: ProgressBar,
    finished: Arc<(Mutex<bool>, Condvar)>,
    logger: Option<JoinHandle<()>>,
}

impl Ticker {
    fn start(activity: String) -> Self {
        let bar = ProgressBar::new_spinner();
        let finished = Arc::new((Mutex::new(false), Condvar::new()));
        if !bar.is_hidden() {
            bar.set_message(activity);
            bar.enable_steady_tick(Duration::from_millis(200));
            return Self { bar, finished, logger: None };
        }
        warn(&activity);
        let shared = Arc::clone(&finished);
        #[expect(
            clippy::disallowed_methods,
            reason = "a thread that only logs, while the driver blocks rayon's threads"
        )]
        let logger = std::thread::spawn(move || {
            let start = Instant::now();
            let (finished, signal) = &*shared;
            let mut is_finished = finished.lock().unwrap_or_else(PoisonError::into_inner);
            while !*is_finished {
                let waited = signal.wait_timeout(is_finished, LOG_INTERVAL).unwrap_or_else(PoisonError::into_inner);
                is_finished = waited.0;
                if waited.1.timed_out() && !*is_finished {
                    warn(&format!("{activity}, {} s so far", start.elapsed().as_secs()));
                }
            }
        });
        Self { bar, finished, logger: Some(logger) }
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        let (finished, signal) = &*self.finished;
        *finished.lock().unwrap_or_else(PoisonError::into_inner) = true;
        signal.notify_all();
        if let Some(logger) = self.logger.take() {
            // A panic of the logging thread affects no result.
            logger.join().ok();
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

    fn tests(file: &Path, use_cache: bool) -> AdapterTests {
        AdapterTests { file: Some(file.to_owned()), use_cache, ticker: Mutex::default() }
    }

    #[test]
    fn verdicts_are_cached_by_driver_and_a_corrupt_cache_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cache/adapters.json");
        let passed = Verdict { fault: None };
        let cached = tests(&file, true);
        assert_eq!(cached.recall(&key("Mesa 22")), None);
        cached.keep(&key("Mesa 22"), &passed);
        assert_eq!(cached.recall(&key("Mesa 22")), Some(passed.clone()));
        assert_eq!(cached.recall(&key("Mesa 23")), None, "verdicts of other drivers do not count");
        assert_eq!(tests(&file, false).recall(&key("Mesa 22")), None, "--again ignores the cache");
        std::fs::write(&file, "{\"tests\": [{\"of\"").unwrap();
        assert_eq!(cached.recall(&key("Mesa 22")), None, "a corrupt cache is empty");
        cached.keep(&key("Mesa 22"), &passed);
        assert_eq!(cached.recall(&key("Mesa 22")), Some(passed), "and is replaced");
    }

    #[test]
    fn the_oldest_tests_are_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("adapters.json");
        let cached = tests(&file, true);
        for driver in 0..=MAX_TESTS {
            cached.keep(&key(&driver.to_string()), &Verdict { fault: None });
        }
        assert_eq!((cached.recall(&key("0")), read(&file).unwrap().tests.len()), (None, MAX_TESTS));
        assert!(cached.recall(&key(&MAX_TESTS.to_string())).is_some());
    }
}
