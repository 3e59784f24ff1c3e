//! The real surface at a pixel: position and normal, from the frame's depth.
//!
//! On a plane n·X = d the depth z along the ray r (X = z·r) satisfies 1/z = (n/d)·r: it is linear
//! in the ray. So the plane is the linear least-squares fit of 1/z over the pixels around. Errors
//! of structured-light and stereo sensors, which are uniform in 1/z, get the right weights. Pixels
//! of other surfaces are weighted down by Tukey's biweight, iteratively, beginning with those whose
//! depth is near that of the picked pixel.
//!
//! Not modelled: curved surfaces. Within the neighbourhood they are approximated by planes.

use glam::{DMat3, DVec2, DVec3};

use super::{Shot, ShotError};
use crate::frame::Frame;
use crate::pixels::DepthMap;
use crate::plane::Plane;
use crate::pose::Pose;
use crate::text::number;
use crate::tracking::NoPose;

/// Radius of the neighbourhood, as a share of the picture's width.
const RADIUS_SHARE: f64 = 1.0 / 40.0;
/// Largest number of samples along each axis.
const MAX_SAMPLES_A_SIDE: i32 = 41;
/// Largest relative difference of a pixel's depth from the picked one's in the first fit.
const FIRST_TOLERANCE: f64 = 0.06;
/// Reweighting iterations.
const REWEIGHTINGS: usize = 8;
/// Tukey's constant: 95 % efficient for normal errors.
const TUKEY: f64 = 4.685;
/// Smallest number of a plane's pixels.
const MIN_PIXELS: usize = 12;

/// A plane that was fitted around a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// In the world, through its intersection with the pixel's ray. The normal faces the camera.
    pub plane: Plane,
    /// Depth of the point, by the convention of depth maps, m.
    pub depth_m: f64,
    /// Robust standard deviation of the measured depths from the plane, m.
    pub sigma_m: f64,
    /// Share of the pixels around that lie on the plane.
    pub share: f64,
}

