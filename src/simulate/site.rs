//! The site: its objects, its lighting, and the light along a ray.
//!
//! All surfaces are diffuse except for a soft mirror image of the lamp. So the outgoing light is
//! computed once, on a chart per face, and rays look it up. Light: the lamp in the ceiling with its
//! soft shadows, and one bounce gathered over the hemisphere.

use glam::{DVec2, DVec3};

use super::Ground;
use super::chart::SiteChart;
use super::evidence::{Evidence, SiteLight};
use super::finish::{Finish, gloss, reflectance};
use super::hemisphere::{GATHER_DIRECTIONS, spiral_direction};
use super::lamps::SiteLamp;
use super::person::Person;
use super::random::Random;
use super::shapes::{SiteHit, SiteShape};

/// Uniform ambient light in the indirect light, in addition to the lamp's.
const AMBIENT: DVec3 = DVec3::new(0.10, 0.115, 0.14);

/// Key of the random placement, in addition to the seed.
const PLACEMENT_KEY: u64 = 0x6d6f_7665;

/// A shape, its finish, and the light that leaves each of its faces.
#[derive(Clone, Debug)]
struct SiteObject {
    shape: SiteShape,
    bounds: (DVec3, f64),
    /// `None` for a self-luminous object that lights nothing else.
    finish: Option<Finish>,
    /// One per face.
    mean_albedo: Vec<DVec3>,
    light: Vec<SiteChart>,
}

/// Resolution of the light computation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Cell size of the texture charts, metres.
    pub texture_m: f64,
    /// Cell size of the light charts, metres.
    pub light_m: f64,
}

impl Detail {
    /// About the size of a pixel at a distance of one metre.
    pub fn for_focal_px(focal_px: f64) -> Self {
        let texture_m = (1.04 / focal_px).clamp(0.001, 0.05);
        Self { texture_m, light_m: 6.25 * texture_m }
    }
}

/// The whole site with its light.
#[derive(Clone, Debug)]
pub struct Site {
    objects: Vec<SiteObject>,
    pub lamps: Vec<SiteLamp>,
    /// A person walking in it.
    pub person: Option<Person>,
    /// Additional real objects.
    pub evidence: Option<Evidence>,
    /// True if all surfaces emit the same light, so that only depth distinguishes them.
    pub is_blank: bool,
}

/// First intersection of a ray.
#[derive(Clone, Copy, Debug)]
pub struct RayHit {
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// Unit length, towards the ray's origin.
    pub normal: DVec3,
    /// Diffuse albedo of the brightest channel.
    pub albedo: f64,
    /// Identifier: one per face of a site object, one for all evidence, one for a person.
    pub surface: u32,
}

/// Maximum number of faces of a shape.
const MAX_FACES: usize = 6;
const EVIDENCE_SURFACE: u32 = u32::MAX;
const PERSON_SURFACE: u32 = u32::MAX - 1;

fn max_channel([r, g, b, _]: [f32; 4]) -> f32 {
    r.max(g).max(b)
}

/// Emitted light of a blank site.
const BLANK_LIGHT: [f32; 3] = [0.2; 3];

/// An empty room whose floor fills the view of every motion, m.
const EMPTY_ROOM: SiteShape = SiteShape::Room { min: DVec3::new(-3.2, -3.2, 0.0), max: DVec3::new(3.2, 3.2, 2.5) };

