//! The support plane of each object: the real surface below it, which receives its shadow.
//!
//! Depth maps of a few frames, spread over the recording, give measured points of the room. The
//! support plane is fitted to those around an object's footprint (RANSAC, Fischler and Bolles 1981,
//! then least squares), or is the dominant plane of the room that explains them as well
//! (room_planes.rs). It is the same for all frames, so that nothing flickers. An object within
//! `SNAP_M` of it stands on it: a gap of the sensor's error would be visible as a line of light.
//!
//! Without depth, it is the recording's floor, or else the level plane through the object's lowest
//! point.

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};

use super::facets::facets;
use super::planes::{MeasuredPoint, ransac_plane};
use super::radiance::radiance_of;
use super::room_planes::AROUND_M;
use super::room_points::{DepthSamples, RoomPoints};
use super::{Shot, Surface, SurfaceError};
use crate::analyse::PlaneSource;
use crate::camera::{Geometry, Response};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::plane::{HessePlane, Plane};
use crate::scene::{LightingOrigin, MIN_SUPPORT_COSINE, Mesh, Object, Scene};
use crate::shadow::{LazyRadiance, Room};

/// Depth samples across a single frame's map.
const SINGLE_FRAME_SAMPLES_ACROSS: u32 = 320;
/// Height of the footprint above an object's lowest point: share of its size, and at least, m.
const FOOTPRINT_SHARE: f64 = 0.02;
const MIN_FOOTPRINT_M: f64 = 0.002;
/// Radius of the points around a footprint, as a multiple of its radius, with its limits.
const SEARCH_PER_RADIUS: f64 = 1.5;
const MIN_SEARCH_M: f64 = 0.08;
const MAX_SEARCH_M: f64 = 0.4;
/// Largest distance of a supporting surface above or below the footprint, m. Over a lower surface,
/// down to `MAX_DROP_M`, the object floats.
const MAX_CONTACT_M: f64 = 0.06;
const MAX_DROP_M: f64 = 1.0;
/// Largest gap at which an object stands on the surface, m.
const SNAP_M: f64 = 0.015;
/// Largest distance between a measured point and the intersection of its ray with a dominant plane,
/// as a multiple of the measurement's error.
const MAX_MOVE_PER_ERROR: f64 = 3.0;
/// Step to which normals are rounded, below their accuracy. An object that is moved over a desk
/// then keeps the same plane, and its shadow map stays valid.
const NORMAL_STEP: f64 = 1.0 / 512.0;

/// Measured points of the room and the supports of objects, computed on first use.
#[derive(Debug, Default)]
pub struct SupportCache(Mutex<Option<RoomScan>>);

#[derive(Debug)]
struct RoomScan {
    samples: Vec<DepthSamples>,
    /// The first frame's camera, with which `measured` was computed.
    camera: Option<Geometry>,
    measured: Arc<RoomPoints>,
    /// Solids of the points, computed on first use.
    solids: Option<Arc<Room>>,
    /// Radiance of surfaces, with the camera response that it depends on.
    radiance: Option<(Response, Arc<LazyRadiance>)>,
    last: LastSupports,
}

impl RoomScan {
    /// The measured points as solids.
    fn solids(&mut self) -> Arc<Room> {
        let points = &self.measured.points;
        self.solids.get_or_insert_with(|| Arc::new(Room::of(points.iter().map(|point| point.at_m)))).clone()
    }
}

/// Whether to wait for the first read of the recording's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scan {
    Awaited,
    IfReady,
}

/// Memo of the last supports.
#[derive(Debug, Default)]
struct LastSupports {
    meshes: Vec<Arc<Mesh>>,
    up: Option<DVec3>,
    objects: Vec<Object>,
    supported: Vec<Object>,
}

impl LastSupports {
    fn is_of(&self, scene: &Scene) -> bool {
        let meshes = scene.meshes.len() == self.meshes.len()
            && scene.meshes.iter().zip(&self.meshes).all(|(a, b)| Arc::ptr_eq(a, b));
        meshes && scene.up_in_world == self.up
    }

