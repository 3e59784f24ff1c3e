//! Light that a depth sensor receives back from its projector, exact by ray casting.
//!
//! A point P has depth if both the sensor's camera and its projector see it. With a projector at
//! baseline b, an object at z₁ casts a shadow of f·b·(1/z₁ − 1/z₂) px onto a surface at z₂ behind
//! it: the difference of their disparities. Here a ray from the projector to P decides, whatever
//! the shapes.
//!
//! The return of a diffuse surface is albedo · cos / distance², with angle and distance relative to
//! the projector. The distance of the camera does not matter, since a pixel covers more of a
//! farther surface. The brightest colour channel stands for infrared, in which most dyes are
//! bright. Glossy surfaces return little in most directions. Not modelled: the projector's mirror
//! image, which saturates a camera.

use glam::DVec3;

use super::depth_errors::DepthErrors;
use super::render::Ray;
use super::site::Site;

/// Tolerance of the occlusion test near the point itself, as a share of the distance.
const SELF_OCCLUSION_TOLERANCE: f64 = 1e-6;

/// Sensor return along a pixel's ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorReturn {
    /// [`super::site::RayHit::surface`] + 1; 0 for no surface.
    pub surface: u64,
    /// 1/m²; `None` in the projector's shadow.
    pub light_per_m2: Option<f64>,
}

/// The return along a camera's ray, with projector and sensor offset by `errors`. `is_own`: the ray
/// is of the sensor's own camera.
pub fn sensor_return(site: &Site, ray: &Ray, errors: &DepthErrors, is_own: bool) -> SensorReturn {
    let Some(met) = site.first_hit(ray.origin, ray.direction, ray.time_s) else { return SensorReturn::default() };
    let surface = 1 + u64::from(met.surface);
    let at = ray.origin + ray.direction * met.t;
    let camera_m = if is_own { 0.0 } else { -errors.camera_offset_m };
    let place = |right_m: f64| ray.origin + ray.right * right_m;
    let is_hidden = |right_m: f64| right_m != 0.0 && is_between(site, place(right_m), at, ray.time_s);
    let projector_m = camera_m + errors.projector_m;
    if is_hidden(camera_m) || is_hidden(projector_m) {
        return SensorReturn { surface, light_per_m2: None };
    }
    let back = place(projector_m) - at;
    // A surface facing away from the projector is in its own shadow.
    let cosine = Some(met.normal.dot(back.normalize_or_zero())).filter(|cosine| *cosine > 0.0);
    SensorReturn { surface, light_per_m2: cosine.map(|cosine| met.albedo * cosine / back.length_squared()) }
}

fn is_between(site: &Site, from: DVec3, to: DVec3, time_s: f64) -> bool {
    site.first_hit(from, to - from, time_s).is_some_and(|met| met.t < 1.0 - SELF_OCCLUSION_TOLERANCE)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::evidence::Evidence;
    use super::super::lamps::DEMO_LAMP;
    use super::super::site::Detail;
    use super::*;
    use crate::scene::{Material, Mesh, Object, Part, Scene, Vertex};

    /// A diffuse 50 % grey square of 20 cm, facing up, half a metre above the floor's origin.
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

    /// Returns along a row of the picture, from 1 m above the card, by x / z.
    fn row(errors: &DepthErrors, is_own: bool) -> Vec<(f64, SensorReturn)> {
        let mut site = Site::new(Detail { texture_m: 0.05, light_m: 0.4 }, vec![DEMO_LAMP], (None, None), None, 2);
        site.evidence = Some(Evidence::new(&card()));
        let return_m = |n: i32| {
            let u = 1e-3 * (f64::from(n) + 0.5);
            let direction = DVec3::new(u, 0.0, -1.0);
            let ray = Ray { time_s: 0.0, origin: 1.5 * DVec3::Z, direction, right: DVec3::X };
            (u, sensor_return(&site, &ray, errors, is_own))
        };
        (-180..180).map(return_m).collect()
    }

    /// The interval without a return: from, to.
    fn dark(row: &[(f64, SensorReturn)]) -> Option<[f64; 2]> {
        let places: Vec<f64> =
            row.iter().filter(|(_, surface)| surface.light_per_m2.is_none()).map(|(u, _)| *u).collect();
        let whole = [*places.first()? - 5e-4, *places.last()? + 5e-4];
        assert!((1e3 * (whole[1] - whole[0]) - places.len() as f64).abs() < 0.01, "one piece");
        Some(whole)
    }

    #[test]
    fn projector_shadow_width_is_the_difference_of_disparities() {
        let near = |edges: Option<[f64; 2]>, expected: [f64; 2]| {
            let edges = edges.unwrap();
            assert!((edges[0] - expected[0]).abs() < 2e-4 && (edges[1] - expected[1]).abs() < 2e-4, "{edges:?}");
        };
        let exact = DepthErrors::default();
        assert_eq!(dark(&row(&exact, false)), None);
        // The card is 1 m away, the floor 1.5 m: b · (1/1 − 1/1.5), left of the card, from a
        // projector on the right.
        near(dark(&row(&DepthErrors { projector_m: 0.06, ..exact }, false)), [-0.12, -0.1]);
        near(dark(&row(&DepthErrors { projector_m: -0.06, ..exact }, false)), [0.1, 0.12]);
        // A camera on the left does not see the floor right of the card; the sensor's own camera
        // does.
        let moved = DepthErrors { camera_offset_m: 0.03, projector_m: 0.03, ..exact };
        near(dark(&row(&moved, false)), [0.1, 0.11]);
        near(dark(&row(&moved, true)), [-0.11, -0.1]);
    }

    #[test]
    fn return_falls_with_squared_distance_and_cosine() {
        let pixels = row(&DepthErrors { projector_m: 0.06, ..DepthErrors::default() }, true);
        // In the card's middle; the projector is 0.06 aside and 1 up. A twenty-fifth of the light
        // is gloss.
        let (u, middle) = pixels[180];
        let squared = 1.0 + (0.06 - u).powi(2);
        let expected = 0.5 * 0.96 / squared.powf(1.5);
        assert!((middle.light_per_m2.unwrap() / expected - 1.0).abs() < 1e-6, "{middle:?}");
        let (card, floor) = (middle.surface, pixels[0].1.surface);
        assert!(card != floor && card != 0 && floor != 0);
        assert!(pixels.iter().all(|(u, pixels)| pixels.surface == if u.abs() < 0.1 { card } else { floor }));
    }
}
