//! Procedural materials: albedo as a function of texture coordinates. Colours are linear RGB.
//!
//! Every pattern takes the pixel's footprint and fades or widens detail that a pixel cannot resolve, so that visible detail
//! is sharp and the rest does not flicker between views. Tiles, boards, fabrics, stone and text keep their mean colour.

mod colour;
mod fabric;
mod print;
mod tiling;

use glam::{Vec2, Vec3};

pub(crate) use colour::{from_hsv, srgb_encoded};

use crate::noise::{faded, fractal_noise};

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TexturePoint {
    /// Surface coordinates, in metres.
    pub uv: Vec2,
    /// Position in the object's frame, in metres.
    pub local: Vec3,
    /// Width of a pixel at the point, in metres.
    pub footprint: f32,
}

/// How albedo varies over a surface. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pattern {
    /// One colour, like textureless walls.
    Plain(Vec3),
    /// Two colours mixed by fractal noise: plaster, concrete, carpet, grass, gravel, bark.
    Grain { a: Vec3, b: Vec3, feature: f32, octaves: u32 },
    /// Veins of folded noise.
    Marble { a: Vec3, b: Vec3, feature: f32 },
    /// Staggered boards with grain.
    Planks { a: Vec3, b: Vec3, width: f32, length: f32 },
    /// Tiles, bricks or slabs of slightly different colours in grout; each row is shifted by a share of a tile.
    Tiles { a: Vec3, b: Vec3, grout: Vec3, size: Vec2, gap: f32, shift: f32 },
    /// Two alternating colours along u.
    Stripes { a: Vec3, b: Vec3, period: f32 },
    /// Squares.
    Checks { a: Vec3, b: Vec3, period: f32 },
    /// A lattice of flowers.
    Motif { a: Vec3, b: Vec3, period: f32 },
    /// Woven threads.
    Weave { a: Vec3, b: Vec3, period: f32 },
    /// A painting that fills a panel with these half sides.
    Painting { half: Vec2 },
    /// Lines of glyphs on a panel with these half sides.
    Text { ink: Vec3, paper: Vec3, half: Vec2, line: f32 },
    /// Spines of books along u.
    Books { height: f32 },
}

/// Material of a surface: albedo, specular reflection and emission.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Material {
    pub pattern: Pattern,
    /// Specular reflectance at normal incidence; 0 for a matte surface.
    pub mirror: f32,
    /// Emitted radiance.
    pub emission: Vec3,
    /// Seed that distinguishes surfaces with the same pattern.
    pub seed: u32,
}

impl Material {
    pub(crate) const fn matte(pattern: Pattern, seed: u32) -> Self {
        Self { pattern, mirror: 0.0, emission: Vec3::ZERO, seed }
    }

