use std::fmt;
use std::sync::Arc;

use crate::SharedBytes;
use crate::TorchError;
use crate::container::Container;

/// Element type of a tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum DType {
    /// `torch.uint8`.
    U8,
    /// `torch.int8`.
    I8,
    /// `torch.int16`.
    I16,
    /// `torch.int32`.
    I32,
    /// `torch.int64`.
    I64,
    /// `torch.float16`.
    F16,
    /// `torch.bfloat16`.
    Bf16,
    /// `torch.float32`.
    F32,
    /// `torch.float64`.
    F64,
    /// `torch.bool`, one byte each.
    Bool,
}

impl DType {
    /// Size of one element in bytes.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 | Self::Bool => 1,
            Self::I16 | Self::F16 | Self::Bf16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::I64 | Self::F64 => 8,
        }
    }
}

impl fmt::Display for DType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::I16 => "int16",
            Self::I32 => "int32",
            Self::I64 => "int64",
            Self::F16 => "float16",
            Self::Bf16 => "bfloat16",
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::Bool => "bool",
        })
    }
}

/// The flat buffer of a tensor, located in the file but not read yet.
#[derive(Clone)]
pub(crate) struct Storage {
    pub(crate) container: Arc<Container>,
    pub(crate) key: Arc<str>,
    pub(crate) dtype: DType,
    /// In elements.
    pub(crate) len: u64,
}

/// A tensor of `torch.save`: a strided view of a storage, whose bounds are checked when it is parsed.
///
/// Creating one does not read its elements, so that listing the scenes of a chunk does not read its images from disk.
/// Elements are little endian.
#[derive(Clone)]
pub struct Tensor {
    storage: Storage,
    /// In elements.
    offset: u64,
    shape: Arc<[u64]>,
    strides: Arc<[u64]>,
    elements: u64,
}

impl Tensor {
    pub(crate) fn new(
        storage: Storage,
        offset: u64,
        shape: Arc<[u64]>,
        strides: Arc<[u64]>,
    ) -> Result<Self, TorchError> {
        let layout = || format!("shape {shape:?}, strides {strides:?}, offset {offset}");
        let location = || format!("tensor in storage {:?}", crate::shortened(&storage.key));
        if shape.len() != strides.len() {
            return Err(TorchError::malformed(location(), "as many strides as dimensions", layout()));
        }
        let elements = element_count(&shape)
            .ok_or_else(|| TorchError::malformed(location(), "an element count below 2^64", layout()))?;
        let end = if elements == 0 { Some(offset) } else { past_last(offset, &shape, &strides) };
        if end.is_none_or(|end| end > storage.len) {
            return Err(TorchError::malformed(location(), format!("at most {} elements", storage.len), layout()));
        }
        Ok(Self { storage, offset, shape, strides, elements })
    }

    /// The element type.
    pub fn dtype(&self) -> DType {
        self.storage.dtype
    }

    /// Elements along each dimension; empty for a scalar.
    pub fn shape(&self) -> &[u64] {
        &self.shape
    }

    /// Strides in elements along each dimension.
    pub fn strides(&self) -> &[u64] {
        &self.strides
    }

    /// Number of elements.
    pub fn element_count(&self) -> u64 {
        self.elements
    }

    /// Whether the elements are row-major without gaps.
    pub fn is_contiguous(&self) -> bool {
        let mut expected = 1u64;
        self.elements == 0
            || self.shape.iter().zip(&*self.strides).rev().all(|(&size, &stride)| {
                let fits = size == 1 || stride == expected;
                expected = expected.saturating_mul(size);
                fits
            })
    }

    /// The elements as row-major little-endian bytes: a part of the mapped file if contiguous, a copy otherwise.
    ///
    /// # Errors
    /// [`TorchError`] if the storage's zip entry is malformed or has another CRC-32, or if the tensor repeats its storage (an
    /// expanded tensor), so that a copy would be larger than the storage.
    pub fn to_bytes(&self) -> Result<SharedBytes, TorchError> {
        let bytes = self.to_unread_bytes()?;
        bytes.verify()?;
        Ok(bytes)
    }

