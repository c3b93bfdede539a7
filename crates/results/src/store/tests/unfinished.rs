//! Folders that a killed process, or the user, has left files in.

use super::*;

/// Results with times, whose rows are in both tables.
fn whole() -> Results {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &["a", "b"]);
    store.add_timings(vec![timing("a", 1)]).unwrap();
    store.finish().unwrap()
}

/// Killed after each file: there is no store until all of it is there, and the same merge can be repeated.
#[test]
fn a_merge_is_whole_or_none() {
    let (results, complete) = (whole(), tempfile::tempdir().unwrap());
    results.write(complete.path()).unwrap();
    assert_eq!(Results::read(complete.path()).unwrap(), results);
    assert!(!complete.path().join(MERGING).exists());
    let written = [timings::TIMINGS, TARGETS, TRIALS, PROVENANCE];
    for files in 0..=written.len() {
        let killed = tempfile::tempdir().unwrap();
        fs::write(killed.path().join(MERGING), b"").unwrap();
        for name in &written[..files] {
            fs::copy(complete.path().join(name), killed.path().join(name)).unwrap();
        }
        let is_whole = files == written.len();
        if is_whole {
            assert_eq!(Results::read(killed.path()).unwrap(), results, "only its mark was left");
        } else {
            assert!(matches!(Results::read(killed.path()), Err(ResultsError::NoStore { .. })), "{files}");
        }
        assert_eq!(results.write_merged(killed.path(), &[]).unwrap(), !is_whole, "{files}");
        assert_eq!(Results::read(killed.path()).unwrap(), results, "{files}");
        assert!(!killed.path().join(MERGING).exists(), "{files}");
    }
    assert!(!results.write_merged(complete.path(), &[]).unwrap(), "nothing is left to do");
    let (mut later, mut others) = (results.clone(), results);
    later.provenance.started += 1;
    others.targets[0].scores.insert("psnr".to_owned(), 12.0);
    for other in [later, others] {
        let error = other.write(complete.path()).unwrap_err();
        assert!(matches!(error, ResultsError::HasResults { .. }), "{error}");
    }
}

/// The folder of a dataset, whose photos have the place of a store's images.
#[test]
fn a_merge_into_a_folder_with_images_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("images/0001.jpg");
    fs::create_dir(folder.path().join("images")).unwrap();
    fs::write(&photo, b"photo").unwrap();
    let refused = whole().write(folder.path()).unwrap_err();
    assert!(matches!(&refused, ResultsError::HasResults { found, .. } if found.ends_with("images")), "{refused}");
    assert!(!folder.path().join(MERGING).exists(), "no mark under which the next merge would remove them");
    assert!(whole().write(folder.path()).is_err() && photo.is_file());
}

#[test]
fn unfinished_files_are_removed_when_a_store_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let [left, other] = [".AbC123.partial", "notes.partial"].map(|name| folder.path().join(name));
    let leave = || [&left, &other].map(|path| fs::write(path, b"half a tab").unwrap());
    leave();
    filled(folder.path(), &["a"]).finish().unwrap();
    assert!(!left.exists() && other.exists());
    leave();
    drop(Store::open(folder.path()).unwrap());
    assert!(!left.exists() && other.exists());
}

/// It has the name of the file that describes the holder of the lock.
#[test]
fn a_file_of_the_user_is_neither_replaced_nor_removed() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.json");
    fs::write(&file, br#"{ "rate": 0.1 }"#).unwrap();
    let written = [
        Store::create(folder.path(), Provenance::default()).map(drop),
        Store::resume(folder.path(), Provenance::default()).map(drop),
        whole().write(folder.path()),
    ];
    for error in written.map(Result::unwrap_err) {
        assert!(error.to_string().contains("run.json"), "{error}");
    }
    assert_eq!(fs::read(&file).unwrap(), br#"{ "rate": 0.1 }"#);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_part_that_was_cut_short_can_be_removed() {
    let folder = tempfile::tempdir().unwrap();
    drop(filled(folder.path(), &["a", "b"]));
    let part = parts::path(folder.path(), &key("a"));
    let bytes = fs::read(&part).unwrap();
    for cut in [0, bytes.len() / 2] {
        fs::write(&part, &bytes[..cut]).unwrap();
        let error = Results::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("remove this file") && error.contains(part.to_str().unwrap()), "{error}");
    }
    fs::remove_file(&part).unwrap();
    assert_eq!(Results::read(folder.path()).unwrap().trials, [trial("b")]);
}
