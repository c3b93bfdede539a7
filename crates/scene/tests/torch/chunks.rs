//! Folders of chunks, and chunks written by this toolkit.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::support::{fixture, fixture_bytes, pickle, saved, text};
use atsplat_numeric::Tolerance;
use atsplat_scene::inspect::left_out;
use atsplat_scene::torch::{Chunk, ChunkScene, ChunkWriter, TorchChunks};
use atsplat_scene::{
    Dataset, Fetch, FrameImage, OpenOptions, SceneError, SceneSource, SharedBytes, WarningKind, Warnings, open_with,
};
use proptest::prelude::*;
use tempfile::TempDir;

pub(crate) const KEYS: [&str; 2] = ["aaaa000000000001", "bbbb000000000002"];

pub(crate) fn folder(files: &[(&str, &[u8])]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, bytes) in files {
        atsplat_tests::write_file(&folder.path().join(name), bytes);
    }
    folder
}

pub(crate) fn open(path: &Path) -> (Result<TorchChunks, SceneError>, Warnings) {
    let mut warnings = Warnings::new();
    (TorchChunks::open(path, &mut warnings), warnings)
}

/// Of chunks that are fetched when they are read; these are here already.
#[derive(Debug)]
struct Here;

impl Fetch for Here {
    fn fetch(&self, _: &[PathBuf]) -> io::Result<()> {
        Ok(())
    }
}

fn open_to_fetch(path: &Path) -> (Result<Dataset, SceneError>, Warnings) {
    let mut warnings = Warnings::new();
    let options = OpenOptions { fetch: Some(Arc::new(Here)), ..OpenOptions::default() };
    (open_with(path, &options, &mut warnings), warnings)
}

fn stored_scenes() -> Vec<ChunkScene> {
    let chunk = Chunk::open(fixture("zip.torch"), &mut Warnings::new()).unwrap();
    chunk.keys().iter().map(|key| chunk.record(key).unwrap()).collect()
}

pub(crate) fn numbered(number: usize, image_bytes: usize) -> ChunkScene {
    let mut image = b"\xff\xd8\xff".to_vec();
    image.resize(image_bytes, 7);
    ChunkScene {
        key: format!("scene{number}"),
        url: String::new(),
        timestamps: vec![i64::try_from(number).unwrap()],
        cameras: vec![[0.5, 0.9, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3]],
        images: vec![SharedBytes::new(image)],
    }
}

