//! Whether objects stand on what the depth shows, hover over it or are sunk into it.
//!
//! Under an object's foot, the outline of its lowest points and what lies within, the depth around each point gives a surface.
//! The nearest of these below is what carries it: a thing that stands out over the edge of a table stands on the table. A gap
//! is claimed only where most of the points see a surface on which things can stand, and where it is larger than what depth,
//! poses and the surface's own unevenness explain. A thing that stands on another one of the scene is left alone, and so is
//! what real things hide: what the camera sees there is not its ground. If no ground is seen around it either, it lies under what is
//! seen.
//!
//! A thing in the air may have something steep or uneven behind its foot. Then the level plane among the depth's points vertically below it
//! tells how high it hovers. What lies against a wall is left alone: its foot touches the wall, and none of it is behind.

use glam::{DVec2, DVec3};

use super::pick::nearest_of;
use super::{Eye, Ray, Shot};
use crate::frame::Frame;
use crate::scene::{MIN_SUPPORT_COSINE, Scene};

/// How an object stands on the surface that a frame's depth shows under it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Index into [`Scene::objects`].
    pub object: usize,
    /// Above the surface if positive, metres; `None` if it stands on it, as far as can be told.
    pub gap_m: Option<f64>,
}

/// Points this near to an object's lowest one, as a share of its size, stand on the ground.
const FOOT: f64 = 0.02;
/// Directions in which the outermost of them are looked at.
const DIRECTIONS: usize = 8;
/// A smaller gap is none: metres, share of the depth, and times the surface's unevenness. A Kinect's scale is off by up to 3.5 %
/// along the ray, but what stands was mostly placed by the same depth.
const LEAST_M: f64 = 0.005;
const LEAST_SHARE: f64 = 0.015;
const LEAST_SIGMA: f64 = 3.0;
/// What is sunk deeper than it is large may have something real before it. Then its ground is seen beside it: of the places within
/// so many times the gap, looked at every so many pixels, at least this share is level with its foot.
const DEEPEST: f64 = 1.0;
const BESIDE: f64 = 3.0;
const EVERY_PX: usize = 2;
const FEWEST_LEVEL: f64 = 0.02;
/// Less of a neighbourhood on one plane is no surface.
const LEAST_ON_IT: f64 = 0.4;
/// So many points of the foot that touch a surface make it stand there: one may be a stray measurement.
const FEWEST_TOUCHING: usize = 2;
/// A virtual thing this near below carries it, metres.
const CARRIES_M: f64 = 0.005;
/// At least this share of a foot is in the air before such things, or over what is level, if what lies below it is to tell.
const LEAST_IN_AIR: f64 = 0.25;

/// Points of a foot before, at and behind what is too steep or too uneven to carry it.
#[derive(Clone, Copy, Debug, Default)]
struct Uneven {
    before: usize,
    at: usize,
    behind: usize,
}

impl Uneven {
    fn take(&mut self, off_m: f64, least_m: f64) {
        let side = match off_m {
            off_m if off_m > least_m => &mut self.before,
            off_m if off_m < -least_m => &mut self.behind,
            _ => &mut self.at,
        };
        *side += 1;
    }

    /// Whether a foot of so many points is in the air there, and not stuck to a wall.
    fn is_in_air(self, points: usize) -> bool {
        let is_stuck = self.at >= FEWEST_TOUCHING && self.behind == 0;
        !is_stuck && self.before as f64 >= LEAST_IN_AIR * points as f64
    }
}

impl Shot {
    /// The objects under which a frame's depth shows a surface. Nothing is said without depth or the world's up.
    pub fn standing(&self, frame: &Frame) -> Vec<Standing> {
        let (Some(up), Ok(eye), true) = (self.scene.up_in_world, self.eye(frame.index), frame.depth.is_some()) else {
            return Vec::new();
        };
        let of = |object: usize| Some(Standing { object, gap_m: self.gap(frame, &eye, object, up)? });
        (0..self.scene.objects.len()).filter_map(of).collect()
    }

