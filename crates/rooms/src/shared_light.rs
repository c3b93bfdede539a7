//! Light of a frame by tiles, with the effects that a stretch of the clip calls for.
//!
//! Rays of a tile that start near each other and go the same way first find together the few objects that any of them can
//! hit. Where nothing can hide a lamp from a face, or one object always does, no shadow ray is cast. This changes no
//! picture. Samples of a pixel on one face share light, and what a weak mirror shows, where its first and last sample
//! nearly agree; this is what [`Stretch::shares`] turns off.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::RoomsError;
use crate::bundle::{Bundle, Candidates, Extent};
use crate::effects::place_on_lamp;
use crate::lamp::{Lamp, LampExtent};
use crate::plan::Stretch;
use crate::render::{CameraRay, Frame, Incidence};
use crate::world::{LEAVE, Surface};

/// Side of a tile, in pixels.
const TILE: u32 = 8;
/// Fewest samples on a face for which a search pays.
const WORTH: usize = 12;
/// Share of reflected light below which samples may share it.
const WEAK: f32 = 0.055;
/// The cosine between normals from which two points are on one face.
const FLAT: f64 = 1.0 - 1e-9;

/// Renders the light of a frame with the effects that a stretch of the clip calls for.
pub(crate) struct SharedLight<'a> {
    pub frame: &'a Frame<'a>,
    pub stretch: &'a Stretch,
}

/// The samples of a tile that hit one side of an object.
struct Face {
    object: usize,
    normal: DVec3,
    /// Whether all have this normal.
    flat: bool,
    count: usize,
    /// Where rays leave the face.
    leaving: Extent,
    /// Directions of reflection.
    bounced: Extent,
    /// What can hide each lamp, and be seen in the mirror; found when first needed.
    shades: Vec<Shades>,
    mirrors: Option<Candidates>,
}

/// What can hide a lamp from a face.
#[derive(Debug)]
enum Shades {
    /// Nothing, or it does not matter.
    Nothing,
    /// One object hides it from everywhere.
    Whole,
    /// Few objects.
    Among(Candidates),
    /// Any object.
    Any,
}

/// A sample's surface and its face's number.
struct Hit {
    surface: Surface,
    view: Incidence,
    face: usize,
}

impl Hit {
    /// Whether both lie on one flat face.
    fn is_beside(&self, other: &Self) -> bool {
        self.face == other.face && self.surface.normal.dot(other.surface.normal) > FLAT
    }
}

/// Ambient light and that of lamps that nothing hides.
#[derive(Clone, Copy)]
struct Sure {
    light: Vec3,
    /// Below this, the light of another lamp does not count.
    enough: f32,
}

/// Light from the direction of reflection.
#[derive(Clone, Copy)]
struct Mirrored {
    radiance: Vec3,
    /// The object that the mirror shows.
    shown: Option<usize>,
}

/// A quantity of a pixel's first and last sample, and of those between if both are close.
enum Shared<T> {
    Ends { first: T, last: T, between: Option<T> },
    Apart,
}

/// Which of a pixel's samples.
#[derive(Clone, Copy)]
enum Place {
    First,
    Last,
    /// Another one on the same face.
    Between,
    Elsewhere,
}

impl<T: Copy> Shared<T> {
    fn of(&self, place: Place) -> Option<T> {
        match (self, place) {
            (Self::Ends { first, .. }, Place::First) => Some(*first),
            (Self::Ends { last, .. }, Place::Last) => Some(*last),
            (Self::Ends { between, .. }, Place::Between) => *between,
            _ => None,
        }
    }
}

