//! Things that really are in the site: a scene's objects, for the truth beside what is composited into the empty site.
//!
//! Paths are traced (Kajiya 1986): at a point of an object lamps are sampled by their area, matt light by the cosine, gloss by its
//! own lobe (GGX, Walter et al. 2007). The site's surfaces keep the light of their charts; what the objects take of it and throw
//! back comes to it. So a picture differs from the empty site's by the objects alone.
//!
//! The matt part of an object gathers what bounces exactly as the site's surfaces do: from the same 64 directions, and roughly
//! ([`Around::rough`]). Only gloss shows the room as it is seen. If matt light saw that, too, a white object would be up to 1.4 times as
//! bright as the white floor under it.
//!
//! Not modelled: normal maps, transparency, light that goes on after the second object.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use super::hemisphere::{BOUNCES, about_cosine, axes, on_spiral};
use super::lamps::Lamp;
use super::random::Random;
use super::triangles::{Touch, Triangle, Triangles};
use crate::scene::{Alpha, Material, Scene, Texture, TextureUse, Vertex, Wrap};

/// Places on each lamp, directions of matt light onto the site and directions of gloss, a camera ray; a ray that was sent on takes one
/// each.
const LAMPS: usize = 8;
const MATT: usize = 8;
const GLOSS: usize = 4;
/// A ray that is so many surfaces away from the camera meets lamps alone.
const DEEPEST: u32 = 2;
/// Rays begin so far in front of a surface, metres.
const OFF_M: f64 = 2e-4;
/// What a dielectric reflects head-on (glTF).
const HEAD_ON: f64 = 0.04;
/// No surface is smoother: its α, the square of the roughness.
const SMOOTHEST: f64 = 2e-3;

/// A triangle's corners.
#[derive(Clone, Debug)]
struct Face {
    corners: [Vertex; 3],
    normals: [DVec3; 3],
    material: usize,
}

/// The site without its objects, as they see it.
pub trait Around {
    fn lamps(&self) -> &[Lamp];

    /// Whether anything of the site stands between `origin` and `origin + to`.
    fn blocked(&self, origin: DVec3, to: DVec3) -> bool;

    /// How far a ray goes, in lengths of `direction`.
    fn distance(&self, origin: DVec3, direction: DVec3) -> f64;

    /// The light along a ray from what is no lamp, without mirror images, where more light arrives at the surface that is met, at
    /// a place and facing a way, than its chart has.
    fn matt(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3;

    /// The light along a ray as the charts have it in what was thrown back once, and `more` as above.
    fn rough(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3;
}

#[derive(Clone, Debug)]
pub struct Evidence {
    triangles: Triangles,
    faces: Vec<Face>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
}

/// A point of an object.
struct Surface {
    at: DVec3,
    normal: DVec3,
    matt: DVec3,
    head_on: DVec3,
    alpha: f64,
    shines: DVec3,
}

/// What the objects do to a surface of the site.
pub struct Change {
    /// To the light that arrives, as the radiance of white.
    pub light: DVec3,
    /// The share of the lamps that they hide.
    pub hidden: f64,
}

impl Evidence {
    /// The objects of a scene where it puts them, the site's axes, metres.
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

    /// Where a ray meets an object first.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<Touch> {
        self.triangles.hit(origin, direction, f64::INFINITY)
    }

    /// Where an object faces at a point of it, and what share of light its matt part throws back.
    pub fn thrown_back(&self, touch: &Touch, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
        let surface = self.surface(touch, origin, direction);
        (surface.normal, surface.matt)
    }

    /// The light that an object sends back along a ray.
    pub fn light(&self, site: &dyn Around, touch: &Touch, origin: DVec3, direction: DVec3) -> DVec3 {
        let mut random = Random::new([touch.t.to_bits(), direction.x.to_bits(), direction.y.to_bits(), 0]);
        self.sent(site, touch, origin, direction, 0, &mut random)
    }

    /// What the objects do to a surface of the site at `p`, that faces `n`.
    pub fn change(&self, site: &dyn Around, p: DVec3, n: DVec3) -> Change {
        let mut random = Random::new([p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), 1]);
        self.changed(site, p + n * OFF_M, n, 0, &mut random)
    }

