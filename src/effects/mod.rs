//! The effects. docs/recipes/effect.md describes how to add one.

pub mod blur;
pub mod chromatic_aberration;
pub mod depth_of_field;
pub mod edge_blend;
pub mod exposure;
pub mod format;
pub mod halation;
pub mod motion_blur;
pub mod noise;
pub mod point_spread;
mod spread_geometry;
mod stage;
pub mod vignetting;

pub use stage::{
    Boxed, Case, Effect, EffectError, ExampleNoise, FrameContext, LayerRun, MixedPart, ObjectMotion, OnReal, Reach,
    curve_choice, response_samples,
};

/// Every effect at its defaults, in the order in which they run: the light's path, except for
/// chromatic_aberration (see there).
pub fn all() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(motion_blur::MotionBlur::default()),
        Box::new(depth_of_field::DepthOfField::default()),
        Box::new(point_spread::PointSpread::default()),
        Box::new(vignetting::Vignetting::default()),
        Box::new(exposure::Exposure::default()),
        Box::new(halation::Halation::default()),
        Box::new(chromatic_aberration::ChromaticAberration::default()),
        Box::new(edge_blend::EdgeBlend::default()),
        Box::new(noise::Noise::default()),
        Box::new(format::FrameFormat::default()),
    ]
}
