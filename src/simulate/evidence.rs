//! Objects of a scene as a real part of the site: ground truth for compositing into the empty site.
//!
//! Path tracing (Kajiya 1986). At a point of an object, lamps are sampled by area, diffuse light by
//! the cosine, gloss by its own lobe (GGX, Walter et al. 2007). Surfaces of the site keep the light
//! of their charts, corrected by the light that objects block and reflect. So a picture differs
//! from the empty site's by the objects alone.
//!
//! The diffuse part of an object gathers indirect light exactly as the site's surfaces do: from the
//! same 64 directions and with the coarse model ([`SiteLight::coarse_light`]). Only gloss reflects
//! the detailed room. With the detailed room in diffuse light as well, a white object would be up
//! to 1.4 times as bright as the white floor below it.
//!
//! Not modelled: normal maps, transparency, light beyond the second object.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use super::bvh::{Triangle, TriangleHit, Triangles};
use super::hemisphere::{GATHER_DIRECTIONS, random_cosine_direction, spiral_direction, tangent_frame};
use super::lamps::SiteLamp;
use super::random::Random;
use crate::scene::{Alpha, Material, Scene, SceneTexture, TextureUse, Vertex, Wrap};

/// Samples per camera ray: of each lamp, of diffuse light onto the site, and of gloss. Secondary
/// rays use one of each.
const LAMP_SAMPLES: usize = 8;
const DIFFUSE_SAMPLES: usize = 8;
const SPECULAR_SAMPLES: usize = 4;
/// Path depth from which rays are tested against lamps only.
const MAX_PATH_DEPTH: u32 = 2;
/// Offset of ray origins from the surface, metres.
const RAY_OFFSET_M: f64 = 2e-4;
/// Reflectance of dielectrics at normal incidence (glTF).
const DIELECTRIC_F0: f64 = 0.04;
/// Smallest α, the square of the roughness.
const MIN_ALPHA: f64 = 2e-3;

/// A triangle's vertices, vertex normals and material.
#[derive(Clone, Debug)]
struct Face {
    corners: [Vertex; 3],
    normals: [DVec3; 3],
    material: usize,
}

/// Queries of the empty site by its objects.
pub trait SiteLight {
    fn lamps(&self) -> &[SiteLamp];

    /// True if the site blocks the segment from `origin` to `origin + to`.
    fn blocked(&self, origin: DVec3, to: DVec3) -> bool;

    /// Distance along a ray, in lengths of `direction`.
    fn distance(&self, origin: DVec3, direction: DVec3) -> f64;