    /// Linear albedo, in [0, 1].
    pub(crate) fn albedo(&self, spot: &TexturePoint) -> Vec3 {
        let TexturePoint { uv, footprint, .. } = *spot;
        let colour = match self.pattern {
            Pattern::Plain(colour) => return colour,
            Pattern::Grain { a, b, feature, octaves } => {
                let n = fractal_noise(spot.local / feature, octaves, footprint / feature, self.seed);
                a.lerp(b, (0.5 + 0.9 * n).clamp(0.0, 1.0))
            }
            Pattern::Marble { a, b, feature } => {
                let n = fractal_noise(spot.local / feature, 6, footprint / feature, self.seed);
                // Veins are about a third as wide as a feature, and fade to their share before the noise does.
                a.lerp(b, faded((1.0 - 6.0 * n.abs()).clamp(0.0, 1.0), 0.285, feature / 3.0, footprint))
            }
            Pattern::Planks { a, b, width, length } => tiling::planks([a, b], width, length, spot, self.seed),
            Pattern::Tiles { a, b, grout, size, gap, shift } => {
                tiling::tiles([a, b, grout], size, gap, shift, spot, self.seed)
            }
            Pattern::Stripes { a, b, period } => fabric::stripes(a, b, uv.x / period, footprint / period),
            Pattern::Checks { a, b, period } => fabric::checks(a, b, uv / period, footprint / period),
            Pattern::Motif { a, b, period } => fabric::motif(a, b, uv / period, footprint / period),
            Pattern::Weave { a, b, period } => fabric::weave(a, b, uv / period, footprint / period, self.seed),
            Pattern::Painting { half } => print::painting(uv, half, footprint, self.seed),
            Pattern::Text { ink, paper, half, line } => print::text([ink, paper], uv, half, line, footprint, self.seed),
            Pattern::Books { height } => print::books(uv, height, footprint, self.seed),
        };
        colour.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::noise::as_f32;
    use crate::rng::Rng;

    fn all() -> Vec<Pattern> {
        let (a, b, grout) = (Vec3::new(0.8, 0.3, 0.1), Vec3::new(0.1, 0.2, 0.4), Vec3::splat(0.5));
        let (size, half) = (Vec2::new(0.2, 0.1), Vec2::new(0.5, 0.4));
        vec![
            Pattern::Plain(a),
            Pattern::Grain { a, b, feature: 0.05, octaves: 5 },
            Pattern::Marble { a, b, feature: 0.3 },
            Pattern::Planks { a, b, width: 0.12, length: 1.2 },
            Pattern::Tiles { a, b, grout, size, gap: 0.01, shift: 0.5 },
            Pattern::Stripes { a, b, period: 0.1 },
            Pattern::Checks { a, b, period: 0.1 },
            Pattern::Motif { a, b, period: 0.3 },
            Pattern::Weave { a, b, period: 0.02 },
            Pattern::Painting { half },
            Pattern::Text { ink: b, paper: a, half, line: 0.05 },
            Pattern::Books { height: 0.3 },
        ]
    }

    /// The standard deviation of the albedo over a panel, for a small and a large footprint.
    #[test]
    fn patterns_stay_in_range_vary_and_fade_with_distance() {
        for pattern in all() {
            let material = Material::matte(pattern, 11);
            let spread = |footprint: f32| {
                let mut rng = Rng::new(3);
                let samples: Vec<f64> = (0..2000)
                    .map(|_| {
                        #[expect(clippy::cast_possible_truncation, reason = "a place on a panel")]
                        let uv = Vec2::new(rng.within(-0.5, 0.5) as f32, rng.within(-0.4, 0.4) as f32);
                        let colour = material.albedo(&TexturePoint { uv, local: uv.extend(0.01), footprint });
                        assert!(
                            colour.cmpge(Vec3::ZERO).all() && colour.cmple(Vec3::ONE).all(),
                            "{pattern:?}: {colour}"
                        );
                        f64::from(colour.x)
                    })
                    .collect();
                let mean = samples.iter().sum::<f64>() / 2000.0;
                (samples.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / 2000.0).sqrt()
            };
            let (near, far) = (spread(0.0005), spread(3.0));
            match pattern {
                Pattern::Plain(_) => Tolerance::F32_ROUND_TRIP.assert([near], [0.0], "one colour"),
                // Large shapes of a painting remain visible.
                Pattern::Painting { .. } => assert!(near > 0.02, "{pattern:?} shows nothing: {near}"),
                _ => assert!(near > 0.02 && far < 0.6 * near, "{pattern:?}: {near} near, {far} far"),
            }
        }
    }

    /// The mean of red over a panel with these half sides.
    fn mean(material: &Material, half: Vec2, footprint: f32) -> f64 {
        let mut rng = Rng::new(7);
        let mut place = || as_f32(rng.within(-1.0, 1.0));
        let red = (0..20_000).map(|_| {
            let uv = half * Vec2::new(place(), place());
            f64::from(material.albedo(&TexturePoint { uv, local: uv.extend(place()), footprint }).x)
        });
        red.sum::<f64>() / 20_000.0
    }

    /// From pixels that show every detail to pixels that are wider than the pattern. The shares are those of the shapes drawn.
    #[test]
    fn patterns_keep_their_mean_with_distance() {
        let (a, b, wide, page) = (Vec3::ZERO, Vec3::ONE, Vec2::splat(3.0), Vec2::new(0.5, 0.4));
        let size = Vec2::new(0.2, 0.1);
        let boards = (1.0 - 0.003 / 0.05) * (1.0 - 0.003 / 0.5);
        let cases = [
            (Pattern::Tiles { a: b, b, grout: a, size, gap: 0.01, shift: 0.5 }, wide, 0.95 * 0.9),
            (Pattern::Planks { a: b, b, width: 0.05, length: 0.5 }, wide, 0.4 + 0.6 * boards),
            (Pattern::Planks { a, b, width: 0.05, length: 0.5 }, wide, 0.5 * (0.4 + 0.6 * boards)),
            (Pattern::Stripes { a, b, period: 0.1 }, wide, 0.5),
            (Pattern::Checks { a, b, period: 0.1 }, wide, 0.5),
            (Pattern::Motif { a, b, period: 0.3 }, wide, 0.265),
            (Pattern::Marble { a, b, feature: 0.3 }, wide, 0.285),
            (Pattern::Text { ink: b, paper: a, half: page, line: 0.05 }, page, 0.09),
        ];
        for (pattern, half, expected) in cases {
            for footprint in [0.0005, 0.02, 0.05, 0.09, 3.0] {
                let found = mean(&Material::matte(pattern, 11), half, footprint);
                Tolerance::absolute(0.015).assert([found], [expected], &format!("{pattern:?} at {footprint}"));
            }
        }
    }

    /// Grain of 90 and of 15 features per metre across a board is gone where a pixel is wider than a feature, and not before.
    #[test]
    fn grain_of_boards_fades_at_its_own_width() {
        let boards = Material::matte(Pattern::Planks { a: Vec3::ZERO, b: Vec3::ONE, width: 0.12, length: 3.0 }, 11);
        let at = |x: f32, y: f32, footprint: f32| {
            f64::from(boards.albedo(&TexturePoint { uv: Vec2::new(x, y), local: Vec3::ZERO, footprint }).x)
        };
        let fine = |footprint: f32| {
            let bends = (0..60u8).map(|step| {
                let (x, half) = (0.03 + 0.001 * f32::from(step), 0.5 / 90.0);
                let [before, here, after] = [x - half, x, x + half].map(|x| at(x, 0.37, footprint));
                (before - 2.0 * here + after).abs()
            });
            bends.sum::<f64>() / 60.0
        };
        assert!(fine(0.001) > 0.05 && fine(0.0112) < 0.01, "{} near, {} far", fine(0.001), fine(0.0112));
        for step in 0..20u8 {
            let y = 0.1 + 0.05 * f32::from(step);
            Tolerance::absolute(1e-5).assert([at(0.04, y, 0.07)], [at(0.08, y, 0.07)], "on both sides of the middle");
        }
    }
}
