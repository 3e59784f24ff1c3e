//! Drawing a plan's samples and summing them.

use std::ops::Range;

use glam::DVec3;

use super::bounds::{Bounds, Footprint, footprint};
use super::dice::{Bend, dice, longest_edge};
use super::light::{EnvironmentLight, LightUniform, unsupported};
use super::material::bind_groups;
use super::plan::{Layer, LayerRun, Sample, SamplePlan};
use super::view::{Shutter, ViewKeys, ViewUniform};
use crate::camera::Geometry;
use crate::gpu::{FullscreenPass, Gpu, Slot, Texture, assemble, constants};
use crate::image::Rect;
use crate::scene::{Alpha, Scene, Vertex};

const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
const SAMPLES: u32 = 4;

/// `Part` of shaders/raster.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct PartUniform {
    rows: [[f32; 4]; 3],
    mirror: [f32; 4],
    offset_px: [f32; 4],
}

/// A mesh on the GPU.
#[derive(Debug)]
struct GpuMesh {
    base_vertex: i32,
    indices: Range<u32>,
    longest: f64,
    bounds: Option<Bounds>,
}

/// A scene ready to be drawn.
#[derive(Debug)]
pub struct Renderer {
    scene: Scene,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    meshes: Vec<GpuMesh>,
    materials: Vec<wgpu::BindGroup>,
    environment: EnvironmentLight,
    frame_layout: wgpu::BindGroupLayout,
    /// By (double sided, mirrored, blended).
    pipelines: [wgpu::RenderPipeline; 8],
    resolve: FullscreenPass,
    accumulate: wgpu::ComputePipeline,
    accumulated: FullscreenPass,
    no_depth: Texture,
}

/// What one frame's drawing needs.
#[derive(Debug)]
pub struct View<'a> {
    pub geometry: &'a Geometry,
    pub keys: &'a ViewKeys,
    pub shutter: Shutter,
    /// What is drawn, in raster axes; may reach beyond the picture.
    pub rect: Rect,
    /// The real scene's depth over `rect` (metres, 0 unknown), and how much nearer it must be.
    pub occlusion: Option<(&'a Texture, f32)>,
}

/// One draw call.
struct Draw {
    part: u32,
    mesh: usize,
    material: usize,
    mirrored: bool,
    diced: Option<(i32, Range<u32>)>,
    /// Of the box's middle, metres: what is blended is drawn from the back.
    depth_m: f64,
}

