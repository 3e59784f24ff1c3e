//! Compares the sharpness of virtual edges with that of the footage.
//!
//! Real: edges in the recording ([`crate::analyse`]). Virtual: a slanted board of bright and dark
//! squares in front of the camera, rendered by the pipeline with the point spread only, and
//! measured in the same way.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};

use super::error::VerifyError;
use crate::analyse::{CaptureInfo, drawn_spread_px, footage_spread_px, still_frames};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::parallel::processors;
use crate::pose::Pose;
use crate::scene::{Material, Mesh, Object, Part, Scene, Vertex};
use crate::shot::Shot;

/// Distance of the board from the camera, m, its rotation about the optical axis, rad, and side of
/// its squares, px.
const BOARD_DISTANCE_M: f64 = 0.4;
const BOARD_ROTATION_RAD: f64 = 0.12;
const SQUARE_PX: f64 = 48.0;
/// Light of bright and dark squares.
const LIGHT: [f32; 2] = [0.5, 0.1];

/// σ of the recording's own edges, px, or the reason for which it is unknown.
pub fn real_px(shot: &Shot) -> Result<Result<f64, String>, VerifyError> {
    let rig = shot.camera();
    let exposure_s = |frame: &Frame| shot.exposure_time(frame).s;
    let capture = CaptureInfo { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s };
    Ok(footage_spread_px(&shot.recording, &shot.geometry_at(0)?, &capture, processors())?)
}

/// σ of rendered edges, px; `None` if no frame has a pose.
pub fn sharpness_px(shot: &Shot, compositor: &mut Compositor) -> Result<Option<f64>, VerifyError> {
    let mut shot = shot.clone();
    shot.settings.plain();
    let _ = shot.settings.switch("point_spread", true);
    let Some(n) = still_frames(&shot.recording).first().copied() else { return Ok(None) };
    let geometry = shot.geometry_at(n)?;
    let time_s = shot.recording.timestamps_s[n];
    let Ok(pose) = shot.recording.track.at(time_s) else { return Ok(None) };
    let i = &geometry.intrinsics;
    let side_m = SQUARE_PX * BOARD_DISTANCE_M / i.fx_px;
    let scene = board(&pose, side_m, (i.width_px.max(i.height_px) as f64 / SQUARE_PX).ceil() as i32);
    compositor.set_scene(scene.clone());
    shot.scene = Arc::new(scene);
    let Some(made) = shot.frames(compositor, n..n + 1, false, 1)?.next().transpose()? else { return Ok(None) };
    Ok(drawn_spread_px(&geometry, &shot.camera().response, made.pixels, processors()))
}

/// A board of squares in the camera's axes, larger than the picture.
fn board(pose: &Pose, side_m: f64, squares: i32) -> Scene {
    let turned = DQuat::from_rotation_z(BOARD_ROTATION_RAD);
    let mesh = |parity: i32, material: usize| {
        let (mut vertices, mut indices) = (Vec::new(), Vec::new());
        for (x, y) in (-squares..squares).flat_map(|y| (-squares..squares).map(move |x| (x, y))) {
            if (x + y).rem_euclid(2) != parity {
                continue;
            }
            let first = vertices.len() as u32;
            for (dx, dy) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                let at = side_m * DVec3::new(f64::from(x + dx), f64::from(y + dy), 0.0);
                let world = pose.inverse_transform_point(turned * at + BOARD_DISTANCE_M * DVec3::Z);
                vertices.push(Vertex {
                    position: world.as_vec3().to_array(),
                    normal: [0.0, 0.0, 1.0],
                    tangent: [0.0; 4],
                    uv0: [0.0; 2],
                    uv1: [0.0; 2],
                    color: [1.0; 4],
                });
            }
            indices.extend([0, 1, 2, 0, 2, 3].map(|k| first + k));
        }
        Arc::new(Mesh { vertices, indices, material })
    };
    let material = |light: f32| Material {
        name: "square".to_owned(),
        base_color: [light, light, light, 1.0],
        double_sided: true,
        unlit: true,
        ..Material::default()
    };
    let parts = (0..2).map(|mesh| Part { mesh, world_from_mesh: DAffine3::IDENTITY }).collect();
    Scene {
        meshes: vec![mesh(0, 0), mesh(1, 1)],
        materials: LIGHT.map(material).to_vec(),
        objects: vec![Object { name: "board".to_owned(), parts, ..Object::default() }],
        ..Scene::default()
    }
}
