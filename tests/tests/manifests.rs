//! The manifests in `datasets/` and the table of official indices say the same.

use std::collections::BTreeSet;
use std::path::Path;

use atsplat_protocol::KNOWN_INDICES;
use serde::Deserialize;

#[derive(Deserialize)]
struct Manifest {
    id: String,
    #[serde(default)]
    index: Vec<ListedIndex>,
}

#[derive(Deserialize)]
struct ListedIndex {
    sha256: String,
    file: String,
}

#[test]
fn every_official_index_is_listed_with_its_dataset() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets");
    let mut listed = BTreeSet::new();
    for entry in folder.read_dir().unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let manifest: Manifest = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
            listed.extend(manifest.index.into_iter().map(|index| (manifest.id.clone(), index.sha256, index.file)));
        }
    }
    let known: BTreeSet<_> = KNOWN_INDICES
        .iter()
        .map(|known| {
            (known.dataset.to_owned(), known.sha256.to_string(), format!("{} {}", known.repository, known.path))
        })
        .collect();
    assert_eq!(listed, known);
}
