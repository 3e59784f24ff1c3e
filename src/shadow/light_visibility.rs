//! Visibility of suns and lamps from a virtual object among real ones.
//!
//! One fraction of each light for the whole object: that of the lines from nine points of its
//! bounding box to eight of the light that no voxel of the room blocks. An object that is moved
//! into a real shadow thus darkens gradually.
//!
//! Not modelled: a real shadow's edge across an object; a panorama's light, which is that of the
//! place where it was taken.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::room::{MIN_HEIGHT_M, Room};
use super::sky::disc;
use crate::render::{Lightmap, MAX_POINTS, MAX_SUNS};
use crate::scene::{Lighting, Object, Scene, bounds_m};

/// Samples of a light's disc.
pub const LIGHT_SAMPLES: usize = 8;
/// Places of the bounding box, as a fraction of the way from its middle to its corners.
const CORNER_FRACTION: f64 = 0.8;

/// Lightmaps of one texel for the parts of objects, in order; `None` for those that all light
/// reaches.
pub fn lightmaps(room: &Room, scene: &Scene) -> Vec<Option<Arc<Lightmap>>> {
    let object_lightmaps = |object: &Object| {
        let map = visibilities(room, scene, object).map(|visibilities| Arc::new(lightmap(&visibilities)));
        std::iter::repeat_n(map, object.parts.len())
    };
    scene.objects.iter().flat_map(object_lightmaps).collect()
}

/// The visible fraction of each light from an object, suns first. `None` if all are 1.
fn visibilities(room: &Room, scene: &Scene, object: &Object) -> Option<Vec<f32>> {
    let (low, high) = bounds_m(scene, object)?;
    let corner = |i: u32| {
        let share = DVec3::from_array([0, 1, 2].map(|bit| f64::from(i >> bit & 1)));
        low + (high - low) * (0.5 + CORNER_FRACTION * (share - 0.5))
    };
    let places: Vec<DVec3> = (0..8).map(corner).chain([0.5 * (low + high)]).collect();
    // The support plane blocks nothing.
    let is_receiver = |at_m: DVec3| {
        let support = object.support.as_ref();
        support.is_some_and(|plane| plane.height_m(at_m) < f64::from(MIN_HEIGHT_M))
    };
    // Visibility lines from every point, each with a direction and a length.
    let visible = |lines_from: &dyn Fn(DVec3) -> Vec<(DVec3, f64)>| {
        let lines = places.iter().flat_map(|place| lines_from(*place).into_iter().map(|line| (*place, line)));
        let is_open = |(from, (to, far_m)): &(DVec3, (DVec3, f64))| !room.blocks(*from, *to, *far_m, is_receiver);
        lines.filter(is_open).count() as f32 / (places.len() * LIGHT_SAMPLES) as f32
    };
    let Lighting { suns, points, .. } = &scene.lighting;
    let of_suns = suns.iter().take(MAX_SUNS).map(|sun| {
        let (towards, radius) = (sun.towards_light_in_world, (0.5 * sun.diameter_rad).tan());
        visible(&|_| disc_around(towards, radius).map(|to| (to.normalize(), f64::INFINITY)).collect())
    });
    let of_lamps = points.iter().take(MAX_POINTS).map(|lamp| {
        visible(&|place: DVec3| {
            let way = lamp.position_in_world_m - place;
            let ends = disc_around(way.as_vec3(), 0.5 * lamp.diameter_m);
            ends.map(|to| (to.normalize_or_zero(), to.length())).collect()
        })
    });
    let visibilities: Vec<f32> = of_suns.chain(of_lamps).collect();
    visibilities.iter().any(|visible| *visible < 1.0).then_some(visibilities)
}

/// Samples of a disc at the end of a line, perpendicular to it.
pub fn disc_around(line: Vec3, radius: f32) -> impl Iterator<Item = DVec3> {
    let (aside, over) = line.try_normalize().unwrap_or(Vec3::Z).any_orthonormal_pair();
    disc(LIGHT_SAMPLES).map(move |at| (line + radius * (aside * at.x + over * at.y)).as_dvec3())
}

/// A lightmap with all of the environment's light, and these fractions of suns and lamps.
fn lightmap(visibilities: &[f32]) -> Lightmap {
    let (first, more) = visibilities.split_at(visibilities.len().min(2));
    let nth = |some: &[f32], i: usize| some.get(i).copied().unwrap_or(1.0);
    let two = [[1.0, 1.0, 1.0, nth(first, 0)], [0.0, 0.0, 0.0, nth(first, 1)]];
    let fours = more.chunks(4).map(|some| [0, 1, 2, 3].map(|i| nth(some, i)));
    Lightmap { side: 1, layers: two.into_iter().chain(fours).map(|texel| vec![texel]).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::block::block;
    use super::*;
    use crate::plane::Plane;
    use crate::scene::{Environment, Part, PointLight, Sun};
    use glam::DAffine3;

    /// A cube of 10 cm, under a sun, a lamp and six lamps straight above it.
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
                support: Some(Plane { point_m: DVec3::ZERO, normal: DVec3::Z }),
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

    /// A wall across x at 1 m, 20 cm high, and the floor, which is uneven by a centimetre.
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
    fn object_behind_a_wall_loses_the_lights_beyond_it() {
        let behind = scene(DVec3::new(0.0, 0.0, 0.1));
        let map = lightmaps(&low_wall(), &behind)[0].clone().unwrap();
        // Sun and lamp are behind the wall, the others above; a layer for every four further
        // lights.
        assert_eq!(map.layers[0], [[1.0, 1.0, 1.0, 0.0]]);
        assert!(
            map.layers[1][0][3] < 0.2,
            "the lamp is seen over the wall by the upper places alone: {:?}",
            map.layers
        );
        assert_eq!(map.layers[2..], [vec![[1.0; 4]], vec![[1.0; 4]]]);
        // Half above the wall a part of the sun is visible; in front of the wall all of it, without
        // a lightmap.
        let over = lightmaps(&low_wall(), &scene(DVec3::new(0.0, 0.0, 0.21)))[0].clone().unwrap();
        assert!((0.3..0.7).contains(&over.layers[0][0][3]), "{:?}", over.layers);
        assert_eq!(lightmaps(&low_wall(), &scene(DVec3::new(2.0, 0.0, 0.1))), [None]);
    }
}
