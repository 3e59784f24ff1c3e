//! Gaps between objects and the surface that a frame's depth shows below them: objects that hover
//! or are sunk.
//!
//! The footprint of an object is sampled along the outline of its lowest points and inside it. The
//! depth around each sample gives a surface. The nearest of these below supports the object: one
//! that extends over the edge of a table stands on the table. A gap is reported only if most
//! samples have a surface that can support objects, and if the gap exceeds the error of depth,
//! poses and the surface's unevenness. Objects on other objects of the scene are skipped. So are
//! objects whose footprint real objects occlude: the visible surface is not their support. If the
//! support is not visible around the footprint either, the object is below the visible surface.
//!
//! Behind the footprint of a hovering object there may be a steep or uneven surface. Then the level
//! plane among the depth's points vertically below gives the height. Objects against a wall are
//! skipped: their footprint touches the wall, and none of it is behind.

use glam::{DVec2, DVec3};

use super::pick::nearest_of;
use super::{PosedCamera, Shot, ViewRay};
use crate::frame::Frame;
use crate::scene::{MIN_SUPPORT_COSINE, Scene};
use crate::support::FootprintSamples;

/// The gap between an object and the surface of a frame's depth below it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupportGap {
    /// Index into [`Scene::objects`].
    pub object: usize,
    /// Height over the surface, negative if sunk, m; `None` if the object stands on it within the
    /// error.
    pub gap_m: Option<f64>,
}

/// Smallest gap that is reported: m, as a share of the depth, and as a multiple of the surface's
/// unevenness. A Kinect's scale is off by up to 3.5 % along the ray, but most objects were placed
/// by the same depth.
const MIN_GAP_M: f64 = 0.005;
const MIN_GAP_PER_DEPTH: f64 = 0.015;
const MIN_GAP_PER_SIGMA: f64 = 3.0;
/// Depth below the surface, as a multiple of the object's size, from which on a real object may
/// occlude it. Then its support is searched beside it.
const MAX_SUNK_SIZES: f64 = 1.0;
/// Radius of that search, as a multiple of the gap.
const SEARCH_PER_GAP: f64 = 3.0;
/// Pixel stride of that search.
const SEARCH_STRIDE_PX: usize = 2;
/// Smallest share of points in the search that are level with the footprint, for a visible support.
const MIN_LEVEL_SHARE: f64 = 0.02;
/// Smallest share of a neighbourhood on one plane, for a surface.
const MIN_PLANE_SHARE: f64 = 0.4;
/// Smallest number of samples in contact with a surface that supports the object: a single one may
/// be a stray measurement.
const MIN_CONTACTS: usize = 2;
/// Largest gap to a virtual object that supports another one, m.
const MAX_STACKED_GAP_M: f64 = 0.005;
/// Smallest share of the footprint in front of steep surfaces, for an object in the air.
const MIN_IN_AIR_SHARE: f64 = 0.25;

/// Samples of the footprint in front of, at and behind surfaces that are too steep or uneven to
/// support it.
#[derive(Clone, Copy, Debug, Default)]
struct SteepContacts {
    before: usize,
    contact: usize,
    behind: usize,
}

impl SteepContacts {
    fn take(&mut self, off_m: f64, min_m: f64) {
        let side = match off_m {
            off_m if off_m > min_m => &mut self.before,
            off_m if off_m < -min_m => &mut self.behind,
            _ => &mut self.contact,
        };
        *side += 1;
    }

    /// Whether a footprint with this number of samples is in the air there, and not attached to a
    /// wall.
    fn is_in_air(self, points: usize) -> bool {
        let is_attached = self.contact >= MIN_CONTACTS && self.behind == 0;
        !is_attached && self.before as f64 >= MIN_IN_AIR_SHARE * points as f64
    }
}