    /// `None` if nothing can be said.
    fn gap(&self, frame: &Frame, eye: &Eye, object: usize, up: DVec3) -> Option<Option<f64>> {
        let feet = feet(&self.scene, object, up)?;
        let carried =
            feet.points_m.iter().filter(|foot| is_carried(&self.scene, object, **foot, up, feet.size_m)).count();
        if carried > 0 {
            return None;
        }
        let i = &eye.geometry().intrinsics;
        let picture = DVec2::new(i.width_px.into(), i.height_px.into());
        let (mut gaps, mut normal, mut uneven) = (Vec::new(), DVec3::ZERO, Uneven::default());
        let mut least_m = LEAST_M;
        for foot in &feet.points_m {
            let Some(at) = eye.project(*foot).filter(|at| at.cmpge(DVec2::ZERO).all() && at.cmplt(picture).all())
            else {
                continue;
            };
            let Ok(surface) = self.surface_at(frame, at) else { continue };
            let off_m = (*foot - surface.point_m).dot(surface.normal_in_world);
            let known_m = LEAST_M.max(LEAST_SHARE * surface.depth_m).max(LEAST_SIGMA * surface.sigma_m);
            if surface.normal_in_world.dot(up) < MIN_SUPPORT_COSINE || surface.share < LEAST_ON_IT {
                uneven.take(off_m, known_m);
                continue;
            }
            gaps.push(off_m);
            normal += surface.normal_in_world;
            least_m = least_m.max(known_m);
        }
        gaps.sort_by(f64::total_cmp);
        let gap = above_m(&gaps, least_m, feet.points_m.len());
        uneven.before += gaps.iter().filter(|gap_m| **gap_m > least_m).count();
        // Along a ray it may be farther to what is seen than down to what lies below.
        let over_m = || self.over_depth_m(frame, &self.scene.objects[object], up).filter(|over_m| *over_m > least_m);
        let gap = match gap {
            Some(Some(gap_m)) if gap_m > 0.0 => Some(over_m().map_or(gap_m, |over_m| over_m.min(gap_m))),
            None if uneven.is_in_air(feet.points_m.len()) => Some(over_m()?),
            told => told?,
        };
        let Some(deep_m) = gap.map(|gap| -gap).filter(|deep_m| *deep_m > DEEPEST * feet.size_m) else {
            return Some(gap);
        };
        let (foot, normal) = (feet.points_m.last()?, normal.normalize_or(up));
        (!self.is_ground_seen(frame, eye, (*foot, normal), BESIDE * deep_m, least_m)).then_some(gap)
    }

    /// Whether a frame's depth shows what is level with a foot, across a normal, but for `within_m`, and not farther from it than
    /// `beside_m`.
    fn is_ground_seen(
        &self,
        frame: &Frame,
        eye: &Eye,
        (foot_m, normal): (DVec3, DVec3),
        beside_m: f64,
        within_m: f64,
    ) -> bool {
        let Some(depth) = &frame.depth else { return false };
        let Ok(pose) = self.measured_from(frame, depth) else { return false };
        let (mut near, mut level) = (0usize, 0usize);
        for y in (0..depth.height as usize).step_by(EVERY_PX) {
            for x in (0..depth.width as usize).step_by(EVERY_PX) {
                let z = f64::from(depth.depth_m[y * depth.width as usize + x]);
                let Some(ray) = eye.geometry().depth_ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) else { continue };
                let off = pose.inverse_transform_point(z * ray) - foot_m;
                let above_m = off.dot(normal);
                if z > 0.0 && (off - above_m * normal).length() < beside_m {
                    near += 1;
                    level += usize::from(above_m.abs() < within_m);
                }
            }
        }
        level as f64 > FEWEST_LEVEL * near as f64
    }
}

/// How far a foot of so many points is above what carries it, by the gaps that are known, ascending; `None` inside where it is
/// less than `least_m`. Nothing where too few are known, or where they do not agree.
fn above_m(gaps_m: &[f64], least_m: f64, points: usize) -> Option<Option<f64>> {
    let agreeing = |at: f64| gaps_m.iter().filter(|gap| (*gap - at).abs() <= least_m).count();
    let is_most = |count: usize| 2 * count > points;
    if agreeing(0.0) >= FEWEST_TOUCHING {
        return Some(None);
    }
    let over: Vec<f64> = gaps_m.iter().copied().filter(|gap| *gap > least_m).collect();
    if is_most(over.len()) {
        let [nearest, _] = *over.array_windows().find(|[a, b]| b - a <= least_m)?;
        let same = over.partition_point(|gap| *gap <= nearest + 2.0 * least_m);
        let from = over.partition_point(|gap| *gap < nearest);
        return Some(Some(over[(from + same) / 2]));
    }
    let middle = *gaps_m.get(gaps_m.len() / 2)?;
    is_most(agreeing(middle)).then_some((middle.abs() > least_m).then_some(middle))
}

