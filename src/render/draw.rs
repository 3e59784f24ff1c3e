//! Draws a plan's samples and accumulates them.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use super::accumulate::WeightedSum;
use super::around::{FaceView, gather, out_of_view};
use super::around_bounds::footprint_around;
use super::bounds::{Footprint, footprint};
use super::dice::{EdgeCurvature, dice};
use super::lens_table::lens_table;
use super::light::{EnvironmentLight, LightUniform, unsupported};
use super::lightmap::{Lightmap, PartLightmaps};
use super::material::bind_groups;
use super::meshes::Meshes;
use super::motion::MotionGrid;
use super::occlusion::Occlusion;
use super::pipeline::{COLOR, DEPTH, DrawInstance, GEOMETRY, RenderPipelines, SAMPLES, Variant, Writes, lens_number};
use super::plan::{Layer, RenderSample, SamplePlan};
use super::unwrap::UnwrappedMesh;
use super::view::{NEAR_M, Shutter, View, ViewKeys, ViewUniform};
use crate::camera::Geometry;
use crate::gpu::{Gpu, PassRecorder, Shader, ShaderEntry, Stamps, Texture};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::scene::{Object, Scene};

/// Maximum number of outline points of all parts (a millisecond's work); beyond it, boxes are used.
const MAX_OUTLINE_POINTS: usize = 16384;

/// A scene prepared for drawing.
#[derive(Debug)]
pub struct Renderer {
    scene: Scene,
    meshes: Meshes,
    lightmaps: PartLightmaps,
    materials: Vec<wgpu::BindGroup>,
    environment: EnvironmentLight,
    pipelines: Arc<RenderPipelines>,
    no_depth: Texture,
    revision: u64,
}

/// One draw call.
struct Draw {
    part: u32,
    mesh: usize,
    material: usize,
    variant: Variant,
    diced: Option<(i32, Range<u32>)>,
    /// Depth of the box's centre, metres, for back-to-front order of blended parts.
    depth_m: f64,
}

/// Draw calls of a view, vertex and index buffers of subdivided meshes, and motion vectors.
struct Draws {
    list: Vec<Draw>,
    diced: Option<(wgpu::Buffer, wgpu::Buffer)>,
    motion: MotionGrid,
    /// Control points of the lens's table, if it has one.
    lens_table: Option<Texture>,
}

/// The data shared by all samples of a frame.
#[expect(clippy::large_enum_variant, reason = "one a picture")]
enum FrameGeometry {
    Plane(Draws),
    /// Cube map faces, with their layers.
    Around(Vec<(FaceView, Layer)>, Vec<Draws>),
}

impl Renderer {
    pub fn new(gpu: &Gpu, scene: Scene) -> Self {
        let pipelines = gpu.shared(RenderPipelines::new);
        Self::with_pipelines(gpu, scene, pipelines)
    }

    /// Replaces the scene. Compiled pipelines are kept, and uploaded resources if they are the
    /// same.
    pub fn set_scene(&mut self, gpu: &Gpu, scene: Scene) {
        let revision = self.revision + 1;
        if self.scene.has_same_resources(&scene) {
            self.scene = scene;
        } else {
            *self = Self::with_pipelines(gpu, scene, self.pipelines.clone());
        }
        self.revision = revision;
    }

    /// Changes with every change of the scene or of its lightmaps: two draws of one view by the
    /// same revision are equal.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Replaces the objects. They use the scene's meshes; objects without parts are not drawn.
    ///
    /// # Panics
    /// If a part's mesh is not one of the scene's.
    pub fn place(&mut self, objects: &[Object]) {
        if self.scene.objects != objects {
            let meshes = self.scene.meshes.len();
            let meshes_exist = objects.iter().flat_map(|object| &object.parts).all(|part| part.mesh < meshes);
            assert!(meshes_exist, "objects of meshes that the scene does not have: it has {meshes}");
            self.scene.objects = objects.to_vec();
            self.revision += 1;
        }
    }

