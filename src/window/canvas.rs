//! Paints the picture with a shader of its own. egui's shader does so much work per pixel that, on
//! a software driver, displaying a picture takes longer than compositing it.

use eframe::egui::{Color32, PaintCallback, PaintCallbackInfo, Rect, Vec2};
use eframe::egui_wgpu::{Callback, CallbackResources, CallbackTrait, RenderState, ScreenDescriptor};
use wgpu::util::DeviceExt;

use super::picture_transform::PictureTransform;
use locard_engine::gpu::Shader;

/// Two pictures, split at a line, on a plain background.
#[derive(Debug)]
pub struct Canvas {
    pub placed: PictureTransform,
    /// Size of the pictures, px; their textures may be smaller.
    pub size: Vec2,
    /// Split line, points: the first picture is to its left.
    pub line_x: f32,
    pub pictures: [wgpu::Texture; 2],
    pub ground: Color32,
    /// Samples the nearest pixel.
    pub squares: bool,
}

impl Canvas {
    pub fn shape(self, panel: Rect) -> PaintCallback {
        Callback::new_paint_callback(panel, self)
    }
}

/// Pipelines and samplers of all canvases of a window.
struct CanvasResources {
    picture: wgpu::RenderPipeline,
    ground: wgpu::RenderPipeline,
    smooth: wgpu::Sampler,
    squares: wgpu::Sampler,
    /// Bind groups of the canvas in this frame of the window.
    bound: Option<CanvasBindings>,
}

struct CanvasBindings {
    pictures: [wgpu::BindGroup; 2],
    ground: wgpu::BindGroup,
}

/// Creates the resources of canvases; call it once per window.
pub fn prepare(window: &RenderState) {
    let device = &window.device;
    let [picture, ground] = ["main", "ground"].map(|entry| fullscreen(window, Shader::Window, entry));
    let sampler = |filter| {
        device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("canvas"),
            mag_filter: filter,
            min_filter: filter,
            ..Default::default()
        })
    };
    let [smooth, squares] = [wgpu::FilterMode::Linear, wgpu::FilterMode::Nearest].map(sampler);
    window.renderer.write().callback_resources.insert(CanvasResources {
        picture,
        ground,
        smooth,
        squares,
        bound: None,
    });
}

/// A pipeline that covers the viewport with a shader's fragment entry.
pub fn fullscreen(window: &RenderState, shader: Shader, entry: &str) -> wgpu::RenderPipeline {
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
            entry_point: Some(entry),
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
        let Some(canvas) = resources.get_mut::<CanvasResources>() else { return Vec::new() };
        let ppp = screen.pixels_per_point;
        let origin = self.placed.rect.min;
        let [r, g, b, a] = self.ground.to_normalized_gamma_f32();
        // The layout is that of `Canvas` in the shader.
        let extent = self.placed.scale * ppp * self.size;
        let values = [origin.x * ppp, origin.y * ppp, extent.x, extent.y, r, g, b, a];
        let uniform = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("canvas"),
            contents: bytemuck::cast_slice(&values),
            usage: wgpu::BufferUsages::UNIFORM,
        });
        let bind = |pipeline: &wgpu::RenderPipeline, resources: &[wgpu::BindingResource<'_>]| {
            let numbered = resources.iter().cloned().zip(0..);
            let entries: Vec<_> =
                numbered.map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource }).collect();
            let layout = &pipeline.get_bind_group_layout(0);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("canvas"), layout, entries: &entries })
        };
        let sampler = if self.squares { &canvas.squares } else { &canvas.smooth };
        let pictures = self.pictures.each_ref().map(|picture| {
            let view = picture.create_view(&Default::default());
            let texels = wgpu::BindingResource::TextureView(&view);
            bind(&canvas.picture, &[uniform.as_entire_binding(), wgpu::BindingResource::Sampler(sampler), texels])
        });
        let ground = bind(&canvas.ground, &[uniform.as_entire_binding()]);
        canvas.bound = Some(CanvasBindings { pictures, ground });
        Vec::new()
    }

    fn paint(&self, info: PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, resources: &CallbackResources) {
        let Some(canvas) = resources.get::<CanvasResources>() else { return };
        let Some(bound) = &canvas.bound else { return };
        let clip = info.clip_rect_in_pixels();
        let clip =
            Area { x: [clip.left_px, clip.left_px + clip.width_px], y: [clip.top_px, clip.top_px + clip.height_px] };
        let (pictures, grounds) = areas(self.placed.rect, self.line_x, clip, info.pixels_per_point);
        let mut draw = |pipeline, bound, area: &Area| {
            let ([x0, x1], [y0, y1]) = (area.x, area.y);
            if x1 > x0 && y1 > y0 {
                pass.set_scissor_rect(x0 as u32, y0 as u32, (x1 - x0) as u32, (y1 - y0) as u32);
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, bound, &[]);
                pass.draw(0..3, 0..1);
            }
        };
        grounds.iter().for_each(|area| draw(&canvas.ground, &bound.ground, area));
        pictures.iter().zip(&bound.pictures).for_each(|(area, picture)| draw(&canvas.picture, picture, area));
    }
}

