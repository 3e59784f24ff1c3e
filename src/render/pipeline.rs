//! The pipelines of shaders/raster.wgsl: one for each combination of features.

use std::sync::Arc;

use super::light::{MAX_POINTS, MAX_SUNS};
use super::unwrap::LightmapVertex;
use crate::camera::{LensModel, Primaries};
use crate::gpu::{Gpu, Shader};
use crate::memo::Memo;
use crate::scene::{Alpha, Environment, Lighting, Material};

pub const COLOR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// The format of shaders/shared/layer.wgsl.
pub const GEOMETRY: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Uint;
pub const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Multisampling, samples per pixel.
pub const SAMPLES: u32 = 4;

/// The features of a draw call. Disabled features cost nothing: the shader is compiled without
/// them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Variant {
    pub double_sided: bool,
    pub mirrored: bool,
    pub blended: bool,
    pub masked: bool,
    pub unlit: bool,
    /// Vertices have colours.
    pub colors: bool,
    /// Base colour, metallic-roughness, normals, occlusion, emissive.
    pub textures: [bool; 5],
    /// Numbers of lights.
    pub suns: u8,
    pub points: u8,
    pub environment_map: bool,
    /// Rolling shutter.
    pub rolling: bool,
    /// The lens model of the picture's camera, as [`lens_number`] gives it.
    pub lens: u8,
    /// Primaries of the drawn light.
    pub primaries: Primaries,
    /// One face of a 360° picture.
    pub around: bool,
    /// Orthographic projection.
    pub parallel: bool,
    /// The depth of the real scene is known.
    pub hidden_by_depth: bool,
    /// The depth has its own resolution.
    pub depth_on_grid: bool,
    /// The part has a lightmap.
    pub lightmap: bool,
}

/// Number of a lens model in shaders/raster.wgsl. Pinhole views of other models are 0.
pub fn lens_number(model: LensModel) -> u8 {
    match model {
        LensModel::Opencv | LensModel::Equirectangular => 0,
        LensModel::OpencvFisheye => 1,
        LensModel::OpencvRational => 2,
        LensModel::Fov => 3,
        LensModel::ThinPrismFisheye => 4,
        LensModel::StMap => 5,
    }
}

impl Variant {
    /// Features required by a material under this lighting.
    pub fn of(material: &Material, lighting: &Lighting) -> Self {
        let unlit = material.unlit;
        let lit = |texture: bool| texture && !unlit;
        Self {
            double_sided: material.double_sided,
            blended: material.alpha == Alpha::Blend,
            masked: matches!(material.alpha, Alpha::Mask(_)),
            unlit,
            textures: [
                material.base_color_texture.is_some(),
                lit(material.metallic_roughness_texture.is_some()),
                lit(material.normal_texture.is_some()),
                lit(material.occlusion_texture.is_some()),
                lit(material.emissive_texture.is_some()),
            ],
            suns: if unlit { 0 } else { lighting.suns.len().min(MAX_SUNS) as u8 },
            points: if unlit { 0 } else { lighting.points.len().min(MAX_POINTS) as u8 },
            environment_map: !unlit && matches!(lighting.environment, Environment::Map(_)),
            ..Self::default()
        }
    }

    /// The values of the shader's `override`s.
    fn constants(&self) -> Vec<(&'static str, f64)> {
        let [base_color, metallic_roughness, normals, occlusion, emissive] = self.textures;
        let features = [
            ("rolling", self.rolling),
            ("around", self.around),
            ("parallel", self.parallel),
            ("has_colors", self.colors),
            ("has_base_color", base_color),
            ("has_metallic_roughness", metallic_roughness),
            ("has_normals", normals),
            ("has_occlusion", occlusion),
            ("has_emissive", emissive),
            ("unlit", self.unlit),
            ("masked", self.masked),
            ("blended", self.blended),
            ("hidden_by_depth", self.hidden_by_depth),
            ("depth_on_grid", self.depth_on_grid),
            ("has_map", self.environment_map),
            ("has_lightmap", self.lightmap && !self.unlit),
            ("converts_primaries", self.primaries != Primaries::Rec709),
        ]
        .map(|(name, on)| (name, u8::from(on)));
        let counts = [("suns", self.suns), ("points", self.points), ("lens", self.lens)];
        let constants = features.into_iter().chain(counts).map(|(name, value)| (name, f64::from(value)));
        let primaries = self.primaries.from_rec709().into_iter().flat_map(|matrix| {
            const NAMES: [[&str; 3]; 3] = [
                ["red_of_red", "red_of_green", "red_of_blue"],
                ["green_of_red", "green_of_green", "green_of_blue"],
                ["blue_of_red", "blue_of_green", "blue_of_blue"],
            ];
            let row = move |at: usize| NAMES[at].into_iter().zip(matrix.row(at).to_array());
            (0..3).flat_map(row)
        });
        constants.chain(primaries).collect()
    }
}

/// Outputs of a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Writes {
    /// Colour; also depth, unless blended.
    Color,
    /// The depth of blended surfaces, in a pass after all colours.
    BlendedDepth,
}

/// Per-object data of its draw calls: the instance attributes of shaders/raster.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct DrawInstance {
    /// The 3×4 matrix from the mesh to world axes around the camera.
    pub rows: [[f32; 4]; 3],
    /// Sign of its determinant.
    pub mirror: f32,
    pub offset_px: [f32; 2],
}