    fn get(&self, object: &Object) -> Option<Object> {
        let at = self.objects.iter().position(|known| known == object)?;
        self.supported.get(at).cloned()
    }
}

impl Shot {
    /// The scene's objects, each with its support plane and facets. Reads the recording's depth on
    /// first use.
    pub(crate) fn objects(&self) -> Vec<Object> {
        // Both shadows and the flattening of depth near planes need the supports.
        let is_needed = self.settings.shadow.cast || self.settings.depth.occlusion;
        if !is_needed || self.scene.objects.is_empty() {
            return self.scene.objects.clone();
        }
        let mut known = self.supports.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = self.scan(&mut known);
        if !known.last.is_of(&self.scene) {
            known.last = LastSupports::default();
        }
        // While one object is moved, the supports of the others stay valid.
        let with_support = |object: &Object| {
            let new = || {
                let support = self.support_of(object, &known.measured).map(|(support, _)| support);
                let facets = support.map(|support| facets(&self.scene, object, &support, &known.measured.points));
                Object { support, facets: facets.unwrap_or_default(), ..object.clone() }
            };
            known.last.get(object).unwrap_or_else(new)
        };
        let supported: Vec<_> = self.scene.objects.iter().map(with_support).collect();
        let Scene { meshes, up_in_world, objects, .. } = &*self.scene;
        let (meshes, objects, up) = (meshes.clone(), objects.clone(), *up_in_world);
        known.last = LastSupports { meshes, up, objects, supported: supported.clone() };
        supported
    }

