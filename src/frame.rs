//! One moment of a recording.

use std::sync::{Arc, Weak};

use glam::Vec3;

use crate::interpolation::bilinear_weights;
use crate::pixels::{DepthMap, Pixels};
use crate::pose::Pose;

/// A frame as the camera delivered it. Never changed in place: the addresses of its pixels and
/// depth identify one decoding.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Position in the recording's order, from 0.
    pub index: usize,
    /// The middle of the middle row's exposure, seconds on the recording's clock.
    pub timestamp_s: f64,
    pub pixels: Arc<Pixels>,
    /// Depth of the site, registered to the colour picture. `None` without a sensor.
    pub depth: Option<Arc<DepthMap>>,
    pub exposure: FrameExposure,
    /// Opacity of the virtual layer: a factor on its light and coverage, 0 to 1. It fades while a
    /// live camera's pose is lost.
    pub opacity: f64,
    /// Neighbouring frames of the recording, in order; empty unless requested.
    pub neighbours: Vec<Arc<NeighbourFrame>>,
    /// Surfaces of the room, fused from all depth maps by an analysis.
    pub surfels: Arc<[Surfel]>,
}

impl Frame {
    /// A picture alone, with an opaque layer.
    pub fn new(index: usize, timestamp_s: f64, pixels: impl Into<Arc<Pixels>>) -> Self {
        Self {
            index,
            timestamp_s,
            pixels: pixels.into(),
            depth: None,
            exposure: FrameExposure::default(),
            opacity: 1.0,
            neighbours: Vec::new(),
            surfels: Arc::new([]),
        }
    }

    pub fn identity(&self) -> FrameIdentity {
        let depth = self.depth.as_ref().map(Arc::downgrade);
        FrameIdentity { index: self.index, pixels: Arc::downgrade(&self.pixels), depth }
    }
}

/// Identifies one decoding of a frame by the addresses of its pixels and depth. It does not keep
/// them in memory, and their addresses are not reused while it exists.
#[derive(Clone, Debug)]
pub struct FrameIdentity {
    index: usize,
    pixels: Weak<Pixels>,
    depth: Option<Weak<DepthMap>>,
}

impl PartialEq for FrameIdentity {
    fn eq(&self, other: &Self) -> bool {
        let same_depth = match (&self.depth, &other.depth) {
            (Some(depth), Some(other)) => depth.ptr_eq(other),
            (depth, other) => depth.is_none() && other.is_none(),
        };
        self.index == other.index && self.pixels.ptr_eq(&other.pixels) && same_depth
    }
}

/// A frame whose depth map votes in another frame.
#[derive(Clone, Debug)]
pub struct NeighbourFrame {
    pub index: usize,
    /// Time on the clock of [`Frame::timestamp_s`].
    pub timestamp_s: f64,
    pub pixels: Arc<Pixels>,
    pub depth: Arc<DepthMap>,
}

/// Side of the voxels of which surfels are the means, m.
pub const SURFEL_SPACING_M: f64 = 0.02;

/// A surface element of the room, the mean of several frames' measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Position in the recording's world.
    pub position_m: Vec3,
    /// Unit length, towards the cameras.
    pub normal: Vec3,
    /// Square roots of linear light in a frame of median brightness.
    pub sqrt_color: [f32; 3],
}

impl Surfel {
    /// Numbers of the surfel: position, normal, colour.
    pub fn to_array(&self) -> [f32; 9] {
        let (position, normal) = (self.position_m.to_array(), self.normal.to_array());
        std::array::from_fn(|n| [position, normal, self.sqrt_color][n / 3][n % 3])
    }

    pub fn from_array(numbers: [f32; 9]) -> Self {
        let three = |first: usize| [numbers[first], numbers[first + 1], numbers[first + 2]];
        Self { position_m: three(0).into(), normal: three(3).into(), sqrt_color: three(6) }
    }

    /// The surfel in another world.
    pub fn in_world(&self, world_from_other: &Pose) -> Self {
        let position_m = world_from_other.inverse_transform_point(self.position_m.as_dvec3()).as_vec3();
        let normal = (world_from_other.rotation.conjugate() * self.normal.as_dvec3()).as_vec3();
        Self { position_m, normal, ..*self }
    }
}

/// Seconds from a frame to the next by their timestamps; `usual_s` for the newest frame.
pub fn interval_s(timestamps_s: &[f64], index: usize, usual_s: f64) -> f64 {
    let time_s = |i: usize| timestamps_s.get(i).copied();
    let next = index.checked_add(1).and_then(time_s);
    next.zip(time_s(index)).map_or(usual_s, |(next, this)| next - this)
}

/// A frame's exposure as the camera reported it. `None`: not reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameExposure {
    /// Exposure time of each row, seconds on the recording's clock: the duration of motion blur.
    /// Also `None` if that clock is only nominal; see [`PhotoSettings::time_s`].
    pub time_s: Option<f64>,
    /// Amplification relative to the recording's base, as a factor.
    pub gain: Option<f64>,
    /// Exposure time by the picture's motion blur, estimated by an analysis, s.
    pub blur_estimate_s: Option<f64>,
    /// Settings in the picture's own file.
    pub photo: PhotoSettings,
    /// Brightness of the picture, estimated by an analysis.
    pub brightness: Option<RelativeBrightness>,
    /// Settings of a tracked lens.
    pub lens: FrameLens,
}

