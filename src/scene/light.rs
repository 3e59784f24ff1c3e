//! Default lighting, and photometric scale in lux.

use glam::{DVec2, DVec3, Vec3};

use super::document::{Color, LightTable, SunTable};
use super::{Environment, Lighting, Sun};

/// Illuminance under which a white diffuse surface is the camera's white: an office.
pub(super) const DEFAULT_WHITE_LX: f64 = 500.0;

/// Angular diameter of the sun: 0.53°.
pub(super) const SUN_RAD: f32 = 0.00925;

/// A bulb's diameter, metres.
pub(super) const BULB_DIAMETER_M: f64 = 0.06;

/// Angular diameter of the default sun, half of the sky: the shadows have no definite direction,
/// since it is unknown.
const DEFAULT_SUN_RAD: f32 = 1.75;

/// Lighting of a scene that specifies none.
pub(super) fn default_lighting(world_up: DVec3) -> Lighting {
    // 35° from up, towards the world axis least aligned with up; the first one in a tie.
    let axis = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .reduce(|best, axis| if axis.dot(world_up).abs() < best.dot(world_up).abs() { axis } else { best })
        .unwrap_or(DVec3::X);
    let sideways = axis.reject_from_normalized(world_up).normalize();
    let DVec2 { x: up_part, y: side_part } = DVec2::from_angle(35f64.to_radians());
    let towards_light_in_world = (world_up * up_part + sideways * side_part).as_vec3();
    Lighting {
        suns: vec![Sun { towards_light_in_world, color: Vec3::splat(0.6), diameter_rad: DEFAULT_SUN_RAD }],
        points: Vec::new(),
        environment: Environment::Uniform(Vec3::splat(0.55)),
    }
}

impl LightTable {
    /// True if a scene file specifies no light.
    pub fn is_unspecified(&self) -> bool {
        self.environment.is_none() && self.ambient.is_none() && self.sun.is_empty() && self.lamp.is_empty()
    }

    /// Writes the default light, which applies if none is specified, to a scene file.
    pub fn write_default(&mut self, world_up: DVec3) {
        // f32 has seven digits; further ones are rounding errors.
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
    /// True if there is no light.
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
    use crate::scene::{LightingOrigin, SceneFile, load_file};

    #[test]
    fn written_default_light_equals_the_implicit_one() {
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.1, 0.2, 0.97).normalize()] {
            let mut file = SceneFile::default();
            let load = |file: &SceneFile| load_file(file, Path::new("scene.toml"), Some(up)).unwrap();
            let implicit = load(&file);
            assert!(file.light.is_unspecified());
            file.light.write_default(up);
            assert!(!file.light.is_unspecified());
            let explicit = load(&file);
            assert_eq!(
                (implicit.lighting_origin, explicit.lighting_origin),
                (LightingOrigin::Default, LightingOrigin::Scene)
            );
            assert_eq!(explicit.lighting.environment, implicit.lighting.environment);
            let ([is], [was]) = (&explicit.lighting.suns[..], &implicit.lighting.suns[..]) else { panic!("one sun") };
            assert!(is.towards_light_in_world.angle_between(was.towards_light_in_world) < 1e-3);
            assert!(is.color == was.color && (is.diameter_rad - was.diameter_rad).abs() < 1e-4, "{is:?} {was:?}");
        }
    }
}
