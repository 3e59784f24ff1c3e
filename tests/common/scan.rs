//! A scan of the demonstration's site, and the demonstration without its depth.

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec2, DVec3};

use super::program;
use locard::hash::pcg3d;
use locard::pose::Pose;
use locard::shot::Shot;

/// Standard deviation of the scanner, m.
const NOISE_M: f64 = 0.002;
/// The scan's axes in the world.
pub fn world_from_scan() -> Pose {
    Pose::new(DQuat::from_euler(glam::EulerRot::ZYX, 2.0, 0.3, -0.2), DVec3::new(1.0, -2.0, 0.5))
}

/// The site as a scanner in the camera's path measures it: the depth of every `stride`th frame as
/// points with noise, in a binary PLY.
pub fn write_scan(shot: &Shot, file: &Path, stride: usize) {
    let mut points = Vec::new();
    for frame in (0..shot.recording.frame_count()).step_by(stride) {
        let (map, camera) = (shot.recording.depth_at(frame).unwrap().unwrap(), shot.geometry_at(frame).unwrap());
        let pose = shot.recording.track.at(map.timestamp_s).unwrap();
        for (n, z) in map.depth_m.iter().enumerate().filter(|(_, z)| **z > 0.0) {
            let at = DVec2::new((n as u32 % map.width) as f64 + 0.5, (n as u32 / map.width) as f64 + 0.5);
            let Some(ray) = camera.depth_ray(at) else { continue };
            let uniform = pcg3d([n as u32, frame as u32, 5]).map(|bits| f64::from(bits) / f64::from(u32::MAX) - 0.5);
            let noise_m = 2.0 * NOISE_M * uniform.iter().sum::<f64>();
            let world = pose.inverse_transform_point((f64::from(*z) + noise_m) * ray);
            points.push(world_from_scan().inverse_transform_point(world).as_vec3());
        }
    }
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n",
        points.len()
    );
    let numbers = points.iter().flat_map(|point| point.to_array()).flat_map(f32::to_le_bytes);
    std::fs::write(file, header.into_bytes().into_iter().chain(numbers).collect::<Vec<u8>>()).unwrap();
}

/// Copies the demonstration's recording without its depth.
pub fn copy_without_depth(from: &Path, to: &Path) {
    program::copied(from, to);
    let text = std::fs::read_to_string(from.join("recording.toml")).unwrap();
    let without = text.replace("[depth]\nlist = \"depth.txt\"\nscale = 250.0\n", "");
    assert_ne!(without, text);
    std::fs::write(to.join("recording.toml"), without).unwrap();
}

/// A scene with large markers behind the stool, the ball and the bucket of the demonstration.
pub fn hidden_markers(folder: &Path) -> PathBuf {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let object = |(number, [x, y], size_m): (usize, [f64; 2], f64)| {
        let model = scenes.join(format!("marker-{number}.glb"));
        format!("[[objects]]\nmodel = {model:?}\nposition_m = [{x:?}, {y:?}, 0.0]\nsize_m = {size_m:?}\n")
    };
    let objects = [(1, [0.42, -0.12], 0.3), (2, [0.62, 0.78], 0.35), (3, [0.2, 0.93], 0.3)].map(object);
    let file = folder.join("markers.toml");
    std::fs::write(&file, format!("version = 1\nup = \"z\"\n{}", objects.concat())).unwrap();
    file
}
