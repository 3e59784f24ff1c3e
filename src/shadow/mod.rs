//! What stands in the room takes light from the floor that it stands on, from itself and from what stands beside it: how much, of
//! each colour, at each place.
//!
//! Room and objects stand still, so that is worked out once and looked up for every frame. On the floor below a thing, the
//! light that it takes is a share of the light there without it: D = 1 − E_with / E_without. What the floor is made of
//! cancels, so that the real picture's light is multiplied by 1 − D, and nothing else has to be known of it. Heckbert and
//! Herf (1996), "Fast shadow generation with projective textures", sum hard shadows of many points of a light alike.
//!
//! - `floor`: a plane with axes of its own. `sky`: the light that comes onto it, as a few hundred rays and the lamps nearby.
//! - `casters`: the triangles that stand on it. `outline`: the edges of their shadows. `mask`: where 32 rays at
//!   a time are stopped. `spread`: how blurred a ray's shadow is.
//! - `room`: what real things keep from the floor already. `dimmed`: what they keep from virtual things.
//! - `on_white`: what a white surface of the room shows by all that light. `radiance`: how bright surfaces are that a frame shows
//!   clipped.
//! - `extent`: how far the shadow is worth drawing. `chart`: the shares on the floor, as a picture of it.
//! - `within`: where a chart on a real thing beside the object counts.
//! - `group`: which things share a chart. `shadows`: the charts that are known already. `kept`: how they are found again; `known`:
//!   by another compositor, too. `last`: those that were made last.
//!
//! On things' own surfaces light is asked for by rays:
//!
//! - `bvh`: triangles that rays meet. `lightmap`: the light that reaches a part's surface. `lightmaps`: which things take light from
//!   which, and the lightmaps that are known already.
//!
//! All of it is arithmetic of the processor, the same on every graphics driver and for any number of threads.
//!
//! Not modelled: surfaces that are not flat; real things beside the floor that would take dim light.

#[cfg(test)]
mod block;
mod bounce;
mod bvh;
mod casters;
mod chart;
mod dimmed;
mod extent;
mod floor;
mod group;
mod last;
mod lightmap;
mod lightmaps;
mod mask;
mod on_white;
mod outline;
mod radiance;
mod room;
mod shadows;
mod skin;
mod sky;
mod spread;
mod steps;
mod within;

pub use chart::{Chart, Part, Shares};
pub use floor::Floor;
pub use lightmaps::Lightmaps;
pub use on_white::{OnWhite, on_white};
pub use radiance::{LazyRadiance, Sampler, SurfaceRadiance, SurfaceSample};
pub use room::Room;
pub use shadows::Shadows;
pub use within::TOLERANCE_M;
