//! The light that comes onto a floor: a few hundred rays of far light, and lamps nearby.
//!
//! The surrounding light is divided into strata of equal brightness on the floor (radiance · cos θ · solid angle), along a
//! Morton curve, so that a stratum is a compact patch of the sky; each sends one ray from a place within it, with all of
//! its light. So a lamp that was photographed with its room gets as many rays as its share of the light.
//!
//! All light is counted as a white matt surface on the floor would show it: irradiance / π.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::floor::Floor;
use super::mask::SPREAD;
use crate::digest::{Digester, Digestible, digestible};
use crate::render::panorama::{Level, direction, direction_at, resampled, solid_sr};
use crate::scene::{Environment, Lighting, Sun};

/// Rays of the surrounding light. For a thing of a marker's size, 256 are within 0.23 codes of 16,384 in 95 % of the
/// places, 512 within 0.13.
const AROUND: usize = 512;
/// Rays of it from everywhere, for things' own surfaces: half of them reach a place.
const EVERYWHERE: usize = 512;
/// Rays of a sun, and of a lamp.
const SUN: usize = 96;
const LAMP: usize = 64;
/// The surrounding light is looked at in this size.
const WIDTH: u32 = 256;
const HEIGHT: u32 = WIDTH / 2;
/// Flatter light than this leaves no shadow that is worth it: metres along the floor for each of height.
const FLATTEST: f32 = 20.0;
/// Angles from which on patches of the sky are of the next class, from their middle to their edge: from half a degree on.
const CLASSES_RAD: [f32; 3] = [0.008, 0.016, 0.032];
pub const CLASSES: usize = CLASSES_RAD.len() + 1;
/// Of rough light.
const FEWER: usize = 8;
/// The golden angle.
const TURN: f32 = 2.399_963_2;

/// Rays of patches of the sky that are smaller than this, from their middle, are of bright light, radians. An even sky's are of
/// 0.044 and more.
const BRIGHT_RAD: f32 = 0.03;

/// Where a ray comes from, among real things.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// It is one of dim light: what stops it is not asked for.
    Dim,
    /// The first real thing in its direction, as a panorama shows it.
    Seen,
    /// Beyond everything: a sun's.
    Beyond,
}

/// Light from far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// How far a shadow falls for each metre of height, in the floor's x and y.
    pub slope: Vec2,
    pub light: Vec3,
    /// The angle of the patch of sky that it stands for, from its middle, radians.
    pub angle_rad: f32,
    pub source: Source,
}

/// Light from far away, from a part of the sphere around.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvSample {
    /// In the world, or in a floor's axes.
    pub towards: Vec3,
    /// What a white matt surface shows that faces it.
    pub light: Vec3,
    pub solid_sr: f32,
}

/// Light from a point nearby, in the floor's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    pub at_m: Vec3,
    color: Vec3,
    range_m: f32,
    spot: Option<(Vec3, Vec2)>,
    radius_m: f32,
    /// Points of the lamp's disc.
    pub points_m: Vec<Vec3>,
}

/// All the light on a floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    pub rays: Arc<[Ray]>,
    pub lamps: Vec<Lamp>,
    /// Of all rays together.
    pub light: Vec3,
    /// Of a facet, which light goes past.
    pub behind: Option<Arc<Behind>>,
}

/// Light that comes from behind a facet, in its floor's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Behind {
    pub far: Vec<EnvSample>,
    pub lamps: Vec<Lamp>,
}

digestible! {
    Ray { slope, light, angle_rad, source }
    EnvSample { towards, light, solid_sr }
    Lamp { at_m, color, range_m, spot, radius_m, points_m }
    Sky { rays, lamps, light, behind }
    Behind { far, lamps }
}

impl Digestible for Source {
    fn digest(&self, into: &mut Digester) {
        into.add(&(*self as u8));
    }
}

/// A scene's surrounding light in the size in which it is looked at: made once for all floors.
#[derive(Clone, Debug)]
pub struct Around {
    level: Level,
    world_from_map: Mat3,
}

