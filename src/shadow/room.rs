//! Occlusion of light by real objects, to avoid double shadows: light that a real object blocks
//! already is not subtracted a second time (Madsen and Laursen 2007, "A scalable GPU-based approach
//! to shading and shadowing for photo-realistic real-time augmented reality").
//!
//! Measured points of the room are voxels of 2 cm. They are projected onto the plane along each ray
//! of bright light, and from each point of a lamp. Blocked light is left out of both E_without and
//! E_with.
//!
//! A sun is behind all real objects. A panorama's light comes from the first real object in its
//! direction, as seen from the virtual objects, or from beyond all of them. A voxel at less than
//! half of this distance blocks it elsewhere. A lamp's housing blocks nothing.
//!
//! Not modelled: real objects that block the dim light of a uniform sky; surfaces without depth.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use glam::{DVec3, IVec3, Vec2, Vec3};

use super::extent::Extent;
use super::mask::jitter;
use super::receiver_plane::ReceiverPlane;
use super::sky::{PlaneLighting, RaySource, SampledLamp, SkyRay};
use crate::depth::MIN_HEIGHT_OVER_PLANE_M;
use crate::digest::{Digester, Digestible};

/// Side of a voxel, and of the cells of a plane, m.
const VOXEL_M: f32 = 0.02;
/// Minimum number of points in a voxel. A single one may be an error of the sensor.
const MIN_VOXEL_POINTS: u32 = 2;
/// Points closer to the plane than this belong to the plane, m.
pub const MIN_HEIGHT_M: f32 = MIN_HEIGHT_OVER_PLANE_M as f32;
/// Voxels nearer than this fraction of the distance of a panorama's light block it. The distance of
/// one wall differs over the plane.
const MAX_BLOCKER_DISTANCE: f32 = 0.5;
/// Voxels this close to a lamp's point are the lamp's housing, m.
const HOUSING_M: f32 = 0.15;
/// Largest length of a visibility ray, m.
const MAX_RAY_M: f64 = 8.0;
/// Length at the start of a visibility ray that is skipped, m, for surfaces in contact.
const MIN_RAY_M: f64 = 0.06;
/// Largest magnification of the shadow of a voxel close below a lamp.
const MAX_MAGNIFICATION: f32 = 32.0;
/// Maximum number of pieces of a voxel's shadow.
const MAX_PIECES: f32 = 64.0;
/// Number of visibility rays from a facet's cell to a lamp.
const LAMP_RAYS: usize = 8;
/// Rays, and points of a lamp, in a word.
const WORD_BITS: usize = 32;

/// Voxels of the real room, sparse and at fixed places, so that their digest is the same whichever
/// other points were measured. `OccupancyGrid` (analyse/light/occupancy.rs) is another walk: a
/// dense grid from the lowest point on, whose empty blocks millions of rays between any two points
/// skip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// The mean of each voxel's points, in the world, m.
    voxels_m: Vec<DVec3>,
    /// Integer coordinates of the voxels.
    cells: HashSet<IVec3>,
}

impl Room {
    /// The voxels of measured points in the world, m.
    pub fn of(points_m: impl Iterator<Item = DVec3>) -> Self {
        let mut cells: HashMap<IVec3, (DVec3, u32)> = HashMap::new();
        for point_m in points_m.filter(|p| p.is_finite()) {
            let cell = cells.entry(cell_of(point_m)).or_default();
            *cell = (cell.0 + point_m, cell.1 + 1);
        }
        let occupied = cells.into_iter().filter(|(_, (_, count))| *count >= MIN_VOXEL_POINTS);
        let mut voxels: Vec<_> =
            occupied.map(|(cell, (sum, count))| (cell.to_array(), sum / f64::from(count))).collect();
        // Hash maps have a random order.
        voxels.sort_by_key(|(cell, _)| *cell);
        let cells = voxels.iter().map(|(cell, _)| IVec3::from_array(*cell)).collect();
        Self { voxels_m: voxels.into_iter().map(|(_, voxel_m)| voxel_m).collect(), cells }
    }

