//! Incident light of a receiver plane: a few hundred rays of distant light, and lamps nearby.
//!
//! The environment is divided into strata of equal irradiance on the plane (radiance · cos θ ·
//! solid angle), along a Morton curve, so that a stratum is a compact patch of the sky. One ray
//! from a point within a stratum has all of its light. A lamp in a panorama thus gets a number of
//! rays in proportion to its irradiance.
//!
//! All light is the radiance of a white Lambertian surface: irradiance / π.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Mat3, Vec2, Vec3};

use super::mask::R2_STEP;
use super::receiver_plane::ReceiverPlane;
use crate::digest::{Digester, Digestible, digestible};
use crate::memo::Memo;
use crate::render::panorama::{MipLevel, direction, direction_at, resampled, solid_sr};
use crate::scene::{Environment, Lighting, Sun};

/// Rays of the environment on a plane. For an object of a marker's size, 256 are within 0.23 codes
/// of 16,384 in 95 % of the places, 512 within 0.13.
const ENVIRONMENT_RAYS: usize = 512;
/// Samples of the environment over the sphere, for objects' own surfaces. Half of them reach a
/// place.
const SPHERE_SAMPLES: usize = 512;
/// Rays of a sun.
const SUN_RAYS: usize = 96;
/// Points of a lamp.
const LAMP_POINTS: usize = 64;
/// Size of the resampled environment, px.
const WIDTH: u32 = 256;
const HEIGHT: u32 = WIDTH / 2;
/// Largest horizontal offset of a shadow for each metre of height. Lower light is treated as this.
const MAX_SLOPE: f32 = 20.0;
/// Smallest angular radius of the patches of each class but the first, rad: from half a degree on.
const MIN_CLASS_ANGLES_RAD: [f32; 3] = [0.008, 0.016, 0.032];
pub const CLASSES: usize = MIN_CLASS_ANGLES_RAD.len() + 1;
/// Stride of the rays of a preview.
const PREVIEW_STRIDE: usize = 8;
const GOLDEN_ANGLE_RAD: f32 = 2.399_963_2;

/// Largest angular radius of a patch of bright light, rad. Those of a uniform sky have 0.044 and
/// more.
const MAX_BRIGHT_ANGLE_RAD: f32 = 0.03;

/// The emitter of a ray, for occlusion by real objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RaySource {
    /// Dim light, whose occlusion is not computed.
    Dim,
    /// The nearest real surface in its direction: light of a panorama.
    NearestSurface,
    /// Infinitely distant: a sun.
    Infinity,
}

/// A ray of distant light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyRay {
    /// Horizontal offset of a shadow for each metre of height, in the plane's axes.
    pub slope: Vec2,
    pub light: Vec3,
    /// Angular radius of its patch of the sky, rad.
    pub angle_rad: f32,
    pub source: RaySource,
}

/// Distant light from a part of the sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvSample {
    /// Direction in the world, or in a plane's axes.
    pub towards: Vec3,
    /// Radiance of a white Lambertian surface that faces it.
    pub light: Vec3,
    pub solid_sr: f32,
}

/// A lamp nearby, in the plane's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledLamp {
    pub at_m: Vec3,
    color: Vec3,
    range_m: f32,
    spot: Option<(Vec3, Vec2)>,
    radius_m: f32,
    /// Points of the lamp's disc.
    pub points_m: Vec<Vec3>,
}

/// All incident light of a plane.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneLighting {
    pub rays: Arc<[SkyRay]>,
    pub lamps: Vec<SampledLamp>,
    /// Sum over all rays.
    pub light: Vec3,
    /// Light from behind a facet that passes its sides; `None` for other planes.
    pub back_light: Option<Arc<BackLight>>,
}

/// Light from behind a facet, in its plane's axes.
#[derive(Clone, Debug, PartialEq)]
pub struct BackLight {
    pub far: Vec<EnvSample>,
    pub lamps: Vec<SampledLamp>,
}

digestible! {
    SkyRay { slope, light, angle_rad, source }
    EnvSample { towards, light, solid_sr }
    SampledLamp { at_m, color, range_m, spot, radius_m, points_m }
    PlaneLighting { rays, lamps, light, back_light }
    BackLight { far, lamps }
}

