//! Geometry of a photograph of flat things: planes, angles, scale of the picture, and the errors of
//! measurements by a scale that lies in another plane.

use glam::DVec3;

/// An object is flat if its thinnest extent is at most this share of the next one.
const MAX_FLAT_RATIO: f64 = 0.25;

/// Normal of a flat object by the corners of its bounding box (bit 0 of an index is x, bit 1 y, bit
/// 2 z; [`crate::scene::Object::corners_m`]): the direction of its thinnest extent, unit length.
/// `None` if it is not flat.
pub fn flat_normal(corners_m: &[DVec3; 8]) -> Option<DVec3> {
    let sides = [1, 2, 4].map(|corner| corners_m[corner] - corners_m[0]);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| sides[a].length().total_cmp(&sides[b].length()));
    let [thin, middle, long] = order.map(|side| sides[side]);
    let is_flat = thin.length() <= MAX_FLAT_RATIO * middle.length();
    // Perpendicular to the other two also where scaling has made the box oblique.
    is_flat.then(|| middle.cross(long).try_normalize()).flatten()
}

/// Longest side of a bounding box by its corners, metres.
pub fn longest_side_m(corners_m: &[DVec3; 8]) -> f64 {
    [1, 2, 4].map(|corner| (corners_m[corner] - corners_m[0]).length()).into_iter().fold(0.0, f64::max)
}

/// Angle between two lines by their directions (any length but 0), degrees, 0 to 90: signs do not
/// matter.
pub fn angle_between_deg(a: DVec3, b: DVec3) -> f64 {
    // By the tangent: the arc cosine loses half of the digits near 0.
    a.cross(b).length().atan2(a.dot(b).abs()).to_degrees()
}

/// Millimetres per pixel, across the optical axis, at a depth along the axis: z / f, with f in
/// pixels.
pub fn mm_per_px(depth_m: f64, focal_px: f64) -> f64 {
    1e3 * depth_m / focal_px
}

/// Relative error of a length in the subject's plane that is measured by a scale tilted out of that
/// plane, with the camera square to the plane.
///
/// A scale tilted by θ about an axis across it shows cos θ of its length: a millimetre of it covers
/// cos θ times as many pixels as one in the plane. The number of millimetres read for a length is
/// its pixels over the scale's pixels per millimetre, hence 1/cos θ times the truth. The error is
/// 1/cos θ − 1; the scale itself appears 1 − cos θ too short, which is the same to first order
/// (θ²/2). At 12° both are 2.2 %. Infinite at 90°.
pub fn tilt_error(tilt_deg: f64) -> f64 {
    let shown = tilt_deg.to_radians().cos();
    if shown > 1e-9 { 1.0 / shown - 1.0 } else { f64::INFINITY }
}

/// Relative error of a length that is measured by a scale parallel to the subject's plane, but
/// nearer to the camera by `nearer_m`, metres: the scale is enlarged by z / (z − h), so lengths
/// come out as 1 − h/z times the truth. Negative if the scale is nearer.
pub fn height_error(nearer_m: f64, depth_m: f64) -> f64 {
    -nearer_m / depth_m
}

/// Share of a length by which it is foreshortened if the camera is tilted by an angle from the
/// normal of its plane, and the length lies in the direction of the tilt: 1 − cos.
pub fn foreshortening(angle_deg: f64) -> f64 {
    1.0 - angle_deg.to_radians().cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn close(actual: f64, expected: f64, within: f64) {
        assert!((actual - expected).abs() <= within, "{actual} is not {expected}");
    }

    fn box_corners(size: DVec3, turn: DQuat) -> [DVec3; 8] {
        std::array::from_fn(|i| turn * (size * DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64)))
    }

    #[test]
    fn flat_box_has_the_normal_of_its_thinnest_side() {
        // A scale of 105 × 0.8 × 105 mm lying, and turned by 12° about x.
        let lying = box_corners(DVec3::new(0.105, 0.0008, 0.105), DQuat::IDENTITY);
        close(flat_normal(&lying).unwrap().y.abs(), 1.0, 1e-12);
        let tilted = box_corners(DVec3::new(0.105, 0.0008, 0.105), DQuat::from_rotation_x(12f64.to_radians()));
        close(angle_between_deg(flat_normal(&tilted).unwrap(), DVec3::Y), 12.0, 1e-9);
        assert_eq!(flat_normal(&box_corners(DVec3::new(0.1, 0.1, 0.09), DQuat::IDENTITY)), None);
        close(longest_side_m(&tilted), 0.105, 1e-12);
    }

    #[test]
    fn angles_ignore_signs_and_lengths() {
        close(angle_between_deg(DVec3::Z, DVec3::new(0.0, 0.0, -3.0)), 0.0, 1e-12);
        close(angle_between_deg(DVec3::Z, DVec3::new(1.0, 0.0, 1.0)), 45.0, 1e-12);
        close(angle_between_deg(DVec3::Z, DVec3::X), 90.0, 1e-12);
    }

    #[test]
    fn errors_match_hand_calculation() {
        // 1/cos 12° − 1 = 1/0.978148 − 1; cos 60° is a half.
        close(tilt_error(12.0), 0.022_341, 1e-6);
        close(tilt_error(60.0), 1.0, 1e-12);
        assert!(tilt_error(0.0) == 0.0 && tilt_error(90.0) == f64::INFINITY);
        close(foreshortening(12.0), 0.021_852, 1e-6);
        // A scale on a box of 5 cm, 1 m from the camera: 5 % too short.
        close(height_error(0.05, 1.0), -0.05, 1e-12);
        // 1 m away by a lens of 520 px: 1000/520 mm per px.
        close(mm_per_px(1.0, 520.0), 1.923_077, 1e-6);
    }
}
