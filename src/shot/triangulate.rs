//! Triangulates a point of the world from its positions in two or more frames.
//!
//! Starts at the point nearest to the rays, and minimizes the reprojection error (Hartley and Sturm
//! 1997; by Gauss and Newton, with distortion and the pose of each row). The point's uncertainty
//! follows from the normal equations, for positions that are accurate to [`PICK_SIGMA_PX`], or to
//! their residuals if those are larger.

use glam::{DMat3, DVec2, DVec3};

use super::{PosedCamera, Shot, SurfaceError};
use crate::fit::ray_intersection;
use crate::text::{fixed, number};

/// A position in a frame's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePoint {
    pub frame: usize,
    /// Position, px from the upper left.
    pub at_px: DVec2,
}

/// A point triangulated from several frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangulatedPoint {
    pub point_m: DVec3,
    /// Standard deviation of its position, over all directions, m.
    pub sigma_m: f64,
    /// Largest angle between two of its rays, degrees.
    pub angle_deg: f64,
    /// Root mean square of the reprojection error, px.
    pub rms_px: f64,
}

/// Accuracy of a picked position, px.
const PICK_SIGMA_PX: f64 = 1.0;
/// Largest accepted standard deviation of a point, as a share of its distance.
const MAX_SIGMA_SHARE: f64 = 0.1;
/// Largest accepted reprojection error, as a share of the picture's width.
const MAX_ERROR_SHARE: f64 = 1.0 / 40.0;
/// Gauss-Newton iterations.
const ITERATIONS: usize = 12;

impl Shot {
    /// The point at two or more positions in different frames. Refused if the rays are too nearly
    /// parallel to give a distance, or pass each other.
    pub fn triangulate(&self, views: &[FramePoint]) -> Result<TriangulatedPoint, SurfaceError> {
        let eyes: Vec<(PosedCamera, FramePoint)> = views
            .iter()
            .map(|view| Ok((self.posed_camera(view.frame)?, *view)))
            .collect::<Result<_, SurfaceError>>()?;
        nearest_point_to_rays(&eyes)
    }
}

