//! What real things keep from a floor: light that they stop already is not taken a second time (Madsen and Laursen 2007, "A
//! scalable GPU-based approach to shading and shadowing for photo-realistic real-time augmented reality").
//!
//! Points of the room that depth has measured are solids of 2 cm. Along each ray of bright light, and from each point of a lamp,
//! they are laid onto the floor. Where one lies that light is not there: neither E_without nor E_with has it.
//!
//! A sun shines from behind everything. A panorama's light comes from the first real thing that is met in its direction from
//! where things stand, or from beyond all; what is less than half as far stops it elsewhere. A lamp's own housing stops nothing.
//!
//! Not modelled: dim light, an even sky's, of which real things stop some too; what no depth map has seen.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use glam::{DVec3, IVec3, Vec2, Vec3};

use super::extent::Extent;
use super::floor::Floor;
use super::mask::jitter;
use super::sky::{Lamp, Ray, Sky, Source};
use crate::digest::{Digester, Digestible};

/// Side of a solid, and of the cells of a floor in which its shadow is told, metres.
const SIDE_M: f32 = 0.02;
/// Points that make a solid: one alone may be an error of the sensor.
const FEWEST: u32 = 2;
/// What is lower than this over a floor is the floor, metres.
pub const ABOVE_M: f32 = 0.03;
/// A solid stops what a panorama shows if it is nearer than this share of the way there: elsewhere on the floor the same wall is
/// met nearer, or farther.
const NEARER: f32 = 0.5;
/// What is this near to a lamp's point is the lamp itself, metres.
const HOUSING_M: f32 = 0.15;
/// Real things are looked for so far from a thing, metres.
const FARTHEST_M: f64 = 8.0;
/// What is this near to a thing touches it, metres.
const TOUCHES_M: f64 = 0.06;
/// A solid close below a lamp throws no wider shadow than this.
const WIDEST: f32 = 32.0;
/// Of a shadow that is longer than so many cells, pieces are looked at.
const MOST_PIECES: f32 = 64.0;
/// Points of a lamp by which a facet's cells ask for it.
const MARCHED: usize = 8;
/// Rays, and points of a lamp, in a word.
const AT_A_TIME: usize = 32;

/// Real things, as solids.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// The mean of each solid's points, in the world, metres.
    solids_m: Vec<DVec3>,
    /// The cells that they are in, sides.
    cells: HashSet<IVec3>,
}

impl Room {
    /// Of points that were measured, in the world, metres.
    pub fn of(points_m: impl Iterator<Item = DVec3>) -> Self {
        let mut cells: HashMap<IVec3, (DVec3, u32)> = HashMap::new();
        for point_m in points_m.filter(|p| p.is_finite()) {
            let cell = cells.entry(cell_of(point_m)).or_default();
            *cell = (cell.0 + point_m, cell.1 + 1);
        }
        let known = cells.into_iter().filter(|(_, (_, count))| *count >= FEWEST);
        let mut solids: Vec<_> = known.map(|(cell, (sum, count))| (cell.to_array(), sum / f64::from(count))).collect();
        // The same order in every run.
        solids.sort_by_key(|(cell, _)| *cell);
        let cells = solids.iter().map(|(cell, _)| IVec3::from_array(*cell)).collect();
        Self { solids_m: solids.into_iter().map(|(_, solid_m)| solid_m).collect(), cells }
    }

    /// Whether something stands between a place and what lies so far away in a direction of unit length, in the world, metres. What
    /// the place touches, the floor that `is_floor` knows, and a lamp's housing do not count, nor what is very far away.
    pub fn stands_between(&self, from_m: DVec3, towards: DVec3, far_m: f64, is_floor: impl Fn(DVec3) -> bool) -> bool {
        let step_m = 0.5 * f64::from(SIDE_M);
        let far_m = (far_m - f64::from(HOUSING_M)).min(FARTHEST_M);
        let steps = ((far_m - TOUCHES_M) / step_m).max(0.0) as usize;
        let at = |n: usize| from_m + (TOUCHES_M + step_m * n as f64) * towards;
        (0..steps).map(at).any(|at_m| self.cells.contains(&cell_of(at_m)) && !is_floor(at_m))
    }
}

/// The cells follow from the solids.
impl Digestible for Room {
    fn digest(&self, into: &mut Digester) {
        let Self { solids_m, cells: _ } = self;
        into.add_numbers(solids_m);
    }
}

