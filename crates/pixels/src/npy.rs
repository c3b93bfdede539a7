//! NumPy's `.npy` files of images, as `numpy.lib.format` describes them.

use ::exr::prelude::f16;
use atsplat_numeric::narrowed;

use crate::{DecodeLimits, Image, ImageU8, PixelError};

/// What every file begins with, before the two bytes of its version.
const MAGIC: &[u8] = b"\x93NUMPY";
/// The header ends at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// The images of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyImages<'a> {
    /// In the order of the array's first axis.
    pub images: Vec<Image>,
    /// All samples as they are stored, if the array is of bytes.
    pub bytes: Option<&'a [u8]>,
}

/// An 8-bit image as a file: an array of `|u1`, H×W×3.
pub fn write(image: &ImageU8) -> Vec<u8> {
    let shape = format!("({}, {}, 3)", image.height(), image.width());
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}");
    // Magic, version and length take ten bytes, the line's end one.
    let padding = (ALIGNMENT - (10 + header.len() + 1) % ALIGNMENT) % ALIGNMENT;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    #[expect(clippy::expect_used, reason = "two sizes have at most twenty digits")]
    let length = u16::try_from(header.len()).expect("a header far below the 65535 bytes of version 1");
    bytes.extend(length.to_le_bytes());
    bytes.extend(header.into_bytes());
    bytes.extend(image.samples());
    bytes
}

/// The images of a file with this shape, T×H×W×3: floats of 16, 32 or 64 bits, or bytes (`|u1`), of which 255 is 1. Both byte orders
/// and both orders of axes (C and Fortran) are read. Floats have any values.
///
/// # Errors
/// [`PixelError::Npy`].
pub fn read(bytes: &[u8], shape: [usize; 4]) -> Result<NpyImages<'_>, PixelError> {
    let array = Array::of(bytes)?;
    let (&[images, rows, columns, channels], true) = (&array.axes[..], array.shape() == shape) else {
        return Err(invalid(format!("the shape {}", text(&shape)), text(&array.shape())));
    };
    let samples = array.samples();
    let images = images.positions(0).map(|start| array.image(&samples, start, [rows, columns, channels]));
    Ok(NpyImages { images: images.collect::<Result<_, _>>()?, bytes: array.bytes() })
}

/// The only image of a file, of the samples that [`read`] reads: H×W×3 or 3×H×W, also with an axis of length 1 before these. Its samples
/// are returned as they are stored too, if they are bytes.
///
/// # Errors
/// [`PixelError::Npy`], also for shapes that fit both orders of axes, 3×N×3, and for images beyond the limits, before their samples are
/// decoded.
pub fn read_render<'a>(bytes: &'a [u8], limits: &DecodeLimits) -> Result<(Image, Option<&'a [u8]>), PixelError> {
    let array = Array::of(bytes)?;
    let axes = match &array.axes[..] {
        [one, axes @ ..] if one.length == 1 && axes.len() == 3 => axes,
        axes => axes,
    };
    let axes = match *axes {
        [a, _, c] if a.length == 3 && c.length == 3 => {
            return Err(invalid("a shape of which one end is 3, for the channels", text(&array.shape())));
        }
        [rows, columns, channels] if channels.length == 3 => [rows, columns, channels],
        [channels, rows, columns] if channels.length == 3 => [rows, columns, channels],
        _ => return Err(invalid("the shape (height, width, 3) or (3, height, width)", text(&array.shape()))),
    };
    let bytes_per_sample = array.bytes_each.max(size_of::<f32>()) as u64;
    if let Some((what, limit, found)) = limits.exceeded(array.size(axes)?, 3 * bytes_per_sample) {
        return Err(invalid(format!("{what} of at most {limit}"), format!("{found} in {}", text(&array.shape()))));
    }
    Ok((array.image(&array.samples(), 0, axes)?, array.bytes()))
}

/// The samples of a file as it has them, and how its axes lead through them.
struct Array<'a> {
    axes: Vec<Axis>,
    /// As many bytes as the axes and the type of the samples need.
    data: &'a [u8],
    bytes_each: usize,
    decoder: Decoder,
}

#[derive(Clone, Copy)]
struct Axis {
    length: usize,
    /// Samples from one element to the next.
    step: usize,
}

impl Axis {
    /// Where its elements begin.
    fn positions(self, start: usize) -> impl Iterator<Item = usize> {
        (0..self.length).map(move |at| start + at * self.step)
    }
}