    /// Light along a ray that hits no lamp, without mirror images. `more` returns the additional
    /// incident light, beyond the chart's, at a position and normal.
    fn detailed_light(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3;

    /// Light along a ray under the coarse model of indirect light, with `more` as above.
    fn coarse_light(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3;
}

/// Triangles of all objects in world axes, with their materials.
#[derive(Clone, Debug)]
pub struct Evidence {
    triangles: Triangles,
    faces: Vec<Face>,
    materials: Vec<Material>,
    textures: Vec<SceneTexture>,
}

/// Material parameters at a point of an object.
struct ShadingPoint {
    at: DVec3,
    normal: DVec3,
    albedo: DVec3,
    f0: DVec3,
    alpha: f64,
    emission: DVec3,
}

/// Effect of the objects on a surface of the site.
pub struct LightChange {
    /// Change of the incident light, as the radiance of a white surface.
    pub light: DVec3,
    /// Share of the lamps that the objects occlude.
    pub occluded: f64,
}

impl Evidence {
    /// The objects of a scene at their positions there; axes of the site, metres.
    pub fn new(scene: &Scene) -> Self {
        let (mut triangles, mut faces) = (Vec::new(), Vec::new());
        for part in scene.objects.iter().flat_map(|object| &object.parts) {
            let mesh = &scene.meshes[part.mesh];
            let turned = part.world_from_mesh.matrix3.inverse().transpose();
            for corners in mesh.indices.chunks_exact(3) {
                let corners = [0, 1, 2].map(|k| mesh.vertices[corners[k] as usize]);
                let [a, b, c] =
                    corners.map(|v| part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from))));
                let normals = corners.map(|v| (turned * DVec3::from(v.normal.map(f64::from))).normalize_or_zero());
                triangles.push(Triangle { corner: a, sides: [b - a, c - a] });
                faces.push(Face { corners, normals, material: mesh.material });
            }
        }
        Self {
            triangles: Triangles::new(triangles),
            faces,
            materials: scene.materials.clone(),
            textures: scene.textures.clone(),
        }
    }

    /// Nearest intersection of a ray with an object.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<TriangleHit> {
        self.triangles.hit(origin, direction, f64::INFINITY)
    }

    /// Normal and diffuse albedo at a point of an object.
    pub fn normal_and_albedo(&self, touch: &TriangleHit, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        let surface = self.shading_point(touch, origin, direction);
        (surface.normal, surface.albedo)
    }

    /// Light that an object sends back along a ray.
    pub fn light(&self, site: &dyn SiteLight, touch: &TriangleHit, origin: DVec3, direction: DVec3) -> DVec3 {
        let mut random = Random::new([touch.t.to_bits(), direction.x.to_bits(), direction.y.to_bits(), 0]);
        self.outgoing(site, touch, origin, direction, 0, &mut random)
    }

    /// Effect of the objects on a surface of the site at `p` with normal `n`.
    pub fn change(&self, site: &dyn SiteLight, p: DVec3, n: DVec3) -> LightChange {
        let mut random = Random::new([p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), 1]);
        self.light_change(site, p + n * RAY_OFFSET_M, n, 0, &mut random)
    }

    fn light_change(&self, site: &dyn SiteLight, p: DVec3, n: DVec3, depth: u32, random: &mut Random) -> LightChange {
        let mut change = LightChange { light: DVec3::ZERO, occluded: 0.0 };
        let lamps = if depth == 0 { LAMP_SAMPLES } else { 1 };
        for lamp in site.lamps() {
            let each = 1.0 / lamps as f64;
            for k in 0..lamps {
                let to = lamp.sample_point(k, lamps, random) - p;
                let share = lamp.white_radiance(to, n);
                if share > 0.0 && self.triangles.hit(p, to, 1.0).is_some() && !site.blocked(p, to) {
                    change.light -= lamp.radiance * (share * each);
                    change.occluded += each / site.lamps().len() as f64;
                }
            }
        }
        if depth + 1 < MAX_PATH_DEPTH {
            let count = if depth == 0 { DIFFUSE_SAMPLES } else { 1 };
            for k in 0..count {
                let direction = random_cosine_direction(n, k, count, random);
                let far = site.distance(p, direction);
                if let Some(touch) = self.triangles.hit(p, direction, far) {
                    let now = self.outgoing(site, &touch, p, direction, depth + 1, random);
                    change.light += (now - site.coarse_light(p, direction, &mut |_, _| DVec3::ZERO)) / count as f64;
                }
            }
        }
        change
    }

    /// Light along a ray that hits no lamp, by the detailed or the coarse model.
    fn incident(
        &self,
        site: &dyn SiteLight,
        (origin, direction): (DVec3, DVec3),
        depth: u32,
        is_detailed: bool,
        random: &mut Random,
    ) -> DVec3 {
        let far = site.distance(origin, direction);
        if let Some(touch) = self.triangles.hit(origin, direction, far) {
            return self.outgoing(site, &touch, origin, direction, depth, random);
        }
        let more = &mut |p, n| self.light_change(site, p + n * RAY_OFFSET_M, n, depth, random).light;
        if is_detailed {
            site.detailed_light(origin, direction, more)
        } else {
            site.coarse_light(origin, direction, more)
        }
    }

    fn outgoing(
        &self,
        site: &dyn SiteLight,
        touch: &TriangleHit,
        origin: DVec3,
        direction: DVec3,
        depth: u32,
        random: &mut Random,
    ) -> DVec3 {
        let surface = self.shading_point(touch, origin, direction);
        let (n, to_eye) = (surface.normal, -direction.normalize());
        let p = surface.at;
        let mut light = surface.emission;
        let count = if depth == 0 { LAMP_SAMPLES } else { 1 };
        for lamp in site.lamps() {
            for k in 0..count {
                let to = lamp.sample_point(k, count, random) - p;
                // E/π. White diffuse reflects 1 of it, a lobe f reflects f·π.
                let share = lamp.white_radiance(to, n);
                if share > 0.0 && !site.blocked(p, to) && self.triangles.hit(p, to, 1.0).is_none() {
                    let lobe = surface.specular_brdf(to.normalize(), to_eye);
                    light += lamp.radiance * (surface.albedo + PI * lobe) * (share / count as f64);
                }
            }
        }
        if depth >= MAX_PATH_DEPTH {
            return light;
        }
        let count = if depth == 0 { GATHER_DIRECTIONS } else { 1 };
        for k in 0..count {
            let direction =
                if depth == 0 { spiral_direction(n, k, count) } else { random_cosine_direction(n, k, count, random) };
            light += surface.albedo * self.incident(site, (p, direction), depth + 1, false, random) / count as f64;
        }
        let count = if depth == 0 { SPECULAR_SAMPLES } else { 1 };
        for _ in 0..count {
            if let Some((direction, weight)) = surface.sample_specular(to_eye, random) {
                light += weight * self.incident(site, (p, direction), depth + 1, true, random) / count as f64;
            }
        }
        light
    }

    fn shading_point(&self, touch: &TriangleHit, origin: DVec3, direction: DVec3) -> ShadingPoint {
        let face = &self.faces[touch.face];
        let material = &self.materials[face.material];
        let shares = [1.0 - touch.barycentric.x - touch.barycentric.y, touch.barycentric.x, touch.barycentric.y];
        let mixed = |of: fn(&Vertex) -> [f32; 4]| {
            let sum = |channel: usize| {
                face.corners.iter().zip(shares).map(|(v, share)| f64::from(of(v)[channel]) * share).sum::<f64>()
            };
            [0, 1, 2, 3].map(sum)
        };
        let [u0, v0, u1, v1] = mixed(|v| [v.uv0[0], v.uv0[1], v.uv1[0], v.uv1[1]]);
        let sample = |used: &Option<TextureUse>| match used {
            Some(used) => {
                let [u, v] = if used.uv_set == 0 { [u0, v0] } else { [u1, v1] };
                texel(&self.textures[used.texture], used, DVec2::new(u, v))
            }
            None => [1.0; 4],
        };
        let [r, g, b, _] = mixed(|v| v.color);
        let [tr, tg, tb, _] = sample(&material.base_color_texture);
        let factor = DVec3::from([0, 1, 2].map(|c| f64::from(material.base_color[c])));
        let base = factor * DVec3::new(r * tr, g * tg, b * tb);
        let [_, rough, metal, _] = sample(&material.metallic_roughness_texture);
        let (roughness, metallic) = (f64::from(material.roughness) * rough, f64::from(material.metallic) * metal);
        let [er, eg, eb, _] = sample(&material.emissive_texture);
        let emission = Vec3::from(material.emissive).as_dvec3() * DVec3::new(er, eg, eb);

        let flat = self.triangles.normal(touch.face);
        let towards = |n: DVec3| if n.dot(direction) > 0.0 { -n } else { n };
        let flat = towards(flat);
        let smooth: DVec3 = face.normals.iter().zip(shares).map(|(n, share)| *n * share).sum();
        let smooth = smooth.normalize_or(flat);
        let smooth = if smooth.dot(flat) < 0.0 { -smooth } else { smooth };
        // A shading normal that faces away from the eye would receive no light.
        let normal = if smooth.dot(direction) < 0.0 { smooth } else { flat };
        ShadingPoint {
            at: origin + direction * touch.t + flat * RAY_OFFSET_M,
            normal,
            albedo: if material.unlit { DVec3::ZERO } else { base * ((1.0 - metallic) * (1.0 - DIELECTRIC_F0)) },
            f0: if material.unlit { DVec3::ZERO } else { DVec3::splat(DIELECTRIC_F0).lerp(base, metallic) },
            alpha: (roughness * roughness).max(MIN_ALPHA),
            emission: if material.unlit { base } else { emission },
        }
    }

    /// The first material feature that cannot be rendered.
    pub fn unsupported(scene: &Scene) -> Option<&'static str> {
        let any = |is: fn(&Material) -> bool| scene.materials.iter().any(is);
        if any(|material| matches!(material.alpha, Alpha::Blend | Alpha::Mask(_))) {
            Some("transparency")
        } else if any(|material| material.normal_texture.is_some()) {
            Some("a normal map")
        } else {
            None
        }
    }
}

