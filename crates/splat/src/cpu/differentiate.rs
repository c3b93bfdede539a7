use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::backward::{Differentiate, Sums, TileGradient};
use super::kernel::{Paint, Render, Tile};
use super::project::Splat;
use super::{CpuRenderer, check_size, narrowed, project};
use crate::reference::SplatGradient;
use crate::reference::project::{self as geometry, Outcome};
use crate::reference::project_backward::{GaussianGradient, of_gaussian};
use crate::renderer::saturated;
use crate::view::Optics;
use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, SplatError, View};

/// Derivatives are summed over cells of this side, whatever the tiles for rendering are.
const CELL: u32 = 16;

impl CpuRenderer {
    /// Derivatives of a loss by everything that made the images, from its derivatives by the images. Needs no
    /// rendering before it.
    ///
    /// Sums over pixels have a fixed order: lanes of a cell of 16×16 pixels, then cells row by row. The result is
    /// the same for any number of threads; another instruction set may round differently.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`], and [`SplatError::Length`] for an image of another size than the view's.
    pub fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        images.check(view)?;
        options.check()?;
        let images = &*options.before_exposure(images, saturated);
        let optics = view.optics(&options.constants)?;
        check_size(view)?;
        self.check_memory(gaussians, view, options)?;
        project::project_all(gaussians, view, &optics, options, self.options.simd, &mut self.splats);
        let order = self.order.by_depth(&self.splats);
        self.tiles.fill(&self.splats, order, view.size, CELL)?;

        let extra = images.depth.is_some() || images.scalar.is_some();
        let background = options.background.map(narrowed);
        let paint = Paint { options, background, size: view.size, splats: &self.splats, extra };
        let (of_splats, by_background) = self.over_cells(&paint, images);
        let mut gradients = Gradients::zero(gaussians);
        gradients.background = by_background.map(saturated);
        over_gaussians(gaussians, view, &optics, options, (&self.splats, &of_splats), &mut gradients);
        Ok(gradients)
    }

    /// Derivatives by the splats, and by the background.
    fn over_cells(&self, paint: &Paint<'_>, images: &ImageGradients<f32>) -> (Vec<CellSum>, [f64; 3]) {
        let mut entries = vec![Sums::default(); self.tiles.entries()];
        let mut rest = entries.as_mut_slice();
        let mut cells = Vec::new();
        for (at, list) in self.tiles.all() {
            let (sums, after) = std::mem::take(&mut rest).split_at_mut(list.len());
            rest = after;
            cells.push((at, list, sums));
        }
        let simd = self.options.simd;
        let backgrounds: Vec<[f64; 3]> = cells
            .into_par_iter()
            .map_init(
                || (Tile::new(CELL), TileGradient::new(CELL)),
                |(tile, gradient), (at, list, sums)| {
                    simd.dispatch(Render { paint, list, at, tile });
                    let background = gradient.fill(tile, at, paint, images);
                    simd.dispatch(Differentiate { paint, list, at, side: CELL as usize, gradient, sums });
                    background
                },
            )
            .collect();
        let mut by_background = [0.0; 3];
        for background in backgrounds {
            for (sum, value) in by_background.iter_mut().zip(background) {
                *sum += value;
            }
        }
        let mut of_splats = vec![CellSum::default(); self.splats.len()];
        let listed = self.tiles.all().flat_map(|(_, list)| list);
        for (splat, sums) in listed.zip(&entries) {
            if let Some(total) = of_splats.get_mut(*splat as usize) {
                total.add(sums);
            }
        }
        (of_splats, by_background)
    }
}

/// [`Sums`] over all cells.
#[derive(Clone, Copy, Debug, Default)]
struct CellSum {
    e: f64,
    first: DVec2,
    second: DVec3,
    rgb: DVec3,
    depth: f64,
    scalar: f64,
}

impl CellSum {
    fn add(&mut self, sums: &Sums) {
        self.e += f64::from(sums.e);
        self.first += DVec2::from_array(sums.first.map(f64::from));
        self.second += DVec3::from_array(sums.second.map(f64::from));
        self.rgb += DVec3::from_array(sums.rgb.map(f64::from));
        self.depth += f64::from(sums.depth);
        self.scalar += f64::from(sums.scalar);
    }

    /// `½ dᵀ Σ⁻¹ d` by the centre is `−Σ⁻¹ d`, by the inverse covariance `½ dx²`, `dx·dy`, `½ dy²`; opacity times
    /// falloff by opacity is `−e` over it.
    fn by_splat(&self, splat: &geometry::Splat) -> SplatGradient {
        let DVec3 { x: a, y: b, z: c } = splat.conic;
        let DVec2 { x, y } = self.first;
        SplatGradient {
            centre: -DVec2::new(a * x + b * y, b * x + c * y),
            conic: self.second * DVec3::new(0.5, 1.0, 0.5),
            opacity: -self.e / splat.opacity,
            rgb: self.rgb,
            depth: self.depth,
            scalar: self.scalar,
        }
    }
}

/// Carries the splats' derivatives to the Gaussians and the pose, in f64.
fn over_gaussians(
    gaussians: &Gaussians,
    view: &View,
    optics: &Optics,
    options: &RenderOptions,
    (splats, of_splats): (&[Splat], &[CellSum]),
    gradients: &mut Gradients<f32>,
) {
    const AT_ONCE: usize = 8192;
    let one = |(splat, sum): (&Splat, &CellSum)| -> Option<(usize, GaussianGradient, SplatGradient)> {
        let position = splat.position as usize;
        match geometry::project(gaussians, position, optics, view.size, options) {
            Outcome::Drawn(splat) => {
                let of_splat = sum.by_splat(&splat);
                Some((position, of_gaussian(gaussians, optics, options, &splat, &of_splat), of_splat))
            }
            _ => None,
        }
    };
    let mut pose = [0.0f64; 6];
    for (splats, of_splats) in splats.chunks(AT_ONCE).zip(of_splats.chunks(AT_ONCE)) {
        let results: Vec<_> = splats.par_iter().zip(of_splats).map(one).collect();
        for (position, of_gaussian, of_splat) in results.into_iter().flatten() {
            gradients.put(position, &of_gaussian, &of_splat, saturated);
            for (sum, value) in pose.iter_mut().zip(of_gaussian.pose.iter().flat_map(DVec3::to_array)) {
                *sum += value;
            }
        }
    }
    gradients.pose = pose.map(saturated);
}