    /// True if a voxel blocks a ray from a place in the world, m, in a direction of unit length.
    /// Voxels near either end, on the plane by `is_receiver`, or beyond [`MAX_RAY_M`] do not count.
    pub fn blocks(&self, from_m: DVec3, towards: DVec3, far_m: f64, is_receiver: impl Fn(DVec3) -> bool) -> bool {
        let step_m = 0.5 * f64::from(VOXEL_M);
        let far_m = (far_m - f64::from(HOUSING_M)).min(MAX_RAY_M);
        let steps = ((far_m - MIN_RAY_M) / step_m).max(0.0) as usize;
        let at = |n: usize| from_m + (MIN_RAY_M + step_m * n as f64) * towards;
        (0..steps).map(at).any(|at_m| self.cells.contains(&cell_of(at_m)) && !is_receiver(at_m))
    }
}

/// Without the coordinates, which follow from the points.
impl Digestible for Room {
    fn digest(&self, into: &mut Digester) {
        let Self { voxels_m, cells: _ } = self;
        into.add_numbers(voxels_m);
    }
}

fn cell_of(point_m: DVec3) -> IVec3 {
    (point_m / f64::from(VOXEL_M)).floor().as_ivec3()
}

/// Which rays, and which points of lamps, real objects block on the way to cells of a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct OccluderMask {
    low_m: Vec2,
    columns: usize,
    rows: usize,
    /// Bit masks of each 32 rays, one for each cell, by row; empty if none of them is blocked in
    /// any cell.
    rays: Vec<Vec<u32>>,
    /// Bit masks of each lamp's points.
    lamps: Vec<Vec<Vec<u32>>>,
}

/// Projection of a voxel onto the plane.
struct VoxelShadow {
    /// Horizontal offset of the shadow for each metre of height.
    slope: Vec2,
    /// Magnification of the shadow: larger than 1 for a lamp nearby.
    magnification: f32,
    /// Distance of the voxel from its shadow, m.
    distance_m: f32,
}

impl Digestible for OccluderMask {
    fn digest(&self, into: &mut Digester) {
        let Self { low_m, columns, rows, rays, lamps } = self;
        into.add(low_m);
        into.add(columns);
        into.add(rows);
        into.add(&lamps.len());
        for words in std::iter::once(rays).chain(lamps) {
            into.add(&words.len());
            words.iter().for_each(|words| into.add_numbers(words));
        }
    }
}

impl OccluderMask {
    /// Over an extent of a plane. `None` if no light is blocked.
    pub fn of(room: &Room, plane: &ReceiverPlane, extent: Extent, sky: &PlaneLighting) -> Option<Arc<Self>> {
        let from_world = plane.plane_from_world();
        let voxels = room.voxels_m.iter().map(|voxel_m| from_world.transform_point3(*voxel_m).as_vec3());
        let voxels: Vec<Vec3> = voxels.filter(|voxel| voxel.z > MIN_HEIGHT_M).collect();
        let cells = ((extent.high - extent.low) / VOXEL_M).ceil().max(Vec2::ONE);
        let (columns, rows) = (cells.x as usize, cells.y as usize);
        let mut mask = Self { low_m: extent.low, columns, rows, rays: Vec::new(), lamps: Vec::new() };
        mask.rays = mask.words(&sky.rays, |nearest, n, ray| mask.of_ray(nearest, &voxels, n, ray));
        let of_lamp = |lamp: &SampledLamp| {
            mask.words(&lamp.points_m, |nearest, n, point| {
                mask.project(nearest, &voxels, n, |voxel| {
                    let below = point.z - voxel.z;
                    let is_housing = voxel.distance_squared(*point) < HOUSING_M * HOUSING_M;
                    let slope = (point.truncate() - voxel.truncate()) / below;
                    (below > 0.0 && !is_housing).then(|| VoxelShadow {
                        slope,
                        magnification: (point.z / below).min(MAX_MAGNIFICATION),
                        distance_m: 0.0,
                    })
                });
                f32::INFINITY
            })
        };
        // The light of a lamp may graze a facet, where projected shadows would be infinitely long.
        let marched = |lamp: &SampledLamp| mask.by_ray_marching(room, plane, lamp);
        mask.lamps = match sky.back_light {
            Some(_) => sky.lamps.iter().map(marched).collect(),
            None => sky.lamps.iter().map(of_lamp).collect(),
        };
        let is_any = mask.rays.iter().chain(mask.lamps.iter().flatten()).any(|words| !words.is_empty());
        is_any.then(|| Arc::new(mask))
    }

