//! What an effect is: its stage, what it reads and what it gives.

use crate::camera::{Camera, Curve, Geometry, Opening, Response};
use crate::frame::FrameExposure;
use crate::gpu::Texture;
use crate::image::Rect;
use crate::params::{Params, Value};
use crate::render::{Layer, LayerRun, SamplePlan};

/// Where in the way of the light an effect works.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// The virtual layer, linear light (and what the renderer draws to make it).
    Layer,
    /// Code values of pixels with A > 0; in a photograph of all.
    Mixed,
}

/// How an object's centre moves across the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMotion {
    /// From the frame to the next one, px (raster axes).
    pub per_frame_px: [f32; 2],
}

/// A photograph of the whole augmented picture with a virtual camera, and how it differs from the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photograph {
    /// Stops brighter than the recording.
    pub over_ev: f64,
    /// Film speed over the recording's.
    pub iso_ratio: f64,
    pub film_width_mm: f64,
    /// Pixels of the photograph for one of the recording.
    pub enlargement: f64,
    /// What enlarging and summing leave of the variance of the real pixels' noise, 0 to 1.
    pub noise_left: f64,
}

/// One of the recording's frames that are summed for a photograph's real part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summed {
    /// The middle of its exposure, seconds from the photograph's own.
    pub time_s: f64,
    pub exposure_s: f64,
    /// Its share of the light.
    pub weight: f64,
}

/// What effects may know of the frame. A pure function of the frames and poses around it.
#[derive(Clone, Debug)]
pub struct FrameContext<'a> {
    pub camera: &'a Camera,
    /// Of the picture that is made.
    pub geometry: &'a Geometry,
    /// Position in the recording.
    pub frame: usize,
    pub seed: u64,
    /// How long each row gathers light, seconds.
    pub exposure_time_s: f64,
    /// What the recording says of the frame's exposure.
    pub recorded: FrameExposure,
    /// To the next frame, seconds.
    pub interval_s: f64,
    /// No point of the objects moves faster than this, px/s.
    pub fastest_px_per_s: f32,
    /// The lens; none for a pinhole.
    pub opening: Option<Opening>,
    /// None where virtual things are added to the recording and nothing else is changed.
    pub photograph: Option<Photograph>,
    /// Of a photograph the recording's frames that it sums; empty where it shows one.
    pub summed: &'a [Summed],
    /// Between which depths all points of the objects lie, metres.
    pub depths_m: [f64; 2],
    /// Of a photograph whose real surfaces are known: between which depths they lie, metres.
    pub real_depths_m: Option<[f64; 2]>,
    /// What of the picture objects can touch, with what effects spread. Known once passes are recorded, empty before.
    pub objects_px: Rect,
    /// What of the picture the layer covers; may reach beyond it. Known once passes are recorded, empty before.
    pub drawn: Rect,
    /// One for each object of the scene.
    pub objects: &'a [ObjectMotion],
}

/// A parameter that a camera does not allow: its name, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} is refused: {reason}")]
pub struct EffectError {
    pub parameter: &'static str,
    pub reason: &'static str,
}

/// What stands at the bindings of an effect's part of the composite's shader, in their order.
#[derive(Debug)]
pub struct MixedInputs {
    /// Empty for none.
    pub uniform: Vec<u8>,
    pub textures: Vec<Texture>,
}

impl FrameContext<'_> {
    /// Pixels of the picture that is made for one of the camera's.
    pub fn enlargement(&self) -> f64 {
        self.photograph.map_or(1.0, |photograph| photograph.enlargement)
    }

    /// Film speed at which the recording's frame was taken over that of the camera's profile, at which its noise was
    /// measured: by the ISO that the frame's file tells, else by the gain that the recording lists. 1 where one of both is
    /// not known.
    pub fn recorded_speed(&self) -> f64 {
        let FrameExposure { gain, photo, .. } = self.recorded;
        let Some(measured) = self.camera.exposure.iso else { return 1.0 };
        let speed = photo.iso.map(|iso| iso / measured).or(gain).unwrap_or(1.0);
        if speed.is_finite() && speed > 0.0 { speed } else { 1.0 }
    }
}

