//! Collects positions and triangles of any format.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::{ScanError, ScanGeometry};
use crate::fit::quantile::upper_median;
use crate::text::{count, short};

/// The origin is the median of this many first positions, so that an outlier does not move it.
const ORIGIN_SAMPLES: usize = 1024;
/// Nearer to zero, in the file's unit, positions need no origin of their own.
const NEAR_ZERO: f64 = 1024.0;
/// Most positions, and most triangles: 3 GiB each.
const MAX_COUNT: usize = 1 << 28;
/// Farther from the origin, in the file's unit, positions of 32 bits are coarser than 0.001.
const MAX_PRECISE: f32 = 16_384.0;
/// Index of a vertex that was dropped.
const DROPPED: u32 = u32::MAX;

/// Collects positions relative to a local origin.
#[derive(Default)]
pub(super) struct GeometryBuilder {
    /// The positions before there are enough of them to choose an origin.
    first: Vec<DVec3>,
    origin: Option<DVec3>,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    pub warnings: Vec<String>,
}

impl GeometryBuilder {
    /// Reserves memory for `count` more positions, which a file announces, and which its length
    /// limits to `max_count`.
    pub fn reserve(&mut self, count: u64, max_count: u64) {
        let room = MAX_COUNT.saturating_sub(self.len()) as u64;
        self.positions.reserve_exact(count.min(max_count).min(room) as usize);
    }

    /// Number of positions so far.
    pub fn len(&self) -> usize {
        self.first.len() + self.positions.len()
    }

    #[inline]
    pub fn push(&mut self, position: DVec3) {
        match self.origin {
            // One more than allowed marks the excess.
            Some(origin) if self.positions.len() <= MAX_COUNT => self.positions.push((position - origin).as_vec3()),
            Some(_) => {}
            None => self.push_first(position),
        }
    }

    #[cold]
    fn push_first(&mut self, position: DVec3) {
        self.first.push(position);
        if self.first.len() >= ORIGIN_SAMPLES {
            self.choose_origin();
        }
    }

    fn choose_origin(&mut self) {
        let median = |axis: usize| {
            let values = self.first.iter().filter(|position| position.is_finite());
            upper_median(values.map(|position| position[axis])).map_or(0.0, f64::round)
        };
        let median = DVec3::from_array([0, 1, 2].map(median));
        let origin = if median.abs().max_element() < NEAR_ZERO { DVec3::ZERO } else { median };
        self.origin = Some(origin);
        self.positions.extend(self.first.drain(..).map(|position| (position - origin).as_vec3()));
    }

    /// Adds a triangle. Triangles with two equal corners, which strips contain, have no area and
    /// are left out.
    pub fn triangle(&mut self, [a, b, c]: [u32; 3]) {
        if a != b && b != c && c != a && self.triangles.len() <= MAX_COUNT {
            self.triangles.push([a, b, c]);
        }
    }

    /// Adds a polygon as a fan around its first corner, which is exact for convex polygons.
    pub fn fan(&mut self, corners: &[u32]) {
        if let [first, rest @ ..] = corners {
            rest.windows(2).for_each(|edge| self.triangle([*first, edge[0], edge[1]]));
        }
    }

