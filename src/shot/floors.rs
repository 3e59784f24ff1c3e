//! The real surface below each object: on it its shadow falls.
//!
//! Depth of a few frames, spread over the recording, makes points of the room. A plane through those around an object's foot
//! is what it stands on (RANSAC, Fischler and Bolles 1981, then least squares), or the dominant plane of the room that explains
//! them as well (room_planes.rs). It is one and the same for all frames, so that nothing flickers. A foot within `SNAP_M` of it stands on it: a gap of the sensor's error would be a line of light.
//!
//! Where depth says nothing, it is the floor that the recording knows, or else the level plane through the foot.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};

use super::facets::facets;
use super::planes::{Point, agreed};
use super::points::FittedPlane;
use super::radiance::radiance_of;
use super::room_planes::AROUND_M;
use super::room_points::{DepthSamples, RoomPoints};
use super::{Shot, Surface, SurfaceError};
use crate::analyse::PlaneSource;
use crate::camera::{Geometry, Response};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::scene::{LightingOrigin, MIN_SUPPORT_COSINE, Mesh, Object, Scene, Support};
use crate::shadow::{LazyRadiance, Room};

/// Points across a frame that is looked at alone.
const ACROSS_ALONE: u32 = 320;
/// Points of an object's foot: this near to its lowest, as a share of its size and metres.
const FOOT: f64 = 0.02;
const FOOT_M: f64 = 0.002;
/// What is looked at around a foot: times its size, at least and at most, metres.
const AROUND: f64 = 1.5;
const LEAST_AROUND_M: f64 = 0.08;
const MOST_AROUND_M: f64 = 0.4;
/// A surface this far above or below the foot carries it, metres; farther below, the object floats over it.
const NEAR_M: f64 = 0.06;
const BELOW_M: f64 = 1.0;
/// Closer to the surface than this, a foot stands on it, metres.
const SNAP_M: f64 = 0.015;
/// Largest distance between a measured place and where its ray meets a dominant plane, by the measurement's error.
const MAX_MOVE: f64 = 3.0;
/// Normals are told apart in steps of this, which is less than they are known to: where a thing is moved over a desk, its floor is
/// tilted as before, and what was worked out of its shadow holds.
const NORMAL_STEP: f64 = 1.0 / 512.0;

/// What is known of the room, made when it is first asked for, and of the objects that were last asked for.
#[derive(Debug, Default)]
pub struct Floors(Mutex<Option<Known>>);

#[derive(Debug)]
struct Known {
    samples: Vec<DepthSamples>,
    /// The first frame's camera, by which `points` were seen.
    camera: Option<Geometry>,
    measured: Arc<RoomPoints>,
    /// Of the points, once it is asked for.
    room: Option<Arc<Room>>,
    /// Of surfaces, by the response of the camera.
    radiance: Option<(Response, Arc<LazyRadiance>)>,
    last: Last,
}

impl Known {
    /// The points as solids.
    fn solids(&mut self) -> Arc<Room> {
        let points = &self.measured.points;
        self.room.get_or_insert_with(|| Arc::new(Room::of(points.iter().map(|point| point.at_m)))).clone()
    }
}

/// Whether the first read of the recording's depth is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scan {
    Awaited,
    IfReady,
}

/// What was found for the objects that were last asked for.
#[derive(Debug, Default)]
struct Last {
    meshes: Vec<Arc<Mesh>>,
    up: Option<DVec3>,
    asked: Vec<Object>,
    found: Vec<Object>,
}

impl Last {
    fn is_of(&self, scene: &Scene) -> bool {
        let meshes = scene.meshes.len() == self.meshes.len()
            && scene.meshes.iter().zip(&self.meshes).all(|(a, b)| Arc::ptr_eq(a, b));
        meshes && scene.up_in_world == self.up
    }

    fn found(&self, object: &Object) -> Option<Object> {
        let at = self.asked.iter().position(|asked| asked == object)?;
        self.found.get(at).cloned()
    }
}