    fn changed(&self, site: &dyn Around, p: DVec3, n: DVec3, deep: u32, random: &mut Random) -> Change {
        let mut change = Change { light: DVec3::ZERO, hidden: 0.0 };
        let lamps = if deep == 0 { LAMPS } else { 1 };
        for lamp in site.lamps() {
            let each = 1.0 / lamps as f64;
            for k in 0..lamps {
                let to = lamp.place(k, lamps, random) - p;
                let share = lamp.share(to, n);
                if share > 0.0 && self.triangles.hit(p, to, 1.0).is_some() && !site.blocked(p, to) {
                    change.light -= lamp.radiance * (share * each);
                    change.hidden += each / site.lamps().len() as f64;
                }
            }
        }
        if deep + 1 < DEEPEST {
            let count = if deep == 0 { MATT } else { 1 };
            for k in 0..count {
                let direction = about_cosine(n, k, count, random);
                let far = site.distance(p, direction);
                if let Some(touch) = self.triangles.hit(p, direction, far) {
                    let now = self.sent(site, &touch, p, direction, deep + 1, random);
                    change.light += (now - site.rough(p, direction, &mut |_, _| DVec3::ZERO)) / count as f64;
                }
            }
        }
        change
    }

    /// The light along a ray from what is no lamp: by what is seen there, or rough.
    fn along(
        &self,
        site: &dyn Around,
        (origin, direction): (DVec3, DVec3),
        deep: u32,
        is_seen: bool,
        random: &mut Random,
    ) -> DVec3 {
        let far = site.distance(origin, direction);
        if let Some(touch) = self.triangles.hit(origin, direction, far) {
            return self.sent(site, &touch, origin, direction, deep, random);
        }
        let more = &mut |p, n| self.changed(site, p + n * OFF_M, n, deep, random).light;
        if is_seen { site.matt(origin, direction, more) } else { site.rough(origin, direction, more) }
    }

    fn sent(
        &self,
        site: &dyn Around,
        touch: &Touch,
        origin: DVec3,
        direction: DVec3,
        deep: u32,
        random: &mut Random,
    ) -> DVec3 {
        let surface = self.surface(touch, origin, direction);
        let (n, to_eye) = (surface.normal, -direction.normalize());
        let p = surface.at;
        let mut light = surface.shines;
        let count = if deep == 0 { LAMPS } else { 1 };
        for lamp in site.lamps() {
            for k in 0..count {
                let to = lamp.place(k, count, random) - p;
                // E/π, of which matt white sends back 1 and a lobe f its π-fold.
                let share = lamp.share(to, n);
                if share > 0.0 && !site.blocked(p, to) && self.triangles.hit(p, to, 1.0).is_none() {
                    let lobe = surface.lobe(to.normalize(), to_eye);
                    light += lamp.radiance * (surface.matt + PI * lobe) * (share / count as f64);
                }
            }
        }
        if deep >= DEEPEST {
            return light;
        }
        let count = if deep == 0 { BOUNCES } else { 1 };
        for k in 0..count {
            let direction = if deep == 0 { on_spiral(n, k, count) } else { about_cosine(n, k, count, random) };
            light += surface.matt * self.along(site, (p, direction), deep + 1, false, random) / count as f64;
        }
        let count = if deep == 0 { GLOSS } else { 1 };
        for _ in 0..count {
            if let Some((direction, weight)) = surface.mirrored(to_eye, random) {
                light += weight * self.along(site, (p, direction), deep + 1, true, random) / count as f64;
            }
        }
        light
    }