/// Objects in the room: world axes, z up, metres. The floor within 0.5 m of the origin is free,
/// except for the stool's legs from 0.38 m on.
fn inventory(placement_seed: Option<u64>) -> Vec<(SiteShape, Finish)> {
    let v = DVec3::new;
    // Random displacement: x, y and yaw.
    let mut random = Random::new([placement_seed.unwrap_or(0), PLACEMENT_KEY, 0, 0]);
    let mut by = |m: f64, rad: f64| {
        let mut either = |max: f64| if placement_seed.is_some() { max * (2.0 * random.uniform() - 1.0) } else { 0.0 };
        (v(either(m), either(m), 0.0), either(rad))
    };
    let ((boxes, box_yaw), (carpet, carpet_yaw), (tub, _)) = (by(0.15, 0.6), by(0.1, 0.3), by(0.1, 0.0));
    let ((ball, _), (paper, _), (stool, _)) = (by(0.12, 0.0), by(0.12, 0.0), by(0.1, 0.0));
    let block = |centre, size: DVec3, yaw_rad| SiteShape::Block { centre, half: 0.5 * size, yaw_rad };
    let mut all = vec![
        (SiteShape::Room { min: v(-1.15, -2.5, 0.0), max: v(2.35, 1.0, 2.5) }, Finish::Room),
        (block(v(0.6, 0.992, 0.045), v(3.5, 0.016, 0.09), 0.0), Finish::Paint),
        (block(v(-1.142, -0.75, 0.045), v(0.016, 3.5, 0.09), 0.0), Finish::Paint),
        (block(v(-0.78, 0.62, 0.15) + boxes, v(0.42, 0.32, 0.3), 0.35 + box_yaw), Finish::Cardboard),
        (block(v(-0.74, 0.63, 0.4) + boxes, v(0.27, 0.22, 0.2), -0.2 + box_yaw), Finish::Cardboard),
        (block(v(-0.86, -0.42, 0.004) + carpet, v(0.52, 1.1, 0.008), 0.05 + carpet_yaw), Finish::Carpet),
        (
            SiteShape::Tub { base: v(0.2, 0.76, 0.0) + tub, bottom_radius: 0.1, top_radius: 0.135, height: 0.26 },
            Finish::Plastic,
        ),
        (SiteShape::Ball { centre: v(0.58, 0.62, 0.12) + ball, radius: 0.12 }, Finish::Rubber),
        (
            SiteShape::Panel { corner: v(-0.3, 0.5, 0.001) + paper, u: v(0.204, 0.051, 0.0), v: v(-0.072, 0.288, 0.0) },
            Finish::Paper,
        ),
        (block(v(-0.28, 0.996, 0.3), v(0.08, 0.008, 0.08), 0.0), Finish::Socket),
    ];
    // The stool: a seat on four legs with four rungs, one leg near (0.36, -0.16).
    let (x, y, leg) = (0.48 + stool.x, -0.28 + stool.y, 0.115);
    all.push((block(v(x, y, 0.395), v(0.28, 0.28, 0.03), 0.0), Finish::Walnut));
    for (dx, dy) in [(-leg, -leg), (-leg, leg), (leg, -leg), (leg, leg)] {
        all.push((block(v(x + dx, y + dy, 0.19), v(0.034, 0.034, 0.38), 0.0), Finish::Walnut));
    }
    for side in [-leg, leg] {
        all.push((block(v(x, y + side, 0.14), v(0.196, 0.018, 0.024), 0.0), Finish::Walnut));
        all.push((block(v(x + side, y, 0.2), v(0.018, 0.196, 0.024), 0.0), Finish::Walnut));
    }
    all
}

/// A desk that fills the view, with objects behind the origin.
fn desk() -> Vec<(SiteShape, Finish)> {
    let v = DVec3::new;
    let block = |centre, size: DVec3, yaw_rad| SiteShape::Block { centre, half: 0.5 * size, yaw_rad };
    vec![
        (EMPTY_ROOM, Finish::Desk),
        (block(v(0.05, 0.42, 0.05), v(0.06, 0.03, 0.1), 0.08), Finish::Screen),
        (block(v(0.05, 0.42, 0.006), v(0.26, 0.18, 0.012), 0.08), Finish::Screen),
        (block(v(0.05, 0.4, 0.25), v(0.54, 0.035, 0.33), 0.08), Finish::Screen),
        (block(v(0.46, 0.2, 0.012), v(0.4, 0.14, 0.024), -0.5), Finish::Keyboard),
        (
            SiteShape::Tub { base: v(-0.33, 0.22, 0.0), bottom_radius: 0.032, top_radius: 0.04, height: 0.095 },
            Finish::Plastic,
        ),
    ]
}