impl<'a> Array<'a> {
    fn of(bytes: &'a [u8]) -> Result<Self, PixelError> {
        let (header, data) = split(bytes)?;
        let field = |name: &str| {
            let missing = || invalid(format!("{name} in the header"), format!("{header:?}"));
            field(header, name).ok_or_else(missing)
        };
        let first_axis_is_fastest = match field("fortran_order")? {
            "False" => false,
            "True" => true,
            other => return Err(invalid("True or False for fortran_order in the header", other)),
        };
        let shape = parsed_shape(field("shape")?);
        let shape = shape.ok_or_else(|| invalid("a shape in the header", format!("{header:?}")))?;
        let descr = field("descr")?;
        let (bytes_each, decoder) = decoder(descr.trim_matches(['\'', '"']))
            .ok_or_else(|| invalid("samples of type float16, float32, float64 or uint8", descr))?;
        let length = shape.iter().try_fold(bytes_each, |length, side| length.checked_mul(*side));
        match length {
            // Then no product of sides is 0 or too large.
            Some(length @ 1..) if length == data.len() => {}
            Some(length @ 1..) => return Err(invalid(format!("{length} bytes of data"), data.len().to_string())),
            _ => return Err(invalid("a shape of samples that fit into memory", text(&shape))),
        }
        Ok(Self { axes: axes(&shape, first_axis_is_fastest), data, bytes_each, decoder })
    }

    /// Decoded, in the order in which the file has them.
    fn samples(&self) -> Vec<f32> {
        (self.decoder)(self.data)
    }

    /// The samples as they are stored, if they are bytes.
    fn bytes(&self) -> Option<&'a [u8]> {
        (self.bytes_each == 1).then_some(self.data)
    }

    fn shape(&self) -> Vec<usize> {
        self.axes.iter().map(|axis| axis.length).collect()
    }

    /// Columns and rows of an image.
    fn size(&self, [rows, columns, _]: [Axis; 3]) -> Result<(u32, u32), PixelError> {
        let too_many = || invalid(format!("at most {} rows and columns", u32::MAX), text(&self.shape()));
        let [width, height] = [columns, rows].map(|axis| u32::try_from(axis.length).ok().ok_or_else(too_many));
        Ok((width?, height?))
    }

    /// The image that begins at a sample of all, by its rows, columns and channels.
    fn image(&self, samples: &[f32], start: usize, axes: [Axis; 3]) -> Result<Image, PixelError> {
        let (width, height) = self.size(axes)?;
        let [rows, columns, channels] = axes;
        let is_row_by_row =
            channels.step == 1 && columns.step == channels.length && rows.step == columns.length * columns.step;
        let samples: Option<Vec<f32>> = if is_row_by_row {
            samples.get(start..start + rows.length * rows.step).map(<[f32]>::to_vec)
        } else {
            let pixels = rows.positions(start).flat_map(|row| columns.positions(row));
            let places = pixels.flat_map(|pixel| channels.positions(pixel));
            places.map(|at| samples.get(at).copied()).collect()
        };
        #[expect(clippy::expect_used, reason = "the file has as many samples as its axes lead to")]
        let samples = samples.expect("a sample at each place of the axes");
        Image::new(width, height, samples)
    }
}

fn axes(shape: &[usize], first_is_fastest: bool) -> Vec<Axis> {
    let mut step = 1;
    let axis = |length: &usize| {
        let axis = Axis { length: *length, step };
        step *= length;
        axis
    };
    if first_is_fastest {
        return shape.iter().map(axis).collect();
    }
    let mut axes: Vec<Axis> = shape.iter().rev().map(axis).collect();
    axes.reverse();
    axes
}

/// Samples from their bytes.
type Decoder = fn(&[u8]) -> Vec<f32>;

/// How samples of a type are decoded, and how many bytes each has; `None` for a type that is not read.
fn decoder(descr: &str) -> Option<(usize, Decoder)> {
    Some(match descr {
        "|u1" => (1, |data| data.iter().map(|byte| f32::from(*byte) / 255.0).collect()),
        "<f2" => (2, |data| data.as_chunks().0.iter().map(|value| f16::from_le_bytes(*value).to_f32()).collect()),
        ">f2" => (2, |data| data.as_chunks().0.iter().map(|value| f16::from_be_bytes(*value).to_f32()).collect()),
        "<f4" => (4, |data| data.as_chunks().0.iter().map(|value| f32::from_le_bytes(*value)).collect()),
        ">f4" => (4, |data| data.as_chunks().0.iter().map(|value| f32::from_be_bytes(*value)).collect()),
        "<f8" => (8, |data| data.as_chunks().0.iter().map(|value| narrowed(f64::from_le_bytes(*value))).collect()),
        ">f8" => (8, |data| data.as_chunks().0.iter().map(|value| narrowed(f64::from_be_bytes(*value))).collect()),
        _ => return None,
    })
}

