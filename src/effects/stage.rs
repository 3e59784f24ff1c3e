//! The interface of effects: their inputs, declarations and results.

use crate::camera::{Camera, Capture, Curve, Geometry, Response};
use crate::coding::PictureCoding;
use crate::example_noise::NoiseModel;
use crate::example_noise::model_coding::CodingDifference;
use crate::example_noise::persistence::FrameKeys;
use crate::frame::FrameExposure;
use crate::gpu::{Bytes, PassRecorder, Shader, Texture, Uniform, UniformBytes};
use crate::memo::ByAddress;
use crate::params::{Params, Value};
use crate::pixels::Rect;
use crate::render::{Layer, SamplePlan};
use crate::stage::Stage;

/// Motion of an object's centre across the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectMotion {
    /// Motion from this frame to the next, px (raster axes).
    pub per_frame_px: [f32; 2],
}

/// The inputs of effects, known before the picture is drawn. A pure function of the frames and
/// poses around it.
#[derive(Clone, Debug)]
pub struct FrameContext<'a> {
    /// The calibrated camera.
    pub camera: &'a Camera,
    /// Geometry of the output picture; [`Capture::recorded`] is the recorded picture's, which
    /// was calibrated.
    pub picture: &'a Geometry,
    pub capture: &'a Capture,
    /// Position in the recording.
    pub frame: usize,
    pub seed: u64,
    /// How the camera's picture was coded; `None` if unknown.
    pub coding: Option<&'a PictureCoding>,
    /// The largest code value: 255 or 65535.
    pub max_code: u32,
    /// The frame's exposure according to the recording.
    pub recorded: FrameExposure,
    /// Time to the next frame, s.
    pub interval_s: f64,
    /// Number of frames before this one in which all objects are where they are in this frame, to
    /// half a pixel.
    pub resting_frames: usize,
    /// Upper bound of the speed of any point of the objects, px/s.
    pub fastest_px_per_s: f32,
    /// Depth range of all points of the objects, m.
    pub depths_m: [f64; 2],
    /// Depth range of the real part's surfaces, if they are known, m.
    pub real_depths_m: Option<[f64; 2]>,
    /// One for each object of the scene.
    pub objects: &'a [ObjectMotion],
}

impl FrameContext<'_> {
    /// Converts a length in the recorded camera's pixels to pixels of the output picture.
    pub fn drawn_px(&self, recorded_px: f64) -> f64 {
        recorded_px * self.capture.enlargement
    }

    /// The frame's film speed over the speed at which the noise was measured (the camera
    /// profile's): by the ISO in the frame's file, else by the gain that the recording lists. 1 if
    /// either is unknown.
    pub fn recorded_speed(&self) -> f64 {
        let FrameExposure { gain, photo, .. } = self.recorded;
        let Some(measured) = self.camera.exposure.iso else { return 1.0 };
        let speed = photo.iso.map(|iso| iso / measured).or(gain).unwrap_or(1.0);
        if speed.is_finite() && speed > 0.0 { speed } else { 1.0 }
    }
}

/// Noise by example over a frame's virtual pixels.
#[derive(Clone, Debug)]
pub struct ExampleNoise {
    pub model: ByAddress<NoiseModel>,
    /// Hash keys of this frame and of the resting frames before it.
    pub keys: FrameKeys,
}

/// A parameter that the camera does not support: its name, and advice to the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{parameter} is refused: {reason}")]
pub struct EffectError {
    pub parameter: &'static str,
    pub reason: &'static str,
}

/// Neighbourhood of an effect, px.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reach {
    /// Radius over which a pixel reads its neighbours.
    pub read_px: f32,
    /// Distance to which it draws beyond the rectangle of the objects, which covers their motion
    /// during the exposure.
    pub spread_px: f32,
}

impl Reach {
    /// A reach with one radius for reading and drawing.
    pub fn both(px: f32) -> Self {
        Self { read_px: px, spread_px: px }
    }
}

/// Treatment of the real part by an effect. Real objects occlude virtual ones, by default before an
/// effect runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnReal {
    /// Acts on virtual objects only.
    #[default]
    VirtualOnly,
    /// Blurs virtual objects as the camera blurred the foreground; occlusion is applied afterwards,
    /// with the matte.
    BlursVirtual,
    /// Also acts on the real part, if its surfaces are known.
    Acts,
    /// Also acts on the real part, if its surfaces are known. It blurs virtual objects behind sharp
    /// real ones; occlusion is applied afterwards, with the matte.
    ActsAndBlurs,
    /// Also acts on the real part, if its surfaces are known. Then it occludes virtual objects by
    /// real ones itself; otherwise occlusion is applied afterwards.
    ActsAndOccludes,
}

impl OnReal {
    pub fn acts(self) -> bool {
        !matches!(self, Self::VirtualOnly | Self::BlursVirtual)
    }

    /// Whether occlusion is applied after it, with the matte.
    pub fn blurs(self) -> bool {
        matches!(self, Self::BlursVirtual | Self::ActsAndBlurs | Self::ActsAndOccludes)
    }
}

/// A label, and the parameters that differ from the defaults.
pub type Case = (&'static str, Vec<(&'static str, Value)>);

/// The context in which an effect of the layer records its passes.
#[derive(Debug)]
pub struct LayerRun<'a> {
    pub recorder: &'a mut PassRecorder,
    pub context: &'a FrameContext<'a>,
    /// The coding that changed pixels follow after the mixed effects.
    pub coding: Option<&'a PictureCoding>,
    /// The part of the picture that the layer covers; may extend beyond the picture.
    pub drawn: Rect,
    /// The part of the picture that virtual objects can affect, including the spread of effects.
    pub objects_px: Rect,
    /// Whether anything still reads the geometry of the resulting layer.
    pub geometry_is_read: bool,
}

