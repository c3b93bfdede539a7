//! The arrays of a checkpoint.

use std::path::Path;

use atsplat_files::Sha256Digest;
use atsplat_splat::{GaussianParts, sh_coefficients};
use atsplat_tensors::{DType, StoredTensors};

use super::wrong;
use crate::corrections::Corrections;
use crate::{FitError, OptimisedGaussians};

/// Parameters and Adam's moments: the first parts of the names of [`arrays`].
pub(super) const PARTS: [&str; 3] = ["value", "first-moment", "second-moment"];

/// The arrays of Gaussians, by name.
pub(super) fn arrays(parts: &GaussianParts) -> [(&'static str, &[f32]); 5] {
    debug_assert_eq!(
        parts.sh.len(),
        parts.means.len() * sh_coefficients(parts.sh_degree),
        "coefficients of every Gaussian"
    );
    [
        ("means", parts.means.as_flattened()),
        ("quaternions", parts.quaternions.as_flattened()),
        ("log-scales", parts.log_scales.as_flattened()),
        ("opacity-logits", &parts.opacity_logits),
        ("sh", parts.sh.as_flattened()),
    ]
}

/// The tensors of a file, and the bytes of those that were read, in order.
pub(super) struct Tensors<'a> {
    stored: &'a StoredTensors,
    path: &'a Path,
    read: Vec<&'a [u8]>,
}

impl<'a> Tensors<'a> {
    pub(super) const fn new(stored: &'a StoredTensors, path: &'a Path) -> Self {
        Self { stored, path, read: Vec::new() }
    }

    /// Hash of what was read so far, in this order.
    pub(super) fn digest(&self) -> String {
        Sha256Digest::of_parts(self.read.iter().copied()).to_string()
    }

    pub(super) fn scene(&mut self, sh_degree: u8, is_filtered: bool) -> Result<OptimisedGaussians, FitError> {
        let mut scene = OptimisedGaussians::default();
        let OptimisedGaussians { parts, first_moments, second_moments } = &mut scene;
        for (part, parts) in PARTS.into_iter().zip([parts, first_moments, second_moments]) {
            parts.sh_degree = sh_degree;
            let mut named = |name: &str| self.singles(&format!("{part}/{name}"));
            parts.means = rows(&named("means")?);
            parts.quaternions = rows(&named("quaternions")?);
            parts.log_scales = rows(&named("log-scales")?);
            parts.opacity_logits = named("opacity-logits")?;
            parts.sh = rows(&named("sh")?);
        }
        scene.parts.filter_3d = is_filtered.then(|| self.singles("filter-3d")).transpose()?;
        Ok(scene)
    }

    pub(super) fn corrections(&mut self) -> Result<Corrections, FitError> {
        let names = Corrections::default().arrays().map(|(name, _)| name);
        let [values, first, second] = names.map(|name| self.singles(name));
        Ok(Corrections { values: rows(&values?), first_moments: rows(&first?), second_moments: rows(&second?) })
    }

    pub(super) fn singles(&mut self, name: &str) -> Result<Vec<f32>, FitError> {
        Ok(self.bytes(name, DType::F32)?.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    pub(super) fn doubles(&mut self, name: &str) -> Result<Vec<f64>, FitError> {
        Ok(self.bytes(name, DType::F64)?.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }

    fn bytes(&mut self, name: &str, dtype: DType) -> Result<&'a [u8], FitError> {
        let stored = self.stored.tensors.get(name);
        let Some(tensor) = stored.filter(|tensor| tensor.dtype() == dtype) else {
            let found = stored.map_or_else(|| "none".to_owned(), ToString::to_string);
            return Err(wrong(self.path, name, &format!("a tensor of {dtype}"), found));
        };
        self.read.push(tensor.bytes());
        Ok(tensor.bytes())
    }
}

fn rows<const N: usize>(values: &[f32]) -> Vec<[f32; N]> {
    values.as_chunks::<N>().0.to_vec()
}
