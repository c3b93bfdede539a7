use super::*;
use crate::re10k::parse_trajectory;
use std::path::Path;

fn scene() -> Scene {
    let rows: String =
        [0, 33_366, 66_733].map(|t| format!("{t} 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n")).concat();
    parse_trajectory(rows.as_bytes(), Path::new("clip.txt")).unwrap().to_scene("clip")
}

fn folder_with(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        std::fs::write(folder.path().join(name), b"").unwrap();
    }
    folder
}

fn attach(names: &[&str]) -> (Scene, Warnings) {
    let folder = folder_with(names);
    let (mut scene, mut warnings) = (scene(), Warnings::new());
    attach_images(&mut scene, &[folder.path().to_owned()], || false, &mut warnings).unwrap();
    (scene, warnings)
}

fn names(scene: &Scene) -> Vec<String> {
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    let shown = |frame: &Frame| match &frame.image {
        FrameImage::File(path) => name(path),
        FrameImage::Missing(path) => format!("no {}", name(path)),
        FrameImage::Ambiguous(paths) => {
            let names: Vec<String> = paths.iter().map(|path| name(path)).collect();
            format!("{}?", names.join(" or "))
        }
        other => format!("{other:?}"),
    };
    scene.frames.iter().map(shown).collect()
}

#[test]
fn images_are_found_by_timestamp_and_missing_ones_keep_their_position() {
    let (scene, warnings) = attach(&["66733.png", "0.png", "999.png"]);
    assert_eq!(names(&scene), ["0.png", "no 33366.png", "66733.png"]);
    let counts: Vec<_> = warnings.counts().collect();
    assert_eq!(counts, [(WarningKind::MissingImage, 1), (WarningKind::UnlistedImage, 1)]);
    assert!(warnings.kept()[1].detail.contains("999.png"), "{:?}", warnings.kept());
}

#[test]
fn numbers_start_from_zero_or_one() {
    for (files, first) in [(["00000.jpg", "00001.jpg", "00002.jpg"], 0), (["1.jpg", "2.jpg", "3.jpg"], 1)] {
        let (scene, warnings) = attach(&files);
        assert_eq!(names(&scene), files, "from {first}");
        assert_eq!(warnings.total(), 0, "from {first}");
    }
}

/// With three rows: four images by time, then by number; a cover belongs to no row, whichever are lost.
#[test]
fn images_of_lost_rows_are_counted() {
    let (_, warnings) = attach(&["0.png", "33366.png", "50000.png", "66733.png", "cover.png"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 1)]);
    assert!(warnings.kept()[0].detail.contains("50000.png"), "{:?}", warnings.kept());
    let (scene, warnings) = attach(&["00001.png", "00002.png", "00003.png", "00004.png", "00005.png"]);
    assert_eq!(names(&scene), ["00001.png", "00002.png", "00003.png"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 2)]);
    let (_, warnings) = attach(&["0.png", "66733.png"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::MissingImage, 1)], "a subset of the rows");
}

/// Three rows. From a wrong first number, every pose would get another row's image.
#[test]
fn images_without_a_gap_start_at_their_least_number() {
    for files in [["00005.png", "00006.png", "00007.png"], ["frame-0.png", "frame-1.png", "frame-2.png"]] {
        let (scene, warnings) = attach(&files);
        assert_eq!((names(&scene), warnings.total()), (files.map(str::to_owned).to_vec(), 0));
    }
}

/// A series of as many images as rows is certain, whatever else is there.
#[test]
fn images_of_another_name_do_not_shift_a_whole_series() {
    for files in [["0.png", "1.png", "2.png", "cover-3.png"], ["4.png", "5.png", "6.png", "cover-1.png"]] {
        let (scene, warnings) = attach(&files);
        assert_eq!(names(&scene), files[..3]);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 1)], "{files:?}");
    }
    let folder = folder_with(&["left_0.png", "left_1.png", "left_2.png", "right_3.png", "right_4.png", "right_5.png"]);
    let folders = [folder.path().to_owned()];
    let error = attach_images(&mut scene(), &folders, || false, &mut Warnings::new()).unwrap_err().to_string();
    assert!(error.contains("may be numbered from 0 or from 3"), "{error}");
}

