//! Picking of world points in the picture: one click with depth or a known plane, otherwise one
//! click in each of two frames, triangulated.

use eframe::egui::{Align2, Color32, Painter, Pos2, Shape, Stroke, vec2};
use glam::{DVec2, DVec3};

use super::obstacle::surface_text;
use super::picture::{PictureOutput, plate};
use locard_engine::frame::Frame;
use locard_engine::plane::{HessePlane, Plane};
use locard_engine::shot::{FramePoint, Shot, SurfaceError};
use locard_engine::text::fixed;

/// Picks points of the world, one after another.
#[derive(Clone, Debug, Default)]
pub struct PointPicker {
    /// First view of a point that needs two.
    first: Option<FramePoint>,
}

/// Result of a click.
#[derive(Clone, Debug)]
pub enum Click {
    Point {
        support: Plane,
        /// Text about the uncertainty of a triangulated point.
        accuracy: Option<String>,
    },
    /// The same point must be clicked in another frame; with an instruction for the user.
    SecondView(String),
}

/// Plane for clicks: the chosen one, or the recording's floor if the frame has no depth.
fn plane_of(chosen: Option<HessePlane>, shot: &Shot, frame: &Frame) -> Option<HessePlane> {
    chosen.or_else(|| shot.floor().filter(|_| frame.depth.is_none()))
}

/// The point at a pixel, if one click is enough. A chosen plane overrides the depth.
pub fn surface_point(chosen: Option<HessePlane>, shot: &Shot, frame: &Frame, at_px: DVec2) -> Option<Plane> {
    match plane_of(chosen, shot, frame) {
        Some(plane) => shot.support_on_plane(frame.index, at_px, plane.coefficients()).ok(),
        None => Some(shot.placement_preview(frame, at_px).ok()?.plane),
    }
}

impl PointPicker {
    /// Drops the first view.
    pub fn cancel(&mut self) {
        self.first = None;
    }

    /// True if a point awaits its second view.
    pub fn awaits_second_view(&self) -> bool {
        self.first.is_some()
    }

    /// Takes a click in a frame. A chosen plane overrides the depth. `up` is the normal of a
    /// triangulated point.
    pub fn click(
        &mut self,
        chosen: Option<HessePlane>,
        shot: &Shot,
        up: DVec3,
        frame: &Frame,
        at_px: DVec2,
    ) -> Result<Click, String> {
        let point = |support: Plane| Ok(Click::Point { support, accuracy: None });
        if let (Some(plane), None) = (plane_of(chosen, shot, frame), self.first) {
            return point(
                shot.support_on_plane(frame.index, at_px, plane.coefficients()).map_err(|error| error.to_string())?,
            );
        }
        let view = FramePoint { frame: frame.index, at_px };
        if let Some(first) = self.first {
            if first.frame == frame.index {
                self.first = Some(view);
                return Ok(Click::SecondView(second_view_prompt()));
            }
            return self.triangulate(shot, up, first, view);
        }
        match shot.placement_surface(frame, at_px) {
            Ok(surface) => point(surface.plane),
            Err(SurfaceError::NoDepth { .. }) => {
                self.first = Some(view);
                Ok(Click::SecondView(second_view_prompt()))
            }
            Err(error) => Err(surface_text(&error)),
        }
    }

    fn triangulate(&mut self, shot: &Shot, up: DVec3, first: FramePoint, second: FramePoint) -> Result<Click, String> {
        let point = shot.triangulate(&[first, second]).map_err(|error| error.to_string())?;
        self.first = None;
        let within = if is_scaled(shot) {
            format!("{:.0} mm", 1e3 * point.sigma_m)
        } else {
            format!("{} units", fixed(point.sigma_m, 3))
        };
        let accuracy = Some(format!("The point is known within {within}"));
        Ok(Click::Point { support: Plane { point_m: point.point_m, normal: up }, accuracy })
    }

