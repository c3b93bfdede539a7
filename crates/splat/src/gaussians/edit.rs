use super::{GaussianParts, Gaussians, LOGIT_OF_INFINITY, sh_coefficients};
use crate::SplatError;

impl Gaussians {
    /// The Gaussians at these indices, in this order; an index may repeat.
    ///
    /// # Errors
    /// [`SplatError::Position`] for an index out of range.
    pub fn select(&self, positions: &[usize]) -> Result<Self, SplatError> {
        if let Some(&found) = positions.iter().find(|position| **position >= self.len()) {
            return Err(SplatError::Position { found, len: self.len() });
        }
        Ok(self.picked(positions))
    }

    /// [`Self::select`] for indices known to be in range.
    pub(super) fn picked(&self, positions: &[usize]) -> Self {
        let parts = self.parts();
        let coefficients = sh_coefficients(parts.sh_degree);
        let sh = positions
            .iter()
            .flat_map(|position| parts.sh.iter().skip(position * coefficients).take(coefficients).copied())
            .collect();
        Self(GaussianParts {
            means: picked(&parts.means, positions),
            quaternions: picked(&parts.quaternions, positions),
            log_scales: picked(&parts.log_scales, positions),
            opacity_logits: picked(&parts.opacity_logits, positions),
            sh_degree: parts.sh_degree,
            sh,
            scalars: parts.scalars.as_ref().map(|values| picked(values, positions)),
            filter_3d: parts.filter_3d.as_ref().map(|values| picked(values, positions)),
        })
    }

    /// Concatenates both sets, `self` first, at the higher of the two SH degrees; missing coefficients, scalars and
    /// filters are zero.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        let degree = if other.sh_degree() > self.sh_degree() { other.sh_degree() } else { self.sh_degree() };
        let counts = (self.len(), other.len());
        let (first, second) = (self.with_sh_degree(degree).into_parts(), other.with_sh_degree(degree).into_parts());
        Self(GaussianParts {
            means: joined(first.means, second.means),
            quaternions: joined(first.quaternions, second.quaternions),
            log_scales: joined(first.log_scales, second.log_scales),
            opacity_logits: joined(first.opacity_logits, second.opacity_logits),
            sh_degree: degree,
            sh: joined(first.sh, second.sh),
            scalars: joined_optional(first.scalars, second.scalars, counts),
            filter_3d: joined_optional(first.filter_3d, second.filter_3d, counts),
        })
    }

    /// The same Gaussians with another SH degree, at most [`super::MAX_SH_DEGREE`]: coefficients are truncated or
    /// padded with zeros.
    #[must_use]
    pub fn with_sh_degree(self, degree: u8) -> Self {
        let degree = degree.min(super::MAX_SH_DEGREE);
        if degree == self.sh_degree() {
            return self;
        }
        let (old, new) = (sh_coefficients(self.sh_degree()), sh_coefficients(degree));
        let mut parts = self.into_parts();
        parts.sh = parts
            .sh
            .chunks_exact(old)
            .flat_map(|of_one| of_one.iter().copied().chain(std::iter::repeat([0.0; 3])).take(new))
            .collect();
        parts.sh_degree = degree;
        Self(parts)
    }

    /// Reinterprets the stored logits as opacities in [0, 1], as pixelSplat's PLY exporter writes them; 0 and 1 become
    /// logits of ±[`LOGIT_OF_INFINITY`], values outside become NaN.
    #[must_use]
    pub fn with_linear_opacities(self) -> Self {
        let mut parts = self.into_parts();
        for logit in &mut parts.opacity_logits {
            *logit = (*logit / (1.0 - *logit)).ln().clamp(-LOGIT_OF_INFINITY, LOGIT_OF_INFINITY);
        }
        Self(parts)
    }
}

fn picked<T: Copy>(values: &[T], positions: &[usize]) -> Vec<T> {
    positions.iter().filter_map(|position| values.get(*position).copied()).collect()
}

fn joined<T>(mut first: Vec<T>, second: Vec<T>) -> Vec<T> {
    first.extend(second);
    first
}

fn joined_optional(first: Option<Vec<f32>>, second: Option<Vec<f32>>, counts: (usize, usize)) -> Option<Vec<f32>> {
    if first.is_none() && second.is_none() {
        return None;
    }
    let zeros = |count| vec![0.0; count];
    Some(joined(first.unwrap_or_else(|| zeros(counts.0)), second.unwrap_or_else(|| zeros(counts.1))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two(degree: u8) -> Gaussians {
        let coefficients = sh_coefficients(degree);
        Gaussians::new(GaussianParts {
            means: vec![[0.0; 3], [1.0; 3]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[-1.0; 3], [-2.0; 3]],
            opacity_logits: vec![0.5, 1.5],
            sh_degree: degree,
            sh: (0..2 * coefficients).map(|n| [n as f32; 3]).collect(),
            scalars: None,
            filter_3d: None,
        })
        .unwrap()
    }

    #[test]
    fn select_undoes_merge() {
        let (low, mut high) = (two(0), two(1).into_parts());
        high.scalars = Some(vec![7.0, 8.0]);
        let high = Gaussians::new(high).unwrap();
        let both = low.clone().merge(high.clone());
        assert_eq!((both.len(), both.sh_degree()), (4, 1));
        assert_eq!(both.parts().scalars, Some(vec![0.0, 0.0, 7.0, 8.0]));
        assert_eq!(both.select(&[2, 3]).unwrap(), high);
        let first = both.select(&[0, 1]).unwrap().with_sh_degree(0);
        assert_eq!(first.parts().sh, low.parts().sh);
        assert_eq!(first.parts().means, low.parts().means);
    }

    #[test]
    fn rejects_indices_out_of_range() {
        assert!(matches!(two(0).select(&[0, 2]), Err(SplatError::Position { found: 2, len: 2 })));
    }

    #[test]
    fn the_error_names_the_array_of_wrong_length() {
        let mut parts = two(1).into_parts();
        parts.sh.pop();
        let error = Gaussians::new(parts).unwrap_err();
        assert_eq!(error.to_string(), "Gaussians: sh has 7 entries, expected 8");
    }

    #[test]
    fn converts_stored_opacities_to_logits() {
        let mut parts = two(0).into_parts();
        parts.opacity_logits = vec![0.75, 1.0];
        let logits = Gaussians::new(parts).unwrap().with_linear_opacities().into_parts().opacity_logits;
        assert_eq!(logits, [3.0f32.ln(), 20.0]);
    }

    #[test]
    fn arrays_that_do_not_change_are_not_copied() {
        let gaussians = two(1);
        let arrays = |of: &Gaussians| (of.parts().means.as_ptr(), of.parts().sh.as_ptr());
        let before = arrays(&gaussians);
        let same = gaussians.with_sh_degree(1).with_linear_opacities();
        assert_eq!(arrays(&same), before);
        assert_eq!(arrays(&same.with_sh_degree(0)).0, before.0, "without the upper coefficients");
        let merged = two(2).merge(two(1));
        let before = arrays(&merged);
        let (clean, _) = merged.into_cleaned(crate::Cleaning::Repair);
        assert_eq!((clean.sh_degree(), clean.len(), arrays(&clean)), (2, 4, before));
    }

    #[test]
    fn size_in_bytes_counts_every_array() {
        assert_eq!(two(0).size_in_bytes(), 2 * 14 * 4);
        assert_eq!(two(3).size_in_bytes(), 2 * 59 * 4);
    }
}
