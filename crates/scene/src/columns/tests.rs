use std::path::PathBuf;
use std::sync::Arc;

use arrow_array::{Array as _, ArrayRef, RecordBatch, StringArray, UInt32Array};
use arrow_schema::DataType;
use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use proptest::prelude::*;

use super::*;
use crate::{Frame, Picture, Scene, SharedBytes};

fn pinhole(shift: f64) -> Camera {
    let rows = [0.0, 0.0, -1.0, shift, 0.0, 1.0, 0.0, 0.1 + 0.2, 1.0, 0.0, 0.0, -1e-300];
    Camera::pinhole(
        CameraFromWorld::from_rows(&rows).unwrap(),
        NormalizedIntrinsics::new(0.482_334_223, 0.857_483_091, 0.503, 1.0 / 3.0).unwrap(),
    )
}

fn frame(name: &str, camera: Camera, picture: Picture) -> Frame {
    Frame { name: name.to_owned(), timestamp_micros: name.parse().ok(), camera, stated_size: None, picture }
}

/// Every kind of picture and lens, every optional cell both present and null.
fn varied() -> Scene {
    let opencv = Distortion::OpenCv { k1: 0.1, k2: -0.2, k3: 1e-17, p1: -0.0, p2: 5e-324 };
    let mut frames = vec![
        frame("100", pinhole(0.0), Picture::Absent),
        frame("a, \"quoted\"\nname", pinhole(1.5), Picture::Missing(PathBuf::from("images/été.png"))),
        frame("", Camera { distortion: opencv, ..pinhole(-2.0) }, Picture::File(PathBuf::from("/data/1.jpg"))),
        frame(
            "-7",
            Camera { distortion: Distortion::Fisheye { k: [1.0, 2.0, 3.0, 4.0] }, ..pinhole(f64::MAX) },
            Picture::Encoded(SharedBytes::new(vec![0xff, 0xd8, 0xff])),
        ),
    ];
    frames[1].stated_size = Some(ImageSize { width: 3840, height: 2160 });
    Scene { key: "a/b".to_owned(), url: Some("https://example.org/v?a=1".to_owned()), frames }
}

fn one_batch(scene: &Scene) -> RecordBatch {
    let mut batches = batches_from_scene(scene).unwrap();
    assert_eq!(batches.len(), 1);
    batches.remove(0)
}

/// The bits, which differ for −0 and 0.
fn bits(camera: &Camera) -> Vec<u64> {
    let k = camera.intrinsics;
    let lens = match camera.distortion {
        Distortion::None => vec![],
        Distortion::OpenCv { k1, k2, k3, p1, p2 } => vec![k1, k2, k3, p1, p2],
        Distortion::Fisheye { k } => k.to_vec(),
    };
    let pose = camera.camera_from_world.to_rows();
    [k.fx, k.fy, k.cx, k.cy].iter().chain(&pose).chain(&lens).map(|value| value.to_bits()).collect()
}

fn assert_rows_match(rows: &[CameraRow], scene: &Scene) {
    assert_eq!(rows.len(), scene.frames.len());
    for (position, (row, frame)) in rows.iter().zip(&scene.frames).enumerate() {
        assert_eq!((row.scene.as_str(), row.frame), (scene.key.as_str(), position as u64));
        assert_eq!((&row.url, &row.name), (&scene.url, &frame.name));
        assert_eq!(bits(&row.camera), bits(&frame.camera), "frame {position}");
        assert_eq!((row.timestamp_micros, row.stated_size), (frame.timestamp_micros, frame.stated_size));
        match (&row.picture, &frame.picture) {
            (None, Picture::Encoded(_)) | (Some(Picture::Absent), Picture::Absent) => {}
            (Some(Picture::Missing(a)), Picture::Missing(b)) | (Some(Picture::File(a)), Picture::File(b)) => {
                assert_eq!(a, b);
            }
            (a, b) => panic!("frame {position}: {b:?} was read as {a:?}"),
        }
    }
}

#[test]
fn cameras_round_trip_bit_for_bit() {
    let scene = varied();
    assert_rows_match(&rows_from_batch(&one_batch(&scene)).unwrap(), &scene);
}

