use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_pixels::Image;
use sha2::{Digest, Sha256};

use super::{Features, Perceptual};
use crate::MetricError;

/// Features of ground truths, so that each is computed once for all methods that are compared on it.
///
/// Pictures are told apart by a hash of their samples, networks by that of their file. The oldest go first when the bytes run out; VGG's features of a
/// 256² picture take 32 MB, so a cache serves the methods of one trial rather than a whole dataset.
#[derive(Debug)]
pub struct FeatureCache {
    most_bytes: usize,
    kept: Mutex<Kept>,
}

type Key = [u8; 32];

#[derive(Debug, Default)]
struct Kept {
    bytes: usize,
    entries: VecDeque<(Key, Arc<Features>)>,
}

impl FeatureCache {
    /// Keeps at most this many bytes of features.
    pub fn new(most_bytes: usize) -> Self {
        Self { most_bytes, kept: Mutex::default() }
    }

    /// The picture's features, computed unless they are kept.
    ///
    /// # Errors
    /// As [`Perceptual::features`].
    pub fn features(&self, perceptual: &Perceptual, picture: &Image) -> Result<Arc<Features>, MetricError> {
        let key = hash(perceptual, picture);
        let find = |kept: &Kept| kept.entries.iter().find(|(k, _)| *k == key).map(|(_, found)| Arc::clone(found));
        if let Some(found) = find(&self.lock()) {
            return Ok(found);
        }
        // Computed without the lock: at worst two threads compute the same.
        let features = Arc::new(perceptual.features(picture)?);
        let mut kept = self.lock();
        if features.bytes() <= self.most_bytes && find(&kept).is_none() {
            kept.bytes += features.bytes();
            kept.entries.push_back((key, Arc::clone(&features)));
            while kept.bytes > self.most_bytes {
                let Some((_, oldest)) = kept.entries.pop_front() else { break };
                kept.bytes -= oldest.bytes();
            }
        }
        Ok(features)
    }

    /// Pictures whose features are kept.
    pub fn len(&self) -> usize {
        self.lock().entries.len()
    }

    /// Whether none are.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(perceptual: &Perceptual, picture: &Image) -> Key {
    let mut hash = Sha256::new();
    hash.update(perceptual.network().name());
    hash.update(&perceptual.hashes().network);
    hash.update(picture.width().to_le_bytes());
    hash.update(picture.height().to_le_bytes());
    let bytes: Vec<u8> = picture.samples().iter().flat_map(|sample| sample.to_le_bytes()).collect();
    hash.update(&bytes);
    hash.finalize().into()
}
