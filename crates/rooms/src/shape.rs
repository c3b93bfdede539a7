use glam::{DMat3, DVec2, DVec3};

use crate::ray_packet::Extent;

/// Shape of an object, about the origin of its own frame. Lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Shape {
    /// A box with these half sides.
    Box(DVec3),
    /// A sphere with this radius.
    Sphere(f64),
    /// A cylinder about z with flat caps.
    Cylinder { radius: f64, half_height: f64 },
    /// A flat ellipse in the plane z = 0: a leaf.
    Leaf(DVec2),
}

/// A shape with a pose in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Object {
    pub shape: Shape,
    pub world_from_local: DMat3,
    pub centre: DVec3,
    /// Half sides of an axis-aligned box.
    aligned: Option<DVec3>,
    /// Index into the world's materials.
    pub material: usize,
    /// The instance that it is part of; from 1.
    pub instance: u32,
}

/// A half-line `origin + t · direction`; `direction` may have any length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RaySegment {
    pub origin: DVec3,
    pub direction: DVec3,
    /// 1 / `direction`, large where that is zero.
    pub inverse: DVec3,
    /// Lower limit of hits.
    pub nearest: f64,
    /// Upper limit of hits.
    pub farthest: f64,
}

impl RaySegment {
    pub(crate) fn new(origin: DVec3, direction: DVec3, nearest: f64, farthest: f64) -> Self {
        // Zero would give 0 · ∞ on a box's own plane.
        let safe = |d: f64| 1.0 / if d.abs() < 1e-15 { 1e-15f64.copysign(d) } else { d };
        let inverse = DVec3::new(safe(direction.x), safe(direction.y), safe(direction.z));
        Self { origin, direction, inverse, nearest, farthest }
    }
}

/// A point of an object's surface, hit by a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HitPoint {
    /// Unit normal in the world, outward of the solid.
    pub normal: DVec3,
    /// Position in the object's own frame.
    pub local: DVec3,
    /// Position on the surface, in metres.
    pub uv: DVec2,
}

impl Object {
    /// An object with a pose. Rotations by multiples of 90° are made exact.
    pub(crate) fn new(shape: Shape, world_from_local: DMat3, centre: DVec3, material: usize, instance: u32) -> Self {
        let rounded = DMat3::from_cols_array(&world_from_local.to_cols_array().map(f64::round));
        let quarter = world_from_local.abs_diff_eq(rounded, 1e-12);
        let world_from_local = if quarter { rounded } else { world_from_local };
        let aligned = match shape {
            Shape::Box(half) if quarter => Some((rounded * half).abs()),
            _ => None,
        };
        Self { shape, world_from_local, centre, aligned, material, instance }
    }

