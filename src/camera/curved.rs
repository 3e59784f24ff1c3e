//! Cameras with curved projections: each pixel corresponds to a direction.
//!
//! Directions have the camera's axes: x right, y down, z forward. Pixel positions are raster px,
//! with the upper left corner at (0, 0). "The circle" is the one that touches the nearer pair of
//! the picture's sides.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// The mapping from directions to pixel positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CurvedProjection {
    /// Equidistant: θ = r·fov/2, r = 1 on the circle (Lemme p.36-39). Up to 2π.
    Fisheye { fov_rad: f64 },
    /// Longitude and latitude, equirectangular: θ = y·fov_y/2 above and φ = x·fov_x/2 to the right
    /// of the axis, with x and y from −1 to 1 across the picture (Lemme p.41-42). Up to 2π by π.
    Environment { fov_rad: DVec2 },
    /// Stereographic, projected from the point of the unit sphere behind the camera: r =
    /// tan(θ/2)/tan(fov/4) in radii of the circle. A camera that points down sees a little planet
    /// (Lemme p.40). Below 2π.
    LittlePlanet { fov_rad: f64 },
}

/// A curved camera with its picture's size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvedCamera {
    pub curve: CurvedProjection,
    pub width_px: u32,
    pub height_px: u32,
}

/// A backward direction whose relative distance from the axis is below this has no unique position.
const MIN_OFF_AXIS: f64 = 1e-12;

impl CurvedCamera {
    fn half_px(&self) -> DVec2 {
        0.5 * DVec2::new(self.width_px.into(), self.height_px.into())
    }

