//! Light that reaches a thing's own surface: less where it, or what lies beside it, stands in the way, more where those throw light
//! onto it.
//!
//! Things stand still, so that is worked out once, for each texel of a thing's lightmap (render/unwrap.rs):
//!
//! - of the surroundings the share a = Σ light·cos θ of the rays that meet nothing, over all rays; a ray that goes down onto a
//!   floor brings what the things' shadow leaves there (the shadow map);
//! - the light b that is thrown back by what the other rays meet: its colour times the light E on it, b = Σ ρ·E·cos θ·Δω/π. E is
//!   asked once for a part's triangles that lie together and face the same way, in the middle of the first of them;
//! - of each sun and lamp the share of its disc that is seen.
//!
//! A white matt surface then shows a·(what it would show alone) + b + the lamps by their shares. Rays below a triangle's own plane
//! are not asked: a curved surface of flat pieces would shade itself at their edges (the terminator).
//!
//! Not modelled: light that is thrown to and fro more than once; a shadow's edge within a group of triangles; mirrors; what is seen
//! through glass; what real things beside the floor take or throw.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::OnceLock;

use glam::{DVec3, Mat3, Vec3};

use super::bvh::{Bundle, Bvh, RAYS};
use super::occluders::Occluders;
use super::shadow_map::ShadowMap;
use super::sky::{EnvSample, disc, on_surface};
use crate::digest::{Digester, Digestible};
use crate::parallel::{over_rows, processors};
use crate::render::{Lightmap, TexelPoint, Unwrapped};
use crate::scene::{Lighting, PointLight};

/// Points of a sun's or a lamp's disc.
const DISC: usize = 16;
/// Of how many texels in a row one is asked first.
const FIRST: i32 = 4;
/// Shares of light that are nearly the same, and normals (cosine of 11°).
const ALIKE: f32 = 0.04;
const ONE_WAY: f32 = 0.98;
/// Of the light on what throws some of it onto others, one ray in so many is asked.
const ASKED_OF: usize = 4;
/// Cells along a part's longest side, and steps along each axis of a direction for 1: a part's triangles of one cell whose normals
/// round to the same steps, at most 40° apart, get the same light. A cartridge case of 6240
/// triangles has 1483 such groups, a marker of 2648 has 916.
const CELLS: f32 = 12.0;
const WAYS: f32 = 2.0;
/// Texels that a thread takes at a time.
const AT_A_TIME: usize = 32;
/// A ray begins this far from its surface, as a share of the things' size: single precision is a hundred times finer.
const BESIDE: f32 = 2e-5;
/// A layer's texel where nothing is shown: all the light.
const OPEN: [f32; 4] = [1.0; 4];

/// The things in which a part stands, around a place of the world.
pub struct Among<'a> {
    pub origin_m: DVec3,
    pub occluders: &'a Occluders,
    pub far: &'a [EnvSample],
    pub lighting: &'a Lighting,
    pub floors: &'a [ShadowMap],
    /// So many suns and lamps are drawn.
    pub most: [usize; 2],
}

impl Digestible for Among<'_> {
    fn digest(&self, into: &mut Digester) {
        let Self { origin_m, occluders, far, lighting, floors, most } = self;
        // `far` is the environment's light.
        let Lighting { environment: _, suns, points } = lighting;
        into.add(origin_m);
        into.add(occluders);
        into.add(*far);
        into.add(suns);
        into.add(points);
        into.add(*floors);
        into.add_numbers(most);
    }
}

/// A sun or a lamp: where the points of its disc are, and how bright a white matt surface is by it.
enum Light<'a> {
    Sun(Vec<Vec3>, Vec3),
    Lamp(Vec<Vec3>, &'a PointLight, Vec3),
}

/// A place of a surface.
struct Spot {
    at: Vec3,
    normal: Vec3,
    /// Of the flat triangle.
    plane: Vec3,
}

/// What reaches it.
#[derive(Clone, Debug)]
struct Reaching {
    open: Vec3,
    thrown: Vec3,
    seen: Vec<f32>,
}

/// Everything that rays are asked of.
pub struct Room<'a> {
    among: &'a Among<'a>,
    bvh: Bvh,
    /// The far light's directions, [`RAYS`] at a time, and of every [`ASKED_OF`]th of them.
    far: Vec<Bundle>,
    few: Vec<Bundle>,
    lights: Vec<Light<'a>>,
    beside_m: f32,
    /// The light on a triangle's front, where it was asked for, and which triangle's light each one gets.
    lit: Vec<OnceLock<Vec3>>,
    lit_as: Vec<u32>,
}