fn nearest_point_to_rays(eyes: &[(PosedCamera, FramePoint)]) -> Result<TriangulatedPoint, SurfaceError> {
    let named = |(_, view): &(PosedCamera, FramePoint)| {
        format!("{}:{}", view.frame, view.at_px.to_array().map(number).join(","))
    };
    let what = eyes.iter().map(named).collect::<Vec<_>>().join("+");
    let refused = |reason: String| Err(SurfaceError::Views { what: what.clone(), reason });
    let mut frames: Vec<usize> = eyes.iter().map(|(_, view)| view.frame).collect();
    frames.sort_unstable();
    if let Some(twice) = frames.windows(2).find(|pair| pair[0] == pair[1]) {
        return refused(format!("frame {} is given twice; a point is found from different frames", twice[0]));
    }
    let mut rays = Vec::new();
    for (camera, view) in eyes {
        let i = &camera.geometry().intrinsics;
        let [width, height] = [i.width_px, i.height_px];
        if !(view.at_px.cmpge(DVec2::ZERO).all() && view.at_px.cmplt(DVec2::new(width.into(), height.into())).all()) {
            return Err(SurfaceError::Outside { at_px: view.at_px.to_array(), width, height });
        }
        rays.push(camera.ray(view.at_px).ok_or(SurfaceError::NoRay { at_px: view.at_px.to_array() })?);
    }
    let pairs = rays.iter().enumerate().flat_map(|(i, a)| rays[..i].iter().map(move |b| (a, b)));
    let angle_deg = pairs.map(|(a, b)| a.direction.angle_between(b.direction).to_degrees()).fold(0.0, f64::max);
    let nearly_parallel = || {
        let reason = "the frames see it from nearly the same place, so its distance is unknown";
        format!(
            "{reason} (rays at {}° to each other): take frames between which the camera moved sideways",
            fixed(angle_deg, 2)
        )
    };
    let mut point = ray_intersection(rays.iter().map(|ray| (ray.origin_m, ray.direction)));
    if !point.is_finite() {
        return refused(nearly_parallel());
    }
    let mut normal = DMat3::ZERO;
    for _ in 0..ITERATIONS {
        let Some((next, equations)) = step(eyes, point) else {
            return refused("the rays meet behind a camera: is it the same point in each frame?".to_owned());
        };
        normal = equations;
        if !next.is_finite() {
            return refused(nearly_parallel());
        }
        point = next;
    }
    let squared_error = |(camera, view): &(PosedCamera, FramePoint)| {
        camera.project(point).map(|px| camera.geometry().displacement_px(view.at_px, px).length_squared())
    };
    let Some(squares) = eyes.iter().map(squared_error).sum::<Option<f64>>() else {
        return refused("the rays meet behind a camera: is it the same point in each frame?".to_owned());
    };
    let count = eyes.len() as f64;
    let rms_px = (squares / count).sqrt();
    // Two equations per position, three unknowns.
    let sigma_px = (squares / (2.0 * count - 3.0)).sqrt().max(PICK_SIGMA_PX);
    let covariance = normal.inverse();
    let sigma_m = sigma_px * (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt();
    let distance_m = rays.iter().map(|ray| ray.origin_m.distance(point)).fold(f64::INFINITY, f64::min);
    let width = f64::from(eyes[0].0.geometry().intrinsics.width_px);
    if rms_px > MAX_ERROR_SHARE * width {
        let reason = "the rays pass each other";
        return refused(format!(
            "{reason} by {} px: is it the same point in each frame, and are the poses right?",
            fixed(2.0 * rms_px, 1)
        ));
    }
    if sigma_m.is_nan() || sigma_m > MAX_SIGMA_SHARE * distance_m {
        return refused(nearly_parallel());
    }
    Ok(TriangulatedPoint { point_m: point, sigma_m, angle_deg, rms_px })
}

/// A Gauss-Newton step, and the normal equations' matrix, px²/m². `None` if the point is not
/// visible in a frame.
fn step(eyes: &[(PosedCamera, FramePoint)], point: DVec3) -> Option<(DVec3, DMat3)> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (camera, view) in eyes {
        let projected_px = camera.project(point)?;
        let nudge_m = 1e-5 * camera.position_m().distance(point).max(1e-3);
        let slope_px = |axis: DVec3| {
            Some(camera.geometry().displacement_px(projected_px, camera.project(point + nudge_m * axis)?) / nudge_m)
        };
        let [x, y, z] = [slope_px(DVec3::X)?, slope_px(DVec3::Y)?, slope_px(DVec3::Z)?];
        let off = camera.geometry().displacement_px(projected_px, view.at_px);
        for (row, off) in [(DVec3::new(x.x, y.x, z.x), off.x), (DVec3::new(x.y, y.y, z.y), off.y)] {
            matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * off;
        }
    }
    Some((point + matrix.inverse() * right, matrix))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::ShotOptions;
    use std::path::Path;

    #[test]
    fn point_is_triangulated_from_its_projections_and_refused_without_a_baseline() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        // A point on the floor, in the middle of frame 30.
        let point = shot.support_on_plane(30, DVec2::new(320.0, 300.0), [0.0, 0.0, 1.0, 0.0]).unwrap().point_m;
        let view_of_point = |frame: usize, by: DVec2| FramePoint {
            frame,
            at_px: shot.posed_camera(frame).unwrap().project(point).unwrap() + by,
        };
        let views = [10, 30, 50].map(|frame| view_of_point(frame, DVec2::ZERO));
        for views in [&views[..2], &views] {
            let triangulated = shot.triangulate(views).unwrap();
            assert!(
                triangulated.point_m.distance(point) < 1e-5 && triangulated.rms_px < 1e-3,
                "{triangulated:?}, {point}"
            );
            assert!(triangulated.sigma_m > 1e-4 && triangulated.angle_deg > 1.0, "{triangulated:?}");
        }
        // An error of 1 px in one of them moves it by about the stated uncertainty.
        let triangulated = shot.triangulate(&[views[0], view_of_point(50, DVec2::X)]).unwrap();
        let moved = triangulated.point_m.distance(point);
        assert!(moved > 0.1 * triangulated.sigma_m && moved < 2.0 * triangulated.sigma_m, "{moved} {triangulated:?}");
        let refused = |views: &[FramePoint]| shot.triangulate(views).unwrap_err().to_string();
        let twice = refused(&[views[1], views[1]]);
        assert!(twice.contains("frame 30 is given twice"), "{twice}");
        let next = refused(&[views[1], view_of_point(31, DVec2::ZERO)]);
        assert!(next.contains("nearly the same place") && next.contains("31:"), "{next}");
        assert!(refused(&[views[1]]).contains("nearly the same place"));
        let other = refused(&[views[0], view_of_point(50, DVec2::new(0.0, 90.0))]);
        assert!(other.contains("is it the same point"), "{other}");
        assert!(
            refused(&[views[0], FramePoint { frame: 50, at_px: DVec2::new(-1.0, 3.0) }])
                .contains("outside the picture")
        );
    }
}