impl Shot {
    /// The scene's objects, each with the real surface below it. The recording's depth is read on first use.
    pub(crate) fn objects(&self) -> Vec<Object> {
        // Shadows fall on them, and a depth map is as flat as they are.
        let asked = self.settings.shadow.cast || self.settings.depth.occlusion;
        if !asked || self.scene.objects.is_empty() {
            return self.scene.objects.clone();
        }
        let mut known = self.floors.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = self.known(&mut known);
        if !known.last.is_of(&self.scene) {
            known.last = Last::default();
        }
        // While one thing is moved, the others' floors are known.
        let with_floor = |object: &Object| {
            let new = || {
                let support = self.support_of(object, &known.measured).map(|(support, _)| support);
                let facets = support.map(|support| facets(&self.scene, object, &support, &known.measured.points));
                Object { support, facets: facets.unwrap_or_default(), ..object.clone() }
            };
            known.last.found(object).unwrap_or_else(new)
        };
        let found: Vec<_> = self.scene.objects.iter().map(with_floor).collect();
        let Scene { meshes, up_in_world, objects, .. } = &*self.scene;
        known.last = Last { meshes: meshes.clone(), up: *up_in_world, asked: objects.clone(), found: found.clone() };
        found
    }

    /// What is known of the room by the camera as it is now. The recording's depth is read on first use.
    fn known<'a>(&self, known: &'a mut Option<Known>) -> &'a mut Known {
        let camera = self.given_geometry_at(0);
        let known = known.get_or_insert_with(|| {
            let samples = self.depth_samples();
            let measured = Arc::new(RoomPoints::new(self.points_by_frame(&samples)));
            Known { measured, samples, camera: camera.clone(), room: None, radiance: None, last: Last::default() }
        });
        if known.camera != camera {
            (known.measured, known.camera) = (Arc::new(RoomPoints::new(self.points_by_frame(&known.samples))), camera);
            (known.room, known.radiance, known.last) = (None, None, Last::default());
        }
        known
    }

    /// The surface at a place of a frame's picture, as [`Shot::surface_at`] measures it, moved onto the dominant plane of the room
    /// that explains it as well: what things are placed on. `share`, `sigma_m` remain those of the frame's own depth.
    pub fn placement_surface(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        self.placed(frame, at_px, Scan::Awaited)
    }

    /// [`Shot::placement_surface`] for a preview: as measured until the recording's depth has been read.
    pub fn placement_preview(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        self.placed(frame, at_px, Scan::IfReady)
    }

    fn placed(&self, frame: &Frame, at_px: DVec2, scan: Scan) -> Result<Surface, SurfaceError> {
        let surface = self.surface_at(frame, at_px)?;
        let Some(measured) = self.room_scan(scan) else { return Ok(surface) };
        let around = measured.around(surface.point_m, AROUND_M);
        let normal = surface.normal_in_world;
        let local = FittedPlane { normal, d_m: normal.dot(surface.point_m), off_m: surface.sigma_m, most_m: 0.0 };
        let plane = measured
            .planes
            .settled(local, surface.point_m, &around, |along| along.dot(normal).abs() > MIN_SUPPORT_COSINE);
        let Ok(Support { point_m, normal }) = self.support_on_plane(frame.index, at_px, plane.numbers()) else {
            return Ok(surface);
        };
        // At a grazing angle a plane that is a little off is met far away.
        let error_m = Point::new(surface.point_m, surface.depth_m, surface.point_m).off_m;
        let is_near = point_m.distance(surface.point_m) < MAX_MOVE * error_m;
        Ok(if is_near { Surface { point_m, normal_in_world: normal, ..surface } } else { surface })
    }

    /// Up by the room's largest level surface, where depth shows one ([`super::room_planes::RoomPlanes::up`]).
    pub(super) fn up_of_room(&self, guess: DVec3, scan: Scan) -> Option<DVec3> {
        self.room_scan(scan)?.planes.up(guess)
    }

    /// Measured points and planes of the room. `None` if they are not ready and nobody waits for them.
    fn room_scan(&self, scan: Scan) -> Option<Arc<RoomPoints>> {
        match scan {
            Scan::Awaited => {
                let mut known = self.floors.0.lock().unwrap_or_else(PoisonError::into_inner);
                Some(self.known(&mut known).measured.clone())
            }
            Scan::IfReady => {
                let known = self.floors.0.try_lock().ok()?;
                let camera = self.given_geometry_at(0);
                known.as_ref().filter(|known| known.camera == camera).map(|known| known.measured.clone())
            }
        }
    }

    /// Makes a compositor of the scene as it is now.
    pub(super) fn compositor_on_floors(&self, gpu: Gpu) -> Compositor {
        let scene = Scene { objects: self.objects(), ..Scene::clone(&self.scene) };
        let mut compositor = Compositor::new(gpu, scene);
        compositor.stand_in(self.room());
        compositor.set_surface_radiance(self.surface_radiance());
        compositor
    }

    /// Places the scene's objects on their floors among what is real, as they are now.
    pub(super) fn place_in(&self, compositor: &mut Compositor) {
        compositor.place(&self.objects());
        compositor.stand_in(self.room());
        compositor.set_surface_radiance(self.surface_radiance());
    }

    /// How bright surfaces are in frames that do not clip there. `None` where the frames' gains are not known.
    fn surface_radiance(&self) -> Option<Arc<LazyRadiance>> {
        let is_analysed = self.recording.exposure.iter().any(|exposure| exposure.seen.is_some());
        if !is_analysed || !self.settings.shadow.cast {
            return None;
        }
        let response = self.camera().response;
        let mut known = self.floors.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = known.as_mut().filter(|known| !known.measured.points.is_empty())?;
        if known.radiance.as_ref().is_none_or(|(of, _)| *of != response) {
            let (recording, rig) = (self.recording.clone(), self.rig.clone());
            let (of, measured) = (response.clone(), known.measured.clone());
            let lazy = LazyRadiance::new(Box::new(move || radiance_of(&recording, &rig, &of, &measured)));
            known.radiance = Some((response, Arc::new(lazy)));
        }
        known.radiance.as_ref().map(|(_, radiance)| radiance.clone())
    }

    /// Real things, where it is known where light comes from: of a light that is guessed nothing can be stopped.
    fn room(&self) -> Option<Arc<Room>> {
        let is_guessed = self.scene.lighting_origin == LightingOrigin::Default && self.found_light.is_none();
        if is_guessed || !self.settings.shadow.cast {
            return None;
        }
        let mut known = self.floors.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = known.as_mut().filter(|known| !known.measured.points.is_empty())?;
        Some(known.solids())
    }

    /// Real things, whatever lights them. The recording's depth is read on first use.
    pub(super) fn solids(&self) -> Arc<Room> {
        let mut known = self.floors.0.lock().unwrap_or_else(PoisonError::into_inner);
        self.known(&mut known).solids()
    }

    /// Points of the room, read anew.
    pub(super) fn room_points(&self) -> RoomPoints {
        RoomPoints::new(self.points_by_frame(&self.depth_samples()))
    }

    /// What an object stands on, and where that is known from.
    pub(super) fn support_of(&self, object: &Object, measured: &RoomPoints) -> Option<(Support, PlaneSource)> {
        let floor = self.floor();
        let up = self.up()?;
        let foot = Foot::of(&self.scene, object, up)?;
        let carried = foot.carried(measured).map(|plane| (plane, PlaneSource::Depth));
        let known = carried.or_else(|| {
            let is_near = |plane: &FittedPlane| foot.height_m(plane).abs() < BELOW_M;
            floor.filter(is_near).map(|plane| (plane, PlaneSource::Recording))
        });
        Some(match known {
            Some((plane, known_by)) => (foot.on(&plane.facing(up)), known_by),
            None => (Support { point_m: foot.lowest(up), normal: up }, PlaneSource::Foot),
        })
    }

    /// How high an object's lowest point is over the level plane that a frame's depth shows vertically below it, metres.
    pub(super) fn over_depth_m(&self, frame: &Frame, object: &Object, up: DVec3) -> Option<f64> {
        let depth = frame.depth.as_ref()?;
        let samples = DepthSamples::new(frame.index, self.measured_from(frame, depth).ok()?, depth, ACROSS_ALONE);
        let foot = Foot::of(&self.scene, object, up)?;
        let points = self.points_by_frame(&[samples]).into_iter().flat_map(|(_, points)| points).collect();
        foot.carried(&RoomPoints { points, ..RoomPoints::default() }).map(|plane| foot.height_m(&plane))
    }
}

