//! Rays that start near each other and go the same way: together they find the few objects that any of them can hit.

use glam::{DVec3, Vec4};

use crate::bvh::{Bvh, Node, OBJECT, Slabs, WIDTH, limit};
use crate::shape::{Object, RaySegment};

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    pub low: DVec3,
    pub high: DVec3,
}

impl Extent {
    pub(crate) const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    pub(crate) fn around(centre: DVec3, half: DVec3) -> Self {
        Self { low: centre - half, high: centre + half }
    }

    pub(crate) fn add(&mut self, point: DVec3) {
        (self.low, self.high) = (self.low.min(point), self.high.max(point));
    }

    /// The smallest and the largest product of a vector with a point of the box.
    pub(crate) fn along(&self, vector: DVec3) -> [f64; 2] {
        let (a, b) = (self.low * vector, self.high * vector);
        [a.min(b).element_sum(), a.max(b).element_sum()]
    }
}

/// All rays `origin + t · direction` with an origin in one box, a direction in another, and `t` from 0 to `farthest`.
///
/// At each `t` the rays' points fill a box, whose sides move linearly: whether it ever touches another box is a slab test.
pub(crate) struct RayPacket {
    /// Per axis, where the lower and the upper side start, and the inverse of their change with `t`.
    sides: [[(Vec4, Vec4); 2]; 3],
    /// Whether each side moves upwards.
    rises: [[bool; 2]; 3],
    farthest: f32,
}

impl RayPacket {
    pub(crate) fn new(origins: Extent, directions: Extent, farthest: f64) -> Self {
        let (o, d) = ([origins.low, origins.high], [directions.low, directions.high]);
        // Zero would give 0 · ∞ on a box's own plane.
        let safe = |d: f64| if d.abs() < 1e-15 { 1e-15f64.copysign(d) } else { d };
        let side = |axis: usize, at: usize| (as_vec4(o[at][axis]), as_vec4(1.0 / safe(d[at][axis])));
        let sides = [0, 1, 2].map(|axis| [0, 1].map(|at| side(axis, at)));
        let rises = [0, 1, 2].map(|axis| [0, 1].map(|at| safe(d[at][axis]) > 0.0));
        // Finite, so that no packet enters the boxes of an empty slot at infinity.
        let farthest = limit(farthest).clamp(0.0, f32::MAX);
        Self { sides, rises, farthest }
    }

    /// The first `t` at which the rays can be in each box of a node, and a bit for each box that they can hit.
    fn enter(&self, node: &Node) -> ([f32; WIDTH], u32) {
        let (mut enter, mut leave) = (Vec4::ZERO, Vec4::splat(self.farthest));
        for ((sides, rises), planes) in self.sides.iter().zip(&self.rises).zip(&node.planes) {
            // The lower side must be below the box's upper plane, the upper side above its lower plane.
            for (at, plane) in [(0, 1), (1, 0)] {
                let (start, inverse) = sides[at];
                let t = (planes[plane] - start) * inverse;
                if rises[at] == (at == 0) {
                    leave = leave.min(t);
                } else {
                    enter = enter.max(t);
                }
            }
        }
        (enter.to_array(), leave.cmpge(enter).bitmask())
    }
}

#[expect(clippy::cast_possible_truncation, reason = "boxes have a margin for f32")]
fn as_vec4(value: f64) -> Vec4 {
    Vec4::splat(value as f32)
}

/// The objects that the rays of a packet can hit, nearest first; or too many to be worth listing.
#[derive(Debug)]
pub(crate) struct Candidates {
    /// Boxes of objects alone, and the first `t` of each node.
    nodes: Vec<(f32, Node)>,
    complete: bool,
}

/// Longest list of objects.
const MAX: usize = 32;

/// Where the packet enters an object's box, the object's link, and the box: low and high by axis.
type Entered = (f32, u32, [(f32, f32); 3]);