    /// Bit masks of a lamp's blocked points, from a few visibility rays for each cell.
    fn by_ray_marching(&self, room: &Room, plane: &ReceiverPlane, lamp: &SampledLamp) -> Vec<Vec<u32>> {
        let step = lamp.points_m.len().div_ceil(LAMP_RAYS).max(1);
        let mut words = vec![vec![0u32; self.columns * self.rows]; lamp.points_m.len().div_ceil(WORD_BITS)];
        let is_facet = |at_m: DVec3| plane.height_m(at_m) < f64::from(MIN_HEIGHT_M);
        for (n, points) in lamp.points_m.chunks(step).enumerate() {
            let point = points[points.len() / 2].as_dvec3();
            let point_m = plane.at(point.truncate()) + point.z * plane.normal();
            let is_blocked = |cell: &usize| {
                let middle = Vec2::new((cell % self.columns) as f32, (cell / self.columns) as f32) + 0.5;
                let from_m = plane.at((self.low_m + VOXEL_M * middle).as_dvec2());
                let offset = point_m - from_m;
                room.blocks(from_m, offset.normalize_or_zero(), offset.length(), is_facet)
            };
            let blocked: Vec<usize> = (0..self.columns * self.rows).filter(is_blocked).collect();
            for n in n * step..n * step + points.len() {
                let word = &mut words[n / WORD_BITS];
                blocked.iter().for_each(|cell| word[*cell] |= 1 << (n % WORD_BITS));
            }
        }
        words.into_iter().map(|word| if word.iter().any(|bits| *bits != 0) { word } else { Vec::new() }).collect()
    }

    /// Bit masks of the blocked ones of `all`. `project` writes the distance of the nearest voxel
    /// in each cell for one of them, and returns the distance below which a voxel blocks it.
    fn words<T>(&self, all: &[T], projection: impl Fn(&mut [f32], usize, &T) -> f32) -> Vec<Vec<u32>> {
        let mut nearest = vec![f32::INFINITY; self.columns * self.rows];
        let of_word = |(word, some): (usize, &[T])| {
            let mut words = Vec::new();
            for (bit, one) in some.iter().enumerate() {
                nearest.fill(f32::INFINITY);
                let max_distance_m = projection(&mut nearest, word * WORD_BITS + bit, one);
                for (cell, _) in nearest.iter().enumerate().filter(|(_, distance_m)| **distance_m < max_distance_m) {
                    words.resize(self.columns * self.rows, 0);
                    words[cell] |= 1 << bit;
                }
            }
            words
        };
        all.chunks(WORD_BITS).enumerate().map(of_word).collect()
    }

