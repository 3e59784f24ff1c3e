//! Shadows of virtual objects on real planes and on each other, with indirect light.
//!
//! Room and objects are static, so that shadows are precomputed and looked up for every frame.
//! Below an object the planar shadow stores D = 1 − E_with / E_without for each colour channel,
//! with the irradiance E with and without the objects. The albedo of the plane cancels: the real
//! picture's light is multiplied by 1 − D. As in Heckbert and Herf (1996), "Fast shadow generation
//! with projective textures", soft shadows are sums of hard ones over many points of a light.
//!
//! On real planes:
//!
//! - `receiver_plane`: the receiver plane with its axes. `sky`: its incident light, as some hundred
//!   rays and the lamps nearby.
//! - `occluders`: triangles above the plane. `silhouette`: outlines of their shadows. `mask`: where
//!   32 rays at a time are blocked. `penumbra`: the blur of each ray's shadow by its angular size.
//! - `bounce`: light that occluders reflect onto the plane.
//! - `extent`: the rectangle in which the shadow is visible. `planar_shadow`: D over that
//!   rectangle.
//! - `room`: real surfaces, and the rays that they block. `light_visibility`: the visible fraction
//!   of suns and lamps behind them, from virtual objects.
//! - `receiver_mask`: where a planar shadow applies on a real surface beside the object.
//! - `group`: which objects share a planar shadow. `caster`: their parts and the light, with a
//!   digest. `shadows`: planar shadows of a scene, memoized. `steps`: transforms as keys.
//!   `moved_planes`: shadows on planes that changed a little.
//! - `white_radiance`: radiance of white at a place. `radiance`: radiance of surfaces that are
//!   clipped in a frame. `albedo`: mean albedo of triangles.
//!
//! On objects' own surfaces, by ray casting:
//!
//! - `bvh`: the acceleration structure. `bake_scene`: incident light at a point. `lightmap`:
//!   incident light over a part's surface. `lightmaps`: those of a scene, memoized.
//!
//! All of it runs on the processor, with the same result for every graphics driver and number of
//! threads.
//!
//! Not modelled: curved receivers; real objects beside the plane that block dim light.

mod albedo;
mod bake_scene;
#[cfg(test)]
mod block;
mod bounce;
mod bvh;
mod caster;
mod extent;
mod group;
mod light_visibility;
mod lightmap;
mod lightmaps;
mod mask;
mod moved_planes;
mod occluders;
mod penumbra;
mod planar_shadow;
mod radiance;
mod receiver_mask;
mod receiver_plane;
mod room;
mod shadows;
mod silhouette;
mod sky;
mod steps;
mod white_radiance;

pub use lightmaps::Lightmaps;
pub use planar_shadow::{PlanarShadow, ShadowTexture, UvRect};
pub use radiance::{LazyRadiance, RadianceSampler, SurfaceRadiance, SurfaceSample};
pub use receiver_plane::ReceiverPlane;
pub use room::Room;
pub use shadows::Shadows;
pub use white_radiance::{WhiteRadiance, white_radiance};
