//! Composites one frame of your own into a texture of your own device.
//!
//! `cargo run --example frame_into_texture`, from the repository's root.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use locard::camera::{Camera, Geometry};
use locard::compositor::{Compositor, Job, Settings, Target};
use locard::{frame::Frame, gpu::Gpu, pixels::Pixels, pose::Pose, scene, tracking::PoseTrack};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Your device, with the features and limits that the compositor needs.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Gpu::device_descriptor(&adapter)))?;
    let gpu = Gpu::from_device(&adapter, device, queue);
    let mut compositor = Compositor::new(gpu.clone(), scene::load("scenes/marker-1.glb".as_ref(), None)?);

    // A grey picture, by a camera at rest 0.6 m in front of the marker.
    let geometry = Geometry::pinhole(640, 480, 600.0);
    let camera = Camera { geometry: Some(geometry.clone()), ..Camera::default() };
    let track = PoseTrack::at_rest(Pose::from_camera_in_world(DVec3::new(0.0, -0.05, 0.6), DQuat::from_rotation_x(PI)));
    let frame = Frame::new(0, 0.0, Pixels::from_u8(640, 480, vec![120; 3 * 640 * 480]).ok_or("a size that differs")?);

    let texture = gpu.render_target((640, 480), wgpu::TextureFormat::Rgba8Unorm);
    let view = texture.create_view(&Default::default());
    let settings = Settings::default();
    let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0)?;
    compositor.submit(job, &camera, &settings, Target::View(&view, texture.format()))?.await_drawn(&gpu)?;
    println!("drawn into a texture of {}x{} px", texture.width(), texture.height());
    Ok(())
}