impl Around {
    pub fn new(environment: &Environment) -> Self {
        match environment {
            Environment::Uniform(color) => {
                Self { level: (WIDTH, HEIGHT, vec![*color; (WIDTH * HEIGHT) as usize]), world_from_map: Mat3::IDENTITY }
            }
            Environment::Map(map) => {
                let mut level = resampled((map.width, map.height, &map.rgb), WIDTH, HEIGHT);
                level.2.iter_mut().for_each(|texel| *texel *= map.color);
                Self { level, world_from_map: Mat3::from_quat(map.map_from_world).transpose() }
            }
        }
    }

    /// Rays in the floor's axes.
    fn rays(&self, floor_from_world: Mat3) -> Vec<Ray> {
        let floor_from_map = floor_from_world * self.world_from_map;
        let weighed = |towards: Vec3, radiance: Vec3, solid_sr: f32| {
            let light = radiance * ((floor_from_map * towards).z.max(0.0) * solid_sr / PI);
            (light, light.element_sum())
        };
        let strata = self.strata(AROUND, weighed);
        let angle_rad = |solid_sr: f32| (solid_sr / PI).sqrt();
        let of = |s: Stratum| {
            let angle_rad = angle_rad(s.solid_sr);
            let source = if angle_rad < BRIGHT_RAD { Source::Seen } else { Source::Dim };
            ray(floor_from_map * s.towards, s.light, angle_rad, source)
        };
        strata.into_iter().map(of).collect()
    }

