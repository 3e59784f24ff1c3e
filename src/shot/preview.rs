//! A frame's picture with annotations: the creases of the scene's scan, and of objects the
//! outlines, names, and the world's axes at their positions.

use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};

use super::{PosedCamera, ProjectedObject, Shot, SurfaceError};
use crate::pixels::{Codes, DepthMap, Pixels};
use crate::scene::Scene;
use crate::sink::lettering::{Style, line, width_px, write};

const DARK: Rgb<u8> = Rgb([16; 3]);
/// Distinct colours, also under colour blindness (Okabe and Ito 2008).
const COLORS: [Rgb<u8>; 6] = [
    Rgb([240, 228, 66]),
    Rgb([86, 180, 233]),
    Rgb([230, 159, 0]),
    Rgb([0, 200, 150]),
    Rgb([230, 140, 190]),
    Rgb([240, 240, 240]),
];
/// Colour of the edges of a scan.
const SITE_INK: Rgb<u8> = Rgb([0, 255, 200]);
/// Relative second difference of inverse depth at the edge of a scan's surface.
const SITE_EDGE_BEND: f32 = 0.02;
/// Axes x, y and z.
const AXES: [(DVec3, Rgb<u8>, &str); 3] =
    [(DVec3::X, Rgb([255, 70, 70]), "x"), (DVec3::Y, Rgb([90, 220, 90]), "y"), (DVec3::Z, Rgb([90, 140, 255]), "z")];
/// Sizes in a picture of 720 px height.
const LETTER_HEIGHT_PX: f64 = 16.0;
const AXIS_LENGTH_PX: f64 = 34.0;
const LINE_WIDTH_PX: f64 = 1.5;

impl Shot {
    /// A frame's picture, with 8 bits, with the edges of the scan, the outline and the name of
    /// every object in it, and the world's axes at its position. `pixels` is the result of
    /// [`Shot::picture`], or another picture of that frame and size.
    pub fn annotated(&self, frame: usize, pixels: &Pixels) -> Result<Pixels, SurfaceError> {
        let eye = self.posed_camera(frame)?;
        let (width, height, codes) = (pixels.width, pixels.height, pixels.codes.to_eight_bit().into_owned());
        let Some(mut picture) = RgbImage::from_raw(width, height, codes) else { return Ok(pixels.clone()) };
        let unit = (f64::from(height) / 720.0).max(1.0);
        for [x, y] in self.site_edges_px(frame)? {
            picture.put_pixel(x, y, SITE_INK);
        }
        let mut labels = Vec::new();
        for object in 0..self.scene.objects.len() {
            let projected = eye.project_object(&self.scene, object);
            let ink = COLORS[object % COLORS.len()];
            for polygon in &projected.outline_px {
                draw_polygon(&mut picture, polygon, unit * (LINE_WIDTH_PX + 2.0), DARK);
                draw_polygon(&mut picture, polygon, unit * LINE_WIDTH_PX, ink);
            }
            axes(&mut picture, &eye, &self.scene, &projected, unit);
            labels.extend(label(&self.scene, &projected, ink));
        }
        names(&mut picture, labels, unit);
        Ok(Pixels::uncoded(width, height, Codes::U8(picture.into_raw())))
    }

    /// The pixels of a frame at the edges of the scene's scan, none without a scan.
    pub fn site_edges_px(&self, frame: usize) -> Result<Vec<[u32; 2]>, SurfaceError> {
        let Some(site) = self.recording.site() else { return Ok(Vec::new()) };
        let (track, time_s) = (&self.recording.track, self.recording.timestamps_s[frame]);
        let map = site.depth_at_time(self.posed_camera(frame)?.geometry(), track, time_s)?;
        Ok(edges_px(&map).collect())
    }
}

