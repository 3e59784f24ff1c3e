//! Model of a structured-light depth sensor.

/// Hash of the values, uniform in [0, 1).
fn hashed(values: [usize; 3]) -> f32 {
    let mut h = 0x9e37_79b9_7f4a_7c15u64;
    for v in values {
        h = (h ^ v as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h ^= h >> 29;
    }
    (h >> 40) as f32 / (1u64 << 24) as f32
}

/// Depth as measured by a Kinect, 0 where there is none; `fx_px` is the picture's focal length.
/// Distances in px are of a picture 640 px wide.
///
/// - Foreground is dilated by 1 to 4 px, constant within squares of 6 px, the matching windows
///   (measured against colour edges of a real recording: 2 to 4 px).
/// - The map is shifted by 2 px to the side and 1 px down (time and pose).
/// - Areas not lit by the projector, 75 mm to the left, have no depth (Khoshelham & Elberink 2012,
///   section 2), nor have most black ones.
/// - Half of the edge pixels are flying pixels between the two surfaces.
/// - Disparity is quantised to 1/8 px at a focal length of 580 px.
pub fn measured(exact_m: &[f32], light: &[[f32; 3]], width: usize, fx_px: f32) -> Vec<f32> {
    let height = exact_m.len() / width;
    let scale = width as f32 / 640.0;
    let px = |at640: f32| (at640 * scale).round() as i32;
    let place = |x: i32, y: i32| y.clamp(0, height as i32 - 1) as usize * width + x.clamp(0, width as i32 - 1) as usize;
    let cell = (6.0 * scale).max(1.0) as usize;
    let at = |i: usize| ((i % width) as i32, (i / width) as i32);
    // Dilation and shift.
    let mut out: Vec<f32> = (0..exact_m.len())
        .map(|i| {
            let (x, y) = at(i);
            let (x, y) = (x - px(2.0), y - px(1.0));
            let r = px(1.0 + 3.0 * hashed([x as usize / cell, y as usize / cell, 1]));
            let mut nearest = f32::INFINITY;
            for dy in -r..=r {
                for dx in -r..=r {
                    if dx * dx + dy * dy <= r * r {
                        nearest = nearest.min(exact_m[place(x + dx, y + dy)]);
                    }
                }
            }
            // Slanted surfaces are not dilated.
            let own = exact_m[place(x, y)];
            if own > 1.04 * nearest { nearest } else { own }
        })
        .collect();
    // Flying pixels.
    let before = out.clone();
    for i in 0..out.len() {
        let (x, y) = at(i);
        let around = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dy)| before[place(x + dx, y + dy)]);
        let far = around.into_iter().fold(before[i], f32::max);
        if far > 1.04 * before[i] && hashed([x as usize, y as usize, 2]) < 0.5 {
            let share = hashed([x as usize, y as usize, 3]);
            out[i] = 1.0 / (share / before[i] + (1.0 - share) / far);
        }
    }
    // Projector shadow: a pixel is displaced by fx·b/z in the projector's view, and is in shadow if
    // a nearer pixel is displaced as far or farther.
    let disparity = |z: f32| fx_px * 0.075 / z;
    let lit = out.clone();
    for y in 0..height {
        // Shadows fall to the right of the foreground.
        let mut beyond = f32::NEG_INFINITY;
        for x in 0..width {
            let i = y * width + x;
            let projector_px = x as f32 + disparity(lit[i]);
            if projector_px < beyond - 1.5 {
                out[i] = 0.0;
            }
            beyond = beyond.max(projector_px);
        }
    }
    for i in 0..out.len() {
        let (x, y) = at(i);
        let black = light[i].into_iter().fold(0.0, f32::max) < 0.012;
        if black && hashed([x as usize / cell, y as usize / cell, 4]) < 0.8 {
            out[i] = 0.0;
        }
        if out[i] > 0.0 {
            let steps = 580.0 * 0.075 / out[i] * 8.0;
            out[i] = 580.0 * 0.075 * 8.0 / steps.round().max(1.0);
        }
    }
    out
}