impl Site {
    /// Sets up the site and computes its light. `placement_seed`: seed of other object positions.
    /// `ground`: replaces the planks and the objects on them. `board`: a self-luminous flat panel,
    /// with the light on its chart. It neither lights nor shadows anything.
    pub fn new(
        detail: Detail,
        lamps: Vec<SiteLamp>,
        (placement_seed, ground): (Option<u64>, Option<Ground>),
        board: Option<(SiteShape, SiteChart)>,
        threads: usize,
    ) -> Self {
        let contents = match ground {
            None => inventory(placement_seed),
            Some(Ground::Concrete) => vec![(EMPTY_ROOM, Finish::Concrete)],
            Some(Ground::Desk) => desk(),
        };
        let objects = contents.into_iter().map(|(shape, finish)| SiteObject::new(shape, Some(finish), Vec::new()));
        let mut site = Self { objects: objects.collect(), lamps, person: None, evidence: None, is_blank: false };
        let light: Vec<_> = site.objects.iter().map(|object| site.bake(object, detail, threads)).collect();
        for (object, light) in site.objects.iter_mut().zip(light) {
            object.light = light;
        }
        // Added last, so that it takes no light from the site.
        site.objects.extend(board.map(|(shape, chart)| SiteObject::new(shape, None, vec![chart])));
        site
    }

    /// Light that leaves an object's faces.
    fn bake(&self, object: &SiteObject, detail: Detail, threads: usize) -> Vec<SiteChart> {
        let Some(finish) = object.finish else { return Vec::new() };
        let cells = |length: f64, cell: f64| ((length / cell).ceil() as usize).clamp(4, 8192);
        let chart = |face| {
            let size = object.shape.face_size_m(face);
            // Walls and ceiling outside every camera path can be coarse.
            let is_unseen = match finish {
                Finish::Room => matches!(face, 1 | 2 | 5),
                Finish::Concrete | Finish::Desk => face != 4,
                _ => false,
            };
            let coarse = if is_unseen { 8.0 } else { 1.0 };
            let incident = SiteChart::from_fn(
                cells(size.x, detail.light_m * coarse),
                cells(size.y, detail.light_m * coarse),
                threads,
                |uv| self.incident(object, face, uv),
            );
            let texture_m = detail.texture_m * coarse;
            SiteChart::from_fn(cells(size.x, texture_m), cells(size.y, texture_m), threads, |uv| {
                let (s, e) = (reflectance(finish, face, uv, size), incident.at(uv));
                let a = s.albedo.as_vec3().max(glam::Vec3::ZERO);
                [a.x * e[0], a.y * e[1], a.z * e[2], s.gloss as f32 * e[3]]
            })
        };
        (0..object.shape.faces()).map(chart).collect()
    }

    /// Incident light at a surface, as the radiance of a white diffuse surface, and the visible
    /// share of the lamp.
    fn incident(&self, object: &SiteObject, face: usize, uv: DVec2) -> [f32; 4] {
        let (p, n) = object.shape.point(face, uv);
        let p = p + n * 2e-4;
        let (direct, lamp_share) = self.direct(p, n);
        let mut bounced = DVec3::ZERO;
        for i in 0..GATHER_DIRECTIONS {
            let direction = spiral_direction(n, i, GATHER_DIRECTIONS);
            bounced += self.coarse_light(p, direction, &mut |_, _| DVec3::ZERO) / GATHER_DIRECTIONS as f64;
        }
        let light = direct + bounced;
        [light.x as f32, light.y as f32, light.z as f32, lamp_share as f32]
    }

