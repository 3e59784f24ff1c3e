//! What a depth sensor with a projector gets back of its light, by rays: exact.
//!
//! A point at P has depth if both the sensor's camera and its projector see it. From a projector b beside the camera, a thing z₁ away
//! throws a shade of f·b·(1/z₁ − 1/z₂) px onto what is z₂ behind it: the difference of their disparities. Here a ray from the
//! projector to P says so, whatever the things' shapes.
//!
//! Of the light, what comes back from a matt surface is as (share that it throws back) · cos / distance², angle and distance from the
//! projector; how far away the camera is does not matter, since a pixel sees the more of a surface the farther it is. The
//! brightest colour stands for infrared, in which most dyes are bright. What is shiny throws little back to all sides. Not
//! modelled: the projector's mirror image, which blinds a camera.

use glam::DVec3;

use super::depth_errors::DepthErrors;
use super::render::Ray;
use super::site::Site;

/// Nearer to a point's own surface nothing hides it: a share of the way.
const ITSELF: f64 = 1e-6;

/// What is at the end of a pixel's ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Returned {
    /// [`super::site::Met::surface`], from 1 on; 0 for nothing.
    pub surface: u64,
    /// 1/m²; `None` in a shade.
    pub light_per_m2: Option<f64>,
}

/// Along the ray of a camera beside which `errors` puts projector and sensor. `is_own`: the sensor's own camera.
pub fn returned(site: &Site, ray: &Ray, errors: &DepthErrors, is_own: bool) -> Returned {
    let Some(met) = site.met(ray.origin, ray.direction, ray.time_s) else { return Returned::default() };
    let surface = 1 + u64::from(met.surface);
    let at = ray.origin + ray.direction * met.t;
    let camera_m = if is_own { 0.0 } else { -errors.moved_m };
    let place = |right_m: f64| ray.origin + ray.right * right_m;
    let is_hidden = |right_m: f64| right_m != 0.0 && is_between(site, place(right_m), at, ray.time_s);
    let projector_m = camera_m + errors.projector_m;
    if is_hidden(camera_m) || is_hidden(projector_m) {
        return Returned { surface, light_per_m2: None };
    }
    let back = place(projector_m) - at;
    // A surface turned away from the projector shades itself.
    let cosine = Some(met.normal.dot(back.normalize_or_zero())).filter(|cosine| *cosine > 0.0);
    Returned { surface, light_per_m2: cosine.map(|cosine| met.thrown_back * cosine / back.length_squared()) }
}

fn is_between(site: &Site, from: DVec3, to: DVec3, time_s: f64) -> bool {
    site.met(from, to - from, time_s).is_some_and(|met| met.t < 1.0 - ITSELF)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::evidence::Evidence;
    use super::super::lamps::USUAL;
    use super::super::site::Detail;
    use super::*;
    use crate::scene::{Material, Mesh, Object, Part, Scene, Vertex};

    /// A matt half-grey square of 20 cm, half a metre over the floor and the origin, that looks up.
    fn card() -> Scene {
        let corner = |(x, y): (f32, f32)| Vertex {
            position: [0.1 * x, 0.1 * y, 0.5],
            normal: [0.0, 0.0, 1.0],
            tangent: [0.0; 4],
            uv0: [0.0; 2],
            uv1: [0.0; 2],
            color: [1.0; 4],
        };
        let vertices = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner).to_vec();
        let material =
            Material { base_color: [0.5, 0.5, 0.5, 1.0], metallic: 0.0, roughness: 1.0, ..Material::default() };
        let part = Part { mesh: 0, world_from_mesh: glam::DAffine3::IDENTITY };
        Scene {
            meshes: vec![Arc::new(Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3], material: 0 })],
            materials: vec![material],
            objects: vec![Object { parts: vec![part], ..Object::default() }],
            ..Scene::default()
        }
    }

    /// From 1 m above the card, along a row of the picture: at x / z, what comes back.
    fn row(errors: &DepthErrors, is_own: bool) -> Vec<(f64, Returned)> {
        let mut site = Site::new(Detail { texture_m: 0.05, light_m: 0.4 }, vec![USUAL], (None, None), None, 2);
        site.evidence = Some(Evidence::new(&card()));
        let along = |n: i32| {
            let u = 1e-3 * (f64::from(n) + 0.5);
            let direction = DVec3::new(u, 0.0, -1.0);
            let ray = Ray { time_s: 0.0, origin: 1.5 * DVec3::Z, direction, right: DVec3::X };
            (u, returned(&site, &ray, errors, is_own))
        };
        (-180..180).map(along).collect()
    }

    /// Where nothing comes back: from, to.
    fn dark(row: &[(f64, Returned)]) -> Option<[f64; 2]> {
        let places: Vec<f64> = row.iter().filter(|(_, seen)| seen.light_per_m2.is_none()).map(|(u, _)| *u).collect();
        let whole = [*places.first()? - 5e-4, *places.last()? + 5e-4];
        assert!((1e3 * (whole[1] - whole[0]) - places.len() as f64).abs() < 0.01, "one piece");
        Some(whole)
    }

    #[test]
    fn a_shade_is_as_wide_as_disparities_differ() {
        let near = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            let found = found.unwrap();
            assert!((found[0] - expected[0]).abs() < 2e-4 && (found[1] - expected[1]).abs() < 2e-4, "{found:?}");
        };
        let exact = DepthErrors::default();
        assert_eq!(dark(&row(&exact, false)), None);
        // The card is 1 m away, the floor 1.5 m: b · (1/1 − 1/1.5), left of the card, from a projector on the right.
        near(dark(&row(&DepthErrors { projector_m: 0.06, ..exact }, false)), [-0.12, -0.1]);
        near(dark(&row(&DepthErrors { projector_m: -0.06, ..exact }, false)), [0.1, 0.12]);
        // A camera on the left does not see what is right of it; one that is the sensor's own does.
        let moved = DepthErrors { moved_m: 0.03, projector_m: 0.03, ..exact };
        near(dark(&row(&moved, false)), [0.1, 0.11]);
        near(dark(&row(&moved, true)), [-0.11, -0.1]);
    }

    #[test]
    fn light_falls_with_the_distance_squared_and_the_angle() {
        let seen = row(&DepthErrors { projector_m: 0.06, ..DepthErrors::default() }, true);
        // In the card's middle; the projector is 0.06 aside and 1 up. A twenty-fifth of the light is gloss.
        let (u, middle) = seen[180];
        let squared = 1.0 + (0.06 - u).powi(2);
        let expected = 0.5 * 0.96 / squared.powf(1.5);
        assert!((middle.light_per_m2.unwrap() / expected - 1.0).abs() < 1e-6, "{middle:?}");
        let (card, floor) = (middle.surface, seen[0].1.surface);
        assert!(card != floor && card != 0 && floor != 0);
        assert!(seen.iter().all(|(u, seen)| seen.surface == if u.abs() < 0.1 { card } else { floor }));
    }
}
