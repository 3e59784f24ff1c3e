//! Radiance of a white Lambertian surface at a place in the room, by the scene's lighting:
//!
//!   W = Σ L·cos θ·Δω/π + Σ V·I·cos θ/d²
//!
//! over the panorama's directions, and over lamps with the visible fraction V of their disc:
//! measured real objects hide the rest. A surface of albedo ρ has the radiance ρ·W.
//!
//! Not modelled: occlusion of the panorama's light by real objects nearby, and their indirect
//! light, beyond the panorama itself.

use glam::Vec3;

use super::light_visibility::{LIGHT_SAMPLES, disc_around};
use super::receiver_plane::ReceiverPlane;
use super::room::{MIN_HEIGHT_M, Room};
use super::sky::{EnvironmentImage, on_surface, rays};
use crate::plane::Plane;
use crate::scene::{Lighting, PointLight};

/// Linear radiance of a white Lambertian surface.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteRadiance {
    /// Radiance by distant light: the environment and suns.
    pub far: Vec3,
    /// Radiance by each lamp without occlusion, and the visible fraction of the lamp, 0 to 1. A
    /// lamp behind the surface contributes nothing.
    pub lamps: Vec<(Vec3, f32)>,
}

impl WhiteRadiance {
    /// Sum over the visible light.
    pub fn light(&self) -> Vec3 {
        self.far + self.lamps.iter().map(|(light, visible_fraction)| *light * *visible_fraction).sum::<Vec3>()
    }
}

/// Radiance of a white surface at a place in the room.
pub fn white_radiance(lighting: &Lighting, room: &Room, at: &Plane) -> WhiteRadiance {
    let plane = ReceiverPlane::new(at.point_m, at.normal);
    let far = rays(lighting, &EnvironmentImage::new(&lighting.environment), &plane).iter().map(|ray| ray.light).sum();
    let is_receiver = |at_m| plane.height_m(at_m) < f64::from(MIN_HEIGHT_M);
    let lamp_radiance = |lamp: &PointLight| {
        let offset = (lamp.position_in_world_m - at.point_m).as_vec3();
        let light = on_surface(offset, at.normal.as_vec3(), lamp.color, lamp.range_m, lamp.spot);
        let ends = disc_around(offset, 0.5 * lamp.diameter_m);
        let is_visible = |to: &glam::DVec3| !room.blocks(at.point_m, to.normalize_or_zero(), to.length(), is_receiver);
        (light, ends.filter(is_visible).count() as f32 / LIGHT_SAMPLES as f32)
    };
    WhiteRadiance { far, lamps: lighting.points.iter().map(lamp_radiance).collect() }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::Environment;

    /// A sky of 0.3 and two lamps with (2, 1, 0.5) at 1 m: 2 m above, and under 45° at 2√2 m.
    fn lighting() -> Lighting {
        let lamp = |x: f64| PointLight {
            position_in_world_m: DVec3::new(x, 0.0, 2.0),
            color: Vec3::new(2.0, 1.0, 0.5),
            diameter_m: 0.1,
            range_m: f32::INFINITY,
            spot: None,
        };
        Lighting {
            suns: Vec::new(),
            points: vec![lamp(0.0), lamp(2.0)],
            environment: Environment::Uniform(Vec3::splat(0.3)),
        }
    }

    #[test]
    fn radiance_is_that_of_the_sky_and_of_lamps_by_cosine_and_distance() {
        let radiance = white_radiance(&lighting(), &Room::default(), &Plane { point_m: DVec3::ZERO, normal: DVec3::Z });
        // By hand: 1/2² by the lamp above, cos 45°/8 by the other, and the radiance of the uniform
        // sky.
        let (above, aside) = (0.25, 0.5f32.sqrt() / 8.0);
        let expected = Vec3::splat(0.3) + Vec3::new(2.0, 1.0, 0.5) * (above + aside);
        assert!((radiance.light() - expected).abs().max_element() < 1e-3, "{radiance:?} {expected}");
        // A wall that faces along x has nothing from the lamp above it, and 2/√8³ from the other.
        let wall = white_radiance(&lighting(), &Room::default(), &Plane { point_m: DVec3::ZERO, normal: DVec3::X });
        assert_eq!(wall.lamps[0].0, Vec3::ZERO);
        assert!((wall.lamps[1].0.y - 2.0 / 8f32.powf(1.5)).abs() < 1e-6, "{wall:?}");
    }

    #[test]
    fn real_objects_hide_a_lamp_and_the_surface_itself_does_not() {
        // A board of 40 cm, 1 m above the place, and the uneven floor around it.
        let places = |m: f64| (-20..20).flat_map(move |x| (-20..20).map(move |y| (m * f64::from(x), m * f64::from(y))));
        let board = places(0.01).map(|(x, y)| DVec3::new(x, y, 1.0));
        let floor = places(0.05).flat_map(|(x, y)| [0.0, 0.01].map(|z| DVec3::new(x, y, z)));
        let room = Room::of(board.chain(floor).flat_map(|at| [at, at]));
        let radiance = white_radiance(&lighting(), &room, &Plane { point_m: DVec3::ZERO, normal: DVec3::Z });
        assert_eq!([radiance.lamps[0].1, radiance.lamps[1].1], [0.0, 1.0]);
        let beside = Plane { point_m: DVec3::new(-1.5, 0.0, 0.0), normal: DVec3::Z };
        assert_eq!(white_radiance(&lighting(), &room, &beside).lamps[0].1, 1.0);
    }
}