/// The values of the `override`s curve and gamma, for shaders that import shared/response.
pub fn response_constants(response: &Response) -> [(&'static str, f64); 2] {
    let curve = match response.curve {
        Curve::Srgb => 0.0,
        Curve::Linear => 1.0,
        Curve::Gamma => 2.0,
    };
    [("curve", curve), ("gamma", response.gamma)]
}

/// An effect with its parameters.
pub trait Effect: std::fmt::Debug + Send + Sync {
    fn stage(&self) -> Stage;
    /// One line: what it does.
    fn summary(&self) -> &'static str;
    /// The table's name is the effect's.
    fn params(&self) -> &dyn Params;
    fn params_mut(&mut self) -> &mut dyn Params;
    /// Whether the camera, with the geometry of the frame's, has what the parameters need. Asked of each effect that is
    /// switched on, before anything is written, also where it may turn out neutral.
    fn check(&self, _: &Camera, _: &Geometry) -> Result<(), EffectError> {
        Ok(())
    }
    /// A setting that does nothing with this camera, and why: worth a word.
    fn idle(&self, _: &Camera) -> Option<&'static str> {
        None
    }
    /// Whether it would change no pixel of this frame; then it does not run.
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool;
    /// How far from a pixel it looks, px.
    fn reach_px(&self, _: &FrameContext<'_>) -> f32 {
        0.0
    }
    /// How far before and behind the exposure lie moments of its plan, seconds.
    fn beyond_s(&self, _exposure_time_s: f64) -> f64 {
        0.0
    }
    /// How far beyond the rectangle of the objects (as they move during the exposure) it
    /// draws, px.
    fn spread_px(&self, context: &FrameContext<'_>) -> f32 {
        self.reach_px(context)
    }
    /// The ways in which it works, each a label and the parameters that differ from the defaults: what the benchmark
    /// measures and what the laws are tested with. At least one.
    fn cases(&self) -> Vec<(&'static str, Vec<(&'static str, Value)>)> {
        vec![("", Vec::new())]
    }
    /// What the renderer is to draw, after what the effects before this one have made of the single plain drawing.
    fn plan(&self, _: &FrameContext<'_>, plan: SamplePlan) -> SamplePlan {
        plan
    }
    /// Whether it works on a photograph's real part too, where its surfaces are known.
    fn acts_on_real(&self) -> bool {
        false
    }
    /// Whether it then hides objects behind real surfaces itself, and nothing is to be cut off them before.
    fn hides_behind_real(&self) -> bool {
        false
    }
    /// Whether it blurs objects where real things before them are sharp, which then cut off what it has made.
    fn blurs_behind_real(&self) -> bool {
        false
    }
    /// Whether it reads the layer's geometry.
    fn reads_geometry(&self) -> bool {
        false
    }
    /// Records the effect's passes; the layer that it gives is the next one's.
    fn run(&mut self, _: &mut LayerRun<'_>, _: &FrameContext<'_>, layer: Layer) -> Layer {
        layer
    }
    /// The effect's part of the composite's shader: WGSL that defines
    /// `fn apply_<name>(p: vec2<i32>, pixel: Mixed) -> Mixed`. Its bindings are numbered from 4,
    /// first a uniform where there is one, then textures. In a photograph the function is called for every pixel, else for
    /// those with A > 0. At most one effect of the layer stage may have one too, instead of the plain composite: it
    /// comes before those of the mixed stage and makes the pixel anew, whatever it is given. `other_film`: a photograph, or
    /// a frame at another film speed than the profile's.
    fn mixed_wgsl(&self, _other_film: bool) -> Option<&'static str> {
        None
    }
    /// Records what that part reads, for the rectangle `shown` of the picture.
    fn mixed_inputs(&mut self, _: &mut LayerRun<'_>, _: &FrameContext<'_>, _shown: Rect) -> MixedInputs {
        MixedInputs { uniform: Vec::new(), textures: Vec::new() }
    }
}
