//! Composites one frame of your own into a texture of your own device.
//!
//! `cargo run --example frame_into_texture`, from the repository's root.

use std::path::Path;

use glam::{DQuat, DVec3};
use locard::camera::{Camera, Geometry};
use locard::compositor::{Compositor, Job, Settings, Target};
use locard::frame::Frame;
use locard::gpu::Gpu;
use locard::pixels::Pixels;
use locard::pose::Pose;
use locard::scene;
use locard::tracking::PoseTrack;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Your device, with the features and limits that the compositor needs.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&Gpu::device_descriptor(&adapter)))?;
    let gpu = Gpu::from_device(&adapter, device.clone(), queue);
    let mut compositor = Compositor::new(gpu.clone(), scene::load(Path::new("scenes/marker-1.glb"), None)?);

    // A grey picture, by a camera 0.6 m in front of the marker that moves by 1 cm in 1/30 s.
    let geometry = Geometry::pinhole(640, 480, 600.0);
    let camera = Camera { geometry: Some(geometry.clone()), ..Camera::default() };
    let pose = |x_m: f64| {
        Pose::from_camera_in_world(DVec3::new(x_m, -0.05, 0.6), DQuat::from_rotation_x(std::f64::consts::PI))
    };
    let track = PoseTrack::new(vec![(0.0, pose(-0.01)), (1.0 / 30.0, pose(0.0)), (2.0 / 30.0, pose(0.01))], 0.1)?;
    let pixels = Pixels::from_u8(640, 480, vec![120; 3 * 640 * 480]).ok_or("the size does not fit")?;
    let frame = Frame::new(0, 1.0 / 30.0, pixels);

    let format = wgpu::TextureFormat::Rgba8Unorm;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("composite"),
        size: wgpu::Extent3d { width: 640, height: 480, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());

    let settings = Settings::default();
    let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0)?;
    let pending = compositor.submit(job, &camera, &settings, Target::View(&view, format))?;
    pending.await_drawn(&gpu)?;
    println!("drawn: {:?}", pending.stats().rect_px);
    Ok(())
}
