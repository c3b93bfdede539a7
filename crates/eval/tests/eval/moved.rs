//! Data and imported files that a later run finds in another place.

use std::path::Path;
use std::sync::Arc;

use crate::common::{Run, SIZE, Walls, dataset, entry, rows};
use atsplat_eval::method::{Method, Renders};
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_results::Results;

/// Writes an image of one shade of grey for a frame of a scene below a folder.
fn write(renders: &Path, scene: usize, frame: usize, shade: u8) {
    let image = ImageU8::new(SIZE.width, SIZE.height, vec![shade; (SIZE.width * SIZE.height * 3) as usize]).unwrap();
    let folder = renders.join(format!("wall-{scene}"));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(format!("{frame:06}.png")), encode_png(&image).unwrap()).unwrap();
}

/// Data and renders in two places each, with the same contents at first.
#[test]
fn what_moved_is_known_by_its_contents_and_other_contents_are_rejected() {
    let [store, first, second] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    for (renders, frame) in [(&first, 1), (&first, 6), (&second, 1), (&second, 6)] {
        write(renders.path(), 0, frame, 100);
    }
    let score = |data: &str, walls: Walls, renders: &Path| {
        let method: Arc<dyn Method> = Arc::new(Renders::new(renders, Some("theirs")).unwrap());
        let mut walls = dataset(walls, &[entry(&[0, 4], &[1, 6])]);
        walls.description = data.to_owned();
        Run::new(vec![walls], vec![method]).run(store.path())
    };
    let walls = || Walls::new(1, 8);
    let places = |results: &Results| {
        let mut warnings = results.provenance.warnings.iter();
        assert!(warnings.all(|warning| !warning.kind.contains("than the first")), "{:?}", results.provenance.warnings);
        let folder = results.provenance.methods[0].parameters["folder"].as_str().unwrap().to_owned();
        (results.provenance.presets[0].dataset.clone(), folder)
    };
    let in_second = ("scratch".to_owned(), second.path().display().to_string());
    let (before, _) = score("disk", walls(), first.path()).unwrap();
    let (moved, summary) = score("scratch", walls(), second.path()).unwrap();
    assert_eq!((summary.evaluated, summary.resumed, rows(&moved)), (0, 1, rows(&before)));
    assert_eq!(places(&moved), in_second, "where they were read last");
    // In the same place, they were edited.
    write(second.path(), 0, 6, 200);
    let (changed, summary) = score("scratch", walls(), second.path()).unwrap();
    assert_eq!((summary.evaluated, places(&changed)), (1, in_second));
    assert_ne!(rows(&changed), rows(&before));
    let files = score("scratch", walls(), first.path()).unwrap_err().to_string();
    let [first, second] = [&first, &second].map(|folder| folder.path().display());
    let said =
        format!("imported files of the two runs differ: expected the contents of {second}, found others in {first}, ");
    assert!(
        files.starts_with(&said) && files.contains("theirs on walls, scene \"wall-0\", entry 0; choose"),
        "{files}"
    );
    assert!(files.contains("--name"), "{files}");
    let other = Walls { replaced: vec![(0, 4)], ..walls() };
    let data = score("elsewhere", other, Path::new(&second.to_string())).unwrap_err().to_string();
    assert!(
        data.contains("data of the two runs differ: expected the contents of scratch, found others in elsewhere"),
        "{data}"
    );
    // Without the second target's frame, the entry is skipped.
    let lacking = score("elsewhere", Walls::new(1, 6), Path::new(&second.to_string())).unwrap_err().to_string();
    assert_eq!(lacking, data, "those lack what the results were made from");
    assert_eq!(Results::read(store.path()).unwrap(), changed, "nothing was replaced, and no place either");
}

/// The second folder has the renders of a scene that the first lacks.
#[test]
fn failed_results_do_not_keep_a_method_in_its_folder() {
    let [store, renders, more] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    for (folder, scene) in [(&renders, 0), (&more, 0), (&more, 1)] {
        write(folder.path(), scene, 6, 100);
    }
    let score = |folder: &Path| {
        let theirs: Arc<dyn Method> = Arc::new(Renders::new(folder, Some("theirs")).unwrap());
        Run::new(vec![dataset(Walls::new(2, 8), &[entry(&[0, 4], &[6])])], vec![theirs]).run(store.path()).unwrap()
    };
    assert_eq!(score(renders.path()).1.incomplete, 1);
    let (results, summary) = score(more.path());
    assert_eq!((summary.evaluated, summary.resumed, summary.incomplete), (1, 1, 0));
    assert_eq!(results.provenance.methods[0].parameters["folder"], more.path().display().to_string());
}