    /// Direct light on a surface, and the visible share of the lamps.
    fn direct(&self, p: DVec3, n: DVec3) -> (DVec3, f64) {
        let (mut light, mut lamp_share) = (DVec3::ZERO, 0.0);
        for lamp in &self.lamps {
            let points = lamp.points();
            let (mut direct, mut of_it) = (0.0, 0.0);
            for on_lamp in &points {
                let to = *on_lamp - p;
                let share = lamp.white_radiance(to, n) / points.len() as f64;
                if share > 0.0 && !self.blocked(p, to) {
                    direct += share;
                    of_it += 1.0 / points.len() as f64;
                }
            }
            light += lamp.radiance * direct;
            lamp_share += of_it / self.lamps.len() as f64;
        }
        (light, lamp_share)
    }

    /// Radiance of a white diffuse surface facing up in the room, under the light that the room's
    /// surfaces receive.
    pub fn white_facing_up(&self, p: DVec3) -> DVec3 {
        const RAYS: usize = 16_384;
        let ray =
            |i: usize| self.coarse_light(p, spiral_direction(DVec3::Z, i, RAYS), &mut |_, _| DVec3::ZERO) / RAYS as f64;
        self.direct(p, DVec3::Z).0 + (0..RAYS).map(ray).sum::<DVec3>()
    }

    fn nearest(&self, origin: DVec3, direction: DVec3) -> Option<(&SiteObject, SiteHit)> {
        let squared = direction.length_squared();
        let mut best: Option<(&SiteObject, SiteHit)> = None;
        for object in &self.objects {
            let to = object.bounds.0 - origin;
            let along = to.dot(direction);
            let radius2 = object.bounds.1 * object.bounds.1;
            let aside2 = to.length_squared() - along * along / squared;
            if aside2 > radius2 || (along < 0.0 && to.length_squared() > radius2) {
                continue;
            }
            if let Some(hit) = object.shape.hit(origin, direction)
                && best.as_ref().is_none_or(|(_, b)| hit.t < b.t)
            {
                best = Some((object, hit));
            }
        }
        best
    }

    /// Linear light (1 is camera white) along a ray at a time, and its distance (in lengths of
    /// `direction`); `None` outside the room.
    pub fn light(&self, origin: DVec3, direction: DVec3, time_s: f64) -> Option<([f32; 3], f64)> {
        let (object, hit) = self.nearest(origin, direction)?;
        let evidence = self.evidence.as_ref();
        let lying = evidence.and_then(|evidence| Some((evidence, evidence.hit(origin, direction)?)));
        let nearest = lying.as_ref().map_or(hit.t, |(_, touch)| touch.t.min(hit.t));
        let in_front = self.person.as_ref().and_then(|person| person.light(origin, direction, time_s));
        if let Some(of_person) = in_front.filter(|(_, t)| *t < nearest) {
            return Some(of_person);
        }
        if self.is_blank {
            return Some((BLANK_LIGHT, nearest));
        }
        if let Some((evidence, touch)) = lying.filter(|(_, touch)| touch.t < hit.t) {
            return Some((evidence.light(self, &touch, origin, direction).as_vec3().to_array(), touch.t));
        }
        let [r, g, b, mut visible] = object.light.get(hit.face)?.at(hit.uv);
        let mut light = [r, g, b];
        let p = origin + direction * hit.t;
        if let (Some(_), Some(evidence)) = (object.finish, evidence) {
            let change = evidence.change(self, p, hit.normal);
            if change.light != DVec3::ZERO {
                let by = (object.albedo(&hit) * change.light).as_vec3().to_array();
                // A chart's cell may already lie in a penumbra.
                light.iter_mut().zip(by).for_each(|(light, by)| *light = (*light + by).max(0.0));
            }
            visible = (visible - change.occluded as f32).max(0.0);
        }
        if let (Some(finish), true) = (object.finish, visible > 0.0) {
            for lamp in &self.lamps {
                let shine = lamp_reflection(lamp, finish, p, direction.normalize(), hit.normal) * f64::from(visible);
                for (value, lamp) in light.iter_mut().zip(lamp.radiance.to_array()) {
                    *value += (shine * lamp) as f32;
                }
            }
        }
        Some((light, hit.t))
    }

