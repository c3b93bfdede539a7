use glam::{DVec3, Vec3A, Vec4};

use crate::shape::{Object, RaySegment};

/// A bounding volume hierarchy with four boxes per node, built by the surface area heuristic. Each leaf box contains one
/// object, which is tested exactly if a ray hits the box.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    pub nodes: Vec<Node>,
}

/// A node of four boxes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    /// Lower and upper planes per axis.
    pub planes: [[Vec4; 2]; 3],
    /// Content of each box: an object, marked by [`OBJECT`], or a node.
    pub links: [u32; WIDTH],
}

pub(crate) const WIDTH: usize = 4;
pub(crate) const OBJECT: u32 = 1 << 31;
/// Levels split by the heuristic; below them, splitting in halves bounds the depth.
const SHAPED: usize = 12;
/// Size of the traversal stack: at most three boxes per level, and few levels of halves.
const STACK: usize = (WIDTH - 1) * (SHAPED + 8);
/// Margin of the f32 boxes, in metres: more than the rounding errors.
const MARGIN: f32 = 1e-4;

impl Bvh {
    pub(crate) fn new(objects: &[Object]) -> Self {
        let mut bvh = Self { nodes: Vec::new() };
        let mut leaves: Vec<Leaf> = (0u32..).zip(objects).map(|(index, object)| Leaf::new(index, object)).collect();
        if !leaves.is_empty() {
            bvh.grow(&mut leaves, 0);
        }
        bvh
    }

    /// Adds the node of a run of objects and all nodes below it; returns its index.
    #[expect(clippy::cast_possible_truncation, reason = "a scene has far fewer than 2^31 objects")]
    fn grow(&mut self, run: &mut [Leaf], depth: usize) -> u32 {
        let index = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        let mut runs = vec![run];
        while runs.len() < WIDTH {
            let largest = (0..runs.len()).filter(|&at| runs[at].len() > 1);
            let Some(largest) = largest.max_by(|&a, &b| area(runs[a]).total_cmp(&area(runs[b]))) else { break };
            let run = runs.swap_remove(largest);
            let at = if depth < SHAPED { cheapest_split(run) } else { run.len() / 2 };
            let (left, right) = run.split_at_mut(at);
            runs.extend([left, right]);
        }
        let mut node = Node::EMPTY;
        for (slot, run) in runs.into_iter().enumerate() {
            let (low, high) = bounds(run);
            let link = match &*run {
                [leaf] => leaf.index | OBJECT,
                _ => self.grow(run, depth + 1),
            };
            node.put(slot, low, high, link);
        }
        self.nodes[index] = node;
        index as u32
    }

    /// The nearest hit and its object; ties go to the first object.
    pub(crate) fn closest(&self, objects: &[Object], ray: &RaySegment) -> Option<(f64, usize)> {
        let mut best: Option<(f64, usize)> = None;
        let mut ray = *ray;
        let slabs = Slabs::new(&ray);
        let mut limit = limit(ray.farthest);
        let mut stack = [(0u32, 0f32); STACK];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let (link, enter) = stack[top];
            if enter > limit {
                continue;
            }
            if link & OBJECT != 0 {
                let index = (link & !OBJECT) as usize;
                let Some(t) = objects[index].hit(&ray) else { continue };
                if best.is_none_or(|(nearest, other)| t < nearest || (t <= nearest && index < other)) {
                    best = Some((t, index));
                    // Slightly beyond, so that an equal hit is still compared.
                    ray.farthest = t * (1.0 + f64::EPSILON) + f64::MIN_POSITIVE;
                    limit = self::limit(ray.farthest);
                }
                continue;
            }
            let node = &self.nodes[link as usize];
            let (enters, hits) = slabs.enter(node, limit);
            let first = top;
            for slot in (0..WIDTH).filter(|slot| hits >> slot & 1 == 1) {
                // Insertion sort of at most four boxes, with the nearest on top.
                let mut at = top;
                while at > first && stack[at - 1].1 < enters[slot] {
                    stack.swap(at, at - 1);
                    at -= 1;
                }
                stack[at] = (node.links[slot], enters[slot]);
                top += 1;
            }
        }
        best
    }

    /// Whether the ray hits anything within its limits.
    pub(crate) fn blocked(&self, objects: &[Object], ray: &RaySegment) -> bool {
        let slabs = Slabs::new(ray);
        let limit = limit(ray.farthest);
        let mut stack = [0u32; STACK];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            let (_, hits) = slabs.enter(node, limit);
            for slot in (0..WIDTH).filter(|slot| hits >> slot & 1 == 1) {
                let link = node.links[slot];
                if link & OBJECT == 0 {
                    stack[top] = link;
                    top += 1;
                } else if objects[(link & !OBJECT) as usize].hit(ray).is_some() {
                    return true;
                }
            }
        }
        false
    }
}

