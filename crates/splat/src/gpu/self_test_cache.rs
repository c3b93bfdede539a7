use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{SelfTestKey, SelfTestResult};

/// Capacity of the file; the oldest results are dropped.
const MAX_TESTS: usize = 64;
/// A larger file was not written by this crate.
const MAX_BYTES: u64 = 1 << 20;

/// A JSON file that caches results of self-tests for a [`SelfTestObserver`](super::SelfTestObserver).
#[derive(Clone, Debug)]
pub struct SelfTestCache(PathBuf);

#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct CacheFile {
    tests: Vec<Test>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Test {
    of: SelfTestKey,
    #[serde(rename = "verdict")]
    result: SelfTestResult,
}

impl SelfTestCache {
    /// The cache in this file, which may be absent.
    pub const fn new(file: PathBuf) -> Self {
        Self(file)
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.0
    }

    /// The result of a key, if there is one.
    ///
    /// # Errors
    /// I/O errors, and [`ErrorKind::InvalidData`] for a file that this crate did not write.
    pub fn get(&self, key: &SelfTestKey) -> io::Result<Option<SelfTestResult>> {
        Ok(self.read()?.tests.into_iter().rev().find(|test| test.of == *key).map(|test| test.result))
    }

    /// Adds a result, or replaces that of the same key; a file that cannot be read is replaced.
    ///
    /// # Errors
    /// I/O errors of writing.
    pub fn insert(&self, key: &SelfTestKey, result: &SelfTestResult) -> io::Result<()> {
        let mut cache = self.read().unwrap_or_default();
        cache.tests.retain(|test| test.of != *key);
        cache.tests.push(Test { of: key.clone(), result: result.clone() });
        let excess = cache.tests.len().saturating_sub(MAX_TESTS);
        cache.tests.drain(..excess);
        if let Some(folder) = self.0.parent() {
            fs::create_dir_all(folder)?;
        }
        atsplat_files::write(&self.0, &serde_json::to_vec_pretty(&cache)?)
    }

    fn read(&self) -> io::Result<CacheFile> {
        let size = match self.0.metadata() {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(CacheFile::default()),
            data => data?.len(),
        };
        if size > MAX_BYTES {
            let found = format!("expected at most {MAX_BYTES} bytes, found {size}");
            return Err(io::Error::new(ErrorKind::InvalidData, found));
        }
        Ok(serde_json::from_slice(&fs::read(&self.0)?)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(driver: &str) -> SelfTestKey {
        let [adapter, backend, version] = ["llvmpipe", "Vulkan", "0123"].map(str::to_owned);
        SelfTestKey { adapter, backend, driver: driver.to_owned(), version }
    }

    #[test]
    fn results_are_cached_by_driver_and_a_corrupt_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let cache = SelfTestCache::new(folder.path().join("cache/adapters.json"));
        let passed = SelfTestResult { fault: None };
        assert_eq!(cache.get(&key("Mesa 22")).unwrap(), None);
        cache.insert(&key("Mesa 22"), &passed).unwrap();
        assert_eq!(cache.get(&key("Mesa 22")).unwrap(), Some(passed.clone()));
        assert_eq!(cache.get(&key("Mesa 23")).unwrap(), None, "results of other drivers do not count");
        fs::write(cache.file(), "{\"tests\": [{\"of\"").unwrap();
        assert!(cache.get(&key("Mesa 22")).is_err());
        cache.insert(&key("Mesa 22"), &passed).unwrap();
        assert_eq!(cache.get(&key("Mesa 22")).unwrap(), Some(passed));
    }

    #[test]
    fn the_oldest_results_are_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let cache = SelfTestCache::new(folder.path().join("adapters.json"));
        for driver in 0..=MAX_TESTS {
            cache.insert(&key(&driver.to_string()), &SelfTestResult { fault: None }).unwrap();
        }
        assert_eq!((cache.get(&key("0")).unwrap(), cache.read().unwrap().tests.len()), (None, MAX_TESTS));
        assert!(cache.get(&key(&MAX_TESTS.to_string())).unwrap().is_some());
    }
}
