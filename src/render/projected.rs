//! Single pictures of a scene through any camera: pinhole, orthographic, and curved projections by
//! cube map.
//!
//! All are drawn by the same [`Renderer`], supersampled and in tiles, so that memory depends on the
//! picture's size only. A curved camera's picture is resampled from up to six cube faces. Not
//! modelled: lens effects beyond the projection (depth of field, vignetting, motion).

use glam::{DQuat, DVec2, DVec3};

use super::draw::Renderer;
use super::panorama;
use super::plan::SamplePlan;
use super::resample::{CubeFace, FaceImage, Resampler};
use super::view::{NEAR_M, Shutter, View, ViewKeys};
use crate::camera::curved::CurvedCamera;
use crate::camera::{Geometry, Primaries};
use crate::gpu::{Gpu, GpuError, PassRecorder, ReadbackSet};
use crate::parallel::{over_rows, processors};
use crate::pixels::{LinearImage, Rect};
use crate::pose::Pose;
use crate::scene::Environment;

/// Mapping between pixels and directions in front of the camera.
#[derive(Clone, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole. A principal point away from the centre makes it off-axis.
    Perspective(Geometry),
    /// Parallel rays, with the camera's position in the picture's centre.
    Orthographic {
        width_px: u32,
        height_px: u32,
        px_per_m: f64,
    },
    Curved(CurvedCamera),
}

impl Projection {
    /// Width and height of the picture, px.
    pub fn size_px(&self) -> (u32, u32) {
        match self {
            Self::Perspective(g) => (g.intrinsics.width_px, g.intrinsics.height_px),
            Self::Orthographic { width_px, height_px, .. } => (*width_px, *height_px),
            Self::Curved(c) => (c.width_px, c.height_px),
        }
    }

    /// The viewing direction (camera's axes, unit length) at a pixel position; `None` outside the
    /// field of view.
    pub fn direction(&self, at_px: DVec2) -> Option<DVec3> {
        match self {
            Self::Perspective(g) => g.direction(at_px),
            Self::Orthographic { .. } => Some(DVec3::Z),
            Self::Curved(c) => c.unproject(at_px),
        }
    }

    /// The pixel position of a point (camera's axes, metres).
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        match self {
            Self::Perspective(g) => g.project(point_in_camera),
            Self::Orthographic { width_px, height_px, px_per_m } => (point_in_camera.z > 0.0).then(|| {
                0.5 * DVec2::new((*width_px).into(), (*height_px).into()) + *px_per_m * point_in_camera.truncate()
            }),
            Self::Curved(c) => c.project(point_in_camera),
        }
    }
}

/// Parameters of a single picture.
#[derive(Clone, Debug)]
pub struct PictureRequest {
    pub projection: Projection,
    pub pose: Pose,
    /// True if the environment map, if any, is visible behind the objects. Not with parallel rays,
    /// which all have the same direction.
    pub background: bool,
}

/// Supersampling factor along each side. Each drawn pixel has four samples.
const SUPERSAMPLING: u32 = 2;
/// Side of the drawn tiles, px. Multisampled targets of a gigabyte would allow 4600.
const TILE_PX: i32 = 1024;

/// Renders a picture; it is transparent outside objects and background.
pub fn take_still(gpu: &Gpu, renderer: &mut Renderer, still: &PictureRequest) -> Result<LinearImage, GpuError> {
    let (width, height) = still.projection.size_px();
    let recorder = PassRecorder::new(gpu.clone());
    let mut studio = StillRenderer { recorder, renderer, readbacks: ReadbackSet::default() };
    let mut image = match &still.projection {
        Projection::Perspective(g) => {
            let fine = g.resized(width * SUPERSAMPLING, height * SUPERSAMPLING);
            studio.downsampled(&fine, still.pose, false)?
        }
        Projection::Orthographic { px_per_m, .. } => {
            let fine =
                Geometry::pinhole(width * SUPERSAMPLING, height * SUPERSAMPLING, px_per_m * f64::from(SUPERSAMPLING));
            studio.downsampled(&fine, still.pose, true)?
        }
        Projection::Curved(curved) => {
            let resampler = Resampler::new(curved);
            let mut sum = LinearImage::empty(width, height);
            for face in CubeFace::ALL.into_iter().filter(|face| resampler.needs(*face)) {
                let turn = face.face_from_camera();
                let pose = Pose::new(turn * still.pose.rotation, turn * still.pose.translation_m);
                let geometry = resampler.face_geometry();
                if !studio.renderer.in_view(&geometry, &pose) {
                    continue;
                }
                let drawn = studio.full_resolution(&geometry, pose)?;
                resampler.add(face, &drawn, &mut sum);
            }
            sum
        }
    };
    let background = still.background && !matches!(still.projection, Projection::Orthographic { .. });
    if let (true, Environment::Map(map)) = (background, &renderer.scene().lighting.environment) {
        let turn = map.map_from_world.as_dquat() * still.pose.world_from_camera_rotation();
        composite_over_panorama(&mut image, &still.projection, &panorama::full_resolution(map), turn);
    }
    Ok(image)
}

