use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Shape, TensorMetadata};
use burn::tensor::IndexingUpdateOp;

use super::Array;
use crate::kernels::gather::Sizes;

/// `[batch, rows, width]` to `[batch, picks, width]` by indices `[batch, picks]`.
pub(crate) fn rows<B: Backend>(x: FloatTensor<B>, indices: IntTensor<B>, sizes: Sizes) -> FloatTensor<B> {
    B::float_gather(1, x, expanded::<B>(indices, sizes.batch, sizes.picks, sizes.width))
}

/// The gradient of [`rows`].
pub(crate) fn rows_backward<B: Backend>(grad: FloatTensor<B>, indices: IntTensor<B>, sizes: Sizes) -> FloatTensor<B> {
    let indices = expanded::<B>(indices, sizes.batch, sizes.picks, sizes.width);
    scatter::<B>(grad, indices, sizes)
}

/// The maximum over neighbours, and the row of each maximum, both `[batch, picks, width]`.
pub(crate) fn max<B: Backend>(
    x: FloatTensor<B>,
    indices: IntTensor<B>,
    sizes: Sizes,
) -> (FloatTensor<B>, IntTensor<B>) {
    let Sizes { batch, picks, neighbours, width, .. } = sizes;
    let indices = B::int_reshape(indices, Shape::from(vec![batch, picks * neighbours]));
    let indices = expanded::<B>(indices, batch, picks * neighbours, width);
    let gathered = B::float_gather(1, x, indices.clone());
    let gathered = Array::<B>(gathered).reshape(&[batch, picks, neighbours, width]).0;
    let int_dtype = indices.dtype().into();
    let (largest, places) = B::float_max_dim_with_indices(gathered, 2, int_dtype);
    let indices = B::int_reshape(indices, Shape::from(vec![batch, picks, neighbours, width]));
    let winners = B::int_gather(2, indices, places);
    let shape = Shape::from(vec![batch, picks, width]);
    (B::float_reshape(largest, shape.clone()), B::int_reshape(winners, shape))
}

/// The gradient of [`max`].
pub(crate) fn max_backward<B: Backend>(grad: FloatTensor<B>, winners: IntTensor<B>, sizes: Sizes) -> FloatTensor<B> {
    scatter::<B>(grad, winners, sizes)
}

fn scatter<B: Backend>(grad: FloatTensor<B>, indices: IntTensor<B>, sizes: Sizes) -> FloatTensor<B> {
    let zeros = Array::<B>(grad.clone()).zeros_like(&[sizes.batch, sizes.rows, sizes.width]);
    B::float_scatter(1, zeros.0, indices, grad, IndexingUpdateOp::Add)
}

fn expanded<B: Backend>(indices: IntTensor<B>, batch: usize, picks: usize, width: usize) -> IntTensor<B> {
    let indices = B::int_reshape(indices, Shape::from(vec![batch, picks, 1]));
    B::int_expand(indices, Shape::from(vec![batch, picks, width]))
}
