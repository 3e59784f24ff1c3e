//! Where the camera stands: OpenTrackIO's chain of transforms, and our poses.
//!
//! A transform is a translation in metres and a rotation by pan, tilt and roll in degrees,
//! right-handed and intrinsic about z, x and y, in that order; all transforms of a sample, one
//! within the other, place the sensor on the stage. With all angles 0 it has x to the camera's
//! right, y forward and z up:
//!
//! ```text
//! world_from_sensor = T₁ · T₂ · … · Tₙ
//! Tᵢ = translate(tᵢ) · Rz(pan) · Rx(tilt) · Ry(roll) · scale(sᵢ)
//! ```
//!
//! So pan turns to the left, tilt upwards, and roll lowers the right side (z towards x: clockwise,
//! seen from behind). Our camera has x right, y down, z forward. In the sensor's axes these are (1,
//! 0, 0), (0, 0, −1) and (0, 1, 0), which is a rotation about x by −90°. The world stays as it is:
//! right-handed, z up, metres.
//!
//! After transforms.json of OpenTrackIO 1.0.1 and OpenLensIO 1.0.1, section 1.2. The entrance pupil
//! in front of the sensor is added by [`super::LensState::at_pupil`].

use ciborium::value::Value;
use glam::{DAffine3, DQuat, DVec3, EulerRot};

use super::error::SampleError;
use super::sample::{map, member, triple};
use crate::pose::Pose;

/// Pan, tilt and roll of OpenTrackIO, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// Positive to the left.
    pub pan_deg: f64,
    /// Positive upwards.
    pub tilt_deg: f64,
    /// Positive clockwise, seen from behind the camera.
    pub roll_deg: f64,
}

/// `sensor_from_camera`: converts the camera's axes (x right, y down, z forward) to OpenTrackIO's
/// (x right, y forward, z up).
fn sensor_from_camera() -> DQuat {
    DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)
}

impl Angles {
    /// `world_from_sensor`.
    fn rotation(self) -> DQuat {
        let [pan, tilt, roll] = [self.pan_deg, self.tilt_deg, self.roll_deg].map(f64::to_radians);
        DQuat::from_euler(EulerRot::ZXY, pan, tilt, roll)
    }

    /// Angles of a pose. Straight up or down, where pan and roll have the same axis, roll is 0 or
    /// close to it.
    pub fn of(pose: &Pose) -> Self {
        let world_from_sensor = pose.world_from_camera_rotation() * sensor_from_camera().conjugate();
        let (pan, tilt, roll) = world_from_sensor.to_euler(EulerRot::ZXY);
        Self { pan_deg: pan.to_degrees(), tilt_deg: tilt.to_degrees(), roll_deg: roll.to_degrees() }
    }

    /// Pose of a camera with these angles at a position.
    pub fn pose(self, position_m: DVec3) -> Pose {
        Pose::from_camera_in_world(position_m, self.rotation() * sensor_from_camera())
    }
}

/// The sensor's pose from a sample's `transforms`. Scales affect the positions within them, and no
/// rotation.
pub fn pose_of(transforms: &Value) -> Result<Pose, SampleError> {
    let refused = |key: String, accepted| SampleError::Value { key, accepted };
    let list = transforms.as_array().filter(|list| !list.is_empty());
    let list = list.ok_or_else(|| refused("transforms".into(), "a list of transforms"))?;
    let (mut world_from_parent, mut rotation) = (DAffine3::IDENTITY, DQuat::IDENTITY);
    for (i, transform) in list.iter().enumerate() {
        let part = |key: &str, names, default: Option<DVec3>| {
            let axes = member(transform, key).map_or(default, |value| triple(value, names));
            axes.ok_or_else(|| refused(format!("transforms[{i}].{key}"), "a map of finite numbers"))
        };
        let translation_m = part("translation", ["x", "y", "z"], None)?;
        let angles = part("rotation", ["pan", "tilt", "roll"], None)?;
        let scale = member(transform, "scale").map_or(Ok(DVec3::ONE), |scale| {
            let one = |name| member(scale, name).map_or(Some(1.0), super::sample::number);
            let scale = (|| Some(DVec3::new(one("x")?, one("y")?, one("z")?)))();
            scale.ok_or_else(|| refused(format!("transforms[{i}].scale"), "a map of finite numbers"))
        })?;
        let turn = Angles { pan_deg: angles.x, tilt_deg: angles.y, roll_deg: angles.z }.rotation();
        world_from_parent *= DAffine3::from_scale_rotation_translation(scale, turn, translation_m);
        rotation *= turn;
    }
    let position_m = world_from_parent.translation;
    if !(position_m.is_finite() && rotation.is_finite()) {
        return Err(refused("transforms".into(), "a place within reach"));
    }
    Ok(Pose::from_camera_in_world(position_m, rotation.normalize() * sensor_from_camera()))
}

