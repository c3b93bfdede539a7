//! Runs of the self-test of graphics adapters: shows their progress, and caches their results.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use atsplat_splat::gpu::{
    AdapterDescription, ProbeStage, SelfTestCache, SelfTestKey, SelfTestObserver, SelfTestResult,
};
use indicatif::ProgressBar;

use crate::print::{print_status, warn};

/// Interval of log lines while a test is running.
const LOG_INTERVAL: Duration = Duration::from_secs(10);

/// Reports progress on standard error, and keeps results in the user's cache folder.
#[derive(Debug)]
pub(crate) struct AdapterSelfTests {
    cache: Option<SelfTestCache>,
    /// Whether cached results are used.
    use_cache: bool,
    ticker: Mutex<Option<Ticker>>,
}

impl AdapterSelfTests {
    /// Uses the results in the user's cache folder, unless `again` is set.
    pub(crate) fn new(again: bool) -> Self {
        let cache = atsplat_files::cache_folder().map(|folder| SelfTestCache::new(folder.join("adapters.json")));
        let tests = Self { cache, use_cache: !again, ticker: Mutex::default() };
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

impl SelfTestObserver for AdapterSelfTests {
    fn begins(&self, adapter: &AdapterDescription, stage: ProbeStage) {
        let activity = match stage {
            ProbeStage::Opening => "opening the device",
            ProbeStage::Image => "rendering a test image; the driver compiles kernels first",
            ProbeStage::Derivative => "testing gradients; the driver compiles kernels first",
        };
        self.report(format!("{adapter}: {activity}"));
    }

    fn cached(&self, key: &SelfTestKey) -> Option<SelfTestResult> {
        let cache = self.cache.as_ref().filter(|_| self.use_cache)?;
        cache.get(key).unwrap_or_else(|error| {
            let file = cache.file().display();
            warn(&format!("the cached adapter tests are ignored: reading {file}: {error}"));
            None
        })
    }

    fn store(&self, key: &SelfTestKey, result: &SelfTestResult) {
        let Some(cache) = &self.cache else { return };
        if let Err(error) = cache.insert(key, result) {
            let file = cache.file().display();
            warn(&format!("the test of {} was not cached: writing {file}: {error}", key.adapter));
        }
    }
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
        print_status(&activity);
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
                    print_status(&format!("{activity}, {} s so far", start.elapsed().as_secs()));
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

    #[test]
    fn cached_results_are_ignored_if_tests_are_repeated() {
        let folder = tempfile::tempdir().unwrap();
        let key = SelfTestKey {
            adapter: "llvmpipe".to_owned(),
            backend: "Vulkan".to_owned(),
            driver: "Mesa 22".to_owned(),
            version: "0123".to_owned(),
        };
        let tests = |use_cache| {
            let cache = SelfTestCache::new(folder.path().join("adapters.json"));
            AdapterSelfTests { cache: Some(cache), use_cache, ticker: Mutex::default() }
        };
        let passed = SelfTestResult { fault: None };
        tests(true).store(&key, &passed);
        assert_eq!((tests(true).cached(&key), tests(false).cached(&key)), (Some(passed), None));
    }
}
