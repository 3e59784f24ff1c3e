//! How a selected thing is seen: its border in the picture, and where it stands.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::maths::{Plane, hull};
use locard_engine::scene::{Object, Scene};
use locard_engine::shot::Eye;

/// Closed polygons, px of the picture.
pub type Border = Vec<Vec<DVec2>>;

/// A thing of more triangles is shown by the box around it, so that dragging it stays immediate.
const MOST_TRIANGLES: usize = 60_000;
const BALL_SIDES: usize = 48;

/// The border of an object of the scene's meshes.
pub fn border(eye: &Eye, scene: &Scene, object: &Object) -> Border {
    let triangles: usize = object.placed().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum();
    if triangles <= MOST_TRIANGLES {
        return eye.outline_px(scene, object);
    }
    let corners = object.corners_m(scene).into_iter().flatten().filter_map(|corner| eye.project(corner));
    Vec::from([hull(corners.collect())])
}

/// The border of a ball. Empty where it is not seen whole, and from within.
///
/// Lines of sight touch it in a circle: of radius r·√(1 − r²/d²), nearer than its middle by r²/d, where d is the distance.
pub fn ball(eye: &Eye, middle_m: DVec3, radius_m: f64) -> Border {
    let to_eye = eye.position_m() - middle_m;
    let distance_m = to_eye.length();
    if radius_m <= 0.0 || distance_m <= radius_m {
        return Vec::new();
    }
    let share = radius_m / distance_m;
    let towards = to_eye / distance_m;
    let (circle_m, diameter_or_default_m) =
        (middle_m + towards * (share * radius_m), radius_m * (1.0 - share * share).sqrt());
    let (a, b) = towards.any_orthonormal_pair();
    let on_circle = (0..BALL_SIDES).map(|n| {
        let (sin, cos) = (std::f64::consts::TAU * n as f64 / BALL_SIDES as f64).sin_cos();
        eye.project(circle_m + diameter_or_default_m * (a * cos + b * sin))
    });
    on_circle.collect::<Option<Vec<_>>>().into_iter().collect()
}

/// The border of what an object would leave on a plane below it, moved along `up`. Empty where the plane is upright.
pub fn footprint(eye: &Eye, scene: &Scene, object: &Object, plane: &Plane, up: DVec3) -> Border {
    let Some(flat) = onto(plane, up) else { return Vec::new() };
    let mut below = object.clone();
    below.move_by(flat);
    let triangles: usize = below.placed().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum();
    if triangles <= MOST_TRIANGLES {
        return eye.outline_px(scene, &below);
    }
    let corners = object.corners_m(scene).into_iter().flatten();
    Vec::from([hull(corners.filter_map(|corner| eye.project(flat.transform_point3(corner))).collect())])
}

/// Moves points along `up` onto a plane.
fn onto(plane: &Plane, up: DVec3) -> Option<DAffine3> {
    let origin = plane.beneath(DVec3::ZERO, up)?;
    let axes = DVec3::AXES.map(|axis| plane.beneath(axis, up).map(|p| p - origin));
    let [Some(x), Some(y), Some(z)] = axes else { return None };
    Some(DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: origin })
}

/// Points that an object's lowest one is among, from a place, metres: the points of its meshes, or of its box.
pub fn feet(scene: &Scene, object: &Object, from_m: DVec3) -> Vec<DVec3> {
    let count: usize = object.placed().map(|part| scene.meshes[part.mesh].vertices.len()).sum();
    if count > MOST_TRIANGLES {
        return object.corners_m(scene).into_iter().flatten().map(|corner| corner - from_m).collect();
    }
    let points = object.placed().flat_map(|part| {
        let world = move |v: &locard_engine::scene::Vertex| {
            part.world_from_mesh.transform_point3(DVec3::from(v.position.map(f64::from))) - from_m
        };
        scene.meshes[part.mesh].vertices.iter().map(world)
    });
    points.collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::{Given, Shot};

    #[test]
    fn a_balls_border_is_where_lines_of_sight_touch_it() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let eye = shot.eye(30).unwrap();
        let middle = eye.ray(DVec2::new(330.0, 230.0)).unwrap().at(0.5);
        let [border] = &ball(&eye, middle, 0.1)[..] else { panic!("one polygon") };
        assert_eq!(border.len(), BALL_SIDES);
        for px in border {
            // The camera moves by less than a millimetre while a row is read.
            let ray = eye.ray(*px).unwrap();
            let off_m = (middle - ray.origin_m).reject_from_normalized(ray.direction).length();
            assert!((off_m - 0.1).abs() < 1e-3, "{off_m}");
        }
        assert!(ball(&eye, middle, 0.51).is_empty() && ball(&eye, middle, 0.0).is_empty());
        let behind = 2.0 * eye.position_m() - middle;
        assert!(ball(&eye, behind, 0.1).is_empty());
    }

    #[test]
    fn points_fall_along_up_onto_a_slope() {
        let slope = Plane { point_m: DVec3::new(0.0, 1.0, 1.0), normal: DVec3::new(0.0, -1.0, 1.0).normalize() };
        let flat = onto(&slope, DVec3::Z).unwrap();
        let fallen = flat.transform_point3(DVec3::new(3.0, 0.25, 7.0));
        assert!(fallen.abs_diff_eq(DVec3::new(3.0, 0.25, 0.25), 1e-12), "{fallen}");
        assert!(onto(&Plane { normal: DVec3::X, ..slope }, DVec3::Z).is_none());
    }
}
