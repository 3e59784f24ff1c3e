//! The edges of the scene's scan over the picture: they lie on the edges of the real things if the
//! scan is in its place.

use eframe::egui::{Color32, ColorImage, Context, Pos2, Rect, TextureHandle, TextureOptions};

use super::super::background::Background;
use super::super::picture::PictureOutput;
use locard_engine::camera::Geometry;
use locard_engine::memo::ByAddress;
use locard_engine::pose::Pose;
use locard_engine::shot::Shot;
use locard_engine::site::SiteScan;

const INK: Color32 = Color32::from_rgb(0, 255, 200);

/// The content of a picture of edges.
#[derive(Clone, Debug, PartialEq)]
struct EdgesKey {
    scan: ByAddress<SiteScan>,
    world_from_scan: Pose,
    frame: usize,
    pose: Option<Pose>,
    geometry: Option<Geometry>,
}

/// The edges in the displayed frame, computed on a background thread.
#[derive(Default)]
pub struct ScanEdges(Background<EdgesKey, Option<TextureHandle>>);

impl ScanEdges {
    /// Paints the edges in a frame once they have been computed.
    pub fn paint(&mut self, picture: &PictureOutput, shot: &Shot, frame: usize) {
        let Some(site) = shot.recording.site() else { return };
        let scan = ByAddress(site.scan.clone());
        let key = EdgesKey {
            scan,
            world_from_scan: site.world_from_scan,
            frame,
            pose: shot.recording.pose_at_frame(frame).ok(),
            geometry: shot.geometry_at(frame).ok(),
        };
        let (ctx, size) = (picture.response.ctx.clone(), [picture.size.x as usize, picture.size.y as usize]);
        let (of_thread, shot) = (ctx.clone(), shot.clone());
        self.0.request(&ctx, key.clone(), move |_| edges(&of_thread, &shot, frame, size));
        let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        if let Some(Some(texture)) = self.0.last().filter(|_| self.0.is_of(&key)) {
            picture.painter.image(texture.id(), picture.placed.rect, uv, Color32::WHITE);
        }
    }
}

/// A picture of the edges; `None` without a pose.
fn edges(ctx: &Context, shot: &Shot, frame: usize, [width, height]: [usize; 2]) -> Option<TextureHandle> {
    let edges_px = shot.site_edges_px(frame).ok()?;
    let mut image = ColorImage::filled([width, height], Color32::TRANSPARENT);
    for [x, y] in edges_px.into_iter().map(|px| px.map(|n| n as usize)).filter(|[x, y]| *x < width && *y < height) {
        image.pixels[y * width + x] = INK;
    }
    Some(ctx.load_texture("scan edges", image, TextureOptions::NEAREST))
}
