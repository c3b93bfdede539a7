use glam::{DVec3, Vec3A};

use crate::form::{Object, RaySegment};

/// A box around the objects `first .. first + count` of a run, or around two nodes, the left one next in line.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3A,
    high: Vec3A,
    /// First object of a leaf, or the right node.
    link: u32,
    /// Objects of a leaf; 0 for a node of nodes.
    count: u32,
}

/// A tree of boxes over objects, split where the surface area heuristic says.
#[derive(Clone, Debug)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

const LEAF: usize = 2;
const DEPTH: usize = 64;
/// Boxes are f32: larger than their content by more than f32 loses at this distance, in metres.
const MARGIN: f32 = 1e-4;

impl Bvh {
    pub(crate) fn new(objects: &[Object]) -> Self {
        let mut order: Vec<u32> = (0u32..).take(objects.len()).collect();
        let mut nodes = Vec::with_capacity(objects.len());
        if !order.is_empty() {
            build(objects, &mut order, 0, &mut nodes, 0);
        }
        Self { nodes, order }
    }

    /// The nearest hit and its object; of hits at the same distance, that of the first object.
    pub(crate) fn closest(&self, objects: &[Object], ray: &RaySegment) -> Option<(f64, usize)> {
        let mut best: Option<(f64, usize)> = None;
        let mut ray = *ray;
        self.walk(ray, |run, farthest| {
            for &index in run {
                let index = index as usize;
                let Some(t) = objects.get(index).and_then(|object| object.hit(&ray)) else { continue };
                let nearer = best.is_none_or(|(held, other)| t < held || (t <= held && index < other));
                if nearer {
                    best = Some((t, index));
                    // A hair beyond, so that an equal hit is compared and not lost.
                    ray.farthest = t * (1.0 + f64::EPSILON) + f64::MIN_POSITIVE;
                    *farthest = ray.farthest;
                }
            }
            false
        });
        best
    }

    /// Whether anything stands within the ray's limits.
    pub(crate) fn blocked(&self, objects: &[Object], ray: &RaySegment) -> bool {
        self.walk(*ray, |run, _| {
            run.iter().any(|&index| objects.get(index as usize).is_some_and(|object| object.hit(ray).is_some()))
        })
    }

    /// Visits runs of objects, near boxes first; `visit` may shorten the ray, and ends the walk by `true`.
    fn walk(&self, ray: RaySegment, mut visit: impl FnMut(&[u32], &mut f64) -> bool) -> bool {
        let origin = ray.origin.as_vec3a();
        let inverse = ray.inverse.as_vec3a();
        let enters = |node: &Node, farthest: f32| {
            let (a, b) = ((node.low - origin) * inverse, (node.high - origin) * inverse);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            (leave >= enter && leave >= 0.0 && enter <= farthest).then_some(enter)
        };
        let mut farthest = ray.farthest;
        let mut stack = [0u32; DEPTH];
        let mut held = usize::from(self.nodes.first().is_some_and(|root| enters(root, f32::INFINITY).is_some()));
        while held > 0 {
            held -= 1;
            let mut at = stack.get(held).copied().unwrap_or_default();
            while let Some(node) = self.nodes.get(at as usize) {
                if node.count > 0 {
                    let run = self.order.get(node.link as usize..(node.link + node.count) as usize);
                    if visit(run.unwrap_or_default(), &mut farthest) {
                        return true;
                    }
                    break;
                }
                #[expect(clippy::cast_possible_truncation, reason = "boxes carry a margin for f32")]
                let limit = farthest as f32 * 1.000_001 + MARGIN;
                let (left, right) = (at + 1, node.link);
                let near = |index: u32| self.nodes.get(index as usize).and_then(|node| enters(node, limit));
                at = match (near(left), near(right)) {
                    (Some(l), Some(r)) => {
                        let (first, second) = if l <= r { (left, right) } else { (right, left) };
                        if let Some(slot) = stack.get_mut(held) {
                            *slot = second;
                            held += 1;
                        }
                        first
                    }
                    (Some(_), None) => left,
                    (None, Some(_)) => right,
                    (None, None) => break,
                };
            }
        }
        false
    }
}

fn bounds(objects: &[Object], run: &[u32]) -> (Vec3A, Vec3A) {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for object in run.iter().filter_map(|&index| objects.get(index as usize)) {
        let half = object.half_extent();
        low = low.min(object.centre - half);
        high = high.max(object.centre + half);
    }
    (low.as_vec3a() - Vec3A::splat(MARGIN), high.as_vec3a() + Vec3A::splat(MARGIN))
}

fn area(objects: &[Object], run: &[u32]) -> f32 {
    let (low, high) = bounds(objects, run);
    let side = high - low;
    side.x * side.y + side.y * side.z + side.z * side.x
}

#[expect(clippy::cast_possible_truncation, reason = "a scene has far fewer than 2^32 objects")]
fn build(objects: &[Object], run: &mut [u32], first: usize, nodes: &mut Vec<Node>, depth: usize) {
    let (low, high) = bounds(objects, run);
    let me = nodes.len();
    nodes.push(Node { low, high, link: first as u32, count: run.len() as u32 });
    // The stack of a walk holds one node a level.
    if run.len() <= LEAF || depth + 1 >= DEPTH {
        return;
    }
    let sort = |run: &mut [u32], axis: usize| {
        let key = |&index: &u32| objects.get(index as usize).map_or(0.0, |o| o.centre.to_array()[axis]);
        run.sort_by(|a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    };
    let mut best = (f32::INFINITY, 0, run.len() / 2);
    for axis in 0..3 {
        sort(run, axis);
        for eighth in 1..8 {
            let at = run.len() * eighth / 8;
            let (left, right) = run.split_at(at);
            if left.is_empty() || right.is_empty() {
                continue;
            }
            let cost = area(objects, left) * left.len() as f32 + area(objects, right) * right.len() as f32;
            if cost < best.0 {
                best = (cost, axis, at);
            }
        }
    }
    sort(run, best.1);
    let at = best.2.clamp(1, run.len() - 1);
    let (left, right) = run.split_at_mut(at);
    build(objects, left, first, nodes, depth + 1);
    let link = nodes.len() as u32;
    build(objects, right, first + at, nodes, depth + 1);
    if let Some(node) = nodes.get_mut(me) {
        (node.link, node.count) = (link, 0);
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::form::Form;
    use crate::rng::Rng;

    #[test]
    fn the_tree_finds_what_trying_every_object_finds() {
        let mut rng = Rng::new(5);
        let objects: Vec<Object> = (0..300)
            .map(|at| {
                let form = match at % 4 {
                    0 => Form::Box(DVec3::new(rng.within(0.01, 1.0), 0.3, 0.002)),
                    1 => Form::Ball(rng.within(0.01, 0.5)),
                    2 => Form::Cylinder { radius: 0.01, half_height: 1.0 },
                    _ => Form::Leaf(glam::DVec2::new(0.2, 0.1)),
                };
                let angle = if at % 3 == 0 { std::f64::consts::FRAC_PI_2 } else { rng.within(0.0, 3.0) };
                let axis = if at % 3 == 0 { DVec3::Z } else { rng.direction() };
                let turn = DMat3::from_axis_angle(axis, angle);
                Object::new(form, turn, rng.direction() * rng.within(0.0, 6.0), 0, 1)
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
        assert!((500..3900).contains(&hits), "{hits} hits prove little");
        assert!(Bvh::new(&[]).closest(&[], &RaySegment::new(DVec3::ZERO, DVec3::X, 0.0, 1.0)).is_none());
    }
}
