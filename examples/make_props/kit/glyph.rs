//! An own stroke font: digits and capitals.

use glam::{Vec2, vec2};

/// Width of a glyph's box, of which the height is 1.
pub fn width(letter: char) -> f32 {
    match letter {
        'I' => 0.1,
        '1' => 0.36,
        'M' => 0.8,
        'W' => 0.95,
        _ => 0.6,
    }
}

/// The strokes of a digit or capital in a box of its [`width`], 1 high, y up; none for others.
pub fn strokes(letter: char) -> Vec<Vec<Vec2>> {
    match letter {
        '1' => vec![line(&[[0.0, 0.78], [0.26, 1.0], [0.26, 0.0]])],
        '0'..='9' => digit(letter as u32 - '0' as u32),
        'A'..='M' => first_capitals(letter),
        'N'..='Z' => last_capitals(letter),
        _ => Vec::new(),
    }
}

fn first_capitals(letter: char) -> Vec<Vec<Vec2>> {
    let stem = || line(&[[0.0, 0.0], [0.0, 1.0]]);
    match letter {
        'A' => vec![line(&[[0.0, 0.0], [0.3, 1.0], [0.6, 0.0]]), line(&[[0.1, 0.3], [0.5, 0.3]])],
        'B' => {
            let mut upper = line(&[[0.0, 1.0], [0.32, 1.0]]);
            upper.extend(arc([0.32, 0.77], [0.24, 0.23], 90.0, -90.0));
            upper.push(vec2(0.0, 0.54));
            let mut lower = line(&[[0.0, 0.54], [0.32, 0.54]]);
            lower.extend(arc([0.32, 0.27], [0.28, 0.27], 90.0, -90.0));
            lower.push(vec2(0.0, 0.0));
            vec![stem(), upper, lower]
        }
        'C' => vec![arc([0.33, 0.5], [0.33, 0.5], 40.0, 320.0)],
        'D' => {
            let mut bow = line(&[[0.0, 1.0], [0.2, 1.0]]);
            bow.extend(arc([0.2, 0.5], [0.4, 0.5], 90.0, -90.0));
            bow.push(vec2(0.0, 0.0));
            vec![stem(), bow]
        }
        'E' => vec![line(&[[0.56, 1.0], [0.0, 1.0], [0.0, 0.0], [0.56, 0.0]]), line(&[[0.0, 0.53], [0.48, 0.53]])],
        'F' => vec![line(&[[0.56, 1.0], [0.0, 1.0], [0.0, 0.0]]), line(&[[0.0, 0.53], [0.46, 0.53]])],
        'G' => {
            let mut bow = arc([0.33, 0.5], [0.33, 0.5], 45.0, 325.0);
            bow.extend(line(&[[0.6, 0.45], [0.36, 0.45]]));
            vec![bow]
        }
        'H' => vec![stem(), line(&[[0.6, 0.0], [0.6, 1.0]]), line(&[[0.0, 0.53], [0.6, 0.53]])],
        'I' => vec![line(&[[0.05, 0.0], [0.05, 1.0]])],
        'J' => {
            let mut hook = line(&[[0.5, 1.0], [0.5, 0.26]]);
            hook.extend(arc([0.25, 0.26], [0.25, 0.26], 0.0, -170.0));
            vec![hook]
        }
        'K' => vec![stem(), line(&[[0.56, 1.0], [0.0, 0.4]]), line(&[[0.18, 0.58], [0.6, 0.0]])],
        'L' => vec![line(&[[0.0, 1.0], [0.0, 0.0], [0.54, 0.0]])],
        _ => vec![line(&[[0.0, 0.0], [0.0, 1.0], [0.4, 0.2], [0.8, 1.0], [0.8, 0.0]])],
    }
}

