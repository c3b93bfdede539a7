//! A model in both encodings: one is read, and compared with the other.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_camera::CameraFromWorld;
use atsplat_numeric::Tolerance;

use super::{ColmapCamera, ColmapImage, Encoding, encoding_of, parse_cameras, parse_images};
use crate::files::read_file;
use crate::{SceneError, WarningKind, Warnings};

/// Text may be rounded to six decimals.
const SAME: Tolerance = Tolerance { absolute: 1e-5, relative: 1e-5 };

/// Bytes of an images file up to which it is compared: most of them are keypoints.
const COMPARED: u64 = 1 << 28;

type Model<'a> = (&'a BTreeMap<u32, ColmapCamera>, &'a [ColmapImage]);

/// The encoding that is whole too, but not read.
pub(super) fn other_encoding(folder: &Path) -> Option<Encoding> {
    let other = match encoding_of(folder)? {
        Encoding::Binary => Encoding::Text,
        Encoding::Text => Encoding::Binary,
    };
    other.is_whole(folder).then_some(other)
}

/// Warns if the folder of the model that was `read` contains another one in the other encoding, as an edited or a stale export.
pub(super) fn report_other_encoding(key: &str, folder: &Path, read: Model<'_>, warnings: &mut Warnings) {
    let Some(other) = other_encoding(folder) else { return };
    let [ours, theirs] = match other {
        Encoding::Text => ["bin", "txt"],
        Encoding::Binary => ["txt", "bin"],
    };
    let (cameras, images) = (other.file(folder, "cameras"), other.file(folder, "images"));
    let problem = match images.metadata() {
        Ok(metadata) if metadata.len() > COMPARED => {
            Some(format!("are too large to be compared, {} bytes", metadata.len()))
        }
        _ => match read_model(other, &cameras, &images) {
            Ok((cameras, images)) => difference(read, (&cameras, &images)).map(|what| format!("differ: {what}")),
            Err(error) => Some(format!("cannot be read: {error}")),
        },
    };
    if let Some(problem) = problem {
        let detail = format!(
            "cameras.{ours} and images.{ours} are read; cameras.{theirs} and images.{theirs} next to them {problem} ({})",
            folder.display()
        );
        warnings.push(WarningKind::IgnoredScene, key, detail);
    }
}

fn read_model(
    encoding: Encoding,
    cameras: &Path,
    images: &Path,
) -> Result<(BTreeMap<u32, ColmapCamera>, Vec<ColmapImage>), SceneError> {
    Ok((
        parse_cameras(&read_file("reading COLMAP cameras", cameras)?, encoding, cameras)?,
        parse_images(&read_file("reading COLMAP images", images)?, encoding, images)?,
    ))
}

/// What differs between two models by more than rounding.
fn difference((cameras, images): Model<'_>, (other_cameras, other_images): Model<'_>) -> Option<String> {
    let is_other = |id: &&u32| match (cameras.get(id), other_cameras.get(id)) {
        (Some(ours), Some(theirs)) => {
            let is_near = |(a, b): (&f64, &f64)| SAME.accepts(*a, *b);
            let is_same = ours.model == theirs.model && ours.size == theirs.size;
            !(is_same && ours.parameters.iter().zip(&theirs.parameters).all(is_near))
        }
        _ => true,
    };
    if let Some(id) = cameras.keys().chain(other_cameras.keys()).find(is_other) {
        return Some(format!("camera {id}"));
    }
    if images.len() != other_images.len() {
        return Some(format!("{} images, not {}", other_images.len(), images.len()));
    }
    let by_id: BTreeMap<u32, &ColmapImage> = other_images.iter().map(|image| (image.id, image)).collect();
    let is_other = |image: &&ColmapImage| {
        by_id.get(&image.id).is_none_or(|other| {
            let is_same = image.name == other.name && image.camera_id == other.camera_id;
            let is_placed_alike = match (&image.camera_from_world, &other.camera_from_world) {
                (Ok(ours), Ok(theirs)) => is_near(ours, theirs),
                (ours, theirs) => ours.is_err() && theirs.is_err(),
            };
            !(is_same && is_placed_alike)
        })
    };
    let mut others = images.iter().filter(is_other);
    let first = others.next()?;
    Some(format!("{} of {} images, first {}", others.count() + 1, images.len(), first.name))
}