    /// The pixel position of a direction (any length), inside the picture or outside. `None` for a
    /// zero direction, for one outside the curve's range, and for straight back, which has no
    /// unique position.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let d = direction.try_normalize()?;
        let half = self.half_px();
        let off_axis = d.truncate().length();
        let theta = off_axis.atan2(d.z);
        let radius = match self.curve {
            CurvedProjection::Environment { fov_rad } => {
                let (phi, above) = (d.x.atan2(d.z), (-d.y).atan2(d.x.hypot(d.z)));
                return Some(half + half * DVec2::new(2.0 * phi / fov_rad.x, -2.0 * above / fov_rad.y));
            }
            CurvedProjection::Fisheye { fov_rad } => 2.0 * theta / fov_rad,
            CurvedProjection::LittlePlanet { fov_rad } => (0.5 * theta).tan() / (0.25 * fov_rad).tan(),
        };
        if off_axis < MIN_OFF_AXIS {
            return (d.z > 0.0).then_some(half);
        }
        Some(half + d.truncate() * (radius * half.min_element() / off_axis))
    }

    /// The direction (unit length) at a pixel position. `None` outside a fisheye's circle, or where
    /// angles would exceed a full turn.
    pub fn unproject(&self, at_px: DVec2) -> Option<DVec3> {
        let half = self.half_px();
        let from_middle = at_px - half;
        let r = from_middle.length() / half.min_element();
        let theta = match self.curve {
            CurvedProjection::Environment { fov_rad } => {
                let DVec2 { x: phi, y: below } = 0.5 * fov_rad * from_middle / half;
                // The tolerance includes the picture's own border despite rounding.
                let inside = phi.abs() <= PI * (1.0 + 1e-12) && below.abs() <= 0.5 * PI * (1.0 + 1e-12);
                let d = DVec3::new(phi.sin() * below.cos(), below.sin(), phi.cos() * below.cos());
                return inside.then_some(d);
            }
            CurvedProjection::Fisheye { fov_rad } => 0.5 * r * fov_rad,
            CurvedProjection::LittlePlanet { fov_rad } => 2.0 * (r * (0.25 * fov_rad).tan()).atan(),
        };
        if matches!(self.curve, CurvedProjection::Fisheye { .. }) && (r > 1.0 + 1e-12 || theta > PI * (1.0 + 1e-12)) {
            return None;
        }
        let towards = from_middle.try_normalize().unwrap_or(DVec2::X);
        Some((towards * theta.sin()).extend(theta.cos()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn degrees(d: f64) -> f64 {
        d.to_radians()
    }

    const RIGHT_BELOW: DVec3 = DVec3::new(1.0, 1.0, 0.0);

    #[test]
    fn fisheye_matches_hand_calculation() {
        // 180° over 400 px: 90° are 200 px, 45° are 100.
        let f = CurvedCamera { curve: CurvedProjection::Fisheye { fov_rad: PI }, width_px: 600, height_px: 400 };
        let at = f.project(DVec3::new(2.0, 0.0, 2.0)).unwrap();
        assert!((at - DVec2::new(400.0, 200.0)).length() < 1e-9, "{at}");
        let at = f.project(RIGHT_BELOW).unwrap();
        assert!((at - DVec2::new(300.0, 200.0) - DVec2::splat(200.0 / 2f64.sqrt())).length() < 1e-9, "{at}");
        assert_eq!(f.unproject(DVec2::new(300.0, 200.0)), Some(DVec3::Z));
        assert_eq!(f.unproject(DVec2::new(501.0, 200.0)), None, "beyond the circle");
        assert_eq!(f.project(DVec3::NEG_Z), None);
    }

    #[test]
    fn environment_matches_hand_calculation() {
        let fov_rad = DVec2::new(2.0 * PI, PI);
        let e = CurvedCamera { curve: CurvedProjection::Environment { fov_rad }, width_px: 720, height_px: 360 };
        // Two px per degree: 90° to the right; 30° up and 60° to the left.
        assert!((e.project(DVec3::X).unwrap() - DVec2::new(540.0, 180.0)).length() < 1e-9);
        let d = DVec3::new(-degrees(60.0).sin() * degrees(30.0).cos(), -0.5, 0.5 * degrees(30.0).cos());
        assert!((e.project(d).unwrap() - DVec2::new(240.0, 120.0)).length() < 1e-9);
        assert!((e.unproject(DVec2::new(360.0, 0.0)).unwrap() - DVec3::NEG_Y).length() < 1e-12, "up is at the top");
    }

    #[test]
    fn little_planet_matches_hand_calculation() {
        // 180° on the circle: tan 45° = 1. 90° off the axis lies on the circle, 45° at tan 22.5° =
        // √2 − 1 of it.
        let p = CurvedCamera { curve: CurvedProjection::LittlePlanet { fov_rad: PI }, width_px: 200, height_px: 200 };
        assert!((p.project(DVec3::X).unwrap() - DVec2::new(200.0, 100.0)).length() < 1e-9);
        let at = p.project(DVec3::new(0.0, 1.0, 1.0)).unwrap();
        assert!((at - DVec2::new(100.0, 100.0 + 100.0 * (2f64.sqrt() - 1.0))).length() < 1e-9, "{at}");
        // It is conformal: small steps along and across the radius are equally long.
        let step = 1e-4;
        let project = |theta: f64, phi: f64| {
            p.project(DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())).unwrap()
        };
        let along = project(2.0 + step, 0.3).distance(project(2.0 - step, 0.3));
        let across = project(2.0, 0.3 + step / 2f64.sin()).distance(project(2.0, 0.3 - step / 2f64.sin()));
        assert!((along / across - 1.0).abs() < 1e-6, "{along} {across}");
    }

    proptest! {
        #[test]
        fn round_trip_over_the_whole_picture(x in 0.0f64..=1.0, y in 0.0f64..=1.0, fov in 0.1f64..6.2, wide in 1u32..900, high in 1u32..900) {
            let curves = [
                CurvedProjection::Fisheye { fov_rad: fov },
                CurvedProjection::LittlePlanet { fov_rad: fov },
                CurvedProjection::Environment { fov_rad: DVec2::new(fov, 0.5 * fov) },
                CurvedProjection::Environment { fov_rad: DVec2::new(2.0 * PI, PI) },
            ];
            for curve in curves {
                let c = CurvedCamera { curve, width_px: wide, height_px: high };
                let at = DVec2::new(x * f64::from(wide), y * f64::from(high));
                let Some(d) = c.unproject(at) else {
                    let r = 2.0 * (at - c.half_px()).length() / f64::from(wide.min(high));
                    let beyond = matches!(curve, CurvedProjection::Fisheye { .. }) && r > 1.0;
                    prop_assert!(beyond, "nothing at {}", at);
                    continue;
                };
                prop_assert!((d.length() - 1.0).abs() < 1e-12);
                // Straight up, down and back have more than one position.
                if d.truncate().length() < 1e-4 && d.z < 0.0 || (d.x.hypot(d.z) < 1e-4 && matches!(curve, CurvedProjection::Environment { .. })) {
                    continue;
                }
                // The left and right borders are the same direction.
                let off = (c.project(d).unwrap() - at).abs();
                let off = if matches!(curve, CurvedProjection::Environment { .. }) { off.x.min((off.x - f64::from(wide)).abs()).max(off.y) } else { off.length() };
                prop_assert!(off < 1e-6 * f64::from(wide.max(high)), "{curve:?} {at} {d}: {off}");
            }
        }
    }
}
