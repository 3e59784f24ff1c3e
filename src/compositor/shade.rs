//! The share of the real light that virtual things take, at each pixel of a frame.
//!
//! A shadow map (shadow/) lies on a plane. The intersection of a pixel's ray r with it is a homography of the ray:
//! [u/t, v/t, 1/t] = H·r, with u, v in texels of the shadow map and t the distance along the ray. Each row has a pose of its own, and
//! so has each sample of the exposure. H is computed here in double precision for the edges between tiles of the picture; H·r is
//! interpolated across tiles in which rays are straight enough. Drivers interpolate relative to the region that is drawn, so that
//! two regions of a picture may differ in the last bit.
//!
//! A real thing that stands on or before the floor is not darkened: only what depth shows within a tolerance of the plane is. At
//! the thing's edge a pixel shows I = α·F + (1 − α)·B, with the matte α by which it hides virtual things too (depth/matte.rs). The
//! shadow takes its share of (1 − α)·B alone.
//!
//! Not modelled: the lens's blur of a shadow's edge beyond a pixel's width; mattes where the shadow takes less than a twentieth of
//! the light, where depth is taken as it was measured; edges of things lower than the step in depth that counts as an edge.

use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::settings::Shade;
use crate::camera::Geometry;
use crate::depth::SENSOR_ERROR;
use crate::gpu::{Entry, Gpu, Recorder, Shader, Texture, half_texels};
use crate::parallel::{over_rows, processors};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::render::{COLOR, Shutter, ViewKeys};
use crate::shadow::{Part, ShadowMap, ShadowTexture, TOLERANCE_M};

/// Moments of an exposure; the same as in shaders/shade.wgsl.
const MOMENTS: usize = 4;
/// Pixels between two rays of the grid: between them a lens bends rays by less than a thousandth of a pixel.
const STEP_PX: u32 = 8;
/// Sides of the pieces in which a shadow map is drawn, px: the largest within which rays are straight to `STRAIGHT_PX`. The least is a
/// cell of the grid.
const PIECES_PX: [i32; 3] = [32, 16, STEP_PX as i32];
const STRAIGHT_PX: f64 = 0.1;
/// Points along each side of a shadow map by which its place in the picture is found.
const ALONG: usize = 8;
/// What lies within [`TOLERANCE_M`] of the floor is the floor; farther away, within three times the error of a structured-light
/// sensor, 1/m.
const PER_DEPTH2: f32 = 3.0 * SENSOR_ERROR as f32;
/// D + (1 − D)·d: transmittances 1 − d of overlapping shadow maps multiply.
const OF_WHAT_IS_LEFT: wgpu::BlendState = wgpu::BlendState {
    color: wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::OneMinusDst,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    },
    alpha: wgpu::BlendComponent::REPLACE,
};
/// The widest atlas of shadow maps, texels.
const WIDEST: u32 = 4096;

crate::uniform! {
    struct ShadeUniform {
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
        presence: f32,
        tolerance_m: f32,
        per_depth2: f32,
        piece_px: i32,
    }
}

/// `ShadowMap` in shaders/shade.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct ShadowMapUniform {
    rect_px: [f32; 4],
    in_atlas: [f32; 2],
    size: [f32; 2],
    height_m: f32,
    unmeasured: f32,
    unused: [f32; 2],
}

/// `Piece` there.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct PieceUniform {
    at_px: [i32; 2],
    shadow_map: u32,
    turn: u32,
}

/// A shadow map in a picture.
#[derive(Clone, Debug)]
pub struct Seen {
    shadow_map: ShadowMap,
    /// Where it can be while the shutter is open, and where it is dark.
    rect: Rect,
    dark: Rect,
    /// Of the camera over the floor, metres.
    height_m: f64,
}

/// The shadow maps that can be seen in a picture.
pub fn seen(shadow_maps: Vec<ShadowMap>, geometry: &Geometry, keys: &ViewKeys) -> Vec<Seen> {
    let i = &geometry.intrinsics;
    let picture = Rect::full(i.width_px, i.height_px);
    let place = |shadow_map: ShadowMap| {
        let height_m = shadow_map.floor.height_m(keys.middle().position_in_world_m());
        let [rect, dark] = [shadow_map.texture.shown, shadow_map.texture.dark]
            .map(|part| rect_of(&shadow_map, part, geometry, keys).map(|rect| rect.intersection(&picture)));
        let (rect, dark) = (rect?, dark.unwrap_or(Rect::new(0, 0, 0, 0)));
        (height_m > 0.0 && !rect.is_empty()).then_some(Seen { shadow_map, rect, dark, height_m })
    };
    shadow_maps.into_iter().filter_map(place).collect()
}

