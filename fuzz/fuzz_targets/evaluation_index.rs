//! Any bytes give an index or an error; an index that was read is written and read back the same.

#![no_main]

use atsplat_protocol::{IndexFile, LintOptions, lint_file};
use atsplat_scene::Warnings;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(file) = IndexFile::parse(bytes) else { return };
    let text = file.index.to_json(&file.layout);
    let again = IndexFile::parse(text.as_bytes()).expect("what was written is an index");
    assert_eq!(again.index, file.index);
    assert_eq!(again.index.content_hash(), file.index.content_hash());
    let report = lint_file(&file, &LintOptions::default(), &mut Warnings::new());
    assert_eq!(report.targets as usize, file.index.target_count());
    assert!(report.leaked.targets <= report.targets && report.outside_window.targets <= report.targets);
    assert!(!report.to_string().contains("NaN"));
});
