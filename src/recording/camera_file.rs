//! A separate depth camera in `recording.toml`: a file with the table `[camera]`, and its pose.

use std::path::Path;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use toml::Value as Toml;

use super::RecordingError;
use crate::camera::{Distortion, Geometry, Intrinsics};
use crate::document;
use crate::params::{Params, Value};
use crate::pose::Pose;
use crate::text::quoted;
use crate::tracking::records;
use crate::tracking::tum::unit_quaternion;

/// Pose of a sensor in other axes.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPose {
    pub position_m: [f64; 3],
    /// x, y, z, w; of unit length.
    pub quaternion: [f64; 4],
}

impl SensorPose {
    /// Transform from the sensor's axes to the others.
    pub fn pose(&self) -> Result<Pose, String> {
        let at_m = DVec3::from_array(self.position_m);
        if !at_m.is_finite() {
            return Err("depth.colour_from_depth.position_m must be finite".to_owned());
        }
        let (turn, _) = unit_quaternion(DQuat::from_array(self.quaternion))
            .map_err(|problem| format!("depth.colour_from_depth.quaternion: {problem}"))?;
        Ok(Pose::new(turn, at_m))
    }
}

/// Required keys.
const REQUIRED_KEYS: [&str; 6] = ["width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px"];

/// The geometry in a file's table `[camera]`, with `[camera.distortion]` if there is one. Other
/// tables belong to a profile and are ignored.
pub fn read(file: &Path) -> Result<Geometry, RecordingError> {
    parse(&records::read_description(file)?).map_err(|problem| RecordingError::content(file, problem))
}

fn parse(text: &str) -> Result<Geometry, String> {
    let root: toml::Table = document::read(text).map_err(|problem| problem.to_string())?;
    let Some(Toml::Table(camera)) = root.get("camera") else { return Err("has no table [camera]".to_owned()) };
    let (mut intrinsics, mut distortion) = (Intrinsics::default(), Distortion::default());
    set(&mut intrinsics, camera)?;
    if let Some(Toml::Table(table)) = camera.get("distortion") {
        set(&mut distortion, table)?;
    }
    let missing: Vec<&str> = REQUIRED_KEYS.into_iter().filter(|key| !camera.contains_key(*key)).collect();
    if !missing.is_empty() {
        return Err(format!("the table [camera] lacks {}", missing.join(", ")));
    }
    match distortion.missing() {
        Some(name) => Err(format!("camera.distortion.{name} is not 0, but its model has no {name}")),
        None => Ok(Geometry::new(intrinsics, distortion)),
    }
}

fn set(params: &mut dyn Params, table: &toml::Table) -> Result<(), String> {
    for (key, value) in table {
        let value = match value {
            Toml::Table(_) => continue,
            Toml::Integer(i) => Value::Number(*i as f64),
            Toml::Float(f) => Value::Number(*f),
            Toml::String(s) => Value::Text(s.clone()),
            other => return Err(format!("{}.{} = {other} is not a number", params.table(), quoted(key))),
        };
        params.set(key, &value).map_err(|e| e.to_string())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: &str = "version = 1\n[camera]\nwidth_px = 256\nheight_px = 192\nfx_px = 210.5\nfy_px = 211\n\
                          cx_px = 128.5\ncy_px = 95\n[camera.distortion]\nk1 = 0.1\n[camera.lens]\nf_number = 2.0\n";

    #[test]
    fn camera_table_is_read() {
        let Geometry { intrinsics: i, distortion, .. } = parse(CAMERA).unwrap();
        assert_eq!((i.width_px, i.height_px, i.fx_px, i.fy_px), (256, 192, 210.5, 211.0));
        assert_eq!((i.cx_px, i.cy_px, distortion.k1), (128.5, 95.0, 0.1));
    }

    #[test]
    fn incomplete_camera_is_refused() {
        for (from, to, said) in [
            ("[camera]", "[kamera]", "lacks width_px, height_px"),
            ("fx_px = 210.5\n", "", "lacks fx_px"),
            ("fx_px = 210.5", "fx_px = -1.0", "fx_px"),
            ("fx_px = 210.5", "fx_px = true", "camera.fx_px = true is not a number"),
            ("cx_px", "cxpx", "cxpx"),
            ("[camera.distortion]\nk1", "[camera.distortion]\nmodel = \"opencv_fisheye\"\np1", "its model has no p1"),
        ] {
            let error = parse(&CAMERA.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn file_without_a_camera_is_refused() {
        assert_eq!(parse("version = 1\n").unwrap_err(), "has no table [camera]");
    }

    #[test]
    fn sensor_pose_transforms_points() {
        // 0.1 m to the right, rotated by 90° about z: its x is the others' y.
        let half = 0.5f64.sqrt();
        let placed = SensorPose { position_m: [0.1, 0.0, 0.0], quaternion: [0.0, 0.0, half, half] }.pose().unwrap();
        assert!((placed.transform_point(DVec3::new(2.0, 0.0, 1.0)) - DVec3::new(0.1, 2.0, 1.0)).length() < 1e-12);
        for (position_m, quaternion) in [([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), ([0.0; 3], [0.0; 4])] {
            assert!(SensorPose { position_m, quaternion }.pose().is_err());
        }
    }
}
