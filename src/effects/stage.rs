//! What an effect is: what it may know, what it says of itself, what it gives.

use crate::camera::{Camera, Capture, Curve, Geometry, Response};
use crate::frame::FrameExposure;
use crate::gpu::{Packed, Recorder, Shader, Texture, Uniform};
use crate::params::{Params, Value};
use crate::pixels::Rect;
use crate::render::{Layer, SamplePlan};

/// How an object's centre moves across the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMotion {
    /// From the frame to the next one, px (raster axes).
    pub per_frame_px: [f32; 2],
}

/// What effects may know of a picture before anything is drawn. A pure function of the frames and poses around it.
#[derive(Clone, Debug)]
pub struct Moment<'a> {
    /// As it was calibrated.
    pub camera: &'a Camera,
    /// Of the picture that is made; [`Capture::recorded`] is that of the recorded one, which was calibrated.
    pub picture: &'a Geometry,
    pub capture: &'a Capture<'a>,
    /// Position in the recording.
    pub frame: usize,
    pub seed: u64,
    /// What the recording says of the frame's exposure.
    pub recorded: FrameExposure,
    /// To the next frame, seconds.
    pub interval_s: f64,
    /// No point of the objects moves faster than this, px/s.
    pub fastest_px_per_s: f32,
    /// Between which depths all points of the objects lie, metres.
    pub depths_m: [f64; 2],
    /// Where the real part's surfaces are known: between which depths they lie, metres.
    pub real_depths_m: Option<[f64; 2]>,
    /// One for each object of the scene.
    pub objects: &'a [ObjectMotion],
}

impl Moment<'_> {
    /// A length in the recorded camera's pixels, in those of the picture that is made.
    pub fn drawn_px(&self, recorded_px: f64) -> f64 {
        recorded_px * self.capture.enlargement
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

/// A parameter that a camera does not allow: its name, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} is refused: {reason}")]
pub struct EffectError {
    pub parameter: &'static str,
    pub reason: &'static str,
}

/// How far an effect works beyond a pixel, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// How far from a pixel it looks.
    pub look_px: f32,
    /// How far beyond the rectangle of the objects (as they move during the exposure) it draws.
    pub spread_px: f32,
}

impl Reach {
    /// Draws as far as it looks.
    pub fn both(px: f32) -> Self {
        Self { look_px: px, spread_px: px }
    }
}

/// What an effect has to do with real things. Virtual things are cut off where real ones hide them: before an effect
/// works, unless it says more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnReal {
    /// Works on virtual things alone.
    #[default]
    Nothing,
    /// Where the real part's surfaces are known, it works on them too.
    ActsAlone,
    /// The same; and it blurs virtual things where real ones before them are sharp, which then cut off what it has made.
    Acts,
    /// The same; and where it works on both, it hides virtual things behind real ones itself.
    ActsAndHides,
}

impl OnReal {
    pub fn acts(self) -> bool {
        self != Self::Nothing
    }
    pub fn blurs_behind(self) -> bool {
        matches!(self, Self::Acts | Self::ActsAndHides)
    }
}

/// A label, and the parameters that differ from the defaults.
pub type Case = (&'static str, Vec<(&'static str, Value)>);

/// What an effect of the layer records its passes with.
#[derive(Debug)]
pub struct LayerRun<'a> {
    pub recorder: &'a mut Recorder,
    pub moment: &'a Moment<'a>,
    /// What of the picture the layer covers; may reach beyond it.
    pub drawn: Rect,
    /// What of the picture virtual things can touch, with what effects spread.
    pub objects_px: Rect,
    /// Whether anything still reads the geometry of the layer that is made.
    pub geometry_is_read: bool,
}

/// An effect's part of the composite: `apply_<name>` of a shader, and what it reads. Its globals stand in a group of
/// their own, and their names begin with the effect's.
#[derive(Debug)]
pub struct MixedPart {
    pub shader: Shader,
    /// The effect's, which its uniform bears too.
    pub name: &'static str,
    pub uniform: Packed,
    pub textures: Vec<(&'static str, Texture)>,
}

/// The value of the `override` curve, for shaders that import shared/response.
pub fn curve_choice(response: &Response) -> f64 {
    match response.curve {
        Curve::Srgb => 0.0,
        Curve::Linear => 1.0,
        Curve::Gamma => 2.0,
    }
}

/// An effect: a table of parameters, whose name is the effect's, with what they do. It keeps nothing between two calls.
///
/// One that works on the virtual layer, in linear light, records passes in `run`; it may have the renderer draw more,
/// by `plan`. One that works on the mixed picture's code values gives its part of the composite in `mix`.
pub trait Effect: Params + Boxed + std::fmt::Debug + Send + Sync {
    /// One line: what it does.
    fn summary(&self) -> &'static str;
    /// Whether it would change no pixel; then it does not run.
    fn is_neutral(&self, moment: &Moment<'_>) -> bool;
    /// Whether the camera, with the geometry of the frame's, has what the parameters need. Asked of each effect that is
    /// switched on, before anything is written, also where it may turn out neutral.
    fn check(&self, _: &Camera, _: &Geometry) -> Result<(), EffectError> {
        Ok(())
    }
    /// A setting that does nothing with this camera, and why: worth a word.
    fn idle(&self, _: &Camera) -> Option<&'static str> {
        None
    }
    /// The ways in which it works: what the benchmark measures and what the laws are tested with. At least one.
    fn cases(&self) -> Vec<Case> {
        vec![("", Vec::new())]
    }
    /// How far it looks and draws.
    fn reach(&self, _: &Moment<'_>) -> Reach {
        Reach::default()
    }
    /// How far before and behind the exposure lie moments of its plan, seconds. Asked before it is known what is in
    /// view, which hangs on it.
    fn beyond_s(&self, _exposure_time_s: f64) -> f64 {
        0.0
    }
    fn on_real(&self) -> OnReal {
        OnReal::Nothing
    }
    /// Whether it reads the layer's geometry.
    fn reads_geometry(&self) -> bool {
        false
    }
    /// What the renderer is to draw, after what the effects before this one have made of the single plain drawing.
    fn plan(&self, _: &Moment<'_>, plan: SamplePlan) -> SamplePlan {
        plan
    }
    /// Records its passes over the layer; what it gives is the next one's.
    fn run(&self, _: &mut LayerRun<'_>, layer: Layer) -> Layer {
        layer
    }
    /// Its part of the composite, for the rectangle `shown` of the picture: called for every pixel where the whole
    /// picture is made, else for those that the layer touches.
    fn mix(&self, _: &mut LayerRun<'_>, _shown: Rect) -> Option<MixedPart> {
        None
    }
}

/// A copy of an effect whose type is forgotten; every effect that can be cloned has it.
pub trait Boxed {
    fn boxed(&self) -> Box<dyn Effect>;
}

impl<E: Effect + Clone + 'static> Boxed for E {
    fn boxed(&self) -> Box<dyn Effect> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Effect> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

impl PartialEq for dyn Effect {
    /// The same effect with the same parameters.
    fn eq(&self, other: &Self) -> bool {
        let specs = self.specs();
        self.table() == other.table() && specs.iter().all(|spec| self.get(spec.name) == other.get(spec.name))
    }
}

impl MixedPart {
    pub fn new<U: Uniform>(shader: Shader, name: &'static str, uniform: &U) -> Self {
        Self { shader, name, uniform: Packed::new(uniform), textures: Vec::new() }
    }

    pub fn texture(mut self, name: &'static str, texture: Texture) -> Self {
        self.textures.push((name, texture));
        self
    }
}
