//! A photomacrographic scale after the ABFO No. 2: an L of 105 mm, legs 25.4 mm wide, 1 mm thick,
//! with three circles, alternating centimetre bars and bars of 18 % reflectance (Forensics Source,
//! "ABFO No. 2 Photomacrographic Scale"; Hyzer and Krauss 1988). The arrangement within a leg and
//! the diameters of the circles are our own.

use glam::{Vec2, vec2};

use super::canvas::{Canvas, Color};
use super::glb::Prop;
use super::l_scale::{BLACK, OUTER_MM, WHITE, l_sheet};

/// One inch.
const LEG_MM: f32 = 25.4;
const THICKNESS_MM: f32 = 1.0;
/// sRGB code of a reflectance of 18 %.
const GREY: Color = [118, 118, 118];
/// Distance of the outer scale's zero from the outer corner.
const OUTER_ZERO_MM: f32 = 4.0;
/// Radius of the line's middle, and its width.
const CIRCLE_MM: [f32; 2] = [5.5, 0.5];

/// Lies on y = 0, its outer corner at the front left; x and -z along the legs.
pub fn scale() -> Prop {
    l_sheet("ABFO No. 2 scale", picture(), LEG_MM, THICKNESS_MM)
}

fn picture() -> Canvas {
    let mut canvas = Canvas::new(OUTER_MM, OUTER_MM, 16.0, WHITE);
    // Both legs are drawn in (distance from the outer corner, distance from the outer edge).
    let upright = |along: f32, off: f32| vec2(off, OUTER_MM - along);
    let lying = |along: f32, off: f32| vec2(along, OUTER_MM - off);
    leg(&mut canvas, &upright);
    leg(&mut canvas, &lying);
    let middle = LEG_MM / 2.0;
    for middle in [upright(middle, middle), upright(97.0, 9.9), lying(97.0, 9.9)] {
        circle(&mut canvas, middle);
    }
    canvas
}

fn leg(canvas: &mut Canvas, place: &dyn Fn(f32, f32) -> Vec2) {
    let mut bar = |color, a: (f32, f32), b: (f32, f32)| {
        let (a, b) = (place(a.0, a.1), place(b.0, b.1));
        canvas.rectangle(color, a.min(b), a.max(b));
    };
    // Ten centimetres along the outer edge.
    for mm in 0..=100u8 {
        let at = OUTER_ZERO_MM + f32::from(mm);
        bar(BLACK, (at - 0.1, 0.0), (at + 0.1, tick_mm(mm, [3.6, 2.8, 2.0])));
    }
    // Eight centimetres along the inner edge, from the inner corner.
    for mm in 0..80u8 {
        let at = LEG_MM + f32::from(mm);
        bar(BLACK, (at - 0.1, LEG_MM - tick_mm(mm, [5.6, 4.0, 2.6])), (at + 0.1, LEG_MM));
    }
    // Centimetres: black and white, and beside them 18 % grey and black.
    bar(BLACK, (LEG_MM, 4.8), (LEG_MM + 60.0, 15.6));
    for cm in 0..6u8 {
        let from = LEG_MM + 10.0 * f32::from(cm);
        let [first, second] = if cm % 2 == 0 { [BLACK, GREY] } else { [WHITE, BLACK] };
        bar(first, (from + 0.2, 5.0), (from + 9.8, 10.1));
        bar(second, (from + 0.2, 10.3), (from + 9.8, 15.4));
    }
    for cm in 1..8u8 {
        let label = cm.to_string();
        canvas.text(BLACK, &label, place(LEG_MM + f32::from(cm) * 10.0, LEG_MM - 7.6), [3.0, 0.42, 0.0]);
    }
}

fn tick_mm(mm: u8, [centimetre, half, millimetre]: [f32; 3]) -> f32 {
    match mm {
        mm if mm % 10 == 0 => centimetre,
        mm if mm % 5 == 0 => half,
        _ => millimetre,
    }
}

fn circle(canvas: &mut Canvas, middle: Vec2) {
    let [radius, line] = CIRCLE_MM;
    canvas.ring(BLACK, middle, radius, line);
    for half in [vec2(radius, 0.1), vec2(0.1, radius)] {
        canvas.rectangle(BLACK, middle - half, middle + half);
    }
}