fn invalid(expected: impl Into<String>, found: impl Into<String>) -> PixelError {
    PixelError::Npy { expected: expected.into(), found: found.into() }
}

/// Header and data.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), PixelError> {
    let other = || invalid("a .npy file", "other bytes");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(other)?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(other)?;
    let bytes_of_length = match version {
        [1, 0] => 2,
        [2 | 3, 0] => 4,
        [major, minor] => return Err(invalid("a .npy file of version 1.0 to 3.0", format!("{major}.{minor}"))),
    };
    let (length, rest) = rest.split_at_checked(bytes_of_length).ok_or_else(other)?;
    let length = length.iter().rev().fold(0, |length, byte| length << 8 | usize::from(*byte));
    let (header, data) = rest.split_at_checked(length).ok_or_else(other)?;
    Ok((std::str::from_utf8(header).ok().ok_or_else(other)?, data))
}

/// The value of a field of the header, a Python dictionary.
fn field<'a>(header: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = header.split_once(&format!("'{name}':"))?;
    let rest = rest.trim_start();
    // A tuple ends with its parenthesis, anything else with a comma.
    let end = if rest.starts_with('(') { rest.find(')')? + 1 } else { rest.find([',', '}'])? };
    rest.get(..end).map(str::trim)
}

fn parsed_shape(tuple: &str) -> Option<Vec<usize>> {
    let inside = tuple.strip_prefix('(')?.strip_suffix(')')?;
    inside.split(',').map(str::trim).filter(|side| !side.is_empty()).map(|side| side.parse().ok()).collect()
}

