//! The fraction of the real light that virtual objects remove, at each pixel of a frame.
//!
//! A planar shadow (shadow/) lies on a receiver plane. The intersection of a pixel's ray r with it
//! is a homography of the ray: [u/t, v/t, 1/t] = H·r, with u, v in texels of the planar shadow and
//! t the distance along the ray. Each row has its own pose (rolling shutter), and so has each
//! sample of the exposure. H is computed here in double precision for the edges between tiles of
//! the picture; H·r is interpolated across tiles in which rays are straight enough. Drivers
//! interpolate relative to the region that is drawn, so that two regions of a picture may differ in
//! the last bit.
//!
//! A real object on or before the receiver is not darkened: only pixels whose depth is within a
//! tolerance of the plane are. At the object's edge a pixel shows I = α·F + (1 − α)·B, with the
//! alpha matte α that occludes virtual objects too (depth/matte.rs). The shadow applies to
//! (1 − α)·B alone.
//!
//! Not modelled: the lens's blur of a shadow's edge beyond a pixel's width; mattes where the shadow
//! removes less than a twentieth of the light, where the measured depth is used as it is; edges of
//! objects lower than the depth step that counts as an edge.
use glam::{DMat3, DVec2, DVec3, Vec3};

use super::ray_grid::{RAY_GRID_PX, RayGrid};
use super::settings::ShadowSettings;
use crate::camera::Geometry;
use crate::depth::{PLANE_TOLERANCE_M, PLANE_TOLERANCE_PER_DEPTH2};
use crate::gpu::{Gpu, PassRecorder, Shader, ShaderEntry, Texture, half_texels};
use crate::memo::ByAddress;
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::render::{COLOR, Shutter, ViewKeys};
use crate::shadow::{PlanarShadow, ShadowTexture, UvRect};

/// Samples over the exposure; the same number as in shaders/shadow_mask.wgsl, by a test.
const EXPOSURE_SAMPLES: usize = 4;
/// Subdivisions of each side of a planar shadow. Their ends are projected for its bounds in the
/// picture.
const SIDE_INTERVALS: usize = 8;
/// D + (1 − D)·d: transmittances 1 − d of overlapping planar shadows multiply.
const MULTIPLY_TRANSMITTANCES: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::OneMinusDst,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
    alpha: wgpu::BlendComponent::REPLACE,
};
/// Largest width of the atlas of planar shadows, texels.
const MAX_ATLAS_WIDTH: u32 = 4096;

crate::uniform! {
    struct ShadowMaskUniform {
        in_picture: [f32; 2],
        part_px: [f32; 2],
        in_depth: [f32; 2],
        in_matte: [f32; 2],
        per_texel: [f32; 2],
        depth_size: [i32; 2],
        matte_size: [i32; 2],
        size: [i32; 2],
        per_step: f32,
        round_px: f32,
        strength: f32,
        opacity: f32,
        tolerance_m: f32,
        per_depth2: f32,
        tile_px: i32,
    }
}

/// `PlanarShadow` in shaders/shadow_mask.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct PlanarShadowUniform {
    rect_px: [f32; 4],
    in_atlas: [f32; 2],
    size: [f32; 2],
    height_m: f32,
    unmeasured: f32,
    unused: [f32; 2],
}

/// `Tile` in shaders/shadow_mask.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct TileUniform {
    at_px: [i32; 2],
    planar_shadow: u32,
    homography: u32,
}

/// A planar shadow in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct VisibleShadow {
    planar_shadow: PlanarShadow,
    /// Bounds of its shadow while the shutter is open.
    rect: Rect,
    /// Bounds of its dark part.
    dark_rect: Rect,
    /// Height of the camera over the receiver plane, m.
    height_m: f64,
}

