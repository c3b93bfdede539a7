use std::path::PathBuf;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float64Type, Int64Type, UInt32Type, UInt64Type};
use arrow_array::{Array as _, RecordBatch};
use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use proptest::prelude::*;

use super::*;
use crate::{Frame, FrameImage, Scene, SharedBytes};

fn pinhole(shift: f64) -> Camera {
    let rows = [0.0, 0.0, -1.0, shift, 0.0, 1.0, 0.0, 0.1 + 0.2, 1.0, 0.0, 0.0, -1e-300];
    Camera::pinhole(
        CameraFromWorld::from_rows(&rows).unwrap(),
        NormalizedIntrinsics::new(0.482_334_223, 0.857_483_091, 0.503, 1.0 / 3.0).unwrap(),
    )
}

fn frame(name: &str, camera: Camera, image: FrameImage) -> Frame {
    Frame { name: name.to_owned(), timestamp_micros: name.parse().ok(), camera, stated_size: None, image }
}

/// Every kind of image and lens, every optional cell both present and null.
fn varied() -> Scene {
    let opencv = Distortion::OpenCv { k1: 0.1, k2: -0.2, k3: 1e-17, p1: -0.0, p2: 5e-324 };
    let mut frames = vec![
        frame("100", pinhole(0.0), FrameImage::Absent),
        frame("a, \"quoted\"\nname", pinhole(1.5), FrameImage::Missing(PathBuf::from("images/été.png"))),
        frame("", Camera { distortion: opencv, ..pinhole(-2.0) }, FrameImage::File(PathBuf::from("/data/1.jpg"))),
        frame(
            "-7",
            Camera { distortion: Distortion::Fisheye { k: [1.0, 2.0, 3.0, 4.0] }, ..pinhole(f64::MAX) },
            FrameImage::Encoded(SharedBytes::new(vec![0xff, 0xd8, 0xff])),
        ),
    ];
    frames[1].stated_size = Some(ImageSize { width: 3840, height: 2160 });
    Scene { key: "a/b".to_owned(), url: Some("https://example.org/v?a=1".to_owned()), frames }
}

/// One scene as record batches: a single one unless the scene is very long.
pub(crate) fn batches_from_scene(scene: &Scene) -> Result<Vec<RecordBatch>, ColumnsError> {
    let mut table = CameraTable::new();
    let mut batches = Vec::new();
    table.push_scene(scene, |batch| {
        batches.push(batch);
        Ok::<(), ColumnsError>(())
    })?;
    batches.push(table.take()?);
    Ok(batches)
}

fn one_batch(scene: &Scene) -> RecordBatch {
    let mut batches = batches_from_scene(scene).unwrap();
    assert_eq!(batches.len(), 1);
    batches.remove(0)
}

/// Compares numbers by their bits, which differ for −0 and 0.
fn assert_holds(batch: &RecordBatch, scene: &Scene) {
    const NUMBERS: [&str; 22] = [
        "fx", "fy", "cx", "cy", "r00", "r01", "r02", "t0", "r10", "r11", "r12", "t1", "r20", "r21", "r22", "t2", "k1",
        "k2", "k3", "k4", "p1", "p2",
    ];
    assert_eq!(batch.num_rows(), scene.frames.len());
    let column = |name: &str| batch.column_by_name(name).unwrap();
    for (row, frame) in scene.frames.iter().enumerate() {
        let text = |name: &str| {
            let cells = column(name).as_string::<i32>();
            cells.is_valid(row).then(|| cells.value(row))
        };
        assert_eq!((text("scene"), text("url")), (Some(scene.key.as_str()), scene.url.as_deref()));
        assert_eq!(text("name"), Some(frame.name.as_str()));
        assert_eq!(column("frame").as_primitive::<UInt64Type>().value(row), row as u64);
        let micros = column("timestamp_micros").as_primitive::<Int64Type>();
        assert_eq!(micros.is_valid(row).then(|| micros.value(row)), frame.timestamp_micros);

        let (model, lens) = match frame.camera.distortion {
            Distortion::None => ("none", [None; 6]),
            Distortion::OpenCv { k1, k2, k3, p1, p2 } => {
                ("opencv", [Some(k1), Some(k2), Some(k3), None, Some(p1), Some(p2)])
            }
            Distortion::Fisheye { k } => ("fisheye", [Some(k[0]), Some(k[1]), Some(k[2]), Some(k[3]), None, None]),
        };
        assert_eq!(text("distortion"), Some(model));
        let k = frame.camera.intrinsics;
        let pinhole = [k.fx, k.fy, k.cx, k.cy].into_iter().chain(frame.camera.camera_from_world.to_rows());
        for (name, number) in NUMBERS.into_iter().zip(pinhole.map(Some).chain(lens)) {
            let cells = column(name).as_primitive::<Float64Type>();
            let found = cells.is_valid(row).then(|| cells.value(row).to_bits());
            assert_eq!(found, number.map(f64::to_bits), "frame {row}, {name}");
        }

        let side = |name: &str| {
            let cells = column(name).as_primitive::<UInt32Type>();
            cells.is_valid(row).then(|| cells.value(row))
        };
        let stated = side("stated_width").zip(side("stated_height"));
        assert_eq!(stated, frame.stated_size.map(|size| (size.width, size.height)));
        let (kind, path) = match &frame.image {
            FrameImage::Absent => ("absent", None),
            FrameImage::Missing(path) => ("missing", Some(path)),
            FrameImage::File(path) => ("file", Some(path)),
            FrameImage::Encoded(_) => ("encoded", None),
            FrameImage::Generated(_) => ("generated", None),
            FrameImage::Ambiguous(_) => ("missing", None),
            FrameImage::Unposed { .. } => panic!("the scene has none"),
        };
        assert_eq!((text("image"), text("image_path")), (Some(kind), path.and_then(|path| path.to_str())));
    }
}

