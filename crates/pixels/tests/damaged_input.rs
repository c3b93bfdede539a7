//! Malicious and corrupt bytes give a value or a typed error, within the memory limits.
#![expect(clippy::unwrap_used, reason = "an invalid fixture fails the test")]

use std::path::{Path, PathBuf};

use atsplat_pixels::{
    DecodeLimits, Image, ImageFormat, ImageU8, PixelError, decode, decode_render, encode_jpeg, encode_png, exr, npy,
    size_of,
};
use image::codecs::{png::PngEncoder, webp::WebPEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use proptest::prelude::*;

fn crate_folder(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_file()).collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

/// Calls all functions that read bytes, and checks that their results are consistent and survive being written. Returns
/// whether the bytes are an image.
fn read_all_ways(bytes: &[u8], limits: &DecodeLimits) -> bool {
    let size = size_of(bytes).ok();
    let image = decode(bytes, limits).ok();
    if let Some(image) = &image {
        assert_eq!(Some((image.width(), image.height())), size, "decode and size_of agree");
        assert!(image.samples().len() as u64 <= limits.max_bytes, "within the limit");
        let again = encode_png(image).and_then(|png| decode(&png, limits));
        assert_eq!(again.ok().as_ref(), Some(image), "through PNG");
    }
    exr::read_rgb(bytes, limits).ok();
    let channels = exr::read(bytes, limits).ok();
    if let Some(channels) = &channels {
        assert_eq!(Some((channels.width(), channels.height())), size, "exr::read and size_of agree");
        check_rewritten(channels, limits);
    }
    image.is_some() || channels.is_some()
}

/// Checks that channels survive being written, unless their names are only read.
fn check_rewritten(channels: &exr::Channels, limits: &DecodeLimits) {
    let file = match exr::write(channels) {
        Err(PixelError::ChannelName { .. }) => return,
        outcome => outcome.unwrap(),
    };
    let again = exr::read(&file, limits).unwrap();
    assert_eq!(channels.channels().len(), again.channels().len());
    for (first, second) in channels.channels().iter().zip(again.channels()) {
        assert_eq!(first.name, second.name);
        assert!(first.samples.iter().zip(&second.samples).all(|(a, b)| a.to_bits() == b.to_bits()), "through EXR");
    }
}

const SMALL: DecodeLimits = DecodeLimits { max_width: 512, max_height: 512, max_bytes: 1 << 20 };

#[test]
fn the_fuzz_corpus_of_arrays_are_images_or_errors() {
    let inputs = files(&crate_folder("../../fuzz/corpus/npy_images"));
    let read = inputs.iter().filter_map(|(_, bytes)| npy::read(bytes, [2, 1, 3, 3]).ok());
    let sizes = |images: &[Image]| images.iter().map(|image| (image.width(), image.height())).collect::<Vec<_>>();
    let sizes: Vec<_> = read.map(|read| sizes(&read.images)).collect();
    assert!(sizes.len() >= 5 && sizes.len() + 6 <= inputs.len(), "{} of {} are images", sizes.len(), inputs.len());
    assert!(sizes.iter().all(|sizes| *sizes == [(3, 1); 2]), "{sizes:?}");
    let renders = inputs.iter().filter_map(|(_, bytes)| npy::read_render(bytes, &SMALL).ok());
    let renders: Vec<_> = renders.collect();
    let is_whole = |(image, stored): &(Image, Option<&[u8]>)| {
        let samples = image.samples().len();
        samples > 0 && stored.is_none_or(|stored| stored.len() == samples)
    };
    assert!(renders.len() >= 3 && renders.iter().all(is_whole), "{} are renders", renders.len());
}

#[test]
fn the_fuzz_corpora_are_images_or_errors() {
    for (folder, least) in [("pixels_decode", 12), ("pixels_exr", 6)] {
        let inputs = files(&crate_folder("../../fuzz/corpus").join(folder));
        let accepted = inputs.iter().filter(|(_, bytes)| read_all_ways(bytes, &SMALL)).count();
        assert!(accepted >= least && accepted < inputs.len(), "{folder}: {accepted} of {} are images", inputs.len());
    }
}

#[test]
fn files_truncated_before_their_last_pixel_are_errors() {
    for (path, bytes) in files(&crate_folder("tests/fixtures/images")) {
        // The trailing bytes hold no pixels: a PNG's IEND and checksum, a JPEG's end marker and padding, a RIFF's
        // padding, WebP's metadata.
        let spare = if path.extension().is_some_and(|extension| extension == "png") { 24 } else { 8 };
        let step = (bytes.len() / 97).max(1);
        for length in (0..bytes.len().saturating_sub(spare)).step_by(step) {
            let outcome = decode(&bytes[..length], &SMALL);
            assert!(outcome.is_err(), "{} truncated to {length} of {} bytes", path.display(), bytes.len());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn corrupt_files_do_not_panic(seed in any::<prop::sample::Index>(), hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let images = files(&crate_folder("tests/fixtures/images"));
        let (_, mut bytes) = seed.get(&images).clone();
        for (place, value) in hits {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        read_all_ways(&bytes, &SMALL);
    }

    #[test]
    fn noise_after_magic_bytes_does_not_panic(magic in prop::sample::select(&MAGICS[..]), noise in prop::collection::vec(any::<u8>(), 0..300)) {
        let bytes = [magic, &noise].concat();
        read_all_ways(&bytes, &SMALL);
    }

    #[test]
    fn lossless_formats_round_trip(image in small_image()) {
        for bytes in [encode_png(&image).unwrap(), webp(&image)] {
            prop_assert_eq!(size_of(&bytes).unwrap(), (image.width(), image.height()));
            prop_assert_eq!(&decode(&bytes, &DecodeLimits::default()).unwrap(), &image);
        }
    }

    #[test]
    fn exr_round_trips_bit_for_bit(width in 1..20u32, height in 1..20u32, seed in any::<u32>()) {
        let bits = |i: u32| f32::from_bits(i.wrapping_mul(2_654_435_761).wrapping_add(seed).rotate_left(7));
        let image = Image::new(width, height, (0..width * height * 3).map(bits).collect()).unwrap();
        let bytes = exr::write_rgb(&image, &exr::Values::DisplayReferred).unwrap();
        prop_assert_eq!(size_of(&bytes).unwrap(), (width, height));
        let (back, values) = exr::read_rgb(&bytes, &DecodeLimits::default()).unwrap();
        prop_assert_eq!(values, exr::Values::DisplayReferred);
        let as_bits = |image: &Image| image.samples().iter().map(|sample| sample.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(as_bits(&back), as_bits(&image), "including NaN payloads and infinities");
    }
}

const MAGICS: [&[u8]; 7] = [
    b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x10\0\0\0\x10\x08\x02\0\0\0",
    b"\xff\xd8\xff",
    b"\xff\xd8\xff\xc0\0\x11\x08\0\x10\0\x10\x03\x01\x22\0\x02\x11\0\x03\x11\0",
    b"RIFF\xff\0\0\0WEBPVP8 \xf0\0\0\0",
    b"RIFF\xff\0\0\0WEBPVP8L\xf0\0\0\0\x2f\x0f\xc0\x03\0",
    b"RIFF\xff\0\0\0WEBPVP8X\x0a\0\0\0",
    b"\x76\x2f\x31\x01\x02\0\0\0",
];

fn small_image() -> impl Strategy<Value = ImageU8> {
    (1..40u32, 1..40u32).prop_flat_map(|(width, height)| {
        prop::collection::vec(any::<u8>(), (width * height * 3) as usize)
            .prop_map(move |samples| ImageU8::new(width, height, samples).unwrap())
    })
}

fn webp(image: &ImageU8) -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = WebPEncoder::new_lossless(&mut file);
    encoder.write_image(image.samples(), image.width(), image.height(), ExtendedColorType::Rgb8).unwrap();
    file
}

#[test]
fn oversized_headers_are_errors_before_allocation() {
    let png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\xff\xff\0\0\xff\xff\x08\x02\0\0\0\0\0\0\0";
    let jpeg = b"\xff\xd8\xff\xc2\0\x11\x08\xff\xff\xff\xff\x03\x01\x22\0\x02\x11\0\x03\x11\0";
    let webp = b"RIFF\xff\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0\xff\xff\xff\xff\xff\xff";
    let unlimited = DecodeLimits { max_width: u32::MAX, max_height: u32::MAX, max_bytes: u64::MAX };
    for bytes in [&png[..], jpeg, webp] {
        let (width, height) = size_of(bytes).unwrap();
        assert!(width >= 65_535 && height >= 65_535, "{width}×{height}");
        let outcome = decode(bytes, &DecodeLimits::default());
        assert!(matches!(outcome, Err(PixelError::OverLimit { what: "width", .. })), "{outcome:?}");
    }
    for bytes in [&png[..], jpeg] {
        let outcome = decode(bytes, &unlimited);
        assert!(matches!(outcome, Err(PixelError::FileTooShort { .. })), "even without limits: {outcome:?}");
    }
}

#[test]
fn every_limit_is_checked() {
    let image = ImageU8::new(40, 30, vec![9; 40 * 30 * 3]).unwrap();
    let exact = DecodeLimits { max_width: 40, max_height: 30, max_bytes: 3600 };
    for bytes in [encode_png(&image).unwrap(), encode_jpeg(&image, 90).unwrap(), webp(&image)] {
        decode(&bytes, &exact).unwrap();
        for (limits, expected) in [
            (DecodeLimits { max_width: 39, ..exact }, "width"),
            (DecodeLimits { max_height: 29, ..exact }, "height"),
            (DecodeLimits { max_bytes: 3599, ..exact }, "decoded bytes"),
        ] {
            match decode(&bytes, &limits) {
                Err(PixelError::OverLimit { what, .. }) => assert_eq!(what, expected),
                outcome => panic!("{outcome:?}"),
            }
        }
    }
    let file = exr::write_rgb(&Image::from_u8(&image), &exr::Values::Linear).unwrap();
    exr::read(&file, &DecodeLimits { max_bytes: 14_400, ..exact }).unwrap();
    let outcome = exr::read(&file, &DecodeLimits { max_bytes: 14_399, ..exact });
    assert!(matches!(outcome, Err(PixelError::OverLimit { what: "decoded bytes", .. })), "{outcome:?}");
}

#[test]
fn errors_describe_other_content() {
    let limits = DecodeLimits::default();
    assert!(matches!(decode(b"", &limits), Err(PixelError::UnknownFormat { length: 0, .. })));
    let gif = decode(b"GIF89a__", &limits).unwrap_err().to_string();
    assert_eq!(gif, "expected a PNG, JPEG, WebP or EXR file, found 8 bytes that start with [47 49 46 38 39 61 5f 5f]");
    let image = Image::new(1, 1, vec![0.5; 3]).unwrap();
    let file = exr::write_rgb(&image, &exr::Values::Linear).unwrap();
    assert!(matches!(decode(&file, &limits), Err(PixelError::HoldsFloats)));
    assert_eq!(ImageFormat::sniff(&file), Some(ImageFormat::Exr));
}

/// Like 16-bit colours: 0x02bc becomes 2, where clipping would give 255.
#[test]
fn sixteen_bit_grey_keeps_its_high_byte() {
    let mut bytes = Vec::new();
    let grey: Vec<u8> = [700u16, 0x80ff, 0xffff, 0].iter().flat_map(|value| value.to_ne_bytes()).collect();
    PngEncoder::new(&mut bytes).write_image(&grey, 2, 2, ExtendedColorType::L16).unwrap();
    let image = decode(&bytes, &DecodeLimits::default()).unwrap();
    assert_eq!(image.samples(), [[2; 3], [0x80; 3], [0xff; 3], [0; 3]].as_flattened());
}

#[test]
fn transparent_pixels_of_renders_are_errors() {
    let limits = DecodeLimits::default();
    let png = |samples: &[u8], color| {
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes).write_image(samples, 3, 1, color).unwrap();
        bytes
    };
    let opaque = png(&[9, 9, 9, 255, 0, 0, 0, 255, 7, 7, 7, 255], ExtendedColorType::Rgba8);
    assert_eq!(decode_render(&opaque, &limits).unwrap(), decode(&opaque, &limits).unwrap());
    let grey = png(&[0, 1, 2], ExtendedColorType::L8);
    assert_eq!(decode_render(&grey, &limits).unwrap().samples(), [0, 0, 0, 1, 1, 1, 2, 2, 2], "no alpha at all");
    let deep: Vec<u8> = [5u16, 0xffff, 5, 0xfffe, 5, 0].iter().flat_map(|value| value.to_ne_bytes()).collect();
    for bytes in [
        png(&[9, 9, 9, 255, 0, 0, 0, 254, 7, 7, 7, 0], ExtendedColorType::Rgba8),
        png(&[255, 255, 0, 254, 0, 0], ExtendedColorType::La8),
        png(&deep, ExtendedColorType::La16),
    ] {
        decode(&bytes, &limits).unwrap();
        let outcome = decode_render(&bytes, &limits);
        assert!(matches!(outcome, Err(PixelError::Transparent { count: 2, column: 1, row: 0 })), "{outcome:?}");
    }
}

#[test]
fn renders_that_would_lose_bits_or_light_are_errors() {
    let read = |name: &str| std::fs::read(crate_folder("tests/fixtures/images").join(name)).unwrap();
    for (name, found) in [
        ("colour2_16.png", "16-bit samples"),
        ("gamma_is_ignored.png", "the exponent 1.000 in `gAMA`"),
        ("rgb.jpg", "a JPEG"),
        ("lossless.webp", "a WebP"),
    ] {
        let bytes = read(name);
        decode(&bytes, &DecodeLimits::default()).unwrap();
        let error = decode_render(&bytes, &DecodeLimits::default()).unwrap_err().to_string();
        assert!(error.contains(&format!("found {found}")), "{name}: {error}");
    }
    for name in ["colour2_8.png", "grey4.png", "palette2.png"] {
        let bytes = read(name);
        let stored = decode(&bytes, &DecodeLimits::default()).unwrap();
        assert_eq!(decode_render(&bytes, &DecodeLimits::default()).unwrap(), stored, "{name}");
    }
}

/// A JPEG of noise, so that zero bytes in place of its data are far more than the pixels need.
fn noisy_jpeg() -> Vec<u8> {
    let noise = |at: u32| {
        let mixed = at.wrapping_mul(2_654_435_761);
        u8::try_from((mixed ^ (mixed >> 15)).wrapping_mul(2_246_822_519) >> 24).unwrap()
    };
    let samples = (0..48 * 32 * 3).map(noise).collect();
    encode_jpeg(&ImageU8::new(48, 32, samples).unwrap(), 100).unwrap()
}

/// As interrupted copies leave them: libjpeg decodes the zeros as pixels, and ignores those that are left.
#[test]
fn jpegs_whose_end_is_zeroed_are_errors() {
    let whole = noisy_jpeg();
    decode(&whole, &SMALL).unwrap();
    for kept in [whole.len() / 2, whole.len() * 2 / 3, whole.len() - 1] {
        let mut zeroed = whole.clone();
        zeroed[kept..].fill(0);
        let message = decode(&zeroed, &SMALL).unwrap_err().to_string();
        assert!(message.contains("expected the marker of the image's end (ff d9)"), "{kept}: {message}");
    }
    let mut with_end = whole.clone();
    let end = whole.len() - 2;
    with_end[whole.len() * 2 / 3..end].fill(0);
    let message = decode(&with_end, &SMALL).unwrap_err().to_string();
    assert!(message.contains("found 8 or more bytes 0x00 behind the last pixel"), "{message}");
}

/// Bytes behind the end, fill bytes before it, a comment and an unknown marker are harmless; so are zeros that pixels need.
#[test]
fn jpegs_with_more_than_pixels_are_images_and_stray_bytes_are_errors() {
    let whole = noisy_jpeg();
    let image = decode(&whole, &SMALL).unwrap();
    let tables = whole.windows(2).position(|pair| pair == [0xff, 0xc4]).unwrap();
    let with = |at: usize, more: &[u8]| [&whole[..at], more, &whole[at..]].concat();
    for fine in [
        with(whole.len(), &[0; 64]),
        with(whole.len() - 2, &[0xff; 31]),
        with(2, &[0xff, 0xfe, 0, 4, b'h', b'i']),
        with(tables, &[0xff, 0xf1, 0, 5, 1, 2, 3]),
    ] {
        assert_eq!(decode(&fine, &SMALL).unwrap(), image);
    }
    let message = decode(&with(tables, &[7; 5]), &SMALL).unwrap_err().to_string();
    assert!(message.contains("5 extraneous bytes"), "{message}");
    let flat = vec![90u8; 128 * 96 * 3];
    let encoder = libjpeg_turbo_rs::Encoder::new(&flat, 128, 96, libjpeg_turbo_rs::PixelFormat::Rgb);
    let optimised = encoder.optimize_huffman(true).encode().unwrap();
    let zeros = optimised.iter().rev().skip(3).take_while(|byte| **byte == 0).count();
    assert!(zeros > 8, "{zeros} zeros before the last bits");
    decode(&optimised, &SMALL).unwrap();
}

#[test]
fn a_git_lfs_pointer_error_names_the_remedy() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    for error in [decode(pointer, &DecodeLimits::default()).unwrap_err(), size_of(pointer).unwrap_err()] {
        assert!(matches!(error, PixelError::LfsPointer) && error.to_string().contains("git lfs pull"), "{error}");
    }
}