/// The numbers of a video's frames coincide with some of the rows, but are of others.
#[test]
fn images_most_of_which_are_beyond_the_rows_belong_to_none() {
    let (scene, warnings) = attach(&["3.png", "13.png", "23.png", "33.png"]);
    assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
    let counts = [(WarningKind::MissingImage, 3), (WarningKind::UnlistedImage, 4)];
    assert_eq!(warnings.counts().collect::<Vec<_>>(), counts);
    let (scene, warnings) = attach(&["2.png", "3.png", "40.png"]);
    assert_eq!(names(&scene), ["no 00001.png", "2.png", "3.png"]);
    let counts = [(WarningKind::MissingImage, 1), (WarningKind::UnlistedImage, 1)];
    assert_eq!(warnings.counts().collect::<Vec<_>>(), counts, "most belong to rows");
    for files in [["0.png", "2.png", "4.png", "6.png", "8.png"], ["1.png", "3.png", "5.png", "7.png", "9.png"]] {
        let (scene, warnings) = attach(&files);
        assert_eq!(names(&scene)[1..], ["no 33366.png", "no 66733.png"], "{files:?}");
        assert!(warnings.count(WarningKind::UnlistedImage) >= 4, "{files:?}");
    }
    let (scene, _) = attach(&["0.png", "1.png", "2.png", "4.png", "5.png", "6.png", "7.png"]);
    assert_eq!(names(&scene), ["0.png", "1.png", "2.png"], "no row lacks an image");
}

#[test]
fn gaps_are_allowed_where_the_first_number_is_certain() {
    for (files, expected) in [
        (["0.jpg", "2.jpg"], ["0.jpg", "no 00001.jpg", "2.jpg"]),
        (["1.jpg", "3.jpg"], ["1.jpg", "no 00002.jpg", "3.jpg"]),
        (["2.jpg", "3.jpg"], ["no 00001.jpg", "2.jpg", "3.jpg"]),
        (["70.jpg", "72.jpg"], ["70.jpg", "no 00071.jpg", "72.jpg"]),
    ] {
        let (scene, warnings) = attach(&files);
        assert_eq!(names(&scene), expected);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::MissingImage, 1)], "{files:?}");
    }
}

#[test]
fn ambiguous_numbers_are_errors_with_all_readings() {
    for (files, found) in [
        (&["frame_1.png", "frame_2.png"][..], "images 1 to 2 for 3 rows, which may be numbered from 0 or from 1"),
        (&["0.png", "1.png", "2.png", "3.png"][..], "images 0 to 3 for 3 rows, which may be numbered from 0 or from 1"),
        (&["3.png", "5.png"][..], "images 3 to 5 for 3 rows, which may be numbered from 1 or from 3"),
        (&["70.png", "71.png"][..], "images 70 to 71 for 3 rows, which may be numbered from 69 or from 70"),
    ] {
        let folder = folder_with(files);
        let folders = [folder.path().to_owned()];
        let error = attach_images(&mut scene(), &folders, || false, &mut Warnings::new()).unwrap_err().to_string();
        assert!(error.contains(found), "{files:?}: {error}");
    }
}

/// Nor can those of another scene, which are as many, but have other timestamps.
#[test]
fn images_that_cannot_belong_to_rows_are_mentioned() {
    let (scene, warnings) = attach(&["left.png", "right.png"]);
    assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
    let detail = &warnings.kept()[1].detail;
    let expected = "33366.png; 2 images there have names that do not end in a number, such as left.png";
    assert!(detail.ends_with(expected), "{detail}");
    let (scene, warnings) = attach(&["100000.png", "133366.png", "166733.png"]);
    assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
    let counts = [(WarningKind::MissingImage, 3), (WarningKind::UnlistedImage, 3)];
    assert_eq!(warnings.counts().collect::<Vec<_>>(), counts);
}

