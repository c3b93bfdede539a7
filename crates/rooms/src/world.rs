use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::bvh::Bvh;
use crate::form::{Form, Object, RaySegment};
use crate::lamp::Lamp;
use crate::material::{Material, Spot};
use crate::sky::Sky;

/// Everything that a scene holds, before anything looks at it. Metres, z up.
#[derive(Clone, Debug)]
pub(crate) struct World {
    pub objects: Vec<Object>,
    pub materials: Vec<Material>,
    pub lamps: Vec<Lamp>,
    pub sky: Sky,
    /// Light that comes from everywhere, where nothing better is known.
    pub ambient: Vec3,
    /// Corners of the space in which a camera may stand.
    pub space: [DVec3; 2],
    bvh: Bvh,
}

/// What a ray met.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub distance: f64,
    pub point: DVec3,
    /// Unit normal on the ray's side.
    pub normal: DVec3,
    pub object: usize,
    pub instance: u32,
    uv: DVec2,
    local: DVec3,
}

impl Surface {
    /// The place for a pixel `footprint` metres wide there.
    pub(crate) fn spot(&self, footprint: f32) -> Spot {
        Spot { uv: self.uv.as_vec2(), local: self.local.as_vec3(), footprint }
    }

    /// Where rays leave it.
    pub(crate) fn leave(&self) -> DVec3 {
        self.point + self.normal * LEAVE
    }
}

/// Rays that leave a surface start this far along, in metres.
pub(crate) const LEAVE: f64 = 1e-5;

impl World {
    /// The nearest surface along a unit direction.
    pub(crate) fn trace(&self, origin: DVec3, direction: DVec3) -> Option<Surface> {
        let ray = RaySegment::new(origin, direction, LEAVE, f64::INFINITY);
        let (distance, object) = self.bvh.closest(&self.objects, &ray)?;
        let held = self.objects.get(object)?;
        let point = origin + direction * distance;
        let touch = held.touch(point);
        let normal = if touch.normal.dot(direction) > 0.0 { -touch.normal } else { touch.normal };
        let (instance, uv, local) = (held.instance, touch.uv, touch.local);
        Some(Surface { distance, point, normal, object, instance, uv, local })
    }

    /// Whether anything stands between a point and `point + way`.
    pub(crate) fn blocked(&self, point: DVec3, way: DVec3) -> bool {
        let nearest = LEAVE / way.length();
        self.bvh.blocked(&self.objects, &RaySegment::new(point, way, nearest, 1.0))
    }

    /// Distance to the nearest surface; not positive inside a solid.
    pub(crate) fn clearance(&self, point: DVec3) -> f64 {
        let distances = self.objects.iter().map(|object| object.distance(point));
        distances.fold(f64::INFINITY, |least, distance| if distance < least { distance } else { least })
    }

    pub(crate) fn material(&self, surface: &Surface) -> Option<&Material> {
        self.materials.get(self.objects.get(surface.object)?.material)
    }
}

/// Puts a world together thing by thing.
#[derive(Debug)]
pub(crate) struct Builder {
    objects: Vec<Object>,
    materials: Vec<Material>,
    pub lamps: Vec<Lamp>,
    instance: u32,
    /// Where things are put: a frame within the world.
    turn: DMat3,
    origin: DVec3,
}

impl Builder {
    pub(crate) const fn new() -> Self {
        Self {
            objects: Vec::new(),
            materials: Vec::new(),
            lamps: Vec::new(),
            instance: 0,
            turn: DMat3::IDENTITY,
            origin: DVec3::ZERO,
        }
    }

    /// Begins another thing of the scene, at `origin` and turned about the vertical.
    pub(crate) fn thing(&mut self, origin: DVec3, yaw: f64) {
        self.instance += 1;
        (self.origin, self.turn) = (origin, DMat3::from_rotation_z(yaw));
    }

    /// Takes a material in.
    pub(crate) fn material(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// A form at a place in the thing's frame.
    pub(crate) fn put(&mut self, form: Form, centre: DVec3, material: usize) {
        self.put_turned(form, centre, DMat3::IDENTITY, material);
    }

    /// A form at a place in the thing's frame, turned within it.
    pub(crate) fn put_turned(&mut self, form: Form, centre: DVec3, turn: DMat3, material: usize) {
        let (world_from_local, centre) = (self.turn * turn, self.to_world(centre));
        self.objects.push(Object::new(form, world_from_local, centre, material, self.instance));
    }

    /// A box between two corners of the thing's frame.
    pub(crate) fn block(&mut self, low: DVec3, high: DVec3, material: usize) {
        self.put(Form::Box((high - low) * 0.5), (low + high) * 0.5, material);
    }

    pub(crate) fn to_world(&self, local: DVec3) -> DVec3 {
        self.origin + self.turn * local
    }

    pub(crate) fn finish(self, sky: Sky, ambient: Vec3, space: [DVec3; 2]) -> World {
        let bvh = Bvh::new(&self.objects);
        let Self { objects, materials, lamps, .. } = self;
        World { objects, materials, lamps, sky, ambient, space, bvh }
    }
}