impl Node {
    /// Boxes that no ray hits.
    pub(crate) const EMPTY: Self =
        Self { planes: [[Vec4::splat(f32::INFINITY), Vec4::splat(f32::NEG_INFINITY)]; 3], links: [0; WIDTH] };

    fn put(&mut self, slot: usize, low: Vec3A, high: Vec3A, link: u32) {
        for (axis, [lows, highs]) in self.planes.iter_mut().enumerate() {
            (lows[slot], highs[slot]) = (low[axis], high[axis]);
        }
        self.links[slot] = link;
    }
}

/// A ray prepared for slab tests of four boxes.
pub(crate) struct Slabs {
    origin: [Vec4; 3],
    inverse: [Vec4; 3],
    /// Which of a node's planes is hit first, per axis.
    first: [usize; 3],
}

impl Slabs {
    pub(crate) fn new(ray: &RaySegment) -> Self {
        let (origin, inverse) = (ray.origin.as_vec3(), ray.inverse.as_vec3());
        Self {
            origin: origin.to_array().map(Vec4::splat),
            inverse: inverse.to_array().map(Vec4::splat),
            first: inverse.to_array().map(|inverse| usize::from(inverse < 0.0)),
        }
    }

    /// Where the ray enters each box, and a bit for each box hit before `limit`.
    pub(crate) fn enter(&self, node: &Node, limit: f32) -> ([f32; WIDTH], u32) {
        let plane = |axis: usize, side: usize| (node.planes[axis][side] - self.origin[axis]) * self.inverse[axis];
        let [x, y, z] = self.first;
        let enter = plane(0, x).max(plane(1, y)).max(plane(2, z));
        let leave = plane(0, 1 - x).min(plane(1, 1 - y)).min(plane(2, 1 - z));
        let hits = leave.cmpge(enter) & leave.cmpge(Vec4::ZERO) & enter.cmple(Vec4::splat(limit));
        (enter.to_array(), hits.bitmask())
    }
}

/// The largest entry of a box that can contain hits nearer than `farthest`.
#[expect(clippy::cast_possible_truncation, reason = "boxes have a margin for f32")]
pub(crate) fn limit(farthest: f64) -> f32 {
    farthest as f32 * 1.000_001 + MARGIN
}

/// An object while the tree is built.
#[derive(Clone, Copy)]
struct Leaf {
    low: Vec3A,
    high: Vec3A,
    centre: DVec3,
    index: u32,
}

impl Leaf {
    fn new(index: u32, object: &Object) -> Self {
        let half = object.half_extent();
        let margin = Vec3A::splat(MARGIN);
        let (low, high) = ((object.centre - half).as_vec3a() - margin, (object.centre + half).as_vec3a() + margin);
        Self { low, high, centre: object.centre, index }
    }
}

fn bounds(run: &[Leaf]) -> (Vec3A, Vec3A) {
    let none = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    run.iter().fold(none, |(low, high), leaf| (low.min(leaf.low), high.max(leaf.high)))
}

fn area(run: &[Leaf]) -> f32 {
    area_of(bounds(run))
}

fn area_of((low, high): (Vec3A, Vec3A)) -> f32 {
    let side = high - low;
    side.x * side.y + side.y * side.z + side.z * side.x
}

