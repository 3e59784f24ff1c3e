//! 360° and wide fisheye pictures, drawn as cube map faces, each cropped to the objects.
//! shaders/around.wgsl assembles them into one layer, on which effects and composite operate as
//! usual.

use glam::{DVec2, DVec3};

use super::around_bounds::max_speed_px_per_s;
use super::pipeline::{COLOR, GEOMETRY};
use super::plan::Layer;
use super::resample::{CubeFace, square_view};
use super::view::{NEAR_M, Outer, View, ViewKeys};
use crate::camera::{Geometry, LensModel};
use crate::gpu::{PassRecorder, Shader, ShaderEntry, Texture};
use crate::pixels::Rect;
use crate::pose::Pose;

/// Texels of a face per pixel, along each side, where texels are coarsest.
const TEXELS_PER_PX: f64 = 2.0;
/// Maximum face size (90°), px; limits the memory.
const MAX_FACE_PX: f64 = 4096.0;

/// A cube face, cropped to the objects.
#[derive(Debug)]
pub struct FaceView {
    face: CubeFace,
    geometry: Geometry,
    keys: ViewKeys,
    rect: Rect,
}

/// The highest angular resolution of the picture, px per radian.
fn px_per_rad(geometry: &Geometry) -> f64 {
    let i = &geometry.intrinsics;
    if geometry.is_equirectangular() {
        // Columns near the poles are denser without showing more detail.
        return i.fy_px.max(i.fx_px);
    }
    let steepest = (0..=100)
        .map(|n| geometry.distortion.slope(f64::from(n) / 100.0 * geometry.valid_radius()))
        .fold(1.0, f64::max);
    i.fx_px.max(i.fy_px) * steepest
}

fn view_geometry(geometry: &Geometry) -> Geometry {
    square_view((2.0 * TEXELS_PER_PX * px_per_rad(geometry)).clamp(32.0, MAX_FACE_PX).ceil() as u32)
}

/// True if a box (corners in the camera's axes) lies beyond one of the sides of a pinhole's
/// picture.
pub fn out_of_view(geometry: &Geometry, corners: &[DVec3; 8]) -> bool {
    let i = &geometry.intrinsics;
    let (low, high) = (
        DVec2::new(-i.cx_px / i.fx_px, -i.cy_px / i.fy_px),
        DVec2::new((f64::from(i.width_px) - i.cx_px) / i.fx_px, (f64::from(i.height_px) - i.cy_px) / i.fy_px),
    );
    let beyond = |side: &dyn Fn(DVec3) -> f64| corners.iter().all(|&c| side(c) < 0.0);
    beyond(&|c| c.x - low.x * c.z)
        || beyond(&|c| high.x * c.z - c.x)
        || beyond(&|c| c.y - low.y * c.z)
        || beyond(&|c| high.y * c.z - c.y)
}

impl FaceView {
    /// The faces in which any of the boxes (corners in the world) is visible.
    pub fn all(view: &View<'_>, boxes: &[[DVec3; 8]]) -> Vec<Self> {
        let geometry = view_geometry(view.geometry);
        let side = geometry.intrinsics.width_px;
        CubeFace::ALL
            .into_iter()
            .filter_map(|face| {
                let turn = face.face_from_camera();
                let turned = |pose: &Pose| Pose::new(turn * pose.rotation, turn * pose.translation_m);
                let keys = ViewKeys { poses: view.keys.poses.iter().map(turned).collect(), ..view.keys.clone() };
                let rect = extent(&geometry, &keys, boxes).intersection(&Rect::full(side, side));
                (!rect.is_empty()).then(|| Self { face, geometry: geometry.clone(), keys, rect })
            })
            .collect()
    }

    /// The view for drawing this face.
    pub fn view<'a>(&'a self, of: &View<'a>) -> View<'a> {
        View {
            geometry: &self.geometry,
            keys: &self.keys,
            shutter: of.shutter,
            depths_m: of.depths_m,
            rect: self.rect,
            occlusion: None,
            parallel_to_m: None,
            primaries: of.primaries,
            outer: Some(Outer { geometry: of.geometry, camera_from_view: self.face.face_from_camera().inverse() }),
        }
    }

    /// A layer for this face.
    pub fn layer(&self, recorder: &PassRecorder) -> Layer {
        let size = (self.rect.width(), self.rect.height());
        let lend = |format| recorder.pool.lend(&recorder.gpu, size, format);
        Layer::new(lend(COLOR), lend(GEOMETRY), size)
    }
}

/// The part of a face that the boxes may touch during the exposure.
fn extent(geometry: &Geometry, keys: &ViewKeys, boxes: &[[DVec3; 8]]) -> Rect {
    let side = geometry.intrinsics.width_px;
    let mut rect = Rect::new(0, 0, 0, 0);
    let (moments, _) = keys.sampled();
    for corners in boxes {
        let boxes_in_camera: Vec<_> = moments.iter().map(|pose| corners.map(|c| pose.transform_point(c))).collect();
        if boxes_in_camera.iter().all(|corners| out_of_view(geometry, corners)) {
            continue;
        }
        if boxes_in_camera.iter().flatten().any(|c| c.z <= NEAR_M) {
            return Rect::full(side, side);
        }
        let places = boxes_in_camera.iter().flatten().map(|&c| geometry.distorted_px(c.truncate() / c.z));
        let (low, high) = places.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let (low, high) = (low.max(DVec2::splat(-9.0)), high.min(DVec2::splat(f64::from(side) + 9.0)));
        let own = Rect::new(low.x as i32 - 2, low.y as i32 - 2, high.x as i32 + 3, high.y as i32 + 3);
        rect = rect.union(&own);
    }
    rect
}

