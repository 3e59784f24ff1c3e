//! Painting of outlines, gizmos and lamp markers: thin lines that are visible on bright and dark
//! pictures.

use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use glam::DVec2;

use super::super::picture::plate;
use super::gizmo::{Gizmo, Handle};
use super::lamp::Marker;

const SELECTED: Color32 = Color32::from_rgb(230, 159, 0);
const HOVERED: Color32 = Color32::from_rgb(255, 220, 130);
const AXES: [Color32; 3] =
    [Color32::from_rgb(226, 84, 84), Color32::from_rgb(104, 190, 92), Color32::from_rgb(86, 142, 240)];
const PLAIN: Color32 = Color32::from_rgb(225, 225, 225);
/// Room for a label offset a lamp marker, points.
const LABEL_ROOM_PT: f32 = 150.0;
/// Halo below lines, for contrast on white.
const HALO: Color32 = Color32::from_black_alpha(110);

pub fn at(p: DVec2) -> Pos2 {
    pos2(p.x as f32, p.y as f32)
}

fn line(painter: &Painter, points: Vec<Pos2>, width: f32, color: Color32) {
    painter.add(Shape::line(points.clone(), Stroke::new(width + 2.0, HALO)));
    painter.add(Shape::line(points, Stroke::new(width, color)));
}

/// Outline of the selected item.
pub fn outline(painter: &Painter, polygons: &[Vec<Pos2>]) {
    for polygon in polygons {
        painter.add(Shape::closed_line(polygon.clone(), Stroke::new(3.0, Color32::from_black_alpha(70))));
    }
    for polygon in polygons {
        painter.add(Shape::closed_line(polygon.clone(), Stroke::new(1.25, SELECTED)));
    }
}

/// Footprint on the plane below the item, dashed.
pub fn footprint(painter: &Painter, polygons: &[Vec<Pos2>]) {
    for polygon in polygons {
        painter.add(Shape::closed_line(polygon.clone(), Stroke::new(2.5, Color32::from_black_alpha(60))));
        let dashes = Shape::dashed_line(&closed(polygon), Stroke::new(1.0, Color32::from_white_alpha(190)), 4.0, 3.0);
        painter.extend(dashes);
    }
}

fn closed(polygon: &[Pos2]) -> Vec<Pos2> {
    polygon.iter().chain(polygon.first()).copied().collect()
}

/// The gizmo. The hovered handle is highlighted; during a drag the others are hidden.
pub fn gizmo(painter: &Painter, gizmo: &Gizmo, hovered: Option<Handle>, is_dragged: bool) {
    let shows = |handle: Handle| !is_dragged || hovered == Some(handle);
    let color = |handle: Handle, usual: Color32| if hovered == Some(handle) { HOVERED } else { usual };
    let width = |handle: Handle| if hovered == Some(handle) { 2.5 } else { 1.5 };
    if shows(Handle::Heading) {
        let sides = gizmo.ring.iter().zip(gizmo.ring.iter().cycle().skip(1));
        let all: Vec<_> = gizmo.ring.iter().map(|(p, _)| at(*p)).collect();
        painter.add(Shape::closed_line(all, Stroke::new(width(Handle::Heading) + 2.0, HALO)));
        for ((p, front), (q, _)) in sides {
            let usual = if *front { PLAIN } else { PLAIN.gamma_multiply(0.45) };
            painter.line_segment([at(*p), at(*q)], Stroke::new(width(Handle::Heading), color(Handle::Heading, usual)));
        }
    }
    if let (Some(square), true) = (gizmo.square, shows(Handle::Ground)) {
        let edge = color(Handle::Ground, PLAIN);
        let fill = edge.gamma_multiply(if hovered == Some(Handle::Ground) { 0.45 } else { 0.2 });
        let corners = square.map(at).to_vec();
        painter.add(Shape::closed_line(corners.clone(), Stroke::new(width(Handle::Ground) + 1.5, HALO)));
        painter.add(Shape::convex_polygon(corners, fill, Stroke::new(width(Handle::Ground) - 0.5, edge)));
    }
    for (axis, arrow) in gizmo.arrows.iter().enumerate() {
        let (Some([from, to]), true) = (arrow, shows(Handle::Axis(axis))) else { continue };
        let handle = Handle::Axis(axis);
        let (from, to) = (at(*from), at(*to));
        line(painter, vec![from, to], width(handle), color(handle, AXES[axis]));
        let along = (to - from).normalized();
        let (tip, side) = (to + along * 9.0, along.rot90() * 4.5);
        let head = vec![tip, to + side, to - side];
        painter.add(Shape::convex_polygon(head, color(handle, AXES[axis]), Stroke::new(1.0, HALO)));
        text(painter, tip + along * 9.0, Align2::CENTER_CENTER, ["x", "y", "z"][axis], 12.0, color(handle, AXES[axis]));
    }
    if shows(Handle::Size) {
        let (size, centre) = (at(gizmo.size), at(gizmo.centre));
        if hovered == Some(Handle::Size) {
            painter.line_segment([centre, size], Stroke::new(1.0, Color32::from_white_alpha(120)));
        }
        let square = Rect::from_center_size(size, vec2(10.0, 10.0));
        painter.rect_filled(square.expand(1.0), 2.0, HALO);
        painter.rect_filled(square, 1.5, color(Handle::Size, PLAIN));
    }
    if shows(Handle::Slide) {
        let centre = at(gizmo.centre);
        painter.circle_filled(centre, 5.5, HALO);
        painter.circle_filled(centre, 4.0, color(Handle::Slide, SELECTED));
    }
}