fn cell_of(point_m: DVec3) -> IVec3 {
    (point_m / f64::from(SIDE_M)).floor().as_ivec3()
}

/// Which rays, and which points of lamps, real objects block on the way to cells of a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct OccluderMask {
    low_m: Vec2,
    columns: usize,
    rows: usize,
    /// For each 32 rays a bit mask for each cell, by row; empty where none of them is blocked in any cell.
    rays: Vec<Vec<u32>>,
    /// The same of each lamp's points.
    lamps: Vec<Vec<Vec<u32>>>,
}

/// How a solid is laid onto the floor.
struct Laid {
    /// How far its shadow falls for each metre of height.
    slope: Vec2,
    /// How much wider its shadow is than it: a lamp nearby throws a larger one.
    wide: f32,
    /// How far it is from there, metres.
    near: f32,
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
    pub fn of(room: &Room, floor: &Floor, extent: Extent, sky: &Sky) -> Option<Arc<Self>> {
        let from_world = floor.floor_from_world();
        let solids = room.solids_m.iter().map(|solid_m| from_world.transform_point3(*solid_m).as_vec3());
        let solids: Vec<Vec3> = solids.filter(|solid| solid.z > ABOVE_M).collect();
        let cells = ((extent.high - extent.low) / SIDE_M).ceil().max(Vec2::ONE);
        let (columns, rows) = (cells.x as usize, cells.y as usize);
        let mut stops = Self { low_m: extent.low, columns, rows, rays: Vec::new(), lamps: Vec::new() };
        stops.rays = stops.words(&sky.rays, |nearest, n, ray| stops.of_ray(nearest, &solids, n, ray));
        let of_lamp = |lamp: &Lamp| {
            stops.words(&lamp.points_m, |nearest, n, point| {
                stops.lay(nearest, &solids, n, |solid| {
                    let below = point.z - solid.z;
                    let is_housing = solid.distance_squared(*point) < HOUSING_M * HOUSING_M;
                    let slope = (point.truncate() - solid.truncate()) / below;
                    (below > 0.0 && !is_housing).then(|| Laid { slope, wide: (point.z / below).min(WIDEST), near: 0.0 })
                });
                f32::INFINITY
            })
        };
        // A lamp may shine along a facet, where what is laid onto it would be without end.
        let along = |lamp: &Lamp| stops.marched(room, floor, lamp);
        stops.lamps = match sky.behind {
            Some(_) => sky.lamps.iter().map(along).collect(),
            None => sky.lamps.iter().map(of_lamp).collect(),
        };
        let is_any = stops.rays.iter().chain(stops.lamps.iter().flatten()).any(|words| !words.is_empty());
        is_any.then(|| Arc::new(stops))
    }

    /// Which of a lamp's points are stopped, asked for by a few of them from each cell.
    fn marched(&self, room: &Room, floor: &Floor, lamp: &Lamp) -> Vec<Vec<u32>> {
        let step = lamp.points_m.len().div_ceil(MARCHED).max(1);
        let mut words = vec![vec![0u32; self.columns * self.rows]; lamp.points_m.len().div_ceil(AT_A_TIME)];
        let is_facet = |at_m: DVec3| floor.height_m(at_m) < f64::from(ABOVE_M);
        for (n, points) in lamp.points_m.chunks(step).enumerate() {
            let point = points[points.len() / 2].as_dvec3();
            let point_m = floor.at(point.truncate()) + point.z * floor.normal();
            let is_stopped = |cell: &usize| {
                let middle = Vec2::new((cell % self.columns) as f32, (cell / self.columns) as f32) + 0.5;
                let from_m = floor.at((self.low_m + SIDE_M * middle).as_dvec2());
                let way = point_m - from_m;
                room.stands_between(from_m, way.normalize_or_zero(), way.length(), is_facet)
            };
            let stopped: Vec<usize> = (0..self.columns * self.rows).filter(is_stopped).collect();
            for n in n * step..n * step + points.len() {
                let word = &mut words[n / AT_A_TIME];
                stopped.iter().for_each(|cell| word[*cell] |= 1 << (n % AT_A_TIME));
            }
        }
        words.into_iter().map(|word| if word.iter().any(|bits| *bits != 0) { word } else { Vec::new() }).collect()
    }

