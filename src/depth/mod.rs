//! Depth of the real scene in a recording's pictures, as plain values.
//!
//! `Repair::over` (`repaired`) computes the depth of a frame: `moment`, `vote`, `surfels`, `proxies`,
//! `inpaint` (`holes`, then `edges`), `smooth`, `contact`, `matte`, in this order. Effects call nothing
//! here. They declare that they read depth (`Effect::reads_geometry`), whether they act on the real part
//! (`Effect::on_real`) and how far they reach; the compositor cuts objects off accordingly
//! (compositor/occlusion.rs).
//!
//! - `registered`: a depth map of another size or camera, registered to the frames' picture.
//! - `moment`: a depth map reprojected to the time of a frame, in a region. `reprojection`: its points
//!   from another pose. `sqrt_colors`: gamma-encoded colours, in which noise is nearly uniform.
//! - `vote`: consensus of several frames' maps. `surfels`: depth fused from the whole recording, where
//!   the consensus has none. `requested`: the pixels that both fill. `of_frame`: both on a whole frame.
//! - `inpaint`: `holes` fills unmeasured depth, `edges` moves depth edges to those of the picture, by the
//!   colours on either side (`likeness`). `behind`: the background of an edge pixel. `smooth`: regularizes
//!   moved edges. `discontinuity`: when neighbouring depths are two surfaces.
//! - `nearest_edge`: the relevant edge of each pixel. `pad`: a map with a border of zeros.
//! - `contact`: depth near a support plane, snapped to it. `proxies`: models in place of real objects.
//! - `matte`: alpha of the nearer surface at edge pixels. `smear`: its motion during the exposure.
//! - `last_repair`: memo of the last result. `grid`: depth over a photograph. `surfaces`: with the
//!   background, for a photograph's real part.

mod behind;
mod contact;
mod discontinuity;
mod edges;
mod grid;
mod holes;
mod inpaint;
mod last_repair;
mod likeness;
mod matte;
mod moment;
mod nearest_edge;
mod of_frame;
mod pad;
mod proxies;
mod registered;
mod repaired;
mod reprojection;
mod requested;
mod smear;
mod smooth;
mod sqrt_colors;
mod surfaces;
mod surfels;
mod vote;

pub use contact::{Plane, flatten};
pub use grid::DepthGrid;
pub use last_repair::LastRepair;
pub use matte::MattePixel;
pub use moment::{RayCache, Rays, measured_from, seen_at_frame};
pub use of_frame::{agreed_at_frame, neighbours};
pub use proxies::{FAR_M, Proxies, Seen, known_m};
pub use registered::{DepthCamera, enlarged, holes, is_same_view};
pub use repaired::{Neighbour, Repair, Repaired, SecondSurface, Wanted};
pub use surfaces::Surfaces;

/// A structured-light sensor's error at 1 m, metres; it grows with the distance's square (Khoshelham and Elberink 2012).
pub const SENSOR_ERROR: f64 = 0.00143;
