//! Bounds of the objects in the picture, and of their speed. All full-area work is restricted to
//! that rectangle.

use std::borrow::Cow;
use std::cell::LazyCell;
use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::dice::CLIP_DEPTH_M;
use super::in_view::{ScreenExtent, clipped_at_near_plane, visible_extent};
use super::view::{NEAR_M, ViewKeys};
use crate::camera::Geometry;
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::scene::{Part, Scene};

/// Picture area that objects can touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// Pixels that objects may touch during the exposure; may extend beyond the picture. Empty if
    /// nothing is in view.
    pub rect: Rect,
    /// Upper bound of the speed of any object point, px/s.
    pub fastest_px_per_s: f32,
    /// Depth range of all object points during the exposure, metres.
    pub depths_m: [f64; 2],
    /// Bounds of each part, and its maximum depth, metres.
    pub parts: Vec<(Rect, f64)>,
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

/// Number of cells along the longest side of a box.
const CELLS_PER_SIDE: f64 = 6.0;
/// Meshes with at most this many vertices are represented exactly.
const MAX_EXACT_VERTICES: usize = 512;

/// Points whose convex hull tightly contains that of the given points: the points themselves if
/// they are few, otherwise the corners of boxes around nearby points.
pub fn outline(points: &[[f32; 3]]) -> Vec<DVec3> {
    let wide = |p: &[f32; 3]| DVec3::from(p.map(f64::from));
    let Some(all) = Bounds::of(points.iter().copied()).filter(|_| points.len() > MAX_EXACT_VERTICES) else {
        return points.iter().map(wide).collect();
    };
    let side = ((all.high - all.low).max_element() / CELLS_PER_SIDE).max(f64::MIN_POSITIVE);
    let mut cells: BTreeMap<[u32; 3], Bounds> = BTreeMap::new();
    for p in points.iter().map(wide) {
        let cell = ((p - all.low) / side).to_array().map(|v| v as u32);
        let own = cells.entry(cell).or_insert(Bounds { low: p, high: p });
        *own = Bounds { low: own.low.min(p), high: own.high.max(p) };
    }
    if 8 * cells.len() < points.len() {
        cells.values().flat_map(Bounds::corners).collect()
    } else {
        points.iter().map(wide).collect()
    }
}

/// Normalised coordinates (x/z, y/z) of points under a pose; `None` if any is not in front of the
/// camera.
fn normalised(points: &[DVec3], pose: &Pose) -> Option<Vec<DVec2>> {
    points
        .iter()
        .map(|&c| {
            let p = pose.transform_point(c);
            (p.z > NEAR_M).then(|| p.truncate() / p.z)
        })
        .collect()
}

/// The image of a rectangle of normalised coordinates: points along its border.
fn border_px(extent: ScreenExtent, geometry: &Geometry) -> impl Iterator<Item = DVec2> {
    border(extent, geometry.distortion.model.is_fisheye()).map(|p| geometry.distorted_px(p))
}

/// The bounding rectangle in the picture of a rectangle of normalised coordinates, plus a pixel for
/// curvature between the border's samples.
fn extent_px(extent: ScreenExtent, geometry: &Geometry) -> Rect {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for d in border_px(extent, geometry) {
        low = low.min(d);
        high = high.max(d);
    }
    let clamp = |v: f64| v.clamp(-1e6, 1e6);
    Rect::new(
        clamp(low.x).floor() as i32,
        clamp(low.y).floor() as i32,
        clamp(high.x).ceil() as i32,
        clamp(high.y).ceil() as i32,
    )
    .grown(1)
}

/// Maximum number of a part's triangles that are clipped individually.
const MAX_CLIPPED_TRIANGLES: usize = 4096;
/// Maximum number of outline points before the box is used: clipping is quadratic in them.
const MAX_CLIPPED_POINTS: usize = 64;

/// Convex hulls that together contain a part, corners in the world: its triangles; if they are
/// many, its outline or box.
fn convex_hulls(scene: &Scene, part: &Part, outline: &[DVec3]) -> Vec<Vec<DVec3>> {
    let world = |p: DVec3| part.world_from_mesh.transform_point3(p);
    let few = scene.meshes.get(part.mesh).filter(|mesh| mesh.indices.len() <= 3 * MAX_CLIPPED_TRIANGLES);
    if let Some(mesh) = few {
        let corner = |i: &u32| world(DVec3::from(mesh.vertices[*i as usize].position.map(f64::from)));
        return mesh.indices.chunks_exact(3).map(|triangle| triangle.iter().map(corner).collect()).collect();
    }
    let low = outline.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
    let high = outline.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
    let corners =
        if outline.len() > MAX_CLIPPED_POINTS { Bounds { low, high }.corners().to_vec() } else { outline.to_vec() };
    vec![corners.into_iter().map(world).collect()]
}