crate::uniform! {
    /// `Around` in shaders/around.wgsl.
    struct AroundUniform {
        focal_px: [f32; 2],
        middle_px: [f32; 2],
        lens: [f32; 4],
        decentring: [f32; 4],
        in_picture: [f32; 2],
        size_px: [f32; 2],
        valid_angle: f32,
        rim_slope: f32,
        rim_radius: f32,
        step_s: f32,
        max_px_per_s: f32,
        view_focal: f32,
        view_middle: f32,
        tolerance_m: f32,
        drawn: [[f32; 4]; 6],
        right: [[f32; 4]; 6],
        down: [[f32; 4]; 6],
        forward: [[f32; 4]; 6],
    }
}

impl AroundUniform {
    fn new<'a>(view: &View<'_>, sides: impl Iterator<Item = &'a FaceView>) -> Self {
        let geometry = view.geometry;
        let (i, d) = (&geometry.intrinsics, &geometry.distortion);
        let rect = |r: &Rect| [r.x0 as f32, r.y0 as f32, r.x1 as f32, r.y1 as f32];
        let valid = if geometry.is_equirectangular() { 0.0 } else { geometry.valid_radius() };
        let (mut drawn, mut axes) = ([[0.0; 4]; 6], [[[0.0; 4]; 6]; 3]);
        for face in CubeFace::ALL {
            for (axis, of) in axes.iter_mut().zip(face.axes()) {
                axis[face as usize] = of.extend(0.0).as_vec4().to_array();
            }
        }
        for side in sides {
            drawn[side.face as usize] = rect(&side.rect);
        }
        let views = view_geometry(geometry).intrinsics;
        let target = view.rect;
        Self {
            focal_px: [i.fx_px as f32, i.fy_px as f32],
            middle_px: [i.cx_px as f32, i.cy_px as f32],
            lens: [d.k1, d.k2, d.k3, d.k4].map(|k| k as f32),
            decentring: [d.p1, d.p2, d.sx1, d.sy1].map(|term| term as f32),
            in_picture: [target.x0 as f32, target.y0 as f32],
            size_px: [i.width_px as f32, i.height_px as f32],
            valid_angle: valid as f32,
            rim_slope: geometry.rim_slope() as f32,
            // The radius of the valid angle, measured horizontally to the right.
            rim_radius: d.radial_part().project_extended(DVec3::new(valid.sin(), 0.0, valid.cos()), valid).x as f32,
            step_s: view.shutter.velocity_step_s() as f32,
            max_px_per_s: max_speed_px_per_s(geometry, view.shutter) as f32,
            view_focal: views.fx_px as f32,
            view_middle: views.cx_px as f32,
            tolerance_m: view.occlusion.map_or(0.0, |occlusion| occlusion.tolerance_m),
            drawn,
            right: axes[0],
            down: axes[1],
            forward: axes[2],
        }
    }
}

/// Colour and geometry of an empty face.
#[derive(Clone, Copy, PartialEq)]
struct EmptyFace;

/// Assembles the layer of `view` from its drawn faces. `no_depth` contains a 0.
pub fn gather(
    recorder: &mut PassRecorder,
    view: &View<'_>,
    sides: &[(FaceView, Layer)],
    no_depth: &Texture,
    out: &Layer,
) {
    const COLORS: [&str; 6] = ["color0", "color1", "color2", "color3", "color4", "color5"];
    const GEOMETRIES: [&str; 6] = ["geometry0", "geometry1", "geometry2", "geometry3", "geometry4", "geometry5"];
    let nothing = recorder.memoized(EmptyFace, |gpu, _| {
        [COLOR, GEOMETRY].map(|format| Texture::new(gpu, "nothing drawn", 1, 1, format, 1))
    });
    let model = view.geometry.distortion.model;
    let around = ShaderEntry::from("main").choose("fisheye", model.is_fisheye());
    let mut pass = recorder
        .pass(Shader::Around, around.choose("thin_prism", model == LensModel::ThinPrismFisheye))
        .uniform("around", &AroundUniform::new(view, sides.iter().map(|(side, _)| side)))
        .texture("real_depth", view.occlusion.map_or(no_depth, |occlusion| occlusion.depth));
    for (face, (color, geometry)) in CubeFace::ALL.into_iter().zip(COLORS.into_iter().zip(GEOMETRIES)) {
        let drawn = sides.iter().find(|(side, _)| side.face == face).map(|(_, layer)| layer);
        pass = pass.texture(color, drawn.map_or(&nothing[0], |layer| &layer.color));
        pass = pass.texture(geometry, drawn.map_or(&nothing[1], |layer| &layer.geometry));
    }
    pass.draw_into(&[&out.color, &out.geometry], out.size);
}
