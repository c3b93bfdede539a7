//! One reflected ray from glossy surfaces, weighted by Schlick's Fresnel term, which is damped on dull ones as by roughness.

use super::SceneContext;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let world = scene.world;
    let glossy = world.objects.iter().filter(|object| world.materials[object.material].mirror > 0.0).count();
    (glossy > 0).then(|| format!("{glossy} of {} objects mirror", world.objects.len()))
}