fn last_capitals(letter: char) -> Vec<Vec<Vec2>> {
    let stem = || line(&[[0.0, 0.0], [0.0, 1.0]]);
    let bowl = || {
        let mut bowl = line(&[[0.0, 1.0], [0.32, 1.0]]);
        bowl.extend(arc([0.32, 0.73], [0.28, 0.27], 90.0, -90.0));
        bowl.push(vec2(0.0, 0.46));
        bowl
    };
    match letter {
        'N' => vec![line(&[[0.0, 0.0], [0.0, 1.0], [0.6, 0.0], [0.6, 1.0]])],
        'O' => vec![arc([0.3, 0.5], [0.3, 0.5], 0.0, 360.0)],
        'P' => vec![stem(), bowl()],
        'Q' => vec![arc([0.3, 0.5], [0.3, 0.5], 0.0, 360.0), line(&[[0.36, 0.26], [0.6, 0.0]])],
        'R' => vec![stem(), bowl(), line(&[[0.28, 0.46], [0.6, 0.0]])],
        'S' => vec![arc([0.29, 0.755], [0.27, 0.245], 30.0, 270.0), arc([0.3, 0.255], [0.29, 0.255], 90.0, -150.0)],
        'T' => vec![line(&[[0.0, 1.0], [0.6, 1.0]]), line(&[[0.3, 1.0], [0.3, 0.0]])],
        'U' => {
            let mut bow = line(&[[0.0, 1.0], [0.0, 0.3]]);
            bow.extend(arc([0.3, 0.3], [0.3, 0.3], 180.0, 360.0));
            bow.push(vec2(0.6, 1.0));
            vec![bow]
        }
        'V' => vec![line(&[[0.0, 1.0], [0.3, 0.0], [0.6, 1.0]])],
        'W' => vec![line(&[[0.0, 1.0], [0.22, 0.0], [0.475, 0.9], [0.73, 0.0], [0.95, 1.0]])],
        'X' => vec![line(&[[0.0, 0.0], [0.6, 1.0]]), line(&[[0.0, 1.0], [0.6, 0.0]])],
        'Y' => vec![line(&[[0.0, 1.0], [0.3, 0.5], [0.6, 1.0]]), line(&[[0.3, 0.5], [0.3, 0.0]])],
        _ => vec![line(&[[0.02, 1.0], [0.58, 1.0], [0.0, 0.0], [0.6, 0.0]])],
    }
}

/// The strokes of a digit in a box 0.6 wide and 1 high, y up.
pub fn digit(digit: u32) -> Vec<Vec<Vec2>> {
    match digit {
        0 => vec![arc([0.3, 0.5], [0.3, 0.5], 0.0, 360.0)],
        1 => vec![line(&[[0.1, 0.78], [0.36, 1.0], [0.36, 0.0]])],
        2 => {
            let mut top = arc([0.3, 0.7], [0.295, 0.295], 165.0, -46.0);
            top.extend(line(&[[0.0, 0.0], [0.6, 0.0]]));
            vec![top]
        }
        3 => vec![arc([0.28, 0.76], [0.26, 0.24], 155.0, -90.0), arc([0.28, 0.26], [0.31, 0.26], 90.0, -155.0)],
        4 => vec![line(&[[0.45, 0.0], [0.45, 1.0], [0.0, 0.28], [0.62, 0.28]])],
        5 => {
            let mut bow = line(&[[0.54, 1.0], [0.12, 1.0], [0.07, 0.55]]);
            bow.extend(arc([0.28, 0.32], [0.31, 0.32], 132.0, -150.0));
            vec![bow]
        }
        6 => six(),
        7 => vec![line(&[[0.0, 1.0], [0.6, 1.0], [0.2, 0.0]])],
        8 => vec![arc([0.3, 0.76], [0.25, 0.24], 0.0, 360.0), arc([0.3, 0.27], [0.3, 0.27], 0.0, 360.0)],
        9 => six().into_iter().map(|l| l.into_iter().map(|p| vec2(0.6, 1.0) - p).collect()).collect(),
        _ => Vec::new(),
    }
}

fn six() -> Vec<Vec<Vec2>> {
    vec![arc([0.3, 0.3], [0.3, 0.3], 0.0, 360.0), arc([0.62, 0.3], [0.62, 0.7], 180.0, 98.0)]
}

fn line(points: &[[f32; 2]]) -> Vec<Vec2> {
    points.iter().copied().map(Vec2::from).collect()
}

/// An elliptical arc between two angles, degrees counter-clockwise from the right.
fn arc(middle: [f32; 2], radii: [f32; 2], from: f32, to: f32) -> Vec<Vec2> {
    let at = |i: u32| {
        Vec2::from(middle) + Vec2::from(radii) * Vec2::from_angle((from + (to - from) * i as f32 / 40.0).to_radians())
    };
    (0..=40).map(at).collect()
}
