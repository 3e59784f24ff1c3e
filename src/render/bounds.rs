//! Where in the picture the objects can be, and how fast they move there. All full-area work stays inside that
//! rectangle.

use std::borrow::Cow;
use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::view::{NEAR_M, ViewKeys};
use crate::camera::{Geometry, LensModel};
use crate::pixels::Rect;
use crate::scene::Scene;

/// The part of a picture that objects can touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Whole pixels that objects may touch while the shutter is open; may extend beyond the picture. Empty if nothing
    /// is in view.
    pub rect: Rect,
    /// An upper bound on the speed of any point of the objects, px/s.
    pub fastest_px_per_s: f32,
    /// The range of depths of all points of the objects while the shutter is open, metres.
    pub depths_m: [f64; 2],
}

/// A bounding box in the axes of its mesh.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub low: DVec3,
    pub high: DVec3,
}

impl Bounds {
    pub fn of(points: impl Iterator<Item = [f32; 3]>) -> Option<Self> {
        points.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into())).fold(None, |b: Option<Self>, p| {
            Some(b.map_or(Self { low: p, high: p }, |b| Self { low: b.low.min(p), high: b.high.max(p) }))
        })
    }

    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            DVec3::new(
                pick(0, self.low.x, self.high.x),
                pick(1, self.low.y, self.high.y),
                pick(2, self.low.z, self.high.z),
            )
        })
    }
}

/// Cells across the longest side of a box.
const CELLS: f64 = 6.0;
/// A mesh with at most this many vertices is represented by them.
const FEW: usize = 512;

/// Points whose convex hull contains all the given points and is hardly larger than theirs: the points themselves if
/// they are few, otherwise the corners of boxes around nearby points.
pub fn outline(points: &[[f32; 3]]) -> Vec<DVec3> {
    let wide = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
    let Some(all) = Bounds::of(points.iter().copied()).filter(|_| points.len() > FEW) else {
        return points.iter().map(wide).collect();
    };
    let side = ((all.high - all.low).max_element() / CELLS).max(f64::MIN_POSITIVE);
    let mut cells: BTreeMap<[u32; 3], Bounds> = BTreeMap::new();
    for p in points.iter().map(wide) {
        let cell = ((p - all.low) / side).to_array().map(|v| v as u32);
        let own = cells.entry(cell).or_insert(Bounds { low: p, high: p });
        *own = Bounds { low: own.low.min(p), high: own.high.max(p) };
    }
    match 8 * cells.len() < points.len() {
        true => cells.values().flat_map(Bounds::corners).collect(),
        false => points.iter().map(wide).collect(),
    }
}

/// Normalised coordinates (x/z, y/z) of points seen with a pose; `None` if any is not in front of the camera.
fn normalised(points: &[DVec3], pose: &crate::pose::Pose) -> Option<Vec<DVec2>> {
    points
        .iter()
        .map(|&c| {
            let p = pose.transform_point(c);
            (p.z > NEAR_M).then(|| p.truncate() / p.z)
        })
        .collect()
}

/// An outline of at most this many points is clipped point by point; a larger one, by the box around it.
const CLIPPED: usize = 16;

/// Normalised coordinates of the part of some points' convex hull that lies in front of the near plane. Its corners are
/// the points in front, and where lines from those to the others meet the plane.
fn before_the_camera(points: &[DVec3], pose: &crate::pose::Pose) -> Vec<DVec2> {
    let near = 2.0 * NEAR_M;
    let seen: Vec<DVec3> = points.iter().map(|&p| pose.transform_point(p)).collect();
    let (front, back): (Vec<DVec3>, Vec<DVec3>) = seen.iter().partition(|p| p.z >= near);
    let meets = |f: &DVec3, b: &DVec3| f.lerp(*b, (f.z - near) / (f.z - b.z));
    let crossing = front.iter().flat_map(|f| back.iter().map(move |b| meets(f, b)));
    front.iter().copied().chain(crossing).map(|p| p.truncate() / p.z).collect()
}

