//! Nuke's `.chan`: a line for each frame, `frame tx ty tz rx ry rz vfov`, separated by tabs:
//! position in metres, rotations in degrees, vertical field of view in degrees. The rotation order
//! is ZXY, Nuke's default: about z first, then x, then y; `file_from_camera` = Ry·Rx·Rz. Sources:
//! Nuke's reference guide, `Camera`; Blender manual, "Nuke Animation (chan)".

use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::animated_camera::{AnimatedCamera, CameraKeyframe, KeyframeClock};
use super::axes::CameraPlacement;
use crate::text::{fixed, number};
use crate::tracking::records::{self, TextError};

/// A line of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChanRow {
    pub frame: i64,
    pub placement: CameraPlacement,
    pub vertical_fov_rad: f64,
}

/// Rotation angles about x, y and z, rad, in the order ZXY.
fn angles_zxy(rotation: DQuat) -> DVec3 {
    let m = DMat3::from_quat(rotation);
    // Ry·Rx·Rz, row by row: (·, ·, sin y cos x), (cos x sin z, cos x cos z, −sin x),
    // (·, ·, cos y cos x).
    let (sin_x, cos_x) = (-m.z_axis.y, m.z_axis.x.hypot(m.z_axis.z));
    let x = sin_x.atan2(cos_x);
    if cos_x < 1e-9 {
        // Straight up or down, y and z turn about the same axis: z is 0.
        return DVec3::new(x, (-m.x_axis.z).atan2(m.x_axis.x), 0.0);
    }
    DVec3::new(x, m.z_axis.x.atan2(m.z_axis.z), m.x_axis.y.atan2(m.y_axis.y))
}

/// The rotation of angles about x, y and z, rad, in the order ZXY.
fn rotation_zxy(angles: DVec3) -> DQuat {
    DQuat::from_rotation_y(angles.y) * DQuat::from_rotation_x(angles.x) * DQuat::from_rotation_z(angles.z)
}

/// Of the angles of the same rotation those nearest to `before`, so that curves between frames have
/// no jumps.
fn nearest_angles(angles: DVec3, before: DVec3) -> DVec3 {
    let other = DVec3::new(PI - angles.x, angles.y + PI, angles.z + PI);
    let unwrapped = |angles: DVec3| {
        let turns = ((before - angles) / (2.0 * PI)).round();
        angles + 2.0 * PI * turns
    };
    let [angles, other] = [angles, other].map(unwrapped);
    if other.distance_squared(before) < angles.distance_squared(before) { other } else { angles }
}

/// The file's text.
pub fn write(rows: &[ChanRow]) -> String {
    let mut text = String::new();
    let mut before: Option<DVec3> = None;
    for row in rows {
        let angles = angles_zxy(row.placement.rotation);
        let angles = before.map_or(angles, |before| nearest_angles(angles, before));
        before = Some(angles);
        let degrees = angles.to_array().map(f64::to_degrees);
        let values = row.placement.position_m.to_array().into_iter().chain(degrees);
        let _ = write!(text, "{}", row.frame);
        for value in values.chain([row.vertical_fov_rad.to_degrees()]) {
            // An exponent would not be read by every program.
            let _ = write!(text, "\t{}", fixed(value, 9));
        }
        text.push('\n');
    }
    text
}

