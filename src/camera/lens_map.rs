//! A lens as a table: for places of an undistorted picture the places of the recorded one, as a
//! tensor product of uniform cubic B-splines (de Boor, *A Practical Guide to Splines*, 1978). Its
//! source are ST maps, fitted by [`fit`].
//!
//! The undistorted picture is a pinhole's with the camera's focal lengths, centred over the
//! recorded picture and at its scale: it may be larger on all sides (overscan). A table is bound to
//! a camera by [`LensMap::bind`]: its domain and its values then are normalised coordinates, like
//! those of the other lens models. Beyond the domain the map continues along its tangent.

mod fit;
mod text;

use std::sync::Arc;

use glam::{DMat2, DVec2};

use super::Intrinsics;

pub use fit::{FitError, MapSample, fit};

/// Iterations of Newton's method for the inverse.
const MAX_ITERATIONS: usize = 60;
/// Error of the inverse that ends the iteration, and the largest that is accepted, normalised.
const INVERSE_TOLERANCE: f64 = 1e-13;
const MAX_INVERSE_ERROR: f64 = 1e-10;
const ORDER: usize = BoundMap::OVERLAP;

/// A map from an undistorted picture to a recorded one, independent of the camera's focal length.
#[derive(Clone, Debug, PartialEq)]
struct MapTable {
    /// Size of the undistorted picture, px.
    undistorted_px: [u32; 2],
    /// Size of the recorded picture, px, if the source of the map states it.
    recorded_px: Option<[u32; 2]>,
    /// Corners of the domain, px of the undistorted picture.
    low_px: DVec2,
    high_px: DVec2,
    /// Cells across and down.
    cells: [usize; 2],
    /// Control points, row by row: places in the recorded picture as fractions of its size, from
    /// the upper left corner. Three more each way than cells.
    controls: Vec<DVec2>,
}

/// The values of a camera that bind a table: size, focal lengths and principal point, px.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MapCamera {
    size_px: DVec2,
    focal_px: DVec2,
    principal_px: DVec2,
}

/// A table in normalised coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundMap {
    /// Corner of the domain.
    pub low: DVec2,
    /// Size of a cell.
    pub cell: DVec2,
    pub cells: [usize; 2],
    /// Control points of the displacement from undistorted to distorted places, row by row.
    pub displacements: Vec<DVec2>,
}

/// A lens's table, and the camera to which it is bound. Cheap to clone.
#[derive(Clone, Debug)]
pub struct LensMap {
    table: Arc<MapTable>,
    binding: Option<(MapCamera, Arc<BoundMap>)>,
}

impl PartialEq for LensMap {
    fn eq(&self, other: &Self) -> bool {
        let binding = |map: &Self| map.binding.as_ref().map(|(binding, _)| *binding);
        binding(self) == binding(other) && (Arc::ptr_eq(&self.table, &other.table) || self.table == other.table)
    }
}

/// Weights of the four control points of a cell and their derivatives, at a fraction of the cell.
fn spline_weights(t: f64) -> [[f64; 2]; 4] {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    [
        [s2 * s / 6.0, -s2 / 2.0],
        [(4.0 + t2 * (3.0 * t - 6.0)) / 6.0, t * (1.5 * t - 2.0)],
        [(1.0 + 3.0 * t * (1.0 + t * (1.0 - t))) / 6.0, 0.5 + t * (1.0 - 1.5 * t)],
        [t2 * t / 6.0, t2 / 2.0],
    ]
}

/// The cell that contains a place in cells from the domain's corner, and the fraction inside.
fn cell_of(place: f64, cells: usize) -> (usize, f64) {
    let first = place.floor().clamp(0.0, (cells - 1) as f64);
    (first as usize, place - first)
}

impl BoundMap {
    /// Overlap of a B-spline's pieces: control points along a side beyond the number of its cells.
    pub const OVERLAP: usize = 3;

    /// The displacement at normalised coordinates, and its derivative along both axes.
    fn displacement(&self, at: DVec2) -> (DVec2, DMat2) {
        let place = (at - self.low) / self.cell;
        let end = DVec2::new(self.cells[0] as f64, self.cells[1] as f64);
        let inside = place.clamp(DVec2::ZERO, end);
        let ((column, right), (row, down)) = (cell_of(inside.x, self.cells[0]), cell_of(inside.y, self.cells[1]));
        let (across, downwards) = (spline_weights(right), spline_weights(down));
        let (mut value, mut by_x, mut by_y) = (DVec2::ZERO, DVec2::ZERO, DVec2::ZERO);
        for (i, [weight_y, slope_y]) in downwards.into_iter().enumerate() {
            let first = (row + i) * (self.cells[0] + ORDER) + column;
            let controls = &self.displacements[first..first + 4];
            let (mut sum, mut slope) = (DVec2::ZERO, DVec2::ZERO);
            for (control, [weight_x, slope_x]) in controls.iter().zip(across) {
                sum += weight_x * *control;
                slope += slope_x * *control;
            }
            value += weight_y * sum;
            by_x += weight_y * slope;
            by_y += slope_y * sum;
        }
        let beyond = place - inside;
        (value + by_x * beyond.x + by_y * beyond.y, DMat2::from_cols(by_x / self.cell.x, by_y / self.cell.y))
    }

