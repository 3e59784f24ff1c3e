//! What an effect is: what it may know, what it declares, what it returns.

use crate::camera::{Camera, Capture, Curve, Geometry, Response};
use crate::frame::FrameExposure;
use crate::gpu::{Packed, Recorder, Shader, Texture, Uniform};
use crate::params::{Params, Value};
use crate::pixels::Rect;
use crate::render::{Layer, SamplePlan};

/// How an object's centre moves across the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMotion {
    /// From this frame to the next, px (raster axes).
    pub per_frame_px: [f32; 2],
}

/// Everything that effects may know of a picture before it is drawn. A pure function of the frames and poses around it.
#[derive(Clone, Debug)]
pub struct Moment<'a> {
    /// The calibrated camera.
    pub camera: &'a Camera,
    /// Geometry of the picture that is made; [`Capture::recorded`] is the recorded picture's, which was calibrated.
    pub picture: &'a Geometry,
    pub capture: &'a Capture<'a>,
    /// Position in the recording.
    pub frame: usize,
    pub seed: u64,
    /// The frame's exposure according to the recording.
    pub recorded: FrameExposure,
    /// To the next frame, seconds.
    pub interval_s: f64,
    /// An upper bound on the speed of any point of the objects, px/s.
    pub fastest_px_per_s: f32,
    /// The range of depths of all points of the objects, metres.
    pub depths_m: [f64; 2],
    /// The range of depths of the real part's surfaces, if they are known, metres.
    pub real_depths_m: Option<[f64; 2]>,
    /// One for each object of the scene.
    pub objects: &'a [ObjectMotion],
}

impl Moment<'_> {
    /// Converts a length in the recorded camera's pixels to pixels of the picture that is made.
    pub fn drawn_px(&self, recorded_px: f64) -> f64 {
        recorded_px * self.capture.enlargement
    }

    /// The frame's film speed over the speed at which the noise was measured (the camera profile's): by the ISO in the
    /// frame's file, else by the gain that the recording lists. 1 if either is unknown.
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
    /// How far beyond the rectangle of the objects (over their motion during the exposure) it draws.
    pub spread_px: f32,
}

impl Reach {
    /// It draws as far as it looks.
    pub fn both(px: f32) -> Self {
        Self { look_px: px, spread_px: px }
    }
}

/// How an effect relates to real things. Virtual objects are cut off where real ones hide them; by default before an
/// effect runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnReal {
    /// Acts on virtual things only.
    #[default]
    Nothing,
    /// Acts on virtual things only. It blurs them as the camera blurred what stands before them, which cuts off its result
    /// where it is known how much of each pixel that has.
    Blurs,
    /// Also acts on the real part where its surfaces are known.
    ActsAlone,
    /// The same. It also blurs virtual objects where real ones in front of them are sharp; those then cut off its
    /// result.
    Acts,
    /// The same. Where it acts on both, it hides virtual objects behind real ones itself.
    ActsAndHides,
}

impl OnReal {
    pub fn acts(self) -> bool {
        !matches!(self, Self::Nothing | Self::Blurs)
    }
    /// Whether things are cut off after it, where it is known how much of each pixel the real ones have.
    pub fn blurs(self) -> bool {
        matches!(self, Self::Blurs | Self::Acts | Self::ActsAndHides)
    }
}

/// A label, and the parameters that differ from the defaults.
pub type Case = (&'static str, Vec<(&'static str, Value)>);

/// The context in which an effect of the layer records its passes.
#[derive(Debug)]
pub struct LayerRun<'a> {
    pub recorder: &'a mut Recorder,
    pub moment: &'a Moment<'a>,
    /// The part of the picture that the layer covers; may extend beyond the picture.
    pub drawn: Rect,
    /// The part of the picture that virtual objects can touch, including what effects spread.
    pub objects_px: Rect,
    /// Whether anything still reads the geometry of the resulting layer.
    pub geometry_is_read: bool,
}

/// An effect's part of the composite: `apply_<name>` of a shader, and its inputs. Its globals are in a group of their
/// own, and their names begin with the effect's.
#[derive(Debug)]
pub struct MixedPart {
    pub shader: Shader,
    /// The effect's name, which is also its uniform's.
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

/// An effect: a table of parameters, which bears its name, and what they do. It keeps nothing between two calls.
///
/// An effect on the virtual layer, in linear light, records passes in `run`; by `plan` it may have the renderer draw
/// more. An effect on the mixed picture's code values gives its part of the composite in `mix`.
pub trait Effect: Params + Boxed + std::fmt::Debug + Send + Sync {
    /// What it does, in one line.
    fn summary(&self) -> &'static str;
    /// Whether it would change no pixel. If so, it does not run.
    fn is_neutral(&self, moment: &Moment<'_>) -> bool;
    /// What is so where it is neutral, and what would set it to work: for a person, without a full stop.
    fn idles(&self) -> &'static str;
    /// Whether the camera, with the frame's geometry, has what the parameters need. Called for every effect that is
    /// switched on, before anything is written, even if it may turn out neutral.
    fn check(&self, _: &Camera, _: &Geometry) -> Result<(), EffectError> {
        Ok(())
    }
    /// A setting that does nothing with this camera, and why: worth a warning.
    fn idle(&self, _: &Camera) -> Option<&'static str> {
        None
    }
    /// The ways in which it works: the benchmark measures them and the laws are tested with them. At least one.
    fn cases(&self) -> Vec<Case> {
        vec![("", Vec::new())]
    }
    /// How far it looks and draws.
    fn reach(&self, _: &Moment<'_>) -> Reach {
        Reach::default()
    }
    /// How far before and after the exposure the moments of its plan lie, seconds. Called before it is known what is in
    /// view, which depends on this.
    fn beyond_s(&self, _exposure_time_s: f64) -> f64 {
        0.0
    }
    /// Whether it reads how far objects move until the next frame ([`ObjectMotion`]).
    fn reads_next_pose(&self) -> bool {
        false
    }
    fn on_real(&self) -> OnReal {
        OnReal::Nothing
    }
    /// Whether it reads the layer's geometry.
    fn reads_geometry(&self) -> bool {
        false
    }
    /// What the renderer is to draw, given the plan that the effects before this one have made of a single plain
    /// drawing.
    fn plan(&self, _: &Moment<'_>, plan: SamplePlan) -> SamplePlan {
        plan
    }
    /// Records its passes over the layer and returns the layer for the next effect.
    fn run(&self, _: &mut LayerRun<'_>, layer: Layer) -> Layer {
        layer
    }
    /// Its part of the composite, for the rectangle `shown` of the picture: called for every pixel if the whole picture
    /// is made, else for those that the layer touches.
    fn mix(&self, _: &mut LayerRun<'_>, _shown: Rect) -> Option<MixedPart> {
        None
    }
}

/// A type-erased copy of an effect. Every effect that implements `Clone` has it.
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
