//! Depth where the sensor measured none.
//!
//! A structured-light sensor sees from one place and lights from another beside it: what a near thing shades from the
//! light has no depth, and lies behind it, at its side (Khoshelham & Elberink 2012). So has what comes into view
//! when depth is carried to another moment. Of the two ends of such a gap the farther one is what goes on in it, as in
//! views made up from depth (Fehn 2004). Other gaps (dark and shining things, windows) tell nothing of themselves;
//! where their ends are alike, both rules say the same.

/// Rows and columns to either side that smooth what was filled in, so that rows do not stand apart.
const SMOOTHED_PX: i32 = 2;

/// Fills the gaps (0 and what is no distance) of a map, row by row: a gap takes the farther one of its ends, along the row or the
/// column, whichever way it is shorter. `false` where nothing was measured at all.
pub fn fill(depth_m: &mut [f32], width: usize) -> bool {
    let known = |z: f32| z.is_finite() && z > 0.0;
    if width == 0 || !depth_m.iter().any(|z| known(*z)) {
        return false;
    }
    let height = depth_m.len() / width;
    let measured: Vec<bool> = depth_m.iter().map(|z| known(*z)).collect();
    let mut is_known = measured.clone();
    // A row and a column without a measurement meet where there is still nothing; then what was filled in goes on.
    while is_known.contains(&false) {
        let mut found: Vec<(usize, f32)> = vec![(usize::MAX, 0.0); depth_m.len()];
        for y in 0..height {
            gaps(depth_m, &is_known, &mut found, y * width, 1, width);
        }
        for x in 0..width {
            gaps(depth_m, &is_known, &mut found, x, width, height);
        }
        for (i, (length, z)) in found.into_iter().enumerate() {
            if length < usize::MAX {
                (depth_m[i], is_known[i]) = (z, true);
            }
        }
    }
    let filled = depth_m.to_vec();
    let mut around = Vec::new();
    for i in (0..depth_m.len()).filter(|i| !measured[*i]) {
        let (x, y) = ((i % width) as i32, (i / width) as i32);
        let place = |at: i32, side: usize| at.clamp(0, side as i32 - 1) as usize;
        around.clear();
        for dy in -SMOOTHED_PX..=SMOOTHED_PX {
            let row = place(y + dy, height) * width;
            around.extend((-SMOOTHED_PX..=SMOOTHED_PX).map(|dx| filled[row + place(x + dx, width)]));
        }
        around.sort_by(f32::total_cmp);
        depth_m[i] = around[around.len() / 2];
    }
    true
}

/// Along one line of pixels, every gap's length and its farther end, where they are shorter than what was found before.
fn gaps(depth_m: &[f32], known: &[bool], found: &mut [(usize, f32)], first: usize, step: usize, count: usize) {
    let at = |n: usize| first + n * step;
    let mut n = 0;
    while n < count {
        if known[at(n)] {
            n += 1;
            continue;
        }
        let end = (n..count).find(|&m| known[at(m)]).unwrap_or(count);
        let before = n.checked_sub(1).map(|m| depth_m[at(m)]);
        let after = (end < count).then(|| depth_m[at(end)]);
        if let Some(z) = before.into_iter().chain(after).max_by(f32::total_cmp) {
            for m in n..end {
                if end - n < found[at(m)].0 {
                    found[at(m)] = (end - n, z);
                }
            }
        }
        n = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_what_stands_farther_at_its_ends() {
        // A thing at 1 m before a wall at 3 m, and its shadow right of it.
        let row = [3.0, 3.0, 1.0, 1.0, 0.0, 0.0, 3.0, 3.0];
        let mut depth: Vec<f32> = (0..8).flat_map(|_| row).collect();
        assert!(fill(&mut depth, 8));
        for row in depth.chunks(8) {
            assert_eq!(row, [3.0, 3.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
        }
    }

    #[test]
    fn the_shorter_way_through_a_gap_decides() {
        // A gap two rows high across a thing: between its own rows, and not the walls beside it.
        let mut depth = vec![1.0f32; 9 * 9];
        for y in 0..9 {
            (depth[y * 9], depth[y * 9 + 8]) = (4.0, 4.0);
        }
        depth[3 * 9 + 1..3 * 9 + 8].fill(0.0);
        depth[4 * 9 + 1..4 * 9 + 8].fill(f32::NAN);
        assert!(fill(&mut depth, 9));
        assert!((1..8).all(|x| depth[3 * 9 + x] == 1.0 && depth[4 * 9 + x] == 1.0), "{:?}", &depth[27..45]);
    }

    #[test]
    fn borders_and_lone_measurements_go_on() {
        let mut depth = vec![0.0f32; 20];
        depth[7] = 2.5;
        assert!(fill(&mut depth, 5));
        assert!(depth.iter().all(|z| *z == 2.5));
        assert!(!fill(&mut [0.0, f32::NAN, -1.0], 3));
        assert!(!fill(&mut [], 0));
    }
}
