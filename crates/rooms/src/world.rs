use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::bvh::Bvh;
use crate::lamp::Lamp;
use crate::material::{Material, TexturePoint};
use crate::ray_packet::{Candidates, RayPacket};
use crate::shape::{HitPoint, Object, RaySegment, Shape};
use crate::sky::Sky;

/// Contents of a scene. Metres, z up.
#[derive(Clone, Debug)]
pub(crate) struct World {
    pub objects: Vec<Object>,
    pub materials: Vec<Material>,
    pub lamps: Vec<Lamp>,
    pub sky: Sky,
    /// Uniform ambient light, for points without indirect light.
    pub ambient: Vec3,
    /// Corners of the space in which a camera may be placed.
    pub space: [DVec3; 2],
    /// Corners of the spaces that walls divide; indirect light of one does not count in another.
    pub interiors: Vec<[DVec3; 2]>,
    bvh: Bvh,
}

/// A surface hit by a ray.
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
    /// The texture coordinates for a pixel `footprint` metres wide at the surface.
    pub(crate) fn texture_point(&self, footprint: f32) -> TexturePoint {
        TexturePoint { uv: self.uv.as_vec2(), local: self.local.as_vec3(), footprint }
    }

    /// Origin of rays that leave the surface.
    pub(crate) fn leave(&self) -> DVec3 {
        self.point + self.normal * RAY_OFFSET
    }
}

/// Offset of rays that leave a surface, in metres.
pub(crate) const RAY_OFFSET: f64 = 1e-5;

impl World {
    /// The nearest surface along a unit direction.
    pub(crate) fn trace(&self, origin: DVec3, direction: DVec3) -> Option<Surface> {
        let ray = RaySegment::new(origin, direction, RAY_OFFSET, f64::INFINITY);
        self.bvh.closest(&self.objects, &ray).map(|hit| self.surface(&ray, hit))
    }

    /// As [`Self::trace`], for a ray whose possible hits are known.
    pub(crate) fn trace_among(&self, candidates: &Candidates, origin: DVec3, direction: DVec3) -> Option<Surface> {
        let ray = RaySegment::new(origin, direction, RAY_OFFSET, f64::INFINITY);
        candidates.closest(&self.bvh, &self.objects, &ray).map(|hit| self.surface(&ray, hit))
    }

    fn surface(&self, &RaySegment { origin, direction, .. }: &RaySegment, (distance, object): (f64, usize)) -> Surface {
        let instance = self.objects[object].instance;
        let point = origin + direction * distance;
        let HitPoint { normal: outward, local, uv } = self.objects[object].hit_point(point);
        let normal = if outward.dot(direction) > 0.0 { -outward } else { outward };
        Surface { distance, point, normal, object, instance, uv, local }
    }

    /// Whether anything is between `point` and `point + offset`.
    pub(crate) fn blocked(&self, point: DVec3, offset: DVec3) -> bool {
        let nearest = RAY_OFFSET / offset.length();
        self.bvh.blocked(&self.objects, &RaySegment::new(point, offset, nearest, 1.0))
    }

    /// As [`Self::blocked`], for a ray whose possible hits are known.
    pub(crate) fn blocked_among(&self, candidates: &Candidates, point: DVec3, offset: DVec3) -> bool {
        if candidates.is_empty() {
            return false;
        }
        let nearest = RAY_OFFSET / offset.length();
        candidates.blocked(&self.bvh, &self.objects, &RaySegment::new(point, offset, nearest, 1.0))
    }

    /// What the rays of a packet can hit; objects that `keep` excludes are known not to be hit.
    pub(crate) fn candidates(&self, packet: &RayPacket, keep: impl Fn(usize) -> bool) -> Candidates {
        Candidates::new(&self.bvh, packet, keep)
    }

    /// Distance to the nearest surface; not positive inside a solid.
    pub(crate) fn clearance(&self, point: DVec3) -> f64 {
        let distances = self.objects.iter().map(|object| object.distance(point));
        distances.fold(f64::INFINITY, |least, distance| if distance < least { distance } else { least })
    }

    pub(crate) fn material(&self, surface: &Surface) -> &Material {
        &self.materials[self.objects[surface.object].material]
    }
}

/// Builds a world instance by instance.
#[derive(Debug)]
pub(crate) struct Builder {
    objects: Vec<Object>,
    materials: Vec<Material>,
    pub lamps: Vec<Lamp>,
    instance: u32,
    /// Pose of the current instance in the world.
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

    /// Starts another instance at `origin`, rotated about the vertical.
    pub(crate) fn instance(&mut self, origin: DVec3, yaw: f64) {
        self.instance += 1;
        (self.origin, self.turn) = (origin, DMat3::from_rotation_z(yaw));
    }

    /// Adds a material and returns its index.
    pub(crate) fn material(&mut self, material: Material) -> usize {
        self.materials.push(material);
        self.materials.len() - 1
    }

    /// Adds a shape at a position in the instance's frame.
    pub(crate) fn put(&mut self, shape: Shape, centre: DVec3, material: usize) {
        self.put_turned(shape, centre, DMat3::IDENTITY, material);
    }

    /// Adds a shape with a pose in the instance's frame.
    pub(crate) fn put_turned(&mut self, shape: Shape, centre: DVec3, turn: DMat3, material: usize) {
        let (world_from_local, centre) = (self.turn * turn, self.to_world(centre));
        self.objects.push(Object::new(shape, world_from_local, centre, material, self.instance));
    }

    /// Adds a box between two corners in the instance's frame.
    pub(crate) fn block(&mut self, low: DVec3, high: DVec3, material: usize) {
        self.put(Shape::Box((high - low) * 0.5), (low + high) * 0.5, material);
    }

    pub(crate) fn to_world(&self, local: DVec3) -> DVec3 {
        self.origin + self.turn * local
    }

    /// The world of these objects; `space` is its only interior.
    pub(crate) fn finish(self, sky: Sky, ambient: Vec3, space: [DVec3; 2]) -> World {
        let bvh = Bvh::new(&self.objects);
        let Self { objects, materials, lamps, .. } = self;
        World { objects, materials, lamps, sky, ambient, space, interiors: vec![space], bvh }
    }
}
