//! Builds `.torch` files by hand, mainly malformed ones.

use std::io::{Cursor, Write};
use std::path::PathBuf;

use atsplat_scene::SharedBytes;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

pub(crate) fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/torch").join(name)
}

pub(crate) fn fixture_bytes(name: &str) -> Vec<u8> {
    let path = fixture(name);
    std::fs::read(&path).unwrap_or_else(|error| panic!("{error} ({})", path.display()))
}

pub(crate) fn shared(bytes: impl Into<Vec<u8>>) -> SharedBytes {
    SharedBytes::new(bytes.into())
}

/// An uncompressed zip file with these entries, in this order.
pub(crate) fn zip_of(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(*name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A zip file as `torch.serialization.set_crc32_options(False)` writes it: without CRCs, so that damage is not found.
pub(crate) fn without_crcs(mut zip: Vec<u8>) -> Vec<u8> {
    let headers: Vec<usize> = (0..zip.len()).filter(|&at| zip[at..].starts_with(b"PK\x01\x02")).collect();
    for at in headers {
        zip[at + 16..at + 20].fill(0);
    }
    zip
}

/// A `torch.save` file with this pickle and one storage.
pub(crate) fn saved(pickle: &[u8], storage: &[u8]) -> SharedBytes {
    shared(zip_of(&[("archive/data.pkl", pickle), ("archive/data/0", storage), ("archive/version", b"3\n")]))
}

pub(crate) fn text(value: &str) -> Vec<u8> {
    let mut bytes = vec![b'X'];
    bytes.extend(u32::try_from(value.len()).unwrap().to_le_bytes());
    bytes.extend(value.as_bytes());
    bytes
}

pub(crate) fn integer(value: i64) -> Vec<u8> {
    let mut bytes = vec![0x8a, 8];
    bytes.extend(value.to_le_bytes());
    bytes
}

pub(crate) fn tuple(numbers: &[i64]) -> Vec<u8> {
    let mut bytes = vec![b'('];
    bytes.extend(numbers.iter().flat_map(|&number| integer(number)));
    bytes.push(b't');
    bytes
}

/// `('storage', class, '0', 'cpu', len)` as a persistent id.
pub(crate) fn storage(class: &str, len: i64) -> Vec<u8> {
    let class = format!("ctorch\n{class}\n");
    [b"(", &text("storage")[..], class.as_bytes(), &text("0"), &text("cpu"), &integer(len), b"tQ"].concat()
}

/// `_rebuild_tensor_v2(storage, offset, shape, strides, False, OrderedDict())`.
pub(crate) fn tensor(storage: &[u8], offset: i64, shape: &[i64], strides: &[i64]) -> Vec<u8> {
    [
        b"ctorch._utils\n_rebuild_tensor_v2\n(",
        storage,
        &integer(offset),
        &tuple(shape),
        &tuple(strides),
        b"\x89ccollections\nOrderedDict\n)RtR",
    ]
    .concat()
}

/// A complete pickle of protocol 2.
pub(crate) fn pickle(body: &[u8]) -> Vec<u8> {
    [b"\x80\x02", body, b"."].concat()
}