    /// [`Self::to_bytes`] for bytes that may stay unused: those of a contiguous tensor are not read from disk, and
    /// [`SharedBytes::verify`] must be called before they are.
    ///
    /// # Errors
    /// Those of [`Self::to_bytes`] except another CRC-32 of a contiguous tensor.
    pub fn to_unread_bytes(&self) -> Result<SharedBytes, TorchError> {
        let storage = self.storage.container.bytes(&self.storage.key)?;
        let (start, count) = (index(self.offset)?, index(self.elements)?);
        let size = self.dtype().bytes();
        if self.is_contiguous() {
            let range = start.checked_mul(size).zip(start.checked_add(count).and_then(|end| end.checked_mul(size)));
            return range.and_then(|(start, end)| storage.slice(start..end)).ok_or_else(|| self.outside(&storage));
        }
        if self.elements > self.storage.len {
            return Err(TorchError::unsupported(self.to_string(), "a tensor that repeats its storage"));
        }
        storage.verify()?;
        self.gathered(&storage, start, size).map(SharedBytes::new).ok_or_else(|| self.outside(&storage))
    }

    /// The exact elements of a floating-point tensor in row-major order.
    ///
    /// # Errors
    /// Those of [`Tensor::to_bytes`], and for a tensor of integers.
    pub fn to_f64(&self) -> Result<Vec<f64>, TorchError> {
        let bytes = self.to_bytes()?;
        Ok(match self.dtype() {
            DType::F16 => elements(&bytes, |b| f64_from_f16(u16::from_le_bytes(b))),
            DType::Bf16 => elements(&bytes, |b| f64::from(f32::from_bits(u32::from(u16::from_le_bytes(b)) << 16))),
            DType::F32 => elements(&bytes, |b| f64::from(f32::from_le_bytes(b))),
            DType::F64 => elements(&bytes, f64::from_le_bytes),
            other => return Err(TorchError::malformed(self.to_string(), "floating-point elements", other.to_string())),
        })
    }

    /// The elements of an integer or boolean tensor in row-major order.
    ///
    /// # Errors
    /// Those of [`Tensor::to_bytes`], and for a tensor of floats.
    pub fn to_i64(&self) -> Result<Vec<i64>, TorchError> {
        let bytes = self.to_bytes()?;
        Ok(match self.dtype() {
            DType::U8 | DType::Bool => elements(&bytes, |[b]| i64::from(b)),
            DType::I8 => elements(&bytes, |b| i64::from(i8::from_le_bytes(b))),
            DType::I16 => elements(&bytes, |b| i64::from(i16::from_le_bytes(b))),
            DType::I32 => elements(&bytes, |b| i64::from(i32::from_le_bytes(b))),
            DType::I64 => elements(&bytes, i64::from_le_bytes),
            other => return Err(TorchError::malformed(self.to_string(), "integer elements", other.to_string())),
        })
    }

    fn gathered(&self, storage: &[u8], start: usize, size: usize) -> Option<Vec<u8>> {
        let count = usize::try_from(self.elements).ok()?;
        let mut copy = Vec::with_capacity(count.checked_mul(size)?);
        let mut position = vec![0u64; self.shape.len()];
        let mut element = start as u64;
        for _ in 0..count {
            let byte = usize::try_from(element).ok()?.checked_mul(size)?;
            copy.extend_from_slice(storage.get(byte..byte.checked_add(size)?)?);
            for ((step, &len), &stride) in position.iter_mut().zip(&*self.shape).zip(&*self.strides).rev() {
                *step += 1;
                if *step < len {
                    element += stride;
                    break;
                }
                element -= (len - 1) * stride;
                *step = 0;
            }
        }
        Some(copy)
    }

    fn outside(&self, storage: &[u8]) -> TorchError {
        TorchError::malformed(self.to_string(), "elements inside the storage", format!("{} bytes", storage.len()))
    }
}

impl fmt::Display for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a {} tensor of shape {:?}", self.dtype(), self.shape)
    }
}

impl fmt::Debug for Tensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

fn element_count(shape: &[u64]) -> Option<u64> {
    // A dimension of 0 makes the tensor empty, however large the others are.
    if shape.contains(&0) {
        return Some(0);
    }
    shape.iter().try_fold(1u64, |count, &size| count.checked_mul(size))
}

/// The largest element index plus one, for a tensor without dimensions of 0.
fn past_last(offset: u64, shape: &[u64], strides: &[u64]) -> Option<u64> {
    let last = shape
        .iter()
        .zip(strides)
        .try_fold(offset, |last, (&size, &stride)| last.checked_add(size.checked_sub(1)?.checked_mul(stride)?))?;
    last.checked_add(1)
}

fn index(value: u64) -> Result<usize, TorchError> {
    usize::try_from(value)
        .map_err(|source| TorchError::unsupported("tensor", format!("an index of {value} ({source})")))
}

fn elements<const N: usize, T>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    let (whole, _) = bytes.as_chunks::<N>();
    whole.iter().map(|element| read(*element)).collect()
}