/// The planar shadows in view.
pub fn visible_shadows(planar_shadows: Vec<PlanarShadow>, geometry: &Geometry, keys: &ViewKeys) -> Vec<VisibleShadow> {
    let i = &geometry.intrinsics;
    let picture = Rect::full(i.width_px, i.height_px);
    let visible = |planar_shadow: PlanarShadow| {
        let height_m = planar_shadow.plane.height_m(keys.middle().position_in_world_m());
        let [rect, dark_rect] = [planar_shadow.texture.visible_bounds, planar_shadow.texture.dark_bounds]
            .map(|part| projected_bounds(&planar_shadow, part, geometry, keys).map(|rect| rect.intersection(&picture)));
        let (rect, dark_rect) = (rect?, dark_rect.unwrap_or(Rect::new(0, 0, 0, 0)));
        (height_m > 0.0 && !rect.is_empty()).then_some(VisibleShadow { planar_shadow, rect, dark_rect, height_m })
    };
    planar_shadows.into_iter().filter_map(visible).collect()
}

/// Bounds of all shadows.
pub fn union_of_rects(shadows: &[VisibleShadow]) -> Rect {
    shadows.iter().fold(Rect::new(0, 0, 0, 0), |all, shadow| all.union(&shadow.rect))
}

/// Bounds of the dark parts of all shadows.
pub fn union_of_dark_rects(shadows: &[VisibleShadow]) -> Rect {
    shadows.iter().fold(Rect::new(0, 0, 0, 0), |all, shadow| all.union(&shadow.dark_rect))
}

/// Bounds of a part of a planar shadow in the picture. The whole picture if some of the part is
/// beside or behind the camera; `None` if all of it is, or if the part is empty.
fn projected_bounds(planar_shadow: &PlanarShadow, part: UvRect, geometry: &Geometry, keys: &ViewKeys) -> Option<Rect> {
    let (poses, _) = keys.sampled();
    if part.is_empty() {
        return None;
    }
    let sides = (0..=SIDE_INTERVALS).map(|n| n as f64 / SIDE_INTERVALS as f64);
    let at = |x: f64, y: f64| part.low + (part.high - part.low) * DVec2::new(x, y);
    let points =
        sides.clone().flat_map(|y| sides.clone().map(move |x| at(x, y))).map(|at| planar_shadow.at(at.x, at.y));
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (mut is_unbounded, mut is_visible) = (geometry.is_equirectangular(), false);
    for point in points {
        for pose in &poses {
            match geometry.project(pose.transform_point(point)) {
                Some(at) => (low, high, is_visible) = (low.min(at), high.max(at), true),
                None => is_unbounded = true,
            }
        }
    }
    let i = &geometry.intrinsics;
    let whole = Rect::full(i.width_px, i.height_px);
    let clamp = |v: f64| v.clamp(-1e6, 1e6);
    let rect = Rect::new(
        clamp(low.x).floor() as i32,
        clamp(low.y).floor() as i32,
        clamp(high.x).ceil() as i32,
        clamp(high.y).ceil() as i32,
    );
    // A margin of 1 px for poses between the sampled ones, and of 1 px for points between the
    // projected ones.
    is_visible.then(|| if is_unbounded { whole } else { rect.grown(2) })
}

/// Shadow textures packed into one.
#[derive(Clone, Debug)]
struct Atlas {
    texture: Texture,
    size: [u32; 2],
    /// First texel of each.
    origins: Vec<[u32; 2]>,
}

/// Key of an atlas.
#[derive(PartialEq)]
struct AtlasKey(Vec<ByAddress<ShadowTexture>>);

impl Atlas {
    /// Packs shadow textures in rows, each as high as its highest texture. Textures beyond the
    /// device's largest size are left out.
    fn new(gpu: &Gpu, AtlasKey(planar_shadows): &AtlasKey) -> Self {
        let max_side = gpu.max_side_px();
        let (mut origins, mut at, mut row) = (Vec::new(), [0, 0], 0);
        let (mut width, mut height) = (1, 1);
        for planar_shadow in planar_shadows {
            if at[0] + planar_shadow.width > MAX_ATLAS_WIDTH.min(max_side) {
                (at, row) = ([0, at[1] + row], 0);
            }
            origins.push(at);
            (width, height, row) = (
                width.max(at[0] + planar_shadow.width),
                height.max(at[1] + planar_shadow.height),
                row.max(planar_shadow.height),
            );
            at[0] += planar_shadow.width;
        }
        let height = height.min(max_side);
        let texture = Texture::new(gpu, "shadows", width, height, COLOR, 1);
        let mut texels = vec![[0.0f32; 4]; width as usize * height as usize];
        for (planar_shadow, [x, y]) in planar_shadows.iter().zip(&origins) {
            for (row, removed) in (*y..height).zip(planar_shadow.removed.chunks_exact(planar_shadow.width as usize)) {
                let start = row as usize * width as usize + *x as usize;
                let out = &mut texels[start..start + removed.len()];
                out.iter_mut().zip(removed).for_each(|(out, [r, g, b])| *out = [*r, *g, *b, 0.0]);
            }
        }
        texture.write(gpu, width, height, &half_texels(&texels));
        Self { texture, size: [width, height], origins }
    }
}

