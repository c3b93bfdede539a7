//! Asks whether images were written wrongly: mirrored, rotated or transposed, as BGR, as linear light or encoded twice, in another
//! order, one for all targets, or of nothing better than one colour.
//!
//! For each correction that would undo such a mistake, thumbnails of a render and its ground truth are compared before and after. It is
//! noted for a trial if it leaves, in more than half of the targets, less than a quarter of the mean squared error and less than an
//! absolute limit. Of imported images, which may be of several formats, one is enough, if its error is large and the correction leaves
//! nearly nothing of it. Of several corrections, the one of most images is noted, and of these the one that leaves the least error.
//!
//! Renders of a weak model keep a large error. If one correction improves every one of at least three, it is noted too ([`consistent`]).
//!
//! On real frames, methods of 19 to 30 dB have at least 22 times their error after any of these corrections, and images with one of
//! the mistakes have at most 0.05 times their error after its correction.

mod consistent;

use std::collections::{BTreeMap, BTreeSet};

use atsplat_pixels::{Image, ImageU8, Srgb as _};
use atsplat_results::{RecordKind, TargetRow, TargetStatus};

use crate::suspicious_notes::SuspiciousNote;

const MAX_THUMBNAIL_SIDE: usize = 32;
/// A correction is noted if it leaves less than this share of the mean squared error,
const MAX_SHARE_LEFT: f64 = 0.25;
/// and less than this error.
const MAX_ERROR_LEFT: f64 = 0.01;
/// An image with a smaller error has no mistake.
const MIN_ERROR: f64 = 1e-5;
/// The share that a correction may leave of the large error of an image that is noted alone: more than of any image with a mistake, and
/// far less than by accident.
const MAX_SHARE_LEFT_OF_ONE: f64 = 0.06;
/// Mean squared difference of two ground truths that cannot be confused, and of one and a flat colour.
const MIN_DISTINCT_DIFFERENCE: f64 = 0.002;

/// A change that would undo a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Correction {
    ExchangeRedAndBlue,
    EncodeAsSrgb,
    DecodeFromSrgb,
    MirrorLeftToRight,
    MirrorTopToBottom,
    RotateByHalfTurn,
    Transpose,
    /// The image belongs to another target of the trial.
    Reorder,
}

impl Correction {
    /// Those of a single image.
    const OF_IMAGE: [Self; 7] = [
        Self::ExchangeRedAndBlue,
        Self::EncodeAsSrgb,
        Self::DecodeFromSrgb,
        Self::MirrorLeftToRight,
        Self::MirrorTopToBottom,
        Self::RotateByHalfTurn,
        Self::Transpose,
    ];

    /// How a note goes on.
    const fn text(self) -> &'static str {
        match self {
            Self::ExchangeRedAndBlue => "with red and blue exchanged",
            Self::EncodeAsSrgb => "encoded as sRGB, as if they were linear light",
            Self::DecodeFromSrgb => "decoded from sRGB, as if they were encoded twice",
            Self::MirrorLeftToRight => "mirrored left to right",
            Self::MirrorTopToBottom => "mirrored top to bottom",
            Self::RotateByHalfTurn => "rotated by 180°",
            Self::Transpose => "with rows and columns exchanged",
            Self::Reorder => "of other targets, as if they were in another order",
        }
    }
}

/// An image of box means.
#[derive(Clone, Debug)]
struct Thumbnail {
    columns: usize,
    /// Whether the image itself is square.
    is_square: bool,
    /// Row-major, in [0, 1].
    pixels: Vec<[f64; 3]>,
}

impl Thumbnail {
    fn of(width: u32, height: u32, pixels: impl Iterator<Item = [f32; 3]>) -> Self {
        let [width, height] = [width as usize, height as usize];
        let [columns, rows] = [width, height].map(|side| side.min(MAX_THUMBNAIL_SIDE));
        let mut sums = vec![([0.0; 3], 0.0); columns * rows];
        for (index, pixel) in pixels.enumerate() {
            let cell = index / width * rows / height * columns + index % width * columns / width;
            if let Some((sum, count)) = sums.get_mut(cell) {
                *sum = added(*sum, pixel.map(|sample| f64::from(sample.clamp(0.0, 1.0))));
                *count += 1.0;
            }
        }
        let pixels = sums.into_iter().map(|(sum, count)| sum.map(|sum| sum / count)).collect();
        Self { columns, is_square: width == height, pixels }
    }