/// Converts IEEE 754 binary16, exactly.
fn f64_from_f16(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let fraction = bits & 0x3ff;
    match ((bits >> 10) & 0x1f, fraction) {
        (0, fraction) => sign * f64::from(fraction) * 2f64.powi(-24),
        (0x1f, 0) => sign * f64::INFINITY,
        (0x1f, _) => f64::NAN,
        (exponent, fraction) => sign * f64::from(1024 + fraction) * 2f64.powi(i32::from(exponent) - 25),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn tensor(data: Vec<u8>, dtype: DType, offset: u64, shape: &[u64], strides: &[u64]) -> Result<Tensor, TorchError> {
        let len = (data.len() / dtype.bytes()) as u64;
        let container = Arc::new(Container::Buffers([("0".to_owned(), SharedBytes::new(data))].into()));
        Tensor::new(Storage { container, key: "0".into(), dtype, len }, offset, shape.into(), strides.into())
    }

    #[test]
    fn transposed_views_are_copied_to_row_major_order() {
        let data: Vec<u8> = (0..6).collect();
        let rows = tensor(data.clone(), DType::U8, 0, &[2, 3], &[3, 1]).unwrap();
        assert!(rows.is_contiguous());
        assert_eq!(&*rows.to_bytes().unwrap(), &[0, 1, 2, 3, 4, 5]);
        let columns = tensor(data.clone(), DType::U8, 0, &[3, 2], &[1, 3]).unwrap();
        assert!(!columns.is_contiguous());
        assert_eq!(columns.to_i64().unwrap(), [0, 3, 1, 4, 2, 5]);
        let part = tensor(data, DType::U8, 1, &[2, 2], &[3, 1]).unwrap();
        assert_eq!(part.to_i64().unwrap(), [1, 2, 4, 5]);
    }

    #[test]
    fn views_outside_their_storage_are_errors() {
        for (offset, shape, strides) in [
            (0, &[7][..], &[1][..]),
            (6, &[1], &[1]),
            (0, &[2, 3], &[4, 1]),
            (1, &[2], &[u64::MAX]),
            (u64::MAX, &[1], &[1]),
            (0, &[u64::MAX, u64::MAX], &[0, 0]),
            (0, &[1], &[1, 1]),
            (7, &[0], &[1]),
        ] {
            assert!(tensor(vec![0; 6], DType::U8, offset, shape, strides).is_err(), "{offset} {shape:?} {strides:?}");
        }
        assert!(
            tensor(vec![0; 6], DType::U8, 6, &[0, u64::MAX, u64::MAX], &[1, 1, 1]).is_ok(),
            "an empty view is inside"
        );
    }

    #[test]
    fn a_stride_of_zero_cannot_cause_a_large_copy() {
        let huge = tensor(vec![7], DType::U8, 0, &[1 << 40, 1 << 20], &[0, 0]).unwrap();
        assert!(matches!(huge.to_bytes(), Err(TorchError::Unsupported { .. })));
        let shared = tensor(vec![7, 8], DType::U8, 0, &[1, 2], &[0, 0]).unwrap();
        assert_eq!(shared.to_i64().unwrap(), [7, 7]);
    }

    #[test]
    fn half_precision_is_exact() {
        let cases = [
            (0x0000u16, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 6.103_515_625e-5),
            (0x0001, 5.960_464_477_539_063e-8),
            (0x7c00, f64::INFINITY),
            (0x3555, 0.333_251_953_125),
        ];
        for (bits, expected) in cases {
            assert_eq!(f64_from_f16(bits).to_bits(), f64::to_bits(expected), "{bits:04x}");
        }
        assert!(f64_from_f16(0x7e00).is_nan());
        assert!(f64_from_f16(0x8000).is_sign_negative(), "sign of negative zero");
        let bfloat = tensor(vec![0x80, 0x3f, 0x20, 0xc1], DType::Bf16, 0, &[2], &[1]).unwrap();
        Tolerance::EXACT.assert(bfloat.to_f64().unwrap(), [1.0, -10.0], "bfloat16");
    }

    #[test]
    fn floats_and_integers_are_not_confused() {
        assert!(tensor(vec![0; 8], DType::F32, 0, &[2], &[1]).unwrap().to_i64().is_err());
        assert!(tensor(vec![0; 8], DType::I32, 0, &[2], &[1]).unwrap().to_f64().is_err());
        assert_eq!(tensor(vec![255; 8], DType::I64, 0, &[1], &[1]).unwrap().to_i64().unwrap(), [-1]);
    }
}