impl Digestible for RaySource {
    fn digest(&self, into: &mut Digester) {
        into.add(&(*self as u8));
    }
}

/// A scene's environment, resampled once for all planes and lightmaps.
#[derive(Debug)]
pub struct EnvironmentImage {
    level: MipLevel,
    world_from_map: Mat3,
    sphere_samples: Memo<(), Arc<[EnvSample]>>,
}

impl EnvironmentImage {
    pub fn new(environment: &Environment) -> Self {
        let (level, world_from_map) = match environment {
            Environment::Uniform(color) => ((WIDTH, HEIGHT, vec![*color; (WIDTH * HEIGHT) as usize]), Mat3::IDENTITY),
            Environment::Map(map) => {
                let mut level = resampled((map.width, map.height, &map.rgb), WIDTH, HEIGHT);
                level.2.iter_mut().for_each(|texel| *texel *= map.color);
                (level, Mat3::from_quat(map.map_from_world).transpose())
            }
        };
        Self { level, world_from_map, sphere_samples: Memo::default() }
    }

    /// Rays in the plane's axes.
    fn rays(&self, plane_from_world: Mat3) -> Vec<SkyRay> {
        let plane_from_map = plane_from_world * self.world_from_map;
        let weighting = |towards: Vec3, radiance: Vec3, solid_sr: f32| {
            let light = radiance * ((plane_from_map * towards).z.max(0.0) * solid_sr / PI);
            (light, light.element_sum())
        };
        let strata = self.strata(ENVIRONMENT_RAYS, weighting);
        let angle_rad = |solid_sr: f32| (solid_sr / PI).sqrt();
        let sky_ray = |s: Stratum| {
            let angle_rad = angle_rad(s.solid_sr);
            let source = if angle_rad < MAX_BRIGHT_ANGLE_RAD { RaySource::NearestSurface } else { RaySource::Dim };
            ray(plane_from_map * s.towards, s.light, angle_rad, source)
        };
        strata.into_iter().map(sky_ray).collect()
    }

    /// Samples over the sphere, half of them by brightness and half uniformly: reflecting surfaces
    /// may be in front of a dark part. Computed by the first call.
    pub fn sphere_samples(&self) -> Arc<[EnvSample]> {
        self.sphere_samples.get_or_insert_with((), |()| self.sample_sphere())
    }

