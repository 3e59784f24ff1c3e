//! A point of the world from the places where two or more frames show it.
//!
//! Begins where the rays come nearest to each other, and goes on to the point whose images lie nearest to the places (Hartley
//! and Sturm 1997; by Gauss and Newton, with distortion and the pose of each row). How well it is known follows from the
//! normal equations, for places that are right within [`PICKED_PX`], or within what they contradict each other.

use glam::{DMat3, DVec2, DVec3};

use super::{Eye, Shot, SurfaceError};
use crate::text::{fixed, number};

/// A place in a frame's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub frame: usize,
    /// px from the upper left.
    pub at_px: DVec2,
}

/// A point that was found from several views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangulated {
    pub point_m: DVec3,
    /// The standard deviation of its place, over all directions, metres.
    pub sigma_m: f64,
    /// The largest angle between two of its rays, degrees.
    pub angle_deg: f64,
    /// How far its images lie from the places, root mean square, px.
    pub off_px: f64,
}

/// How exactly a person picks, px.
const PICKED_PX: f64 = 1.0;
/// A point that is known worse than this share of its distance is none.
const WORST: f64 = 0.1;
/// Images farther from the places than this share of the picture's width are of something else.
const FARTHEST: f64 = 1.0 / 40.0;
const ROUNDS: usize = 12;

impl Shot {
    /// The point that two or more views show. Refused where they are too much alike to tell how far away it is, and where they
    /// do not show the same.
    pub fn triangulate(&self, views: &[View]) -> Result<Triangulated, SurfaceError> {
        let eyes: Vec<(Eye, View)> =
            views.iter().map(|view| Ok((self.eye(view.frame)?, *view))).collect::<Result<_, SurfaceError>>()?;
        of_views(&eyes)
    }
}

fn of_views(eyes: &[(Eye, View)]) -> Result<Triangulated, SurfaceError> {
    let named = |(_, view): &(Eye, View)| format!("{}:{}", view.frame, view.at_px.to_array().map(number).join(","));
    let what = eyes.iter().map(named).collect::<Vec<_>>().join("+");
    let refused = |reason: String| Err(SurfaceError::Views { what: what.clone(), reason });
    let mut frames: Vec<usize> = eyes.iter().map(|(_, view)| view.frame).collect();
    frames.sort_unstable();
    if let Some(twice) = frames.windows(2).find(|pair| pair[0] == pair[1]) {
        return refused(format!("frame {} is given twice; a point is found from different frames", twice[0]));
    }
    let mut rays = Vec::new();
    for (eye, view) in eyes {
        let i = &eye.geometry().intrinsics;
        let [width, height] = [i.width_px, i.height_px];
        if !(view.at_px.cmpge(DVec2::ZERO).all() && view.at_px.cmplt(DVec2::new(width.into(), height.into())).all()) {
            return Err(SurfaceError::Outside { at_px: view.at_px.to_array(), width, height });
        }
        rays.push(eye.ray(view.at_px).ok_or(SurfaceError::NoRay { at_px: view.at_px.to_array() })?);
    }
    let pairs = rays.iter().enumerate().flat_map(|(i, a)| rays[..i].iter().map(move |b| (a, b)));
    let angle_deg = pairs.map(|(a, b)| a.direction.angle_between(b.direction).to_degrees()).fold(0.0, f64::max);
    // The point with the least squares of distances from the rays.
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for ray in &rays {
        let d = ray.direction;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        matrix += across;
        right += across * ray.origin_m;
    }
    let alike = || {
        let reason = "the frames see it from too nearly the same place to tell how far away it is";
        format!(
            "{reason} (rays at {}° to each other): take frames between which the camera moved sideways",
            fixed(angle_deg, 2)
        )
    };
    let mut point = matrix.inverse() * right;
    if !point.is_finite() {
        return refused(alike());
    }
    let mut normal = DMat3::ZERO;
    for _ in 0..ROUNDS {
        let Some((next, equations)) = step(eyes, point) else {
            return refused("the rays meet behind a camera: is it the same point in each frame?".to_owned());
        };
        normal = equations;
        if !next.is_finite() {
            return refused(alike());
        }
        point = next;
    }
    let off =
        |(eye, view): &(Eye, View)| eye.project(point).map(|px| eye.geometry().way_px(view.at_px, px).length_squared());
    let Some(squares) = eyes.iter().map(off).sum::<Option<f64>>() else {
        return refused("the rays meet behind a camera: is it the same point in each frame?".to_owned());
    };
    let count = eyes.len() as f64;
    let off_px = (squares / count).sqrt();
    // Two numbers a view, three of the point.
    let sigma_px = (squares / (2.0 * count - 3.0)).sqrt().max(PICKED_PX);
    let covariance = normal.inverse();
    let sigma_m = sigma_px * (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z).sqrt();
    let distance_m = rays.iter().map(|ray| ray.origin_m.distance(point)).fold(f64::INFINITY, f64::min);
    let width = f64::from(eyes[0].0.geometry().intrinsics.width_px);
    match () {
        () if off_px > FARTHEST * width => {
            let reason = "the rays pass each other";
            refused(format!(
                "{reason} by {} px: is it the same point in each frame, and are the poses right?",
                fixed(2.0 * off_px, 1)
            ))
        }
        () if sigma_m.is_nan() || sigma_m > WORST * distance_m => refused(alike()),
        () => Ok(Triangulated { point_m: point, sigma_m, angle_deg, off_px }),
    }
}

