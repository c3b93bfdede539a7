//! The safetensors format (huggingface/safetensors): eight bytes of length, a JSON header, then the tensors without gaps.
//! Not read by the `safetensors` crate, so that no hostile header can overflow, duplicate names are errors, and errors say
//! where; not written by it, so that the same weights always give the same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::{ErrorKind, Read as _, Result as IoResult};
use std::path::Path;

use atsplat_files::Malformed;
use atsplat_pickle::{DType, SharedBytes, shortened};
use indexmap::IndexMap;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::{StoredTensor, StoredTensors, TensorError, TensorView};

const WHAT: &str = "safetensors file";
const LENGTH: usize = size_of::<u64>();
/// The format's own limit.
const MAX_HEADER_BYTES: u64 = 100_000_000;
const METADATA: &str = "__metadata__";
/// Readers map the file and need aligned numbers; other writers also pad the header to eight bytes.
const ALIGNMENT: usize = 8;

/// Whether bytes look like a safetensors file: a length that fits and an opening brace.
pub(crate) fn recognises(file: &[u8]) -> bool {
    let length = file.first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    length.is_some_and(|length| length < file.len() as u64) && file.get(LENGTH) == Some(&b'{')
}

/// Reads tensors in the order of their bytes, and the file's metadata.
pub(crate) fn parse(file: &SharedBytes) -> Result<StoredTensors, TensorError> {
    let length = file.first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    let length =
        length.ok_or_else(|| malformed("byte 0", "eight bytes of header length", format!("{} bytes", file.len())))?;
    let inside = file.len() as u64 - LENGTH as u64;
    let most = inside.min(MAX_HEADER_BYTES);
    let data_start = usize::try_from(length).ok().filter(|_| length <= most).map(|length| LENGTH + length);
    let (header, data) = data_start
        .and_then(|start| file.get(LENGTH..start).zip(file.slice(start..file.len())))
        .ok_or_else(|| malformed("byte 0", format!("a header length of at most {most}"), length))?;
    let header: Header = serde_json::from_slice(header).map_err(|error| {
        malformed(format!("header, line {} column {}", error.line(), error.column()), "a JSON object of tensors", error)
    })?;
    Ok(StoredTensors { tensors: tensors(header.tensors, &data)?, metadata: header.metadata })
}

/// The metadata of a safetensors file, of which only the header is read; `None` for another file, or one whose header is malformed.
/// The data may be damaged or missing.
///
/// # Errors
/// If the file cannot be read.
pub fn read_metadata(path: &Path) -> IoResult<Option<BTreeMap<String, String>>> {
    let mut file = atsplat_files::open(path)?;
    let (mut length, mut header) = ([0; LENGTH], Vec::new());
    match file.read_exact(&mut length) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        outcome => outcome?,
    }
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER_BYTES {
        return Ok(None);
    }
    file.take(length).read_to_end(&mut header)?;
    Ok(serde_json::from_slice::<Header>(&header).ok().map(|header| header.metadata))
}

