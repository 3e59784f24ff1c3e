//! The compositor's input and output.

use super::{ExposureTime, Settings};
use crate::camera::{Camera, Capture, Geometry, LensError};
use crate::depth::{DepthGrid, Surfaces};
use crate::effects::EffectError;
use crate::frame::Frame;
use crate::gpu::GpuError;
use crate::pixels::{LayerImage, Pixels};
use crate::tracking::PoseTrack;

/// A picture to make: its inputs except camera and settings.
#[derive(Debug)]
pub struct Job<'a> {
    /// Its pixels are the real part, at the picture's size.
    pub frame: Frame,
    /// Geometry of the output picture.
    pub picture: &'a Geometry,
    pub capture: Capture,
    pub real: RealDepth<'a>,
    pub track: &'a PoseTrack,
    /// Seconds to the next frame.
    pub interval_s: f64,
    /// Whether to return the virtual layer too.
    pub want_layer: bool,
}

/// Depth of the real scene.
#[derive(Clone, Copy, Debug)]
pub enum RealDepth<'a> {
    /// Depth of the frame's own depth map, if it has one.
    OfFrame,
    /// Depth at the frame's time, registered to the output picture; it occludes virtual objects.
    /// With `surfaces`, effects act on the real part too. For a picture that sums frames, `moments`
    /// holds the depth of each of them, with its time relative to the picture's, s.
    Known { grid: Option<&'a DepthGrid>, surfaces: Option<&'a Surfaces>, moments: &'a [(f64, DepthGrid)] },
}

/// Destination of the picture.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// Read back to the CPU: [`Composited::pixels`].
    Pixels,
    /// Drawn into a view of the picture's size, for display: the whole picture, including the
    /// camera's pixels. The view receives encoded code values, or linear light if its format is
    /// sRGB and encodes by itself.
    View(&'a wgpu::TextureView, wgpu::TextureFormat),
}

impl Target<'_> {
    /// Checks that a view has the size of the picture.
    pub(super) fn check_size(&self, frame: &Frame) -> Result<(), SubmitError> {
        let Self::View(view, _) = self else { return Ok(()) };
        let size = view.texture().size();
        let (view_px, picture_px) = ((size.width, size.height), (frame.pixels.width, frame.pixels.height));
        if view_px == picture_px { Ok(()) } else { Err(SubmitError::TargetSize { view_px, picture_px }) }
    }
}

impl<'a> Job<'a> {
    /// A recorded frame to which virtual objects are added, at its own geometry and exposure.
    pub fn of_frame(
        frame: Frame,
        camera: &Camera,
        settings: &Settings,
        geometry: &'a Geometry,
        track: &'a PoseTrack,
        interval_s: f64,
    ) -> Result<Self, LensError> {
        let exposure = ExposureTime::of_frame(camera, settings, &frame.exposure, interval_s);
        let capture = Capture::frame(geometry, exposure.s, camera.lens_in(&frame.exposure.lens).opening(geometry)?);
        let real = RealDepth::OfFrame;
        Ok(Self { frame, picture: geometry, capture, real, track, interval_s, want_layer: false })
    }
}

/// A composited frame.
#[derive(Debug)]
pub struct Composited {
    pub frame: usize,
    /// The composite; with [`Target::View`], the camera's pixels.
    pub pixels: Pixels,
    /// The layer over the whole picture, if [`Job::want_layer`] is set.
    pub layer: Option<LayerImage>,
    pub stats: FrameStats,
}

/// Statistics of a frame.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FrameStats {
    pub frame: usize,
    pub timestamp_s: f64,
    /// Why the frame has no pose, and nothing was drawn.
    pub no_pose: Option<String>,
    /// Why the frame's depth occluded nothing, although it exists and occlusion is on.
    pub no_occlusion: Option<String>,
    /// Why the camera's noise by example was not drawn, but the pattern.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_example_noise: Option<String>,
    /// The difference of the frame from the pictures of its noise by example, if they seem to be of
    /// another camera or setting.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub example_mismatch: Option<String>,
    /// Bounds of the composited pixels: x0, y0, x1, y1.
    pub rect_px: Option<[i32; 4]>,
    /// Whether objects may be in the composited region. A photograph is composited even without
    /// any.
    pub objects_in_sight: bool,
    pub exposure_time_s: f64,
    /// Opacity of the layer, if it is not 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opacity: Option<f64>,
    /// Upper bound of the speed of any point of the objects.
    pub fastest_px_per_s: f32,
    pub effects: Vec<&'static str>,
}

impl FrameStats {
    pub(super) fn of(job: &Job<'_>) -> Self {
        let no_pose = job.track.at(job.frame.timestamp_s).err();
        Self {
            frame: job.frame.index,
            timestamp_s: job.frame.timestamp_s,
            no_pose: no_pose.map(|reason| reason.to_string()),
            no_occlusion: None,
            no_example_noise: None,
            example_mismatch: None,
            rect_px: None,
            objects_in_sight: false,
            exposure_time_s: job.capture.exposure_time_s,
            opacity: Some(job.frame.opacity).filter(|opacity| *opacity != 1.0),
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
         a side and {area_px} in all: expected a shorter exposure, less blur{}, or smaller frames",
        widest.map_or_else(String::new, |effect| format!(" ({effect} reaches farthest)"))
    )]
    TooLarge { width_px: u32, height_px: u32, side_px: u32, area_px: u32, widest: Option<&'static str> },
    #[error("the view is {}x{} px, but the picture is {}x{}: both must have one size", view_px.0, view_px.1, picture_px.0, picture_px.1)]
    TargetSize { view_px: (u32, u32), picture_px: (u32, u32) },
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
