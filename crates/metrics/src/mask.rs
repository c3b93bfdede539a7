use crate::MetricError;

/// The pixels that are compared, row-major.
///
/// Metrics that compare pixels or windows treat the picture as if it existed only inside the mask, so a rectangular mask equals
/// a crop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    size: [u32; 2],
    included: Vec<bool>,
    count: usize,
}

impl Mask {
    /// A mask that is `true` for included pixels.
    ///
    /// # Errors
    /// [`MetricError::ValueCount`] unless there are `width · height` values.
    pub fn new(width: u32, height: u32, included: Vec<bool>) -> Result<Self, MetricError> {
        let expected = u64::from(width) * u64::from(height);
        if included.len() as u64 != expected {
            return Err(MetricError::ValueCount { what: "mask", expected, found: included.len() });
        }
        let count = included.iter().filter(|included| **included).count();
        Ok(Self { size: [width, height], included, count })
    }

    /// Width and height.
    pub const fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Row-major, `true` for included pixels.
    pub fn included(&self) -> &[bool] {
        &self.included
    }

    /// Number of included pixels.
    pub const fn count(&self) -> usize {
        self.count
    }

    /// For each square of side `2 · radius + 1` inside the picture, whether it is completely in the mask: row-major by centre,
    /// `width − 2 · radius` by `height − 2 · radius` values.
    pub(crate) fn windows_inside(&self, radius: usize) -> Vec<bool> {
        let [width, height] = self.size.map(|side| side as usize);
        let side = 2 * radius + 1;
        // Rows first, then columns: length of the run of included pixels that ends here.
        let mut run_right = vec![0usize; width * height];
        for (row, run) in self.included.chunks(width).zip(run_right.chunks_mut(width)) {
            let mut length = 0;
            for (included, run) in row.iter().zip(run) {
                length = if *included { length + 1 } else { 0 };
                *run = length;
            }
        }
        let (columns, rows) = ((width + 1).saturating_sub(side), (height + 1).saturating_sub(side));
        let mut run_down = vec![0usize; columns];
        let mut inside = Vec::with_capacity(columns * rows);
        for (row, run) in run_right.chunks(width).enumerate() {
            for (length, run) in run_down.iter_mut().zip(run.iter().skip(side - 1)) {
                *length = if *run >= side { *length + 1 } else { 0 };
            }
            if row + 1 >= side {
                inside.extend(run_down.iter().map(|length| *length >= side));
            }
        }
        inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rejects_a_wrong_number_of_values() {
        let error = Mask::new(3, 2, vec![true; 5]).unwrap_err();
        assert_eq!(error.to_string(), "mask: expected 6 values for its width and height, found 5");
    }

    proptest! {
        #[test]
        fn windows_inside_agree_with_checking_every_pixel(
            width in 1usize..12, height in 1usize..12, radius in 0usize..4, bits in prop::collection::vec(0u8..8, 144),
        ) {
            let included: Vec<bool> = bits.iter().take(width * height).map(|bits| *bits > 0).collect();
            let [w, h] = [width, height].map(|side| u32::try_from(side).unwrap());
            let found = Mask::new(w, h, included.clone()).unwrap().windows_inside(radius);
            let mut expected = Vec::new();
            for y in radius..height.saturating_sub(radius) {
                for x in radius..width.saturating_sub(radius) {
                    expected.push((y - radius..=y + radius).all(|y| (x - radius..=x + radius).all(|x| included[y * width + x])));
                }
            }
            prop_assert_eq!(found, expected);
        }
    }
}
