//! Where a window looks different from before: by its shapes, not by its pixels.

use std::sync::Arc;

use eframe::egui::epaint::{ClippedShape, Shape, TextShape};
use eframe::egui::{Rect, TextureId, pos2, vec2};

/// A shape may come that many places later than before. Beyond that it is taken for a new one.
const REACH: usize = 128;
/// A shape's edges are smoothed beyond its bounds, points.
const FEATHER: f32 = 2.0;
/// Areas are joined where no more than so many pixels have to be painted more, which costs as much as beginning an area does.
const SLACK_PX: f32 = 1024.0;
const MOST_AREAS: usize = 16;

/// Adds the areas where `now` looks different from `before`. Both are painted in their order. A shape is the same as before if
/// it is equal, was painted after the same ones, and its texture's texels are the same.
pub fn changes(
    before: &[ClippedShape],
    now: &[ClippedShape],
    has_new_texels: impl Fn(TextureId) -> bool,
    areas: &mut Areas,
) {
    let mut rest = before;
    for shape in now {
        let found = match uses(&shape.shape, &has_new_texels) {
            true => None,
            false => rest.iter().take(REACH).position(|before| is_same(before, shape)),
        };
        match found {
            Some(at) => {
                rest[..at].iter().for_each(|gone| areas.add(extent(gone)));
                rest = &rest[at + 1..];
            }
            None => areas.add(extent(shape)),
        }
    }
    rest.iter().for_each(|gone| areas.add(extent(gone)));
}

/// Where a shape may paint, points.
pub fn extent(shape: &ClippedShape) -> Rect {
    let bounds = shape.transform_after_tessellation * shape.shape.visual_bounding_rect();
    if bounds.is_finite() { bounds.expand(FEATHER).intersect(shape.clip_rect) } else { Rect::NOTHING }
}

fn uses(shape: &Shape, texture: &impl Fn(TextureId) -> bool) -> bool {
    match shape {
        Shape::Vec(shapes) => shapes.iter().any(|shape| uses(shape, texture)),
        shape => texture(shape.texture_id()),
    }
}

fn is_same(a: &ClippedShape, b: &ClippedShape) -> bool {
    a.clip_rect == b.clip_rect
        && a.transform_after_tessellation == b.transform_after_tessellation
        && match (&a.shape, &b.shape) {
            (Shape::Text(a), Shape::Text(b)) => is_same_text(a, b),
            (Shape::Mesh(a), Shape::Mesh(b)) => Arc::ptr_eq(a, b) || a == b,
            (a, b) => a == b,
        }
}

/// As `==`, but a text that was laid out once is not compared letter by letter.
fn is_same_text(a: &TextShape, b: &TextShape) -> bool {
    let TextShape { pos, galley, underline, fallback_color, override_text_color, opacity_factor, angle } = a;
    *pos == b.pos
        && *underline == b.underline
        && *fallback_color == b.fallback_color
        && *override_text_color == b.override_text_color
        && *opacity_factor == b.opacity_factor
        && *angle == b.angle
        && (Arc::ptr_eq(galley, &b.galley) || *galley == b.galley)
}

/// Areas of a screen, points.
pub struct Areas {
    screen: Rect,
    pixels_per_point: f32,
    areas: Vec<Rect>,
}

impl Areas {
    pub fn new(screen: Rect, pixels_per_point: f32) -> Self {
        Self { screen, pixels_per_point, areas: Vec::new() }
    }

    /// All pixels that it touches.
    pub fn add(&mut self, area: Rect) {
        let area = area.intersect(self.screen);
        if !area.is_positive() {
            return;
        }
        let ppp = self.pixels_per_point;
        let least = vec2(area.min.x * ppp, area.min.y * ppp).floor() / ppp;
        let most = vec2(area.max.x * ppp, area.max.y * ppp).ceil() / ppp;
        self.areas.push(Rect::from_min_max(pos2(least.x, least.y), pos2(most.x, most.y)));
    }

    /// The same, as few that do not meet.
    pub fn merged(self) -> Vec<Rect> {
        let mut slack = SLACK_PX / self.pixels_per_point.powi(2);
        let mut areas = joined(self.areas, slack);
        while areas.len() > MOST_AREAS {
            slack *= 4.0;
            areas = joined(areas, slack);
        }
        areas
    }
}

/// Joins what meets, and what is not larger together by more than `slack`, points².
fn joined(areas: Vec<Rect>, slack: f32) -> Vec<Rect> {
    let is_joined = |a: Rect, b: Rect| a.intersect(b).is_positive() || (a | b).area() <= a.area() + b.area() + slack;
    let mut out: Vec<Rect> = Vec::new();
    for mut area in areas {
        while let Some(at) = out.iter().position(|other| is_joined(*other, area)) {
            area |= out.swap_remove(at);
        }
        out.push(area);
    }
    out
}

#[cfg(test)]
mod tests {
    use eframe::egui::epaint::Mesh;
    use eframe::egui::{Color32, CornerRadius};

    use super::*;

    const SCREEN: Rect = Rect { min: pos2(0.0, 0.0), max: pos2(100.0, 80.0) };

    fn square(x: f32, y: f32, gray: u8) -> ClippedShape {
        let rect = Rect::from_min_size(pos2(x, y), vec2(10.0, 10.0));
        ClippedShape::new(SCREEN, Shape::rect_filled(rect, CornerRadius::ZERO, Color32::from_gray(gray)))
    }