/// Next to frames in PNG, a preview or mask in JPEG is not the frame.
#[test]
fn of_two_images_that_with_the_extension_of_the_others_is_used() {
    let (scene, warnings) = attach(&["0.png", "33366.jpg", "33366.PNG", "66733.png"]);
    assert_eq!(names(&scene), ["0.png", "33366.PNG", "66733.png"]);
    let detail = &warnings.kept()[0].detail;
    assert!(warnings.total() == 1 && detail.ends_with("first: 33366.PNG is used, not 33366.jpg"), "{detail}");
    for files in [&["0.png", "33366.jpg", "33366.png", "66733.jpg"][..], &["33366.jpg", "33366.png"]] {
        let (scene, warnings) = attach(files);
        assert_eq!(names(&scene)[1], "33366.jpg or 33366.png?");
        let image = &scene.frames[1].image;
        assert!(image.is_missing() && !image.is_available() && image.listed_file().is_none());
        let error = scene.frames[1].bytes("clip", 1).unwrap_err().to_string();
        assert!(error.contains("several files may be it (") && error.contains("33366.jpg or "), "{error}");
        let expected = "frame 1: expected one image, found 33366.jpg and 33366.png (";
        assert!(warnings.kept().iter().any(|warning| warning.detail.starts_with(expected)), "{:?}", warnings.kept());
    }
}

#[test]
fn two_images_with_one_number_are_reported() {
    let (scene, warnings) = attach(&["1.jpg", "frame_00001.jpg", "2.jpg", "3.jpg"]);
    assert_eq!(names(&scene), ["1.jpg", "2.jpg", "3.jpg"]);
    assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::AmbiguousNumbering, 1)]);
    assert!(warnings.kept()[0].detail.contains("1 is used, not frame_00001"), "{:?}", warnings.kept());
}

/// Before and after the frames in the order of names.
#[test]
fn masks_and_depth_maps_are_not_used_as_frames() {
    for frames in [["0.jpg", "33366.jpg", "66733.jpg"], ["frame_1.png", "frame_2.png", "frame_3.png"]] {
        let others = frames.into_iter().flat_map(|frame| {
            let (_, number) = frame.rsplit_once('_').unwrap_or(("", frame));
            ["depth", "mask"].map(|kind| format!("{kind}_{number}"))
        });
        let files: Vec<String> = others.chain(frames.map(str::to_owned)).collect();
        let (scene, warnings) = attach(&files.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(names(&scene), frames);
        let detail = &warnings.kept()[0].detail;
        assert!(warnings.total() == 1 && detail.starts_with("6 images have the same number"), "{detail}");
    }
}

/// As masks next to frames.
#[test]
fn two_images_that_differ_by_their_extension_are_reported() {
    for [first, second, third] in [["0", "33366", "66733"], ["00000", "00001", "00002"]] {
        let files =
            [(first, "jpg"), (second, "jpg"), (second, "png"), (third, "jpg"), (third, "webp"), ("cover", "png")];
        let files = files.map(|(stem, extension)| format!("{stem}.{extension}"));
        let (scene, warnings) = attach(&files.each_ref().map(String::as_str));
        assert_eq!(names(&scene), [0, 1, 3].map(|at: usize| files[at].as_str()));
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::AmbiguousNumbering, 1)]);
        let detail = &warnings.kept()[0].detail;
        assert!(detail.starts_with("2 rows fit several images"), "{detail}");
        assert!(detail.ends_with(&format!("first: {second}.jpg is used, not {second}.png")), "{detail}");
    }
}

#[test]
fn images_are_missing_with_an_empty_folder_and_absent_without_one() {
    let (scene, warnings) = attach(&[]);
    assert_eq!(names(&scene), ["no 0.jpg", "no 33366.jpg", "no 66733.jpg"]);
    assert_eq!(warnings.count(WarningKind::MissingImage), 3);
    let (mut alone, mut warnings) = (self::scene(), Warnings::new());
    attach_images(&mut alone, &[PathBuf::from("/nowhere")], || false, &mut warnings).unwrap();
    assert!(alone.frames.iter().all(|frame| matches!(frame.image, FrameImage::Absent)));
    assert_eq!(warnings.total(), 0);
}