/// Composites a picture over a panorama. In partly visible pixels the panorama appears in the
/// visible part only.
fn composite_over_panorama(
    image: &mut LinearImage,
    projection: &Projection,
    map: &panorama::MipLevel,
    map_from_camera: DQuat,
) {
    let row_length = image.width as usize;
    // Texels of the map per radian.
    let texels = f64::from(map.0) / std::f64::consts::TAU;
    over_rows(&mut image.rgba, row_length, processors(), |y, row| {
        for (x, pixel) in row.iter_mut().enumerate() {
            if pixel[3] >= 1.0 {
                continue;
            }
            let at = DVec2::new(x as f64, y as f64);
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|c| projection.direction(at + DVec2::from(c)));
            let steps = match corners {
                [Some(a), Some(b), Some(c)] => {
                    (a.angle_between(b).max(a.angle_between(c)) * texels).ceil().clamp(2.0, 16.0)
                }
                _ => 4.0,
            } as u32;
            let mut sum = glam::Vec4::ZERO;
            for n in 0..steps * steps {
                let inside = DVec2::new(f64::from(n % steps) + 0.5, f64::from(n / steps) + 0.5) / f64::from(steps);
                if let Some(d) = projection.direction(at + inside) {
                    sum += panorama::at(map, (map_from_camera * d).as_vec3()).extend(1.0);
                }
            }
            let mean = sum / (steps * steps) as f32;
            if mean.w > 0.0 {
                let shown = (mean.w - pixel[3]).max(0.0) / mean.w;
                *pixel = (glam::Vec4::from(*pixel) + mean * shown).into();
            }
        }
    });
}

/// Resources for rendering a single picture.
struct StillRenderer<'a> {
    recorder: PassRecorder,
    renderer: &'a mut Renderer,
    readbacks: ReadbackSet,
}

impl StillRenderer<'_> {
    /// A picture in which each pixel is the mean of `SUPERSAMPLING` × `SUPERSAMPLING` drawn ones.
    fn downsampled(&mut self, fine: &Geometry, pose: Pose, parallel: bool) -> Result<LinearImage, GpuError> {
        let mut image =
            LinearImage::empty(fine.intrinsics.width_px / SUPERSAMPLING, fine.intrinsics.height_px / SUPERSAMPLING);
        let wide = image.width as usize;
        self.draw(fine, pose, parallel, |y, x0, texels| {
            let row = &mut image.rgba[y / SUPERSAMPLING as usize * wide..][..wide];
            for (x, texel) in (x0..).zip(texels) {
                (0..4).for_each(|c| row[x / SUPERSAMPLING as usize][c] += texel[c].to_f32());
            }
        })?;
        image.rgba.iter_mut().flatten().for_each(|sum| *sum /= (SUPERSAMPLING * SUPERSAMPLING) as f32);
        Ok(image)
    }

    /// The drawn pixels without downsampling.
    fn full_resolution(&mut self, geometry: &Geometry, pose: Pose) -> Result<FaceImage, GpuError> {
        let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
        let mut rgba = vec![[half::f16::ZERO; 4]; width as usize * height as usize];
        let rect = self.draw(geometry, pose, false, |y, x0, texels| {
            rgba[y * width as usize + x0..][..texels.len()].copy_from_slice(texels);
        })?;
        Ok(FaceImage { width, rect, rgba })
    }

    /// Draws the objects in tiles, and passes their pixels to `each`, row by row from above: row,
    /// first column, pixels. Returns the covered rectangle; it is empty outside. With `parallel`,
    /// focal lengths are px per metre.
    fn draw(
        &mut self,
        geometry: &Geometry,
        pose: Pose,
        parallel: bool,
        mut each: impl FnMut(usize, usize, &[[half::f16; 4]]),
    ) -> Result<Rect, GpuError> {
        let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
        let shutter = Shutter { exposure_time_s: 0.0, readout_time_s: 0.0, beyond_s: 0.0 };
        let keys = ViewKeys::new(shutter, |_| pose);
        let footprint = self.renderer.footprint(geometry, &keys, shutter);
        let full = Rect::full(width, height);
        // Slightly beyond the farthest point. The footprint's rectangle is for a perspective
        // camera, so it is not used here.
        let parallel_to_m = parallel.then(|| 1.01 * footprint.depths_m[1].max(2.0 * NEAR_M));
        let rect = if parallel { full } else { footprint.rect.intersection(&full) };
        let mut band = Vec::new();
        for y0 in (rect.y0..rect.y1).step_by(TILE_PX as usize) {
            let rows = Rect::new(rect.x0, y0, rect.x1, y0 + TILE_PX).intersection(&rect);
            let columns = rows.width() as usize;
            band.resize(columns * rows.height() as usize, [half::f16::ZERO; 4]);
            for x0 in (rect.x0..rect.x1).step_by(TILE_PX as usize) {
                let tile = Rect::new(x0, y0, x0 + TILE_PX, y0 + TILE_PX).intersection(&rect);
                let view = View {
                    geometry,
                    keys: &keys,
                    shutter,
                    depths_m: footprint.depths_m,
                    rect: tile,
                    occlusion: None,
                    parallel_to_m,
                    primaries: Primaries::Rec709,
                    outer: None,
                };
                self.draw_tile(&view, &mut band[(x0 - rect.x0) as usize..], columns)?;
            }
            for (y, texels) in (y0 as usize..).zip(band.chunks_exact(columns.max(1))) {
                each(y, rect.x0 as usize, texels);
            }
        }
        Ok(rect)
    }

    /// Draws into rows with a stride of `stride` pixels.
    fn draw_tile(&mut self, view: &View<'_>, texels: &mut [[half::f16; 4]], stride: usize) -> Result<(), GpuError> {
        let layer = self.renderer.draw(&mut self.recorder, view, &SamplePlan::single());
        let mut readback = self.recorder.read_back(&mut self.readbacks, &layer.color, layer.size);
        readback.submitted(self.recorder.submit());
        readback.rows(&self.recorder.gpu, |row, bytes| {
            for (texel, bytes) in texels[row * stride..].iter_mut().zip(bytes.chunks_exact(8)) {
                *texel = std::array::from_fn(|c| half::f16::from_le_bytes([bytes[2 * c], bytes[2 * c + 1]]));
            }
        })?;
        self.readbacks.give_back(readback);
        Ok(())
    }
}
