//! Scans of a site, as a source of depth for recordings without a depth sensor.
//!
//! A scan is the geometry of a place in axes of its own. Aligned with the world of a recording, it
//! gives each frame the depth that a sensor on the camera would have measured
//! ([`ScannedSite::depth`]). All that reads depth follows: occlusion, shadows, supports, placement,
//! the light of the room.
//!
//! - `morton`: positions on a space-filling curve. `point_octree`: points as discs at several
//!   levels of detail. `triangle_blocks`: a mesh in blocks. `depth_rendering`: both in a camera's
//!   picture.
//!
//! Not modelled: objects that were moved between the scan and the footage; colours of the scan.

pub mod alignment;
mod depth_rendering;
mod morton;
mod point_octree;
pub mod refinement;
pub mod scan_file;
#[cfg(test)]
mod tests;
mod triangle_blocks;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use depth_rendering::{MIN_DISTANCE_M, ScanSurface};
use morton::bounds;
use point_octree::PointOctree;
use scan_file::{ReadingWatch, ScanError, ScanGeometry};
use triangle_blocks::TriangleBlocks;

use crate::camera::Geometry;
use crate::depth::Rays;
use crate::digest::{Digest, Digester};
use crate::memo::Memo;
use crate::pixels::DepthMap;
use crate::pose::Pose;
use crate::source::file::FileStamp;
use crate::text::{count, fixed};
use crate::tracking::{NoPose, PoseTrack};

/// Number of cameras with memoized rays: that of the recording, and those of reduced pictures.
const CAMERA_CAPACITY: usize = 4;

/// The geometry of a scan file, in metres.
#[derive(Debug)]
pub struct SiteScan {
    pub path: PathBuf,
    /// Length of the file's unit, m.
    pub metres_per_unit: f64,
    /// The unit that overrode the format's.
    stated_metres_per_unit: Option<f64>,
    /// Number of points of a cloud, or of vertices of a mesh.
    pub point_count: usize,
    /// 0 for a point cloud.
    pub triangle_count: usize,
    /// Lowest and highest coordinates in the scan's axes, m.
    pub bounds_m: [DVec3; 2],
    /// Direction of up in the scan's axes, if the format defines it.
    pub up: Option<DVec3>,
    pub warnings: Vec<String>,
    surface: ScanSurface,
    /// Origin of the surface's coordinates in the scan's axes, m.
    origin_m: DVec3,
    /// Digest of the geometry.
    digest: Digest,
    stamp: FileStamp,
    rays: Memo<Geometry, Arc<Rays>>,
}

/// A scan in the world of a recording.
#[derive(Clone, Debug)]
pub struct ScannedSite {
    pub scan: Arc<SiteScan>,
    /// Takes a point of the scan, m, to the world.
    pub world_from_scan: Pose,
    /// The pose in the world of the scene file. A correction of the recording's world does not
    /// change it.
    stated: Pose,
}

impl SiteScan {
    /// Reads a file. `metres_per_unit` overrides the unit of the format; without both it is the
    /// metre.
    pub fn read(path: &Path, metres_per_unit: Option<f64>) -> Result<Self, ScanError> {
        Self::read_watched(path, metres_per_unit, &ReadingWatch::default())
    }

    /// Like [`SiteScan::read`]; another thread watches the progress and may end it.
    pub fn read_watched(path: &Path, metres_per_unit: Option<f64>, watch: &ReadingWatch) -> Result<Self, ScanError> {
        let stamp = FileStamp::of(path);
        Ok(Self { stamp, ..Self::of_geometry(path, scan_file::read_watched(path, watch)?, metres_per_unit) })
    }

    /// The scan of a file that was read.
    pub fn of_geometry(path: &Path, geometry: ScanGeometry, metres_per_unit: Option<f64>) -> Self {
        let ScanGeometry { origin, mut positions, triangles, metres_per_unit: of_format, up, warnings } = geometry;
        let stated_metres_per_unit = metres_per_unit;
        let metres_per_unit = metres_per_unit.or(of_format).unwrap_or(1.0);
        let mut digester = Digester::default();
        digester.add_numbers(&origin.to_array());
        digester.add_numbers(bytemuck::cast_slice::<Vec3, f32>(&positions));
        digester.add_numbers(triangles.as_flattened());
        digester.add_numbers(&[metres_per_unit]);
        positions.iter_mut().for_each(|position| *position = (position.as_dvec3() * metres_per_unit).as_vec3());
        let origin_m = origin * metres_per_unit;
        let (low, high) = bounds(positions.iter());
        let (point_count, triangle_count) = (positions.len(), triangles.len());
        let surface = if triangles.is_empty() {
            ScanSurface::Points(PointOctree::new(&positions))
        } else {
            let corners = triangles.iter().map(|corners| corners.map(|corner| positions[corner as usize]));
            ScanSurface::Triangles(TriangleBlocks::new(corners))
        };
        Self {
            path: path.to_owned(),
            metres_per_unit,
            stated_metres_per_unit,
            point_count,
            triangle_count,
            bounds_m: [low, high].map(|corner| corner.as_dvec3() + origin_m),
            up,
            warnings,
            surface,
            origin_m,
            digest: digester.finish(),
            stamp: FileStamp::of(path),
            rays: Memo::new(CAMERA_CAPACITY),
        }
    }

