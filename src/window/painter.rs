//! Repaints only the damaged areas of the window. During playback the panels beside the picture do
//! not change; with a software driver their text costs more than the picture. A repaint without a
//! new picture takes 12 ms of processor time instead of 29, a picture during playback a fifth to a
//! quarter less (docs/performance.md).
//!
//! The window is retained in a texture. The shapes of a frame are compared with those of the last
//! one, the shapes that overlap a damaged area are drawn there, and the texture is copied to the
//! screen. The result is bit-identical to a full repaint.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use eframe::CreationContext;
use eframe::egui::epaint::{ClippedShape, Shape};
use eframe::egui::mutex::RwLock;
use eframe::egui::{Context, CornerRadius, FullOutput, PaintCallbackInfo, Rect, TextureId, TexturesDelta, pos2};
use eframe::egui_wgpu::{
    Callback, CallbackResources, CallbackTrait, RenderState, Renderer, RendererOptions, ScreenDescriptor,
};

use super::canvas::fullscreen;
use super::damage::{Damage, add_damage, extent};
use locard_engine::gpu::Shader;

/// Takes over the painting of a new window. It must be installed before egui's first frame, which
/// uploads the font texture.
pub fn take_over(context: &CreationContext<'_>) -> Result<RenderState, String> {
    let window = context.wgpu_render_state.as_ref().ok_or("the window has no device that Locard can draw with")?;
    Ok(install(&context.egui_ctx, window))
}

/// Textures and callbacks belong to the renderer of the returned state.
fn install(ctx: &Context, window: &RenderState) -> RenderState {
    let retained = RetainedWindow::new(window);
    let window = retained.window.clone();
    ctx.add_plugin(Painter(Arc::new(Mutex::new(retained))));
    window
}

/// Replaces all shapes by one paint callback.
struct Painter(Arc<Mutex<RetainedWindow>>);

impl eframe::egui::Plugin for Painter {
    fn debug_name(&self) -> &'static str {
        "painter"
    }

    fn output_hook(&mut self, ctx: &Context, output: &mut FullOutput) {
        let screen = ctx.viewport_rect();
        let background = ctx.global_style().visuals.panel_fill;
        let background = Shape::rect_filled(screen.expand(1.0), CornerRadius::ZERO, background.to_opaque());
        let background = ClippedShape::new(Rect::EVERYTHING, background);
        let mut shapes = vec![background];
        shapes.append(&mut output.shapes);
        let mut retained = lock(&self.0);
        retained.textures.append(std::mem::take(&mut output.textures_delta));
        retained.next_shapes = Some(shapes);
        let painting = PaintCallback { ctx: ctx.clone(), retained: Arc::clone(&self.0) };
        let shape = Shape::Callback(Callback::new_paint_callback(screen, painting));
        output.shapes = vec![ClippedShape::new(Rect::EVERYTHING, shape)];
    }
}

/// The callback that paints a frame of the window.
struct PaintCallback {
    ctx: Context,
    retained: Arc<Mutex<RetainedWindow>>,
}

impl CallbackTrait for PaintCallback {
    fn prepare(
        &self,
        _: &wgpu::Device,
        _: &wgpu::Queue,
        screen: &ScreenDescriptor,
        _: &mut wgpu::CommandEncoder,
        _: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        lock(&self.retained).paint(&self.ctx, screen);
        Vec::new()
    }

