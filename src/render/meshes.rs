//! A scene's meshes on the GPU.

use std::ops::Range;

use glam::DVec3;

use super::bounds::{Bounds, outline};
use super::dice::longest_edge;
use super::unwrap::{LightmapVertex, UnwrappedMesh, area_of};
use crate::gpu::Gpu;
use crate::scene::{Mesh, Part, Scene};

/// Maximum side of an object's lightmap, texels.
const MAX_LIGHTMAP_SIDE: u32 = 128;
const MIN_TEXEL_M: f64 = 0.0015;

/// A mesh on the GPU.
#[derive(Debug)]
pub struct GpuMesh {
    pub base_vertex: i32,
    pub indices: Range<u32>,
    pub longest: f64,
    pub has_colors: bool,
    pub bounds: Option<Bounds>,
    /// Points whose convex hull contains the mesh.
    pub outline: Vec<DVec3>,
}

/// All meshes in two buffers.
#[derive(Debug)]
pub struct Meshes {
    pub all: Vec<GpuMesh>,
    /// Contents of the buffers.
    pub surfaces: Vec<UnwrappedMesh>,
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    has_lightmap_coordinates: bool,
}

impl Meshes {
    pub fn new(gpu: &Gpu, scene: &Scene) -> Self {
        let surfaces: Vec<_> = scene.meshes.iter().map(|mesh| UnwrappedMesh::none(mesh)).collect();
        let mesh = |(mesh, surface): (&std::sync::Arc<Mesh>, &UnwrappedMesh)| GpuMesh {
            base_vertex: 0,
            indices: 0..0,
            longest: longest_edge(surface),
            has_colors: mesh.vertices.iter().any(|v| v.color != [1.0; 4]),
            bounds: Bounds::of(mesh.vertices.iter().map(|v| v.position)),
            outline: outline(&mesh.vertices.iter().map(|v| v.position).collect::<Vec<_>>()),
        };
        let mut all: Vec<GpuMesh> = scene.meshes.iter().zip(&surfaces).map(mesh).collect();
        let [vertices, indices] = uploaded(gpu, &surfaces, &mut all);
        Self { all, surfaces, vertices, indices, has_lightmap_coordinates: false }
    }

    /// Computes lightmap coordinates, if there are none yet. This is expensive, and only needed for
    /// lightmaps. Returns false if there are some already.
    pub fn unwrap(&mut self, gpu: &Gpu, scene: &Scene) -> bool {
        if self.has_lightmap_coordinates {
            return false;
        }
        self.surfaces = unwrap_all(scene);
        [self.vertices, self.indices] = uploaded(gpu, &self.surfaces, &mut self.all);
        self.has_lightmap_coordinates = true;
        true
    }
}

/// Uploads vertices and indices, and sets each mesh's offsets.
fn uploaded(gpu: &Gpu, surfaces: &[UnwrappedMesh], all: &mut [GpuMesh]) -> [wgpu::Buffer; 2] {
    let (mut vertices, mut indices): (Vec<LightmapVertex>, Vec<u32>) = (Vec::new(), Vec::new());
    for (surface, mesh) in surfaces.iter().zip(all) {
        let first = indices.len() as u32;
        mesh.base_vertex = vertices.len() as i32;
        vertices.extend_from_slice(&surface.corners);
        indices.extend_from_slice(&surface.indices);
        mesh.indices = first..indices.len() as u32;
    }
    // A buffer must not be empty.
    vertices.resize(vertices.len().max(1), bytemuck::Zeroable::zeroed());
    indices.resize(indices.len().max(3), 0);
    [
        gpu.buffer("vertices", bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
        gpu.buffer("indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
    ]
}

/// A scene's meshes with lightmap coordinates, except unlit ones: the parts of an object share its
/// lightmap texels in proportion to their areas.
fn unwrap_all(scene: &Scene) -> Vec<UnwrappedMesh> {
    let area_m2 = |part: &Part| {
        let stretch = part.world_from_mesh.matrix3.determinant().abs().powf(1.0 / 3.0);
        area_of(&scene.meshes[part.mesh]) * stretch * stretch
    };
    // The size of a mesh that no object uses yet is unknown.
    let mut sides = vec![MAX_LIGHTMAP_SIDE; scene.meshes.len()];
    for object in &scene.objects {
        let all: f64 = object.parts.iter().map(area_m2).sum();
        for part in &object.parts {
            let area_m2 = area_m2(part);
            let shared = f64::from(MAX_LIGHTMAP_SIDE) * (area_m2 / all.max(1e-30)).sqrt();
            // About half of the square is filled.
            let finest = (2.0 * area_m2).sqrt() / MIN_TEXEL_M;
            sides[part.mesh] = shared.min(finest).ceil().clamp(16.0, MAX_LIGHTMAP_SIDE.into()) as u32;
        }
    }
    let is_lit = |mesh: &Mesh| scene.materials.get(mesh.material).is_none_or(|material| !material.unlit);
    let unwrapped = |(mesh, side): (&std::sync::Arc<Mesh>, u32)| {
        if is_lit(mesh) { UnwrappedMesh::new(mesh, side) } else { UnwrappedMesh::none(mesh) }
    };
    scene.meshes.iter().zip(sides).map(unwrapped).collect()
}