    /// The smallest `t` within the ray's limits at which it hits the surface.
    pub(crate) fn hit(&self, ray: &RaySegment) -> Option<f64> {
        let within = |t: f64| (t > ray.nearest && t < ray.farthest).then_some(t);
        if let Some(half) = self.aligned {
            return slabs(self.centre - ray.origin, half, ray.inverse, within);
        }
        let local_from_world = self.world_from_local.transpose();
        let o = local_from_world * (ray.origin - self.centre);
        let d = local_from_world * ray.direction;
        match self.shape {
            Shape::Box(half) => slabs(-o, half, RaySegment::new(o, d, 0.0, 0.0).inverse, within),
            Shape::Sphere(radius) => {
                let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - radius * radius);
                let root = (b * b - a * c).sqrt();
                within((-b - root) / a).or_else(|| within((root - b) / a))
            }
            Shape::Cylinder { radius, half_height } => cylinder(o, d, radius, half_height, within),
            Shape::Leaf(half) => {
                let t = within(-o.z / d.z)?;
                let p = (o + d * t).truncate() / half;
                (p.length_squared() <= 1.0).then_some(t)
            }
        }
    }

    /// Whether every line from a point of one box to a point of another is known to pass through the object: only if this is
    /// a wall, slab or panel that is aligned with the axes.
    ///
    /// On a plane between both boxes, the lines cross a region whose extent is that of the lines between the boxes' corners.
    pub(crate) fn separates(&self, from: &Extent, to: &Extent) -> bool {
        const MARGIN: f64 = 1e-4;
        let Some(half) = self.aligned else { return false };
        let [x, y, z] = half.to_array();
        let (axis, others) = if x <= y && x <= z {
            (0, [1, 2])
        } else if y <= z {
            (1, [0, 2])
        } else {
            (2, [0, 1])
        };
        let (middle, reach) = (self.centre[axis], half[axis] + MARGIN);
        let below = |extent: &Extent| extent.high[axis] < middle - reach;
        let above = |extent: &Extent| extent.low[axis] > middle + reach;
        if !(below(from) && above(to) || above(from) && below(to)) {
            return false;
        }
        let ends = |extent: &Extent| [extent.low[axis], extent.high[axis]];
        ends(from).into_iter().flat_map(|start| ends(to).map(|end| (middle - start) / (end - start))).all(|share| {
            others.into_iter().all(|other| {
                let low = from.low[other] + (to.low[other] - from.low[other]) * share;
                let high = from.high[other] + (to.high[other] - from.high[other]) * share;
                low > self.centre[other] - half[other] + MARGIN && high < self.centre[other] + half[other] - MARGIN
            })
        })
    }

    /// Normal and surface coordinates at a point that [`Self::hit`] found.
    pub(crate) fn hit_point(&self, point: DVec3) -> HitPoint {
        let p = self.world_from_local.transpose() * (point - self.centre);
        let (normal, uv) = match self.shape {
            Shape::Box(half) => {
                let q = p / half;
                let (x, y, z) = (q.x.abs(), q.y.abs(), q.z.abs());
                if x >= y && x >= z {
                    (DVec3::X * q.x.signum(), DVec2::new(p.y * q.x.signum(), p.z))
                } else if y >= z {
                    (DVec3::Y * q.y.signum(), DVec2::new(-p.x * q.y.signum(), p.z))
                } else {
                    (DVec3::Z * q.z.signum(), DVec2::new(p.x, p.y))
                }
            }
            Shape::Sphere(radius) => {
                let n = p / radius;
                (n, DVec2::new(n.y.atan2(n.x), n.z.clamp(-1.0, 1.0).asin()) * radius)
            }
            Shape::Cylinder { radius, half_height } => {
                let across = p.truncate() / radius;
                if p.z.abs() / half_height > across.length() {
                    (DVec3::Z * p.z.signum(), p.truncate())
                } else {
                    (across.extend(0.0), DVec2::new(across.y.atan2(across.x) * radius, p.z))
                }
            }
            Shape::Leaf(_) => (DVec3::Z, p.truncate()),
        };
        let normal = self.world_from_local * normal;
        // Rotations by multiples of 90° keep the length exactly.
        let normal = if self.aligned.is_some() { normal } else { normal.normalize_or(DVec3::Z) };
        HitPoint { normal, local: p, uv }
    }

    /// Half sides of the axis-aligned box in the world around [`Self::centre`].
    pub(crate) fn half_extent(&self) -> DVec3 {
        let local = match self.shape {
            Shape::Box(half) => half,
            Shape::Sphere(radius) => return DVec3::splat(radius),
            Shape::Cylinder { radius, half_height } => DVec3::new(radius, radius, half_height),
            Shape::Leaf(half) => half.extend(0.0),
        };
        let m = self.world_from_local;
        m.x_axis.abs() * local.x + m.y_axis.abs() * local.y + m.z_axis.abs() * local.z
    }

    /// Signed distance from a point to the surface, negative inside; a lower bound of the true distance outside.
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        let p = self.world_from_local.transpose() * (point - self.centre);
        let to_box = |q: DVec3| q.max(DVec3::ZERO).length() + q.max_element().clamp(f64::MIN, 0.0);
        match self.shape {
            Shape::Box(half) => to_box(p.abs() - half),
            Shape::Sphere(radius) => p.length() - radius,
            Shape::Cylinder { radius, half_height } => {
                to_box(DVec3::new(p.truncate().length() - radius, -half_height, p.z.abs() - half_height))
            }
            Shape::Leaf(half) => to_box(p.abs() - half.extend(0.0)),
        }
    }
}

/// Slab test of a box with these half sides whose centre is `to_middle` from the ray's origin.
fn slabs(to_middle: DVec3, half: DVec3, inverse: DVec3, within: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let (middle, reach) = (to_middle * inverse, half * inverse.abs());
    let (enter, leave) = ((middle - reach).max_element(), (middle + reach).min_element());
    if enter > leave { None } else { within(enter).or_else(|| within(leave)) }
}

