//! A point cloud as oriented discs in an octree of levels of detail.
//!
//! Points are sorted by Morton code (Morton 1966), so the points of a cube of the octree are
//! contiguous. A node is a cube of 16³ voxels. Each occupied voxel is a disc: at the mean of its
//! points, with the direction of least variance of the points of its 3×3×3 neighbourhood as normal
//! (Hoppe et al. 1992). On a flat neighbourhood the disc is moved onto its plane, which averages
//! the scanner's noise over the neighbourhood. An octant of a node is refined to voxels of half the
//! side while it has enough points for them.
//!
//! Not modelled: intensity and colour of the points; transparency; the positions of the scanner.

use std::ops::Range;

use glam::Vec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::morton::{BITS, bounds, demorton, morton_code};
use crate::parallel::{over_rows, processors};

/// Smallest side of a voxel, m: the noise of a terrestrial scanner.
const MIN_VOXEL_M: f32 = 0.002;
/// Voxels of the coarsest nodes have at most this side, m.
const MAX_VOXEL_M: f32 = 0.08;
/// log₂ of the voxels along the side of a node.
const NODE_BITS: u32 = 4;
const NODE_SIDE: usize = 1 << NODE_BITS;
const NODE_VOXELS: usize = 1 << (3 * NODE_BITS);
/// Least mean number of points per voxel of a refined octant.
const MIN_POINTS_PER_VOXEL: usize = 4;
/// Fewer points in a voxel's neighbourhood define no plane. In a scan they are outliers: points
/// that a scanner measures between two surfaces.
const MIN_POINTS_FOR_PLANE: f32 = 3.0;
/// Smaller clouds are not thinned out.
const MIN_SCAN_POINTS: usize = 1000;
/// A neighbourhood is flat if its variance along the normal is below this fraction of the second
/// smallest one.
const FLAT: f64 = 0.05;

/// A surface element of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// In the axes of the octree, m.
    pub position_m: Vec3,
    /// Unit length, of either sign; zero if unknown.
    pub normal: Vec3,
}

/// A cube of voxels.
#[derive(Clone, Debug)]
pub struct OctreeNode {
    /// Side of a voxel, m.
    pub voxel_m: f32,
    pub octants: [Octant; 8],
}

/// An eighth of a node.
#[derive(Clone, Debug)]
pub struct Octant {
    pub center_m: Vec3,
    /// Indices of its discs.
    pub discs: Range<u32>,
    /// Index of the node that refines it.
    pub refined: Option<u32>,
}

impl OctreeNode {
    /// Half of an octant's diagonal, m.
    pub fn octant_radius_m(&self) -> f32 {
        0.5 * 3.0f32.sqrt() * (NODE_SIDE / 2) as f32 * self.voxel_m
    }
}

/// Discs of a point cloud at several levels of detail.
#[derive(Clone, Debug, Default)]
pub struct PointOctree {
    pub discs: Vec<Disc>,
    pub nodes: Vec<OctreeNode>,
    /// The first nodes are the coarsest; together they hold all points.
    pub root_count: usize,
}

/// A node before it is computed: its points, and log₂ of its voxels' side in quanta.
#[derive(Clone)]
struct OctreeCube {
    points: Range<usize>,
    voxel_bits: u32,
}

/// The discs of a cube, by octants.
#[derive(Clone, Default)]
struct CubeDiscs {
    discs: [Vec<Disc>; 8],
    refined: [Option<OctreeCube>; 8],
}

/// Points by Morton code.
struct SortedPoints {
    codes: Vec<u64>,
    points_m: Vec<Vec3>,
    corner_m: Vec3,
    quantum_m: f32,
}

impl PointOctree {
    /// Points in metres, all finite.
    pub fn new(points_m: &[Vec3]) -> Self {
        if points_m.is_empty() {
            return Self::default();
        }
        let points = SortedPoints::new(points_m);
        let mut cubes = points.roots();
        let mut octree = Self { root_count: cubes.len(), ..Self::default() };
        while !cubes.is_empty() {
            let mut computed = vec![CubeDiscs::default(); cubes.len()];
            over_rows(&mut computed, 1, processors(), |n, discs| discs[0] = points.discs(&cubes[n]));
            let first_refined = octree.nodes.len() + cubes.len();
            let mut refined = Vec::new();
            for (cube, computed) in cubes.iter().zip(computed) {
                octree.push(&points, cube, computed, first_refined, &mut refined);
            }
            cubes = refined;
        }
        octree
    }

