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
use crate::render::panorama::{Level, direction, direction_at, resampled, solid_sr};
use crate::scene::{Environment, Lighting};

/// Rays of the surrounding light. For a thing of a marker's size, 256 are within 0.23 codes of 16,384 in 95 % of the
/// places, 512 within 0.13.
const AROUND: usize = 512;
/// Rays of a sun, and of a lamp.
const SUN: usize = 96;
const LAMP: usize = 64;
/// The surrounding light is looked at in this size.
const WIDTH: u32 = 256;
const HEIGHT: u32 = WIDTH / 2;
/// Flatter light than this leaves no shadow that is worth it: metres along the floor for each of height.
const FLATTEST: f32 = 20.0;
/// The golden angle.
const TURN: f32 = 2.399_963_2;

/// Light from far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// How far a shadow falls for each metre of height, in the floor's x and y.
    pub slope: Vec2,
    pub light: Vec3,
}

/// Light from a point nearby, in the floor's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    at_m: Vec3,
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
}

/// A scene's surrounding light in the size in which it is looked at: made once for all floors.
#[derive(Debug)]
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
                level.2.iter_mut().for_each(|texel| *texel *= map.intensity);
                Self { level, world_from_map: Mat3::from_quat(map.map_from_world).transpose() }
            }
        }
    }

    /// Rays in the floor's axes.
    fn rays(&self, floor_from_world: Mat3) -> Vec<Ray> {
        let floor_from_map = floor_from_world * self.world_from_map;
        // Brightness and light up to each texel, along the curve.
        let mut up_to = vec![(0.0f64, DVec3::ZERO, 0, 0)];
        let (mut sum, mut light) = (0.0, DVec3::ZERO);
        for (x, y) in curve() {
            let towards = floor_from_map * direction(x, y, WIDTH, HEIGHT);
            if towards.z <= 0.0 {
                continue;
            }
            let texel = self.level.2[(y * WIDTH + x) as usize] * (towards.z * solid_sr(y, WIDTH, HEIGHT) / PI);
            light += texel.as_dvec3();
            sum += f64::from(texel.element_sum());
            up_to.push((sum, light, x, y));
        }
        if sum <= 0.0 {
            return Vec::new();
        }
        let within = |share: f64| {
            let next = up_to.partition_point(|(s, ..)| *s < share * sum).clamp(1, up_to.len() - 1);
            let ((from, below, ..), (to, above, x, y)) = (up_to[next - 1], up_to[next]);
            let part = if to > from { ((share * sum - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
            (below.lerp(above, part), Vec2::new(x as f32, y as f32))
        };
        (0..AROUND)
            .map(|n| {
                let at = |part: f64| within((n as f64 + part) / AROUND as f64);
                let ((from, _), (_, texel), (to, _)) = (at(0.0), at(0.5), at(1.0));
                let beside = (SPREAD * (n as f32 + 0.5)).fract();
                ray(floor_from_map * direction_at(texel + beside, WIDTH, HEIGHT), (to - from).as_vec3())
            })
            .collect()
    }
}

/// The places of all texels along the Morton curve.
fn curve() -> impl Iterator<Item = (u32, u32)> {
    let every_other = |n: u32| (0..8).fold(0, |sum, bit| sum | (n >> (2 * bit) & 1) << bit);
    (0..WIDTH * HEIGHT).map(move |n| (every_other(n), every_other(n >> 1)))
}

fn ray(towards: Vec3, light: Vec3) -> Ray {
    let slope = towards.truncate() / towards.z.max(1e-6);
    Ray { slope: slope.clamp_length_max(FLATTEST), light }
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
        let light = sun.color * towards.z.max(0.0) / seen.len().max(1) as f32;
        rays.extend(seen.into_iter().filter(|_| towards.z > 0.0).map(|point| ray(point, light)));
    }
    rays.into()
}

impl Sky {
    /// `rays`: what [`rays`] gives for floors of these axes.
    pub fn new(lighting: &Lighting, rays: Arc<[Ray]>, floor: &Floor) -> Self {
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
                points_m: disc(LAMP).map(|at| at_m + 0.5 * point.diameter_m * (aside * at.x + over * at.y)).collect(),
            }
        });
        let light = rays.iter().map(|ray| ray.light).sum();
        Self { rays, lamps: lamps.filter(|lamp| lamp.at_m.z > lamp.radius_m).collect(), light }
    }

    /// All that comes onto the floor where nothing takes any.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light + self.lamps.iter().map(|lamp| lamp.light_at(place_m)).sum::<Vec3>()
    }
}

impl Lamp {
    /// Its light on the floor, as shaders/raster.wgsl counts it: range and spot by KHR_lights_punctual.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light_on(place_m.extend(0.0), Vec3::Z)
    }

    /// The same on a surface of some normal, in the floor's axes.
    pub fn light_on(&self, place_m: Vec3, normal: Vec3) -> Vec3 {
        let towards = self.at_m - place_m;
        let distance2 = towards.length_squared().max(1e-12);
        let unit = towards / distance2.sqrt();
        let near = (distance2.sqrt() / self.range_m).powi(4);
        let mut share = (1.0 - near).clamp(0.0, 1.0) / distance2 * unit.dot(normal).max(0.0);
        if let Some((axis, angles)) = self.spot {
            let (inner, outer) = (angles.x.cos(), angles.y.cos());
            let t = ((axis.dot(-unit) - outer) / (inner - outer).max(1e-4)).clamp(0.0, 1.0);
            share *= t * t;
        }
        self.color * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Sun;
    use glam::DVec3;

    fn sky(lighting: &Lighting, normal: DVec3) -> Sky {
        let floor = Floor::new(DVec3::ZERO, normal);
        Sky::new(lighting, rays(lighting, &Around::new(&lighting.environment), &floor), &floor)
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