/// A part's surface, placed as its occluders are.
pub struct Surface<'a> {
    pub unwrapped: &'a Unwrapped,
    /// From the mesh's axes.
    pub place: glam::DAffine3,
    pub double_sided: bool,
}

/// The lightmap of a surface in a room.
pub fn lightmap(surface: &Surface<'_>, room: &Room<'_>) -> Lightmap {
    let places = surface.unwrapped.places();
    let side = surface.unwrapped.side;
    let mut layers = Vec::new();
    for turned in if surface.double_sided { &[1.0f32, -1.0][..] } else { &[1.0] } {
        let mut own = vec![vec![OPEN; (side * side) as usize]; 2 + room.lights.len().saturating_sub(2).div_ceil(4)];
        let spots: Vec<Spot> = places.iter().map(|place| surface.spot(place, *turned)).collect();
        for (place, found) in places.iter().zip(Sparsely::new(room, &places, &spots, side).reaching()) {
            let texel = place.texel as usize;
            let seen = |n: usize| found.seen.get(n).copied().unwrap_or(1.0);
            own[0][texel] = found.open.extend(seen(0)).to_array();
            own[1][texel] = found.thrown.extend(seen(1)).to_array();
            for (n, seen) in found.seen.iter().enumerate().skip(2) {
                own[2 + (n - 2) / 4][texel][(n - 2) % 4] = *seen;
            }
        }
        layers.extend(own);
    }
    Lightmap { side, layers }
}

/// Light changes slowly over most of a surface. So every fourth texel of every fourth row is asked first; between texels that lie
/// on one surface and get nearly the same, what reaches is interpolated; what is left is asked too.
struct Sparsely<'a> {
    room: &'a Room<'a>,
    places: &'a [TexelPoint],
    spots: &'a [Spot],
    side: i32,
    /// Which place each texel is, where it is one.
    of_texel: Vec<Option<u32>>,
}

impl<'a> Sparsely<'a> {
    fn new(room: &'a Room<'a>, places: &'a [TexelPoint], spots: &'a [Spot], side: u32) -> Self {
        let mut of_texel = vec![None; (side * side) as usize];
        (0..).zip(places).for_each(|(n, place)| of_texel[place.texel as usize] = Some(n));
        Self { room, places, spots, side: side as i32, of_texel }
    }

    fn reaching(&self) -> Vec<Reaching> {
        let mut found: Vec<Option<Reaching>> = vec![None; self.places.len()];
        for step in [FIRST, FIRST / 2, FIRST / 4] {
            let is_due = |n: &usize| {
                let (x, y) = self.texel(*n);
                found[*n].is_none() && x % step == 0 && y % step == 0
            };
            let due: Vec<usize> = (0..self.places.len()).filter(is_due).collect();
            let mut made: Vec<Option<Reaching>> = vec![None; due.len()];
            over_rows(&mut made, AT_A_TIME, processors(), |row, made| {
                for (n, made) in due[row * AT_A_TIME..].iter().zip(made) {
                    let between = if step < FIRST { self.between(*n, step, &found) } else { None };
                    *made = Some(between.unwrap_or_else(|| self.room.reaching(&self.spots[*n])));
                }
            });
            due.iter().zip(made).for_each(|(n, made)| found[*n] = made);
        }
        found.into_iter().flatten().collect()
    }

    fn texel(&self, place: usize) -> (i32, i32) {
        let texel = self.places[place].texel as i32;
        (texel % self.side, texel / self.side)
    }