    /// Paints the first view of a point, or in other frames its epipolar line.
    pub fn paint(&self, picture: &PictureOutput, shot: &Shot, frame: usize) {
        let Some(first) = self.first else { return };
        picture.prompt(&second_view_prompt());
        let screen = |px: DVec2| picture.placed.screen(vec2(px.x as f32, px.y as f32));
        if first.frame == frame {
            paint_ring(&picture.painter, screen(first.at_px), "", Color32::WHITE);
            return;
        }
        let (Ok(from), Ok(eye)) = (shot.posed_camera(first.frame), shot.posed_camera(frame)) else { return };
        let Some(ray) = from.ray(first.at_px) else { return };
        // From near to far, in logarithmic steps.
        let places = (0..=120).map(|n| eye.project(ray.at(0.02 * 10f64.powf(f64::from(n) / 24.0))));
        let within = 2.0 * f64::from(picture.size.x.max(picture.size.y));
        let mut line: Vec<Pos2> = Vec::new();
        let draw = |line: &mut Vec<Pos2>| {
            for (width, ink) in [(3.5, Color32::from_black_alpha(120)), (1.5, Color32::WHITE)] {
                picture.painter.add(Shape::line(line.clone(), Stroke::new(width, ink)));
            }
            line.clear();
        };
        for place in places {
            match place.filter(|px| px.abs().max_element() < within) {
                Some(px) => line.push(screen(px)),
                None => draw(&mut line),
            }
        }
        draw(&mut line);
    }
}

/// True if lengths are metres.
pub fn is_scaled(shot: &Shot) -> bool {
    shot.recording.kind.is_metric() || shot.recording.metres_per_unit != 1.0
}

/// Paints a ring at a point of a picture.
pub fn paint_ring(painter: &Painter, at: Pos2, text: &str, ink: Color32) {
    for (width, ink) in [(3.5, Color32::from_black_alpha(120)), (1.5, ink)] {
        painter.circle_stroke(at, 5.0, Stroke::new(width, ink));
    }
    if !text.is_empty() {
        plate(painter, at + vec2(12.0, -10.0), Align2::LEFT_BOTTOM, text, 12.0);
    }
}

fn second_view_prompt() -> String {
    "Now the same point in another frame, seen from elsewhere: choose one in the time line".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;
    use std::path::Path;

    #[test]
    fn point_takes_one_click_with_depth_or_a_plane_and_two_without() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let point = DVec3::new(0.1, -0.1, 0.0);
        let projected_px = |frame: usize| shot.posed_camera(frame).unwrap().project(point).unwrap();
        let [near, far] = [30, 50].map(|frame| shot.read(frame).unwrap());
        let mut picker = PointPicker::default();
        let picked_point = |click: Result<Click, String>| match click {
            Ok(Click::Point { support, .. }) => support.point_m,
            other => panic!("{other:?}"),
        };
        // The simulated depth is noisy by 1.5 mm.
        assert!(picked_point(picker.click(None, &shot, DVec3::Z, &near, projected_px(30))).distance(point) < 2e-3);
        let bare = |frame: &Frame| Frame { depth: None, ..frame.clone() };
        assert!(matches!(
            picker.click(None, &shot, DVec3::Z, &bare(&near), DVec2::new(9.0, 9.0)),
            Ok(Click::SecondView(_))
        ));
        // Another click in the same frame replaces the first view.
        assert!(matches!(
            picker.click(None, &shot, DVec3::Z, &bare(&near), projected_px(30)),
            Ok(Click::SecondView(_))
        ));
        assert!(picker.awaits_second_view());
        // A rejected second view can be clicked again.
        picker.click(None, &shot, DVec3::Z, &bare(&far), DVec2::new(3.0, 3.0)).unwrap_err();
        let second = picker.click(None, &shot, DVec3::Z, &bare(&far), projected_px(50));
        assert!(
            matches!(second, Ok(Click::Point { accuracy: Some(_), .. })) && picked_point(second).distance(point) < 1e-4
        );
        assert!(!picker.awaits_second_view());
        let plane = Some(HessePlane { normal: DVec3::Z, offset_m: 0.0 });
        assert!(
            picked_point(picker.click(plane, &shot, DVec3::Z, &bare(&near), projected_px(30))).distance(point) < 1e-6
        );
    }
}
