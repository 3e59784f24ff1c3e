//! Depth in a recording's pictures, as plain values.
//!
//! A frame's depth is `Repair::over` (`repaired`): `moment`, `vote`, `surfels`, `proxies`, `mended` (`holes`, then `edges`), `smooth`, `contact`,
//! `matte`, in this order. Effects call nothing here. They say that they read depth (`Effect::reads_geometry`), act on real things
//! (`Effect::on_real`), and how far they reach; the compositor hides and cuts off by that (compositor/hide.rs).
//!
//! - `registered`: a sensor's map of another size, or from another camera, in the frames' picture.
//! - `moment`: a sensor's map, carried to the moment at which a frame was taken, for a part of the picture.
//! - `carry`: its points, as another pose sees them. `looks`: colours, as they are compared here.
//! - `vote`: consensus of several frames' maps. `surfels`: depth fused from the whole recording, where the consensus has none.
//!   `requested`: the pixels that both fill. `of_frame`: runs both on a whole frame, at its time.
//! - `holes`: depth where the sensor measured none. `edges`: edges moved to the picture's, `likeness`: whose
//!   pixels near them look like. `behind`: what is behind them. `mended`: holes filled and edges moved. `smooth`: moved edges made
//!   even. `apart`: what parts two surfaces.
//! - `nearest_edge`: the edge that matters at each pixel. `padded`: a map within a rim, for what asks about surroundings.
//! - `contact`: what things stand on, as flat as it is. `proxies`: models that stand in for real things.
//! - `matte`: how much of a pixel at an edge is the nearer surface's. `smear`: how far it moves while the shutter is open.
//! - `repaired`: filled and with the picture's edges, where a recording's frame shows objects; `last_repair`: not twice. `grid`: the same over a
//!   photograph. `surfaces`: with what is behind too, for a photograph's real part.

mod apart;
mod behind;
mod carry;
mod contact;
mod edges;
mod grid;
mod holes;
mod last_repair;
mod likeness;
mod looks;
mod matte;
mod mended;
mod moment;
mod nearest_edge;
mod of_frame;
mod padded;
mod proxies;
mod registered;
mod repaired;
mod requested;
mod smear;
mod smooth;
mod surfaces;
mod surfels;
mod vote;

pub use contact::{Plane, flatten};
pub use grid::DepthGrid;
pub use last_repair::LastRepair;
pub use matte::Shared;
pub use moment::{RayCache, Rays, measured_from, seen_at_frame};
pub use of_frame::{agreed_at_frame, neighbours};
pub use proxies::{FAR_M, Proxies, Seen, known_m};
pub use registered::{DepthCamera, enlarged, holes, is_same_view};
pub use repaired::{Neighbour, Repair, Repaired, SecondSurface, Wanted};
pub use surfaces::Surfaces;

/// A structured-light sensor's error at 1 m, metres; it grows with the distance's square (Khoshelham and Elberink 2012).
pub const SENSOR_ERROR: f64 = 0.00143;
