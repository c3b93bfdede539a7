//! Shadows with penumbrae: each sample tests one point of each lamp.

use glam::DVec2;

use super::SceneContext;
use crate::lamp::Lamp;
use crate::world::{Surface, World};

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let (lamps, objects) = (scene.world.lamps.len(), scene.world.objects.len());
    (lamps > 0).then(|| format!("{lamps} lamps among {objects} objects"))
}

/// Share of a lamp that a surface sees; `place` is the point of the lamp to test, in [0, 1)².
pub(super) fn visibility(world: &World, lamp: &Lamp, surface: &Surface, place: DVec2) -> f32 {
    let from = surface.leave();
    let to_lamp = lamp.towards(from, place);
    if world.blocked(from, to_lamp) { 0.0 } else { 1.0 }
}