    /// First intersection of a ray at a time; `None` outside the room.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3, time_s: f64) -> Option<RayHit> {
        let (object, hit) = self.nearest(origin, direction)?;
        let number = self.objects.iter().position(|other| std::ptr::eq(other, object)).unwrap_or_default();
        let albedo = match object.finish {
            Some(_) => object.albedo(&hit).max_element(),
            // The emitted light of a self-luminous object is also its albedo.
            None => object.light.get(hit.face).map_or(0.0, |chart| f64::from(max_channel(chart.at(hit.uv)))),
        };
        let mut nearest_hit =
            RayHit { t: hit.t, normal: hit.normal, albedo, surface: (number * MAX_FACES + hit.face) as u32 };
        if let Some(evidence) = &self.evidence
            && let Some(touch) = evidence.hit(origin, direction).filter(|touch| touch.t < nearest_hit.t)
        {
            let (normal, matt) = evidence.normal_and_albedo(&touch, origin, direction);
            nearest_hit = RayHit { t: touch.t, normal, albedo: matt.max_element(), surface: EVIDENCE_SURFACE };
        }
        match self.person.as_ref().and_then(|person| person.light_and_hit(origin, direction, time_s)) {
            Some(([r, g, b], hit)) if hit.t < nearest_hit.t => Some(RayHit {
                t: hit.t,
                normal: hit.normal,
                albedo: max_channel([r, g, b, 0.0]).into(),
                surface: PERSON_SURFACE,
            }),
            _ => Some(nearest_hit),
        }
    }

    /// Light on an object in the room along a ray: without the mirror image, the lamp itself if the
    /// ray hits it, and black for the board, which lights nothing.
    pub fn surroundings(&self, origin: DVec3, direction: DVec3) -> DVec3 {
        let ahead = self.lamps.iter().filter_map(|lamp| Some((lamp.hit(origin, direction)?, lamp.radiance)));
        let far = self.nearest(origin, direction).map_or(f64::INFINITY, |(_, hit)| hit.t);
        match ahead.filter(|(t, _)| far >= *t).min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, radiance)) => radiance,
            None => self.detailed_light(origin, direction, &mut |_, _| DVec3::ZERO),
        }
    }
}

impl SiteLight for Site {
    fn lamps(&self) -> &[SiteLamp] {
        &self.lamps
    }

    fn blocked(&self, origin: DVec3, to: DVec3) -> bool {
        self.nearest(origin, to).is_some_and(|(_, hit)| hit.t < 1.0)
    }

    fn distance(&self, origin: DVec3, direction: DVec3) -> f64 {
        self.nearest(origin, direction).map_or(f64::INFINITY, |(_, hit)| hit.t)
    }

    fn detailed_light(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3 {
        let Some((object, hit)) = self.nearest(origin, direction) else { return DVec3::ZERO };
        if object.finish.is_none() {
            return DVec3::ZERO;
        }
        let cell = object.light.get(hit.face).map_or([0.0; 4], |chart| chart.at(hit.uv));
        let more = more(origin + direction * hit.t, hit.normal);
        let albedo = if more == DVec3::ZERO { DVec3::ZERO } else { object.albedo(&hit) };
        DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + albedo * more
    }

    fn coarse_light(&self, origin: DVec3, direction: DVec3, more: &mut dyn FnMut(DVec3, DVec3) -> DVec3) -> DVec3 {
        let Some((object, hit)) = self.nearest(origin, direction) else { return DVec3::ZERO };
        let p = origin + direction * hit.t;
        object.coarse_light(&hit, &self.lamps, p, more(p, hit.normal))
    }
}

/// Blurred mirror image of the lamp in a surface, as a share of its radiance. For appearance only,
/// not a measured reflection: Schlick's Fresnel term times a Gaussian around the lamp's rectangle.
fn lamp_reflection(lamp: &SiteLamp, finish: Finish, p: DVec3, direction: DVec3, n: DVec3) -> f64 {
    let (f0, width) = gloss(finish);
    if f0 == 0.0 {
        return 0.0;
    }
    let mirrored = direction - 2.0 * direction.dot(n) * n;
    let fresnel = f0 + (1.0 - f0) * (1.0 - direction.dot(n).abs()).powi(5);
    fresnel * lamp.reflection(p, mirrored, width)
}

impl SiteObject {
    fn new(shape: SiteShape, finish: Option<Finish>, light: Vec<SiteChart>) -> Self {
        const SIDE: usize = 8;
        let mean = |face| {
            let place = |i: usize| DVec2::new((i % SIDE) as f64 + 0.5, (i / SIDE) as f64 + 0.5) / SIDE as f64;
            let size = shape.face_size_m(face);
            let albedo = |i| finish.map_or(DVec3::ZERO, |f| reflectance(f, face, place(i), size).albedo);
            (0..SIDE * SIDE).map(albedo).sum::<DVec3>() / (SIDE * SIDE) as f64
        };
        Self { mean_albedo: (0..shape.faces()).map(mean).collect(), bounds: shape.bounds(), shape, finish, light }
    }

