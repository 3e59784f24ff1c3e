//! Ray casting for lightmaps: occluders, environment rays and lights around an object.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::ops::Range;
use std::sync::OnceLock;

use glam::Vec3;

use super::bvh::{Bvh, RAYS, RayPacket};
use super::occluders::Occluders;
use super::planar_shadow::PlanarShadow;
use super::sky::{EnvSample, disc, on_surface};
use crate::digest::{Digester, Digestible};
use crate::scene::{Lighting, PointLight};

/// Samples of a sun's or a lamp's disc.
const DISC_SAMPLES: usize = 16;
/// Irradiance of hit triangles uses one of this many environment rays.
const ENV_SUBSAMPLING: usize = 4;
/// Clusters of triangles with common irradiance: cells along a part's longest side, and steps per
/// axis of the unit normal, so that normals of a cluster differ by at most 40°. A cartridge case of
/// 6240 triangles has 1483 clusters, a marker of 2648 has 916.
const CLUSTER_CELLS: f32 = 12.0;
const CLUSTER_NORMAL_STEPS: f32 = 2.0;
/// Offset of a ray's origin from its surface, as a fraction of the scene's size: 100 times single
/// precision.
const RAY_OFFSET: f32 = 2e-5;

/// All that a lightmap depends on except the surface. Places are relative to the object's origin,
/// in the axes of the world.
pub struct BakeInputs<'a> {
    pub occluders: &'a Occluders,
    pub environment: &'a [EnvSample],
    pub lighting: &'a Lighting,
    pub planar_shadows: &'a [PlanarShadow],
    /// Largest number of suns and of lamps.
    pub max_lights: [usize; 2],
}

impl Digestible for BakeInputs<'_> {
    fn digest(&self, into: &mut Digester) {
        let Self { occluders, environment, lighting, planar_shadows, max_lights } = self;
        // The samples of the environment stand for it.
        let Lighting { environment: _, suns, points } = lighting;
        into.add(occluders);
        into.add(*environment);
        into.add(suns);
        into.add(points);
        into.add(*planar_shadows);
        into.add_numbers(max_lights);
    }
}

/// A sun with directions to the samples of its disc, or a lamp with the samples' positions; with
/// the radiance of white matt that faces it.
enum BakeLight<'a> {
    Sun { directions: Vec<Vec3>, color: Vec3 },
    Lamp { positions: Vec<Vec3>, lamp: &'a PointLight, centre: Vec3 },
}

/// A point of a surface, with the interpolated normal and the flat triangle's.
pub struct SurfacePoint {
    pub position: Vec3,
    pub normal: Vec3,
    pub face_normal: Vec3,
}

/// Light that arrives at a point.
#[derive(Clone, Debug)]
pub struct Incident {
    /// Fraction of the environment's irradiance that arrives, per channel.
    pub sky_visibility: Vec3,
    /// Radiance of white matt by indirect light.
    pub indirect: Vec3,
    /// Visible fraction of each light's disc, suns first.
    pub light_visibility: Vec<f32>,
}

impl Incident {
    pub fn none(lights: usize) -> Self {
        Self { sky_visibility: Vec3::ZERO, indirect: Vec3::ZERO, light_visibility: vec![0.0; lights] }
    }

    pub fn add(&mut self, other: &Self, weight: f32) {
        self.sky_visibility += weight * other.sky_visibility;
        self.indirect += weight * other.indirect;
        let visibilities = self.light_visibility.iter_mut().zip(&other.light_visibility);
        visibilities.for_each(|(sum, visibility)| *sum += weight * visibility);
    }

