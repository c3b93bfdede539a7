use std::fmt;

use atsplat_files::Malformed;
use atsplat_pickle::{DType, SharedBytes};
use half::{bf16, f16};

use crate::TensorError;

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
        let elements = shape.iter().try_fold(1usize, |count, &size| count.checked_mul(size));
        let length = elements.and_then(|count| count.checked_mul(dtype.bytes()));
        if length != Some(bytes.len()) {
            let length = length.map_or("fewer than 2⁶⁴".to_owned(), |length| length.to_string());
            let expected = format!("{length} bytes of {dtype} in shape {shape:?}");
            return Err(Malformed::new(WHAT, "tensor", expected, format!("{} bytes", bytes.len())).into());
        }
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

    /// The same values as f16, rounded to nearest even.
    ///
    /// # Errors
    /// [`TensorError::Malformed`] for integers, and if a finite value overflows.
    pub fn to_f16(&self) -> Result<Self, TensorError> {
        self.to_halves(DType::F16, "numbers that f16 can represent, up to 65504", |value| {
            let half = f16::from_f32(value);
            (half.is_finite(), half.to_le_bytes())
        })
    }

    /// The same values as bf16, rounded to nearest even: the range of f32, three digits.
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
        let mut bytes = Vec::with_capacity(self.bytes.len());
        for value in self.to_f32()? {
            let (is_finite, rounded) = round(value);
            if value.is_finite() && !is_finite {
                return Err(Malformed::new(WHAT, "tensor", expected, value).into());
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
    /// [`TensorError::Malformed`] if their element types or other dimensions differ, or there are none.
    pub fn joined(parts: &[&Self]) -> Result<Self, TensorError> {
        let fit =
            |a: &Self, b: &Self| a.dtype == b.dtype && !a.shape.is_empty() && a.shape.get(1..) == b.shape.get(1..);
        let Some(first) = parts.first().filter(|first| parts.iter().all(|part| fit(part, first))) else {
            let found: Vec<String> = parts.iter().map(ToString::to_string).collect();
            let expected = "parts of one type and width";
            return Err(Malformed::new(WHAT, "tensors to join", expected, found.join(", ")).into());
        };
        let rows: usize = parts.iter().map(|part| part.shape[0]).sum();
        let shape = [&[rows], &first.shape[1..]].concat();
        let bytes: Vec<u8> = parts.iter().flat_map(|part| part.bytes.iter().copied()).collect();
        Self::new(first.dtype, shape, SharedBytes::new(bytes))
    }
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

fn each<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|element| read(*element)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn counted(shape: &[usize]) -> StoredTensor {
        let values: Vec<f32> = (0u16..).map(f32::from).take(shape.iter().product()).collect();
        StoredTensor::from_f32(shape.to_vec(), &values).unwrap()
    }

    fn assert_values(tensor: &StoredTensor, expected: &[f64]) {
        Tolerance::EXACT.assert(
            tensor.to_f32().unwrap().into_iter().map(f64::from),
            expected.iter().copied(),
            "values",
        );
    }

    #[test]
    fn tensors_are_transposed_split_and_joined() {
        assert_values(&counted(&[2, 3]).transposed().unwrap(), &[0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
        assert!(counted(&[6]).transposed().is_err());
        let whole = counted(&[4, 2]);
        let (first, second) = (whole.part(0, 2).unwrap(), whole.part(1, 2).unwrap());
        assert_eq!(second.shape(), [2, 2]);
        assert_values(&second, &[4.0, 5.0, 6.0, 7.0]);
        assert_eq!(StoredTensor::joined(&[&first, &second]).unwrap().bytes(), whole.bytes());
        for (part, count) in [(0, 3), (2, 2), (0, 0)] {
            assert!(whole.part(part, count).is_err(), "{part} of {count}");
        }
        assert!(StoredTensor::from_f32(vec![], &[1.0]).unwrap().part(0, 1).is_err(), "a scalar has no parts");
        assert!(StoredTensor::joined(&[]).is_err());
        assert!(StoredTensor::joined(&[&counted(&[2, 2]), &counted(&[2, 3])]).is_err());
        assert!(StoredTensor::joined(&[&first, &second.to_f16().unwrap()]).is_err());
    }

    #[test]
    fn converts_every_floating_point_type() {
        let tensor = |dtype, bytes: &[u8]| StoredTensor::new(dtype, vec![1], SharedBytes::new(bytes.to_vec()));
        assert_values(&tensor(DType::F16, &[0x00, 0xc0]).unwrap(), &[-2.0]);
        assert_values(&tensor(DType::Bf16, &[0x20, 0xc1]).unwrap(), &[-10.0]);
        assert_values(&tensor(DType::F64, &0.5f64.to_le_bytes()).unwrap(), &[0.5]);
        assert!(tensor(DType::I64, &[0; 8]).unwrap().to_f32().is_err());
        assert!(tensor(DType::F32, &[0; 5]).is_err(), "five bytes are not an f32");
        assert!(StoredTensor::new(DType::U8, vec![usize::MAX, 2], SharedBytes::new(vec![])).is_err());
        assert!(StoredTensor::from_f32(vec![1], &[1e6]).unwrap().to_f16().is_err(), "beyond the range of f16");
        assert_values(&StoredTensor::from_f32(vec![1], &[65504.0]).unwrap().to_f16().unwrap(), &[65504.0]);
        // 257 and 259 lie half-way between values with eight significant bits and round to even.
        let brain = StoredTensor::from_f32(vec![3], &[257.0, 259.0, -1e30]).unwrap().to_bf16().unwrap();
        assert_values(&brain, &[256.0, 260.0, f64::from(bf16::from_f32(-1e30).to_f32())]);
        assert!(StoredTensor::from_f32(vec![1], &[f32::MAX]).unwrap().to_bf16().is_err(), "rounds to infinity");
    }
}
