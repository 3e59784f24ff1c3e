//! A scene without a light of its own in the light that the footage was found to have.

use std::sync::Arc;

use crate::scene::{Lighting, LightingOrigin, Scene};

/// Lights a scene as it was `given` or, where nobody said how it is lit, by what was found: lamps that its models bring shine on.
/// A scene that says its light keeps it.
pub fn light(scene: &mut Arc<Scene>, given: &Lighting, found: Option<&Lighting>) {
    if scene.lighting_origin == LightingOrigin::Scene {
        return;
    }
    let lighting = match found {
        None => given.clone(),
        Some(found) => {
            let brings = scene.lighting_origin == LightingOrigin::Models;
            let own = given.points.iter().filter(|_| brings);
            Lighting {
                suns: if brings { given.suns.clone() } else { Vec::new() },
                points: own.chain(&found.points).copied().collect(),
                environment: found.environment.clone(),
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

    /// A sun, a lamp and light from everywhere.
    fn given() -> Lighting {
        let sun = Sun { towards_light_in_world: Vec3::Z, color: Vec3::ONE, diameter_rad: 0.01 };
        Lighting { suns: vec![sun], points: vec![lamp(1.0)], environment: Environment::Uniform(Vec3::splat(0.1)) }
    }

    fn found() -> Lighting {
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

    /// The lighting of a scene after [`light`].
    fn lit(lighting_origin: LightingOrigin, found: Option<&Lighting>) -> Lighting {
        let mut scene = Arc::new(Scene { lighting_origin, ..Scene::default() });
        light(&mut scene, &given(), found);
        scene.lighting.clone()
    }

    #[test]
    fn lamps_and_suns_of_models_stay_in_found_light() {
        let lighting = lit(LightingOrigin::Models, Some(&found()));
        assert_eq!(lighting.points, [lamp(1.0), lamp(2.0), lamp(3.0)]);
        assert_eq!(lighting.suns, given().suns);
        assert_eq!(lighting.environment, found().environment);
    }

    #[test]
    fn found_light_replaces_a_guessed_light_and_leaves_that_of_a_scene_file() {
        assert_eq!(lit(LightingOrigin::Default, Some(&found())), found());
        assert_eq!(lit(LightingOrigin::Scene, Some(&found())), Lighting::default());
        assert_eq!(
            [LightingOrigin::Default, LightingOrigin::Models].map(|lighting_origin| lit(lighting_origin, None)),
            [given(), given()]
        );
    }
}
