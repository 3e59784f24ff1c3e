//! A person in patterned clothes who walks to and fro near the evidence: motion that is not the
//! camera's. Like the board, the person is self-luminous and neither lights nor shadows anything.

use glam::{DVec2, DVec3};

use super::chart::SiteChart;
use super::finish::fractal;
use super::path::START_S;
use super::shapes::{SiteHit, SiteShape};

/// Width, depth and height, m.
const SIZE_M: DVec3 = DVec3::new(0.45, 0.25, 1.75);
/// Start of the path along x, on the floor between the camera and the objects at the walls.
const PATH_START_M: DVec3 = DVec3::new(-0.5, -0.2, 0.0);
const PATH_LENGTH_M: f64 = 0.6;
/// Size of the largest patches of the clothes, m.
const PATCH_M: f64 = 0.08;

/// A textured block as tall as a person, which moves along a path.
#[derive(Clone, Debug)]
pub struct Person {
    speed_m_per_s: f64,
    /// The shape at the start of the path.
    shape: SiteShape,
    /// Emitted light, one per face.
    clothes: Vec<SiteChart>,
}

impl Person {
    /// `texture_m`: cell size of the clothes' charts.
    pub fn new(speed_m_per_s: f64, texture_m: f64) -> Self {
        let centre = PATH_START_M + DVec3::new(0.0, 0.0, 0.5 * SIZE_M.z);
        let shape = SiteShape::Block { centre, half: 0.5 * SIZE_M, yaw_rad: 0.0 };
        let chart = |face: usize| {
            let size = shape.face_size_m(face);
            let [width, height] = [size.x, size.y].map(|side| (side / texture_m).ceil().clamp(4.0, 2048.0) as usize);
            let cell = |i: usize| {
                let uv = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)
                    / DVec2::new(width as f64, height as f64);
                let cloth = |seed: u64| fractal(uv * size / PATCH_M, 4, 100 * (1 + face as u64) + 10 * seed) as f32;
                let (light, hue) = (0.02 + 0.5 * cloth(0).powi(2), cloth(1) - 0.5);
                [light * (1.0 + hue), light, light * (1.0 - hue), 0.0]
            };
            SiteChart::new(width, height, (0..width * height).map(cell).collect())
        };
        let clothes = (0..shape.faces()).filter_map(chart).collect();
        Self { speed_m_per_s, shape, clothes }
    }

    /// Distance from the start of the path at a time, m.
    fn distance_m(&self, time_s: f64) -> f64 {
        let travelled_m = (self.speed_m_per_s * (time_s - START_S)).rem_euclid(2.0 * PATH_LENGTH_M);
        travelled_m.min(2.0 * PATH_LENGTH_M - travelled_m)
    }

    /// Linear light from the person along a ray, and its distance in lengths of `direction`.
    pub fn light(&self, origin: DVec3, direction: DVec3, time_s: f64) -> Option<([f32; 3], f64)> {
        self.light_and_hit(origin, direction, time_s).map(|(light, hit)| (light, hit.t))
    }

    /// The emitted light, which is also the albedo, and the intersection.
    pub fn light_and_hit(&self, origin: DVec3, direction: DVec3, time_s: f64) -> Option<([f32; 3], SiteHit)> {
        let hit = self.shape.hit(origin - DVec3::new(self.distance_m(time_s), 0.0, 0.0), direction)?;
        let [r, g, b, _] = self.clothes.get(hit.face)?.at(hit.uv);
        Some(([r, g, b], hit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn person_walks_to_and_fro() {
        let person = Person::new(2.0, 0.05);
        // A metre away, facing +y; the front is at −0.325. From −0.5 the person reaches 0.1 after
        // 0.3 s.
        let hit = |x: f64, after_s: f64| {
            person.light(DVec3::new(x, -1.325, 1.0), DVec3::Y, START_S + after_s).map(|(_, t)| t)
        };
        assert!((hit(-0.5, 0.0).unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(hit(-0.27, 0.0), None);
        assert!(hit(0.1, 0.3).is_some() && hit(-0.5, 0.3).is_none());
        assert!(hit(-0.5, 0.6).is_some() && hit(-0.3, 0.5).is_some());
    }
}
