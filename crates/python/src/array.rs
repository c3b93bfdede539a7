//! NumPy arrays, by bytes: written once into the memory that the array then uses, read from one contiguous copy.
//!
//! The package makes arrays contiguous and of the requested type in `_arrays.py`. The `numpy` crate would save a copy, but it asks for
//! a feature of `num-integer` with which all of `arrow` is built again.

use std::ops::Range;

use atsplat_pixels::{Image, ImageU8, PixelError};
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

use crate::error::Failure;

/// A new array of f32: the `parts` one after the other, each number converted.
pub(crate) fn floats<'py, 'a, T: Copy + 'a>(
    py: Python<'py>,
    shape: &[usize],
    parts: impl IntoIterator<Item = &'a [T]>,
    convert: impl Fn(T) -> f32,
) -> PyResult<Bound<'py, PyAny>> {
    let bytes = PyByteArray::new_with(py, 4 * shape.iter().product::<usize>(), |memory| {
        let mut memory = memory.as_chunks_mut::<4>().0.iter_mut();
        for part in parts {
            for (number, place) in part.iter().zip(&mut memory) {
                *place = convert(*number).to_ne_bytes();
            }
        }
        Ok(())
    })?;
    let array = py.import("numpy")?.call_method1("frombuffer", (bytes, "=f4"))?;
    array.call_method1("reshape", (shape.to_vec(),))
}

/// The f32 in the bytes of an array.
pub(crate) fn read_floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|number| f32::from_ne_bytes(*number)).collect()
}

/// The rows of `N` f32 in the bytes of an array.
pub(crate) fn read_rows<const N: usize>(bytes: &[u8]) -> Vec<[f32; N]> {
    read_floats(bytes).as_chunks::<N>().0.to_vec()
}

/// Images of one size, as the array held them.
#[derive(Clone, Debug)]
pub(crate) struct Images {
    pub(crate) count: usize,
    pub(crate) width: u32,
    pub(crate) height: u32,
    samples: Samples,
}

#[derive(Clone, Debug)]
enum Samples {
    /// Nominally in [0, 1].
    Floats(Vec<f32>),
    /// From 0 to 255.
    Bytes(Vec<u8>),
}

impl Images {
    /// Copies an array of type `f4` or `u1`, of shape count × height × width × 3.
    pub(crate) fn of(shape: &[usize], kind: &str, bytes: &[u8]) -> Result<Self, Failure> {
        let [count, height, width, 3] = *shape else {
            return Err(Failure::invalid("images", format!("expected count × height × width × 3, found {shape:?}")));
        };
        let side = |side: usize| u32::try_from(side).map_err(|error| Failure::invalid("images", error));
        let samples = if kind == "u1" { Samples::Bytes(bytes.to_vec()) } else { Samples::Floats(read_floats(bytes)) };
        Ok(Self { count, width: side(width)?, height: side(height)?, samples })
    }

    /// The image at a position.
    pub(crate) fn image(&self, at: usize) -> Result<Image, PixelError> {
        let Self { width, height, samples, .. } = self;
        let size = *width as usize * *height as usize * 3;
        let range = at * size..(at + 1) * size;
        match samples {
            Samples::Floats(all) => Image::new(*width, *height, part(all, range)),
            Samples::Bytes(all) => Ok(Image::from_u8(&ImageU8::new(*width, *height, part(all, range))?)),
        }
    }
}

#[expect(clippy::expect_used, reason = "the package passes arrays with as many numbers as their shape says")]
fn part<T: Clone>(all: &[T], range: Range<usize>) -> Vec<T> {
    all.get(range).expect("callers index below `count`").to_vec()
}
