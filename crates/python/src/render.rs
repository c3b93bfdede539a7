//! Renders Gaussians.

use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Channels, RasterMode, RenderOptions, RendererConstants, Rendering, View};
use pyo3::prelude::*;

use crate::array::floats;
use crate::camera::{Numbers, view};
use crate::error::Failure;
use crate::gaussians::Gaussians;
use crate::threads::work;

/// Views that are rendered together; Ctrl-C is looked for in between.
const VIEWS: usize = 8;

/// Constants of a rasterizer by name.
pub(crate) fn constants_named(name: &str) -> Result<RendererConstants, Failure> {
    RendererConstants::named(name).ok_or_else(|| {
        let known = RendererConstants::listed_presets();
        Failure::invalid("constants", format!("expected one of {known}, found {name:?}"))
    })
}

/// Images of views of one size (colour N × H × W × 3, alpha and, if requested, composited depth N × H × W), the most Gaussians that one of
/// the views leaves out as invalid, and a remark on spherical harmonics that the constants do not evaluate, or not as published.
type Rendered<'py> = (Vec<Bound<'py, PyAny>>, u64, Option<String>);

/// Renders Gaussians from cameras.
#[pyfunction]
pub(crate) fn render<'py>(
    py: Python<'py>,
    gaussians: &Gaussians,
    cameras: Vec<Numbers>,
    background: [f64; 3],
    constants: &str,
    antialiased: bool,
    depth: bool,
) -> Result<Rendered<'py>, Failure> {
    let options = RenderOptions {
        constants: constants_named(constants)?,
        background,
        mode: if antialiased { RasterMode::Antialiased } else { RasterMode::Classic },
        channels: Channels { depth, ..Channels::default() },
        ..RenderOptions::default()
    };
    let views = cameras.iter().map(view).collect::<Result<Vec<View>, _>>()?;
    let mut renderer = CpuRenderer::default();
    let mut renderings: Vec<Rendering<f32>> = work(py, || Ok(renderer.render_many(&gaussians.0, &[], &options)?))?;
    for some in views.chunks(VIEWS) {
        renderings.extend(work(py, || Ok(renderer.render_many(&gaussians.0, some, &options)?))?);
        py.check_signals()?;
    }
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
    let invalid = renderings.iter().map(|rendering| rendering.counts.invalid).max();
    let remarks = [options.ignored_harmonics(&gaussians.0), options.differing_harmonics(&gaussians.0)];
    let remarks: Vec<String> = remarks.into_iter().flatten().collect();
    Ok((images, invalid.unwrap_or(0), (!remarks.is_empty()).then(|| remarks.join("; "))))
}