    /// The pixels after a correction of a single image; `None` if it would change the image's size.
    fn corrected(&self, correction: Correction) -> Option<Vec<[f64; 3]>> {
        let rows = || self.pixels.chunks_exact(self.columns.max(1));
        let pixels = self.pixels.iter().copied();
        Some(match correction {
            Correction::ExchangeRedAndBlue => pixels.map(|[red, green, blue]| [blue, green, red]).collect(),
            Correction::EncodeAsSrgb => pixels.map(|pixel| pixel.map(f64::srgb_from_linear)).collect(),
            Correction::DecodeFromSrgb => pixels.map(|pixel| pixel.map(f64::linear_from_srgb)).collect(),
            Correction::MirrorLeftToRight => rows().flat_map(|row| row.iter().rev().copied()).collect(),
            Correction::MirrorTopToBottom => rows().rev().flatten().copied().collect(),
            Correction::RotateByHalfTurn => pixels.rev().collect(),
            Correction::Transpose if self.is_square => {
                (0..self.columns).flat_map(|column| rows().filter_map(move |row| row.get(column).copied())).collect()
            }
            Correction::Transpose | Correction::Reorder => return None,
        })
    }
}

fn added(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let ([a0, a1, a2], [b0, b1, b2]) = (a, b);
    [a0 + b0, a1 + b1, a2 + b2]
}

/// Mean squared difference; NaN without pixels.
fn difference(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let squares = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f64>() / a.as_flattened().len() as f64
}

/// A scored render and its ground truth, as far as they are kept until the trial is finished.
#[derive(Clone, Debug)]
pub(super) struct RenderAndTruth {
    render: Thumbnail,
    truth: Thumbnail,
    /// Whether the target is a context frame too.
    is_leaked: bool,
    /// Whether the best flat colour has no larger error.
    is_no_better_than_flat: bool,
}

impl RenderAndTruth {
    /// Of two images of one size.
    pub(super) fn of(render: &Image, truth: &ImageU8, is_leaked: bool) -> Self {
        let (width, height) = (truth.width(), truth.height());
        let rendered = || render.samples().as_chunks::<3>().0.iter().copied();
        let pixel_of = |pixel: &[u8; 3]| pixel.map(|sample| f32::from(sample) / 255.0);
        let true_pixels = || truth.samples().as_chunks::<3>().0.iter().map(pixel_of);
        let (mut error, mut sum, mut squares) = (0.0, [0.0; 3], [0.0; 3]);
        for (rendered, expected) in rendered().zip(true_pixels()) {
            let [rendered, expected] = [rendered, expected].map(|pixel| pixel.map(f64::from));
            error += difference(&[rendered], &[expected]);
            sum = added(sum, expected);
            squares = added(squares, expected.map(|sample| sample * sample));
        }
        let count = f64::from(width) * f64::from(height);
        let mean_squares = sum.map(|sum| (sum / count) * (sum / count)).iter().sum::<f64>();
        let variance = (squares.iter().sum::<f64>() / count - mean_squares) / 3.0;
        Self {
            render: Thumbnail::of(width, height, rendered()),
            truth: Thumbnail::of(width, height, true_pixels()),
            is_leaked,
            is_no_better_than_flat: variance >= MIN_DISTINCT_DIFFERENCE && error / count >= variance,
        }
    }

    fn error(&self) -> f64 {
        difference(&self.render.pixels, &self.truth.pixels)
    }