/// Why there is no surface at a pixel.
#[derive(Debug, thiserror::Error)]
pub enum SurfaceError {
    #[error("frame {frame} has no depth: give a plane, or pick the point in a second frame too (X,Y+FRAME:X,Y)")]
    NoDepth { frame: usize },
    #[error("{} lies outside of the picture, {width}x{height} px", place(*.at_px))]
    Outside { at_px: [f64; 2], width: u32, height: u32 },
    #[error("the lens model has no ray at {}", place(*.at_px))]
    NoRay { at_px: [f64; 2] },
    #[error("the depth sensor measured no surface around {}: pick a place next to it, or give a plane", place(*.at_px))]
    NotMeasured { at_px: [f64; 2] },
    #[error("{plane} {reason}")]
    Plane { plane: String, reason: &'static str },
    #[error("{what} has no world point: {reason}")]
    Views { what: String, reason: String },
    #[error("the points make no plane: {reason}")]
    Points { reason: &'static str },
    #[error(transparent)]
    NoPose(#[from] NoPose),
    #[error(transparent)]
    Shot(#[from] Box<ShotError>),
}

fn place(at_px: [f64; 2]) -> String {
    at_px.map(|px| number((px * 10.0).round() / 10.0)).join(",")
}

/// The depth map has a time of its own: the position of a pixel in it depends on the pixel's depth.
/// Number of iterations.
const ITERATIONS: usize = 4;

impl Shot {
    /// The surface at a position of a frame's picture, px from the upper left. The depth map's time
    /// and that of the position's row are both taken into account, as in occlusion.
    pub fn surface_at(&self, frame: &Frame, at_px: DVec2) -> Result<Surface, SurfaceError> {
        let index = frame.index;
        let depth = frame.depth.as_ref().ok_or(SurfaceError::NoDepth { frame: index })?;
        let position = at_px.to_array();
        let (width, height) = (f64::from(depth.width), f64::from(depth.height));
        let is_inside = |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.x < width && at.y < height;
        if !is_inside(at_px) {
            return Err(SurfaceError::Outside { at_px: position, width: depth.width, height: depth.height });
        }
        let eye = self.posed_camera(index)?;
        let geometry = eye.geometry();
        let ray = eye.ray(at_px).ok_or(SurfaceError::NoRay { at_px: position })?;
        let not_measured = || SurfaceError::NotMeasured { at_px: position };
        let pose = self.measured_from(frame, depth)?;
        let (origin, along) =
            (pose.transform_point(ray.origin_m), pose.world_from_camera_rotation().inverse() * ray.direction);
        let mut in_map = at_px;
        for _ in 1..ITERATIONS {
            let plane =
                InverseDepthPlane::around(depth, in_map, |px| geometry.depth_ray(px)).ok_or_else(not_measured)?;
            let point = plane.intersect(origin, along).ok_or_else(not_measured)?;
            let next = geometry.project(point).filter(|next| is_inside(*next)).ok_or_else(not_measured)?;
            let has_converged = geometry.displacement_px(in_map, next).length() < 0.5;
            in_map = next;
            if has_converged {
                break;
            }
        }
        let plane = InverseDepthPlane::around(depth, in_map, |px| geometry.depth_ray(px)).ok_or_else(not_measured)?;
        let point = plane.intersect(origin, along).ok_or_else(not_measured)?;
        let depth_m = if geometry.is_equirectangular() { point.length() } else { point.z };
        // n/d points away from the camera, because depth is positive.
        let normal = -(pose.world_from_camera_rotation() * plane.inverse_depth.normalize());
        Ok(Surface {
            plane: Plane { point_m: pose.inverse_transform_point(point), normal },
            depth_m,
            sigma_m: plane.sigma * depth_m * depth_m,
            share: plane.share,
        })
    }

    /// The pose at which a frame's depth was measured, or the frame's if the track does not cover
    /// that time.
    pub(super) fn measured_from(&self, frame: &Frame, depth: &DepthMap) -> Result<Pose, NoPose> {
        let recording = &self.recording;
        let measured = recording.track.at(depth.timestamp_s);
        measured.or_else(|_| recording.pose_at_frame(frame.index))
    }

    /// Intersection of the ray of a position in a frame's picture with the plane
    /// a·x + b·y + c·z = d of the world.
    pub fn support_on_plane(&self, frame: usize, at_px: DVec2, plane: [f64; 4]) -> Result<Plane, SurfaceError> {
        let [a, b, c, d] = plane;
        let normal = DVec3::new(a, b, c);
        let refused = |reason| SurfaceError::Plane { plane: plane.map(number).join(","), reason };
        let unit = normal.try_normalize().ok_or_else(|| refused("is no plane: the normal A,B,C has no length"))?;
        let ray = self.posed_camera(frame)?.ray(at_px).ok_or(SurfaceError::NoRay { at_px: at_px.to_array() })?;
        let t = (d - normal.dot(ray.origin_m)) / normal.dot(ray.direction);
        if !(t.is_finite() && t > 0.0) {
            return Err(refused("does not lie before the camera there"));
        }
        // The normal faces the camera.
        let normal = if unit.dot(ray.direction) > 0.0 { -unit } else { unit };
        Ok(Plane { point_m: ray.at(t), normal })
    }
}

/// A plane in the camera's axes.
struct InverseDepthPlane {
    /// n/d, so that 1/z = (n/d)·ray.
    inverse_depth: DVec3,
    /// Standard deviation of 1/z, 1/m.
    sigma: f64,
    share: f64,
}

impl InverseDepthPlane {
    /// Intersection with a ray in the camera's axes; `None` if it lies behind the ray's origin.
    fn intersect(&self, origin: DVec3, along: DVec3) -> Option<DVec3> {
        // n·X = d is (n/d)·X = 1.
        let t = (1.0 - self.inverse_depth.dot(origin)) / self.inverse_depth.dot(along);
        (t > 0.0 && t.is_finite()).then(|| origin + t * along)
    }

    fn around(depth: &DepthMap, at_px: DVec2, ray: impl Fn(DVec2) -> Option<DVec3>) -> Option<Self> {
        let radius = (RADIUS_SHARE * f64::from(depth.width)).max(4.0);
        let step = ((2.0 * radius / f64::from(MAX_SAMPLES_A_SIDE)).ceil() as i32).max(1);
        let reach = (radius / f64::from(step)) as i32;
        let (x0, y0) = (at_px.x as i32, at_px.y as i32);
        let mut points: Vec<(DVec3, f64, f64)> = Vec::new();
        for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx * step, dy * step))) {
            let (x, y) = (x0 + dx, y0 + dy);
            if x < 0 || y < 0 || x >= depth.width as i32 || y >= depth.height as i32 {
                continue;
            }
            let z = f64::from(depth.depth_m[y as usize * depth.width as usize + x as usize]);
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if let (true, Some(ray)) = (z > 0.0 && z.is_finite(), ray(at)) {
                points.push((ray, z.recip(), at.distance(at_px)));
            }
        }
        // The picked surface is that of the nearest measured pixel.
        let picked = points.iter().min_by(|a, b| a.2.total_cmp(&b.2)).filter(|nearest| nearest.2 <= 0.25 * radius)?.1;
        let mut weights: Vec<f64> =
            points.iter().map(|(_, w, _)| f64::from((w / picked - 1.0).abs() < FIRST_TOLERANCE)).collect();
        let mut fitted = None;
        for _ in 0..REWEIGHTINGS {
            let plane = least_squares(&points, &weights)?;
            let residuals: Vec<f64> = points.iter().map(|(ray, w, _)| (plane.dot(*ray) - w).abs()).collect();
            let mut on: Vec<f64> =
                residuals.iter().zip(&weights).filter(|(_, weight)| **weight > 0.0).map(|(r, _)| *r).collect();
            on.sort_by(f64::total_cmp);
            // Robust σ from the median of absolute residuals; at least the rounding error of 32-bit
            // depth.
            let sigma = (1.4826 * on.get(on.len() / 2)?).max(1e-6 * picked);
            weights = residuals.iter().map(|r| (1.0 - (r / (TUKEY * sigma)).powi(2)).max(0.0).powi(2)).collect();
            fitted = Some((plane, sigma));
        }
        let (inverse_depth, sigma) = fitted?;
        let on = weights.iter().filter(|weight| **weight > 0.0).count();
        (on >= MIN_PIXELS).then(|| Self { inverse_depth, sigma, share: on as f64 / points.len() as f64 })
    }
}

/// Solves the normal equations of 1/z = p·ray; `None` if the rays span no plane.
fn least_squares(points: &[(DVec3, f64, f64)], weights: &[f64]) -> Option<DVec3> {
    let (mut matrix, mut right, mut count) = (DMat3::ZERO, DVec3::ZERO, 0);
    for ((ray, inverse, _), weight) in points.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
        let scaled = *ray * *weight;
        matrix += DMat3::from_cols(scaled * ray.x, scaled * ray.y, scaled * ray.z);
        right += scaled * *inverse;
        count += 1;
    }
    let solved = matrix.inverse() * right;
    (count >= MIN_PIXELS && solved.is_finite()).then_some(solved)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays of a pinhole of 100 px over 160 × 120 px.
    fn ray(at: DVec2) -> Option<DVec3> {
        Some(DVec3::new((at.x - 80.0) / 100.0, (at.y - 60.0) / 100.0, 1.0))
    }

