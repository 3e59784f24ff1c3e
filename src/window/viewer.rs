//! Display textures on the window's device: composites are rendered into them and shown without a
//! transfer to the CPU.

use std::collections::VecDeque;
use std::sync::Arc;

use eframe::egui::TextureId;
use eframe::egui_wgpu::RenderState;

use super::canvas;
use super::frame_renderer::{FORMAT, FrameRenderer, RenderKey, RenderOutputs, RenderRequest, RenderResult};
use locard_engine::frame::{Frame, FrameIdentity};
use locard_engine::gpu::Gpu;
use locard_engine::pixels::{Codes, Pixels, eight_bits};
use locard_engine::shot::Shot;

/// A texture that the window can display.
#[derive(Debug)]
pub struct DisplayTexture {
    /// Smaller than the picture if it was composited at a reduced size.
    pub texture: wgpu::Texture,
    /// Size of the picture, px.
    pub size: (u32, u32),
    /// Texture for egui's shapes, sampled with the nearest texel.
    pub texels: TextureId,
}

/// Composites frames for the window.
pub struct Viewer {
    gpu: Gpu,
    window: RenderState,
    renderer: FrameRenderer,
    /// The displayed composite.
    shown: Option<DisplayTexture>,
    /// The displayed composite of the other setting in a comparison.
    other: Option<DisplayTexture>,
    /// Textures that are being rendered, in order.
    pending: VecDeque<DisplayTexture>,
    /// Textures for reuse.
    free: Vec<DisplayTexture>,
    /// The camera's own picture of a frame. No memo: the next frame's picture is written into the
    /// same texture.
    camera: Option<(FrameIdentity, DisplayTexture)>,
}

impl Viewer {
    /// `wake` is called from a thread whenever a composite is finished.
    pub fn new(window: RenderState, wake: impl Fn() + Clone + Send + 'static) -> std::io::Result<Self> {
        let gpu = Gpu::from_device(&window.adapter, window.device.clone(), window.queue.clone());
        canvas::prepare(&window);
        let renderer = FrameRenderer::new(&gpu, wake)?;
        Ok(Self {
            gpu,
            window,
            renderer,
            shown: None,
            other: None,
            pending: VecDeque::new(),
            free: Vec::new(),
            camera: None,
        })
    }

    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    pub fn window(&self) -> &RenderState {
        &self.window
    }

    /// Number of composites in progress.
    pub fn in_flight(&self) -> usize {
        self.renderer.in_flight()
    }

    /// The last finished composite; `None` if it failed.
    pub fn composite(&self) -> Option<&DisplayTexture> {
        self.shown.as_ref()
    }

    /// The last finished composite of the other setting in a comparison.
    pub fn comparison(&self) -> Option<&DisplayTexture> {
        self.other.as_ref()
    }

    /// The last uploaded picture of the camera.
    pub fn camera(&self) -> Option<&DisplayTexture> {
        self.camera.as_ref().map(|(_, texture)| texture)
    }

    /// The camera's own picture of a frame.
    pub fn camera_picture(&mut self, frame: &Frame) -> &DisplayTexture {
        let size = (frame.pixels.width, frame.pixels.height);
        let (latest, texture) = self.camera.take().unzip();
        let picture = reuse_or_create(&self.window, texture, size, 1);
        let identity = frame.identity();
        if latest.as_ref() != Some(&identity) {
            self.window.queue.write_texture(
                picture.texture.as_image_copy(),
                &rgba(&frame.pixels),
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size.0), rows_per_image: None },
                wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
            );
        }
        &self.camera.insert((identity, picture)).1
    }

    /// Starts the composite of a frame with the settings of the shot; `live_frame`: a live frame.
    pub fn begin(&mut self, key: RenderKey, shot: Shot, live_frame: Option<Arc<Frame>>, outputs: RenderOutputs) {
        let size = (shot.recording.width, shot.recording.height);
        let picture = reuse_or_create(&self.window, self.free.pop(), size, key.reduction);
        let texture = picture.texture.clone();
        self.pending.push_back(picture);
        self.renderer.make(RenderRequest { key, shot, live_frame, texture, outputs });
    }

    /// Takes the next finished composite and displays it; `Err` if the worker has ended.
    pub fn take(&mut self) -> Result<Option<RenderResult>, String> {
        let finished = self.renderer.take()?;
        if let Some(finished) = &finished {
            let finished_texture = self.pending.pop_front();
            let place = if finished.key.is_variant { &mut self.other } else { &mut self.shown };
            let (now, failed) =
                if finished.picture.is_ok() { (finished_texture, None) } else { (None, finished_texture) };
            self.free.extend(std::mem::replace(place, now).into_iter().chain(failed));
        }
        Ok(finished)
    }
}

impl Drop for Viewer {
    /// Unregisters its textures from the window.
    fn drop(&mut self) {
        let camera = self.camera.take().map(|(_, texture)| texture);
        let all = self
            .free
            .drain(..)
            .chain(self.pending.drain(..))
            .chain(self.shown.take())
            .chain(self.other.take())
            .chain(camera);
        all.for_each(|picture| free(&self.window, &picture));
    }
}

fn free(window: &RenderState, picture: &DisplayTexture) {
    window.renderer.write().free_texture(&picture.texels);
}

/// A texture for a picture of that size, reduced by a factor; reuses the previous one if it fits.
fn reuse_or_create(
    window: &RenderState,
    before: Option<DisplayTexture>,
    size: (u32, u32),
    reduction: u32,
) -> DisplayTexture {
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
    DisplayTexture { texture, size, texels }
}

/// 8-bit code values with an opaque alpha; 16-bit values are rounded.
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

#[cfg(test)]
mod tests {
    use super::super::painter::device_without_a_screen;
    use super::*;
    use locard_engine::gpu::read_back;

    #[test]
    fn camera_pictures_of_frames_with_the_same_number_differ() {
        let mut viewer = Viewer::new(device_without_a_screen(), || ()).unwrap();
        for code in [10, 200] {
            let pixels = Pixels { width: 8, height: 4, codes: Codes::U8(vec![code; 3 * 8 * 4]), coding: None };
            let texture = viewer.camera_picture(&Frame::new(3, 0.0, pixels)).texture.clone();
            assert_eq!(read_back(viewer.gpu(), &texture).unwrap()[..4], [code, code, code, 255]);
        }
    }
}