    /// The mean of what is known around a place, if all of it is nearly the same.
    fn between(&self, n: usize, step: i32, found: &[Option<Reaching>]) -> Option<Reaching> {
        let (x, y) = self.texel(n);
        // On the coarser grid are the ends of its row, those of its column, or the corners around.
        let beside: &[(i32, i32)] = match (x % (2 * step) == 0, y % (2 * step) == 0) {
            (false, true) => &[(-1, 0), (1, 0)],
            (true, false) => &[(0, -1), (0, 1)],
            _ => &[(-1, -1), (1, -1), (-1, 1), (1, 1)],
        };
        let own = &self.spots[n];
        let (mut mean, mut middle, mut widest) = (Reaching::none(self.room.lights.len()), Vec3::ZERO, 0.0f32);
        let (mut least, mut most) = (mean.clone(), mean.clone());
        let share = 1.0 / beside.len() as f32;
        for (n, (dx, dy)) in beside.iter().enumerate() {
            let (x, y) = (x + dx * step, y + dy * step);
            let inside = (0..self.side).contains(&x) && (0..self.side).contains(&y);
            let other = self.of_texel[if inside { (y * self.side + x) as usize } else { return None }]? as usize;
            let (spot, reaching) = (&self.spots[other], found[other].as_ref()?);
            if spot.normal.dot(own.normal) < ONE_WAY {
                return None;
            }
            mean.add(reaching, share);
            middle += share * spot.at;
            widest = widest.max(spot.at.distance(own.at));
            (least, most) = match n {
                0 => (reaching.clone(), reaching.clone()),
                _ => (least.each(reaching, f32::min), most.each(reaching, f32::max)),
            };
        }
        // What lies beside it on the lightmap may lie elsewhere on the thing.
        let is_near = middle.distance(own.at) < 0.2 * widest;
        (is_near && most.differs_at_most(&least, ALIKE)).then_some(mean)
    }
}

impl Reaching {
    fn none(lights: usize) -> Self {
        Self { open: Vec3::ZERO, thrown: Vec3::ZERO, seen: vec![0.0; lights] }
    }

    fn add(&mut self, other: &Self, share: f32) {
        self.open += share * other.open;
        self.thrown += share * other.thrown;
        self.seen.iter_mut().zip(&other.seen).for_each(|(sum, seen)| *sum += share * seen);
    }

    fn each(&self, other: &Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let both = |a: Vec3, b: Vec3| Vec3::new(of(a.x, b.x), of(a.y, b.y), of(a.z, b.z));
        let seen = self.seen.iter().zip(&other.seen).map(|(a, b)| of(*a, *b)).collect();
        Self { open: both(self.open, other.open), thrown: both(self.thrown, other.thrown), seen }
    }

    /// Whether it is more by no more than a share of all light. What is thrown is judged by its own size.
    fn differs_at_most(&self, less: &Self, share: f32) -> bool {
        (self.open - less.open).max_element() <= share
            && (self.thrown - less.thrown - 2.0 * share * self.thrown).max_element() <= 1e-6
            && self.seen.iter().zip(&less.seen).all(|(more, less)| more - less <= share)
    }
}

impl Digestible for Surface<'_> {
    fn digest(&self, into: &mut Digester) {
        let Self { unwrapped: Unwrapped { corners, indices, side }, place, double_sided } = self;
        into.add_numbers(corners);
        into.add_numbers(indices);
        into.add(side);
        into.add(place);
        into.add(double_sided);
    }
}

impl Surface<'_> {
    fn spot(&self, place: &TexelPoint, turned: f32) -> Spot {
        let matrix = self.place.matrix3.as_mat3();
        let own = &self.unwrapped.indices[3 * place.triangle as usize..][..3];
        let corners = [0, 1, 2].map(|n| &self.unwrapped.corners[own[n] as usize].vertex);
        let positions = corners.map(|c| self.place.transform_point3(Vec3::from(c.position).as_dvec3()).as_vec3());
        let weighted = |values: [Vec3; 3]| (0..3).map(|n| place.weights[n] * values[n]).sum::<Vec3>();
        let plane = (positions[1] - positions[0]).cross(positions[2] - positions[0]);
        // Counter-clockwise seen from outside, mirrored too.
        let plane = plane.normalize_or_zero() * matrix.determinant().signum() * turned;
        let upright = cofactors(matrix) * matrix.determinant().signum();
        let normal = (upright * weighted(corners.map(|c| Vec3::from(c.normal)))).normalize_or_zero() * turned;
        Spot { at: weighted(positions), normal: if normal == Vec3::ZERO { plane } else { normal }, plane }
    }
}

/// Those of a patch that are asked for all of it.
fn few(patch: &[EnvSample]) -> impl Iterator<Item = &EnvSample> {
    patch.iter().skip(ASKED_OF / 2).step_by(ASKED_OF)
}