impl Candidates {
    /// Finds the objects; those that `keep` excludes are known not to be hit.
    pub(crate) fn new(bvh: &Bvh, packet: &RayPacket, keep: impl Fn(usize) -> bool) -> Self {
        let mut found: Vec<Entered> = Vec::new();
        let mut open = vec![0u32];
        while let Some(node) = open.pop().and_then(|link| bvh.nodes.get(link as usize)) {
            let (enters, hits) = packet.enter(node);
            for slot in (0..WIDTH).filter(|slot| hits >> slot & 1 == 1) {
                let link = node.links[slot];
                if link & OBJECT == 0 {
                    open.push(link);
                } else if keep((link & !OBJECT) as usize) {
                    found.push((enters[slot], link, node.planes.map(|[low, high]| (low[slot], high[slot]))));
                }
            }
            if found.len() > MAX {
                return Self { nodes: Vec::new(), complete: false };
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let node = |entered: &[Entered]| {
            let mut node = Node::EMPTY;
            for (slot, (_, link, planes)) in entered.iter().enumerate() {
                for ([lows, highs], (low, high)) in node.planes.iter_mut().zip(planes) {
                    (lows[slot], highs[slot]) = (*low, *high);
                }
                node.links[slot] = *link;
            }
            (entered[0].0, node)
        };
        Self { nodes: found.chunks(WIDTH).map(node).collect(), complete: true }
    }

    /// As [`Bvh::closest`], for a ray of the packet.
    pub(crate) fn closest(&self, bvh: &Bvh, objects: &[Object], ray: &RaySegment) -> Option<(f64, usize)> {
        if !self.complete {
            return bvh.closest(objects, ray);
        }
        let mut best: Option<(f64, usize)> = None;
        let mut ray = *ray;
        let slabs = Slabs::new(&ray);
        let mut farthest = limit(ray.farthest);
        for (first, node) in &self.nodes {
            if *first > farthest {
                break;
            }
            let (enters, hits) = slabs.enter(node, farthest);
            for slot in (0..WIDTH).filter(|slot| hits >> slot & 1 == 1) {
                if enters[slot] > farthest {
                    continue;
                }
                let index = (node.links[slot] & !OBJECT) as usize;
                let Some(t) = objects[index].hit(&ray) else { continue };
                if best.is_none_or(|(nearest, other)| t < nearest || (t <= nearest && index < other)) {
                    best = Some((t, index));
                    // Slightly beyond, so that an equal hit is still compared.
                    ray.farthest = t * (1.0 + f64::EPSILON) + f64::MIN_POSITIVE;
                    farthest = limit(ray.farthest);
                }
            }
        }
        best
    }

    /// As [`Bvh::blocked`], for a ray of the packet.
    pub(crate) fn blocked(&self, bvh: &Bvh, objects: &[Object], ray: &RaySegment) -> bool {
        if !self.complete {
            return bvh.blocked(objects, ray);
        }
        if self.nodes.is_empty() {
            return false;
        }
        let slabs = Slabs::new(ray);
        let farthest = limit(ray.farthest);
        self.nodes.iter().any(|(_, node)| {
            let (_, hits) = slabs.enter(node, farthest);
            (0..WIDTH)
                .filter(|slot| hits >> slot & 1 == 1)
                .any(|slot| objects[(node.links[slot] & !OBJECT) as usize].hit(ray).is_some())
        })
    }

    /// Whether the objects were few enough for a list.
    #[cfg(test)]
    pub(crate) const fn is_listed(&self) -> bool {
        self.complete
    }

    /// The listed objects, nearest first.
    pub(crate) fn objects(&self) -> impl Iterator<Item = usize> {
        let links = self.nodes.iter().flat_map(|(_, node)| node.links);
        links.filter(|link| link & OBJECT != 0).map(|link| (link & !OBJECT) as usize)
    }

    /// Whether nothing can be hit.
    pub(crate) fn is_empty(&self) -> bool {
        self.complete && self.nodes.is_empty()
    }
}
