//! Damage tracking: the areas in which a frame of the window differs from the last one, by
//! comparing shapes instead of pixels.

use std::sync::Arc;

use eframe::egui::epaint::{ClippedShape, Shape, TextShape};
use eframe::egui::{Rect, TextureId, pos2, vec2};

/// Largest number of removed shapes before a match. Beyond that a shape counts as new.
const MAX_SKIPPED_SHAPES: usize = 128;
/// Width of the antialiased border outside of a shape's bounds, points.
const ANTIALIAS_POINTS: f32 = 2.0;
/// Areas are merged if that adds at most this many pixels, which costs as much as another area.
const MERGE_SLACK_PX: f32 = 1024.0;
/// Largest number of areas.
const MAX_AREAS: usize = 16;

/// Adds the areas where `now` differs from `before`, both in painting order. A shape is unchanged
/// if it is equal, follows the same shapes, and its texture is unchanged.
pub fn add_damage(
    before: &[ClippedShape],
    now: &[ClippedShape],
    has_new_texels: impl Fn(TextureId) -> bool,
    areas: &mut Damage,
) {
    let mut rest = before;
    for shape in now {
        let rect = if uses(&shape.shape, &has_new_texels) {
            None
        } else {
            rest.iter().take(MAX_SKIPPED_SHAPES).position(|before| is_same(before, shape))
        };
        match rect {
            Some(at) => {
                rest[..at].iter().for_each(|removed| areas.add(extent(removed)));
                rest = &rest[at + 1..];
            }
            None => areas.add(extent(shape)),
        }
    }
    rest.iter().for_each(|removed| areas.add(extent(removed)));
}