impl Renderer {
    pub fn new(gpu: &Gpu, scene: Scene) -> Self {
        use wgpu::util::DeviceExt;
        let mut vertices: Vec<Vertex> = Vec::new();
        let mut indices: Vec<u32> = Vec::new();
        let meshes = scene
            .meshes
            .iter()
            .map(|mesh| {
                let start = indices.len() as u32;
                let base_vertex = vertices.len() as i32;
                vertices.extend_from_slice(&mesh.vertices);
                indices.extend_from_slice(&mesh.indices);
                GpuMesh {
                    base_vertex,
                    indices: start..indices.len() as u32,
                    longest: longest_edge(mesh),
                    bounds: Bounds::of(mesh.vertices.iter().map(|v| v.position)),
                }
            })
            .collect();
        // A buffer must not be empty.
        vertices.resize(vertices.len().max(1), bytemuck::Zeroable::zeroed());
        indices.resize(indices.len().max(3), 0);
        let buffer = |label, contents, usage| {
            gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
        };
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("raster"),
            source: wgpu::ShaderSource::Wgsl(assemble("raster").into()),
        });
        let (frame_layout, material_layout) = layouts(gpu);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("raster"),
            bind_group_layouts: &[Some(&frame_layout), Some(&material_layout)],
            immediate_size: 0,
        });
        let pipelines = std::array::from_fn(|i| pipeline(gpu, &module, &layout, i & 1 == 1, i & 2 == 2, i & 4 == 4));
        let accumulate_module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("accumulate"),
            source: wgpu::ShaderSource::Wgsl(assemble("accumulate").into()),
        });
        Self {
            vertices: buffer("vertices", bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
            indices: buffer("indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
            meshes,
            materials: bind_groups(gpu, &material_layout, &scene),
            environment: EnvironmentLight::new(gpu, &scene.lighting.environment),
            frame_layout,
            pipelines,
            resolve: FullscreenPass::new(gpu, "resolve", &assemble("resolve"), &[COLOR, COLOR]),
            accumulate: gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("accumulate"),
                layout: None,
                module: &accumulate_module,
                entry_point: Some("add"),
                compilation_options: Default::default(),
                cache: None,
            }),
            accumulated: FullscreenPass::new(gpu, "accumulated", &assemble("accumulated"), &[COLOR, COLOR]),
            no_depth: Texture::new(gpu, "no depth", 1, 1, wgpu::TextureFormat::R32Float, 1),
            scene,
        }
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What the scene asks for and is not drawn.
    pub fn warnings(&self) -> Vec<String> {
        unsupported(&self.scene.lighting).into_iter().collect()
    }

    /// Where the objects can be while the shutter is open.
    pub fn footprint(&self, geometry: &Geometry, keys: &ViewKeys) -> Footprint {
        let bounds: Vec<_> = self.meshes.iter().map(|m| m.bounds).collect();
        footprint(&self.scene, &bounds, geometry, keys)
    }

    /// The middle of each object's bounding box in the world, metres; `None` for an empty one.
    pub fn object_centres(&self) -> Vec<Option<DVec3>> {
        self.scene
            .objects
            .iter()
            .map(|object| {
                let corners = object.parts.iter().filter_map(|part| {
                    let b = self.meshes[part.mesh].bounds?;
                    Some(b.corners().map(|c| part.world_from_mesh.transform_point3(c)))
                });
                let (low, high) =
                    corners.flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
                low.is_finite().then(|| 0.5 * (low + high))
            })
            .collect()
    }

    /// Draws the plan's samples and gives their weighted sum.
    pub fn draw(&self, run: &mut LayerRun<'_>, view: &View<'_>, plan: &SamplePlan) -> Layer {
        let gpu = run.gpu;
        let size = (view.rect.width(), view.rect.height());
        let mut layer = |slot| Layer {
            color: run.pool.get(gpu, "layer colour", slot, size, COLOR, 1),
            geometry: run.pool.get(gpu, "layer geometry", slot, size, COLOR, 1),
            size,
        };
        let (out, one) = (layer(0), layer(1));
        let (draws, diced) = self.draws(gpu, view);
        if let [sample] = plan.samples.as_slice() {
            self.draw_sample(run, view, sample, &draws, diced.as_ref(), &out);
            return out;
        }
        let stride = out.color.width;
        let sum = storage(gpu, stride, out.color.height);
        let nearest = storage(gpu, stride, out.color.height);
        for (i, sample) in plan.samples.iter().enumerate() {
            self.draw_sample(run, view, sample, &draws, diced.as_ref(), &one);
            let first = u32::from(i == 0);
            let step: [u32; 8] = [size.0, size.1, stride, first, sample.weight.to_bits(), 0, 0, 0];
            let step = constants(gpu, "accumulate", bytemuck::cast_slice(&step));
            self.add(run, &step, &one, &sum, &nearest);
            // A long plan in one submission would hold all its buffers at once.
            if i % 32 == 31 {
                let next = gpu.device.create_command_encoder(&Default::default());
                let done = std::mem::replace(run.encoder, next).finish();
                gpu.queue.submit([done]);
            }
        }
        let uniform = constants(gpu, "accumulated", bytemuck::cast_slice(&[stride, 0, 0, 0]));
        self.accumulated.run(
            gpu,
            run.encoder,
            &[Slot::Buffer(&uniform), Slot::Buffer(&sum), Slot::Buffer(&nearest)],
            &[&out.color, &out.geometry],
            size,
        );
        out
    }

    fn add(
        &self,
        run: &mut LayerRun<'_>,
        step: &wgpu::Buffer,
        one: &Layer,
        sum: &wgpu::Buffer,
        nearest: &wgpu::Buffer,
    ) {
        let entries = [
            wgpu::BindGroupEntry { binding: 0, resource: step.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&one.color.view) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(&one.geometry.view) },
            wgpu::BindGroupEntry { binding: 3, resource: sum.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 4, resource: nearest.as_entire_binding() },
        ];
        let group = run.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("accumulate"),
            layout: &self.accumulate.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut pass = run.encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.accumulate);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(one.size.0.div_ceil(8), one.size.1.div_ceil(8), 1);
    }

    /// The draw calls of a view, opaque ones first, blended ones from the back, and the
    /// buffers of what had to be cut fine for it.
    fn draws(&self, gpu: &Gpu, view: &View<'_>) -> (Vec<Draw>, Option<(wgpu::Buffer, wgpu::Buffer)>) {
        use wgpu::util::DeviceExt;
        let bend = Bend::of(view.geometry, view.shutter.readout_time_s);
        let (mut vertices, mut indices) = (Vec::new(), Vec::new());
        let mut draws = Vec::new();
        for (number, part) in self.scene.objects.iter().flat_map(|o| &o.parts).enumerate() {
            let gpu_mesh = &self.meshes[part.mesh];
            let mesh = &self.scene.meshes[part.mesh];
            let Some(bounds) = gpu_mesh.bounds else { continue };
            let corners = bounds.corners().map(|c| part.world_from_mesh.transform_point3(c));
            let diced = dice(mesh, gpu_mesh.longest, &corners, &part.world_from_mesh, view.geometry, view.keys, bend)
                .map(|(v, i)| {
                    let (base, start) = (vertices.len() as i32, indices.len() as u32);
                    vertices.extend(v);
                    indices.extend(i);
                    (base, start..indices.len() as u32)
                });
            let centre = 0.5 * (corners[0] + corners[7]);
            draws.push(Draw {
                part: number as u32,
                mesh: part.mesh,
                material: mesh.material,
                mirrored: part.world_from_mesh.matrix3.determinant() < 0.0,
                diced,
                depth_m: view.keys.middle().transform_point(centre).z,
            });
        }
        let blended = |d: &Draw| self.scene.materials[d.material].alpha == Alpha::Blend;
        draws.sort_by(|a, b| {
            blended(a)
                .cmp(&blended(b))
                .then_with(|| if blended(a) { b.depth_m.total_cmp(&a.depth_m) } else { a.part.cmp(&b.part) })
        });
        let buffers = (!indices.is_empty()).then(|| {
            let buffer = |label, contents, usage| {
                gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage })
            };
            (
                buffer("diced vertices", bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
                buffer("diced indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
            )
        });
        (draws, buffers)
    }

    fn part_uniforms(&self, view: &View<'_>, sample: &Sample) -> Vec<PartUniform> {
        let mut out = Vec::new();
        for (object, parts) in self.scene.objects.iter().map(|o| &o.parts).enumerate() {
            let offset = sample.offsets_px.get(object).copied().unwrap_or_default();
            for part in parts {
                let m = part.world_from_mesh.matrix3;
                let t = part.world_from_mesh.translation - view.keys.origin_in_world_m;
                let row = |i: usize| [m.x_axis[i] as f32, m.y_axis[i] as f32, m.z_axis[i] as f32, t[i] as f32];
                let mirror = m.determinant().signum() as f32;
                out.push(PartUniform {
                    rows: [row(0), row(1), row(2)],
                    mirror: [mirror, 0.0, 0.0, 0.0],
                    offset_px: [offset[0], offset[1], 0.0, 0.0],
                });
            }
        }
        if out.is_empty() {
            out.push(bytemuck::Zeroable::zeroed());
        }
        out
    }

    fn draw_sample(
        &self,
        run: &mut LayerRun<'_>,
        view: &View<'_>,
        sample: &Sample,
        draws: &[Draw],
        diced: Option<&(wgpu::Buffer, wgpu::Buffer)>,
        out: &Layer,
    ) {
        use wgpu::util::DeviceExt;
        let gpu = run.gpu;
        let size = out.size;
        let tolerance = view.occlusion.map_or(-1.0, |(_, tolerance)| tolerance);
        let uniform = ViewUniform::new(view.geometry, view.keys, view.shutter, view.rect, sample.time_s, tolerance);
        let uniform = constants(gpu, "view", bytemuck::bytes_of(&uniform));
        let parts = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("parts"),
            contents: bytemuck::cast_slice(&self.part_uniforms(view, sample)),
            usage: wgpu::BufferUsages::STORAGE,
        });
        let light = LightUniform::new(&self.scene.lighting, &self.environment, view.keys.origin_in_world_m);
        let light = constants(gpu, "light", bytemuck::bytes_of(&light));
        let depth_view = view.occlusion.map_or(&self.no_depth.view, |(t, _)| &t.view);
        let frame = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &self.frame_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: parts.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: light.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::TextureView(&self.environment.view),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: wgpu::BindingResource::Sampler(&self.environment.sampler),
                },
                wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::TextureView(depth_view) },
            ],
        });
        let color = run.pool.get(gpu, "samples colour", 0, size, COLOR, SAMPLES);
        let geometry = run.pool.get(gpu, "samples geometry", 0, size, COLOR, SAMPLES);
        let depth = run.pool.get(gpu, "samples depth", 0, size, DEPTH, SAMPLES);
        {
            let attach = |view| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })
            };
            let mut pass = run.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("raster"),
                color_attachments: &[attach(&color.view), attach(&geometry.view)],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth.view,
                    depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                    stencil_ops: None,
                }),
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            });
            pass.set_viewport(0.0, 0.0, size.0 as f32, size.1 as f32, 0.0, 1.0);
            pass.set_scissor_rect(0, 0, size.0, size.1);
            pass.set_bind_group(0, &frame, &[]);
            for draw in draws {
                let material = &self.scene.materials[draw.material];
                let key = usize::from(material.double_sided)
                    | usize::from(draw.mirrored) << 1
                    | usize::from(material.alpha == Alpha::Blend) << 2;
                pass.set_pipeline(&self.pipelines[key]);
                pass.set_bind_group(1, &self.materials[draw.material], &[]);
                let (vertices, indices, base, range) = match (&draw.diced, diced) {
                    (Some((base, range)), Some((v, i))) => (v, i, *base, range.clone()),
                    _ => {
                        let mesh = &self.meshes[draw.mesh];
                        (&self.vertices, &self.indices, mesh.base_vertex, mesh.indices.clone())
                    }
                };
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(range, base, draw.part..draw.part + 1);
            }
        }
        self.resolve.run(
            gpu,
            run.encoder,
            &[Slot::Texture(&color.view), Slot::Texture(&geometry.view)],
            &[&out.color, &out.geometry],
            size,
        );
    }
}

