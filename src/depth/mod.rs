//! What stands how far away in a recording's pictures, as plain values.
//!
//! - `moment`: a sensor's map, carried to the moment at which a frame was taken; what a part of the picture sees of it.
//! - `holes`: depth where the sensor measured none. `edges`: its edges put on the picture's. `behind`: what stands behind them.
//! - `repaired`: filled and on the picture's edges, where a recording's frame shows objects. `grid`: the same over a photograph.
//!   `surfaces`: with what stands behind too, for a photograph's real part.

mod apart;
mod behind;
mod edges;
mod grid;
mod holes;
mod moment;
mod repaired;
mod surfaces;

pub use grid::DepthGrid;
pub use moment::{RayCache, Rays, measured_from, seen_at_frame};
pub use repaired::Repair;
pub use surfaces::Surfaces;