    fn of_ray(&self, nearest: &mut [f32], voxels: &[Vec3], n: usize, ray: &SkyRay) -> f32 {
        if ray.source == RaySource::Dim {
            return 0.0;
        }
        let length = (1.0 + ray.slope.length_squared()).sqrt();
        self.project(nearest, voxels, n, |voxel| {
            Some(VoxelShadow { slope: ray.slope, magnification: 1.0, distance_m: voxel.z * length })
        });
        if ray.source == RaySource::Infinity {
            return f32::INFINITY;
        }
        // Distance of the light from the cells below and around the first object.
        let (x, y) = self.cell(Vec2::ZERO);
        let around = (y.saturating_sub(1)..(y + 2).min(self.rows))
            .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(self.columns)).map(move |x| (x, y)));
        let source = around.map(|(x, y)| nearest[y * self.columns + x]).fold(f32::INFINITY, f32::min);
        MAX_BLOCKER_DISTANCE * source
    }

    /// Writes the distance of the nearest voxel to each cell.
    fn project(
        &self,
        nearest: &mut [f32],
        voxels: &[Vec3],
        n: usize,
        projection: impl Fn(&Vec3) -> Option<VoxelShadow>,
    ) {
        // Each ray samples another position within the cells, to antialias the edge of a real
        // shadow.
        let beside = jitter(n);
        let size = Vec2::new(self.columns as f32, self.rows as f32);
        for (voxel, VoxelShadow { slope, magnification, distance_m }) in
            voxels.iter().filter_map(|voxel| Some((voxel, projection(voxel)?)))
        {
            // A voxel is as wide as a cell. The length of its shadow is proportional to the slope:
            // one piece for each cell of it.
            let pieces = slope.length().ceil().clamp(1.0, MAX_PIECES);
            let half = 0.5 * (magnification - 1.0);
            let reach = 0.5 * magnification * slope.abs() + half;
            let middle = (voxel.truncate() - slope * voxel.z - self.low_m) / VOXEL_M + beside - 0.5;
            if (middle + reach).cmple(Vec2::NEG_ONE).any() || (middle - reach).cmpge(size).any() {
                continue;
            }
            for piece in 0..pieces as i32 {
                let at = middle + magnification * slope * ((piece as f32 + 0.5) / pieces - 0.5);
                let (low, high) = ((at - half).floor().max(Vec2::ZERO), ((at + half).floor() + 1.0).min(size - 1.0));
                for y in low.y as i32..=high.y as i32 {
                    for x in low.x as i32..=high.x as i32 {
                        let cell = &mut nearest[y as usize * self.columns + x as usize];
                        *cell = cell.min(distance_m);
                    }
                }
            }
        }
    }

    fn cell(&self, place_m: Vec2) -> (usize, usize) {
        let at = ((place_m - self.low_m) / VOXEL_M).max(Vec2::ZERO);
        ((at.x as usize).min(self.columns - 1), (at.y as usize).min(self.rows - 1))
    }

    fn at(&self, words: &[u32], place_m: Vec2) -> u32 {
        if words.is_empty() {
            return 0;
        }
        let (x, y) = self.cell(place_m);
        words[y * self.columns + x]
    }

    /// The light that is not blocked at a place below the objects. Objects reflect it onto the
    /// plane around them.
    pub fn unblocked(&self, sky: &PlaneLighting, at_m: Vec2) -> PlaneLighting {
        let mut rays = sky.rays.to_vec();
        for (n, ray) in rays.iter_mut().enumerate() {
            if self.rays(n / WORD_BITS, at_m) >> (n % WORD_BITS) & 1 == 1 {
                ray.light = Vec3::ZERO;
            }
        }
        let unblocked_lamp = |(number, lamp): (usize, &SampledLamp)| {
            let words = (0..lamp.points_m.len().div_ceil(WORD_BITS)).map(|n| self.lamp(number, n, at_m));
            let blocked: u32 = words.map(u32::count_ones).sum();
            lamp.scaled(1.0 - blocked as f32 / lamp.points_m.len().max(1) as f32)
        };
        let light = rays.iter().map(|ray| ray.light).sum();
        PlaneLighting {
            rays: rays.into(),
            lamps: sky.lamps.iter().enumerate().map(unblocked_lamp).collect(),
            light,
            back_light: sky.back_light.clone(),
        }
    }

    /// True if any of the 32 rays from `32 · n` on is blocked anywhere.
    pub fn blocks_any(&self, n: usize) -> bool {
        self.rays.get(n).is_some_and(|words| !words.is_empty())
    }

    /// Bit mask of the blocked ones of the 32 rays from `32 · n` on, at a place on the plane.
    pub fn rays(&self, n: usize, place_m: Vec2) -> u32 {
        self.rays.get(n).map_or(0, |words| self.at(words, place_m))
    }

    /// Bit mask of the blocked ones of a lamp's 32 points from `32 · n` on.
    pub fn lamp(&self, lamp: usize, n: usize, place_m: Vec2) -> u32 {
        self.lamps.get(lamp).and_then(|lamp| lamp.get(n)).map_or(0, |words| self.at(words, place_m))
    }
}

#[cfg(test)]
mod tests {
    use super::super::block::block;
    use super::*;
    use crate::plane::Plane;
    use crate::scene::{Environment, EnvironmentMap, Lighting, Material, Object, Part, PointLight, Scene, Sun};
    use crate::shadow::{PlanarShadow, Shadows};
    use glam::{DAffine3, DVec2, Quat};

    /// A black box of 8 × 8 × 10 cm on the floor z = 0.
    fn scene(lighting: Lighting, at: DVec2) -> Scene {
        colored(lighting, at, 0.0)
    }

