use burn::Tensor;
use burn::backend::Dispatch;
use burn::tensor::Int;

use crate::backend::FusedOps;
use crate::kernels::gather::Sizes;

/// Rows by their numbers, in each sample: `[batch, rows, width]` and `[batch, picks]` to `[batch, picks, width]`.
///
/// The gradient of a row that was picked more than once is the sum over the picks in their order.
///
/// # Panics
/// When the batches differ, or when a number is not that of a row.
pub fn gather_rows(x: Tensor<3>, rows: Tensor<2, Int>) -> Tensor<3> {
    let [batch, picks] = rows.dims();
    let sizes = sizes(&x, batch, picks, 1);
    Tensor::from_dispatch(Dispatch::gather_rows(x.into_dispatch(), rows.into_dispatch(), sizes))
}

/// The largest of each element over rows by their numbers: `[batch, rows, width]` and `[batch, picks, neighbours]` to
/// `[batch, picks, width]`, without the gathered rows in memory.
///
/// The first of equals wins and takes the whole gradient. NaN wins over everything.
///
/// # Panics
/// When the batches differ, when there are no neighbours, or when a number is not that of a row.
pub fn gather_max(x: Tensor<3>, rows: Tensor<3, Int>) -> Tensor<3> {
    let [batch, picks, neighbours] = rows.dims();
    assert!(neighbours > 0, "the largest of no neighbours");
    let sizes = sizes(&x, batch, picks, neighbours);
    Tensor::from_dispatch(Dispatch::gather_max(x.into_dispatch(), rows.into_dispatch(), sizes))
}

/// The largest of each element over neighbours: `[batch, rows, neighbours, width]` to `[batch, rows, width]`.
///
/// Equals and NaN as in [`gather_max`].
///
/// # Panics
/// When there are no neighbours.
pub fn max_over_neighbours(x: Tensor<4>) -> Tensor<3> {
    let [batch, rows, neighbours, width] = x.dims();
    let numbers = Tensor::<1, Int>::arange(0..(rows * neighbours).cast_signed() as i64, &x.device());
    let numbers = numbers.reshape([1, rows, neighbours]).expand([batch, rows, neighbours]);
    gather_max(x.reshape([batch, rows * neighbours, width]), numbers)
}

fn sizes(x: &Tensor<3>, batch: usize, picks: usize, neighbours: usize) -> Sizes {
    let [samples, rows, width] = x.dims();
    assert_eq!(samples, batch, "samples of rows, and of their numbers");
    Sizes { batch, rows, picks, neighbours, width }
}
