/// Numbers of a matrix whose rows may overlap in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows<'a> {
    pub(super) data: &'a [f32],
    pub(super) count: usize,
    pub(super) stride: usize,
}

/// `out += left · right` for `left` of `terms` columns and a row-major `right` of `terms` by `columns`; `out` is
/// row-major without gaps. On one thread: callers split the rows, in a way that depends on the pictures' size alone.
///
/// # Panics
/// When the shapes reach outside their slices.
#[expect(unsafe_code, reason = "the matrix product of a library that takes pointers")]
pub(super) fn multiply_add(out: &mut [f32], left: Rows<'_>, right: &[f32], terms: usize, columns: usize) {
    let Rows { data, count: rows, stride } = left;
    if rows == 0 || columns == 0 || terms == 0 {
        return;
    }
    assert!((rows - 1) * stride + terms <= data.len(), "left of a product: {rows} rows of {terms}, {stride} apart");
    assert_eq!(right.len(), terms * columns, "right of a product");
    assert_eq!(out.len(), rows * columns, "a product");
    // SAFETY: every element that these sizes and strides name lies inside its slice, as was just checked, and `out` is
    // borrowed mutably and alone.
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