/// A shape as Python writes it.
fn text(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    format!("({})", sides.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let length = u16::try_from(header.len()).unwrap().to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    fn samples(bytes: &[u8], shape: [usize; 4]) -> Result<Vec<f32>, String> {
        let read = read(bytes, shape).map_err(|error| error.to_string())?;
        Ok(read.images.iter().flat_map(|image| image.samples().to_vec()).collect())
    }

    /// The first bytes are those of `numpy.save` (NumPy 2.3) for `numpy.arange(12, dtype="u1").reshape(1, 4, 3)`.
    #[test]
    fn writes_what_numpy_writes() {
        let image = ImageU8::new(4, 1, (0..12).collect()).unwrap();
        let bytes = write(&image);
        let header = b"\x93NUMPY\x01\x00v\x00{'descr': '|u1', 'fortran_order': False, 'shape': (1, 4, 3), }";
        assert!(bytes.starts_with(header), "{:?}", String::from_utf8_lossy(&bytes));
        assert_eq!((bytes.len(), bytes[127], &bytes[128..]), (140, b'\n', &(0..12).collect::<Vec<u8>>()[..]));
    }

    #[test]
    fn reads_floats_and_bytes_row_by_row() {
        // Two images of one row and two columns.
        let values: Vec<f32> = (0..12u8).map(|at| f32::from(at) / 16.0).collect();
        let single: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let double: Vec<u8> = values.iter().flat_map(|value| f64::from(*value).to_le_bytes()).collect();
        for bytes in [file("<f4", "False", "(2, 1, 2, 3)", &single), file("<f8", "False", "(2, 1, 2, 3)", &double)] {
            let NpyImages { images, bytes } = read(&bytes, [2, 1, 2, 3]).unwrap();
            assert_eq!(images.iter().map(|image| (image.width(), image.height())).collect::<Vec<_>>(), [(2, 1); 2]);
            assert_eq!((images[0].samples(), images[1].samples()), (&values[..6], &values[6..]));
            assert_eq!(bytes, None);
        }
        let levels = file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]);
        let NpyImages { images, bytes } = read(&levels, [1, 1, 1, 3]).unwrap();
        assert_eq!((images[0].samples(), bytes), (&[0.0, 0.2, 1.0][..], Some(&[0, 51, 255][..])));
        let image = ImageU8::new(2, 1, vec![9; 6]).unwrap();
        assert!(samples(&write(&image), [1, 1, 2, 3]).unwrap_err().contains("found (1, 2, 3)"));
    }

    /// Row, column and channel of a sample of the file.
    type Place = fn(u16) -> [u16; 3];
    /// A sample as the file has it.
    type Encode = fn(f32) -> Vec<u8>;

    /// The positions of samples are stated once more here, by division.
    #[test]
    fn either_order_of_axes_and_of_bytes_is_read() {
        // Of two images of one row and two columns, in Fortran order: the number of the image changes first.
        let data: Vec<u8> =
            (0..12u16).flat_map(|at| f32::from(6 * (at % 2) + 3 * (at / 2 % 2) + at / 4).to_be_bytes()).collect();
        let expected: Vec<f32> = (0..12u8).map(f32::from).collect();
        assert_eq!(samples(&file(">f4", "True", "(2, 1, 2, 3)", &data), [2, 1, 2, 3]), Ok(expected));
        // Of one image of two rows and four columns.
        let expected: Vec<f32> = (0..24u8).map(|at| f32::from(at) / 32.0).collect();
        let layouts: [(&str, &str, Place); 4] = [
            ("False", "2, 4, 3", |at| [at / 12, at / 3 % 4, at % 3]),
            ("True", "2, 4, 3", |at| [at % 2, at / 2 % 4, at / 8]),
            ("False", "3, 2, 4", |at| [at / 4 % 2, at % 4, at / 8]),
            ("True", "3, 2, 4", |at| [at / 3 % 2, at / 6, at % 3]),
        ];
        let types: [(&str, Encode); 6] = [
            ("<f2", |sample| f16::from_f32(sample).to_le_bytes().to_vec()),
            (">f2", |sample| f16::from_f32(sample).to_be_bytes().to_vec()),
            ("<f4", |sample| sample.to_le_bytes().to_vec()),
            (">f4", |sample| sample.to_be_bytes().to_vec()),
            ("<f8", |sample| f64::from(sample).to_le_bytes().to_vec()),
            (">f8", |sample| f64::from(sample).to_be_bytes().to_vec()),
        ];
        for (order, sides, place) in layouts {
            for (descr, encode) in types {
                let sample = |at| {
                    let [row, column, channel] = place(at);
                    encode(f32::from(12 * row + 3 * column + channel) / 32.0)
                };
                let data: Vec<u8> = (0..24).flat_map(sample).collect();
                for shape in [format!("({sides})"), format!("(1, {sides})")] {
                    let bytes = file(descr, order, &shape, &data);
                    let (image, stored) = read_render(&bytes, &DecodeLimits::default()).unwrap();
                    assert_eq!((image.width(), image.height(), stored), (4, 2, None), "{descr} {order} {shape}");
                    assert_eq!(image.samples(), expected, "{descr} {order} {shape}");
                }
            }
        }
        let levels: Vec<u8> = (0..24).collect();
        let bytes = file("|u1", "False", "(3, 4, 2)", &levels);
        let (image, stored) = read_render(&bytes, &DecodeLimits::default()).unwrap();
        assert_eq!((image.width(), image.height(), stored), (2, 4, Some(&levels[..])));
        assert_eq!(image.pixel(1, 0), Some([1, 9, 17].map(|level: u8| f32::from(level) / 255.0)));
    }

    #[test]
    fn arrays_of_no_single_image_are_rejected() {
        let refused = |descr: &str, shape: &str, length: usize| {
            let file = file(descr, "False", shape, &vec![0; length]);
            read_render(&file, &DecodeLimits::default()).unwrap_err().to_string()
        };
        let orders = "expected the shape (height, width, 3) or (3, height, width), found ";
        for (shape, length) in [("(2, 4)", 8), ("(2, 4, 4)", 32), ("(2, 4, 1)", 8), ("(2, 2, 4, 3)", 48), ("()", 1)] {
            assert_eq!(refused("|u1", shape, length), format!("{orders}{shape}"));
        }
        let either = refused("|u1", "(3, 4, 3)", 36);
        assert_eq!(either, "expected a shape of which one end is 3, for the channels, found (3, 4, 3)");
        for descr in ["|b1", "|i1", "<u2", "<i8", "<f16", "<c8", "|O"] {
            let why = format!("expected samples of type float16, float32, float64 or uint8, found '{descr}'");
            assert_eq!(refused(descr, "(2, 4, 3)", 24), why);
        }
        assert_eq!(refused("<f2", "(2, 4, 3)", 47), "expected 48 bytes of data, found 47");
        for shape in ["(0, 4, 3)", "(18446744073709551615, 0, 3)", "(9223372036854775808, 2, 3)"] {
            assert_eq!(
                refused("|u1", shape, 0),
                format!("expected a shape of samples that fit into memory, found {shape}")
            );
        }
    }

    /// Of two rows and four columns: bytes count as the floats that are returned, other samples as they are stored.
    #[test]
    fn images_beyond_the_limits_are_rejected() {
        let fitting = DecodeLimits { max_width: 4, max_height: 2, max_bytes: 96 };
        let refused = |descr: &str, shape: &str, bytes_each: usize, limits: DecodeLimits| {
            let file = file(descr, "False", shape, &vec![0; 24 * bytes_each]);
            read_render(&file, &limits).err().map(|error| error.to_string())
        };
        for shape in ["(2, 4, 3)", "(3, 2, 4)", "(1, 2, 4, 3)"] {
            assert_eq!(refused("|u1", shape, 1, fitting), None, "{shape}");
            let narrow = refused("|u1", shape, 1, DecodeLimits { max_width: 3, ..fitting });
            assert_eq!(narrow, Some(format!("expected width of at most 3, found 4 in {shape}")));
            let low = refused("|u1", shape, 1, DecodeLimits { max_height: 1, ..fitting });
            assert_eq!(low, Some(format!("expected height of at most 1, found 2 in {shape}")));
            let short = refused("|u1", shape, 1, DecodeLimits { max_bytes: 95, ..fitting });
            assert_eq!(short, Some(format!("expected decoded bytes of at most 95, found 96 in {shape}")));
            assert_eq!(
                [("<f2", 2), ("<f4", 4)].map(|(descr, each)| refused(descr, shape, each, fitting)),
                [None, None]
            );
            let double = refused("<f8", shape, 8, fitting);
            assert_eq!(double, Some(format!("expected decoded bytes of at most 96, found 192 in {shape}")));
        }
    }

    #[test]
    fn the_version_decides_the_bytes_of_the_length() {
        let one = file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]);
        let of = |version: [u8; 2], length: usize| {
            let mut bytes = one.clone();
            bytes.splice(6..8, version);
            bytes.splice(10..10, vec![0; length - 2]);
            samples(&bytes, [1, 1, 1, 3])
        };
        for (version, length) in [([1, 0], 2), ([2, 0], 4), ([3, 0], 4)] {
            assert_eq!(of(version, length).as_deref(), Ok(&[0.0, 0.2, 1.0][..]), "{version:?}");
        }
        for version in [[9, 0], [0, 0], [1, 7]] {
            let expected = format!("expected a .npy file of version 1.0 to 3.0, found {}.{}", version[0], version[1]);
            assert_eq!([2, 4].map(|length| of(version, length)), [Err(expected.clone()), Err(expected)]);
        }
    }

    #[test]
    fn other_files_are_rejected_with_what_was_found() {
        let refused = |bytes: &[u8], shape| samples(bytes, shape).unwrap_err();
        let four = [0; 4 * 6];
        let cases = [
            (refused(b"P6 2 2 255", [1, 1, 2, 3]), "a .npy file"),
            (refused(&file("<f4", "False", "(1, 2, 1, 3)", &four), [1, 1, 2, 3]), "found (1, 2, 1, 3)"),
            (refused(&file("<f4", "1", "(1, 1, 2, 3)", &four), [1, 1, 2, 3]), "expected True or False"),
            (refused(&file("<i4", "False", "(1, 1, 2, 3)", &four), [1, 1, 2, 3]), "found '<i4'"),
            (refused(&file("<f4", "False", "(1, 1, 2, 3)", &four[1..]), [1, 1, 2, 3]), "expected 24 bytes"),
            (refused(&file("<f4", "False", "(1, x)", &four), [1, 1, 2, 3]), "a shape"),
        ];
        for (found, expected) in cases {
            assert!(found.contains(expected), "{found}");
        }
        let bytes = file("<f4", "False", "(1, 1, 2, 3)", &four);
        for end in 0..bytes.len() {
            assert!(read(&bytes[..end], [1, 1, 2, 3]).is_err(), "the first {end} bytes");
        }
    }
}