    fn paint(&self, info: PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, _: &CallbackResources) {
        let retained = lock(&self.retained);
        let Some(texture) = &retained.texture else { return };
        let [width, height] = info.screen_size_px;
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        pass.set_pipeline(&retained.copy_pipeline);
        pass.set_bind_group(0, &texture.bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// The last painted frame of the window.
struct RetainedWindow {
    window: RenderState,
    copy_pipeline: wgpu::RenderPipeline,
    texture: Option<WindowTexture>,
    pixels_per_point: f32,
    shapes: Vec<ClippedShape>,
    /// Shapes to paint next.
    next_shapes: Option<Vec<ClippedShape>>,
    textures: TexturesDelta,
}

struct WindowTexture {
    size: [u32; 2],
    view: wgpu::TextureView,
    bind_group: wgpu::BindGroup,
}

impl RetainedWindow {
    fn new(window: &RenderState) -> Self {
        let device = &window.device;
        // Dithering would change the picture's code values.
        let options = RendererOptions { dithering: false, ..Default::default() };
        let renderer = Renderer::new(device, window.target_format, options);
        let copy_pipeline = fullscreen(window, Shader::Copy, "main");
        let textures = TexturesDelta::default();
        let window = RenderState { renderer: Arc::new(RwLock::new(renderer)), ..window.clone() };
        Self {
            window,
            copy_pipeline,
            texture: None,
            pixels_per_point: 0.0,
            shapes: Vec::new(),
            next_shapes: None,
            textures,
        }
    }

    /// Paints the damaged areas and returns them, points.
    fn paint(&mut self, ctx: &Context, screen: &ScreenDescriptor) -> Vec<Rect> {
        let ppp = screen.pixels_per_point;
        let [width, height] = screen.size_in_pixels;
        let shapes = self.next_shapes.take().unwrap_or_else(|| self.shapes.clone());
        let mut textures = std::mem::take(&mut self.textures);
        // Glyphs keep their places in the font texture until it is replaced.
        let has_new_font = |textures: &TexturesDelta| {
            textures.set.get(&TextureId::default()).is_some_and(|set| set.iter().any(|delta| delta.is_whole()))
        };
        let fits = self.texture.as_ref().is_some_and(|texture| texture.size == screen.size_in_pixels);
        let full_repaint = !fits || self.pixels_per_point != ppp || has_new_font(&textures);
        let all = Rect::from_min_max(pos2(0.0, 0.0), pos2(width as f32 / ppp, height as f32 / ppp));
        let mut areas = Damage::new(all, ppp);
        if full_repaint {
            areas.add(all);
        } else {
            // The content of user textures may have changed.
            let has_new_texels = |id: TextureId| match id {
                TextureId::Managed(_) => id != TextureId::default() && textures.set.contains_key(&id),
                TextureId::User(_) => true,
            };
            add_damage(&self.shapes, &shapes, has_new_texels, &mut areas);
        }
        let mut renderer = self.window.renderer.write();
        let (device, queue) = (&self.window.device, &self.window.queue);
        for (id, deltas) in textures.set.drain() {
            deltas.iter().for_each(|delta| renderer.update_texture(device, queue, id, delta));
        }
        let areas = areas.merged();
        if !areas.is_empty() {
            let texture = match self.texture.take().filter(|_| fits) {
                Some(texture) => texture,
                None => WindowTexture::new(&self.window, &self.copy_pipeline, screen.size_in_pixels),
            };
            let jobs = ctx.tessellate(clip_to_areas(&shapes, &areas, ppp), ppp);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("window") });
            let before = renderer.update_buffers(device, queue, &mut encoder, &jobs, screen);
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("window"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &texture.view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
                })],
                ..Default::default()
            });
            renderer.render(&mut pass.forget_lifetime(), &jobs, screen);
            queue.submit(before.into_iter().chain([encoder.finish()]));
            self.texture = Some(texture);
        }
        // Debug builds panic if an unhandled delta is dropped.
        textures.free.drain().for_each(|id| renderer.free_texture(&id));
        (self.shapes, self.pixels_per_point) = (shapes, ppp);
        areas
    }
}

impl Drop for RetainedWindow {
    /// A window may close before it has painted its last output.
    fn drop(&mut self) {
        self.textures.clear();
    }
}

