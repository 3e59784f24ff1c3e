//! The compositor's input and output.

use super::Settings;
use crate::camera::{Camera, Capture, Geometry, LensError};
use crate::depth::{DepthGrid, Surfaces};
use crate::effects::EffectError;
use crate::frame::Frame;
use crate::gpu::GpuError;
use crate::pixels::{LayerImage, Pixels};
use crate::tracking::PoseTrack;

/// A picture to be made, and all that it depends on except camera and settings.
#[derive(Debug)]
pub struct Job<'a> {
    /// Its pixels are the real part, in the picture's size.
    pub frame: Frame,
    /// Geometry of the picture that is made.
    pub picture: &'a Geometry,
    pub capture: Capture<'a>,
    pub real: RealDepth<'a>,
    pub track: &'a PoseTrack,
    /// Added to the frame's timestamp to look up poses, seconds.
    pub time_offset_s: f64,
    /// Seconds to the next frame.
    pub interval_s: f64,
    /// Whether to return the virtual layer too.
    pub want_layer: bool,
}

/// Depth of the real scene.
#[derive(Clone, Copy, Debug)]
pub enum RealDepth<'a> {
    /// From the frame's own depth map, if it has one.
    OfFrame,
    /// Known at the frame's moment over the picture that is made; it hides virtual things. With the surfaces made from
    /// it, effects act on the real part too. A picture that sums frames has `moments`: what hides in each of them,
    /// with its time in seconds from the picture's.
    Known { grid: Option<&'a DepthGrid>, surfaces: Option<&'a Surfaces>, moments: &'a [(f64, DepthGrid)] },
}

/// Where the picture goes.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// Back to the processor: [`Composited::pixels`].
    Pixels,
    /// Into a view of the picture's size, ready to be shown: the whole picture, including the camera's pixels. The view
    /// receives encoded code values. If its format is sRGB, which encodes by itself, it receives the light that gives
    /// them.
    View(&'a wgpu::TextureView, wgpu::TextureFormat),
}

/// A frame's exposure, seconds. In order of precedence: what a tracked camera said of the frame (if the camera follows that),
/// the camera's shutter angle, the recording's time for the frame (unless the settings overrule either), the camera's time,
/// what the frame's motion blur says, and [`assumed_exposure_s`].
pub fn exposure_time_s(camera: &Camera, settings: &Settings, frame: &Frame, interval_s: f64) -> f64 {
    let exposure = &camera.exposure;
    let angle = |deg: f64| deg / 360.0 * interval_s;
    let recorded = frame.exposure.time_s.filter(|_| !settings.overrule_recorded_exposure);
    let follows = camera.follows.exposure && !settings.overrule_recorded_exposure;
    let tracked = frame.exposure.lens.exposure_s.filter(|_| follows);
    let known = tracked.or(exposure.shutter_angle_deg.map(angle)).or(recorded).or(exposure.time_s);
    known.or(frame.exposure.blurred_s).unwrap_or_else(|| assumed_exposure_s(interval_s))
}

/// Longest exposure that is assumed where nothing states one, s. Phones and depth cameras expose for 1/60 s or less in
/// lit rooms, at 10 frames a second as at 30, so that half of a long interval is too much blur.
const LONGEST_ASSUMED_S: f64 = 1.0 / 60.0;

/// Exposure of frames of which nothing is known: a shutter of 180°, at most 1/60 s.
fn assumed_exposure_s(interval_s: f64) -> f64 {
    (0.5 * interval_s).min(LONGEST_ASSUMED_S)
}

impl<'a> Job<'a> {
    /// A frame of a recording, to which virtual things are added and nothing else is changed.
    pub fn of_frame(
        frame: Frame,
        camera: &Camera,
        settings: &Settings,
        geometry: &'a Geometry,
        track: &'a PoseTrack,
        interval_s: f64,
    ) -> Result<Self, LensError> {
        let exposure_s = exposure_time_s(camera, settings, &frame, interval_s);
        let capture = Capture::frame(geometry, exposure_s, camera.lens_in(&frame.exposure.lens).opening(geometry)?);
        let real = RealDepth::OfFrame;
        Ok(Self { frame, picture: geometry, capture, real, track, time_offset_s: 0.0, interval_s, want_layer: false })
    }
}

/// A composited frame.
#[derive(Debug)]
pub struct Composited {
    pub frame: usize,
    /// The composite. If the picture went into a view, the camera's pixels.
    pub pixels: Pixels,
    /// The layer over the whole picture, if it was asked for.
    pub layer: Option<LayerImage>,
    pub stats: FrameStats,
}

/// A frame's report: what was found and done.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FrameStats {
    pub frame: usize,
    pub timestamp_s: f64,
    /// Why nothing was drawn: there is no pose at this time.
    pub no_pose: Option<String>,
    /// Why the frame's depth hid nothing although it exists and was asked for.
    pub no_occlusion: Option<String>,
    /// The rectangle of work in the picture: x0, y0, x1, y1.
    pub rect_px: Option<[i32; 4]>,
    /// Whether objects may be in the part of the picture that was made. A photograph is made even without any.
    pub objects_in_sight: bool,
    pub exposure_time_s: f64,
    /// The frame's, where it is not 1: the share of the layer that is seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub presence: Option<f64>,
    /// An upper bound on how fast any point of the objects moves.
    pub fastest_px_per_s: f32,
    pub effects: Vec<&'static str>,
}

impl FrameStats {
    pub(super) fn of(job: &Job<'_>) -> Self {
        Self {
            frame: job.frame.index,
            timestamp_s: job.frame.timestamp_s,
            no_pose: None,
            no_occlusion: None,
            rect_px: None,
            objects_in_sight: false,
            exposure_time_s: job.capture.exposure_time_s,
            presence: Some(job.frame.presence).filter(|presence| *presence != 1.0),
            fastest_px_per_s: 0.0,
            effects: Vec::new(),
        }
    }
}

/// Why a frame could not be submitted.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(
        "the objects, as far as they are blurred, take {width_px}x{height_px} px; this adapter draws up to {side_px} px \
         a side and {area_px} in all: accepted are a shorter exposure, less blur{}, or smaller frames",
        widest.map_or_else(String::new, |effect| format!(" ({effect} reaches farthest)"))
    )]
    TooLarge { width_px: u32, height_px: u32, side_px: u32, area_px: u32, widest: Option<&'static str> },
    #[error("the view is {}x{} px, and the picture {}x{}: they must be alike", view_px.0, view_px.1, picture_px.0, picture_px.1)]
    TargetSize { view_px: (u32, u32), picture_px: (u32, u32) },
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
