//! The meaning of an EXR's values, and files of other programs.
#![expect(clippy::unwrap_used, reason = "an invalid fixture fails the test")]

use atsplat_pixels::exr::{Channel, Channels, Values, read, read_render, read_rgb, write, write_rgb};
use atsplat_pixels::{DecodeLimits, Image, PixelError};
use exr::compression::Compression;
use exr::image::write::WritableImage as _;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image as ExrImage, Layer};
use exr::math::Vec2;
use exr::meta::header::LayerAttributes;
use exr::prelude::f16;

fn plane(name: &str, values: Values, samples: &[f32]) -> Channel {
    Channel { name: name.to_owned(), values, samples: samples.to_vec() }
}

#[test]
fn named_planes_round_trip_with_their_meaning() {
    let planes = vec![
        plane("Z", Values::Depth, &[1.0, f32::INFINITY, 2.5, 1e-30]),
        plane("R", Values::Linear, &[0.0, 0.25, 0.5, 7.0]),
        plane("uncertainty", Values::Named("standard deviation of depth".to_owned()), &[0.1, 0.2, 0.3, f32::NAN]),
        plane("mask", Values::Unstated, &[0.0, 1.0, 1.0, 0.0]),
    ];
    let bytes = write(&Channels::new(2, 2, planes.clone()).unwrap()).unwrap();
    let back = read(&bytes, &DecodeLimits::default()).unwrap();
    assert_eq!((back.width(), back.height()), (2, 2));
    assert_eq!(back.channels().iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["R", "Z", "mask", "uncertainty"]);
    for expected in planes {
        let found = back.get(&expected.name).unwrap();
        assert_eq!(found.values, expected.values, "{}", expected.name);
        let bits = |channel: &Channel| channel.samples.iter().map(|sample| sample.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(found), bits(&expected), "{}", expected.name);
    }
}

#[test]
fn the_header_states_the_meaning_as_text() {
    let image = Image::new(1, 1, vec![0.1, 0.2, 0.3]).unwrap();
    let bytes = write_rgb(&image, &Values::DisplayReferred).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("B G R: sRGB-encoded display-referred"), "{text}");
}

#[test]
fn the_same_image_gives_the_same_bytes() {
    let image = Image::new(50, 40, (0..6000u16).map(|i| f32::from(i) / 6000.0).collect()).unwrap();
    let first = write_rgb(&image, &Values::Linear).unwrap();
    for _ in 0..5 {
        assert_eq!(write_rgb(&image, &Values::Linear).unwrap(), first);
    }
}

#[test]
fn a_line_break_cannot_inject_another_channels_meaning() {
    let forged = Values::Named("noise\nR: linear".to_owned());
    let planes = vec![plane("A", forged, &[1.0]), plane("R", Values::Unstated, &[1.0])];
    let bytes = write(&Channels::new(1, 1, planes).unwrap()).unwrap();
    let back = read(&bytes, &DecodeLimits::default()).unwrap();
    assert_eq!(back.get("R").unwrap().values, Values::Unstated);
}

#[test]
fn rgb_requires_three_channels_of_one_kind() {
    let only_depth = write(&Channels::new(1, 1, vec![plane("Z", Values::Depth, &[1.0])]).unwrap()).unwrap();
    let outcome = read_rgb(&only_depth, &DecodeLimits::default());
    assert!(
        matches!(&outcome, Err(PixelError::MissingChannel { expected, found }) if expected == "R" && found == &["Z"])
    );
    let planes =
        ["R", "G", "B"].map(|name| plane(name, if name == "G" { Values::Depth } else { Values::Linear }, &[1.0]));
    let mixed = write(&Channels::new(1, 1, planes.to_vec()).unwrap()).unwrap();
    assert!(matches!(read_rgb(&mixed, &DecodeLimits::default()), Err(PixelError::Header { .. })));
}

#[test]
fn planes_are_checked_before_writing() {
    let named = |name: &str, samples: &[f32]| Channels::new(2, 1, vec![plane(name, Values::Depth, samples)]);
    for name in ["", "with space", "colon:", "täst", "abcdefghijklmnopqrstuvwxyzabcdef"] {
        let outcome = write(&named(name, &[0.0; 2]).unwrap());
        assert!(matches!(outcome, Err(PixelError::ChannelName { .. })), "{name:?}");
    }
    assert!(matches!(named("Z", &[0.0; 3]), Err(PixelError::ChannelSize { expected: 2, found: 3, .. })));
    let repeated = Channels::new(1, 1, vec![plane("Z", Values::Depth, &[0.0]), plane("Z", Values::Linear, &[0.0])]);
    assert!(matches!(repeated, Err(PixelError::ChannelName { problem: "it is repeated", .. })));
    assert!(matches!(Channels::new(0, 1, vec![]), Err(PixelError::Empty { .. })));
}

