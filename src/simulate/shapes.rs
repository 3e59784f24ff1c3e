//! Shapes for ray casting: the room, blocks, a tub, balls, flat panels.
//!
//! Every shape has faces, and every face a chart (u, v) in [0, 1]². [`SiteShape::hit`] returns the
//! chart coordinates of an intersection; [`SiteShape::point`] maps chart coordinates to the world.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

/// Smallest ray parameter of a hit: nearer ones are on the ray's own surface. Metres (for rays of
/// length near 1).
const MIN_T: f64 = 1e-6;

/// A shape in the world, metres.
#[derive(Clone, Debug)]
pub enum SiteShape {
    /// Seen from inside. Faces −x, +x, −y, +y, −z, +z.
    Room {
        min: DVec3,
        max: DVec3,
    },
    /// Rotated by `yaw_rad` about its vertical axis. Faces as for the room.
    Block {
        centre: DVec3,
        half: DVec3,
        yaw_rad: f64,
    },
    /// An upright, open conical frustum with a thin wall: outside, inside, bottom.
    Tub {
        base: DVec3,
        bottom_radius: f64,
        top_radius: f64,
        height: f64,
    },
    Ball {
        centre: DVec3,
        radius: f64,
    },
    /// A parallelogram, visible from both sides: a corner and the two edges from it.
    Panel {
        corner: DVec3,
        u: DVec3,
        v: DVec3,
    },
}

/// Intersection of a ray: at `origin + t * direction`, on `face`, at `uv` of its chart.
#[derive(Clone, Copy, Debug)]
pub struct SiteHit {
    pub t: f64,
    pub face: usize,
    pub uv: DVec2,
    /// Unit length, towards the ray's origin.
    pub normal: DVec3,
}

/// The two axes that span a face perpendicular to `axis`.
fn chart_axes(axis: usize) -> (usize, usize) {
    [(1, 2), (0, 2), (0, 1)][axis]
}

fn axis_vector(axis: usize, sign: f64) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|a| if a == axis { sign } else { 0.0 }))
}

/// Transforms a vector from the world's to the block's axes: a rotation by −yaw about z.
fn turned(p: DVec3, yaw_rad: f64) -> DVec3 {
    let (s, c) = yaw_rad.sin_cos();
    DVec3::new(c * p.x + s * p.y, c * p.y - s * p.x, p.z)
}

/// Entry and exit of a ray through an axis-aligned box: (t, face) each.
fn slabs(origin: DVec3, direction: DVec3, min: DVec3, max: DVec3) -> Option<[(f64, usize); 2]> {
    let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
    for axis in 0..3 {
        let inverse = 1.0 / direction[axis];
        let (low, high) = ((min[axis] - origin[axis]) * inverse, (max[axis] - origin[axis]) * inverse);
        let (near, far, near_face) = if inverse >= 0.0 { (low, high, 2 * axis) } else { (high, low, 2 * axis + 1) };
        if near > enter.0 {
            enter = (near, near_face);
        }
        if far < leave.0 {
            leave = (far, near_face ^ 1);
        }
    }
    (enter.0 <= leave.0).then_some([enter, leave])
}

fn box_hit(origin: DVec3, direction: DVec3, min: DVec3, max: DVec3) -> Option<SiteHit> {
    let [enter, leave] = slabs(origin, direction, min, max)?;
    let ((t, face), inside) = if enter.0 > MIN_T { (enter, -1.0) } else { (leave, 1.0) };
    if t <= MIN_T {
        return None;
    }
    let axis = face / 2;
    let p = (origin + direction * t - min) / (max - min);
    let (a, b) = chart_axes(axis);
    let outward = if face % 2 == 0 { -1.0 } else { 1.0 };
    Some(SiteHit { t, face, uv: DVec2::new(p[a], p[b]), normal: axis_vector(axis, -inside * outward) })
}

impl SiteShape {
    pub fn faces(&self) -> usize {
        match self {
            Self::Room { .. } | Self::Block { .. } => 6,
            Self::Tub { .. } => 3,
            Self::Ball { .. } | Self::Panel { .. } => 1,
        }
    }

    /// Extent of a face's chart along u and v, metres.
    pub fn face_size_m(&self, face: usize) -> DVec2 {
        match *self {
            Self::Room { min, max } => {
                let (a, b) = chart_axes((face / 2).min(2));
                DVec2::new(max[a] - min[a], max[b] - min[b])
            }
            Self::Block { half, .. } => {
                let (a, b) = chart_axes((face / 2).min(2));
                2.0 * DVec2::new(half[a], half[b])
            }
            Self::Tub { bottom_radius, top_radius, height, .. } if face < 2 => {
                DVec2::new(PI * (bottom_radius + top_radius), height)
            }
            Self::Tub { bottom_radius, .. } => DVec2::splat(2.0 * bottom_radius),
            Self::Ball { radius, .. } => DVec2::new(TAU * radius, PI * radius),
            Self::Panel { u, v, .. } => DVec2::new(u.length(), v.length()),
        }
    }