/// For each of a part's triangles the first of those that get the same light.
fn lit_as(occluders: &Occluders, part: Range<usize>) -> impl Iterator<Item = u32> {
    let corners = occluders.triangles[part.clone()].iter().flatten().map(|i| occluders.corners[*i as usize]);
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
    let per_cell = CELLS / (high - low).max_element().max(1e-9);
    let mut firsts = HashMap::new();
    part.map(move |triangle| {
        let (middle, front) = occluders.middle_and_front(triangle);
        let cell = ((middle - low) * per_cell).floor().as_ivec3();
        *firsts.entry((cell, (WAYS * front).round().as_ivec3())).or_insert(triangle as u32)
    })
}

/// The inverse transpose times the determinant.
fn cofactors(m: Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

impl<'a> Room<'a> {
    pub fn new(among: &'a Among<'a>) -> Self {
        let (occluders, lighting) = (among.occluders, among.lighting);
        let size =
            occluders.corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
        let disc_around = |towards: Vec3, radius: f32| -> Vec<Vec3> {
            let (aside, over) = towards.any_orthonormal_pair();
            disc(DISC).map(|at| radius * (aside * at.x + over * at.y)).collect()
        };
        let sun = |sun: &crate::scene::Sun| {
            let towards = sun.towards_light_in_world;
            let points = disc_around(towards, (0.5 * sun.diameter_rad).tan());
            Light::Sun(points.into_iter().map(|beside| (towards + beside).normalize()).collect(), sun.color)
        };
        let lamp = |lamp: &'a PointLight| {
            let at = (lamp.position_in_world_m - among.origin_m).as_vec3();
            let points = disc_around(at.try_normalize().unwrap_or(Vec3::Z), 0.5 * lamp.diameter_m);
            Light::Lamp(points.into_iter().map(|beside| at + beside).collect(), lamp, at)
        };
        let suns = lighting.suns.iter().take(among.most[0]).map(sun);
        let lights: Vec<_> = suns.chain(lighting.points.iter().take(among.most[1]).map(lamp)).collect();
        let few = among.far.chunks(RAYS * ASKED_OF).map(|patch| Bundle::new(few(patch).map(|far| far.towards)));
        Self {
            among,
            bvh: Bvh::new(&occluders.corners, &occluders.triangles),
            far: among.far.chunks(RAYS).map(|far| Bundle::new(far.iter().map(|far| far.towards))).collect(),
            few: few.collect(),
            lights,
            beside_m: BESIDE * (size.1 - size.0).max_element().max(1e-6),
            lit: occluders.triangles.iter().map(|_| OnceLock::new()).collect(),
            lit_as: occluders.parts.iter().flat_map(|part| lit_as(occluders, part.clone())).collect(),
        }
    }

    /// Light that reaches a place.
    fn reaching(&self, spot: &Spot) -> Reaching {
        let from = spot.at + self.beside_m * spot.plane;
        let (mut all, mut open, mut thrown) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for (some, bundle) in self.among.far.chunks(RAYS).zip(&self.far) {
            let cosines = bundle.dot(spot.normal);
            if cosines.iter().all(|cosine| *cosine <= 0.0) {
                continue;
            }
            // Rays below the plane are not asked, and those behind the normal bring nothing.
            let mut farthest = bundle.before(spot.plane, f32::INFINITY);
            farthest.iter_mut().zip(cosines).for_each(|(far, cosine)| *far = if cosine > 0.0 { *far } else { 0.0 });
            let hits = self.bvh.first(from, bundle, farthest);
            for ((far, cosine), hit) in some.iter().zip(cosines).zip(hits).filter(|((_, cosine), _)| *cosine > 0.0) {
                let light = far.light * cosine;
                all += light;
                match hit {
                    Some(hit) => thrown += self.thrown(hit.triangle, far.towards) * (cosine * far.solid_sr / PI),
                    None => open += light * self.left_on_floors(from, far.towards),
                }
            }
        }
        let share = Vec3::select(all.cmpgt(Vec3::splat(1e-9)), open / all.max(Vec3::splat(1e-9)), Vec3::ONE);
        let seen = self.lights.iter().map(|light| self.seen(light, from, spot));
        Reaching { open: share, thrown, seen: seen.collect() }
    }

    /// The share of a light's disc that a place sees.
    fn seen(&self, light: &Light<'_>, from: Vec3, spot: &Spot) -> f32 {
        let (points, farthest) = match light {
            Light::Sun(points, _) => (points, f32::INFINITY),
            Light::Lamp(points, ..) => (points, 1.0),
        };
        let towards = |point: &Vec3| if matches!(light, Light::Sun(..)) { *point } else { *point - from };
        let hidden = |points: &[Vec3]| {
            let bundle = Bundle::new(points.iter().map(towards));
            self.bvh.any(from, &bundle, bundle.before(spot.plane, farthest))
        };
        let hidden = points.chunks(RAYS).flat_map(hidden).filter(|is_hidden| *is_hidden).count();
        1.0 - hidden as f32 / DISC as f32
    }

    /// What a ray that meets nothing finds of its light where it meets a floor.
    fn left_on_floors(&self, from: Vec3, towards: Vec3) -> Vec3 {
        let mut left = Vec3::ONE;
        for shadow_map in self.among.floors {
            let normal = shadow_map.floor.normal();
            let down = -normal.dot(towards.as_dvec3());
            let at = self.among.origin_m + from.as_dvec3();
            let height = shadow_map.floor.height_m(at);
            if down > 1e-6 && height > 0.0 {
                left *= (Vec3::ONE - shadow_map.taken_at(at + towards.as_dvec3() * (height / down))).max(Vec3::ZERO);
            }
        }
        left
    }

    /// How bright a triangle is seen along a ray.
    fn thrown(&self, triangle: u32, towards: Vec3) -> Vec3 {
        let occluders = self.among.occluders;
        // Inside of things it is dark.
        if occluders.middle_and_front(triangle as usize).1.dot(towards) >= 0.0 {
            return Vec3::ZERO;
        }
        let first = self.lit_as[triangle as usize] as usize;
        let light = self.lit[first].get_or_init(|| {
            let (middle, front) = occluders.middle_and_front(first);
            self.light_on(middle, front)
        });
        occluders.colors[triangle as usize] * *light
    }

    /// All light on a white matt place, but for what things throw.
    fn light_on(&self, at: Vec3, normal: Vec3) -> Vec3 {
        let spot = Spot { at, normal, plane: normal };
        let from = at + self.beside_m * normal;
        // A quarter of the rays says which share of it all is open: E = E_all · Σ open / Σ asked.
        let (mut all, mut asked, mut open) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for (patch, bundle) in self.among.far.chunks(RAYS * ASKED_OF).zip(&self.few) {
            let light = |far: &EnvSample| far.light * far.towards.dot(normal).max(0.0);
            let brought: Vec3 = patch.iter().map(light).sum();
            if brought == Vec3::ZERO {
                continue;
            }
            all += brought;
            let farthest = bundle.before(normal, f32::INFINITY);
            let hidden = self.bvh.any(from, bundle, farthest);
            for ((far, is_hidden), _) in few(patch).zip(hidden).zip(farthest).filter(|(_, far)| *far > 0.0) {
                asked += light(far);
                open += if is_hidden { Vec3::ZERO } else { light(far) * self.left_on_floors(from, far.towards) };
            }
        }
        let around = all * Vec3::select(asked.cmpgt(Vec3::splat(1e-9)), open / asked.max(Vec3::splat(1e-9)), Vec3::ONE);
        let lights = self.lights.iter().map(|light| {
            let bright = match light {
                Light::Sun(points, color) => *color * points[0].dot(normal).max(0.0),
                Light::Lamp(_, lamp, middle) => on_surface(*middle - from, normal, lamp.color, lamp.range_m, lamp.spot),
            };
            if bright == Vec3::ZERO { Vec3::ZERO } else { bright * self.seen(light, from, &spot) }
        });
        around + lights.sum::<Vec3>()
    }
}