    pub fn zip_with(&self, other: &Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let each = |a: Vec3, b: Vec3| Vec3::new(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z));
        let visibilities = self.light_visibility.iter().zip(&other.light_visibility);
        Self {
            sky_visibility: each(self.sky_visibility, other.sky_visibility),
            indirect: each(self.indirect, other.indirect),
            light_visibility: visibilities.map(|(a, b)| f(*a, *b)).collect(),
        }
    }

    /// True if it exceeds another one by at most a fraction of all light; indirect light by at most
    /// twice that fraction of itself.
    pub fn is_within(&self, lower: &Self, fraction: f32) -> bool {
        let mut visibilities = self.light_visibility.iter().zip(&lower.light_visibility);
        (self.sky_visibility - lower.sky_visibility).max_element() <= fraction
            && (self.indirect - lower.indirect - 2.0 * fraction * self.indirect).max_element() <= 1e-6
            && visibilities.all(|(high, low)| high - low <= fraction)
    }
}

/// The acceleration structure with rays and lights.
pub struct BakeScene<'a> {
    inputs: &'a BakeInputs<'a>,
    bvh: Bvh,
    /// Directions of the environment's samples, [`RAYS`] at a time, and of every
    /// [`ENV_SUBSAMPLING`]th.
    rays: Vec<RayPacket>,
    sparse_rays: Vec<RayPacket>,
    lights: Vec<BakeLight<'a>>,
    offset_m: f32,
    /// Irradiance / π of each cluster's first triangle on its front, computed on demand. No memo:
    /// indexed by each ray that hits a triangle, on all threads.
    irradiance: Vec<OnceLock<Vec3>>,
    /// First triangle of each triangle's cluster.
    cluster_of: Vec<u32>,
}

