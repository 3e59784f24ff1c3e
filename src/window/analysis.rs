//! Analysis of a frame for the plots: it is composited again on a background thread, with and
//! without noise, to separate virtual from real noise.

use std::sync::{Arc, Mutex, PoisonError};

use super::calibration_messages;
use super::scene_compositor::SceneCompositor;
use super::task::TaskControl;
use locard_engine::calibrate::sharpness;
use locard_engine::calibrate::{NoiseOptions, NoisePoint, rendered_noise, textureless};
use locard_engine::camera::Response;
use locard_engine::compositor::{Composited, Target};
use locard_engine::frame::Frame;
use locard_engine::gpu::Gpu;
use locard_engine::measure::histogram::{dilated_ring, histograms};
use locard_engine::measure::slanted::SlantedEdge;
use locard_engine::pixels::{Pixels, Rect};
use locard_engine::shot::{Shot, ShotError};

/// Table of the noise effect, which is switched off for the reference.
const NOISE_TABLE: &str = "noise";
const FORMAT_TABLE: &str = "format";
/// Smallest coverage of an object's pixel.
const MIN_OBJECT_COVERAGE: f32 = 0.99;
/// Width of the surroundings, px.
const SURROUNDINGS_PX: usize = 24;
pub const HISTOGRAM_BINS: usize = 48;
/// Smallest number of independent samples per noise point of a single picture.
const MIN_INDEPENDENT_SAMPLES: f64 = 300.0;

/// Requested parts of an analysis; others are not computed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnalysisRequest {
    pub noise: bool,
    pub histograms: bool,
    /// Edges of the camera's picture and of the composite.
    pub edges: [Option<Rect>; 2],
    pub edges_of: sharpness::EdgeLight,
}

/// A rejected edge, with the reason and the edge profile there.
#[derive(Clone, Debug)]
pub struct RejectedEdge {
    pub why: String,
    pub profile: Vec<[f64; 2]>,
}

/// Measures an edge of a picture.
pub fn edge(
    pixels: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    of: sharpness::EdgeLight,
) -> Result<SlantedEdge, RejectedEdge> {
    let edge = sharpness::edge_in(pixels, response, region, moved_px, of);
    edge.map_err(|error| RejectedEdge {
        why: error.to_string(),
        profile: sharpness::edge_profile(pixels, response, region, of),
    })
}

impl AnalysisRequest {
    pub fn anything(&self) -> bool {
        self.noise || self.histograms || self.edges != [None; 2]
    }
}

/// Result of an analysis. Each failed part has its reason.
#[derive(Debug, Default)]
pub struct FrameAnalysis {
    pub drawn: Option<Result<[Vec<NoisePoint>; 3], String>>,
    /// Noise of uniform areas of the camera's picture.
    pub real: Option<Result<[Vec<NoisePoint>; 3], String>>,
    /// Histograms of the objects and of their surroundings, of luma and the channels.
    pub histograms: Option<Result<[[Vec<f64>; 4]; 2], String>>,
    pub edges: [Option<Result<SlantedEdge, RejectedEdge>>; 2],
}

/// The compositor of all analyses, which the first one makes. One analysis at a time uses it.
/// No memo: analyses take it by turns and upload another scene to it.
#[derive(Clone, Debug, Default)]
pub struct SharedCompositor(Arc<Mutex<Option<SceneCompositor>>>);

/// Motion of an edge's surface during the exposure, px; zero if unknown.
pub fn moved_px(shot: &Shot, frame: &Frame, region: Rect) -> [f64; 2] {
    let at = glam::DVec2::new(f64::from(region.x0 + region.x1), f64::from(region.y0 + region.y1)) / 2.0;
    let surface = shot.surface_at(frame, at);
    surface.and_then(|surface| shot.motion_px(frame, at, &surface)).unwrap_or_default().to_array()
}

