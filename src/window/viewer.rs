//! Pictures on the window's own device: the composite goes into a texture that the window shows, and never through the
//! processor.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;

use super::Project;
use crate::compositor::{Compositor, FrameStats, Target};
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError};
use crate::pixels::{Codes, Pixels};
use crate::shot::ShotError;

/// Holds code values, which is what the window takes a texture's texels for.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// A picture that the window can show.
pub struct Shown {
    pub texture: wgpu::Texture,
    view: wgpu::TextureView,
    pub size: (u32, u32),
    /// Read between texels, for pictures that are made smaller.
    pub smooth: TextureId,
    /// Texel for texel.
    pub nearest: TextureId,
}

/// Composites frames for the window.
pub struct Viewer {
    gpu: Gpu,
    window: RenderState,
    compositor: Compositor,
    scene_version: u64,
    /// The camera's picture, and the same with everything virtual.
    plain: Option<Shown>,
    composite: Option<Shown>,
    busy: Arc<AtomicBool>,
}

impl Viewer {
    pub fn new(window: RenderState, project: &Project) -> Self {
        let gpu = Gpu::adopt(&window.adapter, window.device.clone(), window.queue.clone());
        let compositor = project.shot().compositor(gpu.clone());
        let scene_version = project.scene_version();
        Self { gpu, window, compositor, scene_version, plain: None, composite: None, busy: Arc::default() }
    }

    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Whether a picture is still being made. One that is begun meanwhile would only wait for it.
    pub fn is_busy(&self) -> bool {
        // Callbacks are called here alone where nothing else is drawn.
        let _ = self.gpu.poll();
        self.busy.load(Ordering::Acquire)
    }

    pub fn plain(&self) -> Option<&Shown> {
        self.plain.as_ref()
    }

    pub fn composite(&self) -> Option<&Shown> {
        self.composite.as_ref()
    }

    /// Shows a frame as it came.
    pub fn show_plain(&mut self, frame: &Frame) {
        let size = (frame.pixels.width, frame.pixels.height);
        let plain = shown(&self.window, self.plain.take(), size);
        let texels = rgba(&frame.pixels);
        self.window.queue.write_texture(
            plain.texture.as_image_copy(),
            &texels,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.0), rows_per_image: None },
            wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
        );
        self.plain = Some(plain);
    }

    /// Begins a frame's composite as all is set now. `done` is called, from wherever, when it can be seen.
    pub fn show(
        &mut self,
        project: &Project,
        frame: &Frame,
        done: impl FnOnce() + Send + 'static,
    ) -> Result<FrameStats, ShotError> {
        let shot = project.shot();
        if self.scene_version != project.scene_version() {
            self.compositor.set_scene(shot.scene.clone());
            self.scene_version = project.scene_version();
        }
        let composite = shown(&self.window, self.composite.take(), (frame.pixels.width, frame.pixels.height));
        let target = Target::View(&composite.view, FORMAT);
        let geometry = shot.geometry_at(frame.index);
        let pending =
            geometry.and_then(|geometry| shot.submit(&mut self.compositor, frame.clone(), &geometry, target, false));
        self.composite = Some(composite);
        let of_frame = |source: GpuError| ShotError::Gpu { frame: frame.index, source };
        let stats = self.compositor.collect(pending?).map_err(of_frame)?.stats;
        self.gpu.check().map_err(of_frame)?;
        self.busy.store(true, Ordering::Release);
        let busy = Arc::clone(&self.busy);
        self.gpu.queue.on_submitted_work_done(move || {
            busy.store(false, Ordering::Release);
            done();
        });
        Ok(stats)
    }
}

/// A picture of that size: the one that was there where it fits.
fn shown(window: &RenderState, before: Option<Shown>, size: (u32, u32)) -> Shown {
    let mut renderer = window.renderer.write();
    if let Some(before) = before {
        if before.size == size {
            return before;
        }
        renderer.free_texture(&before.smooth);
        renderer.free_texture(&before.nearest);
    }
    let texture = window.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shown"),
        size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let view = texture.create_view(&Default::default());
    let mut register = |mag_filter, min_filter| {
        let sampler = wgpu::SamplerDescriptor { label: Some("shown"), mag_filter, min_filter, ..Default::default() };
        renderer.register_native_texture_with_sampler_options(&window.device, &view, sampler)
    };
    let smooth = register(wgpu::FilterMode::Linear, wgpu::FilterMode::Linear);
    let nearest = register(wgpu::FilterMode::Nearest, wgpu::FilterMode::Nearest);
    Shown { texture, view, size, smooth, nearest }
}

/// 8-bit codes with an opaque A; 16 bits are rounded.
fn rgba(pixels: &Pixels) -> Vec<u8> {
    let mut out = Vec::with_capacity(4 * pixels.width as usize * pixels.height as usize);
    match &pixels.codes {
        Codes::U8(codes) => codes.chunks_exact(3).for_each(|c| out.extend([c[0], c[1], c[2], 255])),
        Codes::U16(codes) => {
            let eight = |code: u16| ((u32::from(code) + 128) / 257) as u8;
            codes.chunks_exact(3).for_each(|c| out.extend([eight(c[0]), eight(c[1]), eight(c[2]), 255]));
        }
    }
    out
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Viewer")
    }
}
