//! Imported images that were written wrongly are scored, and their trial says so.

use std::sync::Arc;

use crate::common::{Run, SIZE, Walls, dataset, entry};
use atsplat_eval::method::{Method, Renders, Warp};
use atsplat_eval::runner::KeepImages;
use atsplat_eval::suspicious_notes::SuspiciousNote;
use atsplat_pixels::{DecodeLimits, ImageU8, decode_render, encode_png};

const FRAMES: [usize; 3] = [1, 2, 3];

fn run_of(method: Arc<dyn Method>) -> Run {
    Run::new(vec![dataset(Walls::new(1, 8), &[entry(&[0, 4], &FRAMES)])], vec![method])
}

/// An image whose pixels come from these places, after a change of their colours.
fn changed(image: &ImageU8, from: fn(u32, u32) -> (u32, u32), colour: fn([u8; 3]) -> [u8; 3]) -> ImageU8 {
    let pixels = (0..SIZE.width * SIZE.height).flat_map(|at| {
        let (column, row) = from(at % SIZE.width, at / SIZE.width);
        colour(image.pixel(column, row).unwrap())
    });
    ImageU8::new(SIZE.width, SIZE.height, pixels.collect()).unwrap()
}

#[test]
fn images_with_other_channels_sides_or_order_are_noted() {
    let root = tempfile::tempdir().unwrap();
    let keeping = Run { images: KeepImages::All, ..run_of(Arc::new(Warp)) };
    let (results, _) = keeping.run(&root.path().join("warp")).unwrap();
    assert_eq!(results.trials[0].notes, [""; 0]);
    let kept = root.path().join("warp/images/walls/warp/wall-0-0");
    let images = FRAMES.map(|frame| {
        let bytes = std::fs::read(kept.join(format!("{frame:06}.png"))).unwrap();
        decode_render(&bytes, &DecodeLimits::default()).unwrap()
    });
    let scored = |name: &str, images: [ImageU8; 3]| {
        let folder = root.path().join(name);
        std::fs::create_dir_all(folder.join("wall-0")).unwrap();
        for (frame, image) in FRAMES.iter().zip(&images) {
            std::fs::write(folder.join(format!("wall-0/{frame:06}.png")), encode_png(image).unwrap()).unwrap();
        }
        let run = run_of(Arc::new(Renders::new(&folder, None).unwrap()));
        run.run(&root.path().join(format!("{name}-scored"))).unwrap().0.trials[0].notes.clone()
    };
    let said = |text: &str| [format!("renders would be closer to the truth {text}: 3 of 3")];
    assert!(SuspiciousNote::WrittenWrongly.is(&said("")[0]));
    assert_eq!(scored("same", images.clone()), [""; 0]);
    let swapped = images.each_ref().map(|image| changed(image, |x, y| (x, y), |[r, g, b]| [b, g, r]));
    assert_eq!(scored("swapped", swapped), said("with red and blue exchanged"));
    let flipped = images.each_ref().map(|image| changed(image, |x, y| (SIZE.width - 1 - x, y), |colour| colour));
    assert_eq!(scored("flipped", flipped), said("mirrored left to right"));
    let [first, second, third] = images;
    let others = "of other targets, as if they were in another order";
    assert_eq!(scored("permuted", [second.clone(), third, first.clone()]), said(others));
    let [repeated] = scored("repeated", [first.clone(), first.clone(), first]).try_into().unwrap();
    assert!(SuspiciousNote::Repeated.is(&repeated), "{repeated}");
}