    /// Distorts normalised coordinates.
    pub fn distort(&self, at: DVec2) -> DVec2 {
        at + self.displacement(at).0
    }

    /// The distorted place and the derivative of the map.
    fn with_slope(&self, at: DVec2) -> (DVec2, DMat2) {
        let (displacement, slope) = self.displacement(at);
        (at + displacement, DMat2::IDENTITY + slope)
    }

    /// The inverse of [`BoundMap::distort`], by Newton's method with step halving. `None` if there
    /// is none.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let mut at = distorted;
        let (mut value, mut slope) = self.with_slope(at);
        let mut error = value.distance(distorted);
        for _ in 0..MAX_ITERATIONS {
            if error < INVERSE_TOLERANCE {
                break;
            }
            let determinant = slope.determinant();
            if determinant.is_nan() || determinant.abs() < 1e-12 {
                return None;
            }
            let newton = slope.inverse() * (value - distorted);
            let mut step = 1.0;
            loop {
                let next = at - step * newton;
                let (next_value, next_slope) = self.with_slope(next);
                let next_error = next_value.distance(distorted);
                if next_error < error {
                    (at, value, slope, error) = (next, next_value, next_slope, next_error);
                    break;
                }
                step *= 0.5;
                if step < 1e-6 {
                    return (error < MAX_INVERSE_ERROR).then_some(at);
                }
            }
        }
        (error < MAX_INVERSE_ERROR).then_some(at)
    }
}

impl MapCamera {
    fn of(i: &Intrinsics) -> Self {
        Self {
            size_px: DVec2::new(i.width_px.into(), i.height_px.into()),
            focal_px: DVec2::new(i.fx_px, i.fy_px),
            principal_px: DVec2::new(i.cx_px, i.cy_px),
        }
    }
}

impl MapTable {
    /// The table for a camera, in normalised coordinates.
    fn bound(&self, binding: &MapCamera) -> BoundMap {
        let MapCamera { size_px, focal_px, principal_px } = *binding;
        let undistorted_px = DVec2::new(self.undistorted_px[0].into(), self.undistorted_px[1].into());
        let overscan_px = 0.5 * (undistorted_px - size_px);
        let cells = DVec2::new(self.cells[0] as f64, self.cells[1] as f64);
        let cell_px = (self.high_px - self.low_px) / cells;
        let normalised = |undistorted_px: DVec2| (undistorted_px - overscan_px - principal_px) / focal_px;
        let columns = self.cells[0] + ORDER;
        let displacement = |(n, control): (usize, &DVec2)| {
            // A spline with these places as control points is the identity.
            let own = DVec2::new((n % columns) as f64, (n / columns) as f64) - 1.0;
            (*control * size_px - principal_px) / focal_px - normalised(self.low_px + own * cell_px)
        };
        BoundMap {
            low: normalised(self.low_px),
            cell: cell_px / focal_px,
            cells: self.cells,
            displacements: self.controls.iter().enumerate().map(displacement).collect(),
        }
    }
}

impl LensMap {
    fn new(table: MapTable) -> Self {
        Self { table: Arc::new(table), binding: None }
    }

    /// Binds the table to the camera of the whole recorded picture. A bound table keeps its camera:
    /// that of a crop of the picture has the same rays.
    pub fn bind(&mut self, camera: &Intrinsics) {
        if self.binding.is_none() {
            let binding = MapCamera::of(camera);
            self.binding = Some((binding, Arc::new(self.table.bound(&binding))));
        }
    }

    /// The table without a camera.
    pub fn unbound(&self) -> Self {
        Self { table: Arc::clone(&self.table), binding: None }
    }

    /// The table in normalised coordinates. `None` before it is bound.
    pub fn bound(&self) -> Option<&BoundMap> {
        self.binding.as_ref().map(|(_, bound)| &**bound)
    }

    /// Checks that the table fits a camera, the one of the whole recorded picture. The error is the
    /// predicate of a sentence about the map.
    pub fn check(&self, camera: &Intrinsics) -> Result<(), String> {
        let binding = MapCamera::of(camera);
        let bound = self.table.bound(&binding);
        self.check_size(camera)?;
        check_scale(&bound, &binding)?;
        check_border(&bound, &binding)?;
        check_change(&bound, &binding)
    }