/// Analyses a frame and its composite. The result of cancelled work is incomplete.
pub fn analyse(
    compositor: &SharedCompositor,
    gpu: &Gpu,
    shot: &Shot,
    frame: &Frame,
    request: &AnalysisRequest,
    control: &TaskControl,
) -> FrameAnalysis {
    let mut analysis = FrameAnalysis::default();
    let response = shot.camera().response;
    // Real and virtual edges are compared including motion blur.
    let of_edge = |pixels: &Pixels, region: Rect| edge(pixels, &response, region, [0.0; 2], request.edges_of);
    analysis.edges[0] = request.edges[0].map(|region| of_edge(&frame.pixels, region));
    if request.noise && !control.is_cancelled() {
        let options = NoiseOptions { min_independent: MIN_INDEPENDENT_SAMPLES, ..NoiseOptions::default() };
        let real = textureless::from_frames(std::slice::from_ref(&frame.pixels), &options);
        analysis.real = Some(real.map(|real| real.points()).map_err(|error| calibration_messages::noise_error(&error)));
    }
    if !(request.noise || request.histograms || request.edges[1].is_some()) {
        return analysis;
    }
    let composited = gpu.in_error_scope(|| composited(compositor, gpu, shot, frame, request.noise, control));
    let composited = composited.map_err(|source| ShotError::Gpu { frame: frame.index, source }).and_then(|done| done);
    match composited {
        Ok(None) => {}
        Err(error) => {
            let error = error.to_string();
            analysis.drawn = request.noise.then(|| Err(error.clone()));
            analysis.histograms = request.histograms.then(|| Err(error.clone()));
            analysis.edges[1] = request.edges[1].map(|_| Err(RejectedEdge { why: error, profile: Vec::new() }));
        }
        Ok(Some(CompositedFrame { whole: with, noise_pair })) => {
            let coverage: Vec<f32> = with.layer.iter().flat_map(|layer| &layer.rgba).map(|rgba| rgba[3]).collect();
            let objects: Vec<bool> = coverage.iter().map(|a| *a >= MIN_OBJECT_COVERAGE).collect();
            let touched: Vec<bool> = coverage.iter().map(|a| *a > 0.0).collect();
            analysis.drawn = noise_pair.map(|[noisy, smooth]| {
                let drawn = rendered_noise(&noisy.pixels, &smooth.pixels, &objects);
                drawn.map_err(|error| error.to_string())
            });
            analysis.histograms = request.histograms.then(|| {
                let surroundings = dilated_ring(&objects, &touched, with.pixels.width as usize, SURROUNDINGS_PX);
                let masked_histograms = |mask: &[bool]| histograms(&with.pixels, mask, HISTOGRAM_BINS);
                let both =
                    masked_histograms(&objects).and_then(|object| Ok([object, masked_histograms(&surroundings)?]));
                both.map_err(|error| error.to_string())
            });
            analysis.edges[1] = request.edges[1].map(|region| of_edge(&with.pixels, region));
        }
    }
    analysis
}

/// A composited frame, and without its format the same with and without noise.
struct CompositedFrame {
    whole: Composited,
    noise_pair: Option<[Composited; 2]>,
}

/// The composite with its layer, and if requested the pair without format; `None` if
/// cancelled.
fn composited(
    compositor: &SharedCompositor,
    gpu: &Gpu,
    shot: &Shot,
    frame: &Frame,
    noise_pair: bool,
    control: &TaskControl,
) -> Result<Option<CompositedFrame>, ShotError> {
    if control.is_cancelled() {
        return Ok(None);
    }
    let mut shared = compositor.0.lock().unwrap_or_else(PoisonError::into_inner);
    let compositor = shared.get_or_insert_with(|| SceneCompositor::new(gpu.clone(), shot)).with_scene_of(shot);
    let geometry = shot.geometry_at(frame.index)?;
    let mut make = |shot: &Shot, layer: bool| -> Result<Composited, ShotError> {
        let pending = shot.submit(compositor, frame.clone(), &geometry, Target::Pixels, layer)?;
        compositor.collect(pending).map_err(|source| ShotError::Gpu { frame: frame.index, source })
    };
    let with = make(shot, true)?;
    if control.is_cancelled() {
        return Ok(None);
    }
    // The difference of two coded pictures also contains that of their quantisation. Noise by
    // example is drawn only through the coding.
    let mut noisy = shot.clone();
    if !shot.has_noise_by_example() {
        let _ = noisy.settings.switch(FORMAT_TABLE, false);
    }
    let mut smooth = noisy.clone();
    let _ = smooth.settings.switch(NOISE_TABLE, false);
    let pair = noise_pair.then(|| Ok::<_, ShotError>([make(&noisy, false)?, make(&smooth, false)?]));
    Ok(Some(CompositedFrame { whole: with, noise_pair: pair.transpose()? }))
}
