//! Points of the world that a person clicks in the picture: one click each where the frame has depth or a plane is known,
//! else one click in each of two frames.

use eframe::egui::{Align2, Color32, Pos2, Shape, Stroke, vec2};
use glam::{DVec2, DVec3};

use super::obstacle::surface_text;
use super::picture::{Seen, plate};
use locard_engine::frame::Frame;
use locard_engine::scene::Support;
use locard_engine::shot::{FittedPlane, Shot, SurfaceError, View};
use locard_engine::text::fixed;

/// Finds points of the world, one after another.
#[derive(Clone, Debug, Default)]
pub struct Finder {
    /// Overrides the depth.
    pub plane: Option<FittedPlane>,
    /// The next point, as one frame shows it.
    first: Option<View>,
    /// How exactly the last one is known, in words.
    pub told: Option<String>,
}

/// What a click gave.
#[derive(Clone, Debug)]
pub enum Click {
    Point(Support),
    /// The same point must be clicked in another frame; the text says so.
    Again(String),
}

impl Finder {
    /// Forgets what is half done.
    pub fn cancel(&mut self) {
        self.first = None;
    }

    /// Whether a point is half found.
    pub fn is_between(&self) -> bool {
        self.first.is_some()
    }

    /// What a click meets: what was chosen, or the recording's floor where the frame has no depth.
    fn plane(&self, shot: &Shot, frame: &Frame) -> Option<FittedPlane> {
        self.plane.or_else(|| shot.floor().filter(|_| frame.depth.is_none()))
    }

    /// What a click would find, where one click is enough.
    pub fn look(&self, shot: &Shot, frame: &Frame, at_px: DVec2) -> Option<Support> {
        match (self.first, self.plane(shot, frame)) {
            (Some(_), _) => None,
            (None, Some(plane)) => shot.support_on_plane(frame.index, at_px, plane.numbers()).ok(),
            (None, None) => {
                let surface = shot.placement_preview(frame, at_px).ok()?;
                Some(Support { point_m: surface.point_m, normal: surface.normal_in_world })
            }
        }
    }

    /// Takes a click in a frame.
    pub fn click(&mut self, shot: &Shot, up: DVec3, frame: &Frame, at_px: DVec2) -> Result<Click, String> {
        self.told = None;
        if let (Some(plane), None) = (self.plane(shot, frame), self.first) {
            let support = shot.support_on_plane(frame.index, at_px, plane.numbers()).map_err(|e| e.to_string())?;
            return Ok(Click::Point(support));
        }
        let view = View { frame: frame.index, at_px };
        if let Some(first) = self.first {
            if first.frame == frame.index {
                self.first = Some(view);
                return Ok(Click::Again(again()));
            }
            let found = shot.triangulate(&[first, view]).map_err(|e| e.to_string())?;
            self.first = None;
            let within = match is_scaled(shot) {
                true => format!("{:.0} mm", 1e3 * found.sigma_m),
                false => format!("{} units", fixed(found.sigma_m, 3)),
            };
            self.told = Some(format!("The point is known within {within}"));
            return Ok(Click::Point(Support { point_m: found.point_m, normal: up }));
        }
        match shot.placement_surface(frame, at_px) {
            Ok(surface) => Ok(Click::Point(Support { point_m: surface.point_m, normal: surface.normal_in_world })),
            Err(SurfaceError::NoDepth { .. }) => {
                self.first = Some(view);
                Ok(Click::Again(again()))
            }
            Err(error) => Err(surface_text(&error)),
        }
    }

    /// Shows where a half-found point was clicked, or in another frame the line on which it lies.
    pub fn paint(&self, seen: &Seen, shot: &Shot, frame: usize) {
        let Some(first) = self.first else { return };
        seen.tell(&again());
        let screen = |px: DVec2| seen.placed.screen(vec2(px.x as f32, px.y as f32));
        if first.frame == frame {
            mark(seen, screen(first.at_px), "");
            return;
        }
        let (Ok(from), Ok(eye)) = (shot.eye(first.frame), shot.eye(frame)) else { return };
        let Some(ray) = from.ray(first.at_px) else { return };
        // From near to far, by equal ratios.
        let places = (0..=120).map(|n| eye.project(ray.at(0.02 * 10f64.powf(f64::from(n) / 24.0))));
        let within = 2.0 * f64::from(seen.size.x.max(seen.size.y));
        let mut line: Vec<Pos2> = Vec::new();
        let draw = |line: &mut Vec<Pos2>| {
            for (width, ink) in [(3.5, Color32::from_black_alpha(120)), (1.5, Color32::WHITE)] {
                seen.painter.add(Shape::line(line.clone(), Stroke::new(width, ink)));
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

/// Whether lengths are metres.
pub fn is_scaled(shot: &Shot) -> bool {
    shot.recording.kind.is_metric() || shot.recording.metres_per_unit != 1.0
}

/// Rings a place in the picture.
pub fn mark(seen: &Seen, at: Pos2, text: &str) {
    for (width, ink) in [(3.5, Color32::from_black_alpha(120)), (1.5, Color32::WHITE)] {
        seen.painter.circle_stroke(at, 5.0, Stroke::new(width, ink));
    }
    if !text.is_empty() {
        plate(&seen.painter, at + vec2(12.0, -10.0), Align2::LEFT_BOTTOM, text, 12.0);
    }
}

fn again() -> String {
    "Now the same point in another frame, seen from elsewhere: choose one in the time line".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::Given;
    use std::path::Path;

    #[test]
    fn a_point_is_one_click_with_depth_or_a_plane_and_two_without() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let point = DVec3::new(0.1, -0.1, 0.0);
        let seen = |frame: usize| shot.eye(frame).unwrap().project(point).unwrap();
        let [near, far] = [30, 50].map(|frame| shot.read(frame).unwrap());
        let mut finder = Finder::default();
        let found = |click: Result<Click, String>| match click {
            Ok(Click::Point(support)) => support.point_m,
            other => panic!("{other:?}"),
        };
        // The simulated depth is noisy by 1.5 mm.
        assert!(found(finder.click(&shot, DVec3::Z, &near, seen(30))).distance(point) < 2e-3);
        let bare = |frame: &Frame| Frame { depth: None, ..frame.clone() };
        assert!(matches!(finder.click(&shot, DVec3::Z, &bare(&near), DVec2::new(9.0, 9.0)), Ok(Click::Again(_))));
        // Once more in the same frame: another place.
        assert!(matches!(finder.click(&shot, DVec3::Z, &bare(&near), seen(30)), Ok(Click::Again(_))));
        assert!(finder.is_between());
        // What is refused can be clicked again.
        finder.click(&shot, DVec3::Z, &bare(&far), DVec2::new(3.0, 3.0)).unwrap_err();
        assert!(found(finder.click(&shot, DVec3::Z, &bare(&far), seen(50))).distance(point) < 1e-4);
        assert!(!finder.is_between() && finder.told.is_some());
        finder.plane = Some(FittedPlane { normal: DVec3::Z, d_m: 0.0, off_m: 0.0, most_m: 0.0 });
        assert!(found(finder.click(&shot, DVec3::Z, &bare(&near), seen(30))).distance(point) < 1e-6);
    }
}
