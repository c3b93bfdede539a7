//! The zip directory of a `torch.save` file.
//!
//! The `zip` crate reads every local header, which on a mapped chunk reads one page of disk for every image, used or
//! not; and of two entries with one name it uses the last, where PyTorch uses another. This reads only the central
//! directory, rejects ambiguous ones, and reads a local header when its entry is requested. The content of an entry is compared
//! with its CRC-32 when it is first read.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use crate::shared_bytes::{Checksum, span, u16_at, u32_at, u64_at};
use crate::{SharedBytes, TorchError, shortened};

const LOCAL_HEADER: &[u8] = b"PK\x03\x04";
const LOCAL_HEADER_LEN: usize = 30;
const CENTRAL_HEADER: &[u8] = b"PK\x01\x02";
const CENTRAL_HEADER_LEN: usize = 46;
const END_OF_DIRECTORY: &[u8] = b"PK\x05\x06";
const END_OF_DIRECTORY_LEN: usize = 22;
const ZIP64_END_OF_DIRECTORY: &[u8] = b"PK\x06\x06";
const ZIP64_LOCATOR: &[u8] = b"PK\x06\x07";
const ZIP64_LOCATOR_LEN: usize = 20;
const ZIP64_EXTRA: u16 = 1;
/// The value of a field that is stored in the zip64 record instead.
const SATURATED: u32 = u32::MAX;
/// The CRC-32 of an entry that was written without one: after `torch.serialization.set_crc32_options(False)`, and inside
/// `torch.serialization.skip_data` (`PyTorchStreamWriter::writeRecord`, `mz_zip_writer_add_mem_ex_v2`). Others have it by a
/// chance of 2⁻³².
const NO_CRC: u32 = 0;

/// Entries of a zip file without compression.
#[derive(Debug)]
pub(crate) struct ZipDirectory {
    file: SharedBytes,
    /// The top-level folder: `archive`, or the stem of the file's original name.
    prefix: String,
    entries: HashMap<String, Entry>,
    /// Start of the central directory; entries end before it.
    directory_start: usize,
}

#[derive(Debug)]
struct Entry {
    header: u64,
    len: u64,
    crc: u32,
    /// Shared by all who request the entry, so that one of them compares it.
    checksum: OnceLock<Arc<Checksum>>,
}

impl ZipDirectory {
    /// Whether the bytes start like a zip file.
    pub(crate) fn recognises(bytes: &[u8]) -> bool {
        bytes.starts_with(LOCAL_HEADER)
    }

    pub(crate) fn parse(file: SharedBytes) -> Result<Self, TorchError> {
        let end = EndOfDirectory::find(&file)?;
        let directory = end.directory(&file)?;
        let mut entries = HashMap::with_capacity(directory.len() / CENTRAL_HEADER_LEN);
        let mut at = 0;
        while at < directory.len() {
            let (name, entry, next) = central_entry(directory, at)?;
            if entries.insert(name.to_owned(), entry).is_some() {
                let found = format!("two of {:?}", shortened(name));
                return Err(TorchError::malformed("zip directory", "distinct entry names", found));
            }
            at = next;
        }
        if entries.len() as u64 != end.entries {
            let expected = format!("{} entries", end.entries);
            return Err(TorchError::malformed("zip directory", expected, entries.len().to_string()));
        }
        let directory_start = end.directory_start;
        let prefix = sole_prefix(&entries)?;
        let this = Self { file, prefix, entries, directory_start };
        this.require_little_endian()?;
        Ok(this)
    }

    /// The pickle of the saved object.
    pub(crate) fn pickle(&self) -> Result<SharedBytes, TorchError> {
        let pickle = self.bytes(&self.name("data.pkl"))?;
        pickle.verify()?;
        Ok(pickle)
    }

    /// Name of the entry of a storage.
    pub(crate) fn storage_name(&self, key: &str) -> String {
        [&self.prefix, "/data/", key].concat()
    }

    /// Length of an entry.
    pub(crate) fn len(&self, name: &str) -> Option<u64> {
        self.entries.get(name).map(|entry| entry.len)
    }