/// The pixels at which depth steps or bends.
fn edges_px(map: &DepthMap) -> impl Iterator<Item = [u32; 2]> {
    let (width, height) = (map.width as usize, map.height as usize);
    let w = move |x: usize, y: usize| {
        let z = map.depth_m[y * width + x];
        if z > 0.0 { z.recip() } else { 0.0 }
    };
    // Inverse depth is linear over a plane.
    let bend = |a: f32, b: f32, c: f32| {
        let is_known = a > 0.0 && b > 0.0 && c > 0.0;
        if is_known { (a - 2.0 * b + c).abs() / b } else { 0.0 }
    };
    let r = (height / 240).max(1);
    let is_edge = move |x: usize, y: usize| {
        let here = w(x, y);
        let max_bend = bend(w(x - r, y), here, w(x + r, y)).max(bend(w(x, y - r), here, w(x, y + r)));
        max_bend > SITE_EDGE_BEND
    };
    let rows = r..height.saturating_sub(r);
    let inside = rows.flat_map(move |y| (r..width.saturating_sub(r)).map(move |x| (x, y)));
    inside.filter(move |(x, y)| is_edge(*x, *y)).map(|(x, y)| [x as u32, y as u32])
}

fn draw_polygon(picture: &mut RgbImage, polygon: &[DVec2], width_px: f64, ink: Rgb<u8>) {
    for (a, b) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
        line(picture, *a, *b, width_px, ink);
    }
}

fn axes(picture: &mut RgbImage, eye: &PosedCamera, scene: &Scene, projected: &ProjectedObject, unit: f64) {
    let position_m = scene.objects[projected.object].position_m;
    let (Some(from), Some(depth), false) =
        (projected.position_px, eye.in_camera(position_m).map(DVec3::length), projected.outline_px.is_empty())
    else {
        return;
    };
    // All have the same length in the world: AXIS_LENGTH_PX if they were perpendicular to the line
    // of sight.
    let length_m = unit * AXIS_LENGTH_PX * depth / eye.geometry().intrinsics.fx_px;
    for (axis, ink, name) in AXES {
        let Some(to) = eye.project(position_m + length_m * axis) else { continue };
        line(picture, from, to, unit * (LINE_WIDTH_PX + 2.0), DARK);
        line(picture, from, to, unit * LINE_WIDTH_PX, ink);
        let height_px = (0.8 * unit * LETTER_HEIGHT_PX) as f32;
        let middle = to + (to - from).normalize_or_zero() * 0.6 * f64::from(height_px);
        let corner = (middle.x as f32 - 0.3 * height_px, middle.y as f32 - 0.6 * height_px);
        write(picture, corner, f32::INFINITY, name, Style { height_px, ink });
    }
}

struct Label {
    /// The middle of the outline's upper edge.
    at: DVec2,
    text: String,
    ink: Rgb<u8>,
}

fn label(scene: &Scene, projected: &ProjectedObject, ink: Rgb<u8>) -> Option<Label> {
    let points = projected.outline_px.iter().flatten().copied();
    let (low, high) = points.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))?;
    let text = scene.objects[projected.object].name.clone();
    Some(Label { at: DVec2::new(0.5 * (low.x + high.x), low.y), text, ink })
}

/// Writes names above their objects, without overlap.
fn names(picture: &mut RgbImage, mut labels: Vec<Label>, unit: f64) {
    let height = unit * LETTER_HEIGHT_PX;
    let size = DVec2::new(picture.width().into(), picture.height().into());
    let mut taken: Vec<(DVec2, DVec2)> = Vec::new();
    labels.sort_by(|a, b| b.at.y.total_cmp(&a.at.y));
    for Label { at, text, ink } in labels {
        let wide = f64::from(width_px(&text, height as f32)) + 0.5 * height;
        let extent = DVec2::new(wide, height);
        let mut low = at - DVec2::new(0.5 * wide, 1.4 * height);
        low = low.min(size - extent).max(DVec2::ZERO);
        let covers =
            |low: DVec2, other: &(DVec2, DVec2)| low.cmplt(other.1).all() && (low + extent).cmpgt(other.0).all();
        while low.y > 0.0 && taken.iter().any(|other| covers(low, other)) {
            low.y = (low.y - 0.25 * height).max(0.0);
        }
        taken.push((low, low + extent));
        let middle = low.y + 0.5 * height;
        line(
            picture,
            DVec2::new(low.x + 0.5 * height, middle),
            DVec2::new(low.x + wide - 0.5 * height, middle),
            height,
            DARK,
        );
        let corner = ((low.x + 0.25 * height) as f32, low.y as f32);
        write(picture, corner, f32::INFINITY, &text, Style { height_px: height as f32, ink });
    }
}