    /// The room's scan through the present camera. Reads the recording's depth on first use.
    fn scan<'a>(&self, known: &'a mut Option<RoomScan>) -> &'a mut RoomScan {
        let camera = self.known_geometry_at(0);
        let known = known.get_or_insert_with(|| {
            let samples = self.depth_samples();
            let measured = Arc::new(RoomPoints::new(self.points_by_frame(&samples)));
            RoomScan {
                measured,
                samples,
                camera: camera.clone(),
                solids: None,
                radiance: None,
                last: LastSupports::default(),
            }
        });
        if known.camera != camera {
            (known.measured, known.camera) = (Arc::new(RoomPoints::new(self.points_by_frame(&known.samples))), camera);
            (known.solids, known.radiance, known.last) = (None, None, LastSupports::default());
        }
        known
    }

    /// The surface at a pixel for placing an object: as [`Shot::surface_at`] measures it, moved
    /// onto the dominant plane of the room that explains it as well. `share` and `sigma_m` stay
    /// those of the frame's own depth.
    pub fn placement_surface(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        self.placed(frame, at_px, Scan::Awaited)
    }

    /// [`Shot::placement_surface`] for a preview: the frame's own depth alone until the recording's
    /// depth has been read.
    pub fn placement_preview(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        self.placed(frame, at_px, Scan::IfReady)
    }

    fn placed(&self, frame: &Frame, at_px: DVec2, scan: Scan) -> Result<Surface, SurfaceError> {
        let surface = self.surface_at(frame, at_px)?;
        let Some(measured) = self.room_scan(scan) else { return Ok(surface) };
        let Plane { point_m, normal } = surface.plane;
        let around = measured.around(point_m, AROUND_M);
        let accepts = |along: DVec3| along.dot(normal).abs() > MIN_SUPPORT_COSINE;
        let dominant = measured.planes.or_dominant(surface.plane.into(), point_m, &around, accepts);
        let Ok(plane) = self.support_on_plane(frame.index, at_px, dominant.coefficients()) else {
            return Ok(surface);
        };
        // At a grazing angle, a small error of the plane moves the intersection far.
        let error_m = MeasuredPoint::new(point_m, surface.depth_m, point_m).tolerance_m;
        let is_near = plane.point_m.distance(point_m) < MAX_MOVE_PER_ERROR * error_m;
        Ok(if is_near { Surface { plane, ..surface } } else { surface })
    }

    /// Up by the room's largest level surface, if depth shows one
    /// ([`super::room_planes::RoomPlanes::up`]).
    pub(super) fn up_of_room(&self, guess: DVec3, scan: Scan) -> Option<DVec3> {
        self.room_scan(scan)?.planes.up(guess)
    }

    /// Measured points and planes of the room. `None` if they are not ready and `scan` does not
    /// wait.
    fn room_scan(&self, scan: Scan) -> Option<Arc<RoomPoints>> {
        match scan {
            Scan::Awaited => {
                let mut known = self.supports.0.lock().unwrap_or_else(PoisonError::into_inner);
                Some(self.scan(&mut known).measured.clone())
            }
            Scan::IfReady => {
                let known = self.supports.0.try_lock().ok()?;
                let camera = self.known_geometry_at(0);
                known.as_ref().filter(|known| known.camera == camera).map(|known| known.measured.clone())
            }
        }
    }

    /// Makes a compositor of the present scene, with supports.
    pub(super) fn compositor_with_supports(&self, gpu: Gpu) -> Compositor {
        let scene = Scene { objects: self.objects(), ..Scene::clone(&self.scene) };
        let mut compositor = Compositor::new(gpu, scene);
        compositor.set_room(self.light_occluders());
        compositor.set_surface_radiance(self.surface_radiance());
        compositor
    }

    /// Updates a compositor's objects with their supports, the room's solids and its radiance.
    pub(super) fn update_compositor(&self, compositor: &mut Compositor) {
        compositor.place(&self.objects());
        compositor.set_room(self.light_occluders());
        compositor.set_surface_radiance(self.surface_radiance());
    }

    /// Radiance of surfaces in frames that do not clip there. `None` if the frames' gains are
    /// unknown.
    fn surface_radiance(&self) -> Option<Arc<LazyRadiance>> {
        let is_analysed = self.recording.exposure.iter().any(|exposure| exposure.brightness.is_some());
        if !is_analysed || !self.settings.shadow.cast {
            return None;
        }
        let response = self.camera().response;
        let mut known = self.supports.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = known.as_mut().filter(|known| !known.measured.points.is_empty())?;
        if known.radiance.as_ref().is_none_or(|(of, _)| *of != response) {
            let (recording, rig) = (self.recording.clone(), self.rig.clone());
            let (of, measured) = (response.clone(), known.measured.clone());
            let lazy = LazyRadiance::new(Box::new(move || radiance_of(&recording, &rig, &of, &measured)));
            known.radiance = Some((response, Arc::new(lazy)));
        }
        known.radiance.as_ref().map(|(_, radiance)| radiance.clone())
    }

    /// Solids of the room that occlude light. `None` for a default lighting, whose directions are
    /// arbitrary.
    fn light_occluders(&self) -> Option<Arc<Room>> {
        let is_default = self.scene.lighting_origin == LightingOrigin::Default && self.estimated_lighting.is_none();
        if is_default || !self.settings.shadow.cast {
            return None;
        }
        let mut known = self.supports.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = known.as_mut().filter(|known| !known.measured.points.is_empty())?;
        Some(known.solids())
    }

    /// Solids of the room, for any lighting. Reads the recording's depth on first use.
    pub(super) fn solids(&self) -> Arc<Room> {
        let mut known = self.supports.0.lock().unwrap_or_else(PoisonError::into_inner);
        self.scan(&mut known).solids()
    }

    /// Measured points of the room, read again.
    pub(super) fn room_points(&self) -> RoomPoints {
        RoomPoints::new(self.points_by_frame(&self.depth_samples()))
    }

    /// The support plane of an object, and its source.
    pub(super) fn support_of(&self, object: &Object, measured: &RoomPoints) -> Option<(Plane, PlaneSource)> {
        let floor = self.floor();
        let up = self.up()?;
        let foot = ObjectFootprint::of(&self.scene, object, up)?;
        let measured = foot.support(measured).map(|plane| (plane, PlaneSource::Depth));
        let known = measured.or_else(|| {
            let is_near = |plane: &HessePlane| foot.height_m(plane).abs() < MAX_DROP_M;
            floor.filter(is_near).map(|plane| (plane, PlaneSource::Recording))
        });
        Some(match known {
            Some((plane, known_by)) => (foot.on(&plane.facing(up)), known_by),
            None => (Plane { point_m: foot.lowest(up), normal: up }, PlaneSource::Foot),
        })
    }

    /// Height of an object's lowest point over the level plane vertically below it in a frame's
    /// depth, m.
    pub(super) fn height_over_depth_m(&self, frame: &Frame, object: &Object, up: DVec3) -> Option<f64> {
        let depth = frame.depth.as_ref()?;
        let samples =
            DepthSamples::new(frame.index, self.measured_from(frame, depth).ok()?, depth, SINGLE_FRAME_SAMPLES_ACROSS);
        let foot = ObjectFootprint::of(&self.scene, object, up)?;
        let points = self.points_by_frame(&[samples]).into_iter().flat_map(|(_, points)| points).collect();
        foot.support(&RoomPoints { points, ..RoomPoints::default() }).map(|plane| foot.height_m(&plane))
    }
}

