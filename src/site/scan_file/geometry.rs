//! Geometry of a scan.

use glam::{DVec3, Vec3};

/// Geometry of a scan in the file's own axes and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanGeometry {
    /// Added to every position: georeferenced coordinates exceed 32-bit precision. Zero if the
    /// coordinates are below about 1000, otherwise whole units.
    pub origin: DVec3,
    /// Relative to `origin`, finite, at least one.
    pub positions: Vec<Vec3>,
    /// Indices into `positions`, counter-clockwise from outside if the file keeps to that. Empty: a
    /// point cloud.
    pub triangles: Vec<[u32; 3]>,
    /// Length of the unit by the format, m. `None` if the format does not define one (PLY, OBJ,
    /// STL, XYZ).
    pub metres_per_unit: Option<f64>,
    /// Direction of up in the file's axes, of length 1, if the format defines it (glTF: +Y; E57 and
    /// LAS: +Z).
    pub up: Option<DVec3>,
    /// Omissions and doubts to report to the user; each is one sentence without its full stop.
    pub warnings: Vec<String>,
}
