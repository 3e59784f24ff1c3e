//! Evidence markers with numbers and letters: a folded sheet of yellow plastic, 110 mm wide.

use glam::{Vec2, Vec3, vec2, vec3};

use super::canvas::Canvas;
use super::glb::{Prop, printed};
use super::shape::Shape;

const WIDTH_MM: f32 = 110.0;
/// From the middle of the marker to the outside of a foot.
const FOOT_MM: f32 = 45.0;
/// A panel from its foot to the beginning of the fold.
const PANEL_MM: f32 = 112.0;
const THICKNESS_MM: f32 = 2.0;
/// Radius of the fold's outside.
const FOLD_MM: f32 = 4.0;

const YELLOW: [u8; 3] = [247, 203, 24];
const BLACK: [u8; 3] = [22, 22, 22];

/// Cells of the sheet: columns across, and the positions of the rows, 0 to 1.
struct Cells {
    columns: u16,
    /// From the front foot to the top.
    front: Vec<f32>,
    /// From the top to the back foot.
    back: Vec<f32>,
    /// From foot to foot.
    whole: Vec<f32>,
}

impl Cells {
    fn uniform(columns: u16, rows: u8) -> Self {
        let even = |rows: u8| (0..=rows).map(|row| f32::from(row) / f32::from(rows)).collect::<Vec<_>>();
        Self { columns, front: even(rows), back: even(rows), whole: even(2 * rows) }
    }

    /// The same surface as [`uniform`](Self::uniform) with 25 rows, without those in the flat
    /// panels.
    fn coarse() -> Self {
        let front = vec![0.0, PANEL_SHARE, 0.84, 0.88, 0.92, 0.96, 1.0];
        let back: Vec<f32> = front.iter().rev().map(|t| 1.0 - t).collect();
        let whole = front.iter().map(|t| t / 2.0).chain(back[1..].iter().map(|t| 0.5 + t / 2.0)).collect();
        Self { columns: 1, front, back, whole }
    }
}

/// The position of the row at the share `t` of all rows.
fn row_at(rows: &[f32], t: f32) -> f32 {
    rows[(t * (rows.len() - 1) as f32).round() as usize]
}

/// Markers 1 to 9.
pub fn numbered(digit: u32) -> Prop {
    let mut canvas = sheet();
    canvas.digit(BLACK, digit, label_middle(), 80.0, 13.0);
    marker(canvas, &Cells::uniform(12, 25))
}

/// Markers with two digits or a letter.
pub fn lettered(label: &str) -> Prop {
    let mut canvas = sheet();
    let size = if label.len() > 1 { [72.0, 11.5, 7.0] } else { [80.0, 13.0, 0.0] };
    canvas.text(BLACK, label, label_middle(), size);
    marker(canvas, &Cells::coarse())
}

fn marker(picture: Canvas, cells: &Cells) -> Prop {
    // The panel leans by `lean` from upright so that the fold's arc meets both sides smoothly.
    let lean = lean();
    let profile = |t: f32, inset: f32| -> (Vec2, Vec2) {
        // (z, y) and the outward normal, along foot, panel, fold, panel, foot; t from 0 to 1.
        let fold_turn = std::f32::consts::PI - 2.0 * lean;
        let side = if t < 0.5 { 1.0 } else { -1.0 };
        let from_foot = 1.0 - (2.0 * t - 1.0).abs(); // 0 at the feet, 1 at the top
        let out = |angle: f32| vec2(angle.cos(), angle.sin());
        let top = vec2(0.0, PANEL_MM * lean.cos() - FOLD_MM * lean.sin());
        let (point, way) = if from_foot <= PANEL_SHARE {
            let way = out(lean);
            let foot = vec2(FOOT_MM, 0.0);
            (foot + vec2(-lean.sin(), lean.cos()) * PANEL_MM * (from_foot / PANEL_SHARE), way)
        } else {
            let way = out(lean + fold_turn / 2.0 * (from_foot - PANEL_SHARE) / (1.0 - PANEL_SHARE));
            (top + way * FOLD_MM, way)
        };
        let point = point - way * inset;
        (vec2(point.x * side, point.y.max(0.0)), vec2(way.x * side, way.y))
    };
    let mut shape = Shape::default();
    // Each side separately, since one picture would otherwise mirror the other.
    for (from, side, rows) in [(0.0, 1.0, &cells.front), (0.5, -1.0, &cells.back)] {
        for (inset, facing) in [(0.0, 1.0), (THICKNESS_MM, -1.0)] {
            shape.grid(cells.columns, rows.len() as u16 - 1, |s, t| {
                let t = row_at(rows, t);
                let (p, way) = profile((from + t / 2.0 + if side < 0.0 { 1e-6 } else { -1e-6 }).clamp(0.0, 1.0), inset);
                let x = (s - 0.5) * WIDTH_MM;
                let from_foot = if side > 0.0 { t } else { 1.0 - t };
                // The inside is plain: it uses the margin beside the digit.
                let uv = vec2(if side > 0.0 { s } else { 1.0 - s }, 1.0 - from_foot);
                let uv = if facing > 0.0 { uv } else { vec2(0.02, 0.3) };
                (vec3(x, p.y, p.x), vec3(0.0, way.y, way.x) * facing, uv)
            });
        }
    }
    for x in [-1.0, 1.0] {
        shape.grid(1, cells.whole.len() as u16 - 1, |s, t| {
            let (p, _) = profile(row_at(&cells.whole, t), s * THICKNESS_MM);
            (vec3(x * WIDTH_MM / 2.0, p.y, p.x), Vec3::X * x, vec2(0.02, 0.3))
        });
    }
    for t in [0.0, 1.0] {
        shape.grid(cells.columns, 1, |s, inset| {
            let (p, _) = profile(t, inset * THICKNESS_MM);
            (vec3((s - 0.5) * WIDTH_MM, 0.0, p.x), Vec3::NEG_Y, vec2(0.02, 0.3))
        });
    }
    Prop {
        name: "evidence marker",
        pictures: vec![picture],
        repeat: false,
        materials: vec![printed("yellow plastic", 0.42)],
        shapes: vec![(shape, 0)],
    }
}

/// The share of half the profile's parameter that the flat panel takes.
const PANEL_SHARE: f32 = 0.8;

/// Solves foot = panel · sin(lean) + fold radius · cos(lean) by bisection.
fn lean() -> f32 {
    let (mut low, mut high) = (0.0f32, 1.5f32);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        let foot = PANEL_MM * middle.sin() + FOLD_MM * middle.cos();
        if foot < FOOT_MM { low = middle } else { high = middle }
    }
    low
}

/// Middle of the label in the picture, mm from the top left.
fn label_middle() -> Vec2 {
    vec2(WIDTH_MM / 2.0, PANEL_MM / PANEL_SHARE - PANEL_MM + 47.0)
}

/// The texture of one panel without its label: a bar of centimetres above the foot. v is linear in
/// the profile's parameter, so the panel's 112 mm take the picture's lower 0.8.
fn sheet() -> Canvas {
    let height = PANEL_MM / PANEL_SHARE;
    let mut canvas = Canvas::new(WIDTH_MM, height, 5.0, YELLOW);
    let bar = height - 14.0;
    canvas.rectangle(BLACK, vec2(4.5, bar - 0.5), vec2(105.5, bar + 6.5));
    for cm in 0..10u8 {
        let color = if cm % 2 == 0 { [240, 240, 240] } else { BLACK };
        let x = 5.0 + 10.0 * f32::from(cm);
        canvas.rectangle(color, vec2(x, bar), vec2(x + 10.0, bar + 6.0));
    }
    canvas
}