    /// Words of which bits are stopped. `laid` gives for one of `all` how near the nearest solid is in each cell, and how near it
    /// has to be to stop it.
    fn words<T>(&self, all: &[T], laid: impl Fn(&mut [f32], usize, &T) -> f32) -> Vec<Vec<u32>> {
        let mut nearest = vec![f32::INFINITY; self.columns * self.rows];
        let of_word = |(word, some): (usize, &[T])| {
            let mut words = Vec::new();
            for (bit, one) in some.iter().enumerate() {
                nearest.fill(f32::INFINITY);
                let nearer_than = laid(&mut nearest, word * AT_A_TIME + bit, one);
                for (cell, _) in nearest.iter().enumerate().filter(|(_, near)| **near < nearer_than) {
                    words.resize(self.columns * self.rows, 0);
                    words[cell] |= 1 << bit;
                }
            }
            words
        };
        all.chunks(AT_A_TIME).enumerate().map(of_word).collect()
    }

    fn of_ray(&self, nearest: &mut [f32], solids: &[Vec3], n: usize, ray: &Ray) -> f32 {
        if ray.source == Source::Dim {
            return 0.0;
        }
        let length = (1.0 + ray.slope.length_squared()).sqrt();
        self.lay(nearest, solids, n, |solid| Some(Laid { slope: ray.slope, wide: 1.0, near: solid.z * length }));
        if ray.source == Source::Beyond {
            return f32::INFINITY;
        }
        // Seen from where things stand, below the first of them, and around there.
        let (x, y) = self.cell(Vec2::ZERO);
        let around = (y.saturating_sub(1)..(y + 2).min(self.rows))
            .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(self.columns)).map(move |x| (x, y)));
        let source = around.map(|(x, y)| nearest[y * self.columns + x]).fold(f32::INFINITY, f32::min);
        NEARER * source
    }

    /// How near the nearest solid is in each cell.
    fn lay(&self, nearest: &mut [f32], solids: &[Vec3], n: usize, laid: impl Fn(&Vec3) -> Option<Laid>) {
        // Each looks at another place within the cells, so that the edge of a real shadow has no steps.
        let beside = jitter(n);
        let size = Vec2::new(self.columns as f32, self.rows as f32);
        for (solid, Laid { slope, wide, near }) in solids.iter().filter_map(|solid| Some((solid, laid(solid)?))) {
            // A solid is as wide as a cell, and its shadow as long as the ray is flat: a piece for each of its cells.
            let pieces = slope.length().ceil().clamp(1.0, MOST_PIECES);
            let half = 0.5 * (wide - 1.0);
            let reach = 0.5 * wide * slope.abs() + half;
            let middle = (solid.truncate() - slope * solid.z - self.low_m) / SIDE_M + beside - 0.5;
            if (middle + reach).cmple(Vec2::NEG_ONE).any() || (middle - reach).cmpge(size).any() {
                continue;
            }
            for piece in 0..pieces as i32 {
                let at = middle + wide * slope * ((piece as f32 + 0.5) / pieces - 0.5);
                let (low, high) = ((at - half).floor().max(Vec2::ZERO), ((at + half).floor() + 1.0).min(size - 1.0));
                for y in low.y as i32..=high.y as i32 {
                    for x in low.x as i32..=high.x as i32 {
                        let cell = &mut nearest[y as usize * self.columns + x as usize];
                        *cell = cell.min(near);
                    }
                }
            }
        }
    }

    fn cell(&self, place_m: Vec2) -> (usize, usize) {
        let at = ((place_m - self.low_m) / SIDE_M).max(Vec2::ZERO);
        ((at.x as usize).min(self.columns - 1), (at.y as usize).min(self.rows - 1))
    }

    fn at(&self, words: &[u32], place_m: Vec2) -> u32 {
        if words.is_empty() {
            return 0;
        }
        let (x, y) = self.cell(place_m);
        words[y * self.columns + x]
    }

    /// Light without what is stopped at a place among the things: what they throw onto the floor around them.
    pub fn left(&self, sky: &Sky, at_m: Vec2) -> Sky {
        let mut rays = sky.rays.to_vec();
        for (n, ray) in rays.iter_mut().enumerate() {
            if self.rays(n / AT_A_TIME, at_m) >> (n % AT_A_TIME) & 1 == 1 {
                ray.light = Vec3::ZERO;
            }
        }
        let open = |(number, lamp): (usize, &Lamp)| {
            let words = (0..lamp.points_m.len().div_ceil(AT_A_TIME)).map(|n| self.lamp(number, n, at_m));
            let stopped: u32 = words.map(u32::count_ones).sum();
            lamp.dimmed(1.0 - stopped as f32 / lamp.points_m.len().max(1) as f32)
        };
        let light = rays.iter().map(|ray| ray.light).sum();
        Sky {
            rays: rays.into(),
            lamps: sky.lamps.iter().enumerate().map(open).collect(),
            light,
            behind: sky.behind.clone(),
        }
    }

    /// Whether any of the 32 rays from `32 · n` on is stopped anywhere.
    pub fn blocks_any(&self, n: usize) -> bool {
        self.rays.get(n).is_some_and(|words| !words.is_empty())
    }

    /// Those of the 32 rays from `32 · n` on that are stopped at a place of the floor, as bits.
    pub fn rays(&self, n: usize, place_m: Vec2) -> u32 {
        self.rays.get(n).map_or(0, |words| self.at(words, place_m))
    }

    /// The same of a lamp's points.
    pub fn lamp(&self, lamp: usize, n: usize, place_m: Vec2) -> u32 {
        self.lamps.get(lamp).and_then(|lamp| lamp.get(n)).map_or(0, |words| self.at(words, place_m))
    }
}