/// Pixels of the target, from the first to the one after the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Area {
    x: [i32; 2],
    y: [i32; 2],
}

/// Areas of both pictures and of the background inside `clip`. The pictures lie at `placed` and are
/// split at `line_x`, both in points. A pixel belongs to the area at its centre. The areas are
/// disjoint, so that each pixel is drawn once: a pixel costs more than a draw call.
fn areas(placed: Rect, line_x: f32, clip: Area, ppp: f32) -> ([Area; 2], [Area; 4]) {
    let within = |edge: f32, [from, to]: [i32; 2]| ((edge * ppp - 0.5).ceil() as i32).clamp(from, to);
    let x = [placed.min.x, placed.max.x].map(|x| within(x, clip.x));
    let y = [placed.min.y, placed.max.y].map(|y| within(y, clip.y));
    let line = within(line_x, x);
    let pictures = [[x[0], line], [line, x[1]]].map(|x| Area { x, y });
    let grounds = [
        Area { y: [clip.y[0], y[0]], ..clip },
        Area { y: [y[1], clip.y[1]], ..clip },
        Area { x: [clip.x[0], x[0]], y },
        Area { x: [x[1], clip.x[1]], y },
    ];
    (pictures, grounds)
}

#[cfg(test)]
mod tests {
    use eframe::egui::{pos2, vec2};

    use super::*;

    #[test]
    fn each_pixel_belongs_to_the_area_at_its_centre() {
        for (min, scale, line_x, ppp) in [
            (pos2(3.25, 4.5), 0.7, 9.0, 1.0),
            (pos2(3.25, 4.5), 0.7, f32::NEG_INFINITY, 2.0),
            (pos2(-30.0, -7.3), 4.0, 11.1, 1.5),
            (pos2(90.0, 4.0), 1.0, f32::INFINITY, 1.0),
        ] {
            let size = vec2(20.0, 10.0);
            let clip = Area { x: [2, 40], y: [1, 30] };
            let (pictures, grounds) = areas(Rect::from_min_size(min, scale * size), line_x, clip, ppp);
            for (x, y) in (clip.y[0]..clip.y[1]).flat_map(|y| (clip.x[0]..clip.x[1]).map(move |x| (x, y))) {
                let has = |area: &Area| (area.x[0]..area.x[1]).contains(&x) && (area.y[0]..area.y[1]).contains(&y);
                let at = pos2(x as f32 + 0.5, y as f32 + 0.5) / ppp;
                let share = (at - min) / (scale * size);
                let inside = share.min_elem() >= 0.0 && share.x < 1.0 && share.y < 1.0;
                let expected = [inside && at.x < line_x, inside && at.x >= line_x];
                assert_eq!(pictures.each_ref().map(has), expected, "{x} {y}");
                assert_eq!(grounds.iter().filter(|area| has(area)).count(), usize::from(!inside), "{x} {y}");
            }
        }
    }
}