    /// The bytes of an entry, shared with the mapped file and not read yet.
    pub(crate) fn bytes(&self, name: &str) -> Result<SharedBytes, TorchError> {
        let location = || format!("zip entry {:?}", shortened(name));
        let missing = || TorchError::malformed("zip directory", format!("an entry {:?}", shortened(name)), "none");
        let entry = self.entries.get(name).ok_or_else(missing)?;
        let start = usize::try_from(entry.header)
            .ok()
            .and_then(|header| self.data_start(header))
            .ok_or_else(|| TorchError::malformed(location(), "a local header before the directory", "none"))?;
        let content = span(start, entry.len)
            .filter(|range| range.end <= self.directory_start)
            .and_then(|range| self.file.slice(range))
            .ok_or_else(|| {
                let expected = format!("{} bytes before the directory", entry.len);
                TorchError::malformed(location(), expected, format!("a start at {start}"))
            })?;
        if entry.crc == NO_CRC {
            return Ok(content);
        }
        let checksum = || Arc::new(Checksum::new(location(), content.clone(), entry.crc));
        let checksum = Arc::clone(entry.checksum.get_or_init(checksum));
        Ok(content.with_checksum(checksum))
    }

    fn name(&self, entry: &str) -> String {
        format!("{}/{entry}", self.prefix)
    }

    fn data_start(&self, header: usize) -> Option<usize> {
        let local = self.file.get(header..header.checked_add(LOCAL_HEADER_LEN)?)?;
        let (name, extra) = (u16_at(local, 26)?, u16_at(local, 28)?);
        let start = header.checked_add(LOCAL_HEADER_LEN + usize::from(name) + usize::from(extra))?;
        local.starts_with(LOCAL_HEADER).then_some(start)
    }

    fn require_little_endian(&self) -> Result<(), TorchError> {
        let name = self.name("byteorder");
        if !self.entries.contains_key(&name) {
            return Ok(());
        }
        let order = self.bytes(&name)?;
        order.verify()?;
        match &*order {
            b"little" => Ok(()),
            other => {
                let found = shortened(&String::from_utf8_lossy(other));
                Err(TorchError::unsupported(format!("zip entry {name:?}"), format!("byte order {found:?}")))
            }
        }
    }
}

struct EndOfDirectory {
    entries: u64,
    directory_start: usize,
    directory_end: usize,
}

impl EndOfDirectory {
    /// Searches backwards, because a comment of up to 65535 bytes may follow the record.
    fn find(file: &[u8]) -> Result<Self, TorchError> {
        let searched = file.len().saturating_sub(END_OF_DIRECTORY_LEN + usize::from(u16::MAX));
        let at = (searched..=file.len().saturating_sub(END_OF_DIRECTORY_LEN))
            .rev()
            .find(|&at| ends_file(file, at))
            .ok_or_else(|| TorchError::malformed("end of the zip file", "an end-of-directory record", "none"))?;
        Self::read(file, at)
            .ok_or_else(|| TorchError::malformed(format!("byte {at}"), "a directory inside the file", "one outside"))
    }

    fn read(file: &[u8], at: usize) -> Option<Self> {
        let (entries, len, start) = (u16_at(file, at + 10)?, u32_at(file, at + 12)?, u32_at(file, at + 16)?);
        if entries == u16::MAX || len == SATURATED || start == SATURATED {
            return Self::read_zip64(file, at.checked_sub(ZIP64_LOCATOR_LEN)?);
        }
        Self::new(u64::from(entries), u64::from(start), u64::from(len), at)
    }

    fn read_zip64(file: &[u8], locator: usize) -> Option<Self> {
        file.get(locator..)?.starts_with(ZIP64_LOCATOR).then_some(())?;
        let at = usize::try_from(u64_at(file, locator + 8)?).ok()?;
        let record = file.get(at..locator)?;
        record.starts_with(ZIP64_END_OF_DIRECTORY).then_some(())?;
        Self::new(u64_at(record, 32)?, u64_at(record, 48)?, u64_at(record, 40)?, at)
    }

    fn new(entries: u64, start: u64, len: u64, limit: usize) -> Option<Self> {
        let range = span(usize::try_from(start).ok()?, len)?;
        let fits = range.end <= limit;
        fits.then_some(Self { entries, directory_start: range.start, directory_end: range.end })
    }

