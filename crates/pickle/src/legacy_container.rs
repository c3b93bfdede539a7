//! The legacy format of `torch.save` before 1.6 (`_use_new_zipfile_serialization=False`): five pickles (magic number,
//! protocol version, system information, the object, its storage keys), then each storage as an i64 element count and its
//! raw little-endian elements (PyTorch `torch/serialization.py`, `_legacy_save`).

use std::collections::HashMap;
use std::sync::Arc;

use crate::container::Container;
use crate::graph::Graph;
use crate::interpreter::{self, Parsed};
use crate::shared_bytes::{array_at, span};
use crate::{SharedBytes, TorchError, Value, shortened};

/// `pickle.dumps(0x1950a86a20f9469cfc6c, protocol=2)`.
const MAGIC: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
const PROTOCOL_VERSION: i64 = 1001;

/// Whether the bytes start with the magic number.
pub(crate) fn recognises(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

pub(crate) fn parse(file: &SharedBytes) -> Result<Value, TorchError> {
    let mut at = MAGIC.len();
    match plain(next_pickle(file, &mut at)?)? {
        Value::Int(PROTOCOL_VERSION) => {}
        other => {
            let expected = format!("protocol version {PROTOCOL_VERSION}");
            return Err(TorchError::malformed("legacy header", expected, other.to_string()));
        }
    }
    // Byte order and type sizes of the writer, which torch.load ignores too.
    next_pickle(file, &mut at)?;
    let object = next_pickle(file, &mut at)?;
    let keys = plain(next_pickle(file, &mut at)?)?;
    let buffers = storages(file, at, &keys, &object.graph)?;
    object.graph.into_value(object.root, &Arc::new(Container::Buffers(buffers)))
}

fn next_pickle<'a>(file: &'a [u8], at: &mut usize) -> Result<Parsed<'a>, TorchError> {
    let parsed = interpreter::parse(file, *at)?;
    *at = parsed.end;
    Ok(parsed)
}

/// The value of a pickle without tensors.
pub(crate) fn plain(parsed: Parsed<'_>) -> Result<Value, TorchError> {
    parsed.graph.into_value(parsed.root, &Arc::new(Container::Buffers(HashMap::new())))
}

fn storages(
    file: &SharedBytes,
    mut at: usize,
    keys: &Value,
    graph: &Graph<'_>,
) -> Result<HashMap<String, SharedBytes>, TorchError> {
    let listed = match keys {
        Value::List(keys) => keys,
        other => return Err(TorchError::malformed("legacy storage keys", "a list", other.to_string())),
    };
    let referenced = graph.storages()?;
    let mut buffers = HashMap::new();
    for key in listed.iter() {
        let key = key.as_str().ok_or_else(|| TorchError::malformed("legacy storage keys", "text", key.to_string()))?;
        let location = || format!("legacy storage {:?} at byte {at}", shortened(key));
        let &(dtype, len) = referenced
            .get(key)
            .ok_or_else(|| TorchError::malformed(location(), "a storage that a tensor refers to", "an unused one"))?;
        let counted = array_at(file, at).map(i64::from_le_bytes);
        if counted.and_then(|count| u64::try_from(count).ok()) != Some(len) {
            let found = counted.map_or_else(|| "the end of the file".to_owned(), |count| count.to_string());
            return Err(TorchError::malformed(location(), format!("a count of {len} elements"), found));
        }
        let buffer = len
            .checked_mul(dtype.bytes() as u64)
            .and_then(|bytes| span(at.checked_add(size_of::<i64>())?, bytes))
            .and_then(|range| Some((range.end, file.slice(range)?)));
        let Some((end, buffer)) = buffer else {
            return Err(TorchError::malformed(location(), format!("{len} elements"), "the end of the file"));
        };
        if buffers.insert(key.to_owned(), buffer).is_some() {
            return Err(TorchError::malformed(location(), "distinct storage keys", "a repeated one"));
        }
        at = end;
    }
    Ok(buffers)
}