    /// Diffuse albedo at an intersection.
    fn albedo(&self, hit: &SiteHit) -> DVec3 {
        self.finish.map_or(DVec3::ZERO, |finish| {
            reflectance(finish, hit.face, hit.uv, self.shape.face_size_m(hit.face)).albedo
        })
    }

    /// Coarse outgoing light of a point for indirect light: the face's mean albedo under the
    /// unshadowed lamps and `more`.
    fn coarse_light(&self, hit: &SiteHit, lamps: &[SiteLamp], p: DVec3, more: DVec3) -> DVec3 {
        let albedo = self.mean_albedo.get(hit.face).copied().unwrap_or_default();
        let lamp_light = |lamp: &SiteLamp| lamp.radiance * (0.8 * lamp.white_radiance(lamp.centre_m - p, hit.normal));
        albedo * (lamps.iter().map(lamp_light).sum::<DVec3>() + AMBIENT + more)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::lamps::random_lamps;
    use super::*;
    use crate::scene::{Material, Mesh, Object, Part, Scene, Vertex};

    /// A diffuse square of 4 cm around the origin, facing up, 2 mm above the floor.
    fn card(grey: f32) -> Scene {
        let corner = |x: f32, y: f32| Vertex {
            position: [0.02 * x, 0.02 * y, 0.002],
            normal: [0.0, 0.0, 1.0],
            tangent: [0.0; 4],
            uv0: [0.0; 2],
            uv1: [0.0; 2],
            color: [1.0; 4],
        };
        let vertices = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| corner(x, y)).to_vec();
        let matt =
            Material { base_color: [grey, grey, grey, 1.0], metallic: 0.0, roughness: 1.0, ..Material::default() };
        let part = Part { mesh: 0, world_from_mesh: glam::DAffine3::IDENTITY };
        Scene {
            meshes: vec![Arc::new(Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3], material: 0 })],
            materials: vec![matt],
            objects: vec![Object { parts: vec![part], ..Object::default() }],
            ..Scene::default()
        }
    }

    #[test]
    fn object_on_the_floor_receives_the_light_of_the_floor() {
        // Lamps beside walls and below the ceiling, which are bright there.
        for (lamps, seed) in [(2, 2), (2, 14)] {
            let site = Site::new(
                Detail { texture_m: 0.02, light_m: 0.1 },
                random_lamps(lamps, seed),
                (Some(seed), None),
                None,
                2,
            );
            let (down, above) = (-DVec3::Z, DVec3::Z);
            let (floor, hit) = site.nearest(above, down).unwrap();
            let [r, g, b, _] = site.incident(floor, hit.face, hit.uv);
            let evidence = Evidence::new(&card(0.5));
            let touch = evidence.hit(above, down).unwrap();
            let shown = evidence.light(&site, &touch, above, down);
            // Diffuse 50 % grey, and a few percent of gloss.
            let share = shown / DVec3::new(r.into(), g.into(), b.into());
            assert!(share.min_element() > 0.48 && share.max_element() < 0.53, "site {seed}: {share}");
        }
    }
}
