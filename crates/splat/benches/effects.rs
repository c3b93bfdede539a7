//! Unneeded effects cost nothing: times a bare request, and one with effects that change nothing, alternately.
//!
//! An argument selects a single variant, so that `perf stat` can count its instructions.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

mod scene;

use std::hint::black_box;
use std::io::Write as _;
use std::time::Instant;

use atsplat_camera::{Distortion, ImageSize};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{EffectPlan, EffectSelection};
use atsplat_splat::{Channels, Exposure, GaussianParts, Gaussians, RenderOptions, Rendering, View};
use scene::scene;

/// Few enough Gaussians that a round finishes before the scheduler interrupts it; SH coefficients above degree 0 and
/// scalars are all zero.
fn flat_scene(degree: u8) -> (Gaussians, View) {
    let (gaussians, view) = scene(16_384, ImageSize { width: 96, height: 96 }, 0);
    let scalars = Some(vec![0.0; gaussians.len()]);
    let parts = GaussianParts { scalars, ..gaussians.with_sh_degree(degree).into_parts() };
    (Gaussians::new(parts).expect("Gaussians"), view)
}

/// Alternates the variants, so that other load on the machine affects all of them equally.
fn main() {
    const ROUNDS: usize = 200;
    let only = std::env::args().skip(1).find(|word| !word.starts_with("--"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for degree in [0, 3] {
        let (gaussians, view) = flat_scene(degree);
        let variants: Vec<Variant> =
            variants(view).into_iter().filter(|own| only.as_ref().is_none_or(|only| own.name == only)).collect();
        let mut renderer = CpuRenderer::default();
        let mut times = vec![Vec::with_capacity(ROUNDS); variants.len()];
        for _ in 0..ROUNDS {
            for (variant, times) in variants.iter().zip(&mut times) {
                let start = Instant::now();
                pool.install(|| black_box(variant.render(&mut renderer, &gaussians)));
                times.push(1e3 * start.elapsed().as_secs_f64());
            }
        }
        let mut out = std::io::stdout().lock();
        for (variant, mut times) in variants.iter().zip(times) {
            times.sort_by(f64::total_cmp);
            let (least, middle) = (times.first().expect("rounds"), times.get(ROUNDS / 2).expect("rounds"));
            writeln!(out, "degree {degree}, {:<28} least {least:7.2} ms, median {middle:7.2} ms", variant.name)
                .expect("a line");
        }
    }
}

/// What to render, and whether to plan first.
struct Variant {
    name: &'static str,
    view: View,
    options: RenderOptions,
    selection: Option<EffectSelection>,
}

impl Variant {
    fn render(&self, renderer: &mut CpuRenderer, gaussians: &Gaussians) -> Rendering<f32> {
        let Some(selection) = &self.selection else {
            return renderer.render(gaussians, &self.view, &self.options).expect("an image");
        };
        let plan = EffectPlan::for_scene(gaussians, &self.view, &self.options, selection, EffectPlan::TOLERANCE);
        plan.expect("a plan").render(renderer, gaussians).expect("an image")
    }
}

fn variants(view: View) -> Vec<Variant> {
    let bare = RenderOptions { max_sh_degree: 0, ..RenderOptions::default() };
    let without_effect = RenderOptions {
        exposure: Some(Exposure::IDENTITY),
        channels: Channels { scalar: true, ..Channels::default() },
        ..RenderOptions::default()
    };
    let mut zero_lens = view;
    zero_lens.camera.distortion = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let variant =
        |name, view, options: &RenderOptions, selection| Variant { name, view, options: options.clone(), selection };
    vec![
        variant("bare", view, &bare, None),
        variant("bare-auto", view, &bare, Some(EffectSelection::Auto)),
        variant("in-vain-auto", zero_lens, &without_effect, Some(EffectSelection::Auto)),
        variant("in-vain-all", zero_lens, &without_effect, Some(EffectSelection::All)),
    ]
}