/// The rectangle around all of them.
pub fn around(seen: &[Seen]) -> Rect {
    seen.iter().fold(Rect::new(0, 0, 0, 0), |all, seen| all.union(&seen.rect))
}

/// That around where they are dark.
pub fn dark(seen: &[Seen]) -> Rect {
    seen.iter().fold(Rect::new(0, 0, 0, 0), |all, seen| all.union(&seen.dark))
}

/// Where a part of a shadow map can be in the picture. All of the picture if some of it is beside or behind the camera; `None` if all
/// is, or if there is nothing.
fn rect_of(shadow_map: &ShadowMap, part: Part, geometry: &Geometry, keys: &ViewKeys) -> Option<Rect> {
    let (poses, _) = keys.sampled();
    if part.is_empty() {
        return None;
    }
    let sides = (0..=ALONG).map(|n| n as f64 / ALONG as f64);
    let at = |x: f64, y: f64| part.low + (part.high - part.low) * DVec2::new(x, y);
    let places = sides.clone().flat_map(|y| sides.clone().map(move |x| at(x, y))).map(|at| shadow_map.at(at.x, at.y));
    let (mut low, mut high, mut lost, mut found) = (DVec2::INFINITY, DVec2::NEG_INFINITY, geometry.is_round(), false);
    for point in places {
        for pose in &poses {
            match geometry.project(pose.transform_point(point)) {
                Some(at) => (low, high, found) = (low.min(at), high.max(at), true),
                None => lost = true,
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
    // A pixel for the ends of the exposure between the sampled poses, and one for what lies between the points.
    found.then(|| if lost { whole } else { rect.grown(2) })
}

/// Shadow textures packed into one.
#[derive(Clone, Debug)]
struct Atlas {
    texture: Texture,
    size: [u32; 2],
    /// Where each begins.
    places: Vec<[u32; 2]>,
}

/// By identity: shadow maps that were worked out once are not compared again.
struct Together(Vec<Arc<ShadowTexture>>);

impl PartialEq for Together {
    fn eq(&self, other: &Self) -> bool {
        self.0.len() == other.0.len() && self.0.iter().zip(&other.0).all(|(a, b)| Arc::ptr_eq(a, b))
    }
}

impl Atlas {
    /// Packs shadow textures in rows, each as high as its highest texture. Those beyond the device's largest size are left out.
    fn new(gpu: &Gpu, Together(shadow_maps): &Together) -> Self {
        let most = gpu.max_side_px();
        let (mut places, mut at, mut row) = (Vec::new(), [0, 0], 0);
        let (mut width, mut height) = (1, 1);
        for shadow_map in shadow_maps {
            if at[0] + shadow_map.width > WIDEST.min(most) {
                (at, row) = ([0, at[1] + row], 0);
            }
            places.push(at);
            (width, height, row) = (
                width.max(at[0] + shadow_map.width),
                height.max(at[1] + shadow_map.height),
                row.max(shadow_map.height),
            );
            at[0] += shadow_map.width;
        }
        let height = height.min(most);
        let texture = Texture::new(gpu, "shadows", width, height, COLOR, 1);
        let mut texels = vec![[0.0f32; 4]; width as usize * height as usize];
        for (shadow_map, [x, y]) in shadow_maps.iter().zip(&places) {
            for (row, shares) in (*y..height).zip(shadow_map.taken.chunks_exact(shadow_map.width as usize)) {
                let start = row as usize * width as usize + *x as usize;
                let out = &mut texels[start..start + shares.len()];
                out.iter_mut().zip(shares).for_each(|(out, [r, g, b])| *out = [*r, *g, *b, 0.0]);
            }
        }
        texture.write(gpu, width, height, &half_texels(&texels));
        Self { texture, size: [width, height], places }
    }
}

/// The rays through every eighth pixel's corner.
#[derive(Clone, Debug)]
struct Rays {
    texture: Texture,
    /// The same, 1 in the last place where there is one.
    nodes: Arc<[[f32; 4]]>,
    size: [u32; 2],
    piece_px: i32,
}

impl Rays {
    fn new(gpu: &Gpu, geometry: &Geometry) -> Self {
        let i = &geometry.intrinsics;
        let size = [i.width_px, i.height_px].map(|side| side.div_ceil(STEP_PX).max(1) + 1);
        let mut texels = vec![[0.0f32; 4]; size[0] as usize * size[1] as usize];
        over_rows(&mut texels, size[0] as usize, processors(), |y, row| {
            for (x, texel) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64, y as f64) * f64::from(STEP_PX);
                if let Some(ray) = geometry.depth_ray(at) {
                    *texel = ray.as_vec3().extend(1.0).to_array();
                }
            }
        });
        let texture = Texture::new(gpu, "rays", size[0], size[1], wgpu::TextureFormat::Rgba32Float, 1);
        texture.write(gpu, size[0], size[1], &texels);
        Self { texture, nodes: texels.into(), size, piece_px: piece_px(geometry) }
    }

    /// The ray through a corner of the grid's cells, if there is one.
    fn at(&self, x_px: i32, y_px: i32) -> Option<Vec3> {
        let [column, row] = [(x_px, 0), (y_px, 1)].map(|(at, axis)| {
            let node = at / STEP_PX as i32;
            usize::try_from(node).ok().filter(|node| *node < self.size[axis] as usize)
        });
        let [x, y, z, known] = self.nodes[row? * self.size[0] as usize + column?];
        (known > 0.0).then(|| Vec3::new(x, y, z))
    }
}

/// Whether a piece of the picture shows none of a shadow map's shadow. `turns` are those of its upper and its lower line.
fn is_bare(shares: &ShadowTexture, rays: &Rays, at_px: [i32; 2], turns: &[[[f32; 4]; 3]]) -> bool {
    let side = rays.piece_px;
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for (turns, y) in turns.chunks(MOMENTS).zip([at_px[1], at_px[1] + side]) {
        for x in [at_px[0], at_px[0] + side] {
            let Some(ray) = rays.at(x, y) else { return false };
            for turn in turns {
                let [x, y, z] = turn.map(|[x, y, z, _]| f64::from(Vec3::new(x, y, z).dot(ray)));
                if z < 1e-6 {
                    return false;
                }
                let texel = DVec2::new(x, y) / z;
                (low, high) = (low.min(texel), high.max(texel));
            }
        }
    }
    // Within a pixel each moment has a place of its own.
    let beside = (high - low) / f64::from(side);
    shares.is_none_between(low - beside, high + beside)
}

/// The side of pieces in which this camera's rays are straight.
fn piece_px(geometry: &Geometry) -> i32 {
    let (i, [largest, .., least]) = (&geometry.intrinsics, PIECES_PX);
    let side = f64::from(largest);
    let off_px = |x: u32, y: u32| {
        let ray = |across: f64, down: f64| {
            geometry.depth_ray(side * (DVec2::new(x.into(), y.into()) + DVec2::new(across, down)))
        };
        // A piece is two triangles, so its middle lies on a diagonal of it.
        let middle = ray(0.5, 0.5)?;
        let [one, other] = [(ray(0.0, 0.0)?, ray(1.0, 1.0)?), (ray(1.0, 0.0)?, ray(0.0, 1.0)?)]
            .map(|(from, to)| middle.distance(0.5 * (from + to)) * i.fx_px.max(i.fy_px));
        Some(one.max(other))
    };
    let [columns, rows] = [i.width_px, i.height_px].map(|length| length.div_ceil(largest as u32));
    let pieces = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let Some(off_px) = pieces.map(|(x, y)| off_px(x, y)).try_fold(0.0, |most, off| Some(f64::max(most, off?))) else {
        return least;
    };
    // What is missed grows with the square of the side.
    let is_straight = |piece_px: &i32| off_px * (f64::from(*piece_px) / side).powi(2) <= STRAIGHT_PX;
    PIECES_PX.into_iter().find(is_straight).unwrap_or(least)
}

/// What is asked of a picture's shade.
#[derive(Debug)]
pub struct Asked<'a> {
    pub geometry: &'a Geometry,
    pub keys: &'a ViewKeys,
    pub shutter: Shutter,
    /// The part of the picture, which may extend beyond it.
    pub part: Rect,
    /// The real scene's depth over a rectangle around that part, metres, 0 where unknown.
    pub depth: Option<(&'a Texture, Rect)>,
    /// Second surfaces of the pixels of a rectangle: their share of each colour's light, and their depth, 0 where there is one
    /// surface alone.
    pub matte: Option<(&'a Texture, Rect)>,
    pub settings: &'a Shade,
    /// The share of the virtual layer that is seen.
    pub presence: f64,
}

/// The share of the real light that is taken, over a part of the picture.
#[derive(Debug)]
pub struct Shaded {
    pub texture: Texture,
    /// Beyond these pieces of the picture it is 0.
    pub pieces: Vec<Rect>,
}

/// Records the pass, over `part`. `None` where no shadow map is in it.
pub fn shade(recorder: &mut Recorder, seen: &[Seen], asked: &Asked<'_>) -> Option<Shaded> {
    if seen.is_empty() || asked.part.is_empty() {
        return None;
    }
    let Asked { geometry, part, settings, .. } = *asked;
    let atlas =
        recorder.memoized_large(Together(seen.iter().map(|s| s.shadow_map.texture.clone()).collect()), Atlas::new);
    let rays = recorder.memoized_large(geometry.clone(), Rays::new);
    let piece_px = rays.piece_px;
    let (mut shadow_maps, mut pieces, mut turns) = (Vec::new(), Vec::new(), Vec::new());
    for (seen, in_atlas) in seen.iter().zip(&atlas.places) {
        let rect = seen.rect.intersection(&part);
        let shares = &seen.shadow_map.texture;
        if !rect.is_empty() && in_atlas[1] + shares.height <= atlas.size[1] {
            // Pieces lie at the same places of the picture whichever part of it is asked for.
            let first = rect.y0.div_euclid(piece_px) * piece_px;
            let mut lines = Vec::new();
            for y in (first..rect.y1).step_by(piece_px as usize) {
                let first = turns.len();
                turns.extend((0..MOMENTS).map(|moment| turn(&seen.shadow_map, asked, y, moment)));
                lines.push((y, first));
            }
            let last = rect.y1 + (piece_px - rect.y1.rem_euclid(piece_px)) % piece_px;
            turns.extend((0..MOMENTS).map(|moment| turn(&seen.shadow_map, asked, last, moment)));
            let x0 = rect.x0.div_euclid(piece_px) * piece_px;
            for (y, first) in lines {
                let [shadow_map, turn] = [shadow_maps.len(), first].map(|index| index as u32);
                let both = &turns[first..first + 2 * MOMENTS];
                let along = (x0..rect.x1).step_by(piece_px as usize).map(|x| [x, y]);
                let shown = along.filter(|at_px| !is_bare(shares, &rays, *at_px, both));
                pieces.extend(shown.map(|at_px| PieceUniform { at_px, shadow_map, turn }));
            }
        }
        let all = seen.rect;
        shadow_maps.push(ShadowMapUniform {
            rect_px: [all.x0, all.y0, all.x1, all.y1].map(|edge| edge as f32),
            in_atlas: in_atlas.map(|at| at as f32),
            size: [shares.width as f32, shares.height as f32],
            height_m: seen.height_m as f32,
            unmeasured: f32::from(u8::from(!seen.shadow_map.is_beside)),
            unused: [0.0; 2],
        });
    }
    if pieces.is_empty() {
        return None;
    }
    let around = asked.depth.map_or(part, |(_, rect)| rect);
    let matte = asked.matte.map_or(Rect::new(part.x0, part.y0, part.x0, part.y0), |(_, rect)| rect);
    let uniform = ShadeUniform {
        in_picture: [part.x0 as f32, part.y0 as f32],
        part_px: [part.width() as f32, part.height() as f32],
        in_depth: [(part.x0 - around.x0) as f32, (part.y0 - around.y0) as f32],
        in_matte: [(part.x0 - matte.x0) as f32, (part.y0 - matte.y0) as f32],
        per_texel: atlas.size.map(|side| (side as f32).recip()),
        depth_size: [around.width() as i32, around.height() as i32],
        matte_size: [matte.width() as i32, matte.height() as i32],
        size: rays.size.map(|side| side as i32),
        per_step: 1.0 / STEP_PX as f32,
        round_px: if geometry.is_round() { geometry.intrinsics.width_px as f32 } else { 0.0 },
        strength: settings.strength,
        presence: asked.presence as f32,
        tolerance_m: TOLERANCE_M,
        per_depth2: PER_DEPTH2,
        piece_px,
    };
    let count = pieces.len() as u32;
    let rect = |[x, y]: [i32; 2]| Rect::new(x, y, x + piece_px, y + piece_px);
    let drawn = pieces.iter().map(|piece| rect(piece.at_px)).collect();
    let [shadow_maps, pieces, turns] =
        [bytemuck::cast_slice(&shadow_maps), bytemuck::cast_slice(&pieces), bytemuck::cast_slice(&turns)]
            .map(|bytes| recorder.storage(bytes));
    let entry = Entry::over("seen", "main").choose("has_depth", asked.depth.is_some());
    let entry = entry.choose("has_matte", asked.matte.is_some());
    let pass = recorder.pass(Shader::Shade, entry).uniform("shade", &uniform).texture("rays", &rays.texture);
    let pass = pass.texture("atlas", &atlas.texture).buffer("shadow_maps", shadow_maps);
    let pass = pass.buffer("pieces", pieces).buffer("turns", turns);
    let pass = pass.texture("real_depth", asked.depth.map_or(&rays.texture, |(depth, _)| depth));
    let pass = pass.texture("matte", asked.matte.map_or(&rays.texture, |(matte, _)| matte));
    let pass = pass.tiles(count).blend(OF_WHAT_IS_LEFT);
    let [texture] = pass.draw([COLOR], (part.width(), part.height()));
    Some(Shaded { texture, pieces: drawn })
}

/// From a ray in the camera's axes to the shadow map, for the line above a row of the picture at a moment of its exposure.
fn turn(shadow_map: &ShadowMap, asked: &Asked<'_>, row: i32, moment: usize) -> [[f32; 4]; 3] {
    let Asked { geometry, keys, shutter, .. } = *asked;
    let down = f64::from(row) / f64::from(geometry.intrinsics.height_px) - 0.5;
    let within = (moment as f64 + 0.5) / MOMENTS as f64 - 0.5;
    let (rotation, eye) = keys.at(down * shutter.readout_time_s + within * shutter.exposure_time_s);
    let pose = Pose::from_camera_in_world(eye + keys.origin_in_world_m, rotation.inverse());
    homography(shadow_map, &pose).to_cols_array_2d().map(|[x, y, z]| [x as f32, y as f32, z as f32, 0.0])
}

/// The transpose of H: its columns are the three things that a ray is multiplied with.
///
/// A ray r from the eye e meets the floor at e + t·R·r, where its height h + t·(n·R·r) is 0: 1/t = −(n·R·r)/h. Along an axis a
/// of the floor, from the shadow map's corner c: (a·(e − o) − c)/t + a·R·r.
fn homography(shadow_map: &ShadowMap, pose: &Pose) -> DMat3 {
    let (floor, shares) = (&shadow_map.floor, &shadow_map.texture);
    let eye = pose.position_in_world_m();
    let world_from_camera = DMat3::from_quat(pose.world_from_camera_rotation());
    // Row vectors: aᵀR is Rᵀa.
    let seen = |axis: DVec3| world_from_camera.transpose() * axis;
    let per_way = -seen(floor.normal()) / floor.height_m(eye);
    let texel_m = f64::from(shares.texel_m);
    let along = |axis: DVec3, low: f32| {
        let from_corner = axis.dot(eye - floor.origin_m) - f64::from(low);
        (seen(axis) + per_way * from_corner) / texel_m
    };
    DMat3::from_cols(along(floor.axes.x_axis, shares.low_m.x), along(floor.axes.y_axis, shares.low_m.y), per_way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shadow::Floor;
    use glam::{DQuat, Vec2};

    #[test]
    fn pieces_are_as_small_as_the_lens_bends() {
        use crate::camera::{Distortion, LensModel};
        let with = |distortion: Distortion| {
            let straight = Geometry::pinhole(640, 480, 520.0);
            piece_px(&Geometry::new(straight.intrinsics, distortion))
        };
        assert_eq!(with(Distortion::default()), 32);
        assert_eq!(with(Distortion { k1: -0.05, ..Distortion::default() }), 16);
        assert_eq!(with(Distortion { k1: 0.2624, k2: -0.9531, k3: 1.1633, ..Distortion::default() }), 8);
        assert_eq!(with(Distortion { model: LensModel::OpencvFisheye, ..Distortion::default() }), 8);
    }

    #[test]
    fn ray_meets_the_shadow_map_at_the_point() {
        let floor = Floor::new(DVec3::new(0.2, -0.1, 0.5), DVec3::new(0.1, -0.9, 0.2).normalize());
        let shares = ShadowTexture::empty(Vec2::new(-0.3, -0.2), 0.002, 400, 300);
        let shadow_map = ShadowMap { floor, texture: Arc::new(shares), is_beside: false };
        let pose = Pose::from_camera_in_world(
            DVec3::new(0.3, -1.2, -0.4),
            DQuat::from_scaled_axis(DVec3::new(-0.9, 0.2, 0.1)),
        );
        let h = homography(&shadow_map, &pose);
        for place in [DVec2::new(0.1, 0.05), DVec2::new(-0.25, 0.3)] {
            let point = pose.transform_point(floor.at(place));
            let ray = point / point.z;
            let found = h.transpose() * ray;
            let texel = (place - DVec2::new(-0.3, -0.2)) / 0.002;
            assert!((found.truncate() / found.z).abs_diff_eq(texel, 1e-4), "{found}, {texel}");
            assert!((1.0 / found.z - point.z).abs() < 1e-6, "{} {}", 1.0 / found.z, point.z);
        }
    }
}