    /// A box of a grey colour.
    fn colored(lighting: Lighting, at: DVec2, grey: f32) -> Scene {
        let part = Part { mesh: 0, world_from_mesh: DAffine3::from_translation(at.extend(0.05)) };
        let support = Some(Plane { point_m: DVec3::ZERO, normal: DVec3::Z });
        Scene {
            meshes: vec![Arc::new(block(Vec3::new(0.04, 0.04, 0.05)))],
            materials: vec![Material { base_color: [grey, grey, grey, 1.0], ..Material::default() }],
            objects: vec![Object { parts: vec![part], support, ..Object::default() }],
            lighting,
            ..Scene::default()
        }
    }

    /// Measured points, every 9 mm, of a wall in the plane x = 1.2 m, 3 m wide and 2 m high.
    fn wall() -> Arc<Room> {
        let points = (0..320).flat_map(|y| (0..215).map(move |z| (y, z)));
        let point = |(y, z): (i32, i32)| DVec3::new(1.2, 0.0094 * f64::from(y) - 1.5, 0.0093 * f64::from(z));
        Arc::new(Room::of(points.map(point)))
    }

    fn planar_shadow(scene: &Scene, room: Option<Arc<Room>>) -> PlanarShadow {
        let mut shadows = Shadows::new(scene);
        shadows.set_room(room);
        shadows.planar_shadows(scene, crate::quality::Quality::Final).0.remove(0)
    }

    /// Mean and largest difference between two planar shadows around a place.
    fn difference(a: &PlanarShadow, b: &PlanarShadow, middle: DVec2) -> [f32; 2] {
        let places = (-12..=12).flat_map(|x| (-12..=12).map(move |y| 0.01 * DVec2::new(x.into(), y.into())));
        let difference_at = |place: DVec2| {
            let at = (middle + place).extend(0.0);
            (a.removed_at(at) - b.removed_at(at)).abs().max_element()
        };
        let all: Vec<f32> = places.map(difference_at).collect();
        [all.iter().sum::<f32>() / all.len() as f32, all.into_iter().fold(0.0, f32::max)]
    }

    fn sky(suns: Vec<Sun>, points: Vec<PointLight>) -> Lighting {
        Lighting { environment: Environment::Uniform(Vec3::ONE), suns, points }
    }

    /// Low in the east, behind the wall, whose shadow reaches 2.4 m to the west.
    fn sun() -> Sun {
        let towards_light_in_world = Vec3::new(0.78, 0.0, 0.6).normalize();
        Sun { towards_light_in_world, color: Vec3::splat(3.0), diameter_rad: 0.01 }
    }

    fn lamp(x: f64) -> PointLight {
        let position_in_world_m = DVec3::new(x, 0.0, 1.0);
        PointLight {
            position_in_world_m,
            color: Vec3::splat(4.0),
            diameter_m: 0.05,
            range_m: f32::INFINITY,
            spot: None,
        }
    }

    #[test]
    fn shadow_behind_a_wall_is_that_of_the_sky_alone() {
        // The lamp is near and at a grazing angle: a few of its points are visible between voxels.
        let lights = [(sky(vec![sun()], Vec::new()), 0.001, 0.03), (sky(Vec::new(), vec![lamp(2.4)]), 0.003, 0.08)];
        for (lighting, max_mean, max_largest) in lights {
            let behind = scene(lighting, DVec2::ZERO);
            let (alone, twice) =
                (planar_shadow(&scene(sky(Vec::new(), Vec::new()), DVec2::ZERO), None), planar_shadow(&behind, None));
            let once = planar_shadow(&behind, Some(wall()));
            // A shadow without the blocked light is smaller: its texels have another size, which is
            // visible at the object's foot, and it fades out closer to the object.
            let [mean, largest] = difference(&once, &alone, DVec2::ZERO);
            assert!(mean < max_mean && largest < max_largest, "{mean} {largest}");
            let [mean, largest] = difference(&twice, &alone, DVec2::ZERO);
            assert!(mean > 0.02 && largest > 0.1, "{mean} {largest}");
        }
    }

