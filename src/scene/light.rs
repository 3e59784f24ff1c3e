//! The default light, and the brightness of light in lux.

use glam::{DVec2, DVec3, Vec3};

use super::{Environment, Lighting, Sun};

/// Illuminance at which a white matt surface is the camera's white: an office.
pub(super) const DEFAULT_WHITE_LX: f64 = 500.0;

/// The sun's own diameter: 0.53°.
pub(super) const SUN_RAD: f32 = 0.00925;

/// A bulb's diameter, metres.
pub(super) const BULB_M: f32 = 0.06;

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

impl Lighting {
    /// Whether there is no light at all.
    pub(super) fn is_dark(&self) -> bool {
        self.suns.is_empty()
            && self.points.is_empty()
            && matches!(self.environment, Environment::Uniform(color) if color == Vec3::ZERO)
    }
}