    fn sample_sphere(&self) -> Arc<[EnvSample]> {
        let texels = || (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
        let bright =
            |(x, y): (u32, u32)| self.level.2[(y * WIDTH + x) as usize].element_sum() * solid_sr(y, WIDTH, HEIGHT);
        let all = f64::from(texels().map(bright).sum::<f32>()).max(1e-20) as f32;
        let weighting = |_: Vec3, radiance: Vec3, solid_sr: f32| {
            (radiance * (solid_sr / PI), radiance.element_sum() * solid_sr / all + solid_sr / (4.0 * PI))
        };
        let strata = self.strata(SPHERE_SAMPLES, weighting);
        let far =
            |s: Stratum| EnvSample { towards: self.world_from_map * s.towards, light: s.light, solid_sr: s.solid_sr };
        strata.into_iter().map(far).collect()
    }

    /// Patches of the sphere of equal weight along the Morton curve, with a direction within each,
    /// in the map's axes. `weighting` returns the light of a direction, from its radiance and solid
    /// angle, and its weight. Directions of weight 0 are skipped.
    fn strata(&self, count: usize, weighting: impl Fn(Vec3, Vec3, f32) -> (Vec3, f32)) -> Vec<Stratum> {
        // Cumulative weight, light and solid angle up to each texel, along the curve.
        let mut cumulative = vec![(0.0f64, DVec3::ZERO, 0.0f64, 0, 0)];
        let (mut sum, mut light, mut solid) = (0.0, DVec3::ZERO, 0.0);
        for (x, y) in morton_curve() {
            let solid_sr = solid_sr(y, WIDTH, HEIGHT);
            let radiance = self.level.2[(y * WIDTH + x) as usize];
            let (texel, weight) = weighting(direction(x, y, WIDTH, HEIGHT), radiance, solid_sr);
            if weight <= 0.0 {
                continue;
            }
            light += texel.as_dvec3();
            sum += f64::from(weight);
            solid += f64::from(solid_sr);
            cumulative.push((sum, light, solid, x, y));
        }
        if sum <= 0.0 {
            return Vec::new();
        }
        let within = |share: f64| {
            let next = cumulative.partition_point(|(s, ..)| *s < share * sum).clamp(1, cumulative.len() - 1);
            let ((from, below, less, ..), (to, above, more, x, y)) = (cumulative[next - 1], cumulative[next]);
            let part = if to > from { ((share * sum - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
            (below.lerp(above, part), less + part * (more - less), Vec2::new(x as f32, y as f32))
        };
        let stratum = |n: usize| {
            let at = |part: f64| within((n as f64 + part) / count as f64);
            let ((from, less, _), (_, _, texel), (to, more, _)) = (at(0.0), at(0.5), at(1.0));
            let beside = (R2_STEP * (n as f32 + 0.5)).fract();
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

/// The coordinates of all texels along the Morton curve.
fn morton_curve() -> impl Iterator<Item = (u32, u32)> {
    let every_other = |n: u32| (0..8).fold(0, |sum, bit| sum | (n >> (2 * bit) & 1) << bit);
    (0..WIDTH * HEIGHT).map(move |n| (every_other(n), every_other(n >> 1)))
}

fn ray(towards: Vec3, light: Vec3, angle_rad: f32, source: RaySource) -> SkyRay {
    let slope = towards.truncate() / towards.z.max(1e-6);
    SkyRay { slope: slope.clamp_length_max(MAX_SLOPE), light, angle_rad, source }
}

/// Points distributed uniformly over the unit disc: a spiral of Vogel's.
pub fn disc(count: usize) -> impl Iterator<Item = Vec2> {
    (0..count).map(move |n| {
        let (sin, cos) = (n as f32 * GOLDEN_ANGLE_RAD).sin_cos();
        ((n as f32 + 0.5) / count as f32).sqrt() * Vec2::new(cos, sin)
    })
}

/// All distant light on planes with these axes.
pub fn rays(lighting: &Lighting, environment: &EnvironmentImage, plane: &ReceiverPlane) -> Arc<[SkyRay]> {
    let plane_from_world = plane.plane_from_world().matrix3.as_mat3();
    let mut rays = environment.rays(plane_from_world);
    for sun in &lighting.suns {
        let towards = plane_from_world * sun.towards_light_in_world;
        let (aside, over) = towards.any_orthonormal_pair();
        let radius = (0.5 * sun.diameter_rad).tan();
        let points = disc(SUN_RAYS).map(|at| towards + radius * (aside * at.x + over * at.y));
        // Points of a large sun may be below the horizon.
        let above_plane: Vec<_> = points.filter(|point| point.z > 0.0).collect();
        let angle_rad = radius / (SUN_RAYS as f32).sqrt();
        let light = sun.color * towards.z.max(0.0) / above_plane.len().max(1) as f32;
        rays.extend(
            above_plane
                .into_iter()
                .filter(|_| towards.z > 0.0)
                .map(|point| ray(point, light, angle_rad, RaySource::Infinity)),
        );
    }
    rays.into()
}

impl PlaneLighting {
    /// `rays`: the result of [`rays`] for planes with these axes. `far`: for a facet, samples over
    /// the sphere.
    pub fn new(lighting: &Lighting, rays: Arc<[SkyRay]>, plane: &ReceiverPlane, far: Option<&[EnvSample]>) -> Self {
        let plane_from_world = plane.plane_from_world();
        let turn = plane_from_world.matrix3.as_mat3();
        let lamps = lighting.points.iter().map(|point| {
            let at_m = plane_from_world.transform_point3(point.position_in_world_m).as_vec3();
            let (aside, over) = at_m.try_normalize().unwrap_or(Vec3::Z).any_orthonormal_pair();
            SampledLamp {
                at_m,
                color: point.color,
                range_m: point.range_m,
                spot: point.spot.map(|(axis, angles)| (turn * axis, angles)),
                radius_m: 0.5 * point.diameter_m,
                // Points of a large lamp may be below the horizon.
                points_m: disc(LAMP_POINTS)
                    .map(|at| at_m + 0.5 * point.diameter_m * (aside * at.x + over * at.y))
                    .filter(|point_m| at_m.z <= 0.0 || point_m.z > 0.0)
                    .collect(),
            }
        });
        let light = rays.iter().map(|ray| ray.light).sum();
        let (lamps, hidden) = lamps.partition(|lamp| lamp.at_m.z > 0.0 && !lamp.points_m.is_empty());
        let back_light =
            far.map(|far| Arc::new(BackLight { far: distant_back_light(far, &lighting.suns, turn), lamps: hidden }));
        Self { rays, lamps, light, back_light }
    }

    /// Removes the suns behind a facet, by their direction, and the lamps there, by their position,
    /// for which `sun` and `lamp` are true.
    pub fn without_back_lights(mut self, sun: impl Fn(Vec3) -> bool, lamp: impl Fn(Vec3) -> bool) -> Self {
        if let Some(back_light) = &mut self.back_light {
            let BackLight { far, lamps } = Arc::make_mut(back_light);
            far.retain(|far| far.solid_sr > 0.0 || !sun(far.towards));
            lamps.retain(|beyond| !lamp(beyond.at_m));
        }
        self
    }

    /// An eighth of the rays and of the lamps' points, with the light of all: for previews.
    pub fn sparse(&self) -> Self {
        let stride = PREVIEW_STRIDE;
        let kept: Vec<SkyRay> = self.rays.iter().skip(stride / 2).step_by(stride).copied().collect();
        let sum: Vec3 = kept.iter().map(|ray| ray.light).sum();
        let brighter = Vec3::select(sum.cmpgt(Vec3::ZERO), self.light / sum.max(Vec3::splat(1e-20)), Vec3::ONE);
        // The patch of each ray is larger by the same factor.
        let sparse_ray = |ray: SkyRay| SkyRay {
            light: ray.light * brighter,
            angle_rad: ray.angle_rad * (stride as f32).sqrt(),
            ..ray
        };
        let rays: Vec<SkyRay> = kept.into_iter().map(sparse_ray).collect();
        let light = rays.iter().map(|ray| ray.light).sum();
        let sparse_lamp = |lamp: &SampledLamp| {
            let points_m = lamp.points_m.iter().skip(stride / 2).step_by(stride).copied().collect();
            SampledLamp { points_m, ..lamp.clone() }
        };
        Self {
            rays: rays.into(),
            lamps: self.lamps.iter().map(sparse_lamp).collect(),
            light,
            back_light: self.back_light.clone(),
        }
    }

    /// Mean angular radius of the patches of each class, weighted by light, rad; 0 for a class
    /// without rays, and for the first class, whose patches are points.
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

    /// All light at a place on the plane without occluders.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light + self.lamps.iter().map(|lamp| lamp.light_at(place_m)).sum::<Vec3>()
    }
}

/// Distant light from below a plane, in its axes.
fn distant_back_light(far: &[EnvSample], suns: &[Sun], plane_from_world: Mat3) -> Vec<EnvSample> {
    let sun = |sun: &Sun| EnvSample { towards: sun.towards_light_in_world, light: sun.color, solid_sr: 0.0 };
    let all = far.iter().copied().chain(suns.iter().map(sun));
    let turned = all.map(|far| EnvSample { towards: plane_from_world * far.towards, ..far });
    turned.filter(|far| far.towards.z < 0.0).collect()
}

/// The class of rays by the angular radius of their patches.
pub fn class(angle_rad: f32) -> usize {
    MIN_CLASS_ANGLES_RAD.iter().take_while(|min_rad| angle_rad >= **min_rad).count()
}

impl SampledLamp {
    /// Angular radius of the patch of one of its points, from the plane below the objects, rad.
    pub fn angle_rad(&self) -> f32 {
        self.radius_m / (self.points_m.len().max(1) as f32).sqrt() / self.at_m.length().max(1e-6)
    }

    /// This sky with its light multiplied by a factor.
    pub fn scaled(&self, factor: f32) -> Self {
        Self { color: factor * self.color, ..self.clone() }
    }

    /// Its light on the plane, the same as in shaders/raster.wgsl: range and spot by
    /// KHR_lights_punctual.
    pub fn light_at(&self, place_m: Vec2) -> Vec3 {
        self.light_on(place_m.extend(0.0), Vec3::Z)
    }

    /// Its light on a surface with some normal, in the plane's axes.
    pub fn light_on(&self, place_m: Vec3, normal: Vec3) -> Vec3 {
        on_surface(self.at_m - place_m, normal, self.color, self.range_m, self.spot)
    }
}

/// Radiance of a white Lambertian surface by a lamp at the offset `towards`, m, in the axes of
/// `normal` and the spot's axis. Range and spot by KHR_lights_punctual.
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

    fn sky(lighting: &Lighting, normal: DVec3) -> PlaneLighting {
        let plane = ReceiverPlane::new(DVec3::ZERO, normal);
        PlaneLighting::new(
            lighting,
            rays(lighting, &EnvironmentImage::new(&lighting.environment), &plane),
            &plane,
            None,
        )
    }

    #[test]
    fn uniform_sky_lights_any_plane_with_its_radiance_by_the_cosine() {
        let lighting = Lighting { environment: Environment::Uniform(Vec3::new(0.5, 1.0, 2.0)), ..Default::default() };
        for normal in [DVec3::Y, DVec3::Z, DVec3::new(1.0, -2.0, 0.5).normalize()] {
            let sky = sky(&lighting, normal);
            assert!((sky.light / Vec3::new(0.5, 1.0, 2.0) - 1.0).abs().max_element() < 0.01, "{normal}: {}", sky.light);
            // ∫ cos θ sin θ: half of the irradiance comes from within 45° of the normal, with
            // slopes below 1.
            let steep: f32 = sky.rays.iter().filter(|r| r.slope.length() < 1.0).map(|r| r.light.y).sum();
            assert!((steep - 0.5).abs() < 0.02, "{normal}: {steep}");
            let aside: Vec2 = sky.rays.iter().filter(|r| r.slope.length() < 1.0).map(|r| r.slope * r.light.y).sum();
            assert!(aside.length() < 0.02, "{normal}: {aside}");
        }
    }

    #[test]
    fn sphere_samples_have_all_light_and_cover_the_sphere() {
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
        let far = EnvironmentImage::new(&Environment::Map(map)).sphere_samples();
        let solid: f32 = far.iter().map(|far| far.solid_sr).sum();
        assert!((solid - 4.0 * PI).abs() < 1e-3, "{solid}");
        // A surface that faces one half of the sky has its radiance.
        for (normal, expected) in [(Vec3::NEG_X, Vec3::X * 10.0), (Vec3::X, Vec3::Z * 2.0)] {
            let radiance: Vec3 = far.iter().map(|far| far.light * far.towards.dot(normal).max(0.0)).sum();
            assert!((radiance - expected).abs().max_element() < 0.03 * expected.max_element(), "{normal}: {radiance}");
        }
        let dark = far.iter().filter(|far| far.light.z > 0.0).count();
        assert!(dark > far.len() / 4, "{dark} of {} for the darker half", far.len());
        // A black sky is sampled too: surfaces reflect the light of lamps.
        assert_eq!(EnvironmentImage::new(&Environment::Uniform(Vec3::ZERO)).sphere_samples().len(), far.len());
    }

    #[test]
    fn sun_has_its_irradiance_by_the_cosine_and_its_diameter() {
        let towards = Vec3::new(0.6, 0.0, 0.8);
        let sun = Sun { towards_light_in_world: towards, color: Vec3::splat(2.0), diameter_rad: 0.2 };
        let lighting = Lighting { suns: vec![sun], environment: Environment::Uniform(Vec3::ZERO), points: Vec::new() };
        let sky = sky(&lighting, DVec3::Z);
        assert_eq!(sky.rays.len(), SUN_RAYS);
        assert!((sky.light.x - 1.6).abs() < 1e-4, "{}", sky.light);
        let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
        let slopes = sky.rays.iter().map(|r| (plane.axes * r.slope.extend(1.0).as_dvec3()).as_vec3().normalize());
        let widest = slopes.map(|d| d.angle_between(towards)).fold(0.0, f32::max);
        assert!((widest - 0.1).abs() < 0.002, "{widest}");
    }
}