/// A step of Gauss and Newton, and the normal equations' matrix, px²/m². `None` if a view does not see the point.
fn step(eyes: &[(Eye, View)], point: DVec3) -> Option<(DVec3, DMat3)> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (eye, view) in eyes {
        let seen = eye.project(point)?;
        let nudge_m = 1e-5 * eye.position_m().distance(point).max(1e-3);
        let along = |axis: DVec3| Some(eye.geometry().way_px(seen, eye.project(point + nudge_m * axis)?) / nudge_m);
        let [x, y, z] = [along(DVec3::X)?, along(DVec3::Y)?, along(DVec3::Z)?];
        let off = eye.geometry().way_px(seen, view.at_px);
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
    use crate::shot::Given;
    use std::path::Path;

    #[test]
    fn a_point_is_found_from_where_it_is_seen_and_refused_from_one_place() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        // A point on the floor that frame 30 sees in its middle.
        let point = shot.support_on_plane(30, DVec2::new(320.0, 300.0), [0.0, 0.0, 1.0, 0.0]).unwrap().point_m;
        let seen =
            |frame: usize, by: DVec2| View { frame, at_px: shot.eye(frame).unwrap().project(point).unwrap() + by };
        let views = [10, 30, 50].map(|frame| seen(frame, DVec2::ZERO));
        for views in [&views[..2], &views] {
            let found = shot.triangulate(views).unwrap();
            assert!(found.point_m.distance(point) < 1e-5 && found.off_px < 1e-3, "{found:?}, {point}");
            assert!(found.sigma_m > 1e-4 && found.angle_deg > 1.0, "{found:?}");
        }
        // A px off in one of them moves it by about as much as is told.
        let found = shot.triangulate(&[views[0], seen(50, DVec2::X)]).unwrap();
        let moved = found.point_m.distance(point);
        assert!(moved > 0.1 * found.sigma_m && moved < 2.0 * found.sigma_m, "{moved} {found:?}");
        let refused = |views: &[View]| shot.triangulate(views).unwrap_err().to_string();
        let twice = refused(&[views[1], views[1]]);
        assert!(twice.contains("frame 30 is given twice"), "{twice}");
        let next = refused(&[views[1], seen(31, DVec2::ZERO)]);
        assert!(next.contains("too nearly the same place") && next.contains("31:"), "{next}");
        assert!(refused(&[views[1]]).contains("too nearly the same place"));
        let other = refused(&[views[0], seen(50, DVec2::new(0.0, 90.0))]);
        assert!(other.contains("is it the same point"), "{other}");
        assert!(
            refused(&[views[0], View { frame: 50, at_px: DVec2::new(-1.0, 3.0) }]).contains("outside of the picture")
        );
    }
}
