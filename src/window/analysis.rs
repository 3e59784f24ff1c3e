//! What plots show of a picture: composited once more on a thread of its own, with and without noise, so that the virtual part
//! can be told from the real one.

use std::sync::{Arc, Mutex, PoisonError};

use super::background::Ticket;
use super::calibration_messages;
use locard_engine::calibrate::sharpness;
use locard_engine::calibrate::{NoiseOptions, NoisePoint, moving, rendered_noise};
use locard_engine::camera::Response;
use locard_engine::compositor::{Composited, Compositor, Target};
use locard_engine::frame::Frame;
use locard_engine::gpu::Gpu;
use locard_engine::measure::histogram::{around, histograms};
use locard_engine::measure::slanted::SlantedEdge;
use locard_engine::pixels::{Pixels, Rect};
use locard_engine::scene::Scene;
use locard_engine::shot::{Shot, ShotError};

/// The effect without which the virtual part is smooth.
const NOISE: &str = "noise";
/// From this coverage on a pixel is an object's.
const COVERED: f32 = 0.99;
/// How far the surroundings reach, px.
const AROUND: usize = 24;
pub const HISTOGRAM_BINS: usize = 48;
/// Independent samples that make a point of a single picture's noise.
const NEEDED: f64 = 300.0;

/// What is asked for; what is not costs nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wanted {
    pub noise: bool,
    pub histograms: bool,
    /// Edges of the camera's picture and of the composite.
    pub edges: [Option<Rect>; 2],
    pub edges_of: sharpness::EdgeLight,
}

/// An edge, or why it is none, and how the light goes there instead.
#[derive(Clone, Debug)]
pub struct Refused {
    pub why: String,
    pub seen: Vec<[f64; 2]>,
}

/// Measures an edge of a picture.
pub fn edge(
    pixels: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    of: sharpness::EdgeLight,
) -> Result<SlantedEdge, Refused> {
    let edge = sharpness::edge_in(pixels, response, region, moved_px, of);
    edge.map_err(|error| Refused {
        why: error.to_string(),
        seen: sharpness::edge_profile(pixels, response, region, of),
    })
}

impl Wanted {
    pub fn anything(&self) -> bool {
        self.noise || self.histograms || self.edges != [None; 2]
    }
}

/// What was found. Each part says itself why it is missing.
#[derive(Debug, Default)]
pub struct Analysis {
    pub drawn: Option<Result<[Vec<NoisePoint>; 3], String>>,
    /// In the plain places of the camera's picture.
    pub real: Option<Result<[Vec<NoisePoint>; 3], String>>,
    /// Of the object and of what is around it, by luma and by the channels.
    pub histograms: Option<Result<[[Vec<f64>; 4]; 2], String>>,
    pub edges: [Option<Result<SlantedEdge, Refused>>; 2],
}

/// The compositor that is kept between two analyses, with its scene.
#[derive(Clone, Debug, Default)]
pub struct Bench(Arc<Mutex<Option<Drawn>>>);

/// A scene, and what draws it.
type Drawn = (Arc<Scene>, Compositor);

/// Way of an edge's surface while the shutter was open; nothing where it is not known.
pub fn moved_px(shot: &Shot, frame: &Frame, region: Rect) -> [f64; 2] {
    let at = glam::DVec2::new(f64::from(region.x0 + region.x1), f64::from(region.y0 + region.y1)) / 2.0;
    let surface = shot.surface_at(frame, at);
    surface.and_then(|surface| shot.moved_px(frame, at, &surface)).unwrap_or_default().to_array()
}