    /// Point and outward unit normal (inward for the room and the tub's inside) at chart
    /// coordinates of a face.
    pub fn point(&self, face: usize, uv: DVec2) -> (DVec3, DVec3) {
        let on_box = |min: DVec3, max: DVec3| {
            let axis = (face / 2).min(2);
            let (a, b) = chart_axes(axis);
            let mut p = if face.is_multiple_of(2) { min } else { max };
            p[a] = min[a] + uv.x * (max[a] - min[a]);
            p[b] = min[b] + uv.y * (max[b] - min[b]);
            (p, axis_vector(axis, if face.is_multiple_of(2) { -1.0 } else { 1.0 }))
        };
        match *self {
            Self::Room { min, max } => {
                let (p, n) = on_box(min, max);
                (p, -n)
            }
            Self::Block { centre, half, yaw_rad } => {
                let (p, n) = on_box(-half, half);
                (centre + turned(p, -yaw_rad), turned(n, -yaw_rad))
            }
            Self::Tub { base, bottom_radius, top_radius, height } if face < 2 => {
                let (s, c) = (TAU * uv.x).sin_cos();
                let radius = bottom_radius + (top_radius - bottom_radius) * uv.y;
                let n = DVec3::new(c, s, -(top_radius - bottom_radius) / height).normalize();
                (base + DVec3::new(radius * c, radius * s, height * uv.y), if face == 0 { n } else { -n })
            }
            Self::Tub { base, bottom_radius, .. } => {
                let p = (uv * 2.0 - 1.0) * bottom_radius;
                (base + p.extend(0.004), DVec3::Z)
            }
            Self::Ball { centre, radius } => {
                let ((s, c), (sv, cv)) = ((TAU * uv.x).sin_cos(), (PI * uv.y).sin_cos());
                let n = DVec3::new(sv * c, sv * s, cv);
                (centre + n * radius, n)
            }
            Self::Panel { corner, u, v } => (corner + u * uv.x + v * uv.y, u.cross(v).normalize()),
        }
    }

    /// Bounding sphere, for early rejection.
    pub fn bounds(&self) -> (DVec3, f64) {
        match *self {
            Self::Room { min, max } => (0.5 * (min + max), 0.5 * (max - min).length()),
            Self::Block { centre, half, .. } => (centre, half.length()),
            Self::Tub { base, bottom_radius, top_radius, height } => {
                (base + 0.5 * height * DVec3::Z, bottom_radius.max(top_radius).hypot(0.5 * height))
            }
            Self::Ball { centre, radius } => (centre, radius),
            Self::Panel { corner, u, v } => (corner + 0.5 * (u + v), 0.5 * (u + v).length().max((u - v).length())),
        }
    }

    /// The nearest intersection. From inside a block, the exit.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<SiteHit> {
        match *self {
            Self::Room { min, max } => box_hit(origin, direction, min, max),
            Self::Block { centre, half, yaw_rad } => {
                let hit = box_hit(turned(origin - centre, yaw_rad), turned(direction, yaw_rad), -half, half)?;
                Some(SiteHit { normal: turned(hit.normal, -yaw_rad), ..hit })
            }
            Self::Tub { base, bottom_radius, top_radius, height } => {
                tub_hit(origin - base, direction, bottom_radius, (top_radius - bottom_radius) / height, height)
            }
            Self::Ball { centre, radius } => {
                let o = origin - centre;
                let (a, b, c) = (direction.length_squared(), o.dot(direction), o.length_squared() - radius * radius);
                let root = (b * b - a * c).max(-1.0).sqrt();
                let t = [(-b - root) / a, (-b + root) / a].into_iter().find(|t| *t > MIN_T)?;
                let n = (o + direction * t) / radius;
                let uv = DVec2::new(n.y.atan2(n.x).rem_euclid(TAU) / TAU, n.z.clamp(-1.0, 1.0).acos() / PI);
                Some(SiteHit { t, face: 0, uv, normal: if n.dot(direction) > 0.0 { -n } else { n } })
            }
            Self::Panel { corner, u, v } => {
                let n = u.cross(v);
                let t = n.dot(corner - origin) / n.dot(direction);
                if !(t > MIN_T && t.is_finite()) {
                    return None;
                }
                // Cramer's rule in the panel's plane.
                let p = origin + direction * t - corner;
                let (uu, uv, vv, pu, pv) = (u.dot(u), u.dot(v), v.dot(v), p.dot(u), p.dot(v));
                let at = DVec2::new(pu * vv - pv * uv, pv * uu - pu * uv) / (uu * vv - uv * uv);
                let normal = n.normalize() * if n.dot(direction) > 0.0 { -1.0 } else { 1.0 };
                (at.min_element() >= 0.0 && at.max_element() <= 1.0).then_some(SiteHit { t, face: 0, uv: at, normal })
            }
        }
    }
}