/// As Blender names the passes of a render: with spaces, and longer than what is written here.
#[test]
fn reads_channels_with_names_of_other_programs() {
    let names = ["View Layer.Noisy Image of all the lights", "View Layer.Depth.Z"];
    let planes = names.map(|name| AnyChannel::new(name, FlatSamples::F32(vec![0.5, 2.0])));
    let channels = AnyChannels::sort(planes.into_iter().collect());
    let layer = Layer::new((2, 1), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    let mut file = std::io::Cursor::new(Vec::new());
    ExrImage::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
    let channels = read(&file.into_inner(), &DecodeLimits::default()).unwrap();
    for name in names {
        let found = channels.get(name).unwrap();
        assert_eq!((&found.values, &found.samples), (&Values::Unstated, &vec![0.5, 2.0]), "{name}");
    }
    assert!(matches!(write(&channels), Err(PixelError::ChannelName { .. })));
}

/// Written by the reference library: `fixtures/make_exr.py`.
#[test]
fn reads_files_of_another_program() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/exr");
    let file = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let ramp: Vec<f32> = (0..60u8).map(|i| f32::from(i) * 0.25 - 3.0).collect();
    for kind in ["f32", "f16"] {
        for compression in ["none", "zip", "piz", "rle"] {
            let name = format!("rgb_{kind}_{compression}.exr");
            let (image, values) = read_rgb(&file(&name), &DecodeLimits::default()).unwrap();
            assert_eq!((image.width(), image.height(), values), (5, 4, Values::Unstated), "{name}");
            assert_eq!(image.samples(), ramp, "{name}: quarters are exact in f16");
        }
    }
    let integers = read(&file("integers.exr"), &DecodeLimits::default());
    assert!(matches!(integers, Err(PixelError::Unsupported { .. })), "{integers:?}");
    let (whole, _) = read_render(&file("rgb_f16_zip.exr"), &DecodeLimits::default()).unwrap();
    assert_eq!(whole.samples(), ramp, "a render");
    for (name, found) in
        [("shifted.exr", "5×4 at column 2, row 1 of an image of 5×4 at column 0, row 0: "), ("two_parts.exr", "2: ")]
    {
        let (first, _) = read_rgb(&file(name), &DecodeLimits::default()).unwrap();
        assert_eq!(first.samples(), ramp, "{name}");
        let error = read_render(&file(name), &DecodeLimits::default()).unwrap_err().to_string();
        assert!(error.contains(&format!(", found {found}")), "{name}: {error}");
    }
}

/// A square of 4 samples in f16, which B44 packs into 14 bytes.
#[test]
fn a_render_that_may_have_lost_digits_is_rejected() {
    let file = |compression: Compression| {
        let samples: Vec<f16> = (0..16_u8).map(|at| f16::from_f32(f32::from(at * at) / 256.0)).collect();
        let planes = ["B", "G", "R"].map(|name| AnyChannel::new(name, FlatSamples::F16(samples.clone())));
        let encoding = Encoding { compression, ..Encoding::SMALL_LOSSLESS };
        let channels = AnyChannels::sort(planes.into_iter().collect());
        let layer = Layer::new((4, 4), LayerAttributes::default(), encoding, channels);
        let mut file = std::io::Cursor::new(Vec::new());
        ExrImage::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
        file.into_inner()
    };
    for compression in [Compression::Uncompressed, Compression::ZIP16, Compression::PIZ] {
        assert!(read_render(&file(compression), &DecodeLimits::default()).is_ok(), "{compression}");
    }
    for compression in [Compression::B44, Compression::B44A, Compression::PXR24] {
        let bytes = file(compression);
        assert!(read_rgb(&bytes, &DecodeLimits::default()).is_ok(), "{compression}: but it is no render");
        let error = read_render(&bytes, &DecodeLimits::default()).unwrap_err().to_string();
        let expected = format!("expected lossless compression, found {compression}: ");
        assert!(error.starts_with(&expected), "{error}");
    }
}

/// Where the table of `count` blocks begins, each of whose entries is an offset in the file: the first block follows it.
fn table_of_blocks(bytes: &[u8], count: usize) -> usize {
    let entry = |at: usize| bytes[at..].first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
    (0..bytes.len()).find(|at| entry(*at) == Some((at + 8 * count) as u64)).unwrap()
}

