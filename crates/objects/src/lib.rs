//! Datasets and results stores in object storage (`s3://`, `gs://`, `az://`), through copies on this disk.
//!
//! All other crates read files. So a [`Mirror`] shows the objects below a URL as a folder of files, and fetches contents when
//! they are needed; a [`StoreCopy`] is a results store that is written here and sent there.
//!
//! A separate program, `atsplat-objects`, opens the connections: to the URL that it is given, with the credentials and
//! endpoints of its environment, as the crate `object_store` reads them. It is built from this crate with the feature
//! `object-storage`. Without it, no code for networks is installed, and other crates are not compiled again with the features
//! that networks need. The library starts the program when it is given a URL, and both exchange lines of JSON
//! (`storage/mod.rs`).

mod cache;
mod error;
mod mirror;
#[cfg(feature = "object-storage")]
pub mod serve;
mod storage;
mod store_copy;
mod store_files;
#[cfg(all(test, feature = "object-storage"))]
mod tests;

use std::path::Path;

pub use error::ObjectError;
pub use mirror::Mirror;
pub use storage::Traffic;
pub use store_copy::StoreCopy;

/// Schemes of URLs: Amazon S3 and what speaks its protocol, Google Cloud Storage, Azure Blob Storage, and a folder of this
/// machine, which is for trying things out.
pub const SCHEMES: [&str; 4] = ["s3", "gs", "az", "file"];

/// The text of a path that is a URL of object storage, as `s3://bucket/data`; `None` for other paths.
pub fn url(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    let (scheme, _) = text.split_once("://")?;
    SCHEMES.contains(&scheme).then_some(text)
}
