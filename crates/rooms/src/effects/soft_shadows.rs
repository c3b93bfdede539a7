//! Shadows with penumbrae: each sample tests one point of each lamp.

use glam::DVec2;

use super::{Effect, EffectKind, SceneContext};
use crate::lamp::Lamp;
use crate::world::{Surface, World};

#[derive(Debug)]
pub(super) struct SoftShadows;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let (lamps, objects) = (scene.world.lamps.len(), scene.world.objects.len());
    (lamps > 0).then(|| format!("{lamps} lamps among {objects} objects"))
}

impl Effect for SoftShadows {
    fn kind(&self) -> EffectKind {
        EffectKind::SoftShadows
    }

    fn visibility(&self, world: &World, lamp: &Lamp, surface: &Surface, place: DVec2) -> Option<f32> {
        let from = surface.leave();
        let to_lamp = lamp.towards(from, place);
        Some(if world.blocked(from, to_lamp) { 0.0 } else { 1.0 })
    }
}