/// Whether a tile of the picture contains no shadow of a planar shadow, by the homographies of its
/// upper and its lower edge.
fn is_unshadowed(texture: &ShadowTexture, rays: &RayGrid, at_px: [i32; 2], homographies: &[[[f32; 4]; 3]]) -> bool {
    let side = rays.tile_px;
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for (homographies, y) in homographies.chunks(EXPOSURE_SAMPLES).zip([at_px[1], at_px[1] + side]) {
        for x in [at_px[0], at_px[0] + side] {
            let Some(ray) = rays.at(x, y) else { return false };
            for homography in homographies {
                let [x, y, z] = homography.map(|[x, y, z, _]| f64::from(Vec3::new(x, y, z).dot(ray)));
                if z < 1e-6 {
                    return false;
                }
                let texel = DVec2::new(x, y) / z;
                (low, high) = (low.min(texel), high.max(texel));
            }
        }
    }
    // Each sample of the exposure has its own subpixel offset.
    let pixel = (high - low) / f64::from(side);
    texture.is_unshadowed(low - pixel, high + pixel)
}

/// The inputs of [`shadow_mask`].
#[derive(Debug)]
pub struct ShadowMaskRequest<'a> {
    pub geometry: &'a Geometry,
    pub keys: &'a ViewKeys,
    pub shutter: Shutter,
    /// The part of the picture, which may extend beyond it.
    pub part: Rect,
    /// Depth of the real scene over a rectangle that contains the part, m, 0 if unknown.
    pub depth: Option<(&'a Texture, Rect)>,
    /// Second surfaces of a rectangle's pixels: their share of each channel's light, and their
    /// depth, 0 for pixels with a single surface.
    pub matte: Option<(&'a Texture, Rect)>,
    pub settings: &'a ShadowSettings,
    /// Opacity of the virtual layer.
    pub opacity: f64,
}

/// The fraction of the real light that is removed, over a part of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowMask {
    pub texture: Texture,
    /// Outside these rectangles of the picture it is 0.
    pub pieces: Vec<Rect>,
}