/// Clips shapes to the areas. Shapes below a callback's area are left out, because all callbacks
/// are opaque.
fn clip_to_areas(shapes: &[ClippedShape], areas: &[Rect], ppp: f32) -> Vec<ClippedShape> {
    let extents: Vec<Rect> = shapes.iter().map(extent).collect();
    let covers: Vec<(usize, Rect)> =
        shapes.iter().enumerate().filter_map(|(n, of)| Some((n, covered_pixels(of, ppp)?))).collect();
    let mut parts = areas.to_vec();
    for (_, cover) in &covers {
        parts = parts.iter().flat_map(|part| split(*part, *cover)).collect();
    }
    let mut out = Vec::new();
    for part in parts {
        let lowest = covers.iter().rfind(|(_, cover)| cover.contains_rect(part)).map_or(0, |(n, _)| *n);
        for (shape, extent) in shapes.iter().zip(&extents).skip(lowest) {
            if extent.intersect(part).is_positive() {
                out.push(ClippedShape { clip_rect: shape.clip_rect.intersect(part), ..shape.clone() });
            }
        }
    }
    out
}

/// The whole pixels that a callback covers.
fn covered_pixels(shape: &ClippedShape, ppp: f32) -> Option<Rect> {
    let Shape::Callback(callback) = &shape.shape else { return None };
    let rect = callback.rect.intersect(shape.clip_rect);
    let (min, max) = ((rect.min.to_vec2() * ppp).ceil() / ppp, (rect.max.to_vec2() * ppp).floor() / ppp);
    Some(Rect::from_min_max(min.to_pos2(), max.to_pos2())).filter(Rect::is_positive)
}

/// Splits a rectangle into its part inside of another one and the parts outside.
fn split(rect: Rect, by: Rect) -> Vec<Rect> {
    let inside = rect.intersect(by);
    if !inside.is_positive() {
        return vec![rect];
    }
    let parts = [
        inside,
        Rect { max: pos2(rect.max.x, inside.min.y), ..rect },
        Rect { min: pos2(rect.min.x, inside.max.y), ..rect },
        Rect::from_min_max(pos2(rect.min.x, inside.min.y), pos2(inside.min.x, inside.max.y)),
        Rect::from_min_max(pos2(inside.max.x, inside.min.y), pos2(rect.max.x, inside.max.y)),
    ];
    parts.into_iter().filter(Rect::is_positive).collect()
}

impl WindowTexture {
    fn new(window: &RenderState, copy_pipeline: &wgpu::RenderPipeline, size: [u32; 2]) -> Self {
        let texture = window.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("window"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: window.target_format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        let bind_group = window.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("window"),
            layout: &copy_pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) }],
        });
        Self { size, view, bind_group }
    }
}

/// A panic in a painting has been reported.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A device without a screen, for tests.
#[cfg(test)]
pub fn device_without_a_screen() -> RenderState {
    use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
    use locard_engine::gpu::Gpu;

    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
    setup.device_descriptor = Arc::new(Gpu::device_descriptor);
    let configuration = WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..Default::default() };
    let state = pollster::block_on(async {
        let instance = configuration.wgpu_setup.new_instance().await;
        RenderState::create(&configuration, &instance, None, RendererOptions::default()).await
    });
    state.expect("an adapter")
}

#[cfg(test)]
mod tests {
    use eframe::egui::{self, Color32, Pos2, RawInput, Slider, vec2};

    use super::*;
    use locard_engine::gpu::{Gpu, read_back};