/// Marker of a lamp in its colour: with rays for a lamp in view, with an arrow for one outside.
pub fn lamp(painter: &Painter, marker: &Marker, light: Color32, is_selected: bool, label: Option<&str>) {
    let middle = at(marker.at);
    let ring = if is_selected { SELECTED } else { PLAIN };
    let out = |way: DVec2, from: f32, to: f32| {
        let way = vec2(way.x as f32, way.y as f32);
        [middle + way * from, middle + way * to]
    };
    match marker.off_screen {
        None => {
            for n in 0..8 {
                let [from, to] = out(DVec2::from_angle(f64::from(n) * std::f64::consts::FRAC_PI_4), 8.5, 12.5);
                line(painter, vec![from, to], 1.5, ring);
            }
        }
        Some(way) => {
            let ([foot, tip], side) = (out(way, 7.5, 15.0), out(way.perp(), 0.0, 5.0));
            let side = side[1] - side[0];
            painter.add(Shape::convex_polygon(vec![tip, foot + side, foot - side], ring, Stroke::new(1.0, HALO)));
        }
    }
    painter.circle_filled(middle, 7.5, HALO);
    painter.circle_filled(middle, 5.0, light);
    painter.circle_stroke(middle, 5.5, Stroke::new(if is_selected { 2.0 } else { 1.5 }, ring));
    let Some(label) = label else { return };
    // Clear of the gizmo: its arrows mostly point up and to the right, and the gizmo of a lamp out
    // of view is nearer to the centre.
    let clip = painter.clip_rect();
    let is_left = middle.x < clip.center().x;
    let (offset, align) = match marker.off_screen {
        None if middle.x < clip.min.x + LABEL_ROOM_PT => (vec2(-4.0, 18.0), Align2::LEFT_TOP),
        None => (vec2(-14.0, 10.0), Align2::RIGHT_TOP),
        Some(way) if way.x.abs() > way.y.abs() && is_left => (vec2(-8.0, 20.0), Align2::LEFT_TOP),
        Some(way) if way.x.abs() > way.y.abs() => (vec2(8.0, 20.0), Align2::RIGHT_TOP),
        Some(_) if middle.x < clip.min.x + LABEL_ROOM_PT => (vec2(24.0, 0.0), Align2::LEFT_CENTER),
        Some(_) => (vec2(-24.0, 0.0), Align2::RIGHT_CENTER),
    };
    plate(painter, middle + offset, align, label, 12.0);
}

/// Line of an axis constraint, across the picture.
pub fn axis_line(painter: &Painter, points: Vec<Pos2>, axis: usize) {
    painter.add(Shape::line(points.clone(), Stroke::new(2.5, Color32::from_black_alpha(60))));
    painter.add(Shape::line(points, Stroke::new(1.0, AXES[axis])));
}

/// Status line of a transform, with a hint below.
pub fn status(painter: &Painter, corner: Pos2, status: &str, hint: &str) {
    let big = painter.layout_no_wrap(status.to_owned(), FontId::proportional(16.0), Color32::WHITE);
    let small = painter.layout_no_wrap(hint.to_owned(), FontId::proportional(12.0), Color32::from_gray(200));
    let size = vec2(big.size().x.max(small.size().x), big.size().y + small.size().y + 3.0);
    let rect = Rect::from_min_size(corner, size + vec2(20.0, 14.0));
    painter.rect_filled(rect, 5.0, Color32::from_black_alpha(190));
    let below = vec2(0.0, big.size().y + 3.0);
    painter.galley(corner + vec2(10.0, 7.0), big, Color32::WHITE);
    painter.galley(corner + vec2(10.0, 7.0) + below, small, Color32::WHITE);
}

fn text(painter: &Painter, at: Pos2, align: Align2, text: &str, size: f32, color: Color32) {
    let font = FontId::proportional(size);
    painter.text(at + vec2(1.0, 1.0), align, text, font.clone(), Color32::from_black_alpha(200));
    painter.text(at, align, text, font, color);
}