    fn push(
        &mut self,
        points: &SortedPoints,
        cube: &OctreeCube,
        computed: CubeDiscs,
        first_refined: usize,
        refined: &mut Vec<OctreeCube>,
    ) {
        let centers = points.octant_centers_m(cube);
        let mut cubes = computed.refined.into_iter();
        let mut discs = computed.discs.into_iter();
        let octants = centers.map(|center_m| {
            let start = self.discs.len() as u32;
            self.discs.extend(discs.next().unwrap_or_default());
            let refined_by = cubes.next().flatten().map(|cube| {
                refined.push(cube);
                (first_refined + refined.len() - 1) as u32
            });
            Octant { center_m, discs: start..self.discs.len() as u32, refined: refined_by }
        });
        self.nodes.push(OctreeNode { voxel_m: points.voxel_m(cube), octants });
    }
}

impl SortedPoints {
    fn new(points_m: &[Vec3]) -> Self {
        let (low, high) = bounds(points_m.iter());
        let quanta = (1u32 << BITS) as f32;
        let quantum_m = MIN_VOXEL_M.max(1.001 * (high - low).max_element() / quanta);
        let mut by_code: Vec<(u64, u32)> =
            points_m.iter().enumerate().map(|(n, point)| (morton_code((*point - low) / quantum_m), n as u32)).collect();
        by_code.sort_unstable();
        let sorted = by_code.iter().map(|(_, n)| points_m[*n as usize]).collect();
        let codes = by_code.into_iter().map(|(code, _)| code).collect();
        Self { codes, points_m: sorted, corner_m: low, quantum_m }
    }

    fn voxel_m(&self, cube: &OctreeCube) -> f32 {
        self.quantum_m * (1u64 << cube.voxel_bits) as f32
    }

    /// The coarsest cubes.
    fn roots(&self) -> Vec<OctreeCube> {
        let steps = (MAX_VOXEL_M / self.quantum_m).log2().floor().max(0.0) as u32;
        let voxel_bits = steps.min(BITS - NODE_BITS);
        let shift = 3 * (voxel_bits + NODE_BITS);
        let mut cubes = Vec::new();
        let mut start = 0;
        while start < self.codes.len() {
            let cell = self.codes[start] >> shift;
            let end = start + self.codes[start..].partition_point(|code| code >> shift == cell);
            cubes.push(OctreeCube { points: start..end, voxel_bits });
            start = end;
        }
        cubes
    }

    /// Centers of the octants of a cube, m.
    fn octant_centers_m(&self, cube: &OctreeCube) -> [Vec3; 8] {
        let shift = 3 * (cube.voxel_bits + NODE_BITS);
        let corner = demorton(self.codes[cube.points.start] >> shift << shift) * self.quantum_m + self.corner_m;
        let side_m = (NODE_SIDE / 2) as f32 * self.voxel_m(cube);
        std::array::from_fn(|octant| corner + side_m * (demorton(octant as u64) + 0.5))
    }

    fn discs(&self, cube: &OctreeCube) -> CubeDiscs {
        let codes = &self.codes[cube.points.clone()];
        let voxel = |code: u64| (code >> (3 * cube.voxel_bits)) as usize % NODE_VOXELS;
        let center_m = self.octant_centers_m(cube).iter().sum::<Vec3>() / 8.0;
        let mut moments = vec![PointMoments::default(); NODE_VOXELS];
        for (code, point) in codes.iter().zip(&self.points_m[cube.points.clone()]) {
            moments[voxel(*code)].add(*point - center_m);
        }
        let voxel_m = self.voxel_m(cube);
        let mut computed = CubeDiscs::default();
        for (n, own) in moments.iter().enumerate().filter(|(_, own)| own.count > 0.0) {
            let neighbourhood = neighbourhood_moments(&moments, n);
            let octant = n * 8 / NODE_VOXELS;
            let disc = own.disc(&neighbourhood, voxel_m, self.codes.len() >= MIN_SCAN_POINTS);
            computed.discs[octant].extend(disc.map(|disc| Disc { position_m: disc.position_m + center_m, ..disc }));
        }
        computed.refined = std::array::from_fn(|octant| self.refined(cube, octant));
        computed
    }

