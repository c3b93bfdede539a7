//! One mirrored ray from surfaces that are not matt, by Schlick's Fresnel term.

use super::{Case, Effect, EffectKind};

#[derive(Debug)]
pub(super) struct SpecularReflection;

pub(super) fn called_for(case: &Case<'_>) -> Option<String> {
    let world = case.world;
    let is_glossy =
        |object: &&crate::form::Object| world.materials.get(object.material).is_some_and(|m| m.mirror > 0.0);
    let glossy = world.objects.iter().filter(is_glossy).count();
    (glossy > 0).then(|| format!("{glossy} of {} objects mirror", world.objects.len()))
}

impl Effect for SpecularReflection {
    fn kind(&self) -> EffectKind {
        EffectKind::SpecularReflection
    }

    fn mirrors(&self) -> bool {
        true
    }
}