/// Settings of a tracked lens and its camera at a frame's time. `None`: not reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameLens {
    /// Focal length divided by the opening's diameter.
    pub f_number: Option<f64>,
    /// Focus distance, m.
    pub focus_distance_m: Option<f64>,
    /// Exposure time of each row, s, above 0.
    pub exposure_s: Option<f64>,
    /// Film speed.
    pub iso: Option<f64>,
}

impl FrameExposure {
    /// The reported exposure time, s, also from the picture's own file on a nominal clock.
    pub fn reported_s(&self) -> Option<f64> {
        self.time_s.or(self.photo.time_s)
    }

    /// This frame with the settings of a tracked lens, which override the others.
    pub fn with_lens(self, lens: FrameLens) -> Self {
        let photo = PhotoSettings {
            f_number: lens.f_number.or(self.photo.f_number),
            iso: lens.iso.or(self.photo.iso),
            ..self.photo
        };
        Self { time_s: lens.exposure_s.or(self.time_s), photo, lens, ..self }
    }
}

/// Brightness of a picture relative to the recording's other pictures of the same surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeBrightness {
    /// Linear light over that of the median frame: red, green, blue.
    pub factors: [f64; 3],
    /// Equivalent exposure of the median frame by [`FrameExposure`], seconds at f/1, ISO 100 and
    /// gain 1; `None` if most frames do not report it.
    pub median_s: Option<f64>,
    /// Additional gain that varies across the picture.
    pub spatial_gain: SpatialGain,
}

/// Nodes of [`SpatialGain`]; the same in shaders/exposure.wgsl.
pub const NODES_ACROSS: usize = 5;
pub const NODES_DOWN: usize = 4;
pub const NODES: usize = NODES_ACROSS * NODES_DOWN;

/// Gain across a picture, stops: at nodes from corner to corner, row by row, bilinear between them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpatialGain(pub [f32; NODES]);

impl SpatialGain {
    /// The four nodes around a place, in fractions of the picture's width and height, with their
    /// bilinear weights.
    pub fn weights(at: [f32; 2]) -> [(usize, f32); 4] {
        let node_and_share = |share: f32, nodes: usize| {
            let at = share.clamp(0.0, 1.0) * (nodes - 1) as f32;
            let node = (at as usize).min(nodes - 2);
            (node, at - node as f32)
        };
        let ((x, right), (y, down)) = (node_and_share(at[0], NODES_ACROSS), node_and_share(at[1], NODES_DOWN));
        let node = y * NODES_ACROSS + x;
        let [a, b, c, d] = bilinear_weights([right, down]);
        [(node, a), (node + 1, b), (node + NODES_ACROSS, c), (node + NODES_ACROSS + 1, d)]
    }

    /// Stops at a place, in fractions of the picture's width and height.
    pub fn at(&self, at: [f32; 2]) -> f32 {
        Self::weights(at).iter().map(|(node, weight)| weight * self.0[*node]).sum()
    }

    /// True if the gain is 0 stops everywhere.
    pub fn is_none(&self) -> bool {
        self.0 == [0.0; NODES]
    }
}

/// Settings of the camera from a picture's file (EXIF). All are above 0, except possibly `taken_s`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotoSettings {
    /// Exposure time, s.
    pub time_s: Option<f64>,
    /// Focal length divided by the opening's diameter.
    pub f_number: Option<f64>,
    /// Film speed.
    pub iso: Option<f64>,
    /// Focal length of the lens focused at infinity, metres. Manufacturers round it to millimetres.
    pub focal_length_m: Option<f64>,
    /// When it was taken: seconds since 1970-01-01 on the camera's clock, time zone unknown.
    pub taken_s: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn surfel_in_another_world_is_where_the_camera_of_that_world_sees_it() {
        let surfel = Surfel::from_array([0.3, -0.2, 1.5, 0.6, 0.0, -0.8, 0.1, 0.2, 0.3]);
        assert_eq!(Surfel::from_array(surfel.to_array()), surfel);
        let world_from_other =
            Pose::new(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 0.2), DVec3::new(0.4, 1.0, -2.0));
        let camera = Pose::new(DQuat::from_rotation_z(0.7), DVec3::new(0.1, 0.2, 0.3));
        // camera_from_other = camera_from_world · world_from_other.
        let turn = camera.rotation * world_from_other.rotation;
        let moved_camera = Pose::new(turn, camera.transform_point(world_from_other.translation_m));
        let moved = surfel.in_world(&world_from_other);
        let in_camera = |camera: &Pose, of: &Surfel| {
            (camera.transform_point(of.position_m.as_dvec3()), camera.rotation * of.normal.as_dvec3())
        };
        let (before, after) = (in_camera(&camera, &surfel), in_camera(&moved_camera, &moved));
        assert!(before.0.abs_diff_eq(after.0, 1e-6) && before.1.abs_diff_eq(after.1, 1e-6), "{before:?} {after:?}");
    }

    #[test]
    fn the_newest_frames_interval_is_the_usual_one() {
        let interval = |index| super::interval_s(&[1.0, 1.5, 1.75], index, 0.04);
        assert_eq!([0, 1, 2, 3, usize::MAX].map(interval), [0.5, 0.25, 0.04, 0.04, 0.04]);
    }
}
