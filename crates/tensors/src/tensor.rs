use std::fmt;

use atsplat_files::Malformed;
use atsplat_pickle::{DType, SharedBytes};
use half::{bf16, f16};

use crate::{TensorError, TensorView};

const WHAT: &str = "weights";

/// A row-major array of a file: a part of the file's memory map, or owned bytes.
#[derive(Clone)]
pub struct StoredTensor {
    dtype: DType,
    shape: Vec<usize>,
    bytes: SharedBytes,
}

impl StoredTensor {
    /// A tensor of little-endian bytes.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] if the number of bytes does not fit the shape.
    pub fn new(dtype: DType, shape: Vec<usize>, bytes: SharedBytes) -> Result<Self, TensorError> {
        check_length(dtype, &shape, bytes.len())?;
        Ok(Self { dtype, shape, bytes })
    }

    /// A tensor of f32 values in row-major order.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] if their number does not fit the shape.
    pub fn from_f32(shape: Vec<usize>, values: &[f32]) -> Result<Self, TensorError> {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Self::new(DType::F32, shape, SharedBytes::new(bytes))
    }

    /// Type of the elements.
    pub fn dtype(&self) -> DType {
        self.dtype
    }

    /// Size of each dimension; empty for a scalar.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Row-major little-endian bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The tensor with its bytes borrowed.
    pub(crate) fn view(&self) -> TensorView<'_> {
        TensorView { dtype: self.dtype, shape: self.shape.clone(), bytes: &self.bytes }
    }

    /// The values in row-major order, rounded to f32 if the file has f64.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for integers, which cannot be parameters.
    pub fn to_f32(&self) -> Result<Vec<f32>, TensorError> {
        let bytes = &*self.bytes;
        #[expect(clippy::cast_possible_truncation, reason = "weights are f32 here, and f64 ones are rounded")]
        let values = match self.dtype {
            DType::F16 => each(bytes, |b| f16::from_le_bytes(b).to_f32()),
            DType::Bf16 => each(bytes, |b| bf16::from_le_bytes(b).to_f32()),
            DType::F32 => each(bytes, f32::from_le_bytes),
            DType::F64 => each(bytes, |b| f64::from_le_bytes(b) as f32),
            other => return Err(Malformed::new(WHAT, "tensor", "floating-point elements", other).into()),
        };
        Ok(values)
    }

    /// The same values as f16, rounded to nearest even; f64 by way of f32.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for integers, and if a finite value overflows.
    pub fn to_f16(&self) -> Result<Self, TensorError> {
        self.to_halves(DType::F16, "numbers that f16 can represent, up to 65504", |value| {
            let half = f16::from_f32(value);
            (half.is_finite(), half.to_le_bytes())
        })
    }

    /// The same values as bf16, rounded to nearest even: the range of f32, three digits; f64 by way of f32.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for integers, and if a finite value overflows.
    pub fn to_bf16(&self) -> Result<Self, TensorError> {
        self.to_halves(DType::Bf16, "numbers that bf16 can represent, up to 3.3895e38", |value| {
            let brain = bf16::from_f32(value);
            (brain.is_finite(), brain.to_le_bytes())
        })
    }

    /// `round` returns whether its result is finite, and its bytes.
    fn to_halves(
        &self,
        dtype: DType,
        expected: &str,
        round: impl Fn(f32) -> (bool, [u8; 2]),
    ) -> Result<Self, TensorError> {
        let values = self.to_f32()?;
        let exact = if self.dtype == DType::F64 {
            each(&self.bytes, f64::from_le_bytes)
        } else {
            values.iter().copied().map(f64::from).collect()
        };
        let mut bytes = Vec::with_capacity(self.bytes.len());
        for (value, exact) in values.into_iter().zip(exact) {
            let (is_finite, rounded) = round(value);
            if exact.is_finite() && !is_finite {
                return Err(Malformed::new(WHAT, "tensor", expected, format!("{exact:?}")).into());
            }
            bytes.extend_from_slice(&rounded);
        }
        Self::new(dtype, self.shape.clone(), SharedBytes::new(bytes))
    }

    /// The matrix with rows and columns exchanged.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for anything but a matrix.
    pub fn transposed(&self) -> Result<Self, TensorError> {
        let [rows, columns] = *self.shape.as_slice() else {
            let found = format!("{:?}", self.shape);
            return Err(Malformed::new(WHAT, "tensor to transpose", "two dimensions", found).into());
        };
        // Without rows, the number of columns is not bounded by that of bytes.
        if self.bytes.is_empty() {
            return Self::new(self.dtype, vec![columns, rows], self.bytes.clone());
        }
        let size = self.dtype.bytes();
        let mut bytes = Vec::with_capacity(self.bytes.len());
        for column in 0..columns {
            for row in 0..rows {
                let start = (row * columns + column) * size;
                bytes.extend_from_slice(&self.bytes[start..start + size]);
            }
        }
        Self::new(self.dtype, vec![columns, rows], SharedBytes::new(bytes))
    }

    /// One of `count` equal parts along the first dimension; its bytes are not copied.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] if the first dimension cannot be divided into such parts.
    pub fn part(&self, part: usize, count: usize) -> Result<Self, TensorError> {
        let part_of = |first: usize| {
            let rows = first.checked_div(count).filter(|rows| part < count && rows * count == first)?;
            let length = self.bytes.len() / count;
            Some((rows, self.bytes.slice(part * length..(part + 1) * length)?))
        };
        if let Some((rows, bytes)) = self.shape.first().and_then(|&first| part_of(first)) {
            Self::new(self.dtype, [&[rows], &self.shape[1..]].concat(), bytes)
        } else {
            let expected = format!("{count} equal parts along the first dimension");
            Err(Malformed::new(WHAT, "tensor to split", expected, format!("{:?}", self.shape)).into())
        }
    }

    /// Parts concatenated along the first dimension.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] if their element types or other dimensions differ, there are none, or they have too many rows.
    pub fn joined(parts: &[&Self]) -> Result<Self, TensorError> {
        let fit =
            |a: &Self, b: &Self| a.dtype == b.dtype && !a.shape.is_empty() && a.shape.get(1..) == b.shape.get(1..);
        let Some(first) = parts.first().filter(|first| parts.iter().all(|part| fit(part, first))) else {
            let found: Vec<String> = parts.iter().map(ToString::to_string).collect();
            let expected = "parts of one type and width";
            return Err(Malformed::new(WHAT, "tensors to join", expected, found.join(", ")).into());
        };
        let rows = parts.iter().try_fold(0usize, |rows, part| rows.checked_add(part.shape[0]));
        let rows = rows.ok_or_else(|| Malformed::new(WHAT, "tensors to join", "fewer than 2⁶⁴ rows", "more"))?;
        let shape = [&[rows], &first.shape[1..]].concat();
        let bytes: Vec<u8> = parts.iter().flat_map(|part| part.bytes.iter().copied()).collect();
        Self::new(first.dtype, shape, SharedBytes::new(bytes))
    }
}

/// Checks a tensor's number of bytes.
pub(crate) fn check_length(dtype: DType, shape: &[usize], bytes: usize) -> Result<(), TensorError> {
    let elements = shape.iter().try_fold(1usize, |count, &size| count.checked_mul(size));
    let length = elements.and_then(|count| count.checked_mul(dtype.bytes()));
    if length != Some(bytes) {
        let length = length.map_or("fewer than 2⁶⁴".to_owned(), |length| length.to_string());
        let expected = format!("{length} bytes of {dtype} in shape {shape:?}");
        return Err(Malformed::new(WHAT, "tensor", expected, format!("{bytes} bytes")).into());
    }
    Ok(())
}

impl fmt::Display for StoredTensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?}", self.dtype, self.shape)
    }
}

impl fmt::Debug for StoredTensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

fn each<const N: usize, T>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|element| read(*element)).collect()
}

#[cfg(test)]
mod tests;
