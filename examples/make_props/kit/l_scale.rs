//! A photographic L-scale after the ABFO No. 2: legs of 105 mm outside and 80 mm inside,
//! millimetres along the inner edges, centimetre bars along the outer ones, three circles with
//! crosses to check perspective by. The sheet is 0.8 mm thick.

use glam::{Vec2, Vec3, vec2, vec3};

use super::canvas::Canvas;
use super::glb::{Prop, printed};
use super::shape::Shape;

/// Length of a leg outside.
pub const OUTER_MM: f32 = 105.0;
const LEG_MM: f32 = 25.0;
const THICKNESS_MM: f32 = 0.8;

pub const WHITE: [u8; 3] = [238, 238, 236];
pub const BLACK: [u8; 3] = [20, 20, 20];

/// Lies on y = 0, its outer corner at the front left; x and -z along the legs.
pub fn l_scale() -> Prop {
    l_sheet("L-scale", picture(), LEG_MM, THICKNESS_MM)
}

/// A printed L with legs of 105 mm and the given width. The inner square of the picture is cut out.
pub fn l_sheet(name: &'static str, picture: Canvas, leg_mm: f32, thickness_mm: f32) -> Prop {
    let mut shape = Shape::default();
    // Maps a point of the drawing, from the top left, to the model, whose origin is the drawing's
    // middle.
    let place = |p: Vec2, y: f32| vec3(p.x - OUTER_MM / 2.0, y, p.y - OUTER_MM / 2.0);
    let inner = OUTER_MM - leg_mm;
    let blank = vec2(0.6, 0.4); // inside the L, where nothing is drawn
    let legs = [(vec2(0.0, 0.0), vec2(leg_mm, inner), [5, 16]), (vec2(0.0, inner), vec2(OUTER_MM, OUTER_MM), [21, 5])];
    for (low, high, [columns, rows]) in legs {
        for (y, up) in [(thickness_mm, Vec3::Y), (0.0, Vec3::NEG_Y)] {
            shape.grid(columns, rows, |s, t| {
                let p = low + (high - low) * vec2(s, t);
                (place(p, y), up, if up == Vec3::Y { p / OUTER_MM } else { blank })
            });
        }
    }
    let outline = [
        vec2(0.0, 0.0),
        vec2(0.0, OUTER_MM),
        vec2(OUTER_MM, OUTER_MM),
        vec2(OUTER_MM, inner),
        vec2(leg_mm, inner),
        vec2(leg_mm, 0.0),
    ];
    for (i, &from) in outline.iter().enumerate() {
        let to = outline[(i + 1) % outline.len()];
        // The outline runs down the left side first, so the outside is on its right.
        let out = vec2(from.y - to.y, to.x - from.x);
        shape.grid(16, 1, |s, t| (place(from + (to - from) * s, t * thickness_mm), vec3(out.x, 0.0, out.y), blank));
    }
    Prop {
        name,
        pictures: vec![picture],
        repeat: false,
        materials: vec![printed("printed plastic", 0.55)],
        shapes: vec![(shape, 0)],
    }
}

fn picture() -> Canvas {
    let mut canvas = Canvas::new(OUTER_MM, OUTER_MM, 16.0, WHITE);
    // Both legs are drawn in (distance from the inner corner, distance from the outer edge).
    let upright = |along: f32, off: f32| vec2(off, OUTER_MM - LEG_MM - along);
    let lying = |along: f32, off: f32| vec2(LEG_MM + along, OUTER_MM - off);
    leg(&mut canvas, &upright);
    leg(&mut canvas, &lying);
    for middle in [upright(-12.5, 12.5), upright(65.0, 9.5), lying(65.0, 9.5)] {
        circle(&mut canvas, middle);
    }
    canvas
}

fn leg(canvas: &mut Canvas, place: &dyn Fn(f32, f32) -> Vec2) {
    let mut bar = |color, a: (f32, f32), b: (f32, f32)| {
        let (a, b) = (place(a.0, a.1), place(b.0, b.1));
        canvas.rectangle(color, a.min(b), a.max(b));
    };
    // Centimetres along the outer edge, counted from the inner corner: black, white, black, ...
    bar(BLACK, (-20.0, 3.0), (80.0, 3.3));
    for cm in [-2.0, 0.0, 2.0, 4.0, 6.0] {
        bar(BLACK, (cm * 10.0, 0.0), (cm * 10.0 + 10.0, 3.0));
    }
    for mm in 0..80u8 {
        let length = match mm {
            mm if mm % 10 == 0 => 6.0,
            mm if mm % 5 == 0 => 4.2,
            _ => 2.8,
        };
        let at = f32::from(mm);
        bar(BLACK, (at - 0.125, LEG_MM - length), (at + 0.125, LEG_MM));
    }
    for cm in 1..8u8 {
        canvas.digit(BLACK, cm.into(), place(f32::from(cm) * 10.0, LEG_MM - 8.2), 3.4, 0.5);
    }
}

/// A ring and a cross.
fn circle(canvas: &mut Canvas, middle: Vec2) {
    canvas.ring(BLACK, middle, 4.2, 1.0);
    for half in [vec2(5.6, 0.15), vec2(0.15, 5.6)] {
        canvas.rectangle(BLACK, middle - half, middle + half);
    }
}