    fn with_pipelines(gpu: &Gpu, scene: Scene, pipelines: Arc<RenderPipelines>) -> Self {
        Self {
            meshes: Meshes::new(gpu, &scene),
            materials: bind_groups(gpu, &pipelines.material_layout, &scene),
            environment: EnvironmentLight::new(gpu, &scene.lighting.environment),
            lightmaps: PartLightmaps::new(gpu, &pipelines.lightmap_layout),
            pipelines,
            no_depth: Texture::new(gpu, "no depth", 1, 1, wgpu::TextureFormat::R32Float, 1),
            scene,
            revision: 0,
        }
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Computes lightmap coordinates for the scene's meshes, if they have none yet.
    pub fn unwrap(&mut self, gpu: &Gpu) {
        if self.meshes.unwrap(gpu, &self.scene) {
            self.revision += 1;
        }
    }

    /// The scene's meshes as drawn.
    pub fn unwrapped(&self) -> &[UnwrappedMesh] {
        &self.meshes.surfaces
    }

    /// Lightmap of each part of each object, in order, for the following draws; none: fully lit.
    /// `strength` scales the darkening.
    pub fn set_lightmaps(&mut self, gpu: &Gpu, lightmaps: &[Option<Arc<Lightmap>>], strength: f32) {
        if self.lightmaps.take(gpu, &self.pipelines.lightmap_layout, lightmaps, strength) {
            self.revision += 1;
        }
    }

    /// Warnings about requested features that are not supported.
    pub fn warnings(&self) -> Vec<String> {
        unsupported(&self.scene.lighting).into_iter().collect()
    }

    /// Footprint of the objects during the exposure.
    pub fn footprint(&self, geometry: &Geometry, keys: &ViewKeys, shutter: Shutter) -> Footprint {
        self.footprint_within(geometry, keys, shutter, &keys.middle())
    }

    /// The footprint for a part of an exposure with this pose in its middle.
    fn footprint_within(&self, geometry: &Geometry, keys: &ViewKeys, shutter: Shutter, middle: &Pose) -> Footprint {
        if geometry.needs_cube_map() {
            let bounds: Vec<_> = self.meshes.all.iter().map(|m| m.bounds).collect();
            return footprint_around(&self.scene, &bounds, geometry, keys, shutter);
        }
        let points: usize =
            self.scene.objects.iter().flat_map(|o| &o.parts).map(|p| self.meshes.all[p.mesh].outline.len()).sum();
        let outlines: Vec<Cow<'_, [DVec3]>> = self
            .meshes
            .all
            .iter()
            .map(|m| match m.bounds {
                Some(bounds) if points > MAX_OUTLINE_POINTS => bounds.corners().to_vec().into(),
                _ => m.outline.as_slice().into(),
            })
            .collect();
        footprint(&self.scene, &outlines, geometry, keys, middle)
    }

    /// The box of each part, corners in the world; empty parts are skipped.
    fn boxes(&self) -> impl Iterator<Item = [DVec3; 8]> {
        self.scene.objects.iter().flat_map(|o| &o.parts).filter_map(|part| {
            let bounds = self.meshes.all[part.mesh].bounds?;
            Some(bounds.corners().map(|c| part.world_from_mesh.transform_point3(c)))
        })
    }

    /// True if anything can be in the picture of a pinhole without distortion: some part's box is
    /// not entirely beyond one of the picture's sides.
    pub fn in_view(&self, geometry: &Geometry, pose: &Pose) -> bool {
        self.boxes().any(|corners| !out_of_view(geometry, &corners.map(|c| pose.transform_point(c))))
    }

    /// Centre of each object's bounding box in the world, metres; `None` for an empty object.
    pub fn object_centres(&self) -> Vec<Option<DVec3>> {
        self.scene
            .objects
            .iter()
            .map(|object| {
                let corners = object.parts.iter().filter_map(|part| {
                    let b = self.meshes.all[part.mesh].bounds?;
                    Some(b.corners().map(|c| part.world_from_mesh.transform_point3(c)))
                });
                let (low, high) =
                    corners.flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), c| (l.min(c), h.max(c)));
                low.is_finite().then(|| 0.5 * (low + high))
            })
            .collect()
    }

    /// Draws the plan's samples and returns their weighted sum.
    pub fn draw(&mut self, recorder: &mut PassRecorder, view: &View<'_>, plan: &SamplePlan) -> Layer {
        let size = (view.rect.width(), view.rect.height());
        let out = layer(recorder, size);
        let prepared = self.prepare(recorder, view);
        if let [sample] = plan.samples.as_slice() {
            self.draw_sample(recorder, view, (sample, plan.focus_distance_m), &prepared, &out);
            return out;
        }
        let one = layer(recorder, size);
        let sum = WeightedSum::new(&recorder.gpu, size);
        let mut last_depth_test = None;
        for (i, sample) in Occlusion::grouped_by_moment(view.occlusion.as_ref(), &plan.samples).into_iter().enumerate()
        {
            let part = self.touched_rect(view, sample, plan.focus_distance_m, &prepared);
            if !part.is_empty() {
                let one = Layer { size: (part.width(), part.height()), ..one.clone() };
                let from = ((part.x0 - view.rect.x0) as u32, (part.y0 - view.rect.y0) as u32);
                let occlusion = view.occlusion.map(|real| real.of(sample, recorder, view.rect, &mut last_depth_test));
                let view = View { rect: part, occlusion, ..*view };
                self.draw_sample(recorder, &view, (sample, plan.focus_distance_m), &prepared, &one);
                sum.add(recorder, &one, from, sample.weight);
            }
            if i % 32 == 31 {
                recorder.submit_part();
            }
        }
        sum.finish(recorder, &out);
        out
    }

    /// The rectangle that objects may touch in one sample of a plan, rounded to cells of the motion
    /// grid.
    fn touched_rect(
        &self,
        view: &View<'_>,
        sample: &RenderSample,
        focus_distance_m: f64,
        prepared: &FrameGeometry,
    ) -> Rect {
        let FrameGeometry::Plane(Draws { motion, .. }) = prepared else { return view.rect };
        let keys = view.keys.around(sample.time_s, view.shutter.readout_time_s);
        let footprint = self.footprint_within(view.geometry, &keys, view.shutter, &view.keys.middle());
        let from_lens_px = footprint.depths_m.map(|z| {
            let [x, y] = sample.lens_m.map(|c| c * view.geometry.intrinsics.fx_px * (1.0 / z - 1.0 / focus_distance_m));
            x.hypot(y)
        });
        let moved_px = sample.offsets_px.iter().map(|[x, y]| f64::from(x.hypot(*y)));
        let beside_px = from_lens_px.into_iter().fold(0.0, f64::max) + moved_px.fold(0.0, f64::max);
        motion.cells_around(&footprint.rect.grown(beside_px.ceil() as i32 + 1)).intersection(&view.rect)
    }

    /// The data shared by all samples of a view.
    fn prepare(&mut self, recorder: &mut PassRecorder, view: &View<'_>) -> FrameGeometry {
        let gpu = &recorder.gpu.clone();
        if !view.geometry.needs_cube_map() {
            let draws = self.draws(gpu, view);
            return FrameGeometry::Plane(draws);
        }
        let sides = FaceView::all(view, &self.boxes().collect::<Vec<_>>());
        let all: Vec<Draws> = sides.iter().map(|side| self.draws(gpu, &side.view(view))).collect();
        let with_layer = |side: FaceView| {
            let layer = side.layer(recorder);
            (side, layer)
        };
        FrameGeometry::Around(sides.into_iter().map(with_layer).collect(), all)
    }

    fn draw_sample(
        &mut self,
        recorder: &mut PassRecorder,
        view: &View<'_>,
        sample: (&RenderSample, f64),
        prepared: &FrameGeometry,
        out: &Layer,
    ) {
        match prepared {
            FrameGeometry::Plane(draws) => self.draw_plane(recorder, view, sample, draws, out),
            FrameGeometry::Around(sides, all) => {
                for ((side, layer), draws) in sides.iter().zip(all) {
                    self.draw_plane(recorder, &side.view(view), sample, draws, layer);
                }
                gather(recorder, view, sides, &self.no_depth, out);
            }
        }
    }

    /// Draw calls of a view, opaque ones first, then blended ones back to front, and the buffers of
    /// subdivided meshes.
    fn draws(&self, gpu: &Gpu, view: &View<'_>) -> Draws {
        let bend = EdgeCurvature::of(view.geometry, view.shutter.readout_time_s);
        let (moments, _) = view.keys.sampled();
        let (mut vertices, mut indices) = (Vec::new(), Vec::new());
        let mut draws = Vec::new();
        for (number, part) in self.scene.objects.iter().flat_map(|o| &o.parts).enumerate() {
            let gpu_mesh = &self.meshes.all[part.mesh];
            let (mesh, unwrapped) = (&self.scene.meshes[part.mesh], &self.meshes.surfaces[part.mesh]);
            let Some(bounds) = gpu_mesh.bounds else { continue };
            let corners = bounds.corners().map(|c| part.world_from_mesh.transform_point3(c));
            // Most cube faces contain nothing.
            let out = |pose: &&Pose| out_of_view(view.geometry, &corners.map(|c| pose.transform_point(c)));
            if view.outer.is_some() && moments.iter().all(out) {
                continue;
            }
            let cut =
                || dice(unwrapped, gpu_mesh.longest, &corners, &part.world_from_mesh, view.geometry, view.keys, bend);
            // Orthographic projection preserves straight lines, even behind the camera.
            let diced = view.parallel_to_m.map_or_else(cut, |_| None).map(|(v, i)| {
                let (base, start) = (vertices.len() as i32, indices.len() as u32);
                vertices.extend(v);
                indices.extend(i);
                (base, start..indices.len() as u32)
            });
            let centre = 0.5 * (corners[0] + corners[7]);
            let variant = Variant {
                colors: gpu_mesh.has_colors,
                mirrored: part.world_from_mesh.matrix3.determinant() < 0.0,
                rolling: view.shutter.readout_time_s > 0.0,
                lens: lens_number(view.outer.map_or(view.geometry, |outer| outer.geometry).distortion.model),
                around: view.outer.is_some(),
                primaries: view.primaries,
                parallel: view.parallel_to_m.is_some(),
                hidden_by_depth: view.occlusion.is_some(),
                depth_on_grid: view.occlusion.is_some_and(|occlusion| occlusion.grid_placement.is_some()),
                lightmap: self.lightmaps.has_lightmap(number),
                ..Variant::of(&self.scene.materials[mesh.material], &self.scene.lighting)
            };
            draws.push(Draw {
                part: number as u32,
                mesh: part.mesh,
                material: mesh.material,
                variant,
                diced,
                depth_m: view.keys.middle().transform_point(centre).z,
            });
        }
        let blended = |d: &Draw| d.variant.blended;
        draws.sort_by(|a, b| {
            blended(a)
                .cmp(&blended(b))
                .then_with(|| if blended(a) { b.depth_m.total_cmp(&a.depth_m) } else { a.part.cmp(&b.part) })
        });
        let buffers = (!indices.is_empty()).then(|| {
            (
                gpu.buffer("diced vertices", bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
                gpu.buffer("diced indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
            )
        });
        let lens_table = view.geometry.distortion.bound_map().map(|table| lens_table(gpu, table));
        Draws { list: draws, diced: buffers, motion: MotionGrid::new(gpu, view), lens_table }
    }

    fn instances(&self, view: &View<'_>, sample: &RenderSample) -> Vec<DrawInstance> {
        let mut out = Vec::new();
        for (object, parts) in self.scene.objects.iter().map(|o| &o.parts).enumerate() {
            let offset_px = sample.offsets_px.get(object).copied().unwrap_or_default();
            for part in parts {
                let m = part.world_from_mesh.matrix3;
                let t = part.world_from_mesh.translation - view.keys.origin_in_world_m;
                let row = |i: usize| [m.x_axis[i] as f32, m.y_axis[i] as f32, m.z_axis[i] as f32, t[i] as f32];
                let mirror = m.determinant().signum() as f32;
                out.push(DrawInstance { rows: [row(0), row(1), row(2)], mirror, offset_px });
            }
        }
        // A buffer must not be empty.
        out.resize(out.len().max(1), bytemuck::Zeroable::zeroed());
        out
    }

    fn draw_plane(
        &self,
        recorder: &mut PassRecorder,
        view: &View<'_>,
        (sample, focus_distance_m): (&RenderSample, f64),
        draws: &Draws,
        out: &Layer,
    ) {
        let gpu = &recorder.gpu.clone();
        let size = out.size;
        let uniform = ViewUniform::new(view, &draws.motion.rect, sample, focus_distance_m);
        let uniform = recorder.uniform(bytemuck::bytes_of(&uniform));
        let instances = self.instances(view, sample);
        let instances = gpu.buffer("instances", bytemuck::cast_slice(&instances), wgpu::BufferUsages::VERTEX);
        let (lighting, strength) = (&self.scene.lighting, self.lightmaps.strength);
        let light = LightUniform::new(lighting, &self.environment, view.keys.origin_in_world_m, strength);
        let light = recorder.uniform(bytemuck::bytes_of(&light));
        let depth_view = view.occlusion.map_or(&self.no_depth.view, |occlusion| &occlusion.depth.view);
        let lens_view = &draws.lens_table.as_ref().unwrap_or(&self.no_depth).view;
        let texture =
            |binding, view| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) };
        let frame = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &self.pipelines.frame_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.binding() },
                wgpu::BindGroupEntry { binding: 1, resource: light.binding() },
                texture(2, &self.environment.view),
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::Sampler(&self.environment.sampler),
                },
                texture(4, depth_view),
                texture(5, &self.environment.albedo),
                texture(6, &self.environment.irradiance),
                texture(7, lens_view),
            ],
        });
        let [color, depth] = [COLOR, DEPTH].map(|format| recorder.pool.lend_samples(gpu, size, format, SAMPLES));
        {
            let stamps = recorder.stamps();
            let mut pass = recorder.encoder().begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("raster"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &color.view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth.view,
                    depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                    stencil_ops: None,
                }),
                timestamp_writes: stamps.as_ref().map(Stamps::drawn),
                occlusion_query_set: None,
                multiview_mask: None,
            });
            pass.set_viewport(0.0, 0.0, size.0 as f32, size.1 as f32, 0.0, 1.0);
            pass.set_scissor_rect(0, 0, size.0, size.1);
            pass.set_bind_group(0, &frame, &[]);
            let blended = draws.list.iter().filter(|d| d.variant.blended).map(|d| (d, Writes::BlendedDepth));
            for (draw, writes) in draws.list.iter().map(|d| (d, Writes::Color)).chain(blended) {
                pass.set_pipeline(&self.pipelines.get(gpu, draw.variant, writes));
                pass.set_bind_group(1, &self.materials[draw.material], &[]);
                pass.set_bind_group(2, self.lightmaps.of(draw.part as usize), &[]);
                let (vertices, indices, base, range) = match (&draw.diced, &draws.diced) {
                    (Some((base, range)), Some((v, i))) => (v, i, *base, range.clone()),
                    _ => {
                        let mesh = &self.meshes.all[draw.mesh];
                        (&self.meshes.vertices, &self.meshes.indices, mesh.base_vertex, mesh.indices.clone())
                    }
                };
                pass.set_vertex_buffer(0, vertices.slice(..));
                pass.set_vertex_buffer(1, instances.slice(..));
                pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(range, base, draw.part..draw.part + 1);
            }
        }
        let motion = &draws.motion;
        let (first, cells) = motion.cells_of(&view.rect);
        let resolve = ResolveUniform {
            size: [size.0 as f32, size.1 as f32],
            first: [first.0, first.1],
            columns: cells.0,
            net_columns: motion.cells.0,
            side_px: motion.side_px as f32,
            near_m: NEAR_M as f32,
            far_m: view.parallel_to_m.unwrap_or(0.0) as f32,
        };
        recorder
            .pass(Shader::Resolve, ShaderEntry::with_vertex("cell", "main"))
            .uniform("resolve", &resolve)
            .texture("color", &color)
            .texture("depth", &depth)
            .buffer("nodes", &motion.nodes)
            .tiles(cells.0 * cells.1)
            .draw_into(&[&out.color, &out.geometry], size);
    }
}

crate::uniform! {
    struct ResolveUniform {
        size: [f32; 2],
        first: [u32; 2],
        columns: u32,
        net_columns: u32,
        side_px: f32,
        near_m: f32,
        far_m: f32,
    }
}

/// An empty layer to draw into.
fn layer(recorder: &PassRecorder, size: (u32, u32)) -> Layer {
    let lend = |format| recorder.pool.lend(&recorder.gpu, size, format);
    Layer::new(lend(COLOR), lend(GEOMETRY), size)
}