    fn surface(&self, touch: &Touch, origin: DVec3, direction: DVec3) -> Surface {
        let face = &self.faces[touch.face];
        let material = &self.materials[face.material];
        let shares = [1.0 - touch.beside.x - touch.beside.y, touch.beside.x, touch.beside.y];
        let mixed = |of: fn(&Vertex) -> [f32; 4]| {
            let sum = |channel: usize| {
                face.corners.iter().zip(shares).map(|(v, share)| f64::from(of(v)[channel]) * share).sum::<f64>()
            };
            [0, 1, 2, 3].map(sum)
        };
        let [u0, v0, u1, v1] = mixed(|v| [v.uv0[0], v.uv0[1], v.uv1[0], v.uv1[1]]);
        let seen = |used: &Option<TextureUse>| match used {
            Some(used) => {
                let [u, v] = if used.uv_set == 0 { [u0, v0] } else { [u1, v1] };
                texel(&self.textures[used.texture], used, DVec2::new(u, v))
            }
            None => [1.0; 4],
        };
        let [r, g, b, _] = mixed(|v| v.color);
        let [tr, tg, tb, _] = seen(&material.base_color_texture);
        let factor = DVec3::from([0, 1, 2].map(|c| f64::from(material.base_color[c])));
        let base = factor * DVec3::new(r * tr, g * tg, b * tb);
        let [_, rough, metal, _] = seen(&material.metallic_roughness_texture);
        let (roughness, metallic) = (f64::from(material.roughness) * rough, f64::from(material.metallic) * metal);
        let [er, eg, eb, _] = seen(&material.emissive_texture);
        let shines = Vec3::from(material.emissive).as_dvec3() * DVec3::new(er, eg, eb);

        let flat = self.triangles.normal(touch.face);
        let towards = |n: DVec3| if n.dot(direction) > 0.0 { -n } else { n };
        let flat = towards(flat);
        let smooth: DVec3 = face.normals.iter().zip(shares).map(|(n, share)| *n * share).sum();
        let smooth = smooth.normalize_or(flat);
        let smooth = if smooth.dot(flat) < 0.0 { -smooth } else { smooth };
        // A normal that looks away from the eye has no light to send it.
        let normal = if smooth.dot(direction) < 0.0 { smooth } else { flat };
        Surface {
            at: origin + direction * touch.t + flat * OFF_M,
            normal,
            matt: if material.unlit { DVec3::ZERO } else { base * ((1.0 - metallic) * (1.0 - HEAD_ON)) },
            head_on: if material.unlit { DVec3::ZERO } else { DVec3::splat(HEAD_ON).lerp(base, metallic) },
            alpha: (roughness * roughness).max(SMOOTHEST),
            shines: if material.unlit { base } else { shines },
        }
    }

    /// What they are made of that is not seen as it is.
    pub fn unseen(scene: &Scene) -> Option<&'static str> {
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

impl Surface {
    /// F·D·V (Walter et al. 2007 with the height-correlated masking of Heitz 2014, Schlick's F).
    fn lobe(&self, to_light: DVec3, to_eye: DVec3) -> DVec3 {
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
        let of = |a: f64, b: f64| a * (b * b * (1.0 - a2) + a2).sqrt();
        0.5 / (of(nl, nv) + of(nv, nl)).max(1e-9)
    }

    fn fresnel(&self, cosine: f64) -> DVec3 {
        self.head_on + (DVec3::ONE - self.head_on) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
    }

    /// A direction by the lobe's normals, and what light from there is multiplied by: f·(n·l) / p, p = D·(n·h) / 4(v·h).
    fn mirrored(&self, to_eye: DVec3, random: &mut Random) -> Option<(DVec3, DVec3)> {
        let (u, turn) = (random.uniform(), TAU * random.uniform());
        let a2 = self.alpha * self.alpha;
        let up = ((1.0 - u) / (1.0 + (a2 - 1.0) * u)).sqrt();
        let half = axes(self.normal) * DVec2::from_angle(turn).extend(0.0) * (1.0 - up * up).max(0.0).sqrt()
            + self.normal * up;
        let (vh, nv) = (to_eye.dot(half), self.normal.dot(to_eye).max(1e-4));
        let direction = 2.0 * vh * half - to_eye;
        let nl = self.normal.dot(direction);
        let weight = self.fresnel(vh) * (4.0 * self.masking(nl, nv) * vh * nl / up.max(1e-6));
        (vh > 0.0 && nl > 0.0).then_some((direction, weight))
    }
}

/// A texture's value at (u, v), linear between texels.
fn texel(texture: &Texture, used: &TextureUse, uv: DVec2) -> [f64; 4] {
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