    /// An octant of a cube as a cube of finer voxels, if its points suffice.
    fn refined(&self, cube: &OctreeCube, octant: usize) -> Option<OctreeCube> {
        let voxel_bits = cube.voxel_bits.checked_sub(1)?;
        let codes = &self.codes[cube.points.clone()];
        let child_index = |code: u64| (code >> (3 * (voxel_bits + NODE_BITS))) as usize % 8;
        let start = codes.partition_point(|code| child_index(*code) < octant);
        let end = codes.partition_point(|code| child_index(*code) <= octant);
        let voxels = codes[start..end].chunk_by(|a, b| a >> (3 * voxel_bits) == b >> (3 * voxel_bits)).count();
        let has_enough = end > start && end - start >= MIN_POINTS_PER_VOXEL * voxels;
        let points = cube.points.start + start..cube.points.start + end;
        has_enough.then_some(OctreeCube { points, voxel_bits })
    }
}

/// Sums over points.
#[derive(Clone, Copy, Default)]
struct PointMoments {
    count: f32,
    sum: Vec3,
    /// xx, yy, zz.
    squares: Vec3,
    /// yz, zx, xy.
    products: Vec3,
}

impl PointMoments {
    fn add(&mut self, point: Vec3) {
        self.count += 1.0;
        self.sum += point;
        self.squares += point * point;
        self.products += Vec3::new(point.y * point.z, point.z * point.x, point.x * point.y);
    }

    fn add_all(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.products += other.products;
    }

    fn mean(&self) -> Vec3 {
        self.sum / self.count
    }

    /// The disc of a voxel with its neighbourhood's plane. `None` for an outlier.
    fn disc(&self, around: &Self, voxel_m: f32, drops_outliers: bool) -> Option<Disc> {
        let position_m = self.mean();
        if around.count < MIN_POINTS_FOR_PLANE {
            return (!drops_outliers).then_some(Disc { position_m, normal: Vec3::ZERO });
        }
        let (normal, is_flat) = around.normal(voxel_m);
        let off_m = if is_flat { normal.dot(position_m - around.mean()) } else { 0.0 };
        Some(Disc { position_m: position_m - off_m * normal, normal })
    }

    /// The direction of least variance, and whether the points are flat.
    fn normal(&self, voxel_m: f32) -> (Vec3, bool) {
        let mean = self.mean().as_dvec3();
        let count = f64::from(self.count);
        let (squares, products) = (self.squares.as_dvec3() / count, self.products.as_dvec3() / count);
        let [xx, yy, zz] = (squares - mean * mean).to_array();
        let [yz, zx, xy] = [products.x - mean.y * mean.z, products.y - mean.z * mean.x, products.z - mean.x * mean.y];
        // In voxels, so that the tolerance of the decomposition is relative.
        let scale = f64::from(voxel_m).powi(-2);
        let eigen = SymmetricEigen::new(Matrix3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz) * scale);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let axis = eigen.eigenvectors.column(order[0]);
        let normal = Vec3::new(axis[0] as f32, axis[1] as f32, axis[2] as f32).normalize_or_zero();
        (normal, eigen.eigenvalues[order[0]] < FLAT * eigen.eigenvalues[order[1]])
    }
}

/// Moments of the 3×3×3 neighbourhood of a voxel within its node.
fn neighbourhood_moments(moments: &[PointMoments], voxel: usize) -> PointMoments {
    let [x, y, z] = demorton(voxel as u64).to_array().map(|along| along as i32);
    let mut sum = PointMoments::default();
    let is_inside = |along: i32| (0..NODE_SIDE as i32).contains(&along);
    for (dz, dy, dx) in (0..27).map(|n| (n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1)) {
        let neighbour = [x + dx, y + dy, z + dz];
        if neighbour.into_iter().all(is_inside) {
            let [x, y, z] = neighbour.map(|along| along as f32);
            sum.add_all(&moments[morton_code(Vec3::new(x, y, z)) as usize]);
        }
    }
    sum
}