/// Records the pass, over `request.part`. `None` if no shadow is in it, or if its strength is 0.
pub fn shadow_mask(
    recorder: &mut PassRecorder,
    shadows: &[VisibleShadow],
    request: &ShadowMaskRequest<'_>,
) -> Option<ShadowMask> {
    if shadows.is_empty() || request.part.is_empty() || request.settings.strength <= 0.0 {
        return None;
    }
    let ShadowMaskRequest { geometry, part, settings, .. } = *request;
    let key = AtlasKey(shadows.iter().map(|shadow| shadow.planar_shadow.texture.clone()).collect());
    let atlas = recorder.memoized_large(key, Atlas::new);
    let rays = recorder.memoized_large(geometry.clone(), RayGrid::new);
    let tile_px = rays.tile_px;
    let (mut planar_shadows, mut tiles, mut homographies) = (Vec::new(), Vec::new(), Vec::new());
    for (shadow, in_atlas) in shadows.iter().zip(&atlas.origins) {
        let rect = shadow.rect.intersection(&part);
        let texture = &shadow.planar_shadow.texture;
        if !rect.is_empty() && in_atlas[1] + texture.height <= atlas.size[1] {
            // Tiles are aligned to the picture, not to the part.
            let first = rect.y0.div_euclid(tile_px) * tile_px;
            let mut lines = Vec::new();
            for y in (first..rect.y1).step_by(tile_px as usize) {
                let first = homographies.len();
                homographies.extend(
                    (0..EXPOSURE_SAMPLES).map(|sample| row_homography(&shadow.planar_shadow, request, y, sample)),
                );
                lines.push((y, first));
            }
            let last = rect.y1 + (tile_px - rect.y1.rem_euclid(tile_px)) % tile_px;
            homographies.extend(
                (0..EXPOSURE_SAMPLES).map(|sample| row_homography(&shadow.planar_shadow, request, last, sample)),
            );
            let x0 = rect.x0.div_euclid(tile_px) * tile_px;
            for (y, first) in lines {
                let [planar_shadow, homography] = [planar_shadows.len(), first].map(|index| index as u32);
                let both = &homographies[first..first + 2 * EXPOSURE_SAMPLES];
                let along = (x0..rect.x1).step_by(tile_px as usize).map(|x| [x, y]);
                let shadowed = along.filter(|at_px| !is_unshadowed(texture, &rays, *at_px, both));
                tiles.extend(shadowed.map(|at_px| TileUniform { at_px, planar_shadow, homography }));
            }
        }
        let all = shadow.rect;
        planar_shadows.push(PlanarShadowUniform {
            rect_px: [all.x0, all.y0, all.x1, all.y1].map(|edge| edge as f32),
            in_atlas: in_atlas.map(|at| at as f32),
            size: [texture.width as f32, texture.height as f32],
            height_m: shadow.height_m as f32,
            unmeasured: f32::from(u8::from(!shadow.planar_shadow.is_beside)),
            unused: [0.0; 2],
        });
    }
    if tiles.is_empty() {
        return None;
    }
    let around = request.depth.map_or(part, |(_, rect)| rect);
    let matte = request.matte.map_or(Rect::new(part.x0, part.y0, part.x0, part.y0), |(_, rect)| rect);
    let uniform = ShadowMaskUniform {
        in_picture: [part.x0 as f32, part.y0 as f32],
        part_px: [part.width() as f32, part.height() as f32],
        in_depth: [(part.x0 - around.x0) as f32, (part.y0 - around.y0) as f32],
        in_matte: [(part.x0 - matte.x0) as f32, (part.y0 - matte.y0) as f32],
        per_texel: atlas.size.map(|side| (side as f32).recip()),
        depth_size: [around.width() as i32, around.height() as i32],
        matte_size: [matte.width() as i32, matte.height() as i32],
        size: rays.size.map(|side| side as i32),
        per_step: 1.0 / RAY_GRID_PX as f32,
        round_px: if geometry.is_equirectangular() { geometry.intrinsics.width_px as f32 } else { 0.0 },
        strength: settings.strength,
        opacity: request.opacity as f32,
        tolerance_m: PLANE_TOLERANCE_M as f32,
        per_depth2: PLANE_TOLERANCE_PER_DEPTH2,
        tile_px,
    };
    let count = tiles.len() as u32;
    let rect = |[x, y]: [i32; 2]| Rect::new(x, y, x + tile_px, y + tile_px);
    let drawn = tiles.iter().map(|tile| rect(tile.at_px)).collect();
    let [planar_shadows, tiles, homographies] =
        [bytemuck::cast_slice(&planar_shadows), bytemuck::cast_slice(&tiles), bytemuck::cast_slice(&homographies)]
            .map(|bytes| recorder.storage(bytes));
    let entry = ShaderEntry::with_vertex("tile", "main").choose("has_depth", request.depth.is_some());
    let entry = entry.choose("has_matte", request.matte.is_some());
    let pass = recorder.pass(Shader::ShadowMask, entry).uniform("shadow_mask", &uniform).texture("rays", &rays.texture);
    let pass = pass.texture("atlas", &atlas.texture).buffer("planar_shadows", planar_shadows);
    let pass = pass.buffer("tiles", tiles).buffer("homographies", homographies);
    let pass = pass.texture("real_depth", request.depth.map_or(&rays.texture, |(depth, _)| depth));
    let pass = pass.texture("matte", request.matte.map_or(&rays.texture, |(matte, _)| matte));
    let pass = pass.tiles(count).blend(MULTIPLY_TRANSMITTANCES);
    let [texture] = pass.draw([COLOR], (part.width(), part.height()));
    Some(ShadowMask { texture, pieces: drawn })
}

