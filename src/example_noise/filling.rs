//! Fills masked places of planes with values from beside them, so that large residuals there do not
//! leak into the bands of pixels beside them, and a tile of the atlas need not be usable
//! throughout.
//!
//! A masked px takes the value of the nearest usable px that is a multiple of the coding's unit
//! away along an axis or a diagonal, so that the phase of the block grid stays; 0 without one. The
//! order of equally near ones depends on the unit, so that a row of units does not repeat one.

use super::content::block_means;
use crate::coding::BLOCK;
use crate::grey_image::GreyImage;
use crate::hash::pcg3d;

const DIRECTIONS: [[isize; 2]; 8] = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]];

/// A masked px, and the px that replaces it, as indices; `None` if there is none.
type Replacement = (usize, Option<usize>);

/// The replacements of a picture's masked px. `usable` is 1 or 0 for each px, `unit_px` the
/// coding's unit.
fn replacements(usable: &GreyImage, unit_px: [usize; 2]) -> Vec<Replacement> {
    let (width, height) = (usable.width as isize, usable.height as isize);
    let max_distance = (usable.width / unit_px[0]).max(usable.height / unit_px[1]) as isize;
    let mut out = Vec::new();
    for (i, _) in usable.values.iter().enumerate().filter(|(_, usable)| **usable < 0.5) {
        let (x, y) = (i as isize % width, i as isize / width);
        let unit = [x as u32 / unit_px[0] as u32, y as u32 / unit_px[1] as u32];
        let first = pcg3d([unit[0], unit[1], 0])[0] as usize;
        let place = |distance: isize, n: usize| {
            let [dx, dy] = DIRECTIONS[(first + n) % DIRECTIONS.len()];
            let [x, y] = [x + distance * dx * unit_px[0] as isize, y + distance * dy * unit_px[1] as isize];
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            inside.then(|| (y * width + x) as usize).filter(|&at| usable.values[at] > 0.5)
        };
        let nearest = (1..=max_distance).find_map(|distance| (0..DIRECTIONS.len()).find_map(|n| place(distance, n)));
        out.push((i, nearest));
    }
    out
}

/// Replacements for planes at the resolution of luma and of chroma.
#[derive(Clone)]
pub struct PlaneFilling([Vec<Replacement>; 2]);

impl PlaneFilling {
    /// `usable` is 1 or 0 for each px; `factor`: luma px for each chroma sample.
    pub fn new(usable: &GreyImage, factor: [usize; 2]) -> Self {
        // 1 where all px of a chroma sample are usable.
        let mut whole = block_means(usable, factor);
        whole.values.iter_mut().for_each(|v| *v = if *v > 0.999 { 1.0 } else { 0.0 });
        Self([replacements(usable, factor.map(|factor| BLOCK * factor)), replacements(&whole, [BLOCK; 2])])
    }

    /// Fills a plane, or a band, of Y' (0), Cb or Cr.
    pub fn fill(&self, image: &mut GreyImage, plane: usize) {
        fill(image, &self.0[plane.min(1)]);
    }
}

/// Replaces values of a plane; by 0 where there is no replacement.
fn fill(plane: &mut GreyImage, replacements: &[Replacement]) {
    for &(to, from) in replacements {
        plane.values[to] = from.map_or(0.0, |from| plane.values[from]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masked_px_take_the_nearest_usable_px_at_the_same_phase() {
        // A masked area of 40 × 8 px in a ramp.
        let usable =
            GreyImage::from_fn(64, 48, |x, y| if (8..48).contains(&x) && (16..24).contains(&y) { 0.0 } else { 1.0 });
        let mut ramp = GreyImage::from_fn(64, 48, |x, y| (100 * y + x) as f32);
        let pairs = replacements(&usable, [8, 8]);
        assert_eq!(pairs.len(), 40 * 8);
        fill(&mut ramp, &pairs);
        for (to, from) in pairs {
            let from = from.expect("there are usable px");
            let [[x, y], [u, v]] = [to, from].map(|i| [i % 64, i / 64]);
            assert!(usable.values[from] == 1.0 && x.abs_diff(u) % 8 == 0 && y.abs_diff(v) % 8 == 0);
            assert!(x.abs_diff(u) <= 8 && y.abs_diff(v) <= 8, "({x}, {y}) from ({u}, {v})");
            assert_eq!(ramp.values[to], (100 * v + u) as f32);
        }
        let mut masked = GreyImage::uniform(16, 16, 3.0);
        fill(&mut masked, &replacements(&GreyImage::uniform(16, 16, 0.0), [8, 8]));
        assert_eq!(masked, GreyImage::uniform(16, 16, 0.0));
    }
}
