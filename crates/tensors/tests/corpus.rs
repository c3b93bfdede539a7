//! Replays every input in the corpus of the fuzz target `weights_file`.

use std::path::PathBuf;

use atsplat_pickle::SharedBytes;
use atsplat_tensors::StoredTensors;

#[test]
fn weights_files_round_trip() {
    let mut read = 0;
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/weights_file");
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        let Ok(stored) = StoredTensors::parse(SharedBytes::new(bytes)) else { continue };
        let rewritten = StoredTensors::parse(SharedBytes::new(stored.to_safetensors().unwrap())).unwrap();
        assert_eq!(rewritten.digest(), stored.digest());
        read += 1;
    }
    assert!(read >= 4, "some inputs are valid files");
}