/// Looks at a frame and its composite. What comes of work that nobody waits for any more lacks parts.
pub fn analyse(bench: &Bench, gpu: &Gpu, shot: &Shot, frame: &Frame, wanted: &Wanted, ticket: &Ticket) -> Analysis {
    let mut found = Analysis::default();
    let response = shot.camera().response;
    // The camera's and the drawn edge are compared as they are seen: with the movement in both.
    let of_edge = |pixels: &Pixels, region: Rect| edge(pixels, &response, region, [0.0; 2], wanted.edges_of);
    found.edges[0] = wanted.edges[0].map(|region| of_edge(&frame.pixels, region));
    if wanted.noise && !ticket.is_cancelled() {
        let options = NoiseOptions { min_independent: NEEDED, ..NoiseOptions::default() };
        let real = moving::from_frames(std::slice::from_ref(&frame.pixels), &options);
        found.real = Some(real.map(|real| real.points()).map_err(|error| calibration_messages::noise_error(&error)));
    }
    if !(wanted.noise || wanted.histograms || wanted.edges[1].is_some()) {
        return found;
    }
    let composited = gpu.apart(|| composited(bench, gpu, shot, frame, wanted.noise, ticket));
    let composited = composited.map_err(|source| ShotError::Gpu { frame: frame.index, source }).and_then(|done| done);
    match composited {
        Ok(None) => {}
        Err(error) => {
            let error = error.to_string();
            found.drawn = wanted.noise.then(|| Err(error.clone()));
            found.histograms = wanted.histograms.then(|| Err(error.clone()));
            found.edges[1] = wanted.edges[1].map(|_| Err(Refused { why: error, seen: Vec::new() }));
        }
        Ok(Some((with, without))) => {
            let coverage: Vec<f32> = with.layer.iter().flat_map(|layer| &layer.rgba).map(|rgba| rgba[3]).collect();
            let objects: Vec<bool> = coverage.iter().map(|a| *a >= COVERED).collect();
            let touched: Vec<bool> = coverage.iter().map(|a| *a > 0.0).collect();
            found.drawn = without.map(|without| {
                let drawn = rendered_noise(&with.pixels, &without.pixels, &objects);
                drawn.map_err(|error| error.to_string())
            });
            found.histograms = wanted.histograms.then(|| {
                let surroundings = around(&objects, &touched, with.pixels.width as usize, AROUND);
                let of = |mask: &[bool]| histograms(&with.pixels, mask, HISTOGRAM_BINS);
                let both = of(&objects).and_then(|object| Ok([object, of(&surroundings)?]));
                both.map_err(|error| error.to_string())
            });
            found.edges[1] = wanted.edges[1].map(|region| of_edge(&with.pixels, region));
        }
    }
    found
}

/// The composite with its layer, and if asked for the same without noise; nothing where nobody waits for it.
fn composited(
    bench: &Bench,
    gpu: &Gpu,
    shot: &Shot,
    frame: &Frame,
    twice: bool,
    ticket: &Ticket,
) -> Result<Option<(Composited, Option<Composited>)>, ShotError> {
    if ticket.is_cancelled() {
        return Ok(None);
    }
    let mut kept = bench.0.lock().unwrap_or_else(PoisonError::into_inner);
    let (scene, compositor) = kept.get_or_insert_with(|| (Arc::clone(&shot.scene), shot.compositor(gpu.clone())));
    if !Arc::ptr_eq(scene, &shot.scene) {
        *scene = Arc::clone(&shot.scene);
        compositor.set_scene(Scene::clone(scene));
    }
    let geometry = shot.geometry_at(frame.index)?;
    let mut make = |shot: &Shot, layer: bool| -> Result<Composited, ShotError> {
        let pending = shot.submit(compositor, frame.clone(), &geometry, Target::Pixels, layer)?;
        compositor.collect(pending).map_err(|source| ShotError::Gpu { frame: frame.index, source })
    };
    let with = make(shot, true)?;
    if ticket.is_cancelled() {
        return Ok(None);
    }
    let without = twice.then(|| {
        let mut smooth = shot.clone();
        // It is one of the effects.
        let _ = smooth.settings.switch(NOISE, false);
        make(&smooth, false)
    });
    Ok(Some((with, without.transpose()?)))
}