/// A device's pipelines, each compiled on first use.
#[derive(Debug)]
pub struct RenderPipelines {
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    pub frame_layout: wgpu::BindGroupLayout,
    pub material_layout: wgpu::BindGroupLayout,
    pub lightmap_layout: wgpu::BindGroupLayout,
    pipelines: Memo<(Variant, Writes), Arc<wgpu::RenderPipeline>>,
}

impl RenderPipelines {
    pub fn new(gpu: &Gpu) -> Self {
        let [frame_layout, material_layout, lightmap_layout] = layouts(gpu);
        Self {
            module: gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("raster"),
                source: wgpu::ShaderSource::Wgsl(Shader::Raster.module().into()),
            }),
            layout: gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("raster"),
                bind_group_layouts: &[Some(&frame_layout), Some(&material_layout), Some(&lightmap_layout)],
                immediate_size: 0,
            }),
            frame_layout,
            material_layout,
            lightmap_layout,
            pipelines: Memo::unbounded(),
        }
    }

    /// The pipeline of a variant, compiled on first use.
    pub fn get(&self, gpu: &Gpu, variant: Variant, writes: Writes) -> Arc<wgpu::RenderPipeline> {
        self.pipelines
            .get_or_insert_with((variant, writes), |(variant, writes)| Arc::new(self.make(gpu, variant, *writes)))
    }

    fn make(&self, gpu: &Gpu, variant: &Variant, writes: Writes) -> wgpu::RenderPipeline {
        let corner = wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32x2, 4 => Float32x2, 5 => Float32x4, 10 => Float32x2];
        let instance = wgpu::vertex_attr_array![6 => Float32x4, 7 => Float32x4, 8 => Float32x4, 9 => Float32x3];
        let constants = variant.constants();
        let compilation_options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let entry = match writes {
            Writes::BlendedDepth => "depth_of_blended",
            Writes::Color if variant.masked || variant.hidden_by_depth => "partly",
            Writes::Color => "whole",
        };
        let deep = writes == Writes::BlendedDepth;
        gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("raster"),
            layout: Some(&self.layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("vertex"),
                compilation_options: compilation_options.clone(),
                buffers: &[
                    Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<LightmapVertex>() as u64,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &corner,
                    }),
                    Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<DrawInstance>() as u64,
                        step_mode: wgpu::VertexStepMode::Instance,
                        attributes: &instance,
                    }),
                ],
            },
            primitive: wgpu::PrimitiveState {
                front_face: if variant.mirrored { wgpu::FrontFace::Cw } else { wgpu::FrontFace::Ccw },
                cull_mode: (!variant.double_sided).then_some(wgpu::Face::Back),
                ..Default::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(deep || !variant.blended),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: wgpu::MultisampleState { count: SAMPLES, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some(entry),
                compilation_options,
                targets: &[Some(wgpu::ColorTargetState {
                    format: COLOR,
                    blend: variant.blended.then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                    write_mask: if deep { wgpu::ColorWrites::empty() } else { wgpu::ColorWrites::ALL },
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Layouts of the bind groups per frame, per material and per part.
fn layouts(gpu: &Gpu) -> [wgpu::BindGroupLayout; 3] {
    use wgpu::{BindGroupLayoutEntry, BindingType, BufferBindingType, ShaderStages};
    let entry = |binding, visibility, ty| BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let buffer =
        BindingType::Buffer { ty: BufferBindingType::Uniform, has_dynamic_offset: false, min_binding_size: None };
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
            entry(0, both, buffer),
            entry(1, ShaderStages::FRAGMENT, buffer),
            entry(2, ShaderStages::FRAGMENT, texture(true)),
            entry(3, ShaderStages::FRAGMENT, sampler),
            entry(4, ShaderStages::FRAGMENT, texture(false)),
            entry(5, ShaderStages::FRAGMENT, texture(true)),
            entry(6, ShaderStages::FRAGMENT, texture(true)),
            entry(7, ShaderStages::VERTEX, texture(false)),
        ],
    });
    let mut entries = vec![entry(0, ShaderStages::FRAGMENT, buffer)];
    for i in 0..5 {
        entries.push(entry(1 + 2 * i, ShaderStages::FRAGMENT, texture(true)));
        entries.push(entry(2 + 2 * i, ShaderStages::FRAGMENT, sampler));
    }
    let material = gpu
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("material"), entries: &entries });
    let layers = BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let lightmap = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("lightmap"),
        entries: &[entry(0, ShaderStages::FRAGMENT, layers)],
    });
    [frame, material, lightmap]
}

#[cfg(test)]
mod tests {
    use super::super::light::LightUniform;
    use super::super::material::MaterialUniform;
    use super::super::view::ViewUniform;
    use crate::gpu::{Interface, Shader, Uniform};

    #[test]
    fn uniform_layouts_match_the_shader() {
        let globals = Interface::new("raster", &Shader::Raster.module()).globals(&["vertex", "whole"]);
        globals["view"].check_layout(size_of::<ViewUniform>(), ViewUniform::MEMBERS);
        globals["light"].check_layout(size_of::<LightUniform>(), LightUniform::MEMBERS);
        globals["material"].check_layout(size_of::<MaterialUniform>(), MaterialUniform::MEMBERS);
    }
}
