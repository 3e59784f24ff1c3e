//! The default light, and the brightness of light in lux.

use glam::{DVec2, DVec3, Vec3};

use super::document::{Color, LightTable, SunTable};
use super::{Environment, Lighting, Sun};

/// Illuminance at which a white matt surface is the camera's white: an office.
pub(super) const DEFAULT_WHITE_LX: f64 = 500.0;

/// The sun's own diameter: 0.53°.
pub(super) const SUN_RAD: f32 = 0.00925;

/// A bulb's diameter, metres.
pub(super) const BULB_M: f64 = 0.06;

/// Where nobody said from where the light comes, it comes from half of the sky: no shadow shows a direction that was guessed.
const GUESSED_RAD: f32 = 1.75;

/// The light of a scene that has none of its own.
pub(super) fn default_lighting(world_up: DVec3) -> Lighting {
    // 35° off towards the world axis least aligned with up; the first one if equal.
    let axis = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .reduce(|best, axis| if axis.dot(world_up).abs() < best.dot(world_up).abs() { axis } else { best })
        .unwrap_or(DVec3::X);
    let sideways = axis.reject_from_normalized(world_up).normalize();
    let DVec2 { x: up_part, y: side_part } = DVec2::from_angle(35f64.to_radians());
    let towards_light_in_world = (world_up * up_part + sideways * side_part).as_vec3();
    Lighting {
        suns: vec![Sun { towards_light_in_world, color: Vec3::splat(0.6), diameter_rad: GUESSED_RAD }],
        points: Vec::new(),
        environment: Environment::Uniform(Vec3::splat(0.55)),
    }
}

impl LightTable {
    /// Whether a scene file says nothing of where light comes from.
    pub fn says_none(&self) -> bool {
        self.environment.is_none() && self.ambient.is_none() && self.sun.is_empty() && self.lamp.is_empty()
    }

    /// Says in a scene file the light that the scene has as long as it says none.
    pub fn say_guessed(&mut self, world_up: DVec3) {
        // f32 has seven digits; the last are its own.
        let short = |n: f64| (n * 1e4).round() / 1e4;
        let Lighting { suns, environment, .. } = default_lighting(world_up);
        if let Environment::Uniform(color) = environment {
            self.ambient = Some(Color::Grey(short(color.x.into())));
        }
        let sun = |sun: &Sun| SunTable {
            towards: sun.towards_light_in_world.as_dvec3().to_array().map(short),
            color: Some(Color::Grey(short(sun.color.x.into()))),
            intensity: None,
            diameter_deg: Some(short(f64::from(sun.diameter_rad).to_degrees())),
        };
        self.sun = suns.iter().map(sun).collect();
    }
}

impl Lighting {
    /// Whether there is no light at all.
    pub(super) fn is_dark(&self) -> bool {
        self.suns.is_empty()
            && self.points.is_empty()
            && matches!(self.environment, Environment::Uniform(color) if color == Vec3::ZERO)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::{LitBy, SceneFile, load_file};

    #[test]
    fn a_guessed_light_that_is_said_shines_as_before() {
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.1, 0.2, 0.97).normalize()] {
            let mut file = SceneFile::default();
            let load = |file: &SceneFile| load_file(file, Path::new("scene.toml"), Some(up)).unwrap();
            let unsaid = load(&file);
            assert!(file.light.says_none());
            file.light.say_guessed(up);
            assert!(!file.light.says_none());
            let said = load(&file);
            assert_eq!((unsaid.lit_by, said.lit_by), (LitBy::Nobody, LitBy::Scene));
            assert_eq!(said.lighting.environment, unsaid.lighting.environment);
            let ([is], [was]) = (&said.lighting.suns[..], &unsaid.lighting.suns[..]) else { panic!("one sun") };
            assert!(is.towards_light_in_world.angle_between(was.towards_light_in_world) < 1e-3);
            assert!(is.color == was.color && (is.diameter_rad - was.diameter_rad).abs() < 1e-4, "{is:?} {was:?}");
        }
    }
}
