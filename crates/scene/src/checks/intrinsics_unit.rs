//! Whether intrinsics are in the unit of their format: multiples of the image's sides in RE10K and `.torch` chunks,
//! pixels where an image size is stated.

use atsplat_camera::{ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;

use crate::ImageFolder;

/// Longest focal length in image sides that a capture has: a field of view of 2.9°, 720 mm on full frame. Satellites have longer ones,
/// but none of the protocols is about such images.
const LONGEST: f64 = 20.0;

/// Shortest focal length in image sides that a lens has: a field of view of 157°; a fisheye of 220° has 0.26.
const SHORTEST: f64 = 0.1;

/// An image smaller than this, in pixels, may have its centre within a pixel of the corner.
const SMALL: u32 = 20;

/// How far from the middle a principal point may be, in image sides: lenses and crops of the field stay within a tenth.
const NEAR_MIDDLE: Tolerance = Tolerance::absolute(0.15);

/// How far, in parts of it, a principal point may be from the middle of a copy for which it seems to be stated.
const MIDDLE_OF_COPY: Tolerance = Tolerance::relative(0.1);

/// What is said about a principal point far from the middle: the intrinsics may be stated for a downscaled copy of the images, or the
/// fields be mixed up. Of intrinsics in another unit, [`wrong_unit`] says more.
pub(crate) fn far_off_middle(k: &NormalizedIntrinsics) -> Option<String> {
    let (cx, cy) = (k.cx, k.cy);
    if NEAR_MIDDLE.accepts(cx, 0.5) && NEAR_MIDDLE.accepts(cy, 0.5) {
        return None;
    }
    let is_middle = |factor: &f64| [cx, cy].iter().all(|centre| MIDDLE_OF_COPY.accepts(*centre, 0.5 / factor));
    let suspicion = ImageFolder::FACTORS
        .map(f64::from)
        .into_iter()
        .find(is_middle)
        .map_or_else(String::new, |factor| format!(": stated for another size, by a factor of about {factor}?"));
    Some(format!("expected a principal point near the middle (0.5, 0.5), found cx {cx:.3}, cy {cy:.3}{suspicion}"))
}

/// What intrinsics seem to be, if they are not in the unit of their format, which may state the size of the image.
pub(crate) fn wrong_unit(k: &NormalizedIntrinsics, stated_size: Option<ImageSize>) -> Option<String> {
    let is_far = |centre: f64| !(-1.0..=2.0).contains(&centre);
    let is_far = is_far(k.cx) || is_far(k.cy);
    let is_long = k.fx > LONGEST || k.fy > LONGEST;
    let Some(size) = stated_size else {
        return (is_long || is_far).then(|| {
            let found = format!("fx {:.3}, fy {:.3}, cx {:.3}, cy {:.3}", k.fx, k.fy, k.cx, k.cy);
            format!("expected multiples of the image's width and height, found {found}: pixels?")
        });
    };
    let pixels = k.pixel_from_normalized(size);
    let is_short = |pixels: f64, sides: f64| pixels <= LONGEST && sides < SHORTEST;
    let at_corner = |pixels: f64| pixels > 0.0 && pixels <= 1.0;
    let is_small = size.width < SMALL || size.height < SMALL;
    let is_centred_at_corner = at_corner(pixels.cx) && at_corner(pixels.cy) && !is_small;
    let suspicion = if is_short(pixels.fx, k.fx) || is_short(pixels.fy, k.fy) || is_centred_at_corner {
        "multiples of its width and height?"
    } else if is_long {
        "a field of view below 3°, from an angle in another unit or for another size?"
    } else if is_far {
        "stated for another size?"
    } else {
        return None;
    };
    let found = format!("fx {:.3}, fy {:.3}, cx {:.3}, cy {:.3}", pixels.fx, pixels.fy, pixels.cx, pixels.cy);
    Some(format!("expected pixels of an image of {size}, found {found}: {suspicion}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(numbers: [f64; 4], stated: Option<(u32, u32)>) -> Option<String> {
        let size = stated.map(|(width, height)| ImageSize { width, height });
        wrong_unit(&intrinsics(numbers, stated), size)
    }

    fn intrinsics([fx, fy, cx, cy]: [f64; 4], stated: Option<(u32, u32)>) -> NormalizedIntrinsics {
        let (width, height) = stated.unwrap_or((1, 1));
        let (x, y) = (f64::from(width), f64::from(height));
        NormalizedIntrinsics::new(fx / x, fy / y, cx / x, cy / y).unwrap()
    }

    #[test]
    fn pixels_where_multiples_are_expected() {
        for pixels in [[53.9, 95.8, 0.5, 0.5], [0.5, 95.8, 0.5, 0.5], [0.5, 0.9, 32.0, 0.5], [0.5, 0.9, 0.5, -18.0]] {
            let message = found(pixels, None).unwrap();
            assert!(message.contains("found fx ") && message.ends_with(": pixels?"), "{pixels:?}: {message}");
        }
        for fine in [[0.48, 0.86, 0.5, 0.5], [17.0, 19.0, 0.5, 0.5], [0.26, 0.26, 0.5, 0.5], [0.5, 0.9, -0.4, 1.3]] {
            assert_eq!(found(fine, None), None, "{fine:?}");
        }
    }

    #[test]
    fn multiples_where_pixels_are_expected() {
        let size = Some((192, 128));
        for sides in
            [[0.87, 1.3, 0.5, 0.5], [0.87, 1.3, 96.0, 64.0], [167.0, 1.3, 96.0, 64.0], [167.0, 167.0, 0.5, 0.4]]
        {
            let message = found(sides, size).unwrap();
            assert!(message.contains("192×128") && message.contains("multiples of its"), "{sides:?}: {message}");
        }
        // 54 sides are a field of view of 1.06 radians, read as degrees.
        for long in [[10_380.0, 10_380.0, 96.0, 64.0], [167.0, 2600.0, 96.0, 64.0]] {
            let message = found(long, size).unwrap();
            assert!(
                message.ends_with(": a field of view below 3°, from an angle in another unit or for another size?")
            );
        }
        assert!(found([167.0, 167.0, 960.0, 540.0], size).unwrap().contains("another size?"));
        assert_eq!(found([167.0, 167.0, 0.0, 0.0], size), None, "an unset principal point is not in another unit");
    }

    /// Those of copies of 192×128, and of one axis alone.
    #[test]
    fn principal_points_far_off_the_middle() {
        let size = Some((192, 128));
        for (centre, stated, factor) in [
            ([24.5, 15.5], size, Some("4")),
            ([48.0, 31.0], size, Some("2")),
            ([12.0, 8.0], size, Some("8")),
            ([0.13, 0.12], None, Some("4")),
            ([48.0, 64.0], size, None),
            ([0.25, 0.12], None, None),
            ([0.5, 0.66], None, None),
            ([0.0, 0.0], None, None),
        ] {
            let message = far_off_middle(&intrinsics([0.9, 1.3, centre[0], centre[1]], stated)).unwrap();
            let suspicion =
                message.split_once(": stated for another size, by a factor of about ").map(|(_, rest)| rest);
            assert_eq!(suspicion, factor.map(|factor| format!("{factor}?")).as_deref(), "{message}");
        }
        for fine in [[0.5, 0.5], [0.36, 0.64], [0.64, 0.5]] {
            assert_eq!(far_off_middle(&intrinsics([0.9, 1.3, fine[0], fine[1]], None)), None, "{fine:?}");
        }
    }

    #[test]
    fn small_images_and_long_lenses_are_plausible() {
        for (fine, size) in [
            ([2.0, 2.0, 1.0, 1.0], (2, 2)),
            ([4.0, 4.0, 2.0, 1.5], (4, 3)),
            ([1375.0, 1374.0, 555.0, 965.0], (1080, 1920)),
            ([3800.0, 2500.0, 96.0, 64.0], (192, 128)),
            ([50.0, 50.0, 96.0, 64.0], (192, 128)),
        ] {
            assert_eq!(found(fine, Some(size)), None, "{fine:?} of {size:?}");
        }
    }
}