/// Sorts a run of two or more along the axis of the cheapest split, and returns the index of the split.
fn cheapest_split(run: &mut [Leaf]) -> usize {
    let sort = |run: &mut [Leaf], axis: usize| {
        run.sort_by(|a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.index.cmp(&b.index)));
    };
    let mut best = (f32::INFINITY, 0, run.len() / 2);
    for axis in 0..3 {
        sort(run, axis);
        let mut last = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        let mut of_last = |leaf: &Leaf| {
            last = (last.0.min(leaf.low), last.1.max(leaf.high));
            area_of(last)
        };
        let mut right: Vec<f32> = run.iter().rev().map(&mut of_last).collect();
        right.reverse();
        let mut left = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for at in 1..run.len() {
            left = (left.0.min(run[at - 1].low), left.1.max(run[at - 1].high));
            let cost = area_of(left) * at as f32 + right[at] * (run.len() - at) as f32;
            if cost < best.0 {
                best = (cost, axis, at);
            }
        }
    }
    sort(run, best.1);
    best.2
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::ray_packet::{Candidates, Extent, RayPacket};
    use crate::rng::Rng;
    use crate::shape::Shape;

    /// Bundles of rays of all widths, to near and far ends, through three hundred objects.
    #[test]
    fn the_candidates_of_a_packet_give_the_same_hits_as_the_tree() {
        let mut rng = Rng::new(9);
        let objects: Vec<Object> = (0..300)
            .map(|at| {
                let shape = match at % 3 {
                    0 => Shape::Box(DVec3::new(rng.within(0.01, 1.0), 0.3, 0.002)),
                    1 => Shape::Sphere(rng.within(0.01, 0.5)),
                    _ => Shape::Cylinder { radius: 0.01, half_height: 1.0 },
                };
                let turn = DMat3::from_axis_angle(rng.direction(), rng.within(0.0, 3.0));
                Object::new(shape, turn, rng.direction() * rng.within(0.0, 6.0), 0, 1)
            })
            .collect();
        let bvh = Bvh::new(&objects);
        let [mut hits, mut short] = [0, 0];
        for at in 0..300 {
            let wide = rng.within(0.0, 0.2);
            let (start, way) = (rng.direction() * rng.within(0.0, 7.0), rng.direction() * rng.within(0.5, 5.0));
            let farthest = if at % 2 == 0 { f64::INFINITY } else { 1.0 };
            let (mut origins, mut directions) = (Extent::EMPTY, Extent::EMPTY);
            let rays: Vec<RaySegment> = (0..40)
                .map(|_| {
                    let (origin, direction) = (start + rng.direction() * wide, way + rng.direction() * wide);
                    origins.add(origin);
                    directions.add(direction);
                    RaySegment::new(origin, direction, 1e-6, farthest)
                })
                .collect();
            let candidates = Candidates::new(&bvh, &RayPacket::new(origins, directions, farthest), |_| true);
            short += usize::from(candidates.is_listed());
            for ray in &rays {
                let expected = bvh.closest(&objects, ray);
                assert_eq!(candidates.closest(&bvh, &objects, ray), expected, "packet {at}");
                assert_eq!(candidates.blocked(&bvh, &objects, ray), expected.is_some(), "packet {at}");
                hits += usize::from(expected.is_some());
            }
            let excluded = Candidates::new(&bvh, &RayPacket::new(origins, directions, farthest), |_| false);
            assert!(excluded.is_empty(), "objects that are known not to be hit are left out");
        }
        assert!((1000..11_000).contains(&hits) && short > 200, "{hits} hits, {short} lists");
    }

    #[test]
    fn the_tree_agrees_with_testing_every_object() {
        let mut rng = Rng::new(5);
        let objects: Vec<Object> = (0..300)
            .map(|at| {
                let shape = match at % 4 {
                    0 => Shape::Box(DVec3::new(rng.within(0.01, 1.0), 0.3, 0.002)),
                    1 => Shape::Sphere(rng.within(0.01, 0.5)),
                    2 => Shape::Cylinder { radius: 0.01, half_height: 1.0 },
                    _ => Shape::Leaf(glam::DVec2::new(0.2, 0.1)),
                };
                let angle = if at % 3 == 0 { std::f64::consts::FRAC_PI_2 } else { rng.within(0.0, 3.0) };
                let axis = if at % 3 == 0 { DVec3::Z } else { rng.direction() };
                let turn = DMat3::from_axis_angle(axis, angle);
                Object::new(shape, turn, rng.direction() * rng.within(0.0, 6.0), 0, 1)
            })
            .collect();
        let bvh = Bvh::new(&objects);
        let mut hits = 0;
        for at in 0..4000 {
            // Every other ray runs along an axis, where boxes divide by zero.
            let aim = rng.direction() * 3.0;
            let direction = if at % 2 == 0 { rng.direction() } else { DVec3::Y * rng.sign() };
            let ray = RaySegment::new(aim - direction * 5.0, direction, 1e-6, rng.within(1.0, 20.0));
            let all = objects.iter().enumerate().filter_map(|(index, object)| Some((object.hit(&ray)?, index)));
            let expected = all.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            assert_eq!(bvh.closest(&objects, &ray), expected, "ray {at}");
            assert_eq!(bvh.blocked(&objects, &ray), expected.is_some(), "ray {at}");
            hits += usize::from(expected.is_some());
        }
        assert!((500..3900).contains(&hits), "{hits} hits are too few or too many for a test");
        assert!(Bvh::new(&[]).closest(&[], &RaySegment::new(DVec3::ZERO, DVec3::X, 0.0, 1.0)).is_none());
    }
}