    /// Size and position, for a person.
    pub fn description(&self) -> String {
        let [low, high] = self.bounds_m;
        let three = |numbers: DVec3, between: &str| numbers.to_array().map(|n| fixed(n, 2)).join(between);
        let of = if self.triangle_count > 0 {
            count(self.triangle_count, "triangle")
        } else {
            count(self.point_count, "point")
        };
        format!("{of}, {} m, from {} to {} m", three(high - low, " × "), three(low, " "), three(high, " "))
    }

    /// True if reading the file again would give the same scan.
    pub fn is_of(&self, path: &Path, metres_per_unit: Option<f64>) -> bool {
        let is_same_file =
            || path.canonicalize().is_ok_and(|path| self.path.canonicalize().is_ok_and(|own| own == path));
        metres_per_unit == self.stated_metres_per_unit && (self.path == path || is_same_file()) && self.stamp.is_fresh()
    }

    /// Middle of the scan in its own axes, m.
    pub fn center_m(&self) -> DVec3 {
        0.5 * (self.bounds_m[0] + self.bounds_m[1])
    }

    /// Renders depth from a free camera. Surfaces nearer than `min_distance_m` are clipped.
    pub fn view(&self, camera: &Geometry, camera_from_scan: &Pose, min_distance_m: f32) -> DepthMap {
        let origin_m = camera_from_scan.transform_point(self.origin_m);
        let camera_from_surface = Pose::new(camera_from_scan.rotation, origin_m);
        let min_distance_m = min_distance_m.max(MIN_DISTANCE_M);
        let pose = |_| camera_from_surface;
        let depth_m = depth_rendering::rendered_depth_m(&self.surface, &self.rays(camera), &pose, min_distance_m);
        let (width, height) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
        DepthMap { width, height, depth_m, timestamp_s: 0.0 }
    }

    fn rays(&self, camera: &Geometry) -> Arc<Rays> {
        self.rays.get_or_insert_with(camera.clone(), |camera| Arc::new(Rays::new(camera)))
    }
}

impl ScannedSite {
    pub fn new(scan: Arc<SiteScan>, world_from_scan: Pose) -> Self {
        Self { scan, world_from_scan, stated: world_from_scan }
    }

    /// Depth of the scan from a camera's pose, as a sensor of the camera would measure it at a time
    /// (s) with the camera's readout; 0 where the scan has no surface. `camera_from_world`: the
    /// pose at a time relative to that one, s.
    pub fn depth(
        &self,
        camera: &Geometry,
        camera_from_world: impl Fn(f64) -> Pose + Sync,
        timestamp_s: f64,
    ) -> DepthMap {
        let origin_in_world_m = self.world_from_scan.transform_point(self.scan.origin_m);
        // camera_from_surface = camera_from_world · world_from_scan · scan_from_surface.
        let camera_from_surface = |time_s: f64| {
            let camera = camera_from_world(time_s);
            Pose::new(camera.rotation * self.world_from_scan.rotation, camera.transform_point(origin_in_world_m))
        };
        let rays = self.scan.rays(camera);
        let depth_m =
            depth_rendering::rendered_depth_m(&self.scan.surface, &rays, &camera_from_surface, MIN_DISTANCE_M);
        let (width, height) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
        DepthMap { width, height, depth_m, timestamp_s }
    }

    /// Depth at a time of a track, with the poses of the rows. An error if there is no pose at that
    /// time.
    pub fn depth_at_time(&self, camera: &Geometry, track: &PoseTrack, time_s: f64) -> Result<DepthMap, NoPose> {
        let middle = track.at(time_s)?;
        let pose = |later_s: f64| track.at_or_nearest(time_s + later_s).unwrap_or(middle);
        Ok(self.depth(camera, pose, time_s))
    }

    /// The site in another world.
    pub fn in_world(&self, world_from_other: &Pose) -> Self {
        // other_from_scan = world_from_other⁻¹ · world_from_scan.
        let rotation = world_from_other.rotation.conjugate() * self.world_from_scan.rotation;
        let origin = world_from_other.inverse_transform_point(self.world_from_scan.translation_m);
        Self { world_from_scan: Pose::new(rotation, origin), ..self.clone() }
    }

    /// A text that changes with the geometry and its stated place.
    pub fn identity(&self) -> String {
        format!("{:?} {:?}", self.scan.digest, self.stated)
    }
}
