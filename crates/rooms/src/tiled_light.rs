//! Light of a frame by tiles, to the bit that of [`Frame::light`].
//!
//! Rays of a tile that start near each other and go the same way first find together the few objects that any of them can
//! hit. Where nothing can hide a lamp from a face, or one object always does, no shadow ray is cast.

use std::iter;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::RoomsError;
use crate::lamp::{Lamp, LampExtent};
use crate::ray_packet::{Candidates, Extent, RayPacket};
use crate::render::{CameraRay, Frame, Incidence};
use crate::world::{RAY_OFFSET, Surface};

/// Side of a tile, in pixels.
const TILE: u32 = 8;
/// Smallest number of samples on a face for which a search saves time.
const MIN_SEARCHED: usize = 12;
/// The cosine between normals from which two points are on one face.
const FLAT: f64 = 1.0 - 1e-9;

/// Renders the light of a frame.
pub(crate) struct TiledLight<'a> {
    pub frame: &'a Frame<'a>,
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
    /// What can hide each lamp, and be seen in the mirror; searched for larger faces.
    shades: Vec<Shades>,
    mirrors: Option<Candidates>,
}

/// What can hide a lamp from a face.
#[derive(Debug)]
enum Shades {
    /// Nothing, or shadows do not run.
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

impl TiledLight<'_> {
    /// Linear light before exposure of the whole image, row by row.
    pub(crate) fn light(&self) -> Result<Vec<Vec3>, RoomsError> {
        let (width, height) = (self.frame.size.width, self.frame.size.height);
        let bands = (0..height.div_ceil(TILE)).into_par_iter().map(|band| {
            let rows = band * TILE..((band + 1) * TILE).min(height);
            let mut light = vec![Vec3::ZERO; rows.len() * width as usize];
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
        let ahead = frame.world.candidates(&RayPacket::new(origins, directions, f64::INFINITY), |_| true);
        let mut faces: Vec<Face> = Vec::new();
        let lamps = frame.world.lamps.len();
        let unknown = || {
            let shades = || if frame.effects.shadowed() { Shades::Any } else { Shades::Nothing };
            iter::repeat_with(shades).take(lamps).collect()
        };
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

    /// Finds what can hide lamps from the larger faces and what these can mirror.
    fn prepare(&self, faces: &mut [Face]) {
        let Frame { world, effects, .. } = *self.frame;
        for face in faces.iter_mut().filter(|face| face.count >= MIN_SEARCHED) {
            if effects.shadowed() {
                for (at, lamp) in world.lamps.iter().enumerate() {
                    face.shades[at] = self.shades(face, lamp);
                }
            }
            if face.flat && self.reflects(face.object) {
                let packet = RayPacket::new(face.leaving, face.bounced, f64::INFINITY);
                face.mirrors = Some(world.candidates(&packet, |_| true));
            }
        }
    }

    fn reflects(&self, object: usize) -> bool {
        let Frame { world, effects, .. } = *self.frame;
        effects.mirrors && world.materials[world.objects[object].material].mirror > 0.0
    }

    /// The mean light of a pixel's samples.
    fn pixel(&self, rays: &[CameraRay], hits: &[Option<Hit>], faces: &[Face]) -> Vec3 {
        let light = rays.iter().zip(hits).map(|(ray, hit)| match hit {
            Some(hit) => self.outgoing(ray, hit, &faces[hit.face]),
            None => self.frame.sky(ray),
        });
        light.sum::<Vec3>() / hits.len() as f32
    }

    /// Light towards the camera.
    fn outgoing(&self, ray: &CameraRay, hit: &Hit, face: &Face) -> Vec3 {
        let world = self.frame.world;
        let Hit { surface, view, .. } = hit;
        let material = world.material(surface);
        let arriving = self.arriving(ray, surface, face);
        let diffuse = material.albedo(&surface.texture_point(view.footprint)) * arriving + material.emission;
        if !self.reflects(surface.object) {
            return diffuse;
        }
        let shown = match &face.mirrors {
            Some(candidates) => world.trace_among(candidates, surface.leave(), view.bounced),
            None => world.trace(surface.leave(), view.bounced),
        };
        let fresnel = view.fresnel(material);
        diffuse * (1.0 - fresnel) + self.frame.mirrored(shown.as_ref(), view) * fresnel
    }

    /// Light that arrives at a surface.
    fn arriving(&self, ray: &CameraRay, surface: &Surface, face: &Face) -> Vec3 {
        let Frame { world, effects, .. } = *self.frame;
        let ambient = effects.ambient(world, surface.point, surface.normal);
        let enough = ambient.max_element() * 0.01;
        let mut arriving = ambient;
        for (lamp, shades) in
            world.lamps.iter().zip(&face.shades).filter(|(_, shades)| !matches!(shades, Shades::Whole))
        {
            let reached = lamp.reaches(surface.point, surface.normal);
            if reached.max_element() > enough && !self.hidden(ray, surface, lamp, shades) {
                arriving += reached;
            }
        }
        arriving
    }

    /// Whether anything hides a sample's point of a lamp.
    fn hidden(&self, ray: &CameraRay, surface: &Surface, lamp: &Lamp, shades: &Shades) -> bool {
        let world = self.frame.world;
        let towards = || (surface.leave(), lamp.towards(surface.leave(), ray.place_on_lamps));
        match shades {
            Shades::Nothing => false,
            Shades::Whole => true,
            Shades::Among(shades) => {
                let (from, to_lamp) = towards();
                world.blocked_among(shades, from, to_lamp)
            }
            Shades::Any => {
                let (from, to_lamp) = towards();
                world.blocked(from, to_lamp)
            }
        }
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
        let ground = from.along(face.normal)[0] - 0.5 * RAY_OFFSET;
        let keep = |at: usize| {
            let object = &world.objects[at];
            !above || Extent::around(object.centre, object.half_extent()).along(face.normal)[1] > ground
        };
        let found = world.candidates(&RayPacket::new(from, directions, 1.0), keep);
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

#[cfg(test)]
mod tests {
    use atsplat_camera::ImageSize;

    use super::*;
    use crate::{EffectChoice, EffectKind, Request, SceneKind, SceneSeed, Simulation, Split};

    /// The oracle traces each ray through the whole tree and casts every shadow ray. Sides are not multiples of a tile's.
    #[test]
    fn tiles_give_the_same_bits_as_single_rays() {
        let size = ImageSize { width: 75, height: 53 };
        let mut lit = 0;
        for number in 0..12 {
            let kind = if number % 2 == 0 { SceneKind::Rooms } else { SceneKind::Yards };
            let choices = [
                EffectChoice::All,
                EffectChoice::None,
                EffectChoice::Only(vec![EffectKind::SoftShadows, EffectKind::SpecularReflection]),
            ];
            for effects in choices {
                let seed = SceneSeed { split: Split::Test, number };
                let request = Request { effects, size, samples: 3, ..Request::new(kind, seed) };
                let simulation = Simulation::new(request).unwrap();
                let frame = simulation.frame(40, &simulation.effects).unwrap();
                let shot = simulation.shot(40).unwrap();
                let plain = Frame::new(&simulation.world, &simulation.effects, shot, size, 3).unwrap().light().unwrap();
                let tiled = TiledLight { frame: &frame }.light().unwrap();
                let bits =
                    |light: &[Vec3]| light.iter().map(|light| light.to_array().map(f32::to_bits)).collect::<Vec<_>>();
                assert!(bits(&tiled) == bits(&plain), "{simulation}");
                lit += tiled.iter().filter(|light| light.element_sum() > 0.0).count();
            }
        }
        assert!(lit > 75 * 53 * 30, "only {lit} pixels have light");
    }
}
