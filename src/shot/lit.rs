//! A scene without a light of its own in the light that the footage was found to have.

use std::sync::Arc;

use crate::scene::{Lighting, LitBy, Scene};

/// Lights a scene as it was `given` or, where nobody said how it is lit, by what was found: lamps that its models bring shine on.
/// A scene that says its light keeps it.
pub fn light(scene: &mut Arc<Scene>, given: &Lighting, found: Option<&Lighting>) {
    if scene.lit_by == LitBy::Scene {
        return;
    }
    let lighting = match found {
        None => given.clone(),
        Some(found) => {
            let brings = scene.lit_by == LitBy::Models;
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