/// Homography from a ray in the camera's axes to the planar shadow, for the line above a row of the
/// picture at a sample of its exposure.
fn row_homography(
    planar_shadow: &PlanarShadow,
    request: &ShadowMaskRequest<'_>,
    row: i32,
    sample: usize,
) -> [[f32; 4]; 3] {
    let ShadowMaskRequest { geometry, keys, shutter, .. } = *request;
    let down = f64::from(row) / f64::from(geometry.intrinsics.height_px) - 0.5;
    let within = (sample as f64 + 0.5) / EXPOSURE_SAMPLES as f64 - 0.5;
    let (rotation, eye) = keys.at(down * shutter.readout_time_s + within * shutter.exposure_time_s);
    let pose = Pose::from_camera_in_world(eye + keys.origin_in_world_m, rotation.inverse());
    homography(planar_shadow, &pose).to_cols_array_2d().map(|[x, y, z]| [x as f32, y as f32, z as f32, 0.0])
}

/// The transpose of H: each column's dot product with a ray gives one coordinate.
///
/// A ray r from the eye e meets the plane at e + t·R·r, where its height h + t·(n·R·r) is 0:
/// 1/t = −(n·R·r)/h. Along an axis a of the plane, from the planar shadow's corner c:
/// (a·(e − o) − c)/t + a·R·r.
fn homography(planar_shadow: &PlanarShadow, pose: &Pose) -> DMat3 {
    let (plane, texture) = (&planar_shadow.plane, &planar_shadow.texture);
    let eye = pose.position_in_world_m();
    let world_from_camera = DMat3::from_quat(pose.world_from_camera_rotation());
    // Row vectors: aᵀR is Rᵀa.
    let in_camera = |axis: DVec3| world_from_camera.transpose() * axis;
    let inverse_t = -in_camera(plane.normal()) / plane.height_m(eye);
    let texel_m = f64::from(texture.texel_m);
    let column = |axis: DVec3, low: f32| {
        let from_corner = axis.dot(eye - plane.origin_m) - f64::from(low);
        (in_camera(axis) + inverse_t * from_corner) / texel_m
    };
    DMat3::from_cols(column(plane.axes.x_axis, texture.low_m.x), column(plane.axes.y_axis, texture.low_m.y), inverse_t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::FAR_M;
    use crate::gpu::constant;
    use crate::shadow::ReceiverPlane;
    use glam::{DQuat, Vec2};
    use std::sync::Arc;

    #[test]
    fn constants_equal_the_shaders() {
        let shader = Shader::ShadowMask.module();
        let value = |name| constant(&shader, name);
        assert_eq!([value("EXPOSURE_SAMPLES"), value("FAR_M")], [EXPOSURE_SAMPLES as f64, f64::from(FAR_M)]);
    }

    #[test]
    fn homography_maps_the_ray_to_a_point_to_its_texel_and_depth() {
        let plane = ReceiverPlane::new(DVec3::new(0.2, -0.1, 0.5), DVec3::new(0.1, -0.9, 0.2).normalize());
        let texture = ShadowTexture::empty(Vec2::new(-0.3, -0.2), 0.002, 400, 300);
        let planar_shadow = PlanarShadow { plane, texture: ByAddress(Arc::new(texture)), is_beside: false };
        let pose = Pose::from_camera_in_world(
            DVec3::new(0.3, -1.2, -0.4),
            DQuat::from_scaled_axis(DVec3::new(-0.9, 0.2, 0.1)),
        );
        let h = homography(&planar_shadow, &pose);
        for place in [DVec2::new(0.1, 0.05), DVec2::new(-0.25, 0.3)] {
            let point = pose.transform_point(plane.at(place));
            let ray = point / point.z;
            let projected = h.transpose() * ray;
            let texel = (place - DVec2::new(-0.3, -0.2)) / 0.002;
            assert!((projected.truncate() / projected.z).abs_diff_eq(texel, 1e-4), "{projected}, {texel}");
            assert!((1.0 / projected.z - point.z).abs() < 1e-6, "{} {}", 1.0 / projected.z, point.z);
        }
    }
}