impl<'a> BakeScene<'a> {
    pub fn new(inputs: &'a BakeInputs<'a>) -> Self {
        let (occluders, lighting) = (inputs.occluders, inputs.lighting);
        let corners = occluders.corners.iter();
        let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(*c), h.max(*c)));
        let disc_around = |towards: Vec3, radius: f32| -> Vec<Vec3> {
            let (aside, over) = towards.any_orthonormal_pair();
            disc(DISC_SAMPLES).map(|at| radius * (aside * at.x + over * at.y)).collect()
        };
        let sun = |sun: &crate::scene::Sun| {
            let towards = sun.towards_light_in_world;
            let offsets = disc_around(towards, (0.5 * sun.diameter_rad).tan());
            let directions = offsets.into_iter().map(|offset| (towards + offset).normalize()).collect();
            BakeLight::Sun { directions, color: sun.color }
        };
        let lamp = |lamp: &'a PointLight| {
            let centre = lamp.position_in_world_m.as_vec3();
            let offsets = disc_around(centre.try_normalize().unwrap_or(Vec3::Z), 0.5 * lamp.diameter_m);
            BakeLight::Lamp { positions: offsets.into_iter().map(|offset| centre + offset).collect(), lamp, centre }
        };
        let [max_suns, max_lamps] = inputs.max_lights;
        let suns = lighting.suns.iter().take(max_suns).map(sun);
        let lights = suns.chain(lighting.points.iter().take(max_lamps).map(lamp)).collect();
        let bundles = inputs.environment.chunks(RAYS);
        let patches = inputs.environment.chunks(RAYS * ENV_SUBSAMPLING);
        Self {
            inputs,
            bvh: Bvh::new(&occluders.corners, &occluders.triangles),
            rays: bundles.map(|samples| RayPacket::new(samples.iter().map(|sample| sample.towards))).collect(),
            sparse_rays: patches.map(|patch| RayPacket::new(sparse(patch).map(|sample| sample.towards))).collect(),
            lights,
            offset_m: RAY_OFFSET * (high - low).max_element().max(1e-6),
            irradiance: occluders.triangles.iter().map(|_| OnceLock::new()).collect(),
            cluster_of: occluders.parts.iter().flat_map(|part| clusters(occluders, part.clone())).collect(),
        }
    }

    pub fn light_count(&self) -> usize {
        self.lights.len()
    }

    /// Light that arrives at a point.
    pub fn incident(&self, point: &SurfacePoint) -> Incident {
        let from = point.position + self.offset_m * point.face_normal;
        let (mut all, mut direct, mut indirect) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for (samples, bundle) in self.inputs.environment.chunks(RAYS).zip(&self.rays) {
            let cosines = bundle.dot(point.normal);
            if cosines.iter().all(|cosine| *cosine <= 0.0) {
                continue;
            }
            // Rays below the face are skipped, and those behind the normal contribute nothing.
            let mut farthest = bundle.front_facing_lengths(point.face_normal, f32::INFINITY);
            farthest.iter_mut().zip(cosines).for_each(|(far, cosine)| *far = if cosine > 0.0 { *far } else { 0.0 });
            let hits = self.bvh.first(from, bundle, farthest);
            for ((sample, cosine), hit) in
                samples.iter().zip(cosines).zip(hits).filter(|((_, cosine), _)| *cosine > 0.0)
            {
                let light = sample.light * cosine;
                all += light;
                match hit {
                    Some(hit) => {
                        let radiance = self.reflected(hit.triangle, sample.towards);
                        indirect += radiance * (cosine * sample.solid_sr / PI);
                    }
                    None => direct += light * self.floor_transmittance(from, sample.towards),
                }
            }
        }
        let visibilities = self.lights.iter().map(|light| self.disc_visibility(light, from, point.face_normal));
        Incident { sky_visibility: ratio_or_one(direct, all), indirect, light_visibility: visibilities.collect() }
    }

    /// Fraction of a light's disc that is visible.
    fn disc_visibility(&self, light: &BakeLight<'_>, from: Vec3, face_normal: Vec3) -> f32 {
        let hidden = |rays: &mut dyn Iterator<Item = Vec3>, farthest: f32| {
            let bundle = RayPacket::new(rays);
            let hidden = self.bvh.any(from, &bundle, bundle.front_facing_lengths(face_normal, farthest));
            hidden.into_iter().filter(|is_hidden| *is_hidden).count()
        };
        let hidden: usize = match light {
            BakeLight::Sun { directions, .. } => {
                directions.chunks(RAYS).map(|some| hidden(&mut some.iter().copied(), f32::INFINITY)).sum()
            }
            BakeLight::Lamp { positions, .. } => {
                positions.chunks(RAYS).map(|some| hidden(&mut some.iter().map(|to| *to - from), 1.0)).sum()
            }
        };
        1.0 - hidden as f32 / DISC_SAMPLES as f32
    }

    /// Transmittance of the planar shadows where a ray meets the floors.
    fn floor_transmittance(&self, from: Vec3, towards: Vec3) -> Vec3 {
        let mut transmittance = Vec3::ONE;
        for planar_shadow in self.inputs.planar_shadows {
            let normal = planar_shadow.plane.normal();
            let down = -normal.dot(towards.as_dvec3());
            let at = from.as_dvec3();
            let height = planar_shadow.plane.height_m(at);
            if down > 1e-6 && height > 0.0 {
                let meets = at + towards.as_dvec3() * (height / down);
                transmittance *= (Vec3::ONE - planar_shadow.removed_at(meets)).max(Vec3::ZERO);
            }
        }
        transmittance
    }

    /// Radiance of a triangle against a ray. Backs are black.
    fn reflected(&self, triangle: u32, towards: Vec3) -> Vec3 {
        let occluders = self.inputs.occluders;
        if occluders.centroid_and_normal(triangle as usize).1.dot(towards) >= 0.0 {
            return Vec3::ZERO;
        }
        let first = self.cluster_of[triangle as usize] as usize;
        let irradiance = self.irradiance[first].get_or_init(|| {
            let (middle, front) = occluders.centroid_and_normal(first);
            self.direct_light(middle, front)
        });
        occluders.colors[triangle as usize] * *irradiance
    }

    /// Radiance of white matt by the environment and the lights, without indirect light.
    fn direct_light(&self, at: Vec3, normal: Vec3) -> Vec3 {
        let from = at + self.offset_m * normal;
        // The sparse rays estimate the visible fraction of all rays' light: E = E_all · Σ visible /
        // Σ sampled.
        let (mut all, mut sampled, mut visible) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for (patch, bundle) in self.inputs.environment.chunks(RAYS * ENV_SUBSAMPLING).zip(&self.sparse_rays) {
            let light = |sample: &EnvSample| sample.light * sample.towards.dot(normal).max(0.0);
            let of_patch: Vec3 = patch.iter().map(light).sum();
            if of_patch == Vec3::ZERO {
                continue;
            }
            all += of_patch;
            let farthest = bundle.front_facing_lengths(normal, f32::INFINITY);
            let hidden = self.bvh.any(from, bundle, farthest);
            for ((sample, is_hidden), _) in sparse(patch).zip(hidden).zip(farthest).filter(|(_, far)| *far > 0.0) {
                sampled += light(sample);
                if !is_hidden {
                    visible += light(sample) * self.floor_transmittance(from, sample.towards);
                }
            }
        }
        let lights = self.lights.iter().map(|light| {
            let unoccluded = match light {
                BakeLight::Sun { directions, color } => *color * directions[0].dot(normal).max(0.0),
                BakeLight::Lamp { lamp, centre, .. } => {
                    on_surface(*centre - from, normal, lamp.color, lamp.range_m, lamp.spot)
                }
            };
            if unoccluded == Vec3::ZERO { Vec3::ZERO } else { unoccluded * self.disc_visibility(light, from, normal) }
        });
        all * ratio_or_one(visible, sampled) + lights.sum::<Vec3>()
    }
}