/// A pose as a list of one transform.
pub fn transform_of(pose: &Pose) -> Value {
    let (at, angles) = (pose.position_in_world_m(), Angles::of(pose));
    let triple = |names: [&str; 3], values: [f64; 3]| {
        let [a, b, c] = [0, 1, 2].map(|i| (names[i], Value::from(values[i])));
        map([a, b, c])
    };
    Value::Array(vec![map([
        ("translation", triple(["x", "y", "z"], at.to_array())),
        ("rotation", triple(["pan", "tilt", "roll"], [angles.pan_deg, angles.tilt_deg, angles.roll_deg])),
        ("id", "Camera".into()),
    ])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::{Encoding, Sample};
    use proptest::prelude::*;

    fn pose(transforms: &str) -> Result<Pose, SampleError> {
        let text = format!(r#"{{"transforms":{transforms}}}"#);
        let sample = Sample::decode(Encoding::Json, text.as_bytes()).unwrap();
        pose_of(sample.get(&["transforms"]).unwrap())
    }

    fn one(x: f64, y: f64, z: f64, pan: f64, tilt: f64, roll: f64) -> String {
        format!(
            r#"{{"translation":{{"x":{x},"y":{y},"z":{z}}},"rotation":{{"pan":{pan},"tilt":{tilt},"roll":{roll}}}}}"#
        )
    }

    /// The camera's right, down and forward axes in the world.
    fn axes(pose: &Pose) -> [DVec3; 3] {
        [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.world_from_camera_rotation() * axis)
    }

    fn near(axes: [DVec3; 3], expected: [[f64; 3]; 3]) {
        for (axes, expected) in axes.into_iter().zip(expected) {
            assert!((axes - DVec3::from(expected)).length() < 1e-12, "{axes} is not {expected:?}");
        }
    }

    #[test]
    fn axes_match_computed_values() {
        let turned = |pan, tilt, roll| axes(&pose(&format!("[{}]", one(0.0, 0.0, 0.0, pan, tilt, roll))).unwrap());
        // At rest it faces y, with x right and z up.
        near(turned(0.0, 0.0, 0.0), [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]);
        // Pan by 90° about z takes y to −x: to the left.
        near(turned(90.0, 0.0, 0.0), [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]);
        // Tilt by 90° about x takes y to z: straight up, and the picture's lower side points
        // forward.
        near(turned(0.0, 90.0, 0.0), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        // Roll by 90° about y takes z to x and x to −z: the right side is down.
        near(turned(0.0, 0.0, 90.0), [[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        // Pan, then tilt about the turned x: still faces up, its right is y.
        near(turned(90.0, 90.0, 0.0), [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        // The official examples' pan 180, tilt 90, roll 45: x to −x, y to z, z to y, then roll
        // about the view.
        let s = 0.5f64.sqrt();
        near(turned(180.0, 90.0, 45.0), [[-s, -s, 0.0], [s, -s, 0.0], [0.0, 0.0, 1.0]]);
    }

    #[test]
    fn transforms_are_nested() {
        // A crane at (1, 2, 3), turned to the left, scaled by 2: its (1, 0, 0) is 2 m along the
        // world's y.
        let crane = one(1.0, 2.0, 3.0, 90.0, 0.0, 0.0).replacen('{', r#"{"scale":{"x":2,"y":2,"z":2},"#, 1);
        let head = one(1.0, 0.0, 0.0, -90.0, 0.0, 0.0);
        let pose = pose(&format!("[{crane},{head}]")).unwrap();
        assert!((pose.position_in_world_m() - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-12);
        near(axes(&pose), [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]);
    }

    #[test]
    fn malformed_transforms_are_refused() {
        for text in ["[]", "{}", "[1]", r#"[{"translation":{}}]"#, r#"[{"translation":{},"rotation":{"pan":"x"}}]"#] {
            assert!(pose(text).is_err(), "{text}");
        }
        let far = one(1e308, 0.0, 0.0, 0.0, 0.0, 0.0).replacen('{', r#"{"scale":{"x":1e300,"y":1,"z":1},"#, 1);
        assert!(pose(&format!("[{far},{far}]")).is_err());
    }

    proptest! {
        #[test]
        fn pose_round_trips(at in prop::array::uniform3(-1e3f64..1e3), q in prop::array::uniform4(-1.0f64..1.0)) {
            prop_assume!(DQuat::from_array(q).length() > 0.1);
            let sent = Pose::from_camera_in_world(at.into(), DQuat::from_array(q));
            let back = pose_of(&transform_of(&sent)).unwrap();
            prop_assert!((back.position_in_world_m() - DVec3::from(at)).length() < 1e-9);
            // The error of an angle near straight up is that of its sine: 1e-8.
            prop_assert!(back.rotation.dot(sent.rotation).abs() > 1.0 - 1e-14, "{:?} {:?}", sent, back);
        }
    }
}