#[test]
fn half_a_stated_size_is_an_error() {
    let batch = one_batch(&varied());
    let with = |name: &str, value: Option<u32>| {
        let sides = Arc::new(UInt32Array::from(vec![value; batch.num_rows()]));
        rows_from_batch(&with_column(&batch, name, sides, true)).unwrap_err().to_string()
    };
    for (name, value, expected) in [
        ("stated_height", None, "row 1, column \"stated_width\": expected width and height"),
        ("stated_width", Some(0), "found \"0×null\""),
    ] {
        let error = with(name, value);
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn batches_follow_the_documented_schema() {
    let batch = one_batch(&varied());
    assert_eq!(batch.schema(), schema());
    assert_eq!(schema().metadata().get("atsplat.version").map(String::as_str), Some(SCHEMA_VERSION));
    let columns: Vec<String> = schema()
        .fields()
        .iter()
        .map(|f| format!("{}: {}{}", f.name(), f.data_type(), if f.is_nullable() { "?" } else { "" }))
        .collect();
    insta::assert_snapshot!(columns.join("\n"));
    let bytes = batch.column_by_name("picture_bytes").unwrap();
    assert_eq!((bytes.null_count(), bytes.is_valid(3)), (3, true), "only the encoded picture has a length");
}

#[test]
fn the_centre_columns_follow_from_the_pose() {
    let scene = varied();
    let batch = one_batch(&scene);
    let column = |name: &str| {
        let array = batch.column_by_name(name).unwrap();
        array.as_any().downcast_ref::<arrow_array::Float64Array>().unwrap().value(1)
    };
    let centre = glam::DVec3::new(column("centre_x"), column("centre_y"), column("centre_z"));
    let seen = scene.frames[1].camera.camera_from_world.transform_point(centre);
    atsplat_numeric::Tolerance::F64.assert(seen.to_array(), [0.0; 3], "the centre in camera coordinates");
}

#[test]
fn scenes_share_batches_and_long_scenes_span_them() {
    let long = Scene {
        key: "long".to_owned(),
        url: None,
        frames: vec![frame("0", pinhole(0.0), Picture::Absent); CameraTable::ROW_LIMIT + 3],
    };
    let (mut table, mut sizes) = (CameraTable::new(), Vec::new());
    for scene in [&varied(), &long, &varied()] {
        table
            .push_scene(scene, |batch| {
                sizes.push(batch.num_rows());
                Ok::<_, ColumnsError>(())
            })
            .unwrap();
    }
    assert_eq!((sizes, table.rows()), (vec![CameraTable::ROW_LIMIT], 4 + 3 + 4));
    assert_eq!(table.take().unwrap().num_rows(), 11);
    assert_eq!(table.take().unwrap().num_rows(), 0, "taken");
}

#[test]
fn long_urls_on_every_row_are_split_into_batches() {
    let scene = Scene {
        key: "long URL".to_owned(),
        url: Some("u".repeat(CameraTable::TEXT_LIMIT / 4)),
        frames: vec![frame("0", pinhole(0.0), Picture::Absent); 8],
    };
    let rows: Vec<usize> = batches_from_scene(&scene).unwrap().iter().map(RecordBatch::num_rows).collect();
    assert_eq!(rows, [3, 3, 2], "four URLs and their keys exceed the limit");
    let scene = Scene { url: Some("u".repeat(CameraTable::TEXT_LIMIT)), ..scene };
    assert!(matches!(batches_from_scene(&scene), Err(ColumnsError::RowTooLong { frame: 0, .. })));
}

fn with_column(batch: &RecordBatch, name: &str, array: ArrayRef, nullable: bool) -> RecordBatch {
    let (schema, mut columns, _) = batch.clone().into_parts();
    let index = schema.index_of(name).unwrap();
    let mut fields: Vec<_> = schema.fields().iter().map(|f| f.as_ref().clone()).collect();
    fields[index] = arrow_schema::Field::new(name, array.data_type().clone(), nullable);
    columns[index] = array;
    RecordBatch::try_new(Arc::new(arrow_schema::Schema::new(fields)), columns).unwrap()
}

#[test]
fn errors_name_row_and_column() {
    use std::sync::Arc;
    let batch = one_batch(&varied());
    let error = |batch: &RecordBatch| rows_from_batch(batch).unwrap_err().to_string();

    let lenses = Arc::new(StringArray::from(vec!["none", "none", "spherical", "none"]));
    assert_eq!(
        error(&with_column(&batch, "distortion", lenses, false)),
        "camera table: row 2, column \"distortion\": expected none, opencv or fisheye, found \"spherical\""
    );
    let nulls = Arc::new(arrow_array::Float64Array::from(vec![Some(1.0), None, Some(1.0), Some(1.0)]));
    assert_eq!(
        error(&with_column(&batch, "fx", nulls, true)),
        "camera table: row 1, column \"fx\": expected a value, found null"
    );
    let numbers = Arc::new(arrow_array::Float64Array::from(vec![1.0, 0.0, 1.0, 1.0]));
    assert_eq!(
        error(&with_column(&batch, "fy", numbers, false)),
        "camera table: row 1: fy: expected a positive number, found 0"
    );
    let narrow = Arc::new(arrow_array::Float32Array::from(vec![1.0; 4]));
    assert_eq!(
        error(&with_column(&batch, "t2", narrow, false)),
        "camera table: column \"t2\": expected Float64, found Float32"
    );
    let fewer = batch.project(&[0, 1, 2]).unwrap();
    assert_eq!(error(&fewer), "camera table: expected a column \"name\", found none");

    let newer = batch.schema().as_ref().clone().with_metadata([("atsplat.version", "2")]);
    let newer = RecordBatch::try_new(Arc::new(newer), batch.columns().to_vec()).unwrap();
    assert_eq!(error(&newer), "camera table: expected schema version 1, found \"2\"");
}

#[test]
fn reads_string_views() {
    let scene = varied();
    let mut batch = one_batch(&scene);
    for name in ["scene", "url", "name", "distortion", "picture", "picture_path"] {
        let text = batch.column_by_name(name).unwrap().as_any().downcast_ref::<StringArray>().unwrap().clone();
        let views = Arc::new(text.iter().collect::<arrow_array::StringViewArray>());
        batch = with_column(&batch, name, views, true);
        assert_eq!(batch.column_by_name(name).unwrap().data_type(), &DataType::Utf8View);
    }
    assert_rows_match(&rows_from_batch(&batch).unwrap(), &scene);
}

prop_compose! {
    fn any_camera()(
        angles in prop::array::uniform3(-4.0..4.0f64),
        translation in prop::array::uniform3(-1e6..1e6f64),
        focal in prop::array::uniform2(1e-3..1e3f64),
        centre in prop::array::uniform2(-1.0..2.0f64),
        lens in prop::array::uniform6(any::<f64>()),
        model in 0..3u8,
    ) -> Camera {
        let rotation = glam::DMat3::from_euler(glam::EulerRot::XYZ, angles[0], angles[1], angles[2]);
        let [k1, k2, k3, k4, p1, p2] = lens;
        Camera {
            camera_from_world: CameraFromWorld::new(rotation, translation.into()).unwrap(),
            intrinsics: NormalizedIntrinsics::new(focal[0], focal[1], centre[0], centre[1]).unwrap(),
            distortion: match model {
                0 => Distortion::None,
                1 => Distortion::OpenCv { k1, k2, k3, p1, p2 },
                _ => Distortion::Fisheye { k: [k1, k2, k3, k4] },
            },
        }
    }
}

proptest! {
    #[test]
    fn any_trajectory_round_trips(
        cameras in prop::collection::vec(any_camera(), 0..20), key in ".*", names in prop::collection::vec(".*", 20),
    ) {
        let frames = cameras.into_iter().zip(&names).map(|(camera, name)| frame(name, camera, Picture::Absent)).collect();
        let scene = Scene { key, url: None, frames };
        assert_rows_match(&rows_from_batch(&one_batch(&scene)).unwrap(), &scene);
    }
}
