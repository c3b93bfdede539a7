//! Fields of a `transforms.json` that other programs write, and that would change an evaluation if they were read.

use std::collections::BTreeSet;

use serde_json::Value;

use super::transforms::Object;
use super::{ListedFrame, Transforms};
use crate::image_finder::FoundImage;
use crate::{SceneError, WarningKind, Warnings};

/// Coefficients of lenses that cannot be expressed here: OpenCV's rational model, and Metashape's with affinity b1, b2.
const COEFFICIENTS: [&str; 6] = ["k5", "k6", "p3", "p4", "b1", "b2"];

/// Intrinsics in other notations than `fl_x`.
const NOTATIONS: [&str; 5] = ["fx", "fy", "intrinsic_matrix", "intrinsics", "K"];

const MASK: &str = "mask_path";
const ROLLING_SHUTTER: &str = "rolling_shutter";

/// Seconds from the first to the last row of an image, as 3dgs-deblur reads them.
const SHUTTER_TIME: &str = "rolling_shutter_time";

/// When a frame of a moving scene was taken, as nerfstudio's `data/dataparsers/dnerf_dataparser.py` reads it.
const TIME: &str = "time";

/// Radius in pixels beyond which nerfstudio ignores the pixels of a fisheye (`data/dataparsers/nerfstudio_dataparser.py`).
const CROP_RADIUS: &str = "fisheye_crop_radius";

/// `ScanNet++`'s mark of frames that are blurred or otherwise not to be used.
const IS_BAD: &str = "is_bad";

/// Frames that `ScanNet++` lists next to `frames`.
const TEST_FRAMES: &str = "test_frames";

/// Nerfstudio's images for training, validation and tests (`data/dataparsers/nerfstudio_dataparser.py`).
const SPLIT: [&str; 3] = ["train_filenames", "val_filenames", "test_filenames"];

/// An error for a coefficient that is not zero and that no supported lens has.
pub(super) fn require_no_other_coefficients(object: &Object<'_>) -> Result<(), SceneError> {
    for name in COEFFICIENTS {
        if let Some(value) = object.number(name)?.filter(|value| *value != 0.0) {
            let expected = "0, because lenses have only the coefficients k1 to k4, p1 and p2";
            return Err(object.wrong(name, expected, &value.to_string()));
        }
    }
    Ok(())
}

/// An error for scenes of Mitsuba, which instant-ngp marks by this field: their camera axes are x left, y up and z forward.
pub(super) fn require_opengl_axes(root: &Object<'_>) -> Result<(), SceneError> {
    const OF_MITSUBA: &str = "normal_mts_args";
    if root.value(OF_MITSUBA).is_some() {
        return Err(root.wrong(OF_MITSUBA, "OpenGL camera axes", "a Mitsuba scene, whose cameras look along +z"));
    }
    Ok(())
}

/// An error for a frame of a rolling shutter, whose two poses instant-ngp reads instead of `transform_matrix`.
pub(super) fn require_one_pose(frame: &Object<'_>) -> Result<(), SceneError> {
    for (name, row) in [("transform_matrix_start", "first"), ("transform_matrix_end", "last")] {
        if frame.value(name).is_some() {
            let found = format!("the pose of the {row} row of a rolling shutter");
            return Err(frame.wrong(name, "one pose for all rows of the image, in transform_matrix", &found));
        }
    }
    Ok(())
}

