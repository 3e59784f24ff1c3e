//! Applies the estimated lighting of the footage to scenes without their own.

use std::sync::Arc;

use crate::scene::{Lighting, LightingOrigin, Scene};

/// Sets a scene's lighting: its own (`lighting`), or the estimated one if the scene file defines
/// none. Lamps and suns of its models are added to the estimate.
pub fn apply_lighting(scene: &mut Arc<Scene>, lighting: &Lighting, estimated: Option<&Lighting>) {
    if scene.lighting_origin == LightingOrigin::Scene {
        return;
    }
    let lighting = match estimated {
        None => lighting.clone(),
        Some(estimated) => {
            let has_own_lamps = scene.lighting_origin == LightingOrigin::Models;
            let own = lighting.points.iter().filter(|_| has_own_lamps);
            Lighting {
                suns: if has_own_lamps { lighting.suns.clone() } else { Vec::new() },
                points: own.chain(&estimated.points).copied().collect(),
                environment: estimated.environment.clone(),
            }
        }
    };
    if scene.lighting != lighting {
        Arc::make_mut(scene).lighting = lighting;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Environment, PointLight, Sun};
    use glam::{DVec3, Vec3};

    /// A sun, a lamp and a uniform environment.
    fn of_scene() -> Lighting {
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        Lighting { suns: vec![sun], points: vec![lamp(1.0)], environment: Environment::Uniform(Vec3::splat(0.1)) }
    }

    fn estimated() -> Lighting {
        let environment = Environment::Uniform(Vec3::splat(0.2));
        Lighting { suns: Vec::new(), points: vec![lamp(2.0), lamp(3.0)], environment }
    }

    fn lamp(height_m: f64) -> PointLight {
        PointLight {
            position_in_world_m: height_m * DVec3::Z,
            color: Vec3::ONE,
            diameter_m: 0.06,
            range_m: f32::INFINITY,
            spot: None,
        }
    }

    /// The lighting of a scene after [`apply_lighting`].
    fn lit(lighting_origin: LightingOrigin, estimated: Option<&Lighting>) -> Lighting {
        let mut scene = Arc::new(Scene { lighting_origin, ..Scene::default() });
        apply_lighting(&mut scene, &of_scene(), estimated);
        scene.lighting.clone()
    }

    #[test]
    fn lamps_and_suns_of_models_are_added_to_the_estimated_lighting() {
        let lighting = lit(LightingOrigin::Models, Some(&estimated()));
        assert_eq!(lighting.points, [lamp(1.0), lamp(2.0), lamp(3.0)]);
        assert_eq!(lighting.suns, of_scene().suns);
        assert_eq!(lighting.environment, estimated().environment);
    }

    #[test]
    fn estimated_lighting_replaces_a_default_one_but_not_that_of_a_scene_file() {
        assert_eq!(lit(LightingOrigin::Default, Some(&estimated())), estimated());
        assert_eq!(lit(LightingOrigin::Scene, Some(&estimated())), Lighting::default());
        assert_eq!(
            [LightingOrigin::Default, LightingOrigin::Models].map(|lighting_origin| lit(lighting_origin, None)),
            [of_scene(), of_scene()]
        );
    }
}