fn is_near(a: &CameraFromWorld, b: &CameraFromWorld) -> bool {
    a.to_rows().into_iter().zip(b.to_rows()).all(|(a, b)| SAME.accepts(a, b))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::colmap::{ColmapOptions, ColmapScenes};
    use crate::{Scene, SceneSource};

    fn images_bin(xs: [f64; 2]) -> Vec<u8> {
        let mut bytes = 2u64.to_le_bytes().to_vec();
        for (id, x) in (1u32..).zip(xs) {
            bytes.extend(id.to_le_bytes());
            bytes.extend([1.0, 0.0, 0.0, 0.0, x, 0.0, 0.0].map(f64::to_le_bytes).concat());
            bytes.extend(1u32.to_le_bytes());
            bytes.extend(format!("{id}.png\0").into_bytes());
            bytes.extend(0u64.to_le_bytes());
        }
        bytes
    }

    fn cameras_bin(focal: f64) -> Vec<u8> {
        let lens = [focal, focal, 100.0, 50.0].map(f64::to_le_bytes).concat();
        let [one, width, height] = [1u64, 200, 100].map(u64::to_le_bytes);
        [&one[..], &1u32.to_le_bytes(), &1i32.to_le_bytes(), &width, &height, &lens].concat()
    }

    /// A binary model with x = 1 and 2 and the focal length 100, and this text next to it.
    fn load(cameras: &str, images: &str) -> (Scene, Vec<(WarningKind, String)>) {
        load_with_text([1.0, 2.0], cameras, images)
    }

    fn load_with_text(xs: [f64; 2], cameras: &str, images: &str) -> (Scene, Vec<(WarningKind, String)>) {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
        write("cameras.bin", &cameras_bin(100.0));
        write("images.bin", &images_bin(xs));
        if !cameras.is_empty() {
            write("cameras.txt", cameras.as_bytes());
        }
        write("images.txt", images.as_bytes());
        let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
        let key = &source.keys()[0];
        assert_eq!(source.files(key).unwrap().len(), if cameras.is_empty() { 3 } else { 5 }, "what is fetched");
        let mut warnings = Warnings::new();
        let scene = source.load(key, &mut warnings).unwrap();
        let others = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::IgnoredScene);
        (scene, others.map(|warning| (warning.kind, warning.detail.clone())).collect())
    }

    const CAMERAS: &str = "1 PINHOLE 200 100 100 100 100 50\n";
    const IMAGES: &str = "2 1 0 0 0 2.0000001 0 0 1 2.png\n\n1 1 0 0 0 1 0 0 1 1.png\n\n";

    #[test]
    fn text_next_to_a_binary_model_may_differ_by_rounding_and_order() {
        assert_eq!(load(CAMERAS, IMAGES).1, []);
        assert_eq!(load("", "1 1 0 0 0 9 0 0 1 1.png\n").1, [], "images alone are not a model");
    }

    /// The second image of the binary model has no pose.
    #[test]
    fn an_unusable_pose_is_the_same_only_as_another_one() {
        let with_text = |x: &str| {
            let images = IMAGES.replace(" 2.0000001 ", x);
            let (scene, found) = load_with_text([1.0, f64::NAN], CAMERAS, &images);
            assert_eq!(scene.frames.iter().map(crate::Frame::has_pose).collect::<Vec<_>>(), [true, false]);
            found
        };
        assert_eq!(with_text(" nan "), []);
        let found = with_text(" 2 ");
        assert!(found.len() == 1 && found[0].1.contains("differ: 1 of 2 images, first 2.png ("), "{found:?}");
    }

    #[test]
    fn another_model_in_the_other_encoding_is_counted() {
        let focal = CAMERAS.replace("100 100 100 50", "100 130 100 50");
        for (cameras, images, expected) in [
            (focal.as_str(), IMAGES.to_owned(), "differ: camera 1 ("),
            (CAMERAS, IMAGES.replace(" 2.0000001 ", " 5 "), "differ: 1 of 2 images, first 2.png ("),
            (CAMERAS, IMAGES.replace("1.png", "3.png"), "differ: 1 of 2 images, first 1.png ("),
            (CAMERAS, "1 1 0 0 0 1 0 0 1 1.png\n".to_owned(), "differ: 1 images, not 2 ("),
            (CAMERAS, "nonsense\n".to_owned(), "cannot be read: "),
        ] {
            let (scene, found) = load(cameras, &images);
            let x = scene.frames[1].camera.camera_from_world.translation().x;
            Tolerance::F64.assert([x], [2.0], "the binary model is read");
            let [(_, detail)] = found.as_slice() else { panic!("{expected}: {found:?}") };
            let read = "cameras.bin and images.bin are read; cameras.txt and images.txt next to them ";
            assert!(detail.starts_with(read) && detail.contains(expected), "{detail}");
        }
    }
}