/// The rectangle in the picture that contains a rectangle of normalised coordinates, plus a pixel for curvature between
/// the border's samples.
fn extent_px(low: DVec2, high: DVec2, geometry: &Geometry) -> Rect {
    let (mut px_low, mut px_high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for p in border(low, high, geometry.distortion.model == LensModel::OpencvFisheye) {
        let d = geometry.distorted_px(p);
        px_low = px_low.min(d);
        px_high = px_high.max(d);
    }
    let clamp = |v: f64| v.clamp(-1e6, 1e6);
    Rect::new(
        clamp(px_low.x).floor() as i32,
        clamp(px_low.y).floor() as i32,
        clamp(px_high.x).ceil() as i32,
        clamp(px_high.y).ceil() as i32,
    )
    .grown(1)
}

/// The corners of a box around the points, if there are many.
fn few(points: &[DVec3]) -> Vec<DVec3> {
    if points.len() <= CLIPPED {
        return points.to_vec();
    }
    let low = points.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
    Bounds { low, high }.corners().to_vec()
}

/// The footprint of all parts, by their meshes' outlines. A part that is partly at or behind the camera's plane counts
/// as everywhere if its front comes near the picture. A part that stays farther from the picture than the picture is
/// wide, farther than any blur, counts as nowhere.
///
/// Conservative: without distortion, a part's image lies in the rectangle around its outline's image; distortion maps
/// that rectangle's inside to the inside of its border's image; and poses within the shutter are sampled from key to
/// key ([`ViewKeys::sampled`]).
pub fn footprint(scene: &Scene, outlines: &[Cow<'_, [DVec3]>], geometry: &Geometry, keys: &ViewKeys) -> Footprint {
    let i = &geometry.intrinsics;
    let picture = Rect::full(i.width_px, i.height_px);
    let mut rect = Rect::new(0, 0, 0, 0);
    let mut fastest = 0.0f64;
    let (mut nearest, mut farthest) = (f64::INFINITY, NEAR_M);
    let (moments, step_s) = keys.sampled();
    for part in scene.objects.iter().flat_map(|o| &o.parts) {
        let points: Vec<_> = outlines[part.mesh].iter().map(|&p| part.world_from_mesh.transform_point3(p)).collect();
        if keys.poses.iter().all(|pose| points.iter().all(|&p| pose.transform_point(p).z < NEAR_M)) {
            continue;
        }
        let seen: Option<Vec<_>> = moments.iter().map(|pose| normalised(&points, pose)).collect();
        let clipped = || {
            let points = few(&points);
            moments.iter().flat_map(|pose| before_the_camera(&points, pose)).collect::<Vec<_>>()
        };
        let all = seen.as_ref().map_or_else(clipped, |seen| seen.concat());
        let low = all.iter().fold(DVec2::INFINITY, |m, p| m.min(*p));
        let high = all.iter().fold(DVec2::NEG_INFINITY, |m, p| m.max(*p));
        if all.is_empty() {
            continue;
        }
        let own = extent_px(low, high, geometry);
        let beside_px = i.width_px.max(i.height_px) as i32;
        if own.intersection(&picture.grown(beside_px)).is_empty() {
            continue;
        }
        for pose in &moments {
            for z in points.iter().map(|&p| pose.transform_point(p).z) {
                (nearest, farthest) = (nearest.min(z.max(NEAR_M)), farthest.max(z));
            }
        }
        let Some(seen) = seen else {
            // The whole picture, and a margin from which anything can be blurred in.
            rect = rect.union(&picture.grown(64));
            fastest = fastest.max(rotation_speed(geometry, keys));
            continue;
        };
        let at_px: Vec<Vec<DVec2>> =
            seen.iter().map(|points| points.iter().map(|&p| geometry.distorted_px(p)).collect()).collect();
        for pair in at_px.windows(2) {
            for (p, q) in pair[0].iter().zip(&pair[1]) {
                fastest = fastest.max(p.distance(*q) / step_s);
            }
        }
        rect = rect.union(&own);
    }
    let depths_m = [nearest.min(farthest), farthest];
    // A tenth more for acceleration between the moments.
    Footprint { rect, fastest_px_per_s: (1.1 * fastest) as f32, depths_m }
}

/// Points along a rectangle's border, so close together that its image is straight between them. Towards the sides of a
/// fisheye lengths grow without bound and angles do not, so there a step is at most 3°: an arc of 500 px radius then
/// lies 0.2 px off its chord.
fn border(low: DVec2, high: DVec2, fisheye: bool) -> impl Iterator<Item = DVec2> {
    let steps = if fisheye { 64 } else { 16 };
    let between = move |a: f64, b: f64, f: f64| match fisheye {
        true => (a.atan() + f * (b.atan() - a.atan())).tan(),
        false => a + f * (b - a),
    };
    (0..=steps).flat_map(move |n| {
        let f = f64::from(n) / f64::from(steps);
        let (x, y) = (between(low.x, high.x, f), between(low.y, high.y, f));
        [DVec2::new(x, low.y), DVec2::new(x, high.y), DVec2::new(low.x, y), DVec2::new(high.x, y)]
    })
}

/// The speed that rotation alone gives to far points in the picture's middle, px/s.
pub fn rotation_speed(geometry: &Geometry, keys: &ViewKeys) -> f64 {
    let (Some(first), Some(last)) = (keys.poses.first(), keys.poses.last()) else { return 0.0 };
    let turn = first.rotation.angle_between(last.rotation);
    2.0 * geometry.intrinsics.fx_px * turn / (2.0 * keys.reach_s) + 500.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use crate::pose::Pose;
    use crate::render::Shutter;
    use crate::scene::{Object, Part};
    use glam::{DAffine3, DQuat};

    #[test]
    fn what_lies_beside_and_behind_the_camera_is_nowhere() {
        let geometry = Geometry::new(Intrinsics::default(), Distortion::default());
        let shutter = Shutter { exposure_time_s: 0.02, readout_time_s: 0.0, beyond_s: 0.0 };
        // Moves and turns like a hand-held camera.
        let keys = ViewKeys::new(shutter, |t| {
            Pose::from_camera_in_world(DVec3::new(0.5 * t, 0.0, 0.0), DQuat::from_rotation_y(0.5 * t))
        });
        let cube = |at: DVec3, side: f64| {
            let corners = Bounds { low: at - 0.5 * side, high: at + 0.5 * side }.corners().to_vec();
            let part = Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY };
            let scene =
                Scene { objects: vec![Object { name: "cube".to_owned(), parts: vec![part] }], ..Scene::default() };
            footprint(&scene, &[corners.into()], &geometry, &keys)
        };
        // Beside the camera, one corner 1 cm in front of its plane: more than 3 m to the side of what is visible there.
        for at in [DVec3::new(1.0, 0.0, -0.04), DVec3::new(-1.0, 0.4, -0.03), DVec3::new(0.3, 0.0, -1.0)] {
            let found = cube(at, 0.1);
            assert!(found.rect.is_empty() && found.fastest_px_per_s == 0.0, "{at}: {found:?}");
        }
        // Through the camera's plane and in front of its picture: everywhere.
        let found = cube(DVec3::new(0.0, 0.0, 0.0), 0.4);
        assert_eq!(found.rect, Rect::full(640, 480).grown(64));
        // A metre in front, 0.1 m wide: 52.5 px. It moves by rotation and translation: 525 · (0.5 + 0.5 / 0.95), and a
        // tenth more.
        let found = cube(DVec3::new(0.0, 0.0, 1.0), 0.1);
        assert!(found.rect.width() < 90 && found.rect.contains(320, 240), "{found:?}");
        assert!((450.0..650.0).contains(&found.fastest_px_per_s), "{found:?}");
    }

    #[test]
    fn an_outline_holds_its_points_and_little_more() {
        // A ball of 40 × 40 points and a spike.
        let mut points: Vec<[f32; 3]> = (0..1600)
            .map(|i| {
                let (a, b) =
                    ((i % 40) as f32 / 40.0 * std::f32::consts::TAU, (i / 40) as f32 / 39.0 * std::f32::consts::PI);
                [b.sin() * a.cos(), b.cos(), b.sin() * a.sin()]
            })
            .collect();
        points.push([0.0, 0.0, 1.5]);
        let outline = outline(&points);
        assert!(outline.len() < 1600, "{}", outline.len());
        for i in 0..500 {
            let (z, a) = (f64::from(i) / 250.0 - 0.998, f64::from(i) * 2.399_963);
            let towards = DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            let farthest =
                |points: &mut dyn Iterator<Item = DVec3>| points.map(|p| p.dot(towards)).fold(f64::MIN, f64::max);
            let exact = farthest(&mut points.iter().map(|p| DVec3::from(p.map(f64::from))));
            let told = farthest(&mut outline.iter().copied());
            // Each side of a cell's box touches a point. A corner is farther by at most the other two sides' share,
            // 2/√3 of a cell.
            assert!(told >= exact && told < exact + 1.155 * 2.5 / CELLS, "{towards}: {told}, exact {exact}");
        }
    }
}