/// The lowest part of an object.
struct Foot {
    points: Vec<DVec3>,
    middle: DVec3,
    /// From the middle to the outermost point.
    radius_m: f64,
    up: DVec3,
}

impl Foot {
    fn of(scene: &Scene, object: &Object, up: DVec3) -> Option<Self> {
        let all: Vec<DVec3> = object.points_m(scene).collect();
        let low = all.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
        let high = all.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
        let lowest = all.iter().map(|p| p.dot(up)).reduce(f64::min)?;
        let within = (FOOT * (high - low).max_element()).max(FOOT_M);
        let points: Vec<DVec3> = all.into_iter().filter(|p| p.dot(up) - lowest <= within).collect();
        let low = points.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
        let high = points.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
        let middle = 0.5 * (low + high);
        let radius_m = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        middle.is_finite().then_some(Self { points, middle, radius_m, up })
    }

    fn lowest(&self, up: DVec3) -> DVec3 {
        let height = |p: &DVec3| p.dot(up);
        let lowest = self.points.iter().map(height).fold(f64::INFINITY, f64::min);
        self.middle + (lowest - height(&self.middle)) * up
    }

    /// How high its lowest point is over a plane, metres.
    fn height_m(&self, plane: &FittedPlane) -> f64 {
        let plane = plane.facing(self.up);
        self.points.iter().map(|p| plane.normal.dot(*p) - plane.d_m).fold(f64::INFINITY, f64::min)
    }