    /// Adds a triangle strip. The winding alternates from triangle to triangle.
    pub fn strip(&mut self, corners: &[u32]) {
        for (n, corner) in corners.windows(3).enumerate() {
            let [a, b, c] = [corner[0], corner[1], corner[2]];
            self.triangle(if n % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
    }

    /// The geometry, with neither unit nor up. Fails without any finite position, beyond the memory
    /// limit, and if a triangle refers to an absent vertex.
    pub fn finish(mut self, file: &Path) -> Result<ScanGeometry, ScanError> {
        if !self.first.is_empty() {
            self.choose_origin();
        }
        for (length, things) in [(self.positions.len(), "points"), (self.triangles.len(), "triangles")] {
            if length > MAX_COUNT {
                let problem = format!(
                    "it has more than {MAX_COUNT} {things}, the most that are read; thin it out: in \
                     CloudCompare, Edit > Subsample"
                );
                return Err(ScanError::unsupported(file, problem));
            }
        }
        self.check_triangles(file)?;
        let total = self.positions.len();
        self.drop_invalid();
        if self.positions.is_empty() {
            let problem = match total {
                0 => {
                    "it holds no points; a scan with points is needed: export it again, with points selected".to_owned()
                }
                _ => format!("none of its {} has finite coordinates; export it again", count(total, "point")),
            };
            return Err(ScanError::unsupported(file, problem));
        }
        self.warn_of_precision();
        self.positions.shrink_to_fit();
        self.triangles.shrink_to_fit();
        Ok(ScanGeometry {
            origin: self.origin.unwrap_or_default(),
            positions: self.positions,
            triangles: self.triangles,
            metres_per_unit: None,
            up: None,
            warnings: self.warnings,
        })
    }

    fn check_triangles(&self, file: &Path) -> Result<(), ScanError> {
        let vertices = self.positions.len();
        let is_absent = |corners: &[u32; 3]| corners.iter().any(|corner| *corner as usize >= vertices);
        let Some(n) = self.triangles.iter().position(is_absent) else { return Ok(()) };
        let corner = self.triangles[n].iter().max().unwrap_or(&0);
        let vertices = if vertices == 1 { "1 vertex".to_owned() } else { format!("{vertices} vertices") };
        let problem = format!(
            "it refers to vertex {corner} (counted from 0), and the file has {vertices}: it is cut off or damaged; \
             export it again"
        );
        Err(ScanError::content(file, format_args!("triangle {n}"), problem))
    }

    /// Drops the positions that are not finite, and their triangles.
    fn drop_invalid(&mut self) {
        let total = self.positions.len();
        if self.positions.iter().all(|position| position.is_finite()) {
            return;
        }
        let triangles = self.triangles.len();
        if triangles > 0 {
            let mut next = 0;
            let new_index = |position: &Vec3| {
                let index = if position.is_finite() { next } else { DROPPED };
                next += u32::from(index != DROPPED);
                index
            };
            let new_indices: Vec<u32> = self.positions.iter().map(new_index).collect();
            self.triangles.retain_mut(|corners| {
                *corners = corners.map(|corner| new_indices[corner as usize]);
                !corners.contains(&DROPPED)
            });
        }
        self.positions.retain(|position| position.is_finite());
        let (dropped, flat) = (total - self.positions.len(), triangles - self.triangles.len());
        let with_triangles =
            if flat > 0 { format!(", and {} with them", count(flat, "triangle")) } else { String::new() };
        let points = count(total, "point");
        self.warnings.push(format!("dropped {dropped} of {points}, whose coordinates are not finite{with_triangles}"));
    }

    fn warn_of_precision(&mut self) {
        let farthest =
            self.positions.iter().fold(Vec3::ZERO, |largest, position| largest.max(position.abs())).max_element();
        if farthest >= MAX_PRECISE {
            let steps = f64::from(farthest.next_up() - farthest);
            self.warnings.push(format!(
                "points lie up to {} units from the middle, where coordinates of 32 bits have steps of {} units; \
                 crop the scan to the place in the picture",
                short(f64::from(farthest)),
                short(steps)
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<ScanGeometry, ScanError> {
        let mut builder = GeometryBuilder::default();
        positions.iter().for_each(|position| builder.push(*position));
        triangles.iter().for_each(|corners| builder.triangle(*corners));
        builder.finish(Path::new("a.ply"))
    }

    #[test]
    fn georeferenced_positions_keep_millimetres() {
        let corner = DVec3::new(2_683_141.237, 1_247_655.482, 412.019);
        // An outlier at zero must not become the origin.
        let mut positions = vec![DVec3::ZERO];
        positions.extend((0..3000).map(|n| corner + f64::from(n) * DVec3::new(0.003, 0.001, 0.0007)));
        let built = built(&positions, &[]).unwrap();
        assert!(built.origin.distance(corner) < 10.0, "{}", built.origin);
        assert_eq!(built.positions.len(), positions.len());
        for (expected, read) in positions.iter().zip(&built.positions).skip(1) {
            assert!((built.origin + read.as_dvec3()).distance(*expected) < 2e-6);
        }
        assert!(built.warnings.len() == 1 && built.warnings[0].contains("steps of 0.25 units"), "{:?}", built.warnings);
    }

    #[test]
    fn local_positions_keep_their_coordinates() {
        let positions = [DVec3::new(900.0, -3.5, 1e-3), DVec3::X];
        let built = built(&positions, &[]).unwrap();
        assert_eq!((built.origin, built.positions), (DVec3::ZERO, positions.map(|p| p.as_vec3()).to_vec()));
    }

    #[test]
    fn positions_that_are_not_finite_are_dropped_with_their_triangles() {
        let positions = [DVec3::X, DVec3::NAN, DVec3::Y, DVec3::new(0.0, 1e300, 0.0), DVec3::Z];
        let built = built(&positions, &[[0, 1, 2], [0, 2, 4], [2, 3, 4], [0, 0, 2]]).unwrap();
        assert_eq!(built.positions, [Vec3::X, Vec3::Y, Vec3::Z]);
        assert_eq!(built.triangles, [[0, 1, 2]]);
        let warning = "dropped 2 of 5 points, whose coordinates are not finite, and 2 triangles with them";
        assert_eq!(built.warnings, [warning]);
    }

    #[test]
    fn absent_vertices_and_absent_points_are_errors() {
        let error = built(&[DVec3::X, DVec3::Y], &[[0, 1, 2]]).unwrap_err().to_string();
        assert!(error.starts_with("a.ply, triangle 0: it refers to vertex 2 (counted from 0)"), "{error}");
        assert!(built(&[], &[]).unwrap_err().to_string().contains("holds no points"));
        assert!(built(&[DVec3::NAN], &[]).unwrap_err().to_string().contains("none of its 1 point has finite"));
    }

    #[test]
    fn fans_and_strips_keep_their_winding() {
        let mut builder = GeometryBuilder::default();
        builder.fan(&[0, 1, 2, 3]);
        builder.strip(&[4, 5, 6, 7, 7]);
        assert_eq!(builder.triangles, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [6, 5, 7]]);
        builder.fan(&[]);
        builder.strip(&[1, 2]);
        assert_eq!(builder.triangles.len(), 4);
    }
}
