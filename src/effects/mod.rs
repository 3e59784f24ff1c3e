//! The effects. To add one: ARCHITECTURE.md has the list of what it needs.

pub mod chromatic_aberration;
pub mod depth_of_field;
pub mod edge_blend;
pub mod exposure;
pub mod motion_blur;
pub mod noise;
pub mod point_spread;
mod stage;
pub mod vignetting;

pub use stage::{
    Effect, EffectError, FrameContext, MixedInputs, ObjectMotion, Photograph, Stage, Summed, response_constants,
};

/// Every effect at its defaults, in the order of the light.
pub fn all() -> Vec<Box<dyn Effect>> {
    vec![
        Box::new(motion_blur::MotionBlurEffect::default()),
        Box::new(depth_of_field::DepthOfFieldEffect::default()),
        Box::new(point_spread::PointSpreadEffect::default()),
        Box::new(vignetting::VignettingEffect::default()),
        Box::new(exposure::ExposureEffect::default()),
        Box::new(chromatic_aberration::ChromaticAberrationEffect::default()),
        Box::new(edge_blend::EdgeBlendEffect::default()),
        Box::new(noise::NoiseEffect::default()),
    ]
}
