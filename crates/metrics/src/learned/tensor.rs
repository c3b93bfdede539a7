/// Activations of one picture: rows, columns, channels, the channels of a pixel side by side.
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

    /// Numbers of one row.
    pub(super) const fn row(&self) -> usize {
        self.width * self.channels
    }

    /// With zeros around.
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