/// The lowest points of an object.
struct ObjectFootprint {
    points: Vec<DVec3>,
    middle: DVec3,
    /// Distance from the middle to the outermost point.
    radius_m: f64,
    up: DVec3,
}

impl ObjectFootprint {
    fn of(scene: &Scene, object: &Object, up: DVec3) -> Option<Self> {
        let all: Vec<DVec3> = object.points_m(scene).collect();
        let low = all.iter().fold(DVec3::INFINITY, |m, p| m.min(*p));
        let high = all.iter().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
        let lowest = all.iter().map(|p| p.dot(up)).reduce(f64::min)?;
        let within = (FOOTPRINT_SHARE * (high - low).max_element()).max(MIN_FOOTPRINT_M);
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

    /// Height of its lowest point over a plane, m.
    fn height_m(&self, plane: &HessePlane) -> f64 {
        let plane = plane.facing(self.up);
        self.points.iter().map(|p| plane.height_m(*p)).fold(f64::INFINITY, f64::min)
    }

    /// The plane with a rounded normal, moved to the lowest point if that is within `SNAP_M`.
    fn on(&self, plane: &HessePlane) -> Plane {
        let off = plane.height_m(self.middle);
        let normal = ((plane.normal / NORMAL_STEP).round() * NORMAL_STEP).normalize();
        // Rotated about the point below the footprint.
        let plane = HessePlane { normal, offset_m: normal.dot(self.middle) - off };
        let height_m = self.height_m(&plane);
        let moved_m = if height_m.abs() <= SNAP_M { height_m } else { 0.0 };
        Plane { point_m: self.middle + (moved_m - off) * plane.normal, normal: plane.normal }
    }

    /// The plane of the points around that supports it: one in contact, or else one below that it
    /// floats over.
    fn support(&self, measured: &RoomPoints) -> Option<HessePlane> {
        self.support_within(measured, -MAX_CONTACT_M..MAX_CONTACT_M)
            .or_else(|| self.support_within(measured, -MAX_DROP_M..-MAX_CONTACT_M))
    }

    /// The plane with most inliers among the points around, in a range of heights over the
    /// footprint, m.
    fn support_within(&self, measured: &RoomPoints, heights_m: Range<f64>) -> Option<HessePlane> {
        let around_m = (SEARCH_PER_RADIUS * self.radius_m).clamp(MIN_SEARCH_M, MAX_SEARCH_M);
        let foot = self.lowest(self.up);
        let near: Vec<MeasuredPoint> = measured
            .points
            .iter()
            .filter(|point| {
                let (off, height) = (point.at_m - foot, (point.at_m - foot).dot(self.up));
                heights_m.contains(&height) && (off - height * self.up).length() < around_m
            })
            .copied()
            .collect();
        let plane = ransac_plane(&near, |normal| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE)?.facing(self.up);
        let below_foot_m = foot - plane.height_m(foot) / plane.normal.dot(self.up) * self.up;
        let is_ground = |normal: DVec3| normal.dot(self.up).abs() >= MIN_SUPPORT_COSINE;
        Some(measured.planes.or_dominant(plane, below_foot_m, &near, is_ground).facing(self.up))
    }
}

#[cfg(test)]
mod tests {
    use super::super::planes::random_index;
    use super::*;