impl Shot {
    /// The gaps of all objects with a surface below them in a frame's depth. Empty without depth or
    /// the world's up.
    pub fn support_gaps(&self, frame: &Frame) -> Vec<SupportGap> {
        let (Some(up), Ok(eye), true) = (self.scene.up_in_world, self.posed_camera(frame.index), frame.depth.is_some())
        else {
            return Vec::new();
        };
        let support_gap = |object: usize| Some(SupportGap { object, gap_m: self.gap(frame, &eye, object, up)? });
        (0..self.scene.objects.len()).filter_map(support_gap).collect()
    }

    /// `None` if the gap is undetermined, `Some(None)` if the object stands on its support.
    fn gap(&self, frame: &Frame, eye: &PosedCamera, object: usize, up: DVec3) -> Option<Option<f64>> {
        let footprint = FootprintSamples::of(&self.scene, &self.scene.objects[object], up)?;
        let stacked = footprint
            .points_m
            .iter()
            .filter(|sample| is_on_object(&self.scene, object, **sample, up, footprint.size_m))
            .count();
        if stacked > 0 {
            return None;
        }
        let i = &eye.geometry().intrinsics;
        let picture = DVec2::new(i.width_px.into(), i.height_px.into());
        let (mut gaps, mut normal, mut steep) = (Vec::new(), DVec3::ZERO, SteepContacts::default());
        let mut min_m = MIN_GAP_M;
        for sample in &footprint.points_m {
            let Some(at) = eye.project(*sample).filter(|at| at.cmpge(DVec2::ZERO).all() && at.cmplt(picture).all())
            else {
                continue;
            };
            let Ok(surface) = self.surface_at(frame, at) else { continue };
            let off_m = surface.plane.height_m(*sample);
            let known_m = MIN_GAP_M.max(MIN_GAP_PER_DEPTH * surface.depth_m).max(MIN_GAP_PER_SIGMA * surface.sigma_m);
            if surface.plane.normal.dot(up) < MIN_SUPPORT_COSINE || surface.share < MIN_PLANE_SHARE {
                steep.take(off_m, known_m);
                continue;
            }
            gaps.push(off_m);
            normal += surface.plane.normal;
            min_m = min_m.max(known_m);
        }
        gaps.sort_by(f64::total_cmp);
        let gap = height_m(&gaps, min_m, footprint.points_m.len());
        steep.before += gaps.iter().filter(|gap_m| **gap_m > min_m).count();
        // The visible surface along a ray may be farther than the one vertically below.
        let over_m =
            || self.height_over_depth_m(frame, &self.scene.objects[object], up).filter(|over_m| *over_m > min_m);
        let gap = match gap {
            Some(Some(gap_m)) if gap_m > 0.0 => Some(over_m().map_or(gap_m, |over_m| over_m.min(gap_m))),
            None if steep.is_in_air(footprint.points_m.len()) => Some(over_m()?),
            gap => gap?,
        };
        let Some(deep_m) = gap.map(|gap| -gap).filter(|deep_m| *deep_m > MAX_SUNK_SIZES * footprint.size_m) else {
            return Some(gap);
        };
        let (sample, normal) = (footprint.points_m.last()?, normal.normalize_or(up));
        (!self.has_measured_ground(frame, eye, (*sample, normal), SEARCH_PER_GAP * deep_m, min_m)).then_some(gap)
    }