    /// A window with typical content: text, rounded controls, overlapping shapes and windows, a
    /// texture.
    fn ui(ui: &mut egui::Ui, step: u32, texture: &mut Option<egui::TextureHandle>) {
        egui::Panel::left("left").show(ui, |ui| {
            (0..12).for_each(|n| drop(ui.label(format!("a line that stands still, {n}"))));
        });
        let lines = if step == 5 { 3 } else { 8 };
        for n in 0..lines {
            let mut value = if n == 2 { f64::from(step / 2) } else { f64::from(n) };
            ui.add(Slider::new(&mut value, 0.0..=10.0).text(format!("value {n}")));
        }
        let at = 40.0 + 17.3 * step as f32;
        let painter = ui.painter();
        painter.circle_filled(pos2(at, 150.0), 21.0, Color32::from_rgba_unmultiplied(200, 40, 20, 120));
        painter.line_segment([pos2(at, 150.0), pos2(at + 30.0, 190.0)], (1.5, Color32::WHITE));
        if step >= 7 {
            let texels = egui::ColorImage::filled([4, 4], Color32::from_gray(40 * (step / 3) as u8));
            let options = Default::default();
            let texture = texture.get_or_insert_with(|| ui.ctx().load_texture("picture", texels.clone(), options));
            texture.set(texels, options);
            painter.image(
                texture.id(),
                Rect::from_min_size(pos2(330.0, 20.0), vec2(40.0, 40.0)),
                Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)),
                Color32::WHITE,
            );
        }
        egui::Window::new("In front").open(&mut (3..=9).contains(&step)).show(ui.ctx(), |ui| drop(ui.label("Öffnen…")));
    }

    #[test]
    fn area_is_split_at_the_edges_of_a_cover() {
        let rect = |x0: f32, y0: f32, x1: f32, y1: f32| Rect::from_min_max(pos2(x0, y0), pos2(x1, y1));
        let cover = rect(10.0, 10.0, 50.0, 40.0);
        assert_eq!(split(rect(60.0, 0.0, 70.0, 90.0), cover), [rect(60.0, 0.0, 70.0, 90.0)]);
        assert_eq!(split(rect(20.0, 20.0, 30.0, 30.0), cover), [rect(20.0, 20.0, 30.0, 30.0)]);
        let parts = split(rect(0.0, 20.0, 20.0, 60.0), cover);
        assert_eq!(parts, [rect(10.0, 20.0, 20.0, 40.0), rect(0.0, 40.0, 20.0, 60.0), rect(0.0, 20.0, 10.0, 40.0)]);
        let all = split(rect(0.0, 0.0, 100.0, 100.0), cover);
        assert_eq!(all.len(), 5);
        assert_eq!(all.iter().map(Rect::area).sum::<f32>(), 1e4);
    }

    #[test]
    fn partial_repaint_equals_a_full_repaint() {
        let window = device_without_a_screen();
        let gpu = Gpu::from_device(&window.adapter, window.device.clone(), window.queue.clone());
        let ctx = Context::default();
        let retained = Arc::new(Mutex::new(RetainedWindow::new(&window)));
        ctx.add_plugin(Painter(Arc::clone(&retained)));
        let mut texture = None;
        let mut parts = Vec::new();
        for step in 0..14 {
            let (pixels_per_point, height) = (if step < 12 { 1.0 } else { 1.5 }, if step < 10 { 220 } else { 240 });
            let screen = ScreenDescriptor { size_in_pixels: [400, height], pixels_per_point };
            let size = vec2(400.0, height as f32) / pixels_per_point;
            let mut input = RawInput { screen_rect: Some(Rect::from_min_size(Pos2::ZERO, size)), ..Default::default() };
            input.viewports.entry(input.viewport_id).or_default().native_pixels_per_point = Some(pixels_per_point);
            let output = ctx.run_ui(input, |root| ui(root, step, &mut texture));
            assert_eq!(output.shapes.len(), 1, "one callback stands for all");
            assert_eq!(output.pixels_per_point, pixels_per_point);
            let mut retained = lock(&retained);
            let mut paint = || {
                let areas = retained.paint(&ctx, &screen);
                let texture = retained.texture.as_ref().expect("a picture").view.texture().clone();
                (areas, texture)
            };
            let (areas, texture) = paint();
            parts.push(areas.iter().map(Rect::area).sum::<f32>() / size.x / size.y);
            let in_part = read_back(&gpu, &texture).expect("texels");
            assert_eq!(paint().0, [], "nothing is new");
            retained.texture = None;
            let full_repaint = retained.paint(&ctx, &screen);
            assert_eq!(full_repaint.len(), 1);
            let texture = retained.texture.as_ref().expect("a picture").view.texture();
            assert!(read_back(&gpu, texture).expect("texels") == in_part, "step {step} differs");
        }
        // The first step, another height and another scale repaint everything; the others move a
        // circle, a line, a number.
        for full_repaint in [0, 10, 12] {
            assert_eq!(parts[full_repaint], 1.0, "{parts:?}");
        }
        assert!(parts[2..5].iter().all(|part| (0.05..0.6).contains(part)), "{parts:?}");
    }
}