impl ShadingPoint {
    /// F·D·V (Walter et al. 2007 with the height-correlated masking of Heitz 2014, Schlick's F).
    fn specular_brdf(&self, to_light: DVec3, to_eye: DVec3) -> DVec3 {
        let half = (to_light + to_eye).normalize_or_zero();
        let (nl, nv, nh) = (self.normal.dot(to_light), self.normal.dot(to_eye).max(1e-4), self.normal.dot(half));
        if nl <= 0.0 {
            return DVec3::ZERO;
        }
        let a2 = self.alpha * self.alpha;
        let d = a2 / (PI * (nh * nh * (a2 - 1.0) + 1.0).powi(2));
        self.fresnel(to_eye.dot(half)) * (d * self.masking(nl, nv))
    }

    fn masking(&self, nl: f64, nv: f64) -> f64 {
        let a2 = self.alpha * self.alpha;
        let masking_term = |a: f64, b: f64| a * (b * b * (1.0 - a2) + a2).sqrt();
        0.5 / (masking_term(nl, nv) + masking_term(nv, nl)).max(1e-9)
    }

    fn fresnel(&self, cosine: f64) -> DVec3 {
        self.f0 + (DVec3::ONE - self.f0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
    }

    /// A direction sampled by the distribution of normals, and its weight: f·(n·l) / p, p = D·(n·h)
    /// / 4(v·h).
    fn sample_specular(&self, to_eye: DVec3, random: &mut Random) -> Option<(DVec3, DVec3)> {
        let (u, turn) = (random.uniform(), TAU * random.uniform());
        let a2 = self.alpha * self.alpha;
        let up = ((1.0 - u) / (1.0 + (a2 - 1.0) * u)).sqrt();
        let half = tangent_frame(self.normal) * DVec2::from_angle(turn).extend(0.0) * (1.0 - up * up).max(0.0).sqrt()
            + self.normal * up;
        let (vh, nv) = (to_eye.dot(half), self.normal.dot(to_eye).max(1e-4));
        let direction = 2.0 * vh * half - to_eye;
        let nl = self.normal.dot(direction);
        let weight = self.fresnel(vh) * (4.0 * self.masking(nl, nv) * vh * nl / up.max(1e-6));
        (vh > 0.0 && nl > 0.0).then_some((direction, weight))
    }
}

/// A texture's value at (u, v), bilinear between texels.
fn texel(texture: &SceneTexture, used: &TextureUse, uv: DVec2) -> [f64; 4] {
    let at = used.transform.map(|[a, b, c]| f64::from(a) * uv.x + f64::from(b) * uv.y + f64::from(c));
    let size = [texture.width, texture.height].map(i64::from);
    let wrapped = |i: i64, axis: usize| {
        let size = size[axis];
        match texture.wrap[axis] {
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Clamp => i.clamp(0, size - 1),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * size);
                i.min(2 * size - 1 - i)
            }
        }
    };
    let [x, y] = [0, 1].map(|axis| at[axis] * size[axis] as f64 - 0.5);
    let mut sum = [0.0; 4];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let (i, j) = (x.floor() as i64 + dx, y.floor() as i64 + dy);
        let share = (1.0 - (x - i as f64).abs()) * (1.0 - (y - j as f64).abs());
        let n = 4 * (wrapped(j, 1) * size[0] + wrapped(i, 0)) as usize;
        for (channel, sum) in sum.iter_mut().enumerate() {
            let code = texture.rgba[n + channel];
            let value = if channel < 3 { texture.linear(code) } else { f32::from(code) / 255.0 };
            *sum += share * f64::from(value);
        }
    }
    sum
}