fn storage(gpu: &Gpu, stride: u32, height: u32) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("sum"),
        size: 16 * u64::from(stride) * u64::from(height),
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: false,
    })
}

fn layouts(gpu: &Gpu) -> (wgpu::BindGroupLayout, wgpu::BindGroupLayout) {
    use wgpu::{BindGroupLayoutEntry, BindingType, BufferBindingType, ShaderStages};
    let entry = |binding, visibility, ty| BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let texture = |filterable| BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let sampler = BindingType::Sampler(wgpu::SamplerBindingType::Filtering);
    let both = ShaderStages::VERTEX_FRAGMENT;
    let frame = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("frame"),
        entries: &[
            entry(0, both, buffer(BufferBindingType::Storage { read_only: true })),
            entry(1, ShaderStages::VERTEX, buffer(BufferBindingType::Storage { read_only: true })),
            entry(2, ShaderStages::FRAGMENT, buffer(BufferBindingType::Uniform)),
            entry(3, ShaderStages::FRAGMENT, texture(true)),
            entry(4, ShaderStages::FRAGMENT, sampler),
            entry(5, ShaderStages::FRAGMENT, texture(false)),
        ],
    });
    let mut entries = vec![entry(0, ShaderStages::FRAGMENT, buffer(BufferBindingType::Uniform))];
    for i in 0..5 {
        entries.push(entry(1 + 2 * i, ShaderStages::FRAGMENT, texture(true)));
        entries.push(entry(2 + 2 * i, ShaderStages::FRAGMENT, sampler));
    }
    let material = gpu
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("material"), entries: &entries });
    (frame, material)
}

fn pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    double_sided: bool,
    mirrored: bool,
    blended: bool,
) -> wgpu::RenderPipeline {
    let attributes = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32x2, 4 => Float32x2, 5 => Float32x4];
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("raster"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &attributes,
            })],
        },
        primitive: wgpu::PrimitiveState {
            front_face: if mirrored { wgpu::FrontFace::Cw } else { wgpu::FrontFace::Ccw },
            cull_mode: (!double_sided).then_some(wgpu::Face::Back),
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(!blended),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: SAMPLES, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[
                Some(wgpu::ColorTargetState {
                    format: COLOR,
                    blend: blended.then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: wgpu::ColorWrites::ALL,
                }),
                Some(COLOR.into()),
            ],
        }),
        multiview_mask: None,
        cache: None,
    })
}
