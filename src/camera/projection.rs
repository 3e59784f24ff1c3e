//! The cameras of the lecture slides as matrices: look-at, perspective, window, parallel, viewport.
//!
//! Axes here are those of the slides and of OpenGL: x right, y up, the camera faces −z.
//! Device coordinates are x and y from −1 to 1, y up, and z in one of two [`DepthRange`] ranges.
//! The program itself uses [`super::Geometry`] (x right, y down, z forward); the tests compare the
//! two. Corrections to the slides are noted where they apply.

use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

/// The range of depth between the near and the far plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthRange {
    /// −1 to 1: the slides, OpenGL.
    Signed,
    /// 0 to 1: wgpu. Lemme p.20 states this; the matrix on p.22 gives 0 to −1.
    ZeroToOne,
}

impl DepthRange {
    /// Maps −1..1 to this range.
    fn of_signed(self) -> DMat4 {
        match self {
            Self::Signed => DMat4::IDENTITY,
            Self::ZeroToOne => DMat4::from_translation(0.5 * DVec3::Z) * DMat4::from_scale(DVec3::new(1.0, 1.0, 0.5)),
        }
    }
}

/// A view window, x right and y up, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    pub low: DVec2,
    pub high: DVec2,
}

impl Window {
    pub fn centre(&self) -> DVec2 {
        0.5 * (self.low + self.high)
    }

    pub fn half_size(&self) -> DVec2 {
        0.5 * (self.high - self.low)
    }
}

/// World to camera: Wu's look-at, with `dir` = position − target, right = norm(up × dir), up' =
/// norm(dir × right), and the view as the rotation after the translation by −position. `None` if
/// the three do not define a view.
pub fn look_at(position: DVec3, target: DVec3, up: DVec3) -> Option<DMat4> {
    from_reference_point(position, position - target, up)
}

/// The view matrix from Lemme p.15's extrinsics: view reference point PRP, view plane normal VPN,
/// which points from the scene to the camera, and view up VUP.
pub fn from_reference_point(prp: DVec3, vpn: DVec3, vup: DVec3) -> Option<DMat4> {
    let dir = vpn.try_normalize()?;
    let right = vup.cross(dir).try_normalize()?;
    let up = dir.cross(right);
    let camera_from_world = DMat3::from_cols(right, up, dir).transpose();
    Some(DMat4::from_mat3(camera_from_world) * DMat4::from_translation(-prp))
}

/// Perspective through a window centred on the axis; `aspect` is width over height.
///
/// Wu p.57-60 for a camera along −z: A = (n+f)/(n−f), B = 2fn/(n−f), last row −1. As printed, B has
/// far·far and the last row +1, which with its A is a camera along +z.
pub fn perspective(fov_y_rad: f64, aspect: f64, near_m: f64, far_m: f64, depth: DepthRange) -> DMat4 {
    let cot = 1.0 / (0.5 * fov_y_rad).tan();
    let (a, b) = ((near_m + far_m) / (near_m - far_m), 2.0 * far_m * near_m / (near_m - far_m));
    let signed = DMat4::from_cols(
        DVec4::new(cot / aspect, 0.0, 0.0, 0.0),
        DVec4::new(0.0, cot, 0.0, 0.0),
        DVec4::new(0.0, 0.0, a, -1.0),
        DVec4::new(0.0, 0.0, b, 0.0),
    );
    depth.of_signed() * signed
}

/// The shear that moves the centre of a window, at a distance in front of the camera, onto the
/// axis.
///
/// Lemme p.16, with x' = x + (CW/f)·z: a point of the plane z = −f moves by −CW. As printed, with
/// −CW/f, it would move the window away by the same amount.
pub fn window_shear(centre: DVec2, distance_m: f64) -> DMat4 {
    let mut shear = DMat4::IDENTITY;
    shear.z_axis.x = centre.x / distance_m;
    shear.z_axis.y = centre.y / distance_m;
    shear
}

/// Perspective through a window at the near plane that need not be centred on the axis: shear, then
/// [`perspective`].
pub fn off_centre(window: Window, near_m: f64, far_m: f64, depth: DepthRange) -> DMat4 {
    let half = window.half_size();
    let fov_y_rad = 2.0 * (half.y / near_m).atan();
    perspective(fov_y_rad, half.x / half.y, near_m, far_m, depth) * window_shear(window.centre(), near_m)
}