/// Where an object stands.
struct Feet {
    points_m: Vec<DVec3>,
    /// The object's largest extent along the world's axes.
    size_m: f64,
}

fn feet(scene: &Scene, object: usize, up: DVec3) -> Option<Feet> {
    let points: Vec<DVec3> = scene.objects[object].points_m(scene).collect();
    let low = points.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
    let size_m = (high - low).max_element();
    let lowest = points.iter().map(|p| p.dot(up)).reduce(f64::min)?;
    let standing: Vec<DVec3> = points.into_iter().filter(|p| p.dot(up) - lowest <= FOOT * size_m).collect();
    let (x, y) = up.any_orthonormal_pair();
    let outermost = (0..DIRECTIONS).filter_map(|n| {
        let (s, c) = (std::f64::consts::TAU * n as f64 / DIRECTIONS as f64).sin_cos();
        let towards = c * x + s * y;
        standing.iter().copied().max_by(|a, b| a.dot(towards).total_cmp(&b.dot(towards)))
    });
    let mut points_m: Vec<DVec3> = outermost.collect();
    let middle = points_m.iter().sum::<DVec3>() / points_m.len() as f64;
    // What lies within the outline, too.
    points_m.extend(points_m.clone().iter().map(|point| 0.5 * (*point + middle)));
    points_m.push(middle);
    Some(Feet { points_m, size_m })
}

/// Whether another object lies closely below a point, or around it.
fn is_carried(scene: &Scene, object: usize, foot: DVec3, up: DVec3, size_m: f64) -> bool {
    let ray = Ray { origin_m: foot + size_m.min(CARRIES_M) * up, direction: -up };
    nearest_of(scene, &ray, |other| other != object).is_some_and(|hit| hit.distance_m <= 2.0 * CARRIES_M)
}

#[cfg(test)]
mod tests {
    use super::{Uneven, above_m};

    #[test]
    fn what_touches_a_wall_is_stuck_to_it_and_what_it_goes_through_is_not() {
        let is_in_air = |offs_m: &[f64]| {
            let mut uneven = Uneven::default();
            offs_m.iter().for_each(|off_m| uneven.take(*off_m, 0.01));
            uneven.is_in_air(8)
        };
        assert!(is_in_air(&[0.1, 0.2, 0.3]) && is_in_air(&[0.1, 0.1, 0.0, 0.0, -0.1]));
        assert!(!is_in_air(&[0.1, 0.1, 0.005, -0.005]) && !is_in_air(&[0.1]) && !is_in_air(&[-0.1; 8]));
    }

    #[test]
    fn the_nearest_surface_under_the_foot_carries() {
        let told = |gaps: &[f64]| above_m(gaps, 0.005, 9);
        // On a table, and most of it over the floor beside it; one alone may be a stray.
        assert_eq!(told(&[-0.001, 0.002, 0.7, 0.7, 0.7, 0.7, 0.7, 0.7]), Some(None));
        assert_eq!(told(&[0.002, 0.699, 0.7, 0.7, 0.7, 0.7, 0.701]), Some(Some(0.7)));
        // Five centimetres over the table: the table counts. One stray is no surface.
        assert_eq!(told(&[0.05, 0.051, 0.052, 0.7, 0.7, 0.7, 0.7, 0.7]), Some(Some(0.051)));
        assert_eq!(told(&[0.3, 0.699, 0.7, 0.7, 0.7, 0.7]), Some(Some(0.7)));
        // Too few are known, or they do not agree.
        assert_eq!([told(&[]), told(&[0.7; 4]), told(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])], [None; 3]);
        // In the ground most have to agree.
        assert_eq!(told(&[-0.03, -0.03, -0.03, -0.03, -0.03, 0.4, 0.4]), Some(Some(-0.03)));
        assert_eq!(told(&[-0.5, -0.5, -0.03, -0.03, 0.1]), None);
    }
}
