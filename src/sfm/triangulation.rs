//! A point from several views of it.

use glam::{DVec2, DVec3};

use crate::camera::Geometry;
use crate::fit::ray_intersection;
use crate::pose::Pose;

/// Smallest angle between two of the rays, radians: at smaller ones the distance is unknown.
const MIN_PARALLAX: f64 = 0.02;
/// Largest reprojection error of a view, px.
const MAX_ERROR_PX: f64 = 3.0;

/// The point nearest to all rays (least squares of the distances). `None` if the rays are nearly
/// parallel, or if the point does not project to where it was seen.
pub fn triangulate(geometry: &Geometry, views: &[(Pose, DVec2)]) -> Option<DVec3> {
    let rays: Vec<(DVec3, DVec3)> = views
        .iter()
        .filter_map(|(pose, at_px)| {
            Some((pose.position_in_world_m(), pose.world_from_camera_rotation() * geometry.direction(*at_px)?))
        })
        .collect();
    let (_, first) = rays.first()?;
    let parallax = rays.iter().map(|(_, ray)| ray.angle_between(*first)).fold(0.0, f64::max);
    if parallax < MIN_PARALLAX {
        return None;
    }
    let point = ray_intersection(rays);
    let is_seen = |(pose, at_px): &(Pose, DVec2)| {
        geometry.project(pose.transform_point(point)).is_some_and(|at| (at - at_px).length() <= MAX_ERROR_PX)
    };
    (point.is_finite() && views.iter().all(is_seen)).then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_is_found_from_three_views_and_refused_without_parallax() {
        let geometry = Geometry::pinhole(640, 480, 500.0);
        let point = DVec3::new(0.2, -0.1, 2.0);
        let view = |x: f64| {
            let pose = Pose::new(glam::DQuat::from_rotation_y(0.1 * x), DVec3::new(-x, 0.05 * x, 0.0));
            (pose, geometry.project(pose.transform_point(point)).unwrap())
        };
        let triangulated = triangulate(&geometry, &[view(0.0), view(0.2), view(-0.3)]).unwrap();
        assert!((triangulated - point).length() < 1e-9, "{triangulated}");
        assert_eq!(triangulate(&geometry, &[view(0.0), view(0.001)]), None);
        let mut wrong = view(0.2);
        wrong.1.y += 20.0;
        assert_eq!(triangulate(&geometry, &[view(0.0), wrong]), None);
    }
}
