//! Activations and the matrix product of convolutions.

/// Activations of one image, channels last.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Activations {
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) channels: usize,
    pub(super) values: Vec<f32>,
}

impl Activations {
    pub(super) fn zeros(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, values: vec![0.0; height * width * channels] }
    }

    /// Number of values per row.
    pub(super) const fn row(&self) -> usize {
        self.width * self.channels
    }

    /// Zero-padded on all sides.
    pub(super) fn padded(&self, padding: usize) -> Self {
        let mut padded = Self::zeros(self.height + 2 * padding, self.width + 2 * padding, self.channels);
        let (row, wide, left) = (self.row(), padded.row(), padding * self.channels);
        let slots = padded.values.chunks_exact_mut(wide.max(1)).skip(padding);
        for (slot, row) in slots.zip(self.values.chunks_exact(row.max(1))) {
            slot[left..left + row.len()].copy_from_slice(row);
        }
        padded
    }
}

/// A matrix whose rows may overlap in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'a> {
    pub(super) data: &'a [f32],
    pub(super) count: usize,
    pub(super) stride: usize,
}

/// `out += left · right` for `left` of `terms` columns and a row-major `right` of `terms` by `columns`; `out` is
/// row-major without gaps. Single-threaded: callers split the rows in a way that depends on the images' size only.
///
/// # Panics
/// If the shapes exceed their slices.
#[expect(unsafe_code, reason = "gemm's matrix product takes pointers")]
pub(super) fn multiply_add(out: &mut [f32], left: Rows<'_>, right: &[f32], terms: usize, columns: usize) {
    let Rows { data, count: rows, stride } = left;
    if rows == 0 || columns == 0 || terms == 0 {
        return;
    }
    assert!((rows - 1) * stride + terms <= data.len(), "left operand: {rows} rows of {terms}, {stride} apart");
    assert_eq!(right.len(), terms * columns, "right operand");
    assert_eq!(out.len(), rows * columns, "output");
    // SAFETY: all elements addressed by these sizes and strides are inside their slices, as asserted above, and `out` is
    // borrowed exclusively.
    unsafe {
        gemm::gemm::<f32>(
            rows,
            columns,
            terms,
            out.as_mut_ptr(),
            1,
            columns.cast_signed(),
            true,
            data.as_ptr(),
            1,
            stride.cast_signed(),
            right.as_ptr(),
            1,
            columns.cast_signed(),
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}
