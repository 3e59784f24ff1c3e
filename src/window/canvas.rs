//! Draws the picture into the window by a shader of ours. The window's own shader does so much for each pixel that, on a
//! software driver, a picture costs more to show than to composite.

use eframe::egui::{Color32, PaintCallback, PaintCallbackInfo, Rect, Vec2};
use eframe::egui_wgpu::{Callback, CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use wgpu::util::DeviceExt;

use super::placed::Placed;
use crate::gpu::Shader;

/// A picture on a plain ground.
#[derive(Debug)]
pub struct Canvas {
    pub placed: Placed,
    /// Of the pictures, px; their textures may be smaller.
    pub size: Vec2,
    /// Left of it the first picture is shown, points.
    pub line_x: f32,
    pub pictures: [wgpu::Texture; 2],
    pub ground: Color32,
    /// Pixels are squares.
    pub squares: bool,
}

impl Canvas {
    pub fn shape(self, panel: Rect) -> PaintCallback {
        Callback::new_paint_callback(panel, self)
    }
}

/// What all canvases of a window draw with.
struct Brush {
    pipeline: wgpu::RenderPipeline,
    smooth: wgpu::Sampler,
    squares: wgpu::Sampler,
    /// Of the canvas that is drawn in this frame of the window.
    bound: Option<wgpu::BindGroup>,
}

/// Makes ready to draw canvases in a window; once for each.
pub fn prepare(window: &RenderState) {
    let (device, pipeline) = (&window.device, fullscreen(window, Shader::Window));
    let sampler = |filter| {
        device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("canvas"),
            mag_filter: filter,
            min_filter: filter,
            ..Default::default()
        })
    };
    let [smooth, squares] = [wgpu::FilterMode::Linear, wgpu::FilterMode::Nearest].map(sampler);
    window.renderer.write().callback_resources.insert(Brush { pipeline, smooth, squares, bound: None });
}

/// Covers the viewport of a window's pass by a shader's `main`.
pub fn fullscreen(window: &RenderState, shader: Shader) -> wgpu::RenderPipeline {
    let device = &window.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(shader.name()),
        source: wgpu::ShaderSource::Wgsl(shader.module().into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(shader.name()),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("fullscreen_vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            targets: &[Some(window.target_format.into())],
        }),
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        multiview_mask: None,
        cache: None,
    })
}

impl CallbackTrait for Canvas {
    fn prepare(
        &self,
        device: &wgpu::Device,
        _: &wgpu::Queue,
        screen: &ScreenDescriptor,
        _: &mut wgpu::CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        let Some(brush) = resources.get_mut::<Brush>() else { return Vec::new() };
        let ppp = screen.pixels_per_point;
        let origin = self.placed.rect.min;
        let [r, g, b, a] = self.ground.to_normalized_gamma_f32();
        // As `Canvas` in the shader.
        let line_x = self.line_x.clamp(-1e9, 1e9);
        let extent = self.placed.scale * ppp * self.size;
        let values = [origin.x * ppp, origin.y * ppp, extent.x, extent.y, r, g, b, a, line_x * ppp, 0.0, 0.0, 0.0];
        let uniform = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("canvas"),
            contents: bytemuck::cast_slice(&values),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let [left, right] = self.pictures.each_ref().map(|picture| picture.create_view(&Default::default()));
        let sampler = if self.squares { &brush.squares } else { &brush.smooth };
        let entries = [
            uniform.as_entire_binding(),
            wgpu::BindingResource::Sampler(sampler),
            wgpu::BindingResource::TextureView(&left),
            wgpu::BindingResource::TextureView(&right),
        ];
        let numbered =
            entries.into_iter().zip(0..).map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource });
        brush.bound = Some(device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("canvas"),
            layout: &brush.pipeline.get_bind_group_layout(0),
            entries: &numbered.collect::<Vec<_>>(),
        }));
        Vec::new()
    }

    fn paint(&self, _: PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, resources: &CallbackResources) {
        let Some(brush) = resources.get::<Brush>() else { return };
        let Some(bound) = &brush.bound else { return };
        pass.set_pipeline(&brush.pipeline);
        pass.set_bind_group(0, bound, &[]);
        pass.draw(0..3, 0..1);
    }
}