    #[test]
    fn white_object_does_not_reflect_blocked_light_and_is_unaffected_in_front_of_the_wall() {
        let lighting = sky(vec![sun()], Vec::new());
        let white = |lighting: &Lighting| colored(lighting.clone(), DVec2::ZERO, 0.8);
        let alone = planar_shadow(&white(&sky(Vec::new(), Vec::new())), None);
        let [mean, _] = difference(&planar_shadow(&white(&lighting), Some(wall())), &alone, DVec2::ZERO);
        assert!(mean < 0.002, "{mean}");
        // In front of the wall no light is blocked: the planar shadows are identical.
        let front = scene(lighting, DVec2::new(2.0, 0.0));
        assert_eq!(*planar_shadow(&front, Some(wall())).texture, *planar_shadow(&front, None).texture);
    }

    #[test]
    fn virtual_shadow_begins_at_the_edge_of_the_real_one() {
        // The wall is 2 m high: the edge of its shadow is at 1.2 − 2 · 0.78/0.6 = −1.4 m, below the
        // object.
        let edge = scene(sky(vec![sun()], Vec::new()), DVec2::new(-1.4, 0.0));
        let (once, all) = (planar_shadow(&edge, Some(wall())), planar_shadow(&edge, None));
        let alone = planar_shadow(&scene(sky(Vec::new(), Vec::new()), DVec2::new(-1.4, 0.0)), None);
        let at = |planar_shadow: &PlanarShadow, x: f64| planar_shadow.removed_at(DVec3::new(x, 0.0, 0.0)).x;
        // East of the edge the wall blocks the sun, west of it the object does, to within two
        // voxels.
        assert!((at(&once, -1.35) - at(&alone, -1.35)).abs() < 0.01, "{} {}", at(&once, -1.35), at(&alone, -1.35));
        assert!((at(&once, -1.47) - at(&all, -1.47)).abs() < 0.01, "{} {}", at(&once, -1.47), at(&all, -1.47));
        assert!(at(&all, -1.47) > at(&alone, -1.47) + 0.2);
    }

    #[test]
    fn walls_of_the_panorama_and_the_housing_of_a_lamp_block_nothing() {
        // A bright window in the wall, in a panorama from the place of the objects.
        let window = |i: usize| if i % 64 == 40 && (20..24).contains(&(i / 64)) { [900.0; 3] } else { [1.0; 3] };
        let map = EnvironmentMap {
            width: 64,
            height: 32,
            rgb: (0..64 * 32).map(window).collect::<Vec<_>>().into(),
            map_from_world: Quat::IDENTITY,
            color: Vec3::ONE,
        };
        let lighting = Lighting { environment: Environment::Map(map), ..Lighting::default() };
        let scene_of = |lighting: &Lighting| scene(lighting.clone(), DVec2::ZERO);
        let around: Vec<DVec3> = {
            // A spherical room with a radius of 2 m: every ray hits it.
            let directions = (0..200_000).map(|n| {
                let z = 1.0 - 2.0 * (f64::from(n) + 0.5) / 200_000.0;
                let (sin, cos) = (f64::from(n) * 2.399_963_229_728_653).sin_cos();
                DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
            });
            directions.flat_map(|towards| [2.0 * towards, 2.001 * towards]).collect()
        };
        let room = Arc::new(Room::of(around.into_iter()));
        assert_eq!(
            *planar_shadow(&scene_of(&lighting), Some(room.clone())).texture,
            *planar_shadow(&scene_of(&lighting), None).texture
        );
        // A lamp at the wall of the room.
        let lit = sky(Vec::new(), vec![PointLight { position_in_world_m: DVec3::new(1.2, 0.0, 1.6), ..lamp(0.0) }]);
        assert_eq!(*planar_shadow(&scene_of(&lit), Some(room)).texture, *planar_shadow(&scene_of(&lit), None).texture);
    }

    #[test]
    fn voxel_needs_two_points_in_any_order() {
        let points = [DVec3::new(0.011, 0.01, 0.5), DVec3::new(0.013, 0.012, 0.502), DVec3::new(0.3, 0.0, 0.5)];
        let room = Room::of(points.into_iter());
        assert_eq!(room.voxels_m.len(), 1);
        assert!(room.voxels_m[0].abs_diff_eq(DVec3::new(0.012, 0.011, 0.501), 1e-12));
        assert_eq!(room, Room::of(points.into_iter().rev()));
    }
}