/// An effect's part of the composite pass: `apply_<name>` of a shader, and its inputs. Its globals
/// have a bind group of their own, and their names begin with the effect's.
#[derive(Debug)]
pub struct MixedPart {
    pub shader: Shader,
    /// The effect's name, which is also its uniform's.
    pub name: &'static str,
    pub uniform: UniformBytes,
    pub textures: Vec<(&'static str, Texture)>,
}

/// The value of the `override` curve, for shaders that import shared/response.
pub fn curve_choice(response: &Response) -> f64 {
    match response.curve {
        Curve::Srgb => 0.0,
        Curve::Linear => 1.0,
        Curve::Gamma => 2.0,
        _ => 3.0,
    }
}

/// Key of a response's samples.
#[derive(Clone, Debug, PartialEq)]
struct ResponseKey(Response);

/// The buffer `response_samples`, for shaders that import shared/response.
pub fn response_samples(recorder: &mut PassRecorder, response: &Response) -> Bytes {
    recorder.memoized(ResponseKey(response.clone()), |gpu, ResponseKey(response)| {
        // Not read on curves that the shader computes.
        let samples = response.samples().unwrap_or_else(|| vec![0.0; 2]);
        let bytes = bytemuck::cast_slice(&samples);
        Bytes::from(&gpu.buffer("response samples", bytes, wgpu::BufferUsages::STORAGE))
    })
}

/// An effect: a table of parameters with its name, and the passes that implement it. It has no
/// state between calls.
///
/// An effect on the virtual layer, in linear light, records passes in `run`; in `plan` it may
/// request more samples from the renderer. An effect on the mixed picture's code values returns its
/// part of the composite pass in `mix`.
pub trait Effect: Params + Boxed + std::fmt::Debug + Send + Sync {
    /// Description in one line.
    fn summary(&self) -> &'static str;
    /// True if it changes no pixel. Then it does not run.
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool;
    /// Message for the user of a neutral effect, without a full stop: the reason, and the
    /// parameters to change.
    fn neutral_hint(&self) -> &'static str;
    /// Checks that the camera, with the frame's geometry, supports the parameters. Called for every
    /// effect that is switched on, before any output is written, even if the effect is neutral.
    fn check(&self, _: &Camera, _: &Geometry) -> Result<(), EffectError> {
        Ok(())
    }
    /// Warning of a setting that has no result with this camera.
    fn ineffective_setting(&self, _: &Camera) -> Option<&'static str> {
        None
    }
    /// Its methods, for benchmarks and for the tests of the laws. At least one.
    fn cases(&self) -> Vec<Case> {
        vec![("", Vec::new())]
    }
    /// Radius over which it reads and draws.
    fn reach(&self, _: &FrameContext<'_>) -> Reach {
        Reach::default()
    }
    /// Time before and after the exposure to which the samples of its plan extend, s. Called before
    /// the objects in view are known, because those depend on it.
    fn beyond_s(&self, _exposure_time_s: f64) -> f64 {
        0.0
    }
    /// Whether it reads the objects' motion until the next frame ([`ObjectMotion`]).
    fn reads_next_pose(&self) -> bool {
        false
    }
    fn on_real(&self) -> OnReal {
        OnReal::VirtualOnly
    }
    /// Whether it reads the layer's geometry.
    fn reads_geometry(&self) -> bool {
        false
    }
    /// Extends the samples that the renderer draws. `plan` is the result of the effects before this
    /// one, beginning with a single sample.
    fn plan(&self, _: &FrameContext<'_>, plan: SamplePlan) -> SamplePlan {
        plan
    }
    /// Records its passes over the layer and returns the layer for the next effect.
    fn run(&self, _: &mut LayerRun<'_>, layer: Layer) -> Layer {
        layer
    }
    /// Its part of the composite pass for the rectangle `shown` of the picture. The pass runs over
    /// every pixel if the whole picture is composited, else over those that the layer changes.
    fn mix(&self, _: &mut LayerRun<'_>, _shown: Rect) -> Option<MixedPart> {
        None
    }
    /// The coding that changed pixels follow after the mixed effects.
    fn coding(&self, _: &FrameContext<'_>) -> Option<PictureCoding> {
        None
    }
    /// The noise that is added to the planes of changed pixels, which follow this coding. Fails if
    /// the camera's model does not fit it.
    fn example_noise(
        &self,
        _: &FrameContext<'_>,
        _coding: Option<&PictureCoding>,
    ) -> Result<Option<ExampleNoise>, CodingDifference> {
        Ok(None)
    }
}

impl dyn Effect + '_ {
    /// The stage in which it acts: [`Stage::Mix`], in [`Effect::mix`], if its table is declared at
    /// that stage, else [`Stage::Effects`], in [`Effect::run`].
    pub fn stage(&self) -> Stage {
        match self.table_stage() {
            Some(Stage::Mix) => Stage::Mix,
            _ => Stage::Effects,
        }
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
    /// Equal if the effects and their parameters are equal.
    fn eq(&self, other: &Self) -> bool {
        let specs = self.specs();
        self.table() == other.table() && specs.iter().all(|spec| self.get(spec.name) == other.get(spec.name))
    }
}

impl MixedPart {
    pub fn new<U: Uniform>(shader: Shader, name: &'static str, uniform: &U) -> Self {
        Self { shader, name, uniform: UniformBytes::new(uniform), textures: Vec::new() }
    }

    pub fn texture(mut self, name: &'static str, texture: Texture) -> Self {
        self.textures.push((name, texture));
        self
    }
}