    /// The plane below it, moved to its lowest point where that is near.
    fn on(&self, plane: &FittedPlane) -> Support {
        let off = plane.normal.dot(self.middle) - plane.d_m;
        let normal = ((plane.normal / NORMAL_STEP).round() * NORMAL_STEP).normalize();
        // Tilted about the place below the foot.
        let plane = FittedPlane { normal, d_m: normal.dot(self.middle) - off, ..*plane };
        let height_m = self.height_m(&plane);
        let moved_m = if height_m.abs() <= SNAP_M { height_m } else { 0.0 };
        Support { point_m: self.middle + (moved_m - off) * plane.normal, normal: plane.normal }
    }

    /// The plane of the points around that carries it: one that is near, or else one that it floats over.
    fn carried(&self, measured: &RoomPoints) -> Option<FittedPlane> {
        self.carried_by(measured, -NEAR_M..NEAR_M).or_else(|| self.carried_by(measured, -BELOW_M..-NEAR_M))
    }

    /// The plane that most of the points around agree on, among those in a range of heights over the foot, metres.
    fn carried_by(&self, measured: &RoomPoints, heights_m: Range<f64>) -> Option<FittedPlane> {
        let around_m = (AROUND * self.radius_m).clamp(LEAST_AROUND_M, MOST_AROUND_M);
        let foot = self.lowest(self.up);
        let near: Vec<Point> = measured
            .points
            .iter()
            .filter(|point| {
                let (off, height) = (point.at_m - foot, (point.at_m - foot).dot(self.up));
                heights_m.contains(&height) && (off - height * self.up).length() < around_m
            })
            .copied()
            .collect();
        let plane = agreed(&near, |normal| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE)?.facing(self.up);
        let below_foot_m = foot - (plane.normal.dot(foot) - plane.d_m) / plane.normal.dot(self.up) * self.up;
        let is_ground = |normal: DVec3| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE;
        Some(measured.planes.settled(plane, below_foot_m, &near, is_ground).facing(self.up))
    }
}

