//! A shot's supports: the recording's depth is read once, and the supports of objects are memoized.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DVec2, DVec3};

use super::radiance::radiance_of;
use super::{Shot, Surface, SurfaceError};
use crate::camera::{Geometry, Response};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::memo::{ByAddress, Memo};
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

/// Memos of the data that is derived from a recording's depth, and of the supports of objects.
#[derive(Debug, Default)]
pub struct RoomMemos {
    /// Locked while the depth is read, so that it is read once.
    reading: Mutex<()>,
    /// Depth of the recording. No memo: it has no key, since the recording stays the same.
    samples: OnceLock<Vec<DepthSamples>>,
    /// Measured points, by the first frame's camera.
    points: Memo<Option<Geometry>, Arc<RoomPoints>>,
    /// The points as solids.
    solids: Memo<ByAddress<RoomPoints>, Arc<Room>>,
    /// Radiance of surfaces, by the camera response that it depends on.
    radiance: Memo<(ByAddress<RoomPoints>, Response), Arc<LazyRadiance>>,
    /// Objects with their supports.
    supported: Memo<SupportInputs, Vec<Object>>,
}

impl RoomMemos {
    fn solids(&self, points: &Arc<RoomPoints>) -> Arc<Room> {
        self.solids.get_or_insert_with(ByAddress(points.clone()), |points| {
            Arc::new(Room::of(points.points.iter().map(|point| point.at_m)))
        })
    }
}

/// All inputs of objects' supports.
#[derive(Clone, Debug, PartialEq)]
struct SupportInputs {
    site: SupportSite,
    objects: Vec<Object>,
}

/// The inputs that the supports of all objects share.
#[derive(Clone, Debug, PartialEq)]
struct SupportSite {
    points: ByAddress<RoomPoints>,
    meshes: Vec<ByAddress<Mesh>>,
    up: Option<DVec3>,
}