/// Bounds of the pixels that a shape may change, points.
pub fn extent(shape: &ClippedShape) -> Rect {
    let bounds = shape.transform_after_tessellation * shape.shape.visual_bounding_rect();
    if bounds.is_finite() { bounds.expand(ANTIALIAS_POINTS).intersect(shape.clip_rect) } else { Rect::NOTHING }
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

/// Like `==`, without comparing texts that share a layout letter by letter.
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

/// Damaged areas of a screen, points.
pub struct Damage {
    screen: Rect,
    pixels_per_point: f32,
    areas: Vec<Rect>,
}

impl Damage {
    pub fn new(screen: Rect, pixels_per_point: f32) -> Self {
        Self { screen, pixels_per_point, areas: Vec::new() }
    }

    /// Adds an area, enlarged to whole pixels.
    pub fn add(&mut self, area: Rect) {
        let area = area.intersect(self.screen);
        if !area.is_positive() {
            return;
        }
        let ppp = self.pixels_per_point;
        let min = vec2(area.min.x * ppp, area.min.y * ppp).floor() / ppp;
        let max = vec2(area.max.x * ppp, area.max.y * ppp).ceil() / ppp;
        self.areas.push(Rect::from_min_max(pos2(min.x, min.y), pos2(max.x, max.y)));
    }

    /// Merges the areas into few disjoint ones.
    pub fn merged(self) -> Vec<Rect> {
        let mut slack = MERGE_SLACK_PX / self.pixels_per_point.powi(2);
        let mut areas = merge_overlapping(self.areas, slack);
        while areas.len() > MAX_AREAS {
            slack *= 4.0;
            areas = merge_overlapping(areas, slack);
        }
        areas
    }
}

/// Merges areas that overlap or whose union is larger by at most `slack`, points².
fn merge_overlapping(areas: Vec<Rect>, slack: f32) -> Vec<Rect> {
    let should_merge = |a: Rect, b: Rect| a.intersect(b).is_positive() || (a | b).area() <= a.area() + b.area() + slack;
    let mut out: Vec<Rect> = Vec::new();
    for mut area in areas {
        while let Some(at) = out.iter().position(|other| should_merge(*other, area)) {
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

    fn damage_of(before: &[ClippedShape], now: &[ClippedShape]) -> Vec<Rect> {
        let mut areas = Damage::new(SCREEN, 1.0);
        add_damage(before, now, |texture| texture == TextureId::User(1), &mut areas);
        areas.merged()
    }

    /// Bounds of a square with its antialiased border.
    fn around(x: f32, y: f32) -> Rect {
        Rect::from_min_size(pos2(x, y), vec2(10.0, 10.0)).expand(ANTIALIAS_POINTS).intersect(SCREEN)
    }

    #[test]
    fn equal_shapes_are_not_damaged() {
        let shapes = [square(0.0, 0.0, 1), square(40.0, 0.0, 2), square(40.0, 0.0, 2)];
        assert_eq!(damage_of(&shapes, &shapes), []);
    }

    #[test]
    fn moved_shape_damages_its_old_and_new_place() {
        let before = [square(0.0, 0.0, 1), square(20.0, 0.0, 2), square(0.0, 30.0, 3)];
        let now = [square(0.0, 0.0, 1), square(80.0, 60.0, 2), square(0.0, 30.0, 3)];
        assert_eq!(damage_of(&before, &now), [around(80.0, 60.0), around(20.0, 0.0)]);
    }

    #[test]
    fn added_or_removed_shape_damages_only_its_place() {
        let few = [square(0.0, 0.0, 1), square(0.0, 30.0, 3)];
        let more = [square(0.0, 0.0, 1), square(50.0, 50.0, 2), square(0.0, 30.0, 3)];
        assert_eq!(damage_of(&few, &more), [around(50.0, 50.0)]);
        assert_eq!(damage_of(&more, &few), [around(50.0, 50.0)]);
    }

    #[test]
    fn reordered_shapes_are_damaged() {
        let (a, b) = (square(0.0, 0.0, 1), square(5.0, 0.0, 2));
        let areas = damage_of(&[a.clone(), b.clone()], &[b, a]);
        assert_eq!(areas.len(), 1);
        assert!(areas[0].contains_rect(around(0.0, 0.0)), "{areas:?}");
    }

    #[test]
    fn shape_with_a_changed_texture_is_damaged() {
        let image = |id| {
            let mut mesh = Mesh::with_texture(id);
            let place = Rect::from_min_size(pos2(30.0, 30.0), vec2(10.0, 10.0));
            mesh.add_rect_with_uv(place, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
            [ClippedShape::new(SCREEN, mesh)]
        };
        assert_eq!(damage_of(&image(TextureId::User(1)), &image(TextureId::User(1))), [around(30.0, 30.0)]);
        assert_eq!(damage_of(&image(TextureId::User(2)), &image(TextureId::User(2))), []);
    }

    #[test]
    fn areas_are_whole_pixels_and_disjoint() {
        let mut areas = Damage::new(SCREEN, 1.5);
        areas.add(Rect::from_min_max(pos2(10.1, 10.1), pos2(19.0, 20.0)));
        areas.add(Rect::from_min_max(pos2(60.0, 60.0), pos2(70.0, 200.0)));
        areas.add(Rect::from_min_max(pos2(18.0, 19.0), pos2(30.0, 21.0)));
        areas.add(Rect::from_min_max(pos2(-50.0, 0.0), pos2(-1.0, 40.0)));
        let px = |x: f32| x / 1.5;
        let merged = areas.merged();
        assert_eq!(merged.len(), 2);
        // 10.1 points are 15.15 px, 21 are 31.5; 60 are 90, 70 are 105, and the screen ends at 120
        // px.
        assert_eq!(merged[0], Rect::from_min_max(pos2(px(60.0 * 1.5), 60.0), pos2(70.0, 80.0)));
        assert_eq!(merged[1], Rect::from_min_max(pos2(px(15.0), px(15.0)), pos2(px(45.0), px(32.0))));
    }

    #[test]
    fn distant_areas_are_not_merged() {
        let screen = Rect::from_min_max(pos2(0.0, 0.0), pos2(1280.0, 800.0));
        let picture = Rect::from_min_max(pos2(200.0, 25.0), pos2(888.0, 690.0));
        let head = Rect::from_min_max(pos2(500.0, 698.0), pos2(523.0, 738.0));
        let mut areas = Damage::new(screen, 1.0);
        [picture, head].into_iter().for_each(|area| areas.add(area));
        assert_eq!(areas.merged(), [picture, head]);
        // A hundred distant letters become a few areas, which contain them all but not the rest of
        // the screen.
        let mut areas = Damage::new(screen, 1.0);
        let letters: Vec<Rect> = (0..100)
            .map(|n| Rect::from_min_size(pos2((n % 10) as f32 * 60.0, (n / 10) as f32 * 40.0), vec2(9.0, 9.0)))
            .collect();
        letters.iter().for_each(|letter| areas.add(*letter));
        let merged = areas.merged();
        assert!(merged.len() <= MAX_AREAS, "{merged:?}");
        assert!(letters.iter().all(|letter| merged.iter().any(|area| area.contains_rect(*letter))));
        assert!(merged.iter().all(|area| area.max.x < 560.0 && area.max.y < 380.0), "{merged:?}");
    }
}
