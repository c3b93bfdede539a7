//! Lenses whose model ends inside the image.

use std::cell::RefCell;

use atsplat_camera::{Camera, CameraError, CameraFromWorld, Distortion, ImageSize};
use glam::DVec2;

use crate::Frame;

/// Looks for lenses that map nothing to a part of the image. Frames with the lens of the frame before cost nothing.
#[derive(Debug, Default)]
pub(crate) struct LensEnds {
    last: RefCell<Option<Known>>,
}

#[derive(Debug)]
struct Known {
    lens: Camera,
    size: Option<ImageSize>,
    end: Option<String>,
}

impl LensEnds {
    /// Where the lens of a frame ends inside its image: renderers leave pixels beyond as background.
    pub(crate) fn inside(&self, frame: &Frame) -> Option<String> {
        let lens = Camera { camera_from_world: CameraFromWorld::IDENTITY, ..frame.camera };
        if lens.distortion == Distortion::None {
            return None;
        }
        let mut last = self.last.borrow_mut();
        match &*last {
            Some(known) if known.lens == lens && known.size == frame.stated_size => known.end.clone(),
            _ => {
                let end = end_inside(&lens, frame.stated_size);
                *last = Some(Known { lens, size: frame.stated_size, end: end.clone() });
                end
            }
        }
    }
}

/// The corner pixels are farthest from the axis, wherever it is; their centres are used, if the size is known.
fn end_inside(lens: &Camera, size: Option<ImageSize>) -> Option<String> {
    let projector = lens.projector().ok()?;
    let (x, y) = size.map_or((0.0, 0.0), |size| (0.5 / f64::from(size.width), 0.5 / f64::from(size.height)));
    let corners = [[x, y], [1.0 - x, y], [x, 1.0 - y], [1.0 - x, 1.0 - y]];
    let names = ["upper left", "upper right", "lower left", "lower right"];
    let beyond = |corner: [f64; 2]| {
        matches!(projector.camera_direction(DVec2::from_array(corner)), Err(CameraError::OutsideLens { .. }))
    };
    let (_, name) = corners.into_iter().zip(names).find(|(corner, _)| beyond(*corner))?;
    let degrees = lens.distortion.lens().ok()?.angle_limit().to_degrees();
    Some(format!(
        "the lens model ends inside the image, {degrees:.1}° from the axis, before the {name} corner; pixels beyond are \
         rendered as background"
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::checks::cameras::report_cameras;
    use crate::re10k::parse_trajectory;
    use crate::{TimestampSource, WarningKind, Warnings};

    fn barrel(k1: f64) -> Distortion {
        Distortion::OpenCv { k1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }
    }

    /// What is reported for frames with these lenses; focal lengths and principal point are the same.
    fn reported(intrinsics: [f64; 4], lenses: &[Distortion]) -> Vec<String> {
        let [fx, fy, cx, cy] = intrinsics;
        let row = |at: usize| format!("{at} {fx} {fy} {cx} {cy} 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n");
        let rows: String = (0..lenses.len()).map(row).collect();
        let mut scene = parse_trajectory(rows.as_bytes(), Path::new("clip.txt")).unwrap().to_scene("clip");
        for (frame, lens) in scene.frames.iter_mut().zip(lenses) {
            frame.camera.distortion = *lens;
        }
        let mut warnings = Warnings::new();
        report_cameras(&scene, TimestampSource::Given, &mut warnings);
        let ends = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::LensEndsInside);
        ends.map(|warning| warning.detail.clone()).collect()
    }

    /// `r·(1 + k1·r²)` turns at `r² = −1 / (3 k1)`, where it is `2r/3`; the corners are at 0.707 for a focal length of 1.
    #[test]
    fn a_fold_before_the_corners_is_counted_by_frame() {
        let square = [1.0, 1.0, 0.5, 0.5];
        let [folds, fits] = [-0.31, -0.29].map(barrel);
        assert!(
            2.0 / 3.0 / (3.0f64 * 0.31).sqrt() < 0.5f64.sqrt() && 2.0 / 3.0 / (3.0f64 * 0.29).sqrt() > 0.5f64.sqrt()
        );
        let found = reported(square, &[Distortion::None, fits, folds, fits, folds]);
        assert_eq!(found.len(), 1);
        assert!(
            found[0].starts_with("2 of 5 frames, first 2: the lens model ends inside the image, 46.0° "),
            "{found:?}"
        );
        assert_eq!(reported(square, &[Distortion::None, fits, barrel(0.4)]), [""; 0]);
    }

    /// The corner farthest from the principal point, which is left of or right of the centre, and above or below it.
    #[test]
    fn the_corner_beyond_is_named() {
        for (cx, cy, corner) in [
            (0.45, 0.45, "lower right"),
            (0.45, 0.55, "upper right"),
            (0.55, 0.45, "lower left"),
            (0.55, 0.55, "upper left"),
        ] {
            let found = reported([1.0, 1.0, cx, cy], &[barrel(-0.29)]);
            assert!(found[0].contains(&format!("before the {corner} corner")), "{found:?}");
        }
        let fisheye = Distortion::Fisheye { k: [-0.3, 0.0, 0.0, 0.0] };
        assert_eq!(reported([1.2, 1.2, 0.5, 0.5], &[fisheye]), [""; 0], "up to 60.4°, at 0.703 > 0.59");
        assert_eq!(reported([1.0, 1.0, 0.5, 0.5], &[fisheye]).len(), 1, "0.703 < 0.707");
    }
}
