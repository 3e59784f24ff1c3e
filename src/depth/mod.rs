//! Depth of the real scene in a recording's pictures, as plain values.
//!
//! `Repair::repaired_depth` (`repair`) computes the depth of a frame: `moment`, `vote`, `surfels`,
//! `proxies`, `inpaint` (`holes`, then `edges`), `smooth`, `contact`, `matte`, in this order.
//! Effects call nothing here. They declare that they read depth (`Effect::reads_geometry`), whether
//! they act on the real part (`Effect::on_real`) and how far they reach. The compositor occludes
//! objects accordingly (compositor/occlusion.rs).
//!
//! - `registered`: a depth map of another size or camera, registered to the frames' picture.
//! - `moment`: a depth map reprojected to the time of a frame, in a region. `reprojection`: its
//!   points from another pose. `sqrt_colors`: gamma-encoded colours, in which noise is nearly
//!   uniform.
//! - `vote`: consensus of several frames' maps. `surfels`: depth fused from the whole recording,
//!   where the consensus has none. `requested`: the pixels that both fill. `frame_depth`: both on a
//!   whole frame.
//! - `inpaint`: `holes` fills unmeasured depth, `edges` aligns depth edges with those of the
//!   picture, by the colours on either side (`color_likelihood`). `background`: extrapolation
//!   behind an edge. `smooth`: regularizes aligned edges. `discontinuity`: when neighbouring depths
//!   are two surfaces.
//! - `nearest_edge`: the relevant edge of each pixel. `pad`: a map with a border of zeros.
//! - `contact`: depth near a support plane, snapped to it. `proxies`: models in place of real
//!   objects.
//! - `matte`: alpha of the nearer surface at edge pixels. `smear`: its motion during the exposure.
//! - `last_repair`: memo of the last result. `grid`: depth over a photograph. `surfaces`: with the
//!   background, for a photograph's real part.

mod background;
mod color_likelihood;
mod contact;
mod discontinuity;
mod edges;
mod frame_depth;
mod grid;
mod holes;
mod inpaint;
mod last_repair;
mod matte;
mod moment;
mod nearest_edge;
mod pad;
mod proxies;
mod registered;
mod repair;
mod reprojection;
mod requested;
mod smear;
mod smooth;
mod sqrt_colors;
mod surfaces;
mod surfels;
mod vote;

pub use contact::{MIN_HEIGHT_OVER_PLANE_M, PLANE_TOLERANCE_M, PLANE_TOLERANCE_PER_DEPTH2, snap_to_planes};
pub use frame_depth::{consensus_at_frame, neighbours};
pub use grid::DepthGrid;
pub use last_repair::LastRepair;
pub use matte::MattePixel;
pub use moment::{Rays, measured_from, reprojected_at_frame};
pub use proxies::{FAR_M, ProjectedPoint, Proxies, unknown_if_far_m};
pub use registered::{DepthCamera, is_same_aspect, unknown_fraction, upsampled};
pub use repair::{DepthRequest, PosedNeighbour, ProxyView, Repair, RepairedDepth, SecondSurface};
pub use surfaces::Surfaces;

/// A structured-light sensor's error at 1 m, m. It grows with the square of the distance
/// (Khoshelham and Elberink 2012).
pub const SENSOR_ERROR: f64 = 0.00143;