    /// Each correction after which the render is far closer to its ground truth.
    fn corrections(&self) -> Vec<(Correction, Corrected)> {
        let before = self.error();
        if before < MIN_ERROR {
            return Vec::new();
        }
        let corrected = |correction| {
            let after = difference(&self.render.corrected(correction)?, &self.truth.pixels);
            let is_certain = after < MAX_SHARE_LEFT_OF_ONE * before && before >= MIN_DISTINCT_DIFFERENCE;
            let corrected = Corrected { images: 1, certain: is_certain.into(), error_left: after };
            is_far_closer(before, after).then_some((correction, corrected))
        };
        Correction::OF_IMAGE.into_iter().filter_map(corrected).collect()
    }

    /// The position among `all` of the ground truth that the render resembles far more than its own, with the error that is
    /// left. Not that of a context frame, which methods that copy one resemble rightly.
    fn truth_of_another(&self, all: &[Self]) -> Option<(usize, f64)> {
        let before = self.error();
        // Without this much, no distinct truth can be so much closer.
        if before < MIN_DISTINCT_DIFFERENCE / 3.0 {
            return None;
        }
        let closer = |(position, other): (usize, &Self)| {
            let after = difference(&self.render.pixels, &other.truth.pixels);
            let is_distinct = || difference(&self.truth.pixels, &other.truth.pixels) >= MIN_DISTINCT_DIFFERENCE;
            (!other.is_leaked && is_far_closer(before, after) && is_distinct()).then_some((position, after))
        };
        all.iter().enumerate().filter_map(closer).min_by(|(_, a), (_, b)| a.total_cmp(b))
    }
}

fn is_far_closer(error_before: f64, error_after: f64) -> bool {
    error_after < MAX_SHARE_LEFT * error_before && error_after < MAX_ERROR_LEFT
}

/// Images that a correction brings far closer to their ground truth.
#[derive(Clone, Copy, Debug, Default)]
struct Corrected {
    images: usize,
    /// Those of them that are noted alone.
    certain: usize,
    /// The sum of the errors that are left.
    error_left: f64,
}

/// The correction that brings most of a trial's `targets` renders, or single imported ones, far closer to the ground truth, and how many.
fn likeliest_correction(pairs: &[RenderAndTruth], targets: usize, kind: RecordKind) -> Option<(Correction, usize)> {
    let of_images = pairs.iter().flat_map(RenderAndTruth::corrections);
    // Renders that resemble one and the same truth are those of a method that copies one view.
    let mut resembled = BTreeSet::new();
    let reordered = pairs.iter().filter_map(|pair| pair.truth_of_another(pairs));
    let reordered = reordered.filter(|(position, _)| resembled.insert(*position));
    let reordered =
        reordered.map(|(_, error_left)| (Correction::Reorder, Corrected { images: 1, certain: 0, error_left }));
    let mut found: BTreeMap<Correction, Corrected> = BTreeMap::new();
    for (correction, Corrected { images, certain, error_left }) in of_images.chain(reordered) {
        let all = found.entry(correction).or_default();
        all.images += images;
        all.certain += certain;
        all.error_left += error_left;
    }
    let is_noted = |all: &Corrected| 2 * all.images > targets || (kind == RecordKind::Renders && all.certain > 0);
    let noted = found.into_iter().filter(|(_, all)| is_noted(all));
    let best = noted.min_by(|(_, a), (_, b)| b.images.cmp(&a.images).then(a.error_left.total_cmp(&b.error_left)));
    best.map(|(correction, all)| (correction, all.images))
}

/// The note on a trial with these rows of a method of this kind, of which `pairs` are the scored ones. With `are_noted`, its
/// renders are known to be suspicious for another reason.
pub(super) fn note(pairs: &[RenderAndTruth], rows: &[TargetRow], kind: RecordKind, are_noted: bool) -> Option<String> {
    let targets = rows.len();
    if let Some((correction, count)) = likeliest_correction(pairs, targets, kind) {
        return Some(format!("{} {}: {count} of {targets}", SuspiciousNote::WrittenWrongly, correction.text()));
    }
    if kind == RecordKind::Renders && is_one_image(rows) {
        let repeated = SuspiciousNote::Repeated;
        return Some(format!("{repeated}: {targets} of {targets} renders are equal, and the ground truth differs"));
    }
    if let Some(correction) = consistent::correction(pairs, targets) {
        return Some(format!("{} {}: {targets} of {targets}", SuspiciousNote::WrittenWrongly, correction.text()));
    }
    let is_flat = targets > 0 && pairs.len() == targets && pairs.iter().all(|pair| pair.is_no_better_than_flat);
    let flat = SuspiciousNote::Flat;
    (is_flat && !are_noted).then(|| format!("{flat}: {targets} of {targets} (wrong poses, scale or axes?)"))
}