pub(crate) fn write(folder: &Path, target_bytes: u64, scenes: Vec<ChunkScene>) -> Vec<String> {
    let mut writer = ChunkWriter::create(folder, target_bytes).unwrap();
    for scene in scenes {
        writer.push(scene).unwrap();
    }
    let written = writer.finish().unwrap();
    written.chunks.iter().map(|chunk| chunk.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

#[test]
fn a_folder_is_read_with_and_without_an_index_and_below_its_split() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!("{{\"{}\": \"000000.torch\", \"{}\": \"000000.torch\"}}", KEYS[0], KEYS[1]);
    for files in [
        vec![("000000.torch", &chunk[..]), ("index.json", index.as_bytes())],
        vec![("000000.torch", &chunk[..])],
        vec![
            ("test/000000.torch", &chunk[..]),
            ("test/index.json", index.as_bytes()),
            ("train/000000.torch", b"other"),
        ],
        vec![("train/000000.torch", &chunk[..])],
    ] {
        let folder = folder(&files);
        let (source, mut warnings) = open(folder.path());
        let source = source.unwrap();
        assert_eq!(source.keys(), KEYS);
        assert_eq!(source.load(KEYS[1], &mut warnings).unwrap().frames.len(), 3);
        assert!(matches!(source.load("cccc", &mut warnings), Err(SceneError::UnknownScene { .. })));
        assert_eq!(warnings.total(), 0);
    }
}

/// `index.json` is also the name of evaluation indices. One of chunks in a folder below is of this dataset.
#[test]
fn an_index_that_names_no_chunk_does_not_hide_the_chunks_below() {
    let chunk = fixture_bytes("zip.torch");
    let evaluation = format!(r#"{{"{}": {{"context": [0, 2], "target": [1]}}, "gone": null}}"#, KEYS[0]);
    let gone = format!(r#"{{"{}": "000000.torch"}}"#, KEYS[0]);
    let below = format!(r#"{{"gone": "000000.torch", "{}": "train/000000.torch"}}"#, KEYS[1]);
    for (index, stage, missing) in
        [("{}", "test", 0), (evaluation.as_str(), "test", 0), (gone.as_str(), "test", 0), (below.as_str(), "train", 1)]
    {
        let folder =
            folder(&[("index.json", index.as_bytes()), ("test/000000.torch", &chunk), ("train/000000.torch", &chunk)]);
        let (source, warnings) = open(folder.path());
        let source = source.unwrap();
        assert_eq!(source.keys(), KEYS, "{index}");
        assert_eq!(source.chunks(), [folder.path().join(stage).join("000000.torch")], "{index}");
        let counts = [WarningKind::SceneNotFound, WarningKind::SceneBeyondIndex].map(|kind| warnings.count(kind));
        assert_eq!((warnings.total(), counts), (2 * missing, [missing; 2]), "{index}");
    }
    let last = folder(&[("index.json", b"{}"), ("test/index.json", b"{}"), ("train/000000.torch", &chunk)]);
    assert_eq!(open(last.path()).0.unwrap().keys(), KEYS, "in train");
    let (alone, _) = open(folder(&[("index.json", gone.as_bytes()), ("test/x.txt", b"")]).path());
    assert!(alone.unwrap().keys().is_empty(), "the last resort");
}

#[test]
fn a_folder_named_like_a_chunk_does_not_hide_the_chunks_below() {
    let folder = folder(&[("old.torch/notes.txt", b""), ("test/000000.torch", &fixture_bytes("zip.torch"))]);
    let (source, warnings) = open(folder.path());
    assert_eq!((source.unwrap().keys(), warnings.total()), (&KEYS.map(str::to_owned)[..], 0));
    assert_eq!(open_to_fetch(folder.path()).0.unwrap().keys(), KEYS);
}

#[test]
fn a_single_chunk_is_a_dataset() {
    let (source, warnings) = open(&fixture("legacy.torch"));
    assert_eq!(source.unwrap().keys(), KEYS);
    assert_eq!(warnings.total(), 0);
}

#[test]
fn errors_of_an_index_are_reported() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!(r#"{{"gone": "000009.torch", "{}": "000000.torch", "not there": "000000.torch"}}"#, KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk), ("000001.torch", &chunk)]);
    let (source, mut warnings) = open_to_fetch(folder.path());
    let source = source.unwrap();
    assert_eq!(source.keys(), [KEYS[1], "not there"], "in the index's order");
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::SceneNotFound, 1), (WarningKind::UnindexedChunk, 1)]);
    assert!(source.load(KEYS[1], &mut warnings).is_ok());
    assert!(matches!(source.load("not there", &mut warnings), Err(SceneError::UnknownScene { .. })));
}

/// Each loading of the chunk's first listed scene brings it: of several threads that load it at once, any may keep its warnings.
#[test]
fn a_scene_that_the_index_does_not_list_is_reported() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!(r#"{{"{}": "000000.torch"}}"#, KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk)]);
    let (source, warnings) = open_to_fetch(folder.path());
    let source = source.unwrap();
    assert_eq!((source.keys(), warnings.total()), (&[KEYS[1].to_owned()][..], 0));
    for _ in 0..2 {
        let mut warnings = Warnings::new();
        source.load(KEYS[1], &mut warnings).unwrap();
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnindexedScene, 1)]);
        let warning = &warnings.kept()[0];
        assert!(warning.scene == KEYS[0] && warning.detail.contains("000000.torch"), "{warning}");
    }
}

