//! Blur of the surface under the pointer: motion during the exposure, and circle of confusion.

use eframe::egui::{self, RichText, Stroke, Ui, vec2};
use glam::DVec2;

use super::plots::DataSource;
use locard_engine::frame::Frame;
use locard_engine::shot::{Shot, SurfaceError};
use locard_engine::text::fixed;

/// Depth, blur and code values at a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct PointerProbe {
    pub depth_m: f64,
    pub exposure_s: f64,
    /// Motion during the exposure, px.
    pub moved_px: Result<DVec2, String>,
    /// Diameter of the circle of confusion, px; `None` for a pinhole.
    pub circle_px: Option<f64>,
    /// Code values of the camera's picture, 8 bits.
    pub codes: [u8; 3],
}

impl PointerProbe {
    /// Probes the camera's picture and its surface.
    pub fn at(shot: &Shot, frame: &Frame, at_px: DVec2) -> Result<Self, String> {
        let surface = shot.surface_at(frame, at_px).map_err(|error| match error {
            SurfaceError::NoDepth { .. } => "This frame has no depth, so the point's distance is unknown.".to_owned(),
            error => error.to_string(),
        })?;
        let (camera, message) = (shot.camera(), |error: &dyn std::fmt::Display| error.to_string());
        let geometry = shot.geometry_at(frame.index).map_err(|error| message(&error))?;
        let opening = camera.lens_in(&frame.exposure.lens).opening(&geometry).map_err(|error| message(&error))?;
        Ok(Self {
            depth_m: surface.depth_m,
            exposure_s: shot.exposure_time(frame).s,
            moved_px: shot.motion_px(frame, at_px, &surface).map_err(|error| message(&error)),
            circle_px: opening.map(|o| o.circle_px(geometry.intrinsics.fx_px, surface.depth_m).abs()),
            codes: frame.pixels.eight_bits_at(at_px.x as u32, at_px.y as u32),
        })
    }

    /// Shows the numbers, and motion and circle to scale beside one pixel of the picture.
    pub fn show(&self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(vec2(72.0, 72.0), egui::Sense::hover());
            let (color, weak) = (DataSource::Virtual.color(ui), ui.visuals().weak_text_color());
            let painter = ui.painter().with_clip_rect(rect);
            painter.rect_stroke(rect, 2.0, Stroke::new(1.0, weak.gamma_multiply(0.5)), egui::StrokeKind::Inside);
            let moved = self.moved_px.as_ref().copied().unwrap_or_default();
            let circle = self.circle_px.unwrap_or(0.0);
            let largest = moved.length().max(circle).max(1.0);
            let scale = (60.0 / largest).min(12.0);
            let way = vec2((moved.x * scale) as f32, (moved.y * scale) as f32);
            painter.circle_stroke(rect.center(), (0.5 * circle * scale) as f32, Stroke::new(1.2, color));
            painter.line_segment([rect.center() - 0.5 * way, rect.center() + 0.5 * way], Stroke::new(2.0, color));
            // One pixel for comparison.
            let pixel = egui::Rect::from_min_size(
                rect.left_bottom() + vec2(4.0, -4.0 - scale as f32),
                egui::Vec2::splat(scale as f32),
            );
            painter.rect_stroke(pixel, 0.0, Stroke::new(1.0, weak), egui::StrokeKind::Inside);
            ui.vertical(|ui| {
                ui.label(format!(
                    "{} m away, pixel values (8 bit) {}",
                    fixed(self.depth_m, 3),
                    self.codes.map(|c| c.to_string()).join(" ")
                ));
                match &self.moved_px {
                    Ok(way) => ui.label(format!(
                        "moves {} px ({} right, {} down) in {} ms",
                        fixed(way.length(), 2),
                        fixed(way.x, 2),
                        fixed(way.y, 2),
                        fixed(1e3 * self.exposure_s, 1)
                    )),
                    Err(why) => ui.label(why),
                };
                match self.circle_px {
                    Some(circle) => ui.label(format!("circle of confusion {} px", fixed(circle, 2))),
                    None => ui.label("No aperture set: everything in focus"),
                };
                ui.label(RichText::new("the square is one pixel").small().weak());
            });
        });
    }
}