    fn check_size(&self, camera: &Intrinsics) -> Result<(), String> {
        let Some([width_px, height_px]) = self.table.recorded_px else { return Ok(()) };
        // Maps of proxies have another size and the same aspect.
        let height = f64::from(camera.width_px) * f64::from(height_px) / f64::from(width_px);
        if (height - f64::from(camera.height_px)).abs() <= MAX_ASPECT_ERROR_PX {
            return Ok(());
        }
        Err(format!(
            "from the recorded picture is {width_px}x{height_px} px, and the recorded picture is {}x{}: expected the \
             same size; are `undistort` and `redistort` swapped?",
            camera.width_px, camera.height_px
        ))
    }
}

/// Largest deviation of a map's aspect from the picture's, px of its height.
const MAX_ASPECT_ERROR_PX: f64 = 1.0;
/// Largest ratio of the scales across and down in the middle of the picture.
const MAX_SCALE_RATIO: f64 = 1.1;
/// Largest magnification of the undistorted picture relative to the recorded one in its middle, and
/// the inverse of the smallest.
const MAX_SCALE: f64 = 2.0;
/// Smallest displacement of a map that is not the identity, px.
const MIN_CHANGE_PX: f64 = 0.01;
/// Largest distance of a recorded pixel beyond the map, as a fraction of the picture's width. The
/// map continues along its tangent for so far.
const MAX_BEYOND: f64 = 0.01;

/// Places of the recorded picture: a grid over all of it.
fn grid_px(size_px: DVec2, steps: u32) -> impl Iterator<Item = DVec2> {
    let fraction = move |n: u32| f64::from(n) / f64::from(steps);
    (0..=steps).flat_map(move |y| (0..=steps).map(move |x| DVec2::new(fraction(x), fraction(y)) * size_px))
}

fn check_scale(bound: &BoundMap, binding: &MapCamera) -> Result<(), String> {
    let centre = (0.5 * binding.size_px - binding.principal_px) / binding.focal_px;
    let slope = bound.undistort(centre).map(|at| bound.with_slope(at).1);
    let slope = slope.ok_or("has no place for the middle of the recorded picture: write it of the whole picture")?;
    let [across, down] = [slope.x_axis.length(), slope.y_axis.length()];
    if (across / down).max(down / across) > MAX_SCALE_RATIO {
        return Err(format!(
            "scales the middle of the picture by {across:.2} across and {down:.2} down: it belongs to a picture of \
             another aspect than {}x{}",
            binding.size_px.x, binding.size_px.y
        ));
    }
    if !(1.0 / MAX_SCALE..=MAX_SCALE).contains(&across) {
        return Err(format!(
            "scales the middle of the picture by {across:.2}: the undistorted picture must have the scale of the \
             recorded one; write the map at full resolution"
        ));
    }
    Ok(())
}

fn check_border(bound: &BoundMap, binding: &MapCamera) -> Result<(), String> {
    let MapCamera { size_px, focal_px, principal_px } = *binding;
    let high = bound.low + bound.cell * DVec2::new(bound.cells[0] as f64, bound.cells[1] as f64);
    let mut farthest_px = 0f64;
    let is_on_border = |at: &DVec2| at.x == 0.0 || at.y == 0.0 || at.x == size_px.x || at.y == size_px.y;
    for at_px in grid_px(size_px, 24).filter(is_on_border) {
        let at = bound.undistort((at_px - principal_px) / focal_px);
        let at = at.ok_or_else(|| format!("is not one-to-one at the recorded pixel {:.0}, {:.0}", at_px.x, at_px.y))?;
        let beyond_px = (at - at.clamp(bound.low, high)) * focal_px;
        farthest_px = farthest_px.max(beyond_px.abs().max_element());
    }
    if farthest_px > MAX_BEYOND * size_px.x {
        return Err(format!(
            "ends before the border of the recorded picture does, by up to {farthest_px:.0} px: write it with overscan, \
             or name the map of the other direction, too"
        ));
    }
    Ok(())
}

fn check_change(bound: &BoundMap, binding: &MapCamera) -> Result<(), String> {
    let changes = grid_px(binding.size_px, 8).any(|at_px| {
        let at = (at_px - binding.principal_px) / binding.focal_px;
        ((bound.distort(at) - at) * binding.focal_px).length() > MIN_CHANGE_PX
    });
    if changes {
        return Ok(());
    }
    Err("is the identity: it moves no place by a hundredth of a pixel; write the map of the lens, or leave it out for a \
         picture without distortion"
        .to_owned())
}

#[cfg(test)]
mod tests;