/// A frustum at the origin: x² + y² = (radius + slope·z)² for 0 ≤ z ≤ height, and its bottom.
fn tub_hit(o: DVec3, d: DVec3, radius: f64, slope: f64, height: f64) -> Option<SiteHit> {
    let (r, dr) = (radius + slope * o.z, slope * d.z);
    let a = d.x * d.x + d.y * d.y - dr * dr;
    let b = o.x * d.x + o.y * d.y - r * dr;
    let c = o.x * o.x + o.y * o.y - r * r;
    let root = (b * b - a * c).sqrt();
    let side = [(-b - root) / a, (-b + root) / a]
        .into_iter()
        .filter(|t| *t > MIN_T && (0.0..=height).contains(&(o.z + d.z * t)) && radius + slope * (o.z + d.z * t) > 0.0)
        .min_by(f64::total_cmp);
    let floor = (0.004 - o.z) / d.z;
    let p = o + d * floor;
    if floor > MIN_T && floor < side.unwrap_or(f64::INFINITY) && p.x.hypot(p.y) <= radius {
        let uv = DVec2::new(p.x, p.y) / (2.0 * radius) + 0.5;
        return Some(SiteHit { t: floor, face: 2, uv, normal: DVec3::new(0.0, 0.0, -d.z.signum()) });
    }
    let t = side?;
    let p = o + d * t;
    let outward = DVec3::new(p.x, p.y, -slope * p.x.hypot(p.y)).normalize();
    let uv = DVec2::new(p.y.atan2(p.x).rem_euclid(TAU) / TAU, p.z / height);
    let outside = outward.dot(d) < 0.0;
    Some(SiteHit { t, face: usize::from(!outside), uv, normal: if outside { outward } else { -outward } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> Vec<SiteShape> {
        vec![
            SiteShape::Room { min: DVec3::new(-2.0, -3.0, -1.0), max: DVec3::new(2.0, 3.0, 2.0) },
            SiteShape::Block { centre: DVec3::new(0.3, 0.2, 0.1), half: DVec3::new(0.5, 0.2, 0.3), yaw_rad: 0.4 },
            SiteShape::Tub { base: DVec3::new(0.1, 0.0, -0.2), bottom_radius: 0.3, top_radius: 0.4, height: 0.5 },
            SiteShape::Ball { centre: DVec3::new(-0.1, 0.2, 0.0), radius: 0.4 },
            SiteShape::Panel { corner: DVec3::new(-0.4, -0.5, 0.2), u: DVec3::X, v: DVec3::new(0.2, 0.9, 0.3) },
        ]
    }

    proptest! {
        /// A ray hits where the face's chart predicts, on a surface whose normal faces the ray's
        /// origin.
        #[test]
        fn chart_point_matches_ray_hit(
            (x, y, z) in (-1.9f64..1.9, 0.8f64..2.9, -0.9f64..1.9),
            target in (-0.5f64..0.5, -0.5f64..0.5, -0.3f64..0.5),
        ) {
            let origin = DVec3::new(x, y, z);
            let direction = DVec3::from(target) - origin;
            for shape in shapes() {
                if let Some(hit) = shape.hit(origin, direction) {
                    let (p, n) = shape.point(hit.face, hit.uv);
                    prop_assert!((p - (origin + direction * hit.t)).length() < 1e-6, "{shape:?} {hit:?}");
                    prop_assert!(n.dot(hit.normal).abs() > 1.0 - 1e-9, "{shape:?} {hit:?} {n}");
                    prop_assert!(hit.normal.dot(direction) <= 0.0, "{shape:?} {hit:?}");
                }
            }
        }
    }

    #[test]
    fn hit_distances_match_hand_calculation() {
        let down = |shape: &SiteShape| shape.hit(DVec3::new(0.0, 0.1, 1.5), DVec3::NEG_Z).map(|h| h.t);
        let all = shapes();
        assert_eq!(down(&all[0]), Some(2.5));
        assert!((down(&all[1]).unwrap() - 1.1).abs() < 1e-12);
        assert!((down(&all[2]).unwrap() - 1.696).abs() < 1e-12, "the tub's bottom");
        // z² = 0.16 - 0.01 - 0.01
        assert!((down(&all[3]).unwrap() - (1.5 - 0.14f64.sqrt())).abs() < 1e-12);
        // The panel's z at y = 0.1 is 0.2 + 0.3 · 0.6 / 0.9.
        assert!((down(&all[4]).unwrap() - 1.1).abs() < 1e-12);
        assert!(all[3].hit(DVec3::new(2.0, 2.0, 2.0), DVec3::X).is_none());
    }
}