impl SharedLight<'_> {
    /// Linear light before exposure of the whole picture, row by row.
    pub(crate) fn light(&self) -> Result<Vec<Vec3>, RoomsError> {
        let (width, height) = (self.frame.size.width, self.frame.size.height);
        let bands = (0..height.div_ceil(TILE)).into_par_iter().map(|band| {
            let rows = band * TILE..((band + 1) * TILE).min(height);
            let mut light = vec![Vec3::ZERO; (rows.len()) * width as usize];
            for tile in 0..width.div_ceil(TILE) {
                let columns = tile * TILE..((tile + 1) * TILE).min(width);
                let pixels: Vec<[u32; 2]> =
                    rows.clone().flat_map(|row| columns.clone().map(move |column| [column, row])).collect();
                for (light_of, [column, row]) in self.tile(&pixels)?.into_iter().zip(&pixels) {
                    light[((row - rows.start) * width + column) as usize] = light_of;
                }
            }
            Ok(light)
        });
        Ok(bands.collect::<Result<Vec<_>, RoomsError>>()?.concat())
    }

    /// The light of a tile's pixels.
    fn tile(&self, pixels: &[[u32; 2]]) -> Result<Vec<Vec3>, RoomsError> {
        let frame = self.frame;
        let samples = frame.samples as usize;
        let mut rays: Vec<CameraRay> = Vec::with_capacity(pixels.len() * samples);
        let (mut origins, mut directions) = (Extent::EMPTY, Extent::EMPTY);
        for pixel in pixels {
            let plane = frame.pixel(pixel[0], pixel[1])?;
            for sample in 0..frame.samples {
                let ray = frame.ray(*pixel, plane, sample);
                origins.add(ray.origin);
                directions.add(ray.direction);
                rays.push(ray);
            }
        }
        let ahead = frame.world.candidates(&Bundle::new(origins, directions, f64::INFINITY), |_| true);
        let mut faces: Vec<Face> = Vec::new();
        let lamps = frame.world.lamps.len();
        let traced = |at: usize| frame.effects.shadowed() && self.stretch.shadows[at];
        let unknown = || (0..lamps).map(|at| if traced(at) { Shades::Any } else { Shades::Nothing }).collect();
        let hits: Vec<Option<Hit>> = rays
            .iter()
            .map(|ray| {
                let surface = frame.world.trace_among(&ahead, ray.origin, ray.direction)?;
                let view = Incidence::new(&surface, ray.direction, frame.spread);
                let face = face_of(&mut faces, &surface, &view, unknown);
                Some(Hit { surface, view, face })
            })
            .collect();
        self.prepare(&mut faces);
        Ok(rays.chunks(samples).zip(hits.chunks(samples)).map(|(rays, hits)| self.pixel(rays, hits, &faces)).collect())
    }

    /// Finds what can hide lamps from the larger faces, and what these can mirror.
    fn prepare(&self, faces: &mut [Face]) {
        let Frame { world, effects, .. } = *self.frame;
        for face in faces.iter_mut().filter(|face| face.count >= WORTH) {
            if effects.shadowed() {
                for (at, lamp) in world.lamps.iter().enumerate().filter(|(at, _)| self.stretch.shadows[*at]) {
                    face.shades[at] = self.shades(face, lamp);
                }
            }
            if face.flat && self.reflects(face.object) {
                let bundle = Bundle::new(face.leaving, face.bounced, f64::INFINITY);
                face.mirrors = Some(world.candidates(&bundle, |_| true));
            }
        }
    }

    fn reflects(&self, object: usize) -> bool {
        let Frame { world, effects, .. } = *self.frame;
        effects.mirrors && self.stretch.mirrors[world.objects[object].material]
    }

    /// The mean light of a pixel's samples. Where the first and the last agree, those between take their mean.
    fn pixel(&self, rays: &[CameraRay], hits: &[Option<Hit>], faces: &[Face]) -> Vec3 {
        let (mut sure, mut mirrored) = (Shared::Apart, Shared::Apart);
        if let (Some(Some(first)), Some(Some(last))) = (hits.first(), hits.last())
            && hits.len() > 2
            && first.is_beside(last)
        {
            let face = &faces[first.face];
            sure = self.shared_sure(self.sure(first, face), self.sure(last, face));
            if let (Some(a), Some(b)) = (self.mirrored(first, face), self.mirrored(last, face)) {
                mirrored = self.shared_mirrored(&sure, first, a, b);
            }
        }
        let mut sum = Vec3::ZERO;
        for (at, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            let Some(hit) = hit else {
                sum += self.frame.sky(ray);
                continue;
            };
            let face = &faces[hit.face];
            let place = if at == 0 {
                Place::First
            } else if at + 1 == hits.len() {
                Place::Last
            } else if hits[0].as_ref().is_some_and(|first| first.is_beside(hit)) {
                Place::Between
            } else {
                Place::Elsewhere
            };
            let sure = sure.of(place).unwrap_or_else(|| self.sure(hit, face));
            let mirrored = mirrored.of(place).or_else(|| self.mirrored(hit, face));
            sum += self.outgoing(ray, hit, face, &sure, mirrored.map(|mirrored| mirrored.radiance));
        }
        sum / hits.len() as f32
    }

    /// Ambient light and that of lamps that nothing hides.
    fn sure(&self, hit: &Hit, face: &Face) -> Sure {
        let Frame { world, effects, .. } = *self.frame;
        let surface = &hit.surface;
        let ambient = effects.ambient(world, surface.point, surface.normal);
        let enough = ambient.max_element() * 0.01;
        let mut light = ambient;
        for (lamp, _) in world.lamps.iter().zip(&face.shades).filter(|(_, shades)| matches!(shades, Shades::Nothing)) {
            let reached = lamp.reaches(surface.point, surface.normal);
            if reached.max_element() > enough {
                light += reached;
            }
        }
        Sure { light, enough }
    }

    /// What a mirror shows; `None` for a matte surface.
    fn mirrored(&self, hit: &Hit, face: &Face) -> Option<Mirrored> {
        let world = self.frame.world;
        let (surface, view) = (&hit.surface, &hit.view);
        self.reflects(surface.object).then(|| {
            let shown = match &face.mirrors {
                Some(candidates) => world.trace_among(candidates, surface.leave(), view.bounced),
                None => world.trace(surface.leave(), view.bounced),
            };
            let radiance = self.frame.mirrored(shown.as_ref(), view);
            Mirrored { radiance, shown: shown.map(|shown| shown.object) }
        })
    }

    fn shared_sure(&self, a: Sure, b: Sure) -> Shared<Sure> {
        let apart = (a.light - b.light).abs().max_element();
        let mean = Sure { light: (a.light + b.light) * 0.5, enough: a.enough };
        let between = (apart <= self.stretch.closeness() * a.light.max_element()).then_some(mean);
        Shared::Ends { first: a, last: b, between }
    }

    fn shared_mirrored(&self, sure: &Shared<Sure>, first: &Hit, a: Mirrored, b: Mirrored) -> Shared<Mirrored> {
        let white = sure.of(Place::First).map_or(0.0, |sure| sure.light.max_element());
        let fresnel = first.view.fresnel(self.frame.world.material(&first.surface));
        let apart = (a.radiance - b.radiance).abs().max_element() * fresnel;
        let mean = Mirrored { radiance: (a.radiance + b.radiance) * 0.5, ..a };
        // Compared with the light of a surface of albedo 0.1. The sky may hide a window's bars between both.
        let alike = a.shown.is_some() && a.shown == b.shown;
        let near = fresnel < WEAK && alike && apart <= 0.1 * self.stretch.closeness() * white;
        Shared::Ends { first: a, last: b, between: near.then_some(mean) }
    }

    /// Light towards the camera.
    fn outgoing(&self, ray: &CameraRay, hit: &Hit, face: &Face, sure: &Sure, mirrored: Option<Vec3>) -> Vec3 {
        let world = self.frame.world;
        let Hit { surface, view, .. } = hit;
        let mut arriving = sure.light;
        for (lamp, shades) in
            world.lamps.iter().zip(&face.shades).filter(|(_, shades)| matches!(shades, Shades::Among(_) | Shades::Any))
        {
            let reached = lamp.reaches(surface.point, surface.normal);
            if reached.max_element() > sure.enough {
                let from = surface.leave();
                let to_lamp = lamp.towards(from, place_on_lamp(ray.dice));
                let blocked = match shades {
                    Shades::Among(shades) => world.blocked_among(shades, from, to_lamp),
                    _ => world.blocked(from, to_lamp),
                };
                if !blocked {
                    arriving += reached;
                }
            }
        }
        let material = world.material(surface);
        let diffuse = material.albedo(&surface.texture_point(view.footprint)) * arriving + material.emission;
        mirrored.map_or(diffuse, |mirrored| {
            let fresnel = view.fresnel(material);
            diffuse * (1.0 - fresnel) + mirrored * fresnel
        })
    }

    /// What can hide a lamp from a face.
    fn shades(&self, face: &Face, lamp: &Lamp) -> Shades {
        let world = self.frame.world;
        let from = face.leaving;
        // Most lamps behind a face are recognised here, without a search.
        let reaches = |point: DVec3| lamp.reaches(point, face.normal).max_element() > 0.0;
        if face.flat && ![from.low, from.high, (from.low + from.high) * 0.5].into_iter().any(reaches) {
            return Shades::Any;
        }
        let (directions, to, height) = match lamp.extent() {
            LampExtent::Near(to) => {
                let directions = Extent { low: to.low - from.high, high: to.high - from.low };
                (directions, to, to.along(face.normal)[0] - from.along(face.normal)[1])
            }
            LampExtent::Far(directions) => {
                let to = Extent { low: from.low + directions.low, high: from.high + directions.high };
                (directions, to, directions.along(face.normal)[0])
            }
        };
        // Towards a lamp above the face's plane, nothing below it is in the way.
        let above = face.flat && height > 0.0;
        let ground = from.along(face.normal)[0] - 0.5 * LEAVE;
        let keep = |at: usize| {
            let object = &world.objects[at];
            !above || Extent::around(object.centre, object.half_extent()).along(face.normal)[1] > ground
        };
        let found = world.candidates(&Bundle::new(from, directions, 1.0), keep);
        if found.is_empty() {
            Shades::Nothing
        } else if found.objects().any(|at| world.objects[at].separates(&from, &to)) {
            Shades::Whole
        } else {
            Shades::Among(found)
        }
    }
}

/// The number of a surface's face; `fresh` is what can hide lamps from a small one.
fn face_of(faces: &mut Vec<Face>, surface: &Surface, view: &Incidence, fresh: impl Fn() -> Vec<Shades>) -> usize {
    let near = |face: &Face| face.object == surface.object && face.normal.dot(surface.normal) > 0.9;
    let number = faces.iter().position(near).unwrap_or_else(|| {
        faces.push(Face {
            object: surface.object,
            normal: surface.normal,
            flat: true,
            count: 0,
            leaving: Extent::EMPTY,
            bounced: Extent::EMPTY,
            shades: fresh(),
            mirrors: None,
        });
        faces.len() - 1
    });
    let face = &mut faces[number];
    face.flat &= face.normal.dot(surface.normal) > FLAT;
    face.count += 1;
    face.leaving.add(surface.leave());
    face.bounced.add(view.bounced);
    number
}