/// Parallel projection of everything behind a window, from z = −near to z = −far (Lemme p.20).
pub fn orthographic(window: Window, near_m: f64, far_m: f64, depth: DepthRange) -> DMat4 {
    let to_middle = DVec3::new(-window.centre().x, -window.centre().y, 0.5 * (near_m + far_m));
    let half = window.half_size();
    let to_unit = DVec3::new(1.0 / half.x, 1.0 / half.y, -2.0 / (far_m - near_m));
    depth.of_signed() * DMat4::from_scale(to_unit) * DMat4::from_translation(to_middle)
}

/// Device coordinates to pixel positions; depth is unchanged. With `y_down`, row 0 is at the top
/// (Lemme p.24-27).
pub fn viewport(width_px: u32, height_px: u32, y_down: bool) -> DMat4 {
    let half = 0.5 * DVec2::new(width_px.into(), height_px.into());
    let scale = DVec3::new(half.x, if y_down { -half.y } else { half.y }, 1.0);
    DMat4::from_translation(half.extend(0.0)) * DMat4::from_scale(scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics};
    use crate::pose::Pose;
    use glam::dcamera::rh::{proj, view};
    use proptest::prelude::*;

    const NEAR: f64 = 0.5;
    const FAR: f64 = 8.0;

    #[test]
    fn matrices_match_hand_calculation() {
        // From (0, −5, 1) along +y, z up: a metre to the right of the target and two above it.
        let m = look_at(DVec3::new(0.0, -5.0, 1.0), DVec3::new(0.0, 0.0, 1.0), DVec3::Z).unwrap();
        let p = m.transform_point3(DVec3::new(1.0, 0.0, 3.0));
        assert!((p - DVec3::new(1.0, 2.0, -5.0)).length() < 1e-12, "{p}");
        assert_eq!(look_at(DVec3::ZERO, DVec3::Z, DVec3::Z), None);

        // 90° and 4:3, near 1, far 3: A = 4/−2 = −2, B = 6/−2 = −3. (1, 1, −2): x 0.75/2, y 1/2, z
        // (4 − 3)/2.
        let p = perspective(90f64.to_radians(), 4.0 / 3.0, 1.0, 3.0, DepthRange::Signed);
        let p = p.project_point3(DVec3::new(1.0, 1.0, -2.0));
        assert!((p - DVec3::new(0.375, 0.5, 0.5)).length() < 1e-12, "{p}");

        // A window from 0 to 1 at a distance of 2: points behind its centre are at the picture's.
        let window = Window { low: DVec2::ZERO, high: DVec2::ONE };
        let m = off_centre(window, 2.0, 9.0, DepthRange::ZeroToOne);
        assert!(m.project_point3(DVec3::new(0.5, 0.5, -2.0)).length() < 1e-12);
        assert!(m.project_point3(DVec3::new(1.0, 1.0, -4.0)).truncate().length() < 1e-12);
        let corner = m.project_point3(DVec3::new(4.5, 4.5, -9.0));
        assert!((corner - DVec3::ONE).length() < 1e-12, "{corner}");

        // 2 m wide at 640 px: 320 px per metre; rows count downwards, or upwards.
        let m = orthographic(
            Window { low: DVec2::new(-1.0, -0.75), high: DVec2::new(1.0, 0.75) },
            0.0,
            4.0,
            DepthRange::ZeroToOne,
        );
        let p = DVec3::new(0.25, 0.375, -1.0);
        assert_eq!((viewport(640, 480, true) * m).transform_point3(p), DVec3::new(400.0, 120.0, 0.25));
        assert_eq!((viewport(640, 480, false) * m).transform_point3(p), DVec3::new(400.0, 360.0, 0.25));
    }

    #[test]
    fn near_and_far_map_to_the_ends_of_the_depth_range() {
        let window = Window { low: DVec2::new(-0.2, -0.1), high: DVec2::new(0.4, 0.3) };
        for (depth, ends) in [(DepthRange::Signed, [-1.0, 1.0]), (DepthRange::ZeroToOne, [0.0, 1.0])] {
            for m in [
                perspective(0.8, 1.5, NEAR, FAR, depth),
                off_centre(window, NEAR, FAR, depth),
                orthographic(window, NEAR, FAR, depth),
            ] {
                let z = [NEAR, FAR].map(|z| m.project_point3(DVec3::new(0.1, 0.1, -z)).z);
                assert!((z[0] - ends[0]).abs() < 1e-12 && (z[1] - ends[1]).abs() < 1e-12, "{depth:?} {z:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn matrices_equal_those_of_glam(
            eye in prop::array::uniform3(-9.0f64..9.0), target in prop::array::uniform3(-9.0f64..9.0),
            up in prop::array::uniform3(-1.0f64..1.0), fov in 0.05f64..3.0, aspect in 0.2f64..5.0,
            near in 0.01f64..1.0, depth in 0.1f64..100.0, low in prop::array::uniform2(-2.0f64..0.5),
            size in prop::array::uniform2(0.1f64..3.0),
        ) {
            // Relative to the matrix's own size.
            let same = |a: DMat4, b: DMat4| a.abs_diff_eq(b, 1e-6 * b.to_cols_array().iter().fold(1.0, |m, v| v.abs().max(m)));
            let [eye, target, up] = [eye, target, up].map(DVec3::from);
            prop_assume!((target - eye).normalize().cross(up).length() > 0.05);
            // glam requires a unit up vector.
            prop_assert!(same(look_at(eye, target, up).unwrap(), view::look_at_mat4(eye, target, up.normalize())));
            let far = near + depth;
            let w = Window { low: DVec2::from(low), high: DVec2::from(low) + DVec2::from(size) };
            let (l, r, b, t) = (w.low.x, w.high.x, w.low.y, w.high.y);
            prop_assert!(same(perspective(fov, aspect, near, far, DepthRange::Signed), proj::opengl::perspective(fov, aspect, near, far)));
            prop_assert!(same(perspective(fov, aspect, near, far, DepthRange::ZeroToOne), proj::directx::perspective(fov, aspect, near, far)));
            prop_assert!(same(off_centre(w, near, far, DepthRange::Signed), proj::opengl::frustum(l, r, b, t, near, far)));
            prop_assert!(same(off_centre(w, near, far, DepthRange::ZeroToOne), proj::directx::frustum(l, r, b, t, near, far)));
            prop_assert!(same(orthographic(w, near, far, DepthRange::Signed), proj::opengl::orthographic(l, r, b, t, near, far)));
            prop_assert!(same(orthographic(w, near, far, DepthRange::ZeroToOne), proj::directx::orthographic(l, r, b, t, near, far)));
        }

        /// The slides' chain from world to raster equals the program's camera: OpenCV's axes, focal
        /// lengths in px.
        #[test]
        fn slide_matrices_equal_the_geometry_projection(
            point in prop::array::uniform3(-2.0f64..2.0), eye in prop::array::uniform3(4.0f64..9.0),
            low in prop::array::uniform2(-0.9f64..-0.1), size in 0.5f64..1.5,
        ) {
            let (point, eye, target) = (DVec3::from(point), DVec3::from(eye), DVec3::new(0.1, -0.2, 0.3));
            // Square pixels need a window of 4:3.
            let low = DVec2::from(low);
            let window = Window { low, high: low + DVec2::new(4.0, 3.0) * size / 4.0 };
            let near = 0.7;
            let chain = viewport(640, 480, true) * off_centre(window, near, 100.0, DepthRange::ZeroToOne) * look_at(eye, target, DVec3::Z).unwrap();
            let raster = chain.project_point3(point);
            let px_a_metre = 640.0 / (2.0 * window.half_size().x);
            let middle = window.centre() * px_a_metre;
            let intrinsics = Intrinsics {
                fx_px: near * px_a_metre, fy_px: near * px_a_metre, cx_px: 320.0 - middle.x, cy_px: 240.0 + middle.y,
                ..Default::default()
            };
            let pose = Pose::look_at(eye, target, DVec3::Z).unwrap();
            let at = Geometry::new(intrinsics, Distortion::default()).project(pose.transform_point(point)).unwrap();
            prop_assert!((at - raster.truncate()).length() < 1e-6 * (1.0 + at.length()), "{at} {raster}");
        }
    }
}