/// Largest normalised coordinate (x/z, y/z) in any lens's field of view: 89.9°.
const MAX_NORMALISED: f64 = 1000.0;

/// Normalised coordinates that contain everything imaged into a rectangle of the picture plane.
fn normalised_extent(rect: Rect, geometry: &Geometry) -> ScreenExtent {
    let square = |side: f64| ScreenExtent { low: DVec2::splat(-side), high: DVec2::splat(side) };
    let is_inside = |p: DVec2| rect.grown(1).contains(p.x.floor() as i32, p.y.floor() as i32);
    let holds = |area: &ScreenExtent| {
        extent_px(*area, geometry).union(&rect) == extent_px(*area, geometry)
            && !border_px(*area, geometry).any(is_inside)
    };
    let sides = std::iter::successors(Some(0.5), |side| Some(2.0 * side)).take_while(|side| *side < MAX_NORMALISED);
    sides.map(square).find(holds).unwrap_or(square(MAX_NORMALISED))
}

/// The footprint of all parts, by their meshes' outlines. Of a part that intersects or passes the
/// camera plane, the portion in front of the camera counts. Parts whose distance from the picture
/// exceeds the picture's width, beyond the reach of any blur, are ignored.
///
/// Conservative: without distortion, a part's image lies in the rectangle around its outline's
/// image; distortion maps that rectangle's inside to the inside of its border's image; and poses
/// within the shutter are sampled from key to key ([`ViewKeys::sampled`]). Between two keys a part
/// lies in the hull of its two positions.
///
/// `middle` is the pose at the middle of the whole exposure, of which `keys` may be a part.
pub fn footprint(
    scene: &Scene,
    outlines: &[Cow<'_, [DVec3]>],
    geometry: &Geometry,
    keys: &ViewKeys,
    middle: &Pose,
) -> Footprint {
    let i = &geometry.intrinsics;
    let beside_px = i.width_px.max(i.height_px) as i32;
    let around = Rect::full(i.width_px, i.height_px).grown(beside_px);
    let area = LazyCell::new(|| normalised_extent(around, geometry));
    let mut rect = Rect::new(0, 0, 0, 0);
    let mut fastest = 0.0f64;
    let (mut nearest, mut farthest) = (f64::INFINITY, NEAR_M);
    let (moments, step_s) = keys.sampled();
    let mut parts = Vec::new();
    for part in scene.objects.iter().flat_map(|o| &o.parts) {
        let points: Vec<_> = outlines[part.mesh].iter().map(|&p| part.world_from_mesh.transform_point3(p)).collect();
        if keys.poses.iter().all(|pose| points.iter().all(|&p| pose.transform_point(p).z < NEAR_M)) {
            continue;
        }
        let images: Option<Vec<_>> = moments.iter().map(|pose| normalised(&points, pose)).collect();
        let simple = images.as_ref().and_then(|images| ScreenExtent::of(images.iter().flatten().copied()));
        let simple = simple.map(|extent| extent_px(extent, geometry));
        let cut = || {
            let convex_hulls =
                if images.is_some() { vec![points.clone()] } else { convex_hulls(scene, part, &outlines[part.mesh]) };
            let of_hull = |hull: &Vec<DVec3>| {
                // A part that passes the camera is drawn as far as it is in front of it at the
                // middle moment.
                let drawn: Vec<_> = match images {
                    Some(_) => hull.clone(),
                    None => {
                        let hull: Vec<_> = hull.iter().map(|&p| middle.transform_point(p)).collect();
                        clipped_at_near_plane(&hull, CLIP_DEPTH_M)
                            .into_iter()
                            .map(|p| middle.inverse_transform_point(p))
                            .collect()
                    }
                };
                let at = |pose: &&Pose| drawn.iter().map(|&p| pose.transform_point(p)).collect::<Vec<_>>();
                let places: Vec<_> = moments.iter().map(at).collect();
                let between =
                    places.windows(2.min(places.len())).filter_map(|pair| visible_extent(&pair.concat(), *area));
                between.reduce(ScreenExtent::union)
            };
            convex_hulls
                .iter()
                .filter_map(of_hull)
                .reduce(ScreenExtent::union)
                .map(|extent| extent_px(extent, geometry))
        };
        let own = match simple.filter(|own| own.union(&around) == around) {
            Some(own) => Some(own),
            // The portion in front of the camera counts, even outside the picture: a long blur may
            // reach it.
            None => cut().map(|own| simple.map_or(own, |simple| own.union(&simple))),
        };
        let Some(own) = own.filter(|own| !own.intersection(&around).is_empty()) else { continue };
        rect = rect.union(&own);
        let mut part_farthest = NEAR_M;
        for pose in &moments {
            for z in points.iter().map(|&p| pose.transform_point(p).z) {
                (nearest, part_farthest) = (nearest.min(z.max(NEAR_M)), part_farthest.max(z));
            }
        }
        farthest = farthest.max(part_farthest);
        parts.push((own, part_farthest));
        let Some(images) = images else {
            fastest = fastest.max(rotation_speed_px_per_s(geometry, keys));
            continue;
        };
        let at_px: Vec<Vec<DVec2>> =
            images.iter().map(|points| points.iter().map(|&p| geometry.distorted_px(p)).collect()).collect();
        for pair in at_px.windows(2) {
            for (p, q) in pair[0].iter().zip(&pair[1]) {
                fastest = fastest.max(p.distance(*q) / step_s);
            }
        }
    }
    let depths_m = [nearest.min(farthest), farthest];
    // A margin of 10 % for acceleration between the moments.
    Footprint { rect, fastest_px_per_s: (1.1 * fastest) as f32, depths_m, parts }
}

/// Points along a rectangle's border, so dense that its image is straight between them. A step is
/// at most 40 px of an ordinary picture. Towards the sides of a fisheye lengths grow without bound
/// and angles do not, so there a step is at most 3°: an arc of 500 px radius then deviates by 0.2
/// px from its chord.
fn border(ScreenExtent { low, high }: ScreenExtent, fisheye: bool) -> impl Iterator<Item = DVec2> {
    let wide = (high - low).max_element();
    let steps = if fisheye { 64 } else { (12.0 * wide).clamp(16.0, 512.0) as u32 };
    let between = move |a: f64, b: f64, f: f64| {
        if fisheye { (a.atan() + f * (b.atan() - a.atan())).tan() } else { a + f * (b - a) }
    };
    (0..=steps).flat_map(move |n| {
        let f = f64::from(n) / f64::from(steps);
        let (x, y) = (between(low.x, high.x, f), between(low.y, high.y, f));
        [DVec2::new(x, low.y), DVec2::new(x, high.y), DVec2::new(low.x, y), DVec2::new(high.x, y)]
    })
}

/// Image speed of distant points due to rotation, in the picture's centre, px/s.
pub fn rotation_speed_px_per_s(geometry: &Geometry, keys: &ViewKeys) -> f64 {
    let (Some(first), Some(last)) = (keys.poses.first(), keys.poses.last()) else { return 0.0 };
    let turn = first.rotation.angle_between(last.rotation);
    2.0 * geometry.intrinsics.fx_px * turn / (2.0 * keys.reach_s) + 500.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics, LensModel, MapSample, fit_lens_map};
    use crate::pose::Pose;
    use crate::render::Shutter;
    use crate::scene::{Mesh, Object, Vertex};
    use glam::{DAffine3, DQuat};
    use proptest::prelude::*;

    #[test]
    fn boxes_beside_and_behind_the_camera_have_an_empty_footprint() {
        let geometry = Geometry::new(Intrinsics::default(), Distortion::default());
        let shutter = Shutter { exposure_time_s: 0.02, readout_time_s: 0.0, beyond_s: 0.0 };
        // Moves and turns like a hand-held camera.
        let keys = ViewKeys::new(shutter, |t| {
            Pose::from_camera_in_world(DVec3::new(0.5 * t, 0.0, 0.0), DQuat::from_rotation_y(0.5 * t))
        });
        let cube = |at: DVec3, side: f64| {
            let corners = Bounds { low: at - 0.5 * side, high: at + 0.5 * side }.corners().to_vec();
            let part = Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY };
            let scene = Scene { objects: vec![Object { parts: vec![part], ..Object::default() }], ..Scene::default() };
            footprint(&scene, &[corners.into()], &geometry, &keys, &keys.middle())
        };
        // Beside the camera, one corner 1 cm in front of its plane: more than 3 m to the side of
        // the field of view there.
        for at in [DVec3::new(1.0, 0.0, -0.04), DVec3::new(-1.0, 0.4, -0.03), DVec3::new(0.3, 0.0, -1.0)] {
            let extent = cube(at, 0.1);
            assert!(extent.rect.is_empty() && extent.fastest_px_per_s == 0.0, "{at}: {extent:?}");
        }
        // Through the camera's plane, 3 m to the side of the field of view 1 cm before it, and 0.2
        // m beside the middle of the picture 0.1 m before it: outside the picture, too.
        for at in [DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.4, 0.0, -0.09)] {
            let extent = cube(at, 0.4);
            assert!(extent.rect.intersection(&Rect::full(640, 480)).is_empty(), "{at}: {extent:?}");
        }
        // Through the camera's plane and in front of its picture: unbounded.
        let extent = cube(DVec3::new(0.0, 0.0, 0.0), 0.4);
        assert_eq!(extent.rect.intersection(&Rect::full(640, 480).grown(64)), Rect::full(640, 480).grown(64));
        // A metre in front, 0.1 m wide: 52.5 px. It moves by rotation and translation: 525 · (0.5 +
        // 0.5 / 0.95), and a tenth more.
        let extent = cube(DVec3::new(0.0, 0.0, 1.0), 0.1);
        assert!(extent.rect.width() < 90 && extent.rect.contains(320, 240), "{extent:?}");
        assert!((450.0..650.0).contains(&extent.fastest_px_per_s), "{extent:?}");
    }

    #[test]
    fn outline_contains_its_points_tightly() {
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
            let bound = farthest(&mut outline.iter().copied());
            // Each side of a cell's box touches a point. A corner is farther by at most the other
            // two sides' share, 2/√3 of a cell.
            assert!(
                bound >= exact && bound < exact + 1.155 * 2.5 / CELLS_PER_SIDE,
                "{towards}: {bound}, exact {exact}"
            );
        }
    }

    /// A lens as a table.
    fn tabled() -> Distortion {
        let sample = |n: u32| {
            let place = DVec2::new((n % 41).into(), (n / 41).into()) * 20.0;
            let at = (place - DVec2::new(400.0, 300.0)) / 525.0;
            let recorded = at / (1.0 + 0.15 * at.length_squared() + 0.02 * at.x) * 525.0 + DVec2::new(320.0, 240.0);
            MapSample { undistorted_px: place, recorded: recorded / DVec2::new(640.0, 480.0) }
        };
        let map = fit_lens_map(&(0..41 * 31).map(sample).collect::<Vec<_>>(), [800, 600], None).unwrap();
        Distortion { model: LensModel::StMap, map: Some(map), ..Default::default() }
    }

    /// A hand-held camera that turns and moves, a lens, and boxes from the size of a pen to that of
    /// a table.
    fn hand_held_view() -> impl Strategy<Value = (Geometry, ViewKeys, DAffine3)> {
        let numbers = |n: usize, max: f64| prop::collection::vec(-max..max, n);
        let lens = prop_oneof![
            Just(Distortion::default()),
            Just(Distortion { k1: -0.3, k2: 0.1, p1: 0.002, ..Default::default() }),
            Just(Distortion { k1: 0.2624, k2: -0.9531, k3: 1.1633, ..Default::default() }),
            Just(Distortion { model: LensModel::OpencvFisheye, k1: 0.01, ..Default::default() }),
            Just(Distortion { model: LensModel::OpencvRational, k1: -0.2, k4: 0.1, k5: 0.02, ..Default::default() }),
            Just(Distortion { model: LensModel::Fov, omega: 0.9, ..Default::default() }),
            Just(tabled()),
            Just(Distortion { model: LensModel::ThinPrismFisheye, p1: 0.002, sx1: 0.003, ..Default::default() }),
        ];
        let own = (numbers(3, 0.6), numbers(4, 1.0), prop::collection::vec(-2.3f64..0.0, 3));
        (lens, own, numbers(3, 1.0), numbers(3, 1.0)).prop_map(|(lens, (at, turn, sides), moves, turns)| {
            let focal_px = if lens.model.is_fisheye() { 300.0 } else { 525.0 };
            let intrinsics = Intrinsics { fx_px: focal_px, fy_px: focal_px, ..Default::default() };
            let shutter = Shutter { exposure_time_s: 0.02, readout_time_s: 0.02, beyond_s: 0.0 };
            let (moves, turns) = (DVec3::from_slice(&moves), DVec3::from_slice(&turns));
            let keys = ViewKeys::new(shutter, |t| {
                Pose::from_camera_in_world(moves * t, DQuat::from_scaled_axis(3.0 * turns * t))
            });
            let sides = DVec3::from_slice(&sides).map(|s| 10f64.powf(s));
            let turn = DQuat::from_xyzw(turn[0], turn[1], turn[2], turn[3] + 1e-3).normalize();
            let world_from_box = DAffine3::from_scale_rotation_translation(sides, turn, DVec3::from_slice(&at));
            (Geometry::new(intrinsics, lens), keys, world_from_box)
        })
    }

    /// The footprint of the box from -0.5 to 0.5 in each direction, in axes of its own.
    fn of_box(geometry: &Geometry, keys: &ViewKeys, world_from_mesh: DAffine3, meshes: Vec<Mesh>) -> Footprint {
        let meshes = meshes.into_iter().map(Into::into).collect();
        let unit = Bounds { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        let object = Object { parts: vec![Part { mesh: 0, world_from_mesh }], ..Object::default() };
        let scene = Scene { objects: vec![object], meshes, ..Scene::default() };
        footprint(&scene, &[unit.corners().to_vec().into()], geometry, keys, &keys.middle())
    }

    /// Its sides.
    fn sides() -> Mesh {
        let unit = Bounds { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        let vertex = |c: DVec3| Vertex { position: c.as_vec3().to_array(), ..bytemuck::Zeroable::zeroed() };
        let squares = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let indices = squares.iter().flat_map(|s: &[u32; 4]| [s[0], s[1], s[2], s[0], s[2], s[3]]).collect();
        Mesh { vertices: unit.corners().map(vertex).to_vec(), indices, material: 0 }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1500))]
        #[test]
        fn box_points_project_into_its_footprint((geometry, keys, world_from_box) in hand_held_view()) {
            let by_outline = of_box(&geometry, &keys, world_from_box, Vec::new());
            let by_triangles = of_box(&geometry, &keys, world_from_box, vec![sides()]);
            let picture = Rect::full(640, 480).grown(100);
            // Points throughout its inside and the exposure: the plastic sequence in four
            // dimensions.
            for n in 0..3000 {
                let [x, y, z, t] = [1, 2, 3, 4].map(|k| (f64::from(n) * 1.167_303_978_261_418_7f64.powi(-k)).fract() - 0.5);
                // Half of them lie on its sides.
                let mut p = [x, y, z];
                if n % 2 == 0 {
                    p[n as usize / 2 % 3] = 0.5f64.copysign(p[n as usize / 2 % 3]);
                }
                let extent = if n % 2 == 0 { &by_triangles } else { &by_outline };
                let p = DVec3::from(p);
                let (rotation, position_m) = keys.at(2.0 * t * keys.reach_s);
                let eye = position_m + keys.origin_in_world_m;
                let p = world_from_box.transform_point3(p);
                let in_middle = keys.middle().transform_point(p);
                let p = rotation.normalize() * (p - eye);
                let is_drawn = p.z >= NEAR_M && in_middle.z >= CLIP_DEPTH_M;
                let Some(at) = geometry.project(p).filter(|_| is_drawn) else { continue };
                let (x, y) = (at.x.floor() as i32, at.y.floor() as i32);
                prop_assert!(!picture.contains(x, y) || extent.rect.contains(x, y), "{at} of {p} is not in {extent:?}");
            }
        }

        #[test]
        fn box_beyond_one_side_of_the_picture_is_out_of_view((_, _, world_from_box) in hand_held_view()) {
            let geometry = Geometry::new(Intrinsics::default(), Distortion::default());
            let shutter = Shutter { exposure_time_s: 0.02, readout_time_s: 0.0, beyond_s: 0.0 };
            let keys = ViewKeys::new(shutter, |_| Pose::IDENTITY);
            let extent = of_box(&geometry, &keys, world_from_box, Vec::new());
            let unit = Bounds { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
            let corners = unit.corners().map(|c| world_from_box.transform_point3(c));
            // 640 px and more to the right and left, and as many below and above.
            let (x, y) = (961.0 / 525.0, 881.0 / 525.0);
            let beyond = [
                corners.iter().all(|c| c.z < NEAR_M),
                corners.iter().all(|c| c.x > x * c.z),
                corners.iter().all(|c| -c.x > x * c.z),
                corners.iter().all(|c| c.y > y * c.z),
                corners.iter().all(|c| -c.y > y * c.z),
            ];
            prop_assert!(!beyond.contains(&true) || (extent.rect.is_empty() && extent.fastest_px_per_s == 0.0), "{extent:?}");
        }
    }
}