    /// True if the depth map has enough points within `within_m` of the plane through the
    /// footprint, at most `beside_m` away.
    fn has_measured_ground(
        &self,
        frame: &Frame,
        eye: &PosedCamera,
        (foot_m, normal): (DVec3, DVec3),
        beside_m: f64,
        within_m: f64,
    ) -> bool {
        let Some(depth) = &frame.depth else { return false };
        let Ok(pose) = self.measured_from(frame, depth) else { return false };
        let (mut near, mut level) = (0usize, 0usize);
        for y in (0..depth.height as usize).step_by(SEARCH_STRIDE_PX) {
            for x in (0..depth.width as usize).step_by(SEARCH_STRIDE_PX) {
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
        level as f64 > MIN_LEVEL_SHARE * near as f64
    }
}

/// Height of a footprint with `points` samples over its support, by the known gaps in ascending
/// order: `Some(None)` for a gap below `min_m`, `None` if too few are known or they disagree.
fn height_m(gaps_m: &[f64], min_m: f64, points: usize) -> Option<Option<f64>> {
    let agreeing = |at: f64| gaps_m.iter().filter(|gap| (*gap - at).abs() <= min_m).count();
    let is_majority = |count: usize| 2 * count > points;
    if agreeing(0.0) >= MIN_CONTACTS {
        return Some(None);
    }
    let over: Vec<f64> = gaps_m.iter().copied().filter(|gap| *gap > min_m).collect();
    if is_majority(over.len()) {
        let [nearest, _] = *over.array_windows().find(|[a, b]| b - a <= min_m)?;
        let same = over.partition_point(|gap| *gap <= nearest + 2.0 * min_m);
        let from = over.partition_point(|gap| *gap < nearest);
        return Some(Some(over[(from + same) / 2]));
    }
    let middle = *gaps_m.get(gaps_m.len() / 2)?;
    is_majority(agreeing(middle)).then_some((middle.abs() > min_m).then_some(middle))
}

/// Whether another object of the scene is closely below a point, or around it.
fn is_on_object(scene: &Scene, object: usize, sample: DVec3, up: DVec3, size_m: f64) -> bool {
    let ray = ViewRay { origin_m: sample + size_m.min(MAX_STACKED_GAP_M) * up, direction: -up };
    nearest_of(scene, &ray, |other| other != object).is_some_and(|hit| hit.distance_m <= 2.0 * MAX_STACKED_GAP_M)
}

#[cfg(test)]
mod tests {
    use super::{SteepContacts, height_m};

    #[test]
    fn footprint_that_only_touches_a_wall_is_attached_to_it() {
        let is_in_air = |offs_m: &[f64]| {
            let mut steep = SteepContacts::default();
            offs_m.iter().for_each(|off_m| steep.take(*off_m, 0.01));
            steep.is_in_air(8)
        };
        assert!(is_in_air(&[0.1, 0.2, 0.3]) && is_in_air(&[0.1, 0.1, 0.0, 0.0, -0.1]));
        assert!(!is_in_air(&[0.1, 0.1, 0.005, -0.005]) && !is_in_air(&[0.1]) && !is_in_air(&[-0.1; 8]));
    }

    #[test]
    fn height_is_over_the_nearest_surface_that_enough_samples_agree_on() {
        let height = |gaps: &[f64]| height_m(gaps, 0.005, 9);
        // On a table, with most of it over the floor beside it; a single contact may be a stray.
        assert_eq!(height(&[-0.001, 0.002, 0.7, 0.7, 0.7, 0.7, 0.7, 0.7]), Some(None));
        assert_eq!(height(&[0.002, 0.699, 0.7, 0.7, 0.7, 0.7, 0.701]), Some(Some(0.7)));
        // 5 cm over the table: the table counts. A single stray is no surface.
        assert_eq!(height(&[0.05, 0.051, 0.052, 0.7, 0.7, 0.7, 0.7, 0.7]), Some(Some(0.051)));
        assert_eq!(height(&[0.3, 0.699, 0.7, 0.7, 0.7, 0.7]), Some(Some(0.7)));
        // Too few gaps, or they disagree.
        assert_eq!([height(&[]), height(&[0.7; 4]), height(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])], [None; 3]);
        // Below the surface, most samples must agree.
        assert_eq!(height(&[-0.03, -0.03, -0.03, -0.03, -0.03, 0.4, 0.4]), Some(Some(-0.03)));
        assert_eq!(height(&[-0.5, -0.5, -0.03, -0.03, 0.1]), None);
    }
}