    fn map(depth: impl Fn(f64, f64) -> f64) -> DepthMap {
        let places = (0..120).flat_map(|y| (0..160).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)));
        DepthMap {
            width: 160,
            height: 120,
            depth_m: places.map(|(x, y)| depth(x, y) as f32).collect(),
            timestamp_s: 0.0,
        }
    }

    #[test]
    fn plane_fit_ignores_another_surface_and_gaps() {
        // Tilted by 45° about x: y = z − 2. Right of column 84, another surface is in front of it
        // at 1 m.
        let on_plane = |y: f64| 2.0 / (1.0 - (y - 60.0) / 100.0);
        let depth = map(|x, y| {
            if x > 84.0 {
                1.0
            } else if (x as i32 + y as i32) % 3 == 0 {
                0.0
            } else {
                on_plane(y)
            }
        });
        let at = DVec2::new(82.0, 50.0);
        let plane = InverseDepthPlane::around(&depth, at, ray).unwrap();
        let z = plane.inverse_depth.dot(ray(at).unwrap()).recip();
        assert!((z - on_plane(50.0)).abs() < 1e-5, "{z}");
        let normal = plane.inverse_depth.normalize();
        assert!(normal.abs_diff_eq(DVec3::new(0.0, -0.5f64.sqrt(), 0.5f64.sqrt()), 1e-5), "{normal}");
        assert!(plane.share > 0.5 && plane.share < 0.95, "{}", plane.share);
        // The surface in front faces the camera.
        let front = InverseDepthPlane::around(&depth, DVec2::new(86.0, 50.0), ray).unwrap();
        assert!(front.inverse_depth.abs_diff_eq(DVec3::Z, 1e-5), "{}", front.inverse_depth);
        // Without measured depth.
        assert!(InverseDepthPlane::around(&map(|_, _| 0.0), at, ray).is_none());
    }
}
