use burn::Tensor;
use burn::backend::Dispatch;
use burn::tensor::Int;

use crate::backend::FusedOps;
use crate::kernels::gather::Sizes;

/// Gathers rows by index in each sample: `[batch, rows, width]` and `[batch, picks]` to `[batch, picks, width]`.
///
/// The gradient of a row that was picked more than once is the sum over the picks in their order.
///
/// # Panics
/// If the batches differ, or an index is not that of a row.
pub fn gather_rows(x: Tensor<3>, rows: Tensor<2, Int>) -> Tensor<3> {
    let [batch, picks] = rows.dims();
    let sizes = sizes(&x, batch, picks, 1);
    Tensor::from_dispatch(Dispatch::gather_rows(x.into_dispatch(), rows.into_dispatch(), sizes))
}

/// The maximum of each element over rows given by index: `[batch, rows, width]` and `[batch, picks, neighbours]` to
/// `[batch, picks, width]`, without storing the gathered rows.
///
/// Ties go to the first neighbour, which gets the whole gradient, and NaN wins over everything. This is tested on the CPU; on
/// other devices, burn's own maximum decides.
///
/// # Panics
/// If the batches differ, there are no neighbours, or an index is not that of a row.
pub fn gather_max(x: Tensor<3>, rows: Tensor<3, Int>) -> Tensor<3> {
    let [batch, picks, neighbours] = rows.dims();
    assert!(neighbours > 0, "a maximum over no neighbours");
    let sizes = sizes(&x, batch, picks, neighbours);
    Tensor::from_dispatch(Dispatch::gather_max(x.into_dispatch(), rows.into_dispatch(), sizes))
}

fn sizes(x: &Tensor<3>, batch: usize, picks: usize, neighbours: usize) -> Sizes {
    let [samples, rows, width] = x.dims();
    assert_eq!(samples, batch, "batch sizes of rows and indices");
    Sizes { batch, rows, picks, neighbours, width }
}