fn block(bytes: &[u8], table: usize, at: usize) -> usize {
    let offset = u64::from_le_bytes(*bytes[table + 8 * at..].first_chunk().unwrap());
    usize::try_from(offset).unwrap()
}

/// Without compression, each row is a block.
#[test]
fn a_file_that_lacks_a_block_is_rejected() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/exr/rgb_f32_none.exr");
    let good = std::fs::read(path).unwrap();
    let table = table_of_blocks(&good, 4);
    let error = |change: &dyn Fn(&mut [u8])| {
        let mut bytes = good.clone();
        change(&mut bytes);
        read(&bytes, &DecodeLimits::default()).map(|_| ()).map_err(|error| error.to_string())
    };
    assert_eq!(error(&|_| ()), Ok(()));
    let lost = "EXR data: expected a block that starts at row 1, column 0, found another that states row 2, column 0";
    assert_eq!(error(&|bytes| bytes.copy_within(table + 16..table + 24, table + 8)), Err(lost.to_owned()));
    let row_1 = block(&good, table, 1);
    assert_eq!(error(&|bytes| bytes[row_1] = 2), Err(lost.to_owned()), "the row that the block states");
    assert!(error(&|bytes| bytes[row_1] = 9).is_err(), "below the image");
    let exchanged = |bytes: &mut [u8]| (0..8).for_each(|at| bytes.swap(table + at, table + 8 + at));
    assert_eq!(error(&exchanged), Ok(()), "blocks may be in any order");
}

#[test]
fn a_file_that_lacks_a_tile_is_rejected() {
    let samples: Vec<f32> = (0..8_u8).map(f32::from).collect();
    let planes = ["B", "G", "R"].map(|name| AnyChannel::new(name, FlatSamples::F32(samples.clone())));
    let tiles = Blocks::Tiles(Vec2(2, 1));
    let encoding = Encoding { compression: Compression::Uncompressed, blocks: tiles, ..Encoding::SMALL_LOSSLESS };
    let channels = AnyChannels::sort(planes.into_iter().collect());
    let layer = Layer::new((4, 2), LayerAttributes::default(), encoding, channels);
    let mut file = std::io::Cursor::new(Vec::new());
    ExrImage::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
    let mut bytes = file.into_inner();
    assert_eq!(read(&bytes, &DecodeLimits::default()).unwrap().get("G").unwrap().samples, samples);
    let table = table_of_blocks(&bytes, 4);
    // The third is the left one of the second row, and states its column first.
    let third = block(&bytes, table, 2);
    bytes[third] = 1;
    let error = read(&bytes, &DecodeLimits::default()).unwrap_err().to_string();
    let lost = "EXR data: expected a block that starts at row 1, column 0, found another that states row 1, column 2";
    assert_eq!(error, lost);
}

/// A file of a few hundred bytes whose header announces 67 million tiles, which took gigabytes.
#[test]
fn announced_tiles_that_are_not_there_take_no_memory() {
    let planes = [AnyChannel::new("G", FlatSamples::F32(vec![0.5]))];
    let tiles = Blocks::Tiles(Vec2(1, 1));
    let encoding = Encoding { compression: Compression::Uncompressed, blocks: tiles, ..Encoding::SMALL_LOSSLESS };
    let channels = AnyChannels::sort(planes.into_iter().collect());
    let layer = Layer::new((1, 1), LayerAttributes::default(), encoding, channels);
    let mut file = std::io::Cursor::new(Vec::new());
    ExrImage::from_layer(layer).write().non_parallel().to_buffered(&mut file).unwrap();
    let mut bytes = file.into_inner();
    assert!(read(&bytes, &DecodeLimits::default()).is_ok());
    let name = b"dataWindow\0box2i\0";
    let window = bytes.windows(name.len()).position(|found| found == name).unwrap() + name.len() + 4;
    // The last column and row follow the first ones.
    bytes[window + 8..window + 12].copy_from_slice(&8191_i32.to_le_bytes());
    bytes[window + 12..window + 16].copy_from_slice(&8191_i32.to_le_bytes());
    let begin = std::time::Instant::now();
    let limits = DecodeLimits { max_bytes: 1 << 30, ..DecodeLimits::default() };
    let error = read(&bytes, &limits).unwrap_err();
    assert!(matches!(error, PixelError::Decode { .. }), "{error}");
    assert!(begin.elapsed().as_secs() < 5, "millions of entries were made before the table was read");
}
