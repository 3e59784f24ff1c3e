//! Outlines of items in the picture, and of their footprints on a plane.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::maths::project_along;
use locard_engine::fit::convex_hull;
use locard_engine::plane::Plane;
use locard_engine::scene::{Object, Scene};
use locard_engine::shot::PosedCamera;

/// Closed polygons, px of the picture.
pub type Outline = Vec<Vec<DVec2>>;

/// Largest number of triangles, or of vertices, that is processed exactly. A larger object is
/// replaced by its bounding box, so that dragging stays interactive.
const MAX_TRIANGLES: usize = 60_000;
const SPHERE_SIDES: usize = 48;

/// Outline of an object.
pub fn outline(eye: &PosedCamera, scene: &Scene, object: &Object) -> Outline {
    let triangles: usize = object.placed().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum();
    if triangles <= MAX_TRIANGLES {
        return eye.outline_px(scene, object);
    }
    let corners = object.corners_m(scene).into_iter().flatten().filter_map(|corner| eye.project(corner));
    Vec::from([convex_hull(corners.collect())])
}

/// Outline of a sphere. Empty if it is partly out of view or the camera is inside.
///
/// View rays touch the sphere in a circle of radius r·√(1 − r²/d²), nearer than its centre by r²/d,
/// where d is the distance of the centre.
pub fn sphere_outline(eye: &PosedCamera, centre_m: DVec3, radius_m: f64) -> Outline {
    let to_eye = eye.position_m() - centre_m;
    let distance_m = to_eye.length();
    if radius_m <= 0.0 || distance_m <= radius_m {
        return Vec::new();
    }
    let ratio = radius_m / distance_m;
    let towards = to_eye / distance_m;
    let circle_centre_m = centre_m + towards * (ratio * radius_m);
    let circle_radius_m = radius_m * (1.0 - ratio * ratio).sqrt();
    let (a, b) = towards.any_orthonormal_pair();
    let on_circle = (0..SPHERE_SIDES).map(|n| {
        let (sin, cos) = (std::f64::consts::TAU * n as f64 / SPHERE_SIDES as f64).sin_cos();
        eye.project(circle_centre_m + circle_radius_m * (a * cos + b * sin))
    });
    on_circle.collect::<Option<Vec<_>>>().into_iter().collect()
}

/// Outline of an object's projection onto a plane along `up`. Empty if the plane is upright.
pub fn footprint(eye: &PosedCamera, scene: &Scene, object: &Object, plane: &Plane, up: DVec3) -> Outline {
    let Some(flat) = projection_onto(plane, up) else { return Vec::new() };
    let mut below = object.clone();
    below.move_by(flat);
    let triangles: usize = below.placed().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum();
    if triangles <= MAX_TRIANGLES {
        return eye.outline_px(scene, &below);
    }
    let corners = object.corners_m(scene).into_iter().flatten();
    Vec::from([convex_hull(corners.filter_map(|corner| eye.project(flat.transform_point3(corner))).collect())])
}

/// Projection along `up` onto a plane.
fn projection_onto(plane: &Plane, up: DVec3) -> Option<DAffine3> {
    let origin = project_along(plane, DVec3::ZERO, up)?;
    let axes = DVec3::AXES.map(|axis| project_along(plane, axis, up).map(|p| p - origin));
    let [Some(x), Some(y), Some(z)] = axes else { return None };
    Some(DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: origin })
}

/// Points that include an object's lowest one, relative to `from_m`: the vertices of its meshes, or
/// of its bounding box.
pub fn support_points_m(scene: &Scene, object: &Object, from_m: DVec3) -> Vec<DVec3> {
    let count: usize = object.placed().map(|part| scene.meshes[part.mesh].vertices.len()).sum();
    if count > MAX_TRIANGLES {
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
    use locard_engine::shot::{Shot, ShotOptions};

    #[test]
    fn outline_of_a_sphere_is_tangent_to_it() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let eye = shot.posed_camera(30).unwrap();
        let middle = eye.ray(DVec2::new(330.0, 230.0)).unwrap().at(0.5);
        let [outline] = &sphere_outline(&eye, middle, 0.1)[..] else { panic!("one polygon") };
        assert_eq!(outline.len(), SPHERE_SIDES);
        for px in outline {
            // Rolling shutter: the camera moves by less than a millimetre.
            let ray = eye.ray(*px).unwrap();
            let off_m = (middle - ray.origin_m).reject_from_normalized(ray.direction).length();
            assert!((off_m - 0.1).abs() < 1e-3, "{off_m}");
        }
        assert!(sphere_outline(&eye, middle, 0.51).is_empty() && sphere_outline(&eye, middle, 0.0).is_empty());
        let behind = 2.0 * eye.position_m() - middle;
        assert!(sphere_outline(&eye, behind, 0.1).is_empty());
    }

    #[test]
    fn projection_along_up_lands_on_the_slope() {
        let slope = Plane { point_m: DVec3::new(0.0, 1.0, 1.0), normal: DVec3::new(0.0, -1.0, 1.0).normalize() };
        let flat = projection_onto(&slope, DVec3::Z).unwrap();
        let projected = flat.transform_point3(DVec3::new(3.0, 0.25, 7.0));
        assert!(projected.abs_diff_eq(DVec3::new(3.0, 0.25, 0.25), 1e-12), "{projected}");
        assert!(projection_onto(&Plane { normal: DVec3::X, ..slope }, DVec3::Z).is_none());
    }
}
