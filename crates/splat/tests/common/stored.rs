//! The tensors of a safetensors file.

use std::path::Path;

/// The tensors of a safetensors file below `tests/fixtures`, by name.
pub(crate) struct Stored {
    header: serde_json::Value,
    data: Vec<u8>,
}

impl Stored {
    pub(crate) fn read(path: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(path);
        let bytes = std::fs::read(path).unwrap();
        let (length, rest) = bytes.split_first_chunk().unwrap();
        let (header, data) = rest.split_at(usize::try_from(u64::from_le_bytes(*length)).unwrap());
        Self { header: serde_json::from_slice(header).unwrap(), data: data.to_vec() }
    }

    /// The bytes of a tensor.
    pub(crate) fn bytes(&self, name: &str) -> &[u8] {
        let offset = |end: usize| usize::try_from(self.header[name]["data_offsets"][end].as_u64().unwrap()).unwrap();
        &self.data[offset(0)..offset(1)]
    }

    /// The values of a tensor of f32.
    pub(crate) fn values(&self, name: &str) -> Vec<f32> {
        self.bytes(name).as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect()
    }

    /// The values of a tensor of f32, in rows.
    pub(crate) fn rows<const N: usize>(&self, name: &str) -> Vec<[f32; N]> {
        self.values(name).as_chunks().0.to_vec()
    }
}