#[test]
fn every_cell_is_the_scenes_bit_for_bit() {
    let scene = varied();
    assert_holds(&one_batch(&scene), &scene);
}

#[test]
fn an_image_that_may_be_several_files_is_missing_without_a_path() {
    let image = FrameImage::Ambiguous(vec![PathBuf::from("1.jpg"), PathBuf::from("1.png")]);
    let scene = Scene { key: "s".to_owned(), url: None, frames: vec![frame("1", pinhole(0.0), image)] };
    assert_holds(&one_batch(&scene), &scene);
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
    let bytes = batch.column_by_name("image_bytes").unwrap();
    assert_eq!((bytes.null_count(), bytes.is_valid(3)), (3, true), "only the encoded image has a length");
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

/// The lens is that of the file, and so is the image.
#[test]
fn a_frame_without_a_pose_is_a_row_of_nan() {
    let mut scene = varied();
    for at in [1, 3] {
        scene.frames[at].image = scene.frames[at].image.clone().unposed("no rotation");
    }
    let batch = one_batch(&scene);
    let number = |name: &str, row: usize| batch.column_by_name(name).unwrap().as_primitive::<Float64Type>().value(row);
    for name in ["r00", "r21", "t2", "centre_x"] {
        assert!(number(name, 1).is_nan() && number(name, 2).is_finite(), "{name}");
    }
    assert!((number("fx", 1) - 0.482_334_223).abs() < 1e-12);
    let image = batch.column_by_name("image").unwrap().as_string::<i32>();
    assert_eq!([0, 1, 2, 3].map(|row| image.value(row)), ["absent", "unposed", "file", "unposed"]);
    let path = batch.column_by_name("image_path").unwrap().as_string::<i32>();
    assert_eq!((path.value(1), path.value(2), path.is_valid(3)), ("images/été.png", "/data/1.jpg", false));
    let bytes = batch.column_by_name("image_bytes").unwrap().as_primitive::<UInt64Type>();
    assert_eq!((bytes.is_valid(1), bytes.value(3)), (false, 3), "encoded in a chunk");
}

#[test]
fn scenes_share_batches_and_long_scenes_span_them() {
    let long = Scene {
        key: "long".to_owned(),
        url: None,
        frames: vec![frame("0", pinhole(0.0), FrameImage::Absent); CameraTable::ROW_LIMIT + 3],
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
        frames: vec![frame("0", pinhole(0.0), FrameImage::Absent); 8],
    };
    let rows: Vec<usize> = batches_from_scene(&scene).unwrap().iter().map(RecordBatch::num_rows).collect();
    assert_eq!(rows, [3, 3, 2], "four URLs and their keys exceed the limit");
    let scene = Scene { url: Some("u".repeat(CameraTable::TEXT_LIMIT)), ..scene };
    assert!(matches!(batches_from_scene(&scene), Err(ColumnsError::RowTooLong { frame: 0, .. })));
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
    fn any_trajectory_is_held_bit_for_bit(
        cameras in prop::collection::vec(any_camera(), 0..20), key in ".*", names in prop::collection::vec(".*", 20),
    ) {
        let frames = cameras.into_iter().zip(&names).map(|(camera, name)| frame(name, camera, FrameImage::Absent)).collect();
        let scene = Scene { key, url: None, frames };
        assert_holds(&one_batch(&scene), &scene);
    }
}