/// A file of the given tensors up to their data, which follow in the same order: length and header. The same arguments give the
/// same bytes.
///
/// # Errors
/// [`TensorError::Malformed`] for the reserved name of the metadata, and for a name that two tensors have.
pub(crate) fn start(
    tensors: &[(&str, TensorView<'_>)],
    metadata: &BTreeMap<String, String>,
) -> Result<Vec<u8>, TensorError> {
    let mut header = Header { tensors: Vec::with_capacity(tensors.len()), metadata: metadata.clone() };
    let (mut names, mut end) = (BTreeSet::new(), 0);
    for (name, tensor) in tensors {
        if *name == METADATA {
            return Err(malformed("tensor name", format!("any but {METADATA}"), name));
        }
        if !names.insert(*name) {
            return Err(malformed(format!("tensor {:?}", shortened(name)), "a unique name", "two tensors"));
        }
        let start = end;
        end += tensor.bytes().len() as u64;
        let shape = tensor.shape().iter().map(|&size| size as u64).collect();
        let dtype = dtype_name(tensor.dtype()).to_owned();
        header.tensors.push(((*name).to_owned(), Entry { dtype, shape, data_offsets: (start, end) }));
    }
    let mut json = serde_json::to_vec(&header).map_err(|error| malformed("header", "text and numbers", error))?;
    json.resize(json.len().next_multiple_of(ALIGNMENT), b' ');
    let mut file = (json.len() as u64).to_le_bytes().to_vec();
    file.append(&mut json);
    Ok(file)
}

fn tensors(
    mut entries: Vec<(String, Entry)>,
    data: &SharedBytes,
) -> Result<IndexMap<String, StoredTensor>, TensorError> {
    entries.sort_by_key(|(_, entry)| entry.data_offsets);
    let mut tensors = IndexMap::with_capacity(entries.len());
    let mut expected_start = 0;
    for (name, Entry { dtype, shape, data_offsets: (start, end) }) in entries {
        let location = || format!("tensor {:?}", shortened(&name));
        if start != expected_start {
            let expected = format!("data that begins at {expected_start}, the end of the previous tensor");
            return Err(malformed(location(), expected, start));
        }
        expected_start = end;
        let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
        let bytes = range.and_then(|(start, end)| data.slice(start..end)).ok_or_else(|| {
            malformed(location(), format!("data within {} bytes", data.len()), format!("{start} to {end}"))
        })?;
        let dtype = dtype_of(&dtype).ok_or_else(|| {
            malformed(location(), "U8, I8, I16, I32, I64, BOOL, F16, BF16, F32 or F64", shortened(&dtype))
        })?;
        let shape: Option<Vec<usize>> = shape.iter().map(|&size| usize::try_from(size).ok()).collect();
        let shape = shape.ok_or_else(|| malformed(location(), "sizes that this machine can address", "larger ones"))?;
        let tensor =
            StoredTensor::new(dtype, shape, bytes).map_err(|error| malformed(location(), "a whole tensor", error))?;
        if tensors.insert(name.clone(), tensor).is_some() {
            return Err(malformed(location(), "a unique name", "two tensors"));
        }
    }
    if expected_start != data.len() as u64 {
        return Err(malformed("end of file", format!("{expected_start} bytes of data"), data.len()));
    }
    Ok(tensors)
}

struct Header {
    /// In the order of the file.
    tensors: Vec<(String, Entry)>,
    metadata: BTreeMap<String, String>,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Entry {
    dtype: String,
    shape: Vec<u64>,
    data_offsets: (u64, u64),
}

impl<'de> Deserialize<'de> for Header {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries;
        impl<'de> Visitor<'de> for Entries {
            type Value = Header;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("tensors by name")
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Header, M::Error> {
                let (mut tensors, mut metadata) = (Vec::new(), None);
                while let Some(name) = map.next_key::<String>()? {
                    if name != METADATA {
                        tensors.push((name, map.next_value()?));
                    } else if metadata.replace(map.next_value()?).is_some() {
                        return Err(M::Error::duplicate_field(METADATA));
                    }
                }
                Ok(Header { tensors, metadata: metadata.unwrap_or_default() })
            }
        }
        deserializer.deserialize_map(Entries)
    }
}

impl Serialize for Header {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        if !self.metadata.is_empty() {
            map.serialize_entry(METADATA, &self.metadata)?;
        }
        for (name, entry) in &self.tensors {
            map.serialize_entry(name, entry)?;
        }
        map.end()
    }
}

const DTYPES: [(&str, DType); 10] = [
    ("U8", DType::U8),
    ("I8", DType::I8),
    ("I16", DType::I16),
    ("I32", DType::I32),
    ("I64", DType::I64),
    ("BOOL", DType::Bool),
    ("F16", DType::F16),
    ("BF16", DType::Bf16),
    ("F32", DType::F32),
    ("F64", DType::F64),
];

fn dtype_of(name: &str) -> Option<DType> {
    DTYPES.iter().find(|(known, _)| *known == name).map(|(_, dtype)| *dtype)
}

#[expect(clippy::expect_used, reason = "the table has every type")]
fn dtype_name(dtype: DType) -> &'static str {
    DTYPES.iter().find(|(_, known)| *known == dtype).map(|(name, _)| *name).expect("a type of the table")
}

fn malformed(location: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> TensorError {
    Malformed::new(WHAT, location, expected, found).into()
}
