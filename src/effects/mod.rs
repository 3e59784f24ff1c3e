//! The effects. ARCHITECTURE.md lists what adding one takes.

pub mod blur;
pub mod chromatic_aberration;
pub mod depth_of_field;
pub mod edge_blend;
pub mod exposure;
mod follow;
pub mod halation;
pub mod motion_blur;
pub mod noise;
pub mod point_spread;
mod stage;
pub mod vignetting;

pub use stage::{
    Boxed, Case, Effect, EffectError, LayerRun, MixedPart, Moment, ObjectMotion, OnReal, Reach, curve_choice,
};

/// Every effect at its defaults, in working order: the light's, except for chromatic_aberration, which says why it
/// comes last.
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
    ]
}