/// Channel by channel; 1 where there is no light at all.
fn ratio_or_one(part: Vec3, all: Vec3) -> Vec3 {
    Vec3::select(all.cmpgt(Vec3::splat(1e-9)), part / all.max(Vec3::splat(1e-9)), Vec3::ONE)
}

/// Every [`ENV_SUBSAMPLING`]th sample of a patch.
fn sparse(patch: &[EnvSample]) -> impl Iterator<Item = &EnvSample> {
    patch.iter().skip(ENV_SUBSAMPLING / 2).step_by(ENV_SUBSAMPLING)
}

/// The first triangle of the cluster of each triangle of a part.
fn clusters(occluders: &Occluders, part: Range<usize>) -> impl Iterator<Item = u32> {
    let corners = occluders.triangles[part.clone()].iter().flatten().map(|i| occluders.corners[*i as usize]);
    let (low, high) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
    let per_cell = CLUSTER_CELLS / (high - low).max_element().max(1e-9);
    let mut firsts = HashMap::new();
    part.map(move |triangle| {
        let (middle, front) = occluders.centroid_and_normal(triangle);
        let cell = ((middle - low) * per_cell).floor().as_ivec3();
        *firsts.entry((cell, (CLUSTER_NORMAL_STEPS * front).round().as_ivec3())).or_insert(triangle as u32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clusters_join_coplanar_neighbours_of_one_part() {
        // 1 m long; the first two lie in one cell of a twelfth of that, the third beyond, the
        // fourth faces the other way.
        let triangle =
            |x: f32, y: f32| [Vec3::new(x, y, 0.0), Vec3::new(x + 0.01, y, 0.0), Vec3::new(x, y + 0.01, 0.0)];
        let mut corners = [triangle(0.0, 0.0), triangle(0.02, 0.03), triangle(0.99, 0.0), triangle(0.02, 0.0)].concat();
        corners.swap(10, 11);
        corners.extend(corners.clone());
        let triangles: Vec<[u32; 3]> = (0..8).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
        let occluders = Occluders { corners, triangles, parts: vec![0..4, 4..8], ..Occluders::default() };
        let all: Vec<u32> = occluders.parts.iter().flat_map(|part| clusters(&occluders, part.clone())).collect();
        assert_eq!(all, [0, 0, 2, 3, 4, 4, 6, 7]);
    }
}
