use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_pixels::Image;
use sha2::{Digest, Sha256};

use super::{Features, Lpips};
use crate::MetricError;

/// Cache of ground-truth features, which are shared by all methods that are compared on an image.
///
/// The key is a hash of the image's samples and the network's file. The oldest entries are evicted first; VGG's features of a
/// 256² image take 32 MB, so the cache serves the methods of one trial rather than a whole dataset.
#[derive(Debug)]
pub struct FeatureCache {
    max_bytes: usize,
    entries: Mutex<Entries>,
}

type Key = [u8; 32];

#[derive(Debug, Default)]
struct Entries {
    bytes: usize,
    queue: VecDeque<(Key, Arc<Features>)>,
}

impl FeatureCache {
    /// A cache of at most this many bytes of features.
    pub fn new(max_bytes: usize) -> Self {
        Self { max_bytes, entries: Mutex::default() }
    }

    /// The image's features, computed unless they are cached.
    ///
    /// # Errors
    /// As [`Lpips::features`].
    pub fn features(&self, lpips: &Lpips, image: &Image) -> Result<Arc<Features>, MetricError> {
        let key = hash(lpips, image);
        let find =
            |entries: &Entries| entries.queue.iter().find(|(k, _)| *k == key).map(|(_, found)| Arc::clone(found));
        if let Some(found) = find(&self.lock()) {
            tracing::trace!(metric = lpips.network().name(), "features of the true image are cached");
            return Ok(found);
        }
        // Computed without holding the lock: at worst two threads compute the same features.
        let features = Arc::new(lpips.features(image)?);
        let mut entries = self.lock();
        if features.bytes() <= self.max_bytes && find(&entries).is_none() {
            entries.bytes += features.bytes();
            entries.queue.push_back((key, Arc::clone(&features)));
            while entries.bytes > self.max_bytes {
                let Some((_, oldest)) = entries.queue.pop_front() else { break };
                entries.bytes -= oldest.bytes();
            }
        }
        Ok(features)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(lpips: &Lpips, image: &Image) -> Key {
    let mut hash = Sha256::new();
    hash.update(lpips.network().name());
    hash.update(&lpips.hashes().network);
    hash.update(image.width().to_le_bytes());
    hash.update(image.height().to_le_bytes());
    let bytes: Vec<u8> = image.samples().iter().flat_map(|sample| sample.to_le_bytes()).collect();
    hash.update(&bytes);
    hash.finalize().into()
}
