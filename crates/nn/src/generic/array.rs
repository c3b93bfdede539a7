use std::ops::{Add, Div, Mul, Range, Sub};

use burn::backend::tensor::{Device, FloatTensor};
use burn::backend::{Backend, DType, FloatDType, Scalar, Shape, Slice, TensorMetadata};

use crate::MatmulPrecision;

/// A backend's float tensor with operators, so that formulas are readable. Shapes broadcast.
#[derive(Debug)]
pub(super) struct Array<B: Backend>(pub(super) FloatTensor<B>);

impl<B: Backend> Clone for Array<B> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<B: Backend> Array<B> {
    pub(super) fn zeros(shape: &[usize], device: &Device<B>, dtype: FloatDType) -> Self {
        Self(B::float_zeros(Shape::from(shape.to_vec()), device, dtype))
    }

    /// Zeros of the same type and device.
    pub(super) fn zeros_like(&self, shape: &[usize]) -> Self {
        Self::zeros(shape, &self.0.device(), self.0.dtype().into())
    }

    pub(super) fn dims(&self) -> Vec<usize> {
        self.0.shape().to_vec()
    }

    /// The largest finite and the smallest positive normal value of the element type.
    pub(super) fn extremes(&self) -> (f64, f64) {
        match self.0.dtype() {
            DType::F64 => (f64::MAX, f64::MIN_POSITIVE),
            DType::F16 => (65_504.0, 6.103_515_625e-5),
            _ => (f64::from(f32::MAX), f64::from(f32::MIN_POSITIVE)),
        }
    }

    pub(super) fn reshape(self, shape: &[usize]) -> Self {
        Self(B::float_reshape(self.0, Shape::from(shape.to_vec())))
    }

    pub(super) fn swap(self, a: usize, b: usize) -> Self {
        Self(B::float_swap_dims(self.0, a, b))
    }

    /// The last two dimensions exchanged.
    pub(super) fn transposed(self) -> Self {
        Self(B::float_transpose(self.0))
    }

    /// The product of matrices, in the current [`MatmulPrecision`] if the device has it.
    pub(super) fn matmul(self, right: Self) -> Self {
        let is_half = MatmulPrecision::current() == MatmulPrecision::F16 && self.0.dtype() == DType::F32;
        if !is_half || !B::supports_dtype(&self.0.device(), DType::F16) {
            return Self(B::float_matmul(self.0, right.0));
        }
        let [left, right] = [self, right].map(|factor| B::float_cast(factor.0, FloatDType::F16));
        Self(B::float_cast(B::float_matmul(left, right), FloatDType::F32))
    }

    /// A range of one dimension.
    pub(super) fn range(self, dimension: usize, range: Range<usize>) -> Self {
        let slices = slices(&self.dims(), dimension, range);
        Self(B::float_slice(self.0, &slices))
    }

    /// Replaces a range of one dimension.
    pub(super) fn with_range(self, dimension: usize, range: Range<usize>, value: Self) -> Self {
        let slices = slices(&self.dims(), dimension, range);
        Self(B::float_slice_assign(self.0, &slices, value.0))
    }

    pub(super) fn joined(parts: Vec<Self>, dimension: usize) -> Self {
        Self(B::float_cat(parts.into_iter().map(|part| part.0).collect(), dimension))
    }

    /// The sum along a dimension, which is kept with size 1.
    pub(super) fn sum(self, dimension: usize) -> Self {
        Self(B::float_sum_dim(self.0, dimension))
    }

    pub(super) fn mean(self, dimension: usize) -> Self {
        Self(B::float_mean_dim(self.0, dimension))
    }

    pub(super) fn max(self, dimension: usize) -> Self {
        Self(B::float_max_dim(self.0, dimension))
    }

    pub(super) fn exp(self) -> Self {
        Self(B::float_exp(self.0))
    }

    pub(super) fn ln(self) -> Self {
        Self(B::float_log(self.0))
    }

    pub(super) fn erf(self) -> Self {
        Self(B::float_erf(self.0))
    }

    pub(super) fn sqrt(self) -> Self {
        Self(B::float_sqrt(self.0))
    }

    pub(super) fn plus(self, value: f64) -> Self {
        Self(B::float_add_scalar(self.0, Scalar::from(value)))
    }

    pub(super) fn times(self, value: f64) -> Self {
        Self(B::float_mul_scalar(self.0, Scalar::from(value)))
    }

    pub(super) fn at_least(self, value: f64) -> Self {
        Self(B::float_clamp_min(self.0, Scalar::from(value)))
    }

    pub(super) fn at_most(self, value: f64) -> Self {
        Self(B::float_clamp_max(self.0, Scalar::from(value)))
    }

    /// Element-wise maximum.
    pub(super) fn larger(self, other: Self) -> Self {
        let last = self.dims().len();
        let widen = |array: Self| {
            let mut dims = array.dims();
            dims.push(1);
            array.reshape(&dims)
        };
        let mut dims = self.dims();
        let both = Self::joined(vec![widen(self), widen(other)], last).max(last);
        dims.truncate(last);
        both.reshape(&dims)
    }
}

fn slices(dims: &[usize], dimension: usize, range: Range<usize>) -> Vec<Slice> {
    let whole = |(at, &size): (usize, &usize)| if at == dimension { range.clone() } else { 0..size };
    dims.iter().enumerate().map(|item| Slice::from(whole(item))).collect()
}

macro_rules! operator {
    ($operator:ident, $method:ident, $function:ident) => {
        impl<B: Backend> $operator for Array<B> {
            type Output = Self;

            fn $method(self, right: Self) -> Self {
                Self(B::$function(self.0, right.0))
            }
        }
    };
}

operator!(Add, add, float_add);
operator!(Sub, sub, float_sub);
operator!(Mul, mul, float_mul);
operator!(Div, div, float_div);
