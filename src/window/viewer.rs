//! Textures of the window's own device: composites go into them and are shown from there, never through the processor.

use std::collections::VecDeque;
use std::sync::Arc;

use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;

use super::canvas;
use super::frame_renderer::{FORMAT, FrameRenderer, RenderKey, RenderOutputs, RenderRequest, RenderResult};
use locard_engine::frame::Frame;
use locard_engine::gpu::Gpu;
use locard_engine::pixels::{Codes, Pixels, eight_bits};
use locard_engine::shot::Shot;

/// A picture that the window can show.
#[derive(Debug)]
pub struct Shown {
    /// Smaller than the picture where it was made at a fraction of its size.
    pub texture: wgpu::Texture,
    /// Of the picture, px.
    pub size: (u32, u32),
    /// For the window's own shapes, texel for texel.
    pub texels: TextureId,
}

/// Composites frames for the window.
pub struct Viewer {
    gpu: Gpu,
    window: RenderState,
    renderer: FrameRenderer,
    /// One picture is shown while others are drawn, in order; the rest is free.
    shown: Option<Shown>,
    /// The picture that it is compared with.
    other: Option<Shown>,
    drawn: VecDeque<Shown>,
    free: Vec<Shown>,
    /// A camera's own picture, with its frame.
    plain: Option<(usize, Shown)>,
}

impl Viewer {
    /// `wake` is called from a thread whenever a picture is finished.
    pub fn new(window: RenderState, wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let gpu = Gpu::adopt(&window.adapter, window.device.clone(), window.queue.clone());
        canvas::prepare(&window);
        let renderer = FrameRenderer::new(&gpu, wake)?;
        Ok(Self {
            gpu,
            window,
            renderer,
            shown: None,
            other: None,
            drawn: VecDeque::new(),
            free: Vec::new(),
            plain: None,
        })
    }

    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    pub fn window(&self) -> &RenderState {
        &self.window
    }

    /// How many pictures are not finished.
    pub fn in_flight(&self) -> usize {
        self.renderer.in_flight()
    }

    /// The composite that was finished last; `None` where it failed.
    pub fn composite(&self) -> Option<&Shown> {
        self.shown.as_ref()
    }

    /// The picture that it is compared with.
    pub fn other(&self) -> Option<&Shown> {
        self.other.as_ref()
    }

    /// The camera's own picture that was needed last.
    pub fn camera(&self) -> Option<&Shown> {
        self.plain.as_ref().map(|(_, plain)| plain)
    }

    /// A frame as it came.
    pub fn plain(&mut self, frame: &Frame) -> &Shown {
        let size = (frame.pixels.width, frame.pixels.height);
        let is_there = self.plain.as_ref().is_some_and(|(index, _)| *index == frame.index);
        let plain = fitting(&self.window, self.plain.take().map(|(_, plain)| plain), size, 1);
        if !is_there {
            self.window.queue.write_texture(
                plain.texture.as_image_copy(),
                &rgba(&frame.pixels),
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.0), rows_per_image: None },
                wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            );
        }
        &self.plain.insert((frame.index, plain)).1
    }

    /// Begins a frame's composite as all is set in the shot; `live_frame` is a camera's frame.
    pub fn begin(&mut self, key: RenderKey, shot: Shot, live_frame: Option<Arc<Frame>>, outputs: RenderOutputs) {
        let size = (shot.recording.width, shot.recording.height);
        let picture = fitting(&self.window, self.free.pop(), size, key.reduction);
        let texture = picture.texture.clone();
        self.drawn.push_back(picture);
        self.renderer.make(RenderRequest { key, shot, live_frame, texture, outputs });
    }

    /// The next picture that is finished, which is shown from now on; `Err` where nothing more will come.
    pub fn take(&mut self) -> Result<Option<RenderResult>, ()> {
        let finished = self.renderer.take()?;
        if let Some(finished) = &finished {
            let drawn = self.drawn.pop_front();
            let place = if finished.key.is_variant { &mut self.other } else { &mut self.shown };
            let (now, failed) = if finished.picture.is_ok() { (drawn, None) } else { (None, drawn) };
            self.free.extend(std::mem::replace(place, now).into_iter().chain(failed));
        }
        Ok(finished)
    }
}

impl Drop for Viewer {
    /// Gives its textures back to the window.
    fn drop(&mut self) {
        let plain = self.plain.take().map(|(_, plain)| plain);
        let all = self
            .free
            .drain(..)
            .chain(self.drawn.drain(..))
            .chain(self.shown.take())
            .chain(self.other.take())
            .chain(plain);
        all.for_each(|picture| free(&self.window, &picture));
    }
}

fn free(window: &RenderState, picture: &Shown) {
    window.renderer.write().free_texture(&picture.texels);
}

/// A picture of that size, its texture smaller by a factor: the one that was there where it fits.
fn fitting(window: &RenderState, before: Option<Shown>, size: (u32, u32), reduction: u32) -> Shown {
    let (width, height) = ((size.0 / reduction).max(1), (size.1 / reduction).max(1));
    if let Some(before) = before {
        if before.size == size && (before.texture.width(), before.texture.height()) == (width, height) {
            return before;
        }
        free(window, &before);
    }
    let texture = window.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shown"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
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
    let sampler = wgpu::SamplerDescriptor { label: Some("shown"), ..Default::default() };
    let mut renderer = window.renderer.write();
    let texels = renderer.register_native_texture_with_sampler_options(&window.device, &view, sampler);
    Shown { texture, size, texels }
}

/// 8-bit codes with an opaque A; 16 bits are rounded.
fn rgba(pixels: &Pixels) -> Vec<u8> {
    let mut out = Vec::with_capacity(4 * pixels.width as usize * pixels.height as usize);
    match &pixels.codes {
        Codes::U8(codes) => codes.chunks_exact(3).for_each(|c| out.extend([c[0], c[1], c[2], 255])),
        Codes::U16(codes) => {
            let eight = |c: &[u16]| [eight_bits(c[0]), eight_bits(c[1]), eight_bits(c[2]), 255];
            codes.chunks_exact(3).for_each(|c| out.extend(eight(c)));
        }
    }
    out
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Viewer")
    }
}