/// The object's fields that are not read, and not without meaning.
pub(super) fn unread_fields(object: &Object<'_>) -> Vec<&'static str> {
    let states_pixels = object.value("fl_x").is_some();
    let notations = NOTATIONS.into_iter().filter(|name| !states_pixels && object.value(name).is_some());
    let masks = object.value(MASK).filter(|path| path.as_str() != Some("")).map(|_| MASK);
    let is_moving = |number: &Value| number.as_f64() != Some(0.0);
    let shutter = object.value(ROLLING_SHUTTER).and_then(Value::as_array).filter(|list| list.iter().any(is_moving));
    let bad = object.value(IS_BAD).and_then(Value::as_bool).filter(|is_bad| *is_bad);
    let fields =
        [masks, shutter.map(|_| ROLLING_SHUTTER), bad.map(|_| IS_BAD), object.value(CROP_RADIUS).map(|_| CROP_RADIUS)];
    let numbers = [SHUTTER_TIME, TIME].into_iter().filter(|name| {
        let number = object.value(name).and_then(Value::as_f64);
        number.is_some_and(|number| number != 0.0)
    });
    notations.chain(fields.into_iter().flatten()).chain(numbers).collect()
}

/// The number of `test_frames` that are not among the frames: `ScanNet++`'s script for undistorted images appends them there.
pub(super) fn unread_test_frames(root: &Object<'_>, frames: &[ListedFrame]) -> usize {
    let listed: BTreeSet<&str> = frames.iter().map(|frame| frame.file_path.as_str()).collect();
    let is_read = |entry: &Value| {
        let path = entry.get("file_path").and_then(Value::as_str);
        path.is_some_and(|path| listed.contains(path))
    };
    let entries = root.value(TEST_FRAMES).and_then(Value::as_array);
    entries.map_or(0, |entries| entries.iter().filter(|entry| !is_read(entry)).count())
}

/// The lists of a split that have images, each with the number of them.
pub(super) fn stated_split(root: &Object<'_>) -> Vec<(&'static str, usize)> {
    let images = |name: &str| root.value(name).and_then(Value::as_array).map_or(0, Vec::len);
    SPLIT.into_iter().map(|name| (name, images(name))).filter(|(_, count)| *count > 0).collect()
}

/// Warns about each field that is not read, with the number of frames that it is about.
pub(super) fn report_unread_fields(key: &str, transforms: &Transforms, warnings: &mut Warnings) {
    for name in NOTATIONS.into_iter().chain([MASK, CROP_RADIUS, ROLLING_SHUTTER, SHUTTER_TIME, TIME, IS_BAD]) {
        let is_global = transforms.unread_fields.contains(&name);
        let frames = transforms.frames.iter().enumerate();
        let mut with = frames.filter(|(_, frame)| is_global || frame.unread_fields.contains(&name)).map(|(at, _)| at);
        if let Some(first) = with.next() {
            let (count, frames) = (with.count() + 1, transforms.frames.len());
            let instead = match name {
                MASK | CROP_RADIUS => "whole images are compared",
                ROLLING_SHUTTER | SHUTTER_TIME => "all rows are taken to be exposed at once",
                TIME => "scenes do not change with time",
                IS_BAD => "these frames are used like all others",
                _ => "intrinsics are those in fl_x, camera_angle_x or x_fov",
            };
            let detail = format!("{count} of {frames} frames, first {first}: {name} is not read; {instead}");
            warnings.push(WarningKind::UnreadField, key, detail);
        }
    }
    if transforms.test_frames > 0 {
        let count = transforms.test_frames;
        let detail = format!("{TEST_FRAMES} is not read: {count} more frames; positions count frames alone");
        warnings.push(WarningKind::UnreadField, key, detail);
    }
    if !transforms.split.is_empty() {
        let lists: Vec<String> = transforms.split.iter().map(|(name, count)| format!("{name} ({count})")).collect();
        let detail =
            format!("{}: the file's split is not used; indices and sampling rules choose frames", lists.join(", "));
        warnings.push(WarningKind::UnreadField, key, detail);
    }
}

/// Warns about instant-ngp's masks, which no field lists: `images` are those of the frames.
pub(super) fn report_masks_of_names(key: &str, images: &[FoundImage], warnings: &mut Warnings) {
    let mut masked = images.iter().enumerate().filter(|(_, found)| found.has_dynamic_mask).map(|(at, _)| at);
    if let Some(first) = masked.next() {
        let (count, frames) = (masked.count() + 1, images.len());
        let detail = format!(
            "{count} of {frames} frames, first {first}: dynamic_mask_<name>.png next to the image is not read; whole \
             images are compared"
        );
        warnings.push(WarningKind::UnreadField, key, detail);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use serde_json::json;

    use super::*;
    use crate::nerfstudio::parse_transforms;

    /// A scene with `global` fields, and three frames with fields each.
    fn parse(global: &Value, frames: [&Value; 3]) -> Result<Transforms, SceneError> {
        let mut root = global.clone();
        root["frames"] = frames
            .map(|fields| {
                let mut frame = fields.clone();
                frame["file_path"] = json!("a.png");
                frame["transform_matrix"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
                frame
            })
            .into();
        parse_transforms(root.to_string().as_bytes(), Path::new("transforms.json"))
    }

    fn reported(global: &Value, frames: [&Value; 3]) -> Vec<String> {
        let mut warnings = Warnings::new();
        report_unread_fields("s", &parse(global, frames).unwrap(), &mut warnings);
        assert_eq!(warnings.count(WarningKind::UnreadField), warnings.total());
        warnings.kept().iter().map(|warning| warning.detail.clone()).collect()
    }

    #[test]
    fn coefficients_of_other_lenses_are_errors_unless_zero() {
        let none = json!({});
        for name in ["k5", "k6", "p3", "p4", "b1", "b2"] {
            let with = |value: f64| {
                let mut fields = json!({});
                fields[name] = json!(value);
                fields
            };
            let zero = with(0.0);
            assert!(parse(&zero, [&none, &zero, &none]).is_ok(), "{name}");
            let error = parse(&none, [&zero, &none, &with(-0.3)]).unwrap_err().to_string();
            let expected = format!("frames[2].{name}: expected 0, because ");
            assert!(error.contains(&expected) && error.contains("found -0.3"), "{error}");
            assert!(parse(&with(0.2), [&none; 3]).unwrap_err().to_string().contains(&format!("{name}: expected 0")));
        }
    }

    /// Of the root alone, and however the list's entries look.
    #[test]
    fn frames_in_another_list_are_counted() {
        let none = json!({});
        let tests = json!({ "fl_x": 9.0, "test_frames": [{ "file_path": "b.png" }, {}] });
        let expected = ["test_frames is not read: 2 more frames; positions count frames alone"];
        assert_eq!(reported(&tests, [&none; 3]), expected);
        assert_eq!(parse(&tests, [&none; 3]).unwrap().frames.len(), 3);
        let mut appended = tests.clone();
        appended["test_frames"].as_array_mut().unwrap().push(json!({ "file_path": "a.png" }));
        assert_eq!(reported(&appended, [&none; 3]), expected, "the last one is a frame");
        for without in [json!([]), Value::Null] {
            assert_eq!(reported(&json!({ "fl_x": 9.0, "test_frames": without }), [&none, &tests, &none]), [""; 0]);
        }
    }

    /// Of the root alone; one list is empty, and another none.
    #[test]
    fn a_split_of_the_file_is_counted() {
        let none = json!({});
        let split = json!({
            "fl_x": 9.0, "test_filenames": ["a.png"], "train_filenames": ["a.png", "b.png"], "val_filenames": []
        });
        let expected = "train_filenames (2), test_filenames (1): the file's split is not used; indices and sampling rules \
                        choose frames";
        assert_eq!(reported(&split, [&none; 3]), [expected]);
        for without in [json!([]), Value::Null, json!("a.png")] {
            let without = json!({ "fl_x": 9.0, "train_filenames": without });
            assert_eq!(reported(&without, [&none, &split, &none]), [""; 0]);
        }
    }

    #[test]
    fn cameras_of_mitsuba_are_rejected() {
        let (none, args) = (json!({}), json!({ "normal_mts_args": ["-o"] }));
        let error = parse(&args, [&none; 3]).unwrap_err().to_string();
        let expected =
            "normal_mts_args: expected OpenGL camera axes, found a Mitsuba scene, whose cameras look along +z";
        assert!(error.contains(expected) && error.contains("transforms.json"), "{error}");
        assert!(parse(&none, [&none, &args, &none]).is_ok(), "the file has one convention, not each frame");
    }

    #[test]
    fn two_poses_of_one_frame_are_rejected() {
        let pose = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
        let none = json!({});
        for (name, row) in [("transform_matrix_start", "first"), ("transform_matrix_end", "last")] {
            let mut moving = json!({});
            moving[name] = pose.clone();
            let error = parse(&none, [&none, &none, &moving]).unwrap_err().to_string();
            let expected = format!(
                "frames[2].{name}: expected one pose for all rows of the image, in transform_matrix, found the pose of the \
                 {row} row of a rolling shutter"
            );
            assert!(error.contains(&expected) && error.contains("transforms.json"), "{error}");
        }
    }

    #[test]
    fn frames_that_are_marked_as_bad_are_counted() {
        let [none, bad, good] = [json!({}), json!({ "is_bad": true }), json!({ "is_bad": false })];
        let found = reported(&json!({ "fl_x": 9.0 }), [&good, &bad, &none]);
        assert_eq!(found, ["1 of 3 frames, first 1: is_bad is not read; these frames are used like all others"]);
    }

    /// Of a moving scene, the first frame is at 0.
    #[test]
    fn times_and_the_circle_of_a_fisheye_are_counted() {
        let at = |time: Value| json!({ "time": time });
        let [start, middle, end] = [0.0, 0.25, 1.0].map(|time| at(json!(time)));
        let lens = json!({ "fl_x": 9.0 });
        let moving = "2 of 3 frames, first 1: time is not read; scenes do not change with time";
        assert_eq!(reported(&lens, [&start, &middle, &end]), [moving]);
        assert_eq!(reported(&lens, [&start, &at(Value::Null), &at(json!("noon"))]), [""; 0]);
        let none = json!({});
        let circle = json!({ "fl_x": 9.0, "fisheye_crop_radius": 4.0, "rolling_shutter_time": 0.02 });
        let expected = [
            "3 of 3 frames, first 0: fisheye_crop_radius is not read; whole images are compared",
            "3 of 3 frames, first 0: rolling_shutter_time is not read; all rows are taken to be exposed at once",
        ];
        assert_eq!(reported(&circle, [&none; 3]), expected);
        let without = json!({ "fl_x": 9.0, "fisheye_crop_radius": null, "rolling_shutter_time": 0 });
        assert_eq!(reported(&without, [&none; 3]), [""; 0]);
    }

    #[test]
    fn masks_and_other_notations_of_intrinsics_are_counted() {
        let (none, mask) = (json!({}), json!({ "mask_path": "masks/a.png" }));
        let found = reported(&json!({ "fl_x": 9.0 }), [&json!({ "mask_path": "" }), &mask, &mask]);
        assert_eq!(found, ["2 of 3 frames, first 1: mask_path is not read; whole images are compared"]);
        let unread = json!({ "fx": 50, "fy": 50, "intrinsic_matrix": [[50, 0, 8], [0, 50, 6], [0, 0, 1]] });
        let mut with_read = unread.clone();
        with_read["fl_x"] = json!(50);
        let found = reported(&json!({ "fl_x": 9.0 }), [&none, &with_read, &unread]);
        let starts =
            ["fx", "fy", "intrinsic_matrix"].map(|name| format!("1 of 3 frames, first 2: {name} is not read; "));
        assert_eq!(found.len(), 3);
        assert!(found.iter().zip(starts).all(|(found, start)| found.starts_with(&start)), "{found:?}");
        let found = reported(&json!({ "K": [[9]], "rolling_shutter": [0, 0.0, 0.1] }), [&none; 3]);
        assert!(
            found[0].starts_with("3 of 3 frames, first 0: K is") && found[1].contains("rolling_shutter"),
            "{found:?}"
        );
        let still =
            json!({ "fl_x": 9.0, "fx": 9.0, "rolling_shutter": [0, 0.0], "mask_path": null, "depth_file_path": "d" });
        assert_eq!(reported(&still, [&none; 3]), [""; 0]);
    }
}
