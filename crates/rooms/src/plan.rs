//! What `auto` runs, decided by a pilot: a few small pictures along the path, with and without each effect that traces rays.
//!
//! Shadows of a lamp, or reflections of a material, are left out of a stretch of the path only on evidence: the pilot
//! pictures at its ends show them often enough, and nowhere with more than half the tolerance. Samples share light only
//! where the pilot pictures rendered that way stay close to the complete ones.

use std::ops::Range;

use atsplat_camera::ImageSize;
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::effects::{EffectKind, Effects, TOLERANCE};
use crate::material::srgb_encoded;
use crate::path::Shot;
use crate::render::{Frame, exposed};
use crate::shared_light::SharedLight;
use crate::world::World;
use crate::{RoomsError, noise};

/// A part of the path and what runs in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Stretch {
    /// Its frames; the end is exclusive.
    pub frames: Range<usize>,
    /// Whether shadow rays run towards each of the world's lamps.
    pub shadows: Vec<bool>,
    /// Number of the world's glossy materials, and how many of them reflect.
    pub glossy: usize,
    /// See [`Self::glossy`].
    pub reflecting: usize,
    /// Whether samples of a pixel share light that hardly differs between them.
    pub shares: bool,
    /// Largest change of a pilot pixel without each effect, as a share of white.
    pub differences: Vec<Difference>,
    #[serde(skip)]
    pub(crate) mirrors: Vec<bool>,
}

/// What an effect changes in the pilot's pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The effect.
    pub effect: EffectKind,
    /// Largest change of a displayed value, as a share of white.
    pub largest: f32,
    /// Share of the pilot's pixels that change by more than the tolerance.
    pub share: f64,
}

impl Stretch {
    /// Largest relative difference of light that samples of a pixel share: half the tolerance, at white, through the
    /// encoding's exponent of 1/2.4.
    pub(crate) fn closeness(&self) -> f32 {
        if self.shares { noise::as_f32(0.5 * TOLERANCE * 2.4) } else { 0.0 }
    }

    /// Whether any lamp has shadows, any material reflects.
    pub(crate) fn runs(&self, effect: EffectKind) -> bool {
        match effect {
            EffectKind::SoftShadows => self.shadows.contains(&true),
            EffectKind::SpecularReflection => self.reflecting > 0,
            _ => true,
        }
    }
}

/// Size of the pilot's pictures.
const PILOT: ImageSize = ImageSize { width: 32, height: 32 };
/// Largest number of stretches.
const STRETCHES: usize = 4;
/// Fewest pilot pixels that are evidence.
const EVIDENCE: usize = 64;
/// Largest share of a pilot picture's pixels that sharing may change by more than two tolerances. A pilot pixel is eight
/// times as wide as one of a picture of 256, and its samples lie as much further apart.
const ASTRAY: f64 = 0.05;

/// What one pilot picture shows.
struct Pilot {
    /// Pixels that a lamp lights, or a material fills, and the largest change without its shadow or its reflection.
    lamps: Vec<(usize, f32)>,
    materials: Vec<(usize, f32)>,
    /// Changes without shadows, reflection and indirect light, pixel by pixel.
    changes: [Vec<f32>; 3],
    shares: bool,
}

const COSTLY: [EffectKind; 3] = [EffectKind::SoftShadows, EffectKind::SpecularReflection, EffectKind::IndirectLight];