    /// Rays from everywhere, half of them by their brightness and half evenly: what throws light may stand before the dark.
    pub fn everywhere(&self) -> Vec<EnvSample> {
        let texels = || (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        let bright =
            |(x, y): (u32, u32)| self.level.2[(y * WIDTH + x) as usize].element_sum() * solid_sr(y, WIDTH, HEIGHT);
        let all = f64::from(texels().map(bright).sum::<f32>()).max(1e-20) as f32;
        let weighed = |_: Vec3, radiance: Vec3, solid_sr: f32| {
            (radiance * (solid_sr / PI), radiance.element_sum() * solid_sr / all + solid_sr / (4.0 * PI))
        };
        let strata = self.strata(EVERYWHERE, weighed);
        let far =
            |s: Stratum| EnvSample { towards: self.world_from_map * s.towards, light: s.light, solid_sr: s.solid_sr };
        strata.into_iter().map(far).collect()
    }

    /// Patches of the sphere of equal weight, along the curve, each with a direction within it, in the map's axes. `weighed` gives
    /// what light a direction of some radiance and solid angle brings, and its weight; of weight 0, it is left out.
    fn strata(&self, count: usize, weighed: impl Fn(Vec3, Vec3, f32) -> (Vec3, f32)) -> Vec<Stratum> {
        // Weight, light and solid angle up to each texel, along the curve.
        let mut up_to = vec![(0.0f64, DVec3::ZERO, 0.0f64, 0, 0)];
        let (mut sum, mut light, mut solid) = (0.0, DVec3::ZERO, 0.0);
        for (x, y) in curve() {
            let solid_sr = solid_sr(y, WIDTH, HEIGHT);
            let radiance = self.level.2[(y * WIDTH + x) as usize];
            let (texel, weight) = weighed(direction(x, y, WIDTH, HEIGHT), radiance, solid_sr);
            if weight <= 0.0 {
                continue;
            }
            light += texel.as_dvec3();
            sum += f64::from(weight);
            solid += f64::from(solid_sr);
            up_to.push((sum, light, solid, x, y));
        }
        if sum <= 0.0 {
            return Vec::new();
        }
        let within = |share: f64| {
            let next = up_to.partition_point(|(s, ..)| *s < share * sum).clamp(1, up_to.len() - 1);
            let ((from, below, less, ..), (to, above, more, x, y)) = (up_to[next - 1], up_to[next]);
            let part = if to > from { ((share * sum - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
            (below.lerp(above, part), less + part * (more - less), Vec2::new(x as f32, y as f32))
        };
        let stratum = |n: usize| {
            let at = |part: f64| within((n as f64 + part) / count as f64);
            let ((from, less, _), (_, _, texel), (to, more, _)) = (at(0.0), at(0.5), at(1.0));
            let beside = (SPREAD * (n as f32 + 0.5)).fract();
            let towards = direction_at(texel + beside, WIDTH, HEIGHT);
            Stratum { towards, light: (to - from).as_vec3(), solid_sr: (more - less) as f32 }
        };
        (0..count).map(stratum).collect()
    }
}

/// A patch of the sphere.
struct Stratum {
    towards: Vec3,
    light: Vec3,
    solid_sr: f32,
}

/// The places of all texels along the Morton curve.
fn curve() -> impl Iterator<Item = (u32, u32)> {
    let every_other = |n: u32| (0..8).fold(0, |sum, bit| sum | (n >> (2 * bit) & 1) << bit);
    (0..WIDTH * HEIGHT).map(move |n| (every_other(n), every_other(n >> 1)))
}

fn ray(towards: Vec3, light: Vec3, angle_rad: f32, source: Source) -> Ray {
    let slope = towards.truncate() / towards.z.max(1e-6);
    Ray { slope: slope.clamp_length_max(FLATTEST), light, angle_rad, source }
}

/// Evenly over a disc of radius 1.
pub fn disc(count: usize) -> impl Iterator<Item = Vec2> {
    (0..count).map(move |n| {
        let (sin, cos) = (n as f32 * TURN).sin_cos();
        ((n as f32 + 0.5) / count as f32).sqrt() * Vec2::new(cos, sin)
    })
}

/// All far light on floors of these axes.
pub fn rays(lighting: &Lighting, around: &Around, floor: &Floor) -> Arc<[Ray]> {
    let turn = floor.floor_from_world().matrix3.as_mat3();
    let mut rays = around.rays(turn);
    for sun in &lighting.suns {
        let towards = turn * sun.towards_light_in_world;
        let (aside, over) = towards.any_orthonormal_pair();
        let radius = (0.5 * sun.diameter_rad).tan();
        let points = disc(SUN).map(|at| towards + radius * (aside * at.x + over * at.y));
        // A part of a wide one is below the horizon.
        let seen: Vec<_> = points.filter(|point| point.z > 0.0).collect();
        let angle_rad = radius / (SUN as f32).sqrt();
        let light = sun.color * towards.z.max(0.0) / seen.len().max(1) as f32;
        rays.extend(
            seen.into_iter().filter(|_| towards.z > 0.0).map(|point| ray(point, light, angle_rad, Source::Beyond)),
        );
    }
    rays.into()
}

impl Sky {
    /// `rays`: what [`rays`] gives for floors of these axes. `far`: of a facet, the light from everywhere.
    pub fn new(lighting: &Lighting, rays: Arc<[Ray]>, floor: &Floor, far: Option<&[EnvSample]>) -> Self {
        let floor_from_world = floor.floor_from_world();
        let turn = floor_from_world.matrix3.as_mat3();
        let lamps = lighting.points.iter().map(|point| {
            let at_m = floor_from_world.transform_point3(point.position_in_world_m).as_vec3();
            let (aside, over) = at_m.try_normalize().unwrap_or(Vec3::Z).any_orthonormal_pair();
            Lamp {
                at_m,
                color: point.color,
                range_m: point.range_m,
                spot: point.spot.map(|(axis, angles)| (turn * axis, angles)),
                radius_m: 0.5 * point.diameter_m,
                // A part of a wide one is below the horizon.
                points_m: disc(LAMP)
                    .map(|at| at_m + 0.5 * point.diameter_m * (aside * at.x + over * at.y))
                    .filter(|point_m| at_m.z <= 0.0 || point_m.z > 0.0)
                    .collect(),
            }
        });
        let light = rays.iter().map(|ray| ray.light).sum();
        let (lamps, hidden) = lamps.partition(|lamp| lamp.at_m.z > 0.0 && !lamp.points_m.is_empty());
        let behind = far.map(|far| Arc::new(Behind { far: behind(far, &lighting.suns, turn), lamps: hidden }));
        Self { rays, lamps, light, behind }
    }

    /// Without the suns behind a facet, by where they stand, and the lamps there, by their places, that do not shine.
    pub fn behind_without(mut self, sun: impl Fn(Vec3) -> bool, lamp: impl Fn(Vec3) -> bool) -> Self {
        if let Some(behind) = &mut self.behind {
            let Behind { far, lamps } = Arc::make_mut(behind);
            far.retain(|far| far.solid_sr > 0.0 || !sun(far.towards));
            lamps.retain(|beyond| !lamp(beyond.at_m));
        }
        self
    }

    /// One of eight rays and points of lamps, with the light of all: for previews.
    pub fn sparse(&self) -> Self {
        let fewer = FEWER;
        let kept: Vec<Ray> = self.rays.iter().skip(fewer / 2).step_by(fewer).copied().collect();
        let sum: Vec3 = kept.iter().map(|ray| ray.light).sum();
        let brighter = Vec3::select(sum.cmpgt(Vec3::ZERO), self.light / sum.max(Vec3::splat(1e-20)), Vec3::ONE);
        // Each stands for a patch as much larger.
        let of =
            |ray: Ray| Ray { light: ray.light * brighter, angle_rad: ray.angle_rad * (fewer as f32).sqrt(), ..ray };
        let rays: Vec<Ray> = kept.into_iter().map(of).collect();
        let light = rays.iter().map(|ray| ray.light).sum();
        let thin = |lamp: &Lamp| {
            let points_m = lamp.points_m.iter().skip(fewer / 2).step_by(fewer).copied().collect();
            Lamp { points_m, ..lamp.clone() }
        };
        Self { rays: rays.into(), lamps: self.lamps.iter().map(thin).collect(), light, behind: self.behind.clone() }
    }

    /// The angle of the patches that rays of each class stand for, their mean by their light, radians; 0 for none, and for those of
    /// the first class, which are points.
    pub fn angles_rad(&self) -> [f32; CLASSES] {
        let rays = self.rays.iter().map(|ray| (ray.angle_rad, ray.light.element_sum()));
        let lamps = self.lamps.iter().map(|lamp| (lamp.angle_rad(), lamp.light_at(Vec2::ZERO).element_sum()));
        let mut sums = [(0.0f32, 0.0f32); CLASSES];
        for (angle_rad, light) in rays.chain(lamps) {
            let (sum, all) = &mut sums[class(angle_rad)];
            (*sum, *all) = (*sum + angle_rad * light, *all + light);
        }
        sums[0].0 = 0.0;
        sums.map(|(sum, all)| sum / all.max(1e-20))
    }

    /// All that comes onto the floor where nothing takes any.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light + self.lamps.iter().map(|lamp| lamp.light_at(place_m)).sum::<Vec3>()
    }
}

/// Far light that comes from below a floor, in its axes.
fn behind(far: &[EnvSample], suns: &[Sun], floor_from_world: Mat3) -> Vec<EnvSample> {
    let sun = |sun: &Sun| EnvSample { towards: sun.towards_light_in_world, light: sun.color, solid_sr: 0.0 };
    let all = far.iter().copied().chain(suns.iter().map(sun));
    let turned = all.map(|far| EnvSample { towards: floor_from_world * far.towards, ..far });
    turned.filter(|far| far.towards.z < 0.0).collect()
}

/// The class of rays that stand for patches of some angle.
pub fn class(angle_rad: f32) -> usize {
    CLASSES_RAD.iter().take_while(|least| angle_rad >= **least).count()
}

impl Lamp {
    /// The angle of the patch that one of its points stands for, seen from the floor below the things.
    pub fn angle_rad(&self) -> f32 {
        self.radius_m / (self.points_m.len().max(1) as f32).sqrt() / self.at_m.length().max(1e-6)
    }

    /// With a share of its light.
    pub fn dimmed(&self, share: f32) -> Self {
        Self { color: share * self.color, ..self.clone() }
    }

    /// Its light on the floor, as shaders/raster.wgsl counts it: range and spot by KHR_lights_punctual.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light_on(place_m.extend(0.0), Vec3::Z)
    }

    /// The same on a surface of some normal, in the floor's axes.
    pub fn light_on(&self, place_m: Vec3, normal: Vec3) -> Vec3 {
        on_surface(self.at_m - place_m, normal, self.color, self.range_m, self.spot)
    }
}

/// What a white matt surface shows by a lamp that stands `towards` it, metres, in the axes that `normal` and the spot's axis are
/// in. Range and spot by KHR_lights_punctual.
pub fn on_surface(towards: Vec3, normal: Vec3, color: Vec3, range_m: f32, spot: Option<(Vec3, Vec2)>) -> Vec3 {
    let distance2 = towards.length_squared().max(1e-12);
    let unit = towards / distance2.sqrt();
    let near = (distance2.sqrt() / range_m).powi(4);
    let mut share = (1.0 - near).clamp(0.0, 1.0) / distance2 * unit.dot(normal).max(0.0);
    if let Some((axis, angles)) = spot {
        let (inner, outer) = (angles.x.cos(), angles.y.cos());
        let t = ((axis.dot(-unit) - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
        share *= t * t;
    }
    color * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Sun;
    use glam::DVec3;

    fn sky(lighting: &Lighting, normal: DVec3) -> Sky {
        let floor = Floor::new(DVec3::ZERO, normal);
        Sky::new(lighting, rays(lighting, &Around::new(&lighting.environment), &floor), &floor, None)
    }

    #[test]
    fn an_even_sky_lights_any_floor_with_its_own_radiance_and_by_the_cosine() {
        let lighting = Lighting { environment: Environment::Uniform(Vec3::new(0.5, 1.0, 2.0)), ..Default::default() };
        for normal in [DVec3::Y, DVec3::Z, DVec3::new(1.0, -2.0, 0.5).normalize()] {
            let sky = sky(&lighting, normal);
            assert!((sky.light / Vec3::new(0.5, 1.0, 2.0) - 1.0).abs().max_element() < 0.01, "{normal}: {}", sky.light);
            // Of the light on a floor, ∫ cos θ sin θ: half comes from within 45° of straight up, where slopes are below 1.
            let steep: f32 = sky.rays.iter().filter(|r| r.slope.length() < 1.0).map(|r| r.light.y).sum();
            assert!((steep - 0.5).abs() < 0.02, "{normal}: {steep}");
            let aside: Vec2 = sky.rays.iter().filter(|r| r.slope.length() < 1.0).map(|r| r.slope * r.light.y).sum();
            assert!(aside.length() < 0.02, "{normal}: {aside}");
        }
    }

    #[test]
    fn rays_from_everywhere_bring_all_light_and_fill_the_sphere() {
        // One half of the sky is red and five times as bright as the other, which is blue.
        let (red, blue) = ([5.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let rgb = (0..16 * 8).map(|i| if i % 16 < 8 { red } else { blue }).collect::<Vec<_>>();
        let map = crate::scene::EnvironmentMap {
            width: 16,
            height: 8,
            rgb: rgb.into(),
            map_from_world: glam::Quat::from_rotation_x(0.3),
            color: Vec3::splat(2.0),
        };
        let far = Around::new(&Environment::Map(map)).everywhere();
        let solid: f32 = far.iter().map(|far| far.solid_sr).sum();
        assert!((solid - 4.0 * PI).abs() < 1e-3, "{solid}");
        // A surface that faces a half of an even sky shows its radiance.
        for (normal, wanted) in [(Vec3::NEG_X, Vec3::X * 10.0), (Vec3::X, Vec3::Z * 2.0)] {
            let shown: Vec3 = far.iter().map(|far| far.light * far.towards.dot(normal).max(0.0)).sum();
            assert!((shown - wanted).abs().max_element() < 0.03 * wanted.max_element(), "{normal}: {shown}");
        }
        let dark = far.iter().filter(|far| far.light.z > 0.0).count();
        assert!(dark > far.len() / 4, "{dark} of {} for the darker half", far.len());
        // A black sky is asked all the same: things throw what lamps bring.
        assert_eq!(Around::new(&Environment::Uniform(Vec3::ZERO)).everywhere().len(), far.len());
    }

    #[test]
    fn a_sun_is_as_bright_as_the_floor_is_turned_to_it_and_as_wide_as_it_is() {
        let towards = Vec3::new(0.6, 0.0, 0.8);
        let sun = Sun { towards_light_in_world: towards, color: Vec3::splat(2.0), diameter_rad: 0.2 };
        let lighting = Lighting { suns: vec![sun], environment: Environment::Uniform(Vec3::ZERO), points: Vec::new() };
        let sky = sky(&lighting, DVec3::Z);
        assert_eq!(sky.rays.len(), SUN);
        assert!((sky.light.x - 1.6).abs() < 1e-4, "{}", sky.light);
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let slopes = sky.rays.iter().map(|r| (floor.axes * r.slope.extend(1.0).as_dvec3()).as_vec3().normalize());
        let widest = slopes.map(|d| d.angle_between(towards)).fold(0.0, f32::max);
        assert!((widest - 0.1).abs() < 0.002, "{widest}");
    }
}
