//! Supports: the real surfaces on which objects stand, and those beside them that receive shadows.
//!
//! Plain values, from a scene's objects and measured points of the room. `shot` caches the results.
//!
//! - `room_points`: measured points, from depth maps spread over a recording.
//! - `plane_fit`: the least-squares plane through points. `ransac`: the plane of most points.
//!   `room_planes`: the dominant planes of a room. `inverse_depth_plane`: the plane around a pixel
//!   of a depth map.
//! - `footprint`: the lowest points of an object. `object_support`: the plane below them. `tilt`:
//!   the gap between them and a tilted plane.
//! - `facets`: flat parts of real objects beside an object.
//! - `report`: supports and facets in words and numbers.

mod facets;
mod footprint;
mod inverse_depth_plane;
mod object_support;
mod plane_fit;
mod ransac;
mod report;
mod room_planes;
mod room_points;
mod tilt;

pub use facets::facets;
pub use footprint::FootprintSamples;
pub use inverse_depth_plane::InverseDepthPlane;
pub use object_support::{height_over_points_m, object_support};
pub use plane_fit::{PlaneFit, PlaneFitError, plane_through};
pub use ransac::{MeasuredPoint, ransac_plane};
pub use report::{PlaneSource, SupportReport};
pub use room_planes::{RoomPlanes, up_on_surface};
pub use room_points::{DepthSamples, RoomPoints, points_by_frame};
pub use tilt::TiltedSupport;
