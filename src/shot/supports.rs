//! A shot's supports: the recording's depth is read once, and the supports of objects are cached
//! until the objects change.

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};

use super::radiance::radiance_of;
use super::{Shot, Surface, SurfaceError};
use crate::camera::{Geometry, Response};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::plane::{HessePlane, Plane};
use crate::scene::{LightingOrigin, Mesh, Object, Scene};
use crate::shadow::{LazyRadiance, Room};
use crate::support::{
    DepthSamples, MeasuredPoint, PlaneSource, RoomPoints, facets, height_over_points_m, object_support, points_by_frame,
};

/// Depth samples across a single frame's map.
const SINGLE_FRAME_SAMPLES_ACROSS: u32 = 320;
/// Largest distance between a measured point and the intersection of its ray with a dominant plane,
/// as a multiple of the measurement's error.
const MAX_MOVE_PER_ERROR: f64 = 3.0;
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
            let samples = DepthSamples::of_recording(&self.recording);
            let measured = Arc::new(self.points_of(&samples));
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
            (known.measured, known.camera) = (Arc::new(self.points_of(&known.samples)), camera);
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
        let dominant = measured.or_dominant(&surface.plane);
        let Ok(plane) = self.support_on_plane(frame.index, at_px, dominant.coefficients()) else {
            return Ok(surface);
        };
        // At a grazing angle, a small error of the plane moves the intersection far.
        let error_m = MeasuredPoint::tolerance_m(surface.depth_m);
        let is_near = plane.point_m.distance(surface.plane.point_m) < MAX_MOVE_PER_ERROR * error_m;
        Ok(if is_near { Surface { plane, ..surface } } else { surface })
    }

    /// Up by the room's largest level surface, if depth shows one
    /// ([`RoomPlanes::up`](crate::support::RoomPlanes::up)).
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
        self.points_of(&DepthSamples::of_recording(&self.recording))
    }

    /// Measured points through the present camera.
    fn points_of(&self, samples: &[DepthSamples]) -> RoomPoints {
        RoomPoints::new(points_by_frame(samples, |frame| self.known_geometry_at(frame)))
    }

    /// The recording's floor: the plane through the world's origin, across up.
    pub fn floor(&self) -> Option<HessePlane> {
        let normal = self.recording.up.filter(|_| self.recording.has_floor)?;
        Some(HessePlane { normal, offset_m: 0.0 })
    }

    /// The support plane of an object, and its source.
    pub(super) fn support_of(&self, object: &Object, measured: &RoomPoints) -> Option<(Plane, PlaneSource)> {
        object_support(&self.scene, object, self.up()?, self.floor(), measured)
    }

    /// Height of an object's lowest point over the level plane vertically below it in a frame's
    /// depth, m.
    pub(super) fn height_over_depth_m(&self, frame: &Frame, object: &Object, up: DVec3) -> Option<f64> {
        let depth = frame.depth.as_ref()?;
        let samples =
            DepthSamples::new(frame.index, self.measured_from(frame, depth).ok()?, depth, SINGLE_FRAME_SAMPLES_ACROSS);
        let points = points_by_frame(&[samples], |frame| self.known_geometry_at(frame));
        height_over_points_m(&self.scene, object, up, points.into_iter().flat_map(|(_, points)| points).collect())
    }
}