/// Reads lines of 7 or 8 numbers; the field of view is ignored.
pub fn parse(text: &str, file: &Path) -> Result<AnimatedCamera, TextError> {
    let mut keyframes: Vec<CameraKeyframe> = Vec::new();
    for (line, record) in records::records(text) {
        let refuse = |problem: String| {
            TextError::line(file, line, format!("{problem} (a line is `frame tx ty tz rx ry rz vfov`)"))
        };
        let mut rest = record;
        let mut values = [0.0; 7];
        for (value, name) in values.iter_mut().zip(["frame", "tx", "ty", "tz", "rx", "ry", "rz"]) {
            *value = records::number(&mut rest, name).map_err(refuse)?;
        }
        if !rest.trim().is_empty() {
            records::number(&mut rest, "vfov").map_err(refuse)?;
        }
        records::end(rest).map_err(refuse)?;
        let [at, tx, ty, tz, rx, ry, rz] = values;
        if let Some(before) = keyframes.last().filter(|before| at <= before.at) {
            return Err(refuse(format!(
                "frame {} comes after frame {}; expected ascending frames",
                number(at),
                number(before.at)
            )));
        }
        let rotation = rotation_zxy(DVec3::new(rx, ry, rz) * (PI / 180.0)).normalize();
        keyframes
            .push(CameraKeyframe { at, placement: CameraPlacement { position_m: DVec3::new(tx, ty, tz), rotation } });
    }
    if keyframes.is_empty() {
        let problem = "has no lines `frame tx ty tz rx ry rz vfov`; export the camera again (Nuke: Export chan file)";
        return Err(TextError::line(file, 1, problem));
    }
    Ok(AnimatedCamera { clock: KeyframeClock::FrameNumbers, keyframes, up: DVec3::Y, warnings: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn line_matches_hand_calculation() {
        // 2 m right of the origin and 1 m up, panned by 90° to the left (about y), tilted down by
        // 30° (about its own x).
        let rotation = DQuat::from_rotation_y(0.5 * PI) * DQuat::from_rotation_x(-PI / 6.0);
        let placement = CameraPlacement { position_m: DVec3::new(2.0, 1.0, 0.0), rotation };
        // 480 rows at a focal length of 240 px: 2·atan(1) = 90°.
        let row = ChanRow { frame: 7, placement, vertical_fov_rad: 2.0 * (240.0f64 / 240.0).atan() };
        let expected =
            "7\t2.000000000\t1.000000000\t0.000000000\t-30.000000000\t90.000000000\t0.000000000\t90.000000000\n";
        assert_eq!(write(&[row]), expected);
        // Its axis is the world's −x, turned 30° downwards.
        let ahead = parse(expected, Path::new("a.chan")).unwrap().keyframes[0].placement.rotation * DVec3::NEG_Z;
        let by_hand = DVec3::new(-(PI / 6.0).cos(), -0.5, 0.0);
        assert!((ahead - by_hand).length() < 1e-9, "{ahead}");
    }

    #[test]
    fn angles_continue_across_half_a_turn() {
        let row = |frame: i64, pan_deg: f64| {
            let rotation = DQuat::from_rotation_y(pan_deg.to_radians());
            let placement = CameraPlacement { position_m: DVec3::ZERO, rotation };
            ChanRow { frame, placement, vertical_fov_rad: 1.0 }
        };
        let text = write(&[row(1, 179.0), row(2, 181.0), row(3, 183.0)]);
        let pans: Vec<f64> = text.lines().map(|line| line.split('\t').nth(5).unwrap().parse().unwrap()).collect();
        assert!(pans.iter().zip([179.0, 181.0, 183.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{text}");
    }

    #[test]
    fn mistakes_name_the_line() {
        for (text, expected) in [
            ("", "a.chan, line 1: has no lines"),
            ("1 0 0 0 0 0\n", "a.chan, line 1: rz is missing (a line is `frame tx ty tz rx ry rz vfov`)"),
            ("1 0 0 0 0 0 0 40\n2 0 0 x 0 0 0 40\n", "a.chan, line 2: tz is `x`"),
            ("1 0 0 0 0 0 0 40 9\n", "a.chan, line 1: there is more than expected: `9`"),
            ("2 0 0 0 0 0 0\n2 0 0 0 0 0 0\n", "a.chan, line 2: frame 2 comes after frame 2"),
            ("1 0 0 nan 0 0 0\n", "a.chan, line 1: tz is `nan`"),
        ] {
            let error = parse(text, Path::new("a.chan")).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    proptest! {
        #[test]
        fn rotation_round_trip(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, w in 0.01f64..1.0) {
            let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
            let placement = CameraPlacement { position_m: DVec3::new(x, y, z), rotation };
            let text = write(&[ChanRow { frame: 1, placement, vertical_fov_rad: 1.0 }]);
            let back = parse(&text, Path::new("a.chan")).unwrap().keyframes[0].placement;
            prop_assert!((back.rotation * DVec3::ONE - rotation * DVec3::ONE).length() < 1e-8);
            prop_assert!(back.position_m.distance(placement.position_m) < 1e-8);
        }

        #[test]
        fn straight_down_round_trip(pan in -3.0f64..3.0, roll in -3.0f64..3.0, down in prop::bool::ANY) {
            let tilt = if down { -0.5 * PI } else { 0.5 * PI };
            let rotation = rotation_zxy(DVec3::new(tilt, pan, roll));
            let back = rotation_zxy(angles_zxy(rotation));
            prop_assert!((back * DVec3::ONE - rotation * DVec3::ONE).length() < 1e-7);
        }

        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.e]{0,5}[\t\n]){0,40}") {
            let _ = parse(&text, Path::new("a.chan"));
            let _ = parse(&near, Path::new("a.chan"));
        }
    }
}