#[cfg(test)]
mod tests {
    use super::super::planes::pick;
    use super::*;

    fn foot(height_m: f64) -> Foot {
        let corner = |x: f64, y: f64| DVec3::new(x, y, height_m);
        let points = vec![corner(-0.05, -0.05), corner(0.05, -0.05), corner(0.05, 0.05), corner(-0.05, 0.05)];
        Foot { points, middle: DVec3::new(0.0, 0.0, height_m), radius_m: 0.07, up: DVec3::Z }
    }

    /// A table of height 0 with a box on it, and noise of 2 mm.
    fn room() -> Vec<Point> {
        let noise = |n: usize| (pick(n, 4001) as f64 / 2000.0 - 1.0) * 0.002;
        let place = |i: usize| DVec2::new((i % 40) as f64, (i / 40) as f64) * 0.01 - 0.2;
        let height = |at: DVec2| if at.x > 0.06 { 0.05 } else { 0.0 };
        let at_m = |i: usize| place(i).extend(height(place(i)) + noise(i));
        (0..1600).map(|i| Point { at_m: at_m(i), off_m: 0.005, eye_m: DVec3::Z }).collect()
    }

    #[test]
    fn a_thing_stands_on_the_table_and_not_on_the_box_beside_it() {
        let plane = foot(0.004).carried_by(&RoomPoints::new(vec![(0, room())]), -NEAR_M..NEAR_M).unwrap();
        assert!(plane.normal.z > 0.999 && plane.d_m.abs() < 0.002, "{plane:?}");
        // Its foot is four millimetres over what was measured: the plane goes to the foot.
        let support = foot(0.004).on(&plane);
        assert!((support.point_m.z - 0.004).abs() < 0.0005, "{support:?}");
        // Three centimetres over it, it floats.
        let support = foot(0.03).on(&plane);
        assert!(support.point_m.z.abs() < 0.002, "{support:?}");
    }

    #[test]
    fn floors_that_differ_by_less_than_is_known_are_one_below_the_foot() {
        let tilted = |by: f64| {
            let normal = DVec3::new(by, 0.0, 1.0).normalize();
            FittedPlane { normal, d_m: normal.dot(DVec3::new(3.0, -2.0, 0.0)), off_m: 0.0, most_m: 0.0 }
        };
        let foot = Foot { middle: DVec3::new(3.0, -2.0, 0.03), ..foot(0.03) };
        let [a, b] = [0.0021, 0.0022].map(|by| foot.on(&tilted(by)));
        assert_eq!(a.normal, b.normal);
        assert!(foot.on(&tilted(0.01)).normal != a.normal);
        // Tilted about the world's origin it would be half a millimetre off.
        assert!(a.point_m.z.abs() < 1e-4, "{a:?}");
    }

    #[test]
    fn a_wall_and_too_few_points_carry_nothing() {
        let wall: Vec<Point> = (0..900)
            .map(|i| DVec3::new(0.01, (i % 30) as f64 * 0.005 - 0.07, (i / 30) as f64 * 0.003 - 0.05))
            .map(|at_m| Point { at_m, off_m: 0.003, eye_m: DVec3::X })
            .collect();
        assert!(foot(0.0).carried_by(&RoomPoints::new(vec![(0, wall)]), -NEAR_M..NEAR_M).is_none());
        assert!(foot(0.0).carried_by(&RoomPoints::new(vec![(0, room()[..20].to_vec())]), -NEAR_M..NEAR_M).is_none());
    }
}