#[cfg(test)]
mod tests {
    use super::super::block::block;
    use super::*;
    use crate::scene::Support;
    use crate::scene::{Environment, EnvironmentMap, Lighting, Material, Object, Part, PointLight, Scene, Sun};
    use crate::shadow::{ShadowMap, Shadows};
    use glam::{DAffine3, DVec2, Quat};

    /// A black box of 8 × 8 × 10 cm on the floor z = 0.
    fn scene(lighting: Lighting, at: DVec2) -> Scene {
        colored(lighting, at, 0.0)
    }

    /// The same in a grey.
    fn colored(lighting: Lighting, at: DVec2, grey: f32) -> Scene {
        let part = Part { mesh: 0, world_from_mesh: DAffine3::from_translation(at.extend(0.05)) };
        let support = Some(Support { point_m: DVec3::ZERO, normal: DVec3::Z });
        Scene {
            meshes: vec![Arc::new(block(Vec3::new(0.04, 0.04, 0.05)))],
            materials: vec![Material { base_color: [grey, grey, grey, 1.0], ..Material::default() }],
            objects: vec![Object { parts: vec![part], support, ..Object::default() }],
            lighting,
            ..Scene::default()
        }
    }

    /// A wall in the plane x = 1.2 m, 3 m wide and 2 m high, as a sensor sees it: points every 9 mm.
    fn wall() -> Arc<Room> {
        let points = (0..320).flat_map(|y| (0..215).map(move |z| (y, z)));
        let point = |(y, z): (i32, i32)| DVec3::new(1.2, 0.0094 * f64::from(y) - 1.5, 0.0093 * f64::from(z));
        Arc::new(Room::of(points.map(point)))
    }

    fn shadow_map(scene: &Scene, room: Option<Arc<Room>>) -> ShadowMap {
        let mut shadows = Shadows::new(scene);
        shadows.set_room(room);
        shadows.shadow_maps(scene, crate::quality::Quality::Final).0.remove(0)
    }

    /// The difference between two shadow maps around a place: on the mean, and at most.
    fn apart(a: &ShadowMap, b: &ShadowMap, middle: DVec2) -> [f32; 2] {
        let places = (-12..=12).flat_map(|x| (-12..=12).map(move |y| 0.01 * DVec2::new(x.into(), y.into())));
        let off = |place: DVec2| {
            let at = (middle + place).extend(0.0);
            (a.taken_at(at) - b.taken_at(at)).abs().max_element()
        };
        let all: Vec<f32> = places.map(off).collect();
        [all.iter().sum::<f32>() / all.len() as f32, all.into_iter().fold(0.0, f32::max)]
    }

    fn sky(suns: Vec<Sun>, points: Vec<PointLight>) -> Lighting {
        Lighting { environment: Environment::Uniform(Vec3::ONE), suns, points }
    }

