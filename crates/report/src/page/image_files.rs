use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, decode};
use atsplat_results::store::images::is_image_of;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// How the data URI of an image begins.
const PNG: &str = "data:image/png;base64,";

/// Image files as data URIs, each read once, however often the page is written to fit its limit; equal images are kept once.
#[derive(Debug, Default)]
pub(super) struct ImageFiles {
    uris: Vec<String>,
    positions: BTreeMap<Sha256Digest, usize>,
    read: BTreeMap<(PathBuf, Option<String>), Result<usize, Unusable>>,
}

/// Why an image is not shown.
#[derive(Clone, Copy, Debug)]
pub(super) enum Unusable {
    /// It cannot be read or decoded.
    Unreadable,
    /// It belongs to another result.
    Replaced,
}

impl ImageFiles {
    /// The position of an image that has the samples of this hash.
    pub(super) fn position(&mut self, path: &Path, hash: Option<&str>) -> Result<usize, Unusable> {
        let file = (path.to_owned(), hash.map(str::to_owned));
        if let Some(known) = self.read.get(&file) {
            return *known;
        }
        let found = read(path, hash).map(|png| self.add(&png));
        self.read.insert(file, found);
        found
    }

    /// Whether an image that was not read takes more than these bytes of the page.
    pub(super) fn is_too_large(&self, path: &Path, hash: Option<&str>, room: usize) -> bool {
        let is_known = || self.read.contains_key(&(path.to_owned(), hash.map(str::to_owned)));
        bytes_in_base64(path).is_some_and(|bytes| bytes > room) && !is_known()
    }

    /// The data URI of an image.
    pub(super) fn uri(&self, position: usize) -> &str {
        &self.uris[position]
    }

    fn add(&mut self, png: &[u8]) -> usize {
        let next = self.uris.len();
        *self.positions.entry(Sha256Digest::of(png)).or_insert_with(|| {
            self.uris.push(format!("{PNG}{}", STANDARD.encode(png)));
            next
        })
    }
}

/// The bytes of a file's data URI, by its size; `None` if it has none.
fn bytes_in_base64(path: &Path) -> Option<usize> {
    let bytes = usize::try_from(path.metadata().ok()?.len()).ok()?;
    bytes.div_ceil(3).checked_mul(4)?.checked_add(PNG.len())
}

/// The image file of a row with this hash. It must decode within limits, so that nothing but images is embedded.
fn read(path: &Path, hash: Option<&str>) -> Result<Vec<u8>, Unusable> {
    let Ok(bytes) = atsplat_files::read(path) else { return Err(Unusable::Unreadable) };
    if !bytes.starts_with(b"\x89PNG") || decode(&bytes, &DecodeLimits::default()).is_err() {
        return Err(Unusable::Unreadable);
    }
    if !is_image_of(&bytes, hash) {
        return Err(Unusable::Replaced);
    }
    Ok(bytes)
}