/// Whether to wait for the first read of the recording's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scan {
    Awaited,
    IfReady,
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
        let points = ByAddress(self.read_room());
        let Scene { meshes, up_in_world, objects, .. } = &*self.scene;
        let meshes = meshes.iter().cloned().map(ByAddress).collect();
        let site = SupportSite { points, meshes, up: *up_in_world };
        let memo = &self.room.supported;
        memo.get_or_insert_with(SupportInputs { site, objects: objects.clone() }, |inputs| {
            // While one object is moved, the supports of the others stay valid.
            let latest = memo.latest().filter(|(of, _)| of.site == inputs.site);
            let cached = |object: &Object| {
                let (of, supported) = latest.as_ref()?;
                supported.get(of.objects.iter().position(|other| other == object)?).cloned()
            };
            let with_support =
                |object| cached(object).unwrap_or_else(|| self.with_support(object, &inputs.site.points));
            inputs.objects.iter().map(with_support).collect()
        })
    }

    /// An object with its support plane and facets.
    fn with_support(&self, object: &Object, measured: &RoomPoints) -> Object {
        let support = self.support_of(object, measured).map(|(support, _)| support);
        let facets = support.map(|support| facets(&self.scene, object, &support, &measured.points));
        Object { support, facets: facets.unwrap_or_default(), ..object.clone() }
    }

    /// Measured points of the room through the present camera. Reads the recording's depth on first
    /// use.
    fn read_room(&self) -> Arc<RoomPoints> {
        let _reading = self.room.reading.lock().unwrap_or_else(PoisonError::into_inner);
        self.room.points.get_or_insert_with(self.known_geometry_at(0), |_| {
            let samples = self.room.samples.get_or_init(|| DepthSamples::of_recording(&self.recording));
            Arc::new(self.points_of(samples))
        })
    }

    /// The points of [`Shot::read_room`], if they have been read.
    fn known_room(&self) -> Option<Arc<RoomPoints>> {
        self.room.points.get(&self.known_geometry_at(0))
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
            Scan::Awaited => Some(self.read_room()),
            Scan::IfReady => self.known_room(),
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
        let measured = self.known_room().filter(|measured| !measured.points.is_empty())?;
        let key = (ByAddress(measured), self.camera().response);
        Some(self.room.radiance.get_or_insert_with(key, |(measured, response)| {
            let (recording, rig) = (self.recording.clone(), self.rig.clone());
            let (measured, response) = (Arc::clone(&measured.0), response.clone());
            Arc::new(LazyRadiance::new(Box::new(move || radiance_of(&recording, &rig, &response, &measured))))
        }))
    }

    /// Solids of the room that occlude light. `None` for a default lighting, whose directions are
    /// arbitrary.
    fn light_occluders(&self) -> Option<Arc<Room>> {
        let is_default = self.scene.lighting_origin == LightingOrigin::Default && self.estimated_lighting.is_none();
        if is_default || !self.settings.shadow.cast {
            return None;
        }
        let measured = self.known_room().filter(|measured| !measured.points.is_empty())?;
        Some(self.room.solids(&measured))
    }

    /// Solids of the room, for any lighting. Reads the recording's depth on first use.
    pub(super) fn solids(&self) -> Arc<Room> {
        self.room.solids(&self.read_room())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{RelativeBrightness, SpatialGain};
    use crate::recording::OpenOptions;
    use crate::shot::ShotOptions;
    use glam::DAffine3;
    use std::path::Path;

    fn demo() -> Shot {
        let options = ShotOptions { scene: Some("scenes/demo.toml".into()), ..ShotOptions::default() };
        Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap()
    }

    #[test]
    fn supports_after_changes_are_those_of_a_new_shot() {
        let mut reused = demo();
        let first = reused.objects();
        assert!(first.len() > 1 && first.iter().all(|object| object.support.is_some()), "{first:?}");
        let mut moved = Scene::clone(&reused.scene);
        moved.objects[0].move_by(DAffine3::from_translation(DVec3::new(0.05, -0.02, 0.03)));
        let mut tilted = moved.clone();
        tilted.up_in_world = Some(DVec3::new(0.0, 0.3, 1.0).normalize());
        let mut reshaped = tilted.clone();
        let parts = &reshaped.objects[0].parts;
        let mesh = Arc::make_mut(&mut reshaped.meshes[parts[0].mesh]);
        mesh.vertices.iter_mut().for_each(|vertex| vertex.position[0] += 0.02);
        let mut before = first;
        for scene in [moved, tilted, reshaped] {
            reused.scene = Arc::new(scene);
            let mut new = demo();
            new.scene = reused.scene.clone();
            let objects = reused.objects();
            assert!(objects == new.objects() && objects != before);
            before = objects;
        }
        // Another camera measures other points.
        let points = reused.read_room();
        assert!(Arc::ptr_eq(&points, &reused.read_room()));
        reused.rig.set_text("camera.fx_px=700", &mut reused.settings).unwrap();
        assert!(reused.known_room().is_none() && reused.read_room().points[0].at_m != points.points[0].at_m);
        assert!(reused.objects() != before);
    }

    #[test]
    fn solids_and_radiance_are_kept_until_their_inputs_change() {
        let mut shot = demo();
        let brightness = RelativeBrightness { factors: [1.0; 3], median_s: None, spatial_gain: SpatialGain::default() };
        let recording = Arc::make_mut(&mut shot.recording);
        Arc::make_mut(&mut recording.exposure)[0].brightness = Some(brightness);
        shot.read_room();
        let derived = |shot: &Shot| (shot.light_occluders().unwrap(), shot.surface_radiance().unwrap());
        let (solids, radiance) = derived(&shot);
        let is_kept = |shot: &Shot| {
            let (solids_now, radiance_now) = derived(shot);
            [Arc::ptr_eq(&solids, &solids_now), Arc::ptr_eq(&radiance, &radiance_now)]
        };
        assert_eq!(is_kept(&shot), [true; 2]);
        let mut linear = shot.clone();
        linear.rig.set_text("camera.response.curve=linear", &mut linear.settings).unwrap();
        assert_eq!(is_kept(&linear), [true, false]);
        // Another camera measures other points.
        shot.rig.set_text("camera.fx_px=700", &mut shot.settings).unwrap();
        shot.read_room();
        assert_eq!(is_kept(&shot), [false; 2]);
    }
}