    /// Low in the east, behind the wall: its shadow reaches 2.4 m to the west of it.
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
    fn behind_a_wall_the_sky_alone_is_taken() {
        // The lamp is near and looks flatly over the solids: a few of its points are seen between them.
        let lights = [(sky(vec![sun()], Vec::new()), 0.001, 0.03), (sky(Vec::new(), vec![lamp(2.4)]), 0.003, 0.08)];
        for (lighting, mean_off, most_off) in lights {
            let behind = scene(lighting, DVec2::ZERO);
            let (alone, twice) =
                (shadow_map(&scene(sky(Vec::new(), Vec::new()), DVec2::ZERO), None), shadow_map(&behind, None));
            let once = shadow_map(&behind, Some(wall()));
            // Another light's shadow reaches less far: its texels have another size, which shows at the thing's foot, and it
            // fades out nearer.
            let [mean, most] = apart(&once, &alone, DVec2::ZERO);
            assert!(mean < mean_off && most < most_off, "{mean} {most}");
            let [mean, most] = apart(&twice, &alone, DVec2::ZERO);
            assert!(mean > 0.02 && most > 0.1, "{mean} {most}");
        }
    }

    #[test]
    fn a_white_thing_throws_back_no_light_that_is_stopped_and_in_front_of_the_wall_nothing_is() {
        let lighting = sky(vec![sun()], Vec::new());
        let white = |lighting: &Lighting| colored(lighting.clone(), DVec2::ZERO, 0.8);
        let alone = shadow_map(&white(&sky(Vec::new(), Vec::new())), None);
        let [mean, _] = apart(&shadow_map(&white(&lighting), Some(wall())), &alone, DVec2::ZERO);
        assert!(mean < 0.002, "{mean}");
        // There its light comes unhindered: not even the shadow map is another one.
        let front = scene(lighting, DVec2::new(2.0, 0.0));
        assert_eq!(shadow_map(&front, Some(wall())).texture, shadow_map(&front, None).texture);
    }

    #[test]
    fn where_a_real_shadow_ends_the_virtual_one_begins() {
        // The wall is 2 m high: its shadow's edge lies at 1.2 − 2 · 0.78/0.6 = −1.4 m, below the thing's western side.
        let edge = scene(sky(vec![sun()], Vec::new()), DVec2::new(-1.4, 0.0));
        let (once, all) = (shadow_map(&edge, Some(wall())), shadow_map(&edge, None));
        let alone = shadow_map(&scene(sky(Vec::new(), Vec::new()), DVec2::new(-1.4, 0.0)), None);
        let at = |shadow_map: &ShadowMap, x: f64| shadow_map.taken_at(DVec3::new(x, 0.0, 0.0)).x;
        // East of the edge the sun is gone already, west of it the thing takes it; within two solids between.
        assert!((at(&once, -1.35) - at(&alone, -1.35)).abs() < 0.01, "{} {}", at(&once, -1.35), at(&alone, -1.35));
        assert!((at(&once, -1.47) - at(&all, -1.47)).abs() < 0.01, "{} {}", at(&once, -1.47), at(&all, -1.47));
        assert!(at(&all, -1.47) > at(&alone, -1.47) + 0.2);
    }

    #[test]
    fn what_a_panorama_shows_shines_and_a_lamp_s_housing_stops_nothing() {
        // A bright window in the wall, as a panorama taken where things stand has it.
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
            // A room all around, 2 m away: every ray meets it.
            let directions = (0..200_000).map(|n| {
                let z = 1.0 - 2.0 * (f64::from(n) + 0.5) / 200_000.0;
                let (sin, cos) = (f64::from(n) * 2.399_963_229_728_653).sin_cos();
                DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
            });
            directions.flat_map(|towards| [2.0 * towards, 2.001 * towards]).collect()
        };
        let room = Arc::new(Room::of(around.into_iter()));
        assert_eq!(
            shadow_map(&scene_of(&lighting), Some(room.clone())).texture,
            shadow_map(&scene_of(&lighting), None).texture
        );
        // A lamp that hangs at the room's own wall.
        let lit = sky(Vec::new(), vec![PointLight { position_in_world_m: DVec3::new(1.2, 0.0, 1.6), ..lamp(0.0) }]);
        assert_eq!(shadow_map(&scene_of(&lit), Some(room)).texture, shadow_map(&scene_of(&lit), None).texture);
    }

    #[test]
    fn one_point_alone_is_no_solid_and_their_order_changes_nothing() {
        let points = [DVec3::new(0.011, 0.01, 0.5), DVec3::new(0.013, 0.012, 0.502), DVec3::new(0.3, 0.0, 0.5)];
        let room = Room::of(points.into_iter());
        assert_eq!(room.solids_m.len(), 1);
        assert!(room.solids_m[0].abs_diff_eq(DVec3::new(0.012, 0.011, 0.501), 1e-12));
        assert_eq!(room, Room::of(points.into_iter().rev()));
    }
}
