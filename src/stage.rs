//! The stages of a frame.

use std::fmt;

/// A stage of a frame's computation, in order. Each is a pure function of its inputs and of earlier
/// stages' results, so that a change recomputes the first stage that reads it, and those that read
/// the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// The fraction of light that objects remove from real surfaces.
    PlanarShadows,
    /// The fraction of light that reaches objects, and the indirect light on them.
    Lightmaps,
    /// The real scene's depth, repaired, and the foreground's matte.
    Depth,
    /// The fraction of the real light that is removed, at each pixel.
    ShadowMask,
    /// The objects, drawn.
    Draw,
    /// The effects on the drawn layer, in linear light.
    Effects,
    /// The layer over the camera's picture, with the effects on code values.
    Mix,
}

impl Stage {
    pub const ALL: [Self; 7] =
        [Self::PlanarShadows, Self::Lightmaps, Self::Depth, Self::ShadowMask, Self::Draw, Self::Effects, Self::Mix];
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PlanarShadows => "planar shadows",
            Self::Lightmaps => "lightmaps",
            Self::Depth => "depth",
            Self::ShadowMask => "shadow mask",
            Self::Draw => "draw",
            Self::Effects => "effects",
            Self::Mix => "mix",
        })
    }
}