/// Whether all renders are equal although no two ground truths are.
fn is_one_image(rows: &[TargetRow]) -> bool {
    let renders: BTreeSet<_> = rows.iter().map(|row| &row.render_hash).collect();
    let truths: BTreeSet<_> = rows.iter().filter_map(|row| row.truth_hash.as_ref()).collect();
    let is_scored = |row: &TargetRow| row.status == TargetStatus::Scored || row.status == TargetStatus::Identical;
    rows.len() > 1 && rows.iter().all(is_scored) && renders.len() == 1 && truths.len() == rows.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDES: (u32, u32) = (48, 48);

    /// A scene without symmetries, from one of several places.
    fn truth(place: u8, (width, height): (u32, u32)) -> ImageU8 {
        let pixel = |index: u32| {
            let (x, y) = (f64::from(index % width) / f64::from(width), f64::from(index / width) / f64::from(height));
            let shift = 0.25 * f64::from(place);
            [0.2 + 0.6 * x * y, 0.1 + 0.5 * (x + shift).fract(), 0.3 * y * y + 0.15 * (3.0 * x + shift).sin().abs()]
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours lie in [0, 1]")]
        let samples = (0..width * height).flat_map(|index| pixel(index).map(|value| (255.0 * value).round() as u8));
        ImageU8::new(width, height, samples.collect()).unwrap()
    }

    /// A method's render: with an error of about 0.02.
    fn render(truth: &ImageU8) -> Image {
        let samples = Image::from_u8(truth).into_samples().into_iter().enumerate();
        let samples = samples.map(|(index, sample)| sample + if index % 7 < 3 { 0.02 } else { -0.02 });
        Image::new(truth.width(), truth.height(), samples.collect()).unwrap()
    }

    fn changed(image: &Image, change: impl Fn(&Image, u32, u32) -> [f32; 3]) -> Image {
        let (width, height) = (image.width(), image.height());
        let pixels = (0..width * height).flat_map(|index| change(image, index % width, index / width));
        Image::new(width, height, pixels.collect()).unwrap()
    }

    fn row(at: u32, render: &str) -> TargetRow {
        let (render_hash, truth_hash) = (Some(render.to_owned()), Some(at.to_string()));
        TargetRow { truth_hash, render_hash, ..crate::sample_rows::target("m", "a", 0, at, "psnr", 20.0) }
    }

    /// The note of a trial with these renders, by the truth that they are compared with.
    fn noted(images: &[(Image, ImageU8, bool)], are_noted: bool) -> String {
        noted_of(RecordKind::Renders, images, are_noted)
    }

    fn noted_of(kind: RecordKind, images: &[(Image, ImageU8, bool)], are_noted: bool) -> String {
        let pair = |(render, truth, leaked): &(Image, ImageU8, bool)| RenderAndTruth::of(render, truth, *leaked);
        let pairs: Vec<RenderAndTruth> = images.iter().map(pair).collect();
        let rows: Vec<TargetRow> = (0u32..).zip(images).map(|(at, _)| row(at, &at.to_string())).collect();
        note(&pairs, &rows, kind, are_noted).unwrap_or_default()
    }

    fn of_all(change: impl Fn(&Image) -> Image) -> String {
        let image = |at| (change(&render(&truth(at, SIDES))), truth(at, SIDES), false);
        noted(&[0, 1, 2].map(image), false)
    }

    #[test]
    fn each_mistake_in_writing_images_is_noted_once() {
        let at = |image: &Image, x: u32, y: u32| image.pixel(x, y).unwrap();
        let gamma = |curve: fn(f64) -> f64| {
            move |image: &Image| {
                #[expect(clippy::cast_possible_truncation, reason = "a colour")]
                let sample = |value: f32| curve(f64::from(value).clamp(0.0, 1.0)) as f32;
                Image::new(image.width(), image.height(), image.samples().iter().map(|v| sample(*v)).collect()).unwrap()
            }
        };
        let said = |text: &str| format!("renders would be closer to the truth {text}: 3 of 3");
        assert_eq!(of_all(Image::clone), "", "correct renders");
        let swapped = of_all(|image| {
            changed(image, |image, x, y| {
                let [red, green, blue] = at(image, x, y);
                [blue, green, red]
            })
        });
        assert_eq!(swapped, said("with red and blue exchanged"));
        assert_eq!(of_all(gamma(f64::linear_from_srgb)), said("encoded as sRGB, as if they were linear light"));
        assert_eq!(of_all(gamma(f64::srgb_from_linear)), said("decoded from sRGB, as if they were encoded twice"));
        let last = SIDES.0 - 1;
        let moved = |from: fn(u32, u32, u32) -> (u32, u32)| {
            of_all(|image| {
                changed(image, |image, x, y| {
                    let (x, y) = from(x, y, last);
                    at(image, x, y)
                })
            })
        };
        assert_eq!(moved(|x, y, last| (last - x, y)), said("mirrored left to right"));
        assert_eq!(moved(|x, y, last| (x, last - y)), said("mirrored top to bottom"));
        assert_eq!(moved(|x, y, last| (last - x, last - y)), said("rotated by 180°"));
        assert_eq!(moved(|x, y, _| (y, x)), said("with rows and columns exchanged"));
    }

    /// A weak model's render: with an error of 0.12 in blocks, of 18.5 dB.
    fn weak(truth: &ImageU8) -> Image {
        changed(&Image::from_u8(truth), |image, x, y| {
            let error = if (x / 6 + y / 6) % 2 == 1 { 0.12 } else { -0.12 };
            image.pixel(x, y).unwrap().map(|sample| (sample + error).clamp(0.0, 1.0))
        })
    }

    /// No correction leaves an error that is small enough for a single image.
    #[test]
    fn a_mistake_in_every_render_of_a_weak_model_is_noted() {
        fn said(wrong: &dyn Fn(&Image, u32, u32) -> [f32; 3], are_wrong: &[bool]) -> String {
            let image = |(place, is_wrong): (u8, &bool)| {
                let truth = truth(place, SIDES);
                let right = weak(&truth);
                (if *is_wrong { changed(&right, wrong) } else { right }, truth, false)
            };
            // Without the note on flat renders, which two with a mistake would have.
            noted(&(0..).zip(are_wrong).map(image).collect::<Vec<_>>(), true)
        }
        fn check(text: &str, wrong: &dyn Fn(&Image, u32, u32) -> [f32; 3]) {
            assert_eq!(said(wrong, &[true; 3]), format!("renders would be closer to the truth {text}: 3 of 3"));
            assert_eq!(said(wrong, &[true, false, true]), "", "{text}: one is correct");
            assert_eq!(said(wrong, &[true; 2]), "", "{text}: two are too few");
        }
        let at = |image: &Image, x: u32, y: u32| image.pixel(x, y).unwrap();
        let last = SIDES.0 - 1;
        assert_eq!(said(&at, &[true; 3]), "", "as they are");
        check("with red and blue exchanged", &|image, x, y| {
            let [red, green, blue] = at(image, x, y);
            [blue, green, red]
        });
        check("mirrored left to right", &|image, x, y| at(image, last - x, y));
        check("mirrored top to bottom", &|image, x, y| at(image, x, last - y));
        check("rotated by 180°", &|image, x, y| at(image, last - x, last - y));
        check("with rows and columns exchanged", &|image, x, y| at(image, y, x));
    }

    /// One EXR of linear light among PNGs, for example. A method that makes all of its images in one way has a dark one by accident.
    #[test]
    fn a_single_imported_image_with_a_mistake_is_noted() {
        let images = [0, 1, 2].map(|at| {
            let image = render(&truth(at, SIDES));
            #[expect(clippy::cast_possible_truncation, reason = "a colour")]
            let linear = |value: &f32| f64::from(value.clamp(0.0, 1.0)).linear_from_srgb() as f32;
            let samples = image.samples().iter().map(linear).collect();
            let shown = if at == 1 { Image::new(image.width(), image.height(), samples).unwrap() } else { image };
            (shown, truth(at, SIDES), false)
        });
        let said = "renders would be closer to the truth encoded as sRGB, as if they were linear light: 1 of 3";
        assert_eq!(noted(&images, false), said);
        assert_eq!(noted_of(RecordKind::Exec, &images, false), "");
    }

    #[test]
    fn images_in_another_order_are_noted_but_not_copies_of_one_view() {
        let truths = [0, 1, 2].map(|at| truth(at, SIDES));
        let shown = |order: [usize; 3], leaked: [bool; 3]| {
            let image = |at: usize| (render(&truths[order[at]]), truths[at].clone(), leaked[at]);
            noted(&[0, 1, 2].map(image), true)
        };
        let reordered =
            "renders would be closer to the truth of other targets, as if they were in another order: 3 of 3";
        assert_eq!(shown([0, 1, 2], [false; 3]), "");
        assert_eq!(shown([1, 2, 0], [false; 3]), reordered);
        assert_eq!(shown([0, 0, 0], [false; 3]), "", "one image for all is not another order");
        assert_eq!(shown([1, 2, 0], [true; 3]), "", "context frames");
    }

    #[test]
    fn one_file_for_all_targets_is_noted_for_imported_images() {
        let rows = [row(0, "x"), row(1, "x"), row(2, "x")];
        let said = "one image for all targets: 3 of 3 renders are equal, and the ground truth differs";
        assert_eq!(note(&[], &rows, RecordKind::Renders, false).as_deref(), Some(said));
        assert_eq!(note(&[], &rows, RecordKind::Exec, false), None, "the nearest view, for example");
        assert_eq!(note(&[], &[row(0, "x"), row(1, "x"), row(2, "y")], RecordKind::Renders, false), None);
        let still = TargetRow { truth_hash: rows[0].truth_hash.clone(), ..row(1, "x") };
        assert_eq!(note(&[], &[row(0, "x"), still], RecordKind::Renders, false), None, "a camera that does not move");
        assert_eq!(note(&[], &rows[..1], RecordKind::Renders, false), None);
    }

    #[test]
    fn renders_that_show_no_more_than_a_flat_colour_are_noted() {
        let flat = |at| {
            let truth = truth(at, SIDES);
            // Of another place, neither the scene nor any change of it.
            let colours = [[0.9, 0.1, 0.8], [0.1, 0.8, 0.0]];
            let wrong = changed(&render(&truth), |_, x, y| colours[usize::from((x / 6 + y / 6) % 2 == 1)]);
            (wrong, truth, false)
        };
        let said = "no better than one flat colour: 2 of 2 (wrong poses, scale or axes?)";
        assert_eq!(noted(&[flat(0), flat(1)], false), said);
        assert_eq!(noted(&[flat(0), flat(1)], true), "", "empty renders have their own note");
        let good = (render(&truth(1, SIDES)), truth(1, SIDES), false);
        assert_eq!(noted(&[flat(0), good], false), "", "one target is better");
    }

    /// A render of one grey value on a scene of one: nothing distinguishes any change.
    #[test]
    fn symmetric_scenes_are_not_noted() {
        let plain = ImageU8::new(40, 30, [90, 90, 90].repeat(1200)).unwrap();
        let darker = Image::new(40, 30, vec![0.3; 3600]).unwrap();
        assert_eq!(noted(&[(darker, plain, false)], false), "");
        let wide = truth(0, (64, 40));
        assert_eq!(noted(&[(render(&wide), wide, false)], false), "", "an image that is not square");
    }
}
