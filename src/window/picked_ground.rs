//! A placement surface and a scale from picked points.

use eframe::egui::{Color32, vec2};
use glam::DVec3;

use super::picture::PictureOutput;
use super::point_picker::paint_ring;
use super::project::Project;
use locard_engine::plane::HessePlane;

/// A plane through three picked points, and the two points of a scale.
#[derive(Clone, Debug, Default)]
pub struct PickedGround {
    /// Surface to place on, instead of the one that the depth shows.
    pub plane: Option<HessePlane>,
    /// Picked points whose true distance the user enters.
    pub scale_points_m: Option<[DVec3; 2]>,
}

impl PickedGround {
    /// Drops the picked points of a scale. Returns false if there are none.
    pub fn cancel_scale(&mut self) -> bool {
        self.scale_points_m.take().is_some()
    }

    /// Paints the picked points of a scale.
    pub fn paint(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        paint_points(self.scale_points_m.as_ref().map_or(&[], |points| points), picture, project, frame);
    }
}

/// Paints numbered points.
pub fn paint_points(points_m: &[DVec3], picture: &PictureOutput, project: &Project, frame: usize) {
    let Ok(eye) = project.shot().posed_camera(frame) else { return };
    for (n, point) in points_m.iter().enumerate() {
        if let Some(px) = eye.project(*point) {
            let at = picture.placed.screen(vec2(px.x as f32, px.y as f32));
            paint_ring(&picture.painter, at, &(n + 1).to_string(), Color32::WHITE);
        }
    }
}