#[cfg(test)]
mod tests {
    use super::super::floor::Floor;
    use super::*;
    use crate::digest::Digest;
    use crate::scene::Sun;
    use glam::{DAffine3, Vec2};
    use std::sync::Arc;

    /// All that a lightmap depends on.
    #[derive(Clone)]
    struct Inputs {
        occluders: Occluders,
        far: Vec<EnvSample>,
        lighting: Lighting,
        floors: Vec<ShadowMap>,
        origin_m: DVec3,
        unwrapped: Unwrapped,
        place: DAffine3,
        double_sided: bool,
    }

    impl Inputs {
        fn digest(&self) -> Digest {
            let Self { occluders, far, lighting, floors, origin_m, unwrapped, place, double_sided } = self;
            let among = Among { origin_m: *origin_m, occluders, far, lighting, floors, most: [1, 3] };
            let mut digester = Digester::default();
            digester.add(&among);
            digester.add(&Surface { unwrapped, place: *place, double_sided: *double_sided });
            digester.finish()
        }
    }

    #[test]
    fn any_input_of_a_lightmap_changes_its_digest() {
        let lamp = PointLight {
            position_in_world_m: DVec3::Z,
            color: Vec3::ONE,
            diameter_m: 0.1,
            range_m: f32::INFINITY,
            spot: None,
        };
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        let shares = crate::shadow::ShadowTexture::new(
            &Occluders::default(),
            super::super::extent::Extent { low: Vec2::ZERO, high: Vec2::ONE },
            &super::super::sky::Sky::new(&Lighting::default(), Arc::new([]), &Floor::new(DVec3::ZERO, DVec3::Z), None),
            super::super::shadow_map::Real::default(),
        );
        let shadow_map =
            ShadowMap { floor: Floor::new(DVec3::ZERO, DVec3::Z), texture: Arc::new(shares), is_beside: false };
        let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let first = Inputs {
            occluders: Occluders {
                corners,
                triangles: vec![[0, 1, 2]],
                colors: vec![Vec3::ONE],
                parts: vec![0..1, 1..1],
            },
            far: vec![EnvSample { towards: Vec3::Z, light: Vec3::ONE, solid_sr: 1.0 }],
            lighting: Lighting { suns: vec![sun], points: vec![lamp], ..Lighting::default() },
            floors: vec![shadow_map],
            origin_m: DVec3::ZERO,
            unwrapped: Unwrapped { corners: Vec::new(), indices: vec![0, 1, 2], side: 16 },
            place: DAffine3::IDENTITY,
            double_sided: false,
        };
        assert_eq!(first.digest(), first.clone().digest());
        let changes: [fn(&mut Inputs); 17] = [
            |i| i.occluders.corners[1].x = 1.0f32.next_up(),
            |i| i.occluders.triangles[0] = [0, 2, 1],
            |i| i.occluders.colors[0].y = 0.5,
            |i| i.occluders.parts[0] = 0..0,
            |i| i.far[0].light.z = 1.0f32.next_down(),
            |i| i.far[0].solid_sr = 2.0,
            |i| i.lighting.suns[0].diameter_rad = 0.02,
            |i| i.lighting.points[0].position_in_world_m.x = f64::MIN_POSITIVE,
            |i| i.lighting.points[0].spot = Some(Default::default()),
            |i| i.lighting.points[0].range_m = 9.0,
            |i| i.floors[0].floor.origin_m.y = 1.0,
            |i| Arc::make_mut(&mut i.floors[0].texture).taken[0][1] += 0.5,
            |i| i.floors.clear(),
            |i| i.origin_m.z = 1e-9,
            |i| i.unwrapped.side = 17,
            |i| i.place.translation.x = 1e-12,
            |i| i.double_sided = true,
        ];
        for (n, change) in changes.into_iter().enumerate() {
            let mut other = first.clone();
            change(&mut other);
            assert_ne!(other.digest(), first.digest(), "change {n}");
        }
    }

    #[test]
    fn what_lies_together_and_faces_one_way_is_lit_as_one_and_parts_stay_apart() {
        // 1 m long; the first two lie in one cell of a twelfth of that, the third beyond, the fourth faces the other way.
        let triangle =
            |x: f32, y: f32| [Vec3::new(x, y, 0.0), Vec3::new(x + 0.01, y, 0.0), Vec3::new(x, y + 0.01, 0.0)];
        let mut corners = [triangle(0.0, 0.0), triangle(0.02, 0.03), triangle(0.99, 0.0), triangle(0.02, 0.0)].concat();
        corners.swap(10, 11);
        corners.extend(corners.clone());
        let triangles: Vec<[u32; 3]> = (0..8).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        let occluders = Occluders { corners, triangles, parts: vec![0..4, 4..8], ..Occluders::default() };
        let all: Vec<u32> = occluders.parts.iter().flat_map(|part| lit_as(&occluders, part.clone())).collect();
        assert_eq!(all, [0, 0, 2, 3, 4, 4, 6, 7]);
    }
}