/// What is wrong with a chunk comes with its first scene. Neither scene can be read.
#[test]
fn unreadable_scenes_are_the_same_in_any_order_of_loading() {
    let scene = |key: &str| [b"}", &text("key")[..], &text(key), b"s"].concat();
    let chunk = saved(&pickle(&[b"](", &scene("one")[..], b"}", &scene("two"), b"e"].concat()), b"");
    let index = br#"{"one": "000000.torch", "two": "000000.torch"}"#;
    let folder = folder(&[("index.json", index), ("000000.torch", &chunk)]);
    let found = |order: [&'static str; 2]| {
        let (source, mut all) = open_to_fetch(folder.path());
        let (source, mut of_scenes) = (source.unwrap(), BTreeMap::new());
        for key in order {
            let mut warnings = Warnings::new();
            let error = source.load(key, &mut warnings).unwrap_err();
            warnings.push(WarningKind::UnreadableScene, key, error.to_string());
            of_scenes.insert(key, warnings);
        }
        for warnings in of_scenes.into_values() {
            all.merge(warnings);
        }
        let of_kind = |kind| all.kept().iter().filter(|warning| warning.kind == kind).cloned().collect::<Vec<_>>();
        [WarningKind::UnreadableScene, WarningKind::UnindexedScene].map(of_kind)
    };
    let [unreadable, unindexed] = found(["one", "two"]);
    assert_eq!(unreadable.iter().map(|warning| warning.scene.as_str()).collect::<Vec<_>>(), ["one", "two"]);
    let [entry] = unindexed.as_slice() else { panic!("{unindexed:?}") };
    assert!(entry.scene.ends_with("000000.torch") && entry.detail.starts_with("scene 1 of the chunk: "), "{entry}");
    assert_eq!(found(["two", "one"]), [unreadable, unindexed]);
}

