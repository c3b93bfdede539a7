//! Renders Gaussians.

use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Channels, RasterMode, RenderOptions, RendererConstants, Rendering};
use pyo3::prelude::*;

use crate::array::floats;
use crate::camera::{Numbers, view};
use crate::error::Failure;
use crate::gaussians::Gaussians;
use crate::threads::work;

/// Images of views of one size: colour (N × H × W × 3), alpha and, if requested, composited depth (N × H × W); and the most Gaussians
/// that one of the views leaves out as invalid.
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    gaussians: &Gaussians,
    cameras: Vec<Numbers>,
    background: [f64; 3],
    constants: &str,
    antialiased: bool,
    depth: bool,
) -> Result<(Vec<Bound<'py, PyAny>>, u64), Failure> {
    let constants = RendererConstants::named(constants).ok_or_else(|| {
        let known = RendererConstants::PRESETS.join(", ");
        Failure::invalid("constants", format!("expected one of {known}, found {constants:?}"))
    })?;
    let options = RenderOptions {
        constants,
        background,
        mode: if antialiased { RasterMode::Antialiased } else { RasterMode::Classic },
        channels: Channels { depth, ..Channels::default() },
        ..RenderOptions::default()
    };
    let renderings: Vec<Rendering<f32>> = work(py, || {
        let views = cameras.iter().map(view).collect::<Result<Vec<_>, _>>()?;
        Ok(CpuRenderer::default().render_many(&gaussians.0, &views, &options)?)
    })?;
    let (width, height) = cameras.first().map_or((0, 0), |(.., width, height)| (*width as usize, *height as usize));
    let plane = [renderings.len(), height, width];
    let [count, height, width] = plane;
    let same = |number| number;
    let colour = renderings.iter().map(|rendering| rendering.rgb.as_flattened());
    let mut images = vec![floats(py, &[count, height, width, 3], colour, same)?];
    images.push(floats(py, &plane, renderings.iter().map(|rendering| rendering.alpha.as_slice()), same)?);
    if depth {
        let composited = renderings.iter().filter_map(|rendering| rendering.depth.as_deref());
        images.push(floats(py, &plane, composited, same)?);
    }
    let invalid = renderings.iter().map(|rendering| rendering.census.invalid).max();
    Ok((images, invalid.unwrap_or(0)))
}