    fn found(before: &[ClippedShape], now: &[ClippedShape]) -> Vec<Rect> {
        let mut areas = Areas::new(SCREEN, 1.0);
        changes(before, now, |texture| texture == TextureId::User(1), &mut areas);
        areas.merged()
    }

    /// A square's place with its smoothed edges.
    fn around(x: f32, y: f32) -> Rect {
        Rect::from_min_size(pos2(x, y), vec2(10.0, 10.0)).expand(FEATHER).intersect(SCREEN)
    }

    #[test]
    fn what_is_equal_is_not_painted() {
        let shapes = [square(0.0, 0.0, 1), square(40.0, 0.0, 2), square(40.0, 0.0, 2)];
        assert_eq!(found(&shapes, &shapes), []);
    }

    #[test]
    fn what_moves_is_painted_where_it_was_and_where_it_is() {
        let before = [square(0.0, 0.0, 1), square(20.0, 0.0, 2), square(0.0, 30.0, 3)];
        let now = [square(0.0, 0.0, 1), square(80.0, 60.0, 2), square(0.0, 30.0, 3)];
        assert_eq!(found(&before, &now), [around(80.0, 60.0), around(20.0, 0.0)]);
    }

    #[test]
    fn what_comes_or_goes_between_others_is_painted_alone() {
        let few = [square(0.0, 0.0, 1), square(0.0, 30.0, 3)];
        let more = [square(0.0, 0.0, 1), square(50.0, 50.0, 2), square(0.0, 30.0, 3)];
        assert_eq!(found(&few, &more), [around(50.0, 50.0)]);
        assert_eq!(found(&more, &few), [around(50.0, 50.0)]);
    }

    #[test]
    fn what_comes_to_the_front_is_painted() {
        let (a, b) = (square(0.0, 0.0, 1), square(5.0, 0.0, 2));
        let areas = found(&[a.clone(), b.clone()], &[b, a]);
        assert_eq!(areas.len(), 1);
        assert!(areas[0].contains_rect(around(0.0, 0.0)), "{areas:?}");
    }

    #[test]
    fn a_texture_with_new_texels_is_painted() {
        let image = |id| {
            let mut mesh = Mesh::with_texture(id);
            let place = Rect::from_min_size(pos2(30.0, 30.0), vec2(10.0, 10.0));
            mesh.add_rect_with_uv(place, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
            [ClippedShape::new(SCREEN, mesh)]
        };
        assert_eq!(found(&image(TextureId::User(1)), &image(TextureId::User(1))), [around(30.0, 30.0)]);
        assert_eq!(found(&image(TextureId::User(2)), &image(TextureId::User(2))), []);
    }

    #[test]
    fn areas_are_whole_pixels_and_do_not_meet() {
        let mut areas = Areas::new(SCREEN, 1.5);
        areas.add(Rect::from_min_max(pos2(10.1, 10.1), pos2(19.0, 20.0)));
        areas.add(Rect::from_min_max(pos2(60.0, 60.0), pos2(70.0, 200.0)));
        areas.add(Rect::from_min_max(pos2(18.0, 19.0), pos2(30.0, 21.0)));
        areas.add(Rect::from_min_max(pos2(-50.0, 0.0), pos2(-1.0, 40.0)));
        let px = |x: f32| x / 1.5;
        let merged = areas.merged();
        assert_eq!(merged.len(), 2);
        // 10.1 points are 15.15 px, 21 are 31.5; 60 are 90, 70 are 105, and the screen ends at 120 px.
        assert_eq!(merged[0], Rect::from_min_max(pos2(px(60.0 * 1.5), 60.0), pos2(70.0, 80.0)));
        assert_eq!(merged[1], Rect::from_min_max(pos2(px(15.0), px(15.0)), pos2(px(45.0), px(32.0))));
    }

    #[test]
    fn a_large_area_does_not_take_in_what_lies_beside_it() {
        let screen = Rect::from_min_max(pos2(0.0, 0.0), pos2(1280.0, 800.0));
        let picture = Rect::from_min_max(pos2(200.0, 25.0), pos2(888.0, 690.0));
        let head = Rect::from_min_max(pos2(500.0, 698.0), pos2(523.0, 738.0));
        let mut areas = Areas::new(screen, 1.0);
        [picture, head].into_iter().for_each(|area| areas.add(area));
        assert_eq!(areas.merged(), [picture, head]);
        // A hundred letters far from each other are a few areas, which hold them all and no other half of the screen.
        let mut areas = Areas::new(screen, 1.0);
        let letters: Vec<Rect> = (0..100)
            .map(|n| Rect::from_min_size(pos2((n % 10) as f32 * 60.0, (n / 10) as f32 * 40.0), vec2(9.0, 9.0)))
            .collect();
        letters.iter().for_each(|letter| areas.add(*letter));
        let merged = areas.merged();
        assert!(merged.len() <= MOST_AREAS, "{merged:?}");
        assert!(letters.iter().all(|letter| merged.iter().any(|area| area.contains_rect(*letter))));
        assert!(merged.iter().all(|area| area.max.x < 560.0 && area.max.y < 380.0), "{merged:?}");
    }
}