fn cylinder(o: DVec3, d: DVec3, radius: f64, half: f64, within: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let (os, ds) = (o.truncate(), d.truncate());
    let (a, b, c) = (ds.length_squared(), os.dot(ds), os.length_squared() - radius * radius);
    let root = (b * b - a * c).sqrt();
    // Parallel to the axis a is 0, and the ray is always or never inside the lateral surface.
    let (mantle_in, mantle_out) = if a > 0.0 {
        ((-b - root) / a, (root - b) / a)
    } else if c <= 0.0 {
        (f64::NEG_INFINITY, f64::INFINITY)
    } else {
        return None;
    };
    let (cap_a, cap_b) = ((-half - o.z) / d.z, (half - o.z) / d.z);
    let (cap_in, cap_out) = if cap_a < cap_b { (cap_a, cap_b) } else { (cap_b, cap_a) };
    if mantle_in.is_nan() || mantle_in > cap_out || cap_in > mantle_out {
        return None;
    }
    let enter = if cap_in > mantle_in { cap_in } else { mantle_in };
    let leave = if cap_out < mantle_out { cap_out } else { mantle_out };
    within(enter).or_else(|| within(leave))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;

    use super::*;

    fn shapes() -> impl Strategy<Value = Shape> {
        let side = || 0.05..2.0f64;
        prop_oneof![
            (side(), side(), side()).prop_map(|(x, y, z)| Shape::Box(DVec3::new(x, y, z))),
            side().prop_map(Shape::Sphere),
            (side(), side()).prop_map(|(radius, half_height)| Shape::Cylinder { radius, half_height }),
        ]
    }

    /// A wall with 1 m on all sides of the lines' middle: random lines between the boxes are all blocked, and a wall that
    /// is lower, off to the side or not between the boxes hides less than all.
    #[test]
    fn a_wall_between_two_boxes_separates_them() {
        let wall = |centre: DVec3, half: DVec3| Object::new(Shape::Box(half), DMat3::IDENTITY, centre, 0, 1);
        let from = Extent::around(DVec3::new(0.0, 0.0, 0.0), DVec3::new(0.2, 0.3, 0.1));
        let to = Extent::around(DVec3::new(0.5, 6.0, 1.0), DVec3::new(0.4, 0.1, 0.6));
        let shields = wall(DVec3::new(0.2, 2.0, 0.3), DVec3::new(1.0, 0.05, 1.0));
        assert!(shields.separates(&from, &to) && shields.separates(&to, &from));
        let mut rng = crate::rng::Rng::new(4);
        let mut inside = |extent: &Extent| {
            let share = DVec3::new(rng.unit(), rng.unit(), rng.unit());
            extent.low + (extent.high - extent.low) * share
        };
        for _ in 0..500 {
            let (start, end) = (inside(&from), inside(&to));
            assert!(shields.hit(&RaySegment::new(start, end - start, 1e-6, 1.0)).is_some());
        }
        let gaps = [
            (wall(DVec3::new(0.2, 2.0, -0.75), DVec3::new(1.0, 0.05, 1.0)), "the highest lines pass above"),
            (wall(DVec3::new(1.1, 2.0, 0.3), DVec3::new(1.0, 0.05, 1.0)), "lines pass on the left"),
            (wall(DVec3::new(0.2, 7.0, 0.3), DVec3::new(9.0, 0.05, 9.0)), "it is behind the other box"),
            (wall(DVec3::new(0.2, 0.2, 0.3), DVec3::new(9.0, 0.05, 9.0)), "it touches the first box"),
        ];
        for (wall, why) in gaps {
            assert!(!wall.separates(&from, &to) && !wall.separates(&to, &from), "{why}");
        }
        let turned = Object::new(shields.shape, DMat3::from_rotation_z(0.1), shields.centre, 0, 1);
        assert!(!turned.separates(&from, &to), "only aligned walls are sure");
    }

    fn unit(seed: (f64, f64)) -> DVec3 {
        crate::rng::sphere_point(DVec2::new(seed.0, seed.1))
    }

    proptest! {
        /// Sphere tracing finds the surface independently.
        #[test]
        fn hits_agree_with_sphere_tracing(
            shape in shapes(), turn in (0.0..1.0, 0.0..1.0f64), angle in 0.0..6.0f64,
            from in (0.0..1.0, 0.0..1.0f64), aim in (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64),
        ) {
            let centre = DVec3::new(0.3, -1.0, 2.0);
            let world_from_local = DMat3::from_axis_angle(unit(turn), angle);
            let object = Object::new(shape, world_from_local, centre, 0, 1);
            let origin = centre + unit(from) * 5.0;
            let direction = (centre + DVec3::from(aim) - origin).normalize();
            let found = object.hit(&RaySegment::new(origin, direction, 0.0, 50.0));
            let mut walked = 0.0;
            let mut least = f64::INFINITY;
            for _ in 0..2000 {
                let step = object.distance(origin + direction * walked);
                least = if step < least { step } else { least };
                walked += step;
                if step < 1e-10 || walked > 20.0 { break; }
            }
            let close = Tolerance::absolute(1e-5);
            match found {
                Some(t) => {
                    close.assert([object.distance(origin + direction * t)], [0.0], "a hit is on the surface");
                    if least < 1e-9 { close.assert([walked], [t], "the first hit"); }
                    let point = object.hit_point(origin + direction * t);
                    prop_assert!(point.normal.dot(direction) < 1e-6, "seen from outside");
                    let away = object.distance(origin + direction * t + point.normal * 1e-3);
                    Tolerance::absolute(2e-5).assert([away], [1e-3], "the normal points away from the surface");
                }
                None => prop_assert!(least > 1e-7, "passed at {least} without a hit"),
            }
            let extent = object.half_extent() + DVec3::splat(1e-9);
            if let Some(t) = found {
                prop_assert!(((origin + direction * t - centre).abs().cmple(extent)).all());
            }
        }
    }
}