    fn directory<'a>(&self, file: &'a [u8]) -> Result<&'a [u8], TorchError> {
        file.get(self.directory_start..self.directory_end)
            .ok_or_else(|| TorchError::malformed("zip directory", "a range inside the file", "one outside"))
    }
}

fn ends_file(file: &[u8], at: usize) -> bool {
    file.get(at..).is_some_and(|record| record.starts_with(END_OF_DIRECTORY))
        && u16_at(file, at + 20).is_some_and(|comment| at + END_OF_DIRECTORY_LEN + usize::from(comment) == file.len())
}

/// Name and entry of the directory record at `at`, and the start of the next record.
fn central_entry(directory: &[u8], at: usize) -> Result<(&str, Entry, usize), TorchError> {
    let location = || format!("zip directory byte {at}");
    let truncated = || TorchError::malformed(location(), "an entry", "the end of the directory");
    let header = directory.get(at..).filter(|rest| rest.len() >= CENTRAL_HEADER_LEN).ok_or_else(truncated)?;
    if !header.starts_with(CENTRAL_HEADER) {
        return Err(TorchError::malformed(location(), "an entry's signature", "other bytes"));
    }
    let field16 = |offset| u16_at(header, offset).map(usize::from).ok_or_else(truncated);
    let field32 = |offset| u32_at(header, offset).ok_or_else(truncated);
    let (name_len, extra_len, comment_len) = (field16(28)?, field16(30)?, field16(32)?);
    let extra_start = CENTRAL_HEADER_LEN + name_len;
    let comment_start = extra_start + extra_len;
    let name = header.get(CENTRAL_HEADER_LEN..extra_start).ok_or_else(truncated)?;
    let name = std::str::from_utf8(name)
        .map_err(|source| TorchError::malformed(location(), "a name in UTF-8", source.to_string()))?;
    let extra = header.get(extra_start..comment_start).ok_or_else(truncated)?;

    let entry_location = || format!("zip entry {:?}", shortened(name));
    let (flags, method) = (field16(8)?, field16(10)?);
    if method != 0 {
        return Err(TorchError::unsupported(entry_location(), format!("compression method {method}")));
    }
    if flags & 1 != 0 {
        return Err(TorchError::unsupported(entry_location(), "encryption"));
    }
    let mut wide = zip64_fields(extra);
    let mut widened = |narrow: u32| match narrow {
        SATURATED => wide.next(),
        narrow => Some(u64::from(narrow)),
    };
    // The zip64 record holds only the saturated fields, in this order.
    let (compressed, packed, offset) = (field32(24)?, field32(20)?, field32(42)?);
    let (Some(len), Some(packed), Some(header)) = (widened(compressed), widened(packed), widened(offset)) else {
        return Err(TorchError::malformed(entry_location(), "a zip64 field", "none"));
    };
    if len != packed {
        let found = format!("{packed} and {len}");
        return Err(TorchError::malformed(entry_location(), "equal packed and unpacked lengths", found));
    }
    let entry = Entry { header, len, crc: field32(16)?, checksum: OnceLock::new() };
    Ok((name, entry, at + comment_start + comment_len))
}

/// The u64 values of the zip64 extra field, if there is one.
fn zip64_fields(mut extra: &[u8]) -> impl Iterator<Item = u64> {
    let mut fields: &[u8] = &[];
    while let (Some(id), Some(len)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let Some(body) = extra.get(4..4 + usize::from(len)) else { break };
        if id == ZIP64_EXTRA {
            fields = body;
            break;
        }
        extra = &extra[4 + usize::from(len)..];
    }
    fields.as_chunks::<8>().0.iter().map(|field| u64::from_le_bytes(*field))
}

fn sole_prefix(entries: &HashMap<String, Entry>) -> Result<String, TorchError> {
    let mut prefixes = entries.keys().filter_map(|name| name.strip_suffix("/data.pkl"));
    match (prefixes.next(), prefixes.next()) {
        (Some(prefix), None) => Ok(prefix.to_owned()),
        (None, _) => Err(TorchError::malformed("zip directory", "an entry data.pkl in a folder", "none")),
        (Some(_), Some(_)) => Err(TorchError::malformed("zip directory", "one entry data.pkl", "several")),
    }
}