    fn foot(height_m: f64) -> ObjectFootprint {
        let corner = |x: f64, y: f64| DVec3::new(x, y, height_m);
        let points = vec![corner(-0.05, -0.05), corner(0.05, -0.05), corner(0.05, 0.05), corner(-0.05, 0.05)];
        ObjectFootprint { points, middle: DVec3::new(0.0, 0.0, height_m), radius_m: 0.07, up: DVec3::Z }
    }

    /// A table at height 0 with a box on it, and noise of 2 mm.
    fn room() -> Vec<MeasuredPoint> {
        let noise = |n: usize| (random_index(n, 4001) as f64 / 2000.0 - 1.0) * 0.002;
        let place = |i: usize| DVec2::new((i % 40) as f64, (i / 40) as f64) * 0.01 - 0.2;
        let height = |at: DVec2| if at.x > 0.06 { 0.05 } else { 0.0 };
        let at_m = |i: usize| place(i).extend(height(place(i)) + noise(i));
        (0..1600).map(|i| MeasuredPoint { at_m: at_m(i), tolerance_m: 0.005, camera_m: DVec3::Z }).collect()
    }

    #[test]
    fn support_of_an_object_is_the_table_and_not_the_box_beside_it() {
        let plane =
            foot(0.004).support_within(&RoomPoints::new(vec![(0, room())]), -MAX_CONTACT_M..MAX_CONTACT_M).unwrap();
        assert!(plane.normal.z > 0.999 && plane.offset_m.abs() < 0.002, "{plane:?}");
        // The footprint is 4 mm above the measured plane: the plane moves to it.
        let support = foot(0.004).on(&plane);
        assert!((support.point_m.z - 0.004).abs() < 0.0005, "{support:?}");
        // 3 cm above, it floats.
        let support = foot(0.03).on(&plane);
        assert!(support.point_m.z.abs() < 0.002, "{support:?}");
    }

    #[test]
    fn support_normals_that_differ_by_less_than_their_accuracy_are_rounded_to_one() {
        let tilted = |by: f64| {
            let normal = DVec3::new(by, 0.0, 1.0).normalize();
            HessePlane::from(Plane { point_m: DVec3::new(3.0, -2.0, 0.0), normal })
        };
        let foot = ObjectFootprint { middle: DVec3::new(3.0, -2.0, 0.03), ..foot(0.03) };
        let [a, b] = [0.0021, 0.0022].map(|by| foot.on(&tilted(by)));
        assert_eq!(a.normal, b.normal);
        assert!(foot.on(&tilted(0.01)).normal != a.normal);
        // Rotated about the world's origin, it would be off by half a millimetre.
        assert!(a.point_m.z.abs() < 1e-4, "{a:?}");
    }

    #[test]
    fn wall_and_too_few_points_are_no_support() {
        let wall: Vec<MeasuredPoint> = (0..900)
            .map(|i| DVec3::new(0.01, (i % 30) as f64 * 0.005 - 0.07, (i / 30) as f64 * 0.003 - 0.05))
            .map(|at_m| MeasuredPoint { at_m, tolerance_m: 0.003, camera_m: DVec3::X })
            .collect();
        assert!(foot(0.0).support_within(&RoomPoints::new(vec![(0, wall)]), -MAX_CONTACT_M..MAX_CONTACT_M).is_none());
        assert!(
            foot(0.0)
                .support_within(&RoomPoints::new(vec![(0, room()[..20].to_vec())]), -MAX_CONTACT_M..MAX_CONTACT_M)
                .is_none()
        );
    }
}
