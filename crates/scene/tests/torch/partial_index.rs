//! Chunks next to an index that does not list all of their scenes.

use std::fs;

use crate::chunks::{KEYS, folder, numbered, open, write};
use crate::support::fixture_bytes;
use atsplat_scene::{SceneError, SceneSource, WarningKind, Warnings};
use tempfile::TempDir;

/// As after copying another export next to a partial index. The published loaders go through all scenes of all chunks.
#[test]
fn scenes_that_the_index_does_not_list_are_read() {
    let other = TempDir::new().unwrap();
    write(other.path(), 1 << 20, vec![numbered(5, 10)]);
    let (chunk, more) = (fixture_bytes("zip.torch"), fs::read(other.path().join("000000.torch")).unwrap());
    let index = format!(r#"{{"gone": "000009.torch", "{}": "000000.torch", "not there": "000000.torch"}}"#, KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk), ("000001.torch", &more)]);
    let (source, warnings) = open(folder.path());
    let source = source.unwrap();
    assert_eq!(source.keys(), [KEYS[0], KEYS[1], "scene5"], "in the chunks' order");
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::SceneNotFound, 2), (WarningKind::SceneBeyondIndex, 2)]);
    let details: Vec<String> = warnings.kept().iter().map(ToString::to_string).collect();
    assert!(details[1].starts_with("scene5: ") && details[1].contains("000001.torch"), "{details:?}");
    assert!(details[2].starts_with("gone: ") && details[2].ends_with("000009.torch, which is missing"), "{details:?}");
    assert!(details[3].ends_with("000000.torch, which does not contain it"), "{details:?}");
    for key in source.keys() {
        assert!(source.load(key, &mut Warnings::new()).is_ok(), "{key}");
    }
}

/// Both chunks contain both scenes, and the index lists the first in the second chunk.
#[test]
fn the_index_says_which_of_two_chunks_a_scene_is_read_from() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!(r#"{{"{}": "000001.torch", "{}": "000000.torch"}}"#, KEYS[0], KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk), ("000001.torch", &chunk)]);
    let (source, warnings) = open(folder.path());
    let source = source.unwrap();
    assert_eq!(source.keys(), [KEYS[1], KEYS[0]]);
    assert_eq!(source.files(KEYS[0]).unwrap(), [folder.path().join("000001.torch")]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::DuplicateScene, 2)]);
}

/// The scenes of the index in a chunk that cannot be read fail when they are loaded, as each entry of theirs does.
#[test]
fn an_invalid_chunk_of_an_index_keeps_its_scenes() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!(r#"{{"{}": "000000.torch", "lost": "000001.torch"}}"#, KEYS[0]);
    let invalid = b"PK\x03\x04 and no more";
    let folder = folder(&[
        ("index.json", index.as_bytes()),
        ("000000.torch", &chunk),
        ("000001.torch", invalid),
        ("000002.torch", invalid),
    ]);
    let (source, warnings) = open(folder.path());
    let source = source.unwrap();
    assert_eq!(source.keys(), [KEYS[0], KEYS[1], "lost"]);
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::UnreadableScene, 1), (WarningKind::SceneBeyondIndex, 1)]);
    assert!(warnings.kept().iter().any(|warning| warning.scene.ends_with("000002.torch")), "{warnings:?}");
    assert!(matches!(source.load("lost", &mut Warnings::new()), Err(SceneError::Torch { .. })));
}

/// The chunk before it has the scene that the index lists in the invalid one: nothing is left to fail when it is loaded.
#[test]
fn an_invalid_chunk_whose_scenes_are_in_an_earlier_one_is_reported() {
    let (chunk, invalid) = (fixture_bytes("zip.torch"), b"PK\x03\x04 and no more");
    let index = format!(r#"{{"{}": "000000.torch", "{}": "000001.torch"}}"#, KEYS[0], KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk), ("000001.torch", invalid)]);
    let (source, warnings) = open(folder.path());
    let source = source.unwrap();
    assert_eq!(source.keys(), KEYS);
    assert_eq!(source.files(KEYS[1]).unwrap(), [folder.path().join("000000.torch")]);
    let counts = [WarningKind::UnreadableScene, WarningKind::DuplicateScene].map(|kind| warnings.count(kind));
    assert_eq!((counts, warnings.total()), ([1, 1], 2), "{warnings:?}");
    let unreadable = warnings.kept().iter().find(|warning| warning.kind == WarningKind::UnreadableScene).unwrap();
    assert!(unreadable.scene.ends_with("000001.torch"), "{unreadable}");
}
