//! What real things leave of suns' and lamps' light for a virtual thing that stands behind them.
//!
//! One share of each light for the whole thing: from nine places of its box to eight of the light, those lines that meet no solid
//! of the room. So a thing that is carried into a real shadow grows dark as it goes in.
//!
//! Not modelled: a real shadow's edge across a thing; a panorama's light, which is that of the place where it was taken.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::room::{ABOVE_M, Room};
use super::sky::disc;
use crate::render::{Lightmap, MAX_POINTS, MAX_SUNS};
use crate::scene::{Lighting, Object, Scene, bounds_m};

/// Places of a light.
pub const OF_LIGHT: usize = 8;
/// Places of a thing's box lie this far from its middle towards the corners.
const WITHIN: f64 = 0.8;

/// Lightmaps of one texel for the parts of objects, in turn; nothing for those that all light reaches.
pub fn lightmaps(room: &Room, scene: &Scene) -> Vec<Option<Arc<Lightmap>>> {
    let of = |object: &Object| {
        let map = seen(room, scene, object).map(|seen| Arc::new(lightmap(&seen)));
        std::iter::repeat_n(map, object.parts.len())
    };
    scene.objects.iter().flat_map(of).collect()
}

/// The share of each light, suns first, that reaches an object; nothing where all of all does.
fn seen(room: &Room, scene: &Scene, object: &Object) -> Option<Vec<f32>> {
    let (low, high) = bounds_m(scene, object)?;
    let corner = |i: u32| {
        let share = DVec3::from_array([0, 1, 2].map(|bit| f64::from(i >> bit & 1)));
        low + (high - low) * (0.5 + WITHIN * (share - 0.5))
    };
    let places: Vec<DVec3> = (0..8).map(corner).chain([0.5 * (low + high)]).collect();
    // The floor below it is no wall before it.
    let is_floor = |at_m: DVec3| {
        let support = object.support.as_ref();
        support.is_some_and(|floor| (at_m - floor.point_m).dot(floor.normal) < f64::from(ABOVE_M))
    };
    let share = |towards: &dyn Fn(DVec3) -> Vec<(DVec3, f64)>| {
        let lines = places.iter().flat_map(|place| towards(*place).into_iter().map(|line| (*place, line)));
        let is_open = |(from, (to, far_m)): &(DVec3, (DVec3, f64))| !room.stands_between(*from, *to, *far_m, is_floor);
        let open = lines.filter(is_open).count();
        open as f32 / (places.len() * OF_LIGHT) as f32
    };
    let Lighting { suns, points, .. } = &scene.lighting;
    let of_suns = suns.iter().take(MAX_SUNS).map(|sun| {
        let (towards, radius) = (sun.towards_light_in_world, (0.5 * sun.diameter_rad).tan());
        share(&|_| disc_around(towards, radius).map(|to| (to.normalize(), f64::INFINITY)).collect())
    });
    let of_lamps = points.iter().take(MAX_POINTS).map(|lamp| {
        share(&|place: DVec3| {
            let way = lamp.position_in_world_m - place;
            let ends = disc_around(way.as_vec3(), 0.5 * lamp.diameter_m);
            ends.map(|to| (to.normalize_or_zero(), to.length())).collect()
        })
    });
    let seen: Vec<f32> = of_suns.chain(of_lamps).collect();
    seen.iter().any(|share| *share < 1.0).then_some(seen)
}

/// Places of a disc across a way, at its end.
pub fn disc_around(way: Vec3, radius: f32) -> impl Iterator<Item = DVec3> {
    let (aside, over) = way.try_normalize().unwrap_or(Vec3::Z).any_orthonormal_pair();
    disc(OF_LIGHT).map(move |at| (way + radius * (aside * at.x + over * at.y)).as_dvec3())
}

/// Of all of the surroundings' light, and these shares of suns and lamps.
fn lightmap(seen: &[f32]) -> Lightmap {
    let (first, more) = seen.split_at(seen.len().min(2));
    let share = |seen: &[f32], i: usize| seen.get(i).copied().unwrap_or(1.0);
    let two = [[1.0, 1.0, 1.0, share(first, 0)], [0.0, 0.0, 0.0, share(first, 1)]];
    let fours = more.chunks(4).map(|some| [0, 1, 2, 3].map(|i| share(some, i)));
    Lightmap { side: 1, layers: two.into_iter().chain(fours).map(|texel| vec![texel]).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::block::block;
    use super::*;
    use crate::scene::{Environment, Part, PointLight, Sun, Support};
    use glam::DAffine3;

    /// A thing of 10 cm whose middle is 10 cm over the floor, under a sun, a lamp and six lamps straight above it.
    fn scene(at: DVec3) -> Scene {
        let part = Part { mesh: 0, world_from_mesh: DAffine3::from_translation(at) };
        let lamp = |x: f64, z: f64| PointLight {
            position_in_world_m: DVec3::new(x, 0.0, z),
            color: Vec3::ONE,
            diameter_m: 0.02,
            range_m: f32::INFINITY,
            spot: None,
        };
        let sun = Sun { towards_light_in_world: Vec3::X, color: Vec3::ONE, diameter_rad: 0.01 };
        Scene {
            meshes: vec![Arc::new(block(Vec3::splat(0.05)))],
            objects: vec![Object {
                parts: vec![part],
                support: Some(Support { point_m: DVec3::ZERO, normal: DVec3::Z }),
                ..Object::default()
            }],
            lighting: Lighting {
                environment: Environment::Uniform(Vec3::ONE),
                suns: vec![sun],
                points: [lamp(3.0, 0.3)].into_iter().chain((0..6).map(|_| lamp(0.0, 2.0))).collect(),
            },
            ..Scene::default()
        }
    }

    /// Across x at 1 m, as high as 20 cm over the floor, and the floor itself, which is uneven by a centimetre.
    fn low_wall() -> Room {
        let places = (-50..50).flat_map(|y| (0..20).map(move |z| (y, z)));
        let wall = places.map(|(y, z)| DVec3::new(1.0, 0.01 * f64::from(y), 0.01 * f64::from(z)));
        let floor = (-50..300).flat_map(|x| (-30..30).map(move |y| (x, y)));
        let uneven = |(x, y): (i32, i32)| {
            DVec3::new(0.01 * f64::from(x), 0.01 * f64::from(y), 0.01 * f64::from((x * y) % 3 - 1))
        };
        Room::of(wall.chain(floor.map(uneven)))
    }

    #[test]
    fn a_thing_behind_a_wall_lacks_the_lights_beyond_it_alone() {
        let behind = scene(DVec3::new(0.0, 0.0, 0.1));
        let map = lightmaps(&low_wall(), &behind)[0].clone().unwrap();
        // Sun and lamp stand behind the wall, the others above; a layer each for six lights more.
        assert_eq!(map.layers[0], [[1.0, 1.0, 1.0, 0.0]]);
        assert!(
            map.layers[1][0][3] < 0.2,
            "the lamp is seen over the wall by the upper places alone: {:?}",
            map.layers
        );
        assert_eq!(map.layers[2..], [vec![[1.0; 4]], vec![[1.0; 4]]]);
        // Half over the wall it has a part of the sun; before it, all, and no lightmap at all.
        let over = lightmaps(&low_wall(), &scene(DVec3::new(0.0, 0.0, 0.21)))[0].clone().unwrap();
        assert!((0.3..0.7).contains(&over.layers[0][0][3]), "{:?}", over.layers);
        assert_eq!(lightmaps(&low_wall(), &scene(DVec3::new(2.0, 0.0, 0.1))), [None]);
    }
}
