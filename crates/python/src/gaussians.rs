//! Gaussians from and to arrays and files.

use std::path::PathBuf;
use std::sync::Arc;

use atsplat_splat::files::{self, Output};
use atsplat_splat::{GaussianParts, MAX_SH_DEGREE, sh_coefficients};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::array::{floats, read_floats, read_rows};
use crate::error::Failure;
use crate::threads::work;

/// 3D Gaussians; `gaussians.py` documents their arrays.
#[pyclass(frozen, subclass, module = "atsplat._native")]
pub(crate) struct Gaussians(pub(crate) Arc<atsplat_splat::Gaussians>);

#[pymethods]
impl Gaussians {
    /// From the bytes of contiguous f32 arrays: means, quaternions, log-scales, opacity logits, harmonics and,
    /// where there are any, scalars and the 3D filter.
    #[staticmethod]
    #[pyo3(signature = (arrays, coefficients, scalars, filter_3d))]
    fn from_bytes(
        arrays: [Bound<'_, PyBytes>; 5],
        coefficients: usize,
        scalars: Option<Bound<'_, PyBytes>>,
        filter_3d: Option<Bound<'_, PyBytes>>,
    ) -> Result<Self, Failure> {
        let [means, quaternions, log_scales, opacity_logits, sh] = arrays;
        let degree = (0..=MAX_SH_DEGREE).find(|degree| sh_coefficients(*degree) == coefficients);
        let sh_degree = degree.ok_or_else(|| {
            Failure::invalid(
                "sh",
                format!("expected 1, 4, 9, 16 or 25 coefficients for each Gaussian, found {coefficients}"),
            )
        })?;
        let parts = GaussianParts {
            means: read_rows(means.as_bytes()),
            quaternions: read_rows(quaternions.as_bytes()),
            log_scales: read_rows(log_scales.as_bytes()),
            opacity_logits: read_floats(opacity_logits.as_bytes()),
            sh_degree,
            sh: read_rows(sh.as_bytes()),
            scalars: scalars.map(|scalars| read_floats(scalars.as_bytes())),
            filter_3d: filter_3d.map(|filter| read_floats(filter.as_bytes())),
        };
        Ok(Self(Arc::new(atsplat_splat::Gaussians::new(parts)?)))
    }

    /// Reads a file; also what a user should know about it.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf, opacities_as_stored: bool) -> Result<(Self, Vec<String>), Failure> {
        work(py, || {
            let (gaussians, import) = files::read(&path)?;
            let (gaussians, mut notes) = files::interpret(gaussians, &import, opacities_as_stored, &path)?;
            if import.antialiased == Some(true) {
                notes.push("trained with antialiasing: render it with antialiased=True".to_owned());
            }
            if !import.unused.is_empty() {
                notes.push(format!("unused fields of the file: {}", import.unused.join(", ")));
            }
            notes.extend(import.validation.findings.iter().map(ToString::to_string));
            Ok((Self(Arc::new(gaussians)), notes))
        })
    }

    /// Writes a file by its extension; returns notes on what its format cannot represent.
    fn write(&self, py: Python<'_>, path: PathBuf, antialiased: bool) -> Result<Vec<String>, Failure> {
        let output = Output::of_path(&path).map_err(|error| Failure::invalid("path", error))?;
        if antialiased && matches!(output, Output::Ply(_)) {
            return Err(Failure::invalid("antialiased", "expected a path that ends in .spz, found .ply"));
        }
        work(py, || Ok(files::write(&path, &self.0, output.with_antialiased(antialiased))?.warnings()))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[getter]
    fn sh_degree(&self) -> u8 {
        self.0.sh_degree()
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        floats(py, &[self.0.len(), 3], [self.0.parts().means.as_flattened()], |number| number)
    }

    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        floats(py, &[self.0.len(), 4], [self.0.parts().quaternions.as_flattened()], |number| number)
    }

    #[getter]
    fn log_scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        floats(py, &[self.0.len(), 3], [self.0.parts().log_scales.as_flattened()], |number| number)
    }

    #[getter]
    fn opacity_logits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        floats(py, &[self.0.len()], [self.0.parts().opacity_logits.as_slice()], |number| number)
    }

    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = [self.0.len(), sh_coefficients(self.0.sh_degree()), 3];
        floats(py, &shape, [self.0.parts().sh.as_flattened()], |number| number)
    }

    #[getter]
    fn scalars<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        optional_floats(py, self.0.parts().scalars.as_deref())
    }

    #[getter]
    fn filter_3d<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        optional_floats(py, self.0.parts().filter_3d.as_deref())
    }
}

fn optional_floats<'py>(py: Python<'py>, values: Option<&[f32]>) -> PyResult<Option<Bound<'py, PyAny>>> {
    values.map(|values| floats(py, &[values.len()], [values], |number| number)).transpose()
}