/// Two scenes of a chunk have one key: the second is lost. A further reference to the first is no loss.
#[test]
fn a_scene_with_the_key_of_another_in_its_chunk_is_lost() {
    let scene = |key: &str| [b"}", &text("key")[..], &text(key), b"s"].concat();
    let two = scene("two");
    let entries = [&b"]("[..], &scene("one"), b"q\x00", &two, b"h\x00", &scene("one"), &scene("one"), b"e"].concat();
    let chunk = saved(&pickle(&entries), b"");
    let counts = |warnings: &Warnings| {
        [WarningKind::DuplicateScene, WarningKind::UnreadableScene, WarningKind::UnindexedScene]
            .map(|kind| warnings.count(kind))
    };
    let scanned = folder(&[("000000.torch", &chunk)]);
    let (source, warnings) = open(scanned.path());
    assert_eq!(source.unwrap().keys(), ["one", "two"]);
    assert_eq!((counts(&warnings), left_out(&warnings, &warnings)), ([1, 2, 0], 2), "{warnings:?}");
    let detail = &warnings.kept().last().unwrap().detail;
    assert!(detail.starts_with("scene 4 of the chunk: expected a unique key, found the key \"one\""), "{detail}");
    let indexed =
        folder(&[("index.json", br#"{"one": "000000.torch", "two": "000000.torch"}"#), ("000000.torch", &chunk)]);
    let (source, warnings) = open(indexed.path());
    assert_eq!(source.unwrap().keys(), ["one", "two"]);
    assert_eq!((counts(&warnings), left_out(&warnings, &warnings)), ([1, 2, 0], 2), "{warnings:?}");
    // Found when the chunk is fetched; no index can list them.
    let (source, opening) = open_to_fetch(indexed.path());
    assert_eq!(opening.total(), 0, "{opening:?}");
    let mut warnings = opening.clone();
    source.unwrap().load("one", &mut warnings).unwrap_err();
    assert_eq!((counts(&warnings), left_out(&opening, &warnings)), ([1, 0, 2], 2), "{warnings:?}");
}

/// Both chunks contain both scenes, and the index lists one in each.
#[test]
fn a_scene_in_another_chunk_than_the_indexed_one_is_a_duplicate() {
    let chunk = fixture_bytes("zip.torch");
    let index = format!(r#"{{"{}": "000000.torch", "{}": "000001.torch"}}"#, KEYS[0], KEYS[1]);
    let folder = folder(&[("index.json", index.as_bytes()), ("000000.torch", &chunk), ("000001.torch", &chunk)]);
    let (source, _) = open_to_fetch(folder.path());
    let source = source.unwrap();
    for (key, other, name) in [(KEYS[0], KEYS[1], "000000.torch"), (KEYS[1], KEYS[0], "000001.torch")] {
        let mut warnings = Warnings::new();
        source.load(key, &mut warnings).unwrap();
        let duplicates: Vec<_> = warnings.kept().iter().filter(|w| w.kind == WarningKind::DuplicateScene).collect();
        let [duplicate] = duplicates.as_slice() else { panic!("{duplicates:?}") };
        assert!(duplicate.scene == other && duplicate.detail.contains(name), "{duplicate}");
    }
}

#[test]
fn a_truncated_index_is_not_said_to_repeat_keys() {
    let (source, _) = open(folder(&[("index.json", br#"{"a": "000000.torch", "b"#)]).path());
    let message = source.unwrap_err().to_string();
    assert!(message.contains("expected complete JSON, found the end of the file"), "{message}");
}

#[test]
fn an_index_cannot_refer_outside_its_folder() {
    let chunk = fixture_bytes("zip.torch");
    for name in
        ["../000000.torch", "/etc/passwd", "a/../../b.torch", "..\\\\000000.torch", "", ".", "./000000.torch/.."]
    {
        let index = format!(r#"{{"key": "{name}"}}"#);
        let folder = folder(&[("data/index.json", index.as_bytes()), ("000000.torch", &chunk)]);
        let (source, _) = open(&folder.path().join("data"));
        assert!(matches!(source, Err(SceneError::Malformed(_))), "{name:?}: {source:?}");
    }
}

#[test]
fn invalid_indices_and_empty_folders_are_typed_errors() {
    for index in ["", "[]", "{\"a\": 1}", "{\"a\": null}", "{", "\u{feff}[]", &"[".repeat(100_000)] {
        let (source, _) = open(folder(&[("index.json", index.as_bytes())]).path());
        assert!(matches!(source, Err(SceneError::Malformed(_))), "{index:.20}");
    }
    assert!(matches!(open(TempDir::new().unwrap().path()).0, Err(SceneError::Malformed(_))));
    assert!(matches!(open(Path::new("/nowhere/at/all")).0, Err(SceneError::Io(_))));
}

#[test]
fn lens_columns_that_are_not_zero_are_reported() {
    let folder = TempDir::new().unwrap();
    let mut distorted = numbered(1, 10);
    distorted.cameras.push(distorted.cameras[0]);
    distorted.timestamps.push(2);
    distorted.images.push(distorted.images[0].clone());
    distorted.cameras[1][5] = 0.25;
    write(folder.path(), 1 << 20, vec![numbered(0, 10), distorted]);
    let (source, mut warnings) = open(folder.path());
    let source = source.unwrap();
    source.load("scene0", &mut warnings).unwrap();
    assert_eq!(warnings.count(WarningKind::LensDistortion), 0);
    source.load("scene1", &mut warnings).unwrap();
    let detail = warnings.kept()[0].to_string();
    assert_eq!(warnings.count(WarningKind::LensDistortion), 1);
    assert!(detail.contains("scene1") && detail.contains("1 of 2 rows, first 1"), "{detail}");
}

#[test]
fn git_lfs_pointers_and_repeated_keys_are_reported() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    let (source, warnings) = open(folder(&[("000000.torch", pointer)]).path());
    assert!(source.unwrap().keys().is_empty());
    let detail = warnings.kept()[0].to_string();
    assert!(detail.contains("git lfs pull") && detail.contains("000000.torch"), "{detail}");

    let chunk = fixture_bytes("zip.torch");
    let index = format!("{{\"{0}\": \"000000.torch\",\n\"{0}\": \"000001.torch\"}}", KEYS[0]);
    let files = [("index.json", index.as_bytes()), ("000000.torch", &chunk[..]), ("000001.torch", &chunk[..])];
    let error = open(folder(&files).path()).0.unwrap_err().to_string();
    assert!(error.contains("line 2") && error.contains(KEYS[0]) && error.contains("index.json"), "{error}");
}

#[test]
fn an_invalid_chunk_does_not_affect_the_others() {
    let good = fixture_bytes("zip.torch");
    let folder =
        folder(&[("000000.torch", b"PK\x03\x04 and no more"), ("000001.torch", &good), ("000002.torch", &good)]);
    let (source, warnings) = open(folder.path());
    assert_eq!(source.unwrap().keys(), KEYS);
    assert_eq!(warnings.count(WarningKind::UnreadableScene), 1, "the invalid chunk");
    assert_eq!(warnings.count(WarningKind::DuplicateScene), 2, "the keys of the last chunk");
    let details: Vec<String> = warnings.kept().iter().map(ToString::to_string).collect();
    assert!(details[0].contains("000000.torch") && details[0].contains("end-of-directory"), "{details:?}");
}

/// The committed chunk is checked by PyTorch in `fixtures/torch/check_with_torch.py`. `ATSPLAT_BLESS=1` updates it.
#[test]
fn the_writer_reproduces_the_chunk_checked_by_pytorch() {
    let folder = TempDir::new().unwrap();
    assert_eq!(write(folder.path(), ChunkWriter::TARGET_BYTES, stored_scenes()), ["000000.torch"]);
    for name in ["000000.torch", "index.json"] {
        let written = fs::read(folder.path().join(name)).unwrap();
        let shown = fixture("written").join(name);
        if std::env::var_os("ATSPLAT_BLESS").is_some() {
            fs::create_dir_all(shown.parent().unwrap()).unwrap();
            fs::write(&shown, &written).unwrap();
        }
        assert!(written == fs::read(&shown).unwrap(), "{name} differs from the committed one");
    }
}

#[test]
fn writing_what_was_read_gives_the_same_bytes() {
    let (first, second) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    write(first.path(), 1, stored_scenes());
    let (source, mut warnings) = open(first.path());
    let source = source.unwrap();
    let scenes = source.keys().iter().map(|key| {
        let scene = source.load(key, &mut warnings).unwrap();
        ChunkScene::from_scene(&scene, &mut warnings).unwrap()
    });
    let names = write(second.path(), 1, scenes.collect());
    assert_eq!(names, ["000000.torch", "000001.torch"], "one scene each, because each reaches the target");
    for name in ["000000.torch", "000001.torch", "index.json"] {
        assert!(fs::read(first.path().join(name)).unwrap() == fs::read(second.path().join(name)).unwrap(), "{name}");
    }
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::UnexpectedSize, 6)], "the fixture's images do not have the shape of its cameras");
}

#[test]
fn storages_are_aligned_and_entries_stored() {
    let folder = TempDir::new().unwrap();
    write(folder.path(), 1, vec![numbered(0, 1000)]);
    let bytes = fs::read(folder.path().join("000000.torch")).unwrap();
    let mut zip = zip::ZipArchive::new(io::Cursor::new(&bytes)).unwrap();
    for index in 0..zip.len() {
        let entry = zip.by_index_raw(index).unwrap();
        assert_eq!(entry.compression(), zip::CompressionMethod::Stored);
        assert_eq!(entry.data_start().unwrap() % 64, 0, "{:?}", entry.name());
    }
}

#[test]
fn chunks_are_written_when_their_images_reach_the_target() {
    let folder = TempDir::new().unwrap();
    let names = write(
        folder.path(),
        1000,
        [400, 400, 400, 1000, 999]
            .map(|bytes| numbered(bytes, bytes))
            .into_iter()
            .enumerate()
            .map(|(at, scene)| ChunkScene { key: at.to_string(), ..scene })
            .collect(),
    );
    assert_eq!(names, ["000000.torch", "000001.torch", "000002.torch"]);
    let index = fs::read_to_string(folder.path().join("index.json")).unwrap();
    assert_eq!(
        index,
        r#"{"0":"000000.torch","1":"000000.torch","2":"000000.torch","3":"000001.torch","4":"000002.torch"}"#
    );
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 4, "no partial file is left: {left:?}");
}

/// As after a kill: a writer that is not finished leaves the chunks that were full.
#[test]
fn an_interrupted_writer_leaves_no_dataset() {
    let folder = TempDir::new().unwrap();
    let mut writer = ChunkWriter::create(folder.path(), 1000).unwrap();
    for scene in [numbered(0, 1000), numbered(1, 999)] {
        writer.push(scene).unwrap();
    }
    drop(writer);
    let (source, warnings) = open(folder.path());
    assert!(folder.path().join("000000.torch").is_file() && source.unwrap().keys().is_empty());
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnindexedChunk, 1)]);
    assert!(warnings.kept()[0].detail.contains("interrupted"), "{:?}", warnings.kept());
}

#[test]
fn scenes_that_a_chunk_cannot_store_are_rejected() {
    let folder = TempDir::new().unwrap();
    let mut writer = ChunkWriter::create(folder.path(), u64::MAX).unwrap();
    writer.push(numbered(0, 100)).unwrap();
    let mut wrong: [ChunkScene; 6] = std::array::from_fn(|at| numbered(at, 100));
    wrong[1].timestamps.push(3);
    wrong[2].images.clear();
    wrong[3].images[0] = SharedBytes::new(b"GIF89a".to_vec());
    wrong[4].cameras.clear();
    wrong[5].cameras[0][9] = 1e300;
    for scene in wrong {
        let key = scene.key.clone();
        assert!(matches!(writer.push(scene), Err(SceneError::Torch { .. })), "{key}");
    }
    assert_eq!(writer.finish().unwrap().scenes, 1, "rejected scenes are skipped");
    write(&folder.path().join("new"), 1, vec![numbered(0, 10)]);
    assert!(
        matches!(ChunkWriter::create(folder.path().join("new"), 1), Err(SceneError::Malformed(_))),
        "already written"
    );
}

#[test]
fn frames_without_an_image_or_number_cannot_be_stored() {
    let chunk = Chunk::open(fixture("zip.torch"), &mut Warnings::new()).unwrap();
    let scene = chunk.load(KEYS[0]).unwrap();
    let with = |change: &dyn Fn(&mut atsplat_scene::Frame)| {
        let mut scene = scene.clone();
        change(&mut scene.frames[1]);
        ChunkScene::from_scene(&scene, &mut Warnings::new())
    };
    assert!(matches!(with(&|frame| frame.image = FrameImage::Absent), Err(SceneError::NoImage { frame: 1, .. })));
    assert!(matches!(
        with(&|frame| frame.image = FrameImage::Missing("x.png".into())),
        Err(SceneError::NoImage { .. })
    ));
    assert!(matches!(with(&|frame| frame.image = FrameImage::File("/nowhere/x.png".into())), Err(SceneError::Io(_))));
    let unnumbered = |frame: &mut atsplat_scene::Frame| {
        frame.timestamp_micros = None;
        frame.name = "first".to_owned();
    };
    let error = with(&unnumbered).unwrap_err();
    assert!(matches!(error, SceneError::NoTimestamp { frame: 1, .. }), "{error}");
    let text = error.to_string();
    assert!(text.ends_with("or ends in _ and a number, found the name \"first\"") && !text.contains("image"), "{text}");
    let named = with(&|frame| {
        frame.timestamp_micros = None;
        frame.name = "frame_00042".to_owned();
    });
    assert_eq!(named.unwrap().timestamps[1], 42, "the number used by depthsplat's conversion");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_scene_round_trips(
        key in "[a-z0-9 äöü\"\\\\/]{1,20}",
        url in ".{0,40}",
        frames in proptest::collection::vec((any::<i64>(), proptest::array::uniform18(-1e30f32..1e30), 3..2000usize), 0..5),
    ) {
        let image = |len: &usize| SharedBytes::new([b"\xff\xd8\xff".to_vec(), vec![42; *len]].concat());
        let scene = ChunkScene {
            key: key.clone(),
            url: url.clone(),
            timestamps: frames.iter().map(|frame| frame.0).collect(),
            cameras: frames.iter().map(|frame| frame.1.map(f64::from)).collect(),
            images: frames.iter().map(|frame| image(&frame.2)).collect(),
        };
        let folder = TempDir::new().unwrap();
        write(folder.path(), 1 << 20, vec![scene.clone()]);
        let chunk = Chunk::open(folder.path().join("000000.torch"), &mut Warnings::new()).unwrap();
        let back = chunk.record(&key).unwrap();
        prop_assert_eq!((&back.key, &back.url, &back.timestamps), (&key, &url, &scene.timestamps));
        prop_assert!(Tolerance::EXACT.check(back.cameras.concat(), scene.cameras.concat()).is_ok());
        for (image, expected) in back.images.iter().zip(&scene.images) {
            prop_assert!(**image == **expected);
        }
        prop_assert_eq!(back.images.len(), scene.images.len());
    }
}