/// Plans a clip.
pub(crate) fn plan(
    world: &World,
    effects: &Effects,
    shots: &[Shot],
    samples: u32,
    gain: f32,
) -> Result<Vec<Stretch>, RoomsError> {
    let last = shots.len() - 1;
    let parts = STRETCHES.min(last).max(1);
    let ends: Vec<usize> = (0..=parts).map(|part| part * last / parts).collect();
    let pilots = ends.par_iter().map(|&at| pilot(world, effects, &shots[at], samples, gain));
    let pilots = pilots.collect::<Result<Vec<_>, _>>()?;
    let stretch = |part: usize| {
        let ends_of = &pilots[part..part + 2];
        let needed = |read: &dyn Fn(&Pilot) -> (usize, f32)| {
            let seen: usize = ends_of.iter().map(|pilot| read(pilot).0).sum();
            let change = ends_of.iter().map(|pilot| read(pilot).1).fold(0.0, larger);
            seen < EVIDENCE || f64::from(change) > 0.5 * TOLERANCE
        };
        let shadows: Vec<bool> = (0..world.lamps.len()).map(|at| needed(&|pilot| pilot.lamps[at])).collect();
        let glossy = |at: usize| world.materials[at].mirror > 0.0;
        let mirrors: Vec<bool> =
            (0..world.materials.len()).map(|at| glossy(at) && needed(&|pilot| pilot.materials[at])).collect();
        let differences = COSTLY.iter().enumerate().map(|(which, &effect)| {
            let changes = || ends_of.iter().flat_map(|pilot| &pilot.changes[which]).copied();
            let beyond = changes().filter(|change| f64::from(*change) > TOLERANCE).count();
            let share = beyond as f64 / changes().count() as f64;
            Difference { effect, largest: changes().fold(0.0, larger), share }
        });
        let past = if part + 1 == parts { shots.len() } else { ends[part + 1] };
        Stretch {
            frames: ends[part]..past,
            shadows,
            glossy: (0..world.materials.len()).filter(|at| glossy(*at)).count(),
            reflecting: mirrors.iter().filter(|reflects| **reflects).count(),
            shares: ends_of.iter().all(|pilot| pilot.shares),
            differences: differences.collect(),
            mirrors,
        }
    };
    Ok((0..parts).map(stretch).collect())
}

fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The largest difference of two lights as they are displayed.
fn displayed_change(a: Vec3, b: Vec3, gain: f32) -> f32 {
    let display = |light: Vec3| exposed(light, gain).map(srgb_encoded);
    (display(a) - display(b)).abs().max_element()
}

fn pilot(world: &World, effects: &Effects, shot: &Shot, samples: u32, gain: f32) -> Result<Pilot, RoomsError> {
    let frame = Frame::new(world, effects, shot, PILOT, 1)?;
    let mut pilot = Pilot {
        lamps: vec![(0, 0.0); world.lamps.len()],
        materials: vec![(0, 0.0); world.materials.len()],
        changes: [Vec::new(), Vec::new(), Vec::new()],
        shares: shares(world, effects, shot, samples, gain)?,
    };
    let note = |seen: &mut (usize, f32), change: f32| *seen = (seen.0 + 1, larger(seen.1, change));
    for pixel in (0..PILOT.height).flat_map(|row| (0..PILOT.width).map(move |column| [column, row])) {
        let ray = frame.ray(pixel, frame.pixel(pixel[0], pixel[1])?, 0);
        let Some(parts) = frame.parts(&ray) else {
            pilot.changes.iter_mut().for_each(|changes| changes.push(0.0));
            continue;
        };
        let complete = parts.light();
        let change = |other: Vec3| displayed_change(complete, other, gain);
        let mut shadows = 0.0;
        for (lamp, reached, visible) in &parts.lamps {
            let lit = parts.with_arriving(parts.arriving() + *reached * (1.0 - visible));
            let change = change(lit);
            note(&mut pilot.lamps[*lamp], change);
            shadows = larger(shadows, change);
        }
        let matte = change(parts.diffuse());
        if parts.mirrored.is_some() {
            note(&mut pilot.materials[parts.material], matte);
        }
        let uniform = change(parts.with_arriving(parts.arriving() - parts.ambient + world.ambient));
        for (changes, change) in pilot.changes.iter_mut().zip([shadows, matte, uniform]) {
            changes.push(change);
        }
    }
    Ok(pilot)
}

/// Whether sharing light between samples stays close to the complete picture.
fn shares(world: &World, effects: &Effects, shot: &Shot, samples: u32, gain: f32) -> Result<bool, RoomsError> {
    let frame = Frame::new(world, effects, shot, PILOT, samples)?;
    let everything = Stretch {
        frames: 0..0,
        shadows: vec![true; world.lamps.len()],
        glossy: 0,
        reflecting: 0,
        shares: true,
        differences: Vec::new(),
        mirrors: world.materials.iter().map(|material| material.mirror > 0.0).collect(),
    };
    let shared = SharedLight { frame: &frame, stretch: &everything }.light()?;
    let complete = frame.light()?;
    let changes = complete.iter().zip(&shared).map(|(a, b)| displayed_change(*a, *b, gain));
    let astray = changes.filter(|change| f64::from(*change) > 2.0 * TOLERANCE).count();
    Ok(astray as f64 <= ASTRAY * complete.len() as f64)
}
