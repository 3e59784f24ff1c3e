//! PictureCoverage of a photograph by an object: its share of the picture, its share in view, its
//! extent.

use glam::DVec2;

/// Cells along the longer side of an object's outline.
const CELLS: f64 = 256.0;

/// Largest share in view of an object of which a part is out of view.
pub const MAX_PARTIAL_VIEW: f64 = 0.999;

/// An object's projection.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PictureCoverage {
    /// Share of the picture that it covers, 0 to 1.
    pub share: f64,
    /// Share of its outline inside the picture, 0 to 1.
    pub in_view: f64,
    /// Bounds of its part in view, px: minimum and maximum. Both zero outside the picture.
    pub low_px: DVec2,
    pub high_px: DVec2,
}

/// The coverage of a picture of `size` (px) by an object's projected triangles, px. Sampled at the
/// centres of a grid of 256 cells along the longer side of the triangles' bounds. Occlusion is not
/// considered.
pub fn coverage(triangles: &[[DVec2; 3]], size: DVec2) -> PictureCoverage {
    let bounds = triangles.iter().flatten().map(|&p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)));
    let Some((low, high)) = bounds.filter(|(low, high)| low.is_finite() && high.is_finite()) else {
        return PictureCoverage::default();
    };
    let extent = high - low;
    if extent.max_element() <= 0.0 {
        return PictureCoverage::default();
    }
    let cell_px = extent.max_element() / CELLS;
    let columns = (extent.x / cell_px).ceil().max(1.0) as usize;
    let rows = (extent.y / cell_px).ceil().max(1.0) as usize;
    let mut covered = vec![false; columns * rows];
    for triangle in triangles {
        fill(&mut covered, columns, &triangle.map(|p| (p - low) / cell_px));
    }
    let (mut whole, mut inside) = (0usize, 0usize);
    for (i, _) in covered.iter().enumerate().filter(|(_, covered)| **covered) {
        let at = low + cell_px * (DVec2::new((i % columns) as f64, (i / columns) as f64) + 0.5);
        whole += 1;
        inside += usize::from(at.cmpge(DVec2::ZERO).all() && at.cmple(size).all());
    }
    let (low_px, high_px) = (low.max(DVec2::ZERO), high.min(size));
    if inside == 0 || !low_px.cmple(high_px).all() {
        return PictureCoverage::default();
    }
    let is_whole = low.cmpge(DVec2::ZERO).all() && high.cmple(size).all();
    PictureCoverage {
        share: (inside as f64 * cell_px * cell_px / (size.x * size.y)).min(1.0),
        in_view: if is_whole { 1.0 } else { (inside as f64 / whole as f64).min(MAX_PARTIAL_VIEW) },
        low_px,
        high_px,
    }
}

/// Marks the cells with their centre inside a triangle of either orientation.
fn fill(covered: &mut [bool], columns: usize, triangle: &[DVec2; 3]) {
    let rows = covered.len() / columns;
    let low = triangle.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = triangle.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let first = |at: f64| (at - 0.5).ceil().max(0.0) as usize;
    let past = |at: f64, count: usize| ((at - 0.5).floor() + 1.0).clamp(0.0, count as f64) as usize;
    for row in first(low.y)..past(high.y, rows) {
        for column in first(low.x)..past(high.x, columns) {
            let at = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
            let side = |k: usize| (triangle[(k + 1) % 3] - triangle[k]).perp_dot(at - triangle[k]);
            let sides = [side(0), side(1), side(2)];
            if sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0) {
                covered[row * columns + column] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of a rectangle.
    fn rectangle(low: [f64; 2], high: [f64; 2]) -> [[DVec2; 3]; 2] {
        let [a, b, c, d] =
            [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]].map(DVec2::from);
        [[a, b, c], [a, c, d]]
    }

    fn longest_px(view: &PictureCoverage) -> f64 {
        (view.high_px - view.low_px).max_element()
    }

    fn close(actual: f64, expected: f64, within: f64) {
        assert!((actual - expected).abs() <= within, "{actual} is not {expected}");
    }

    #[test]
    fn rectangle_in_view_covers_its_area() {
        // 160 × 120 of 640 × 480: a sixteenth.
        let view = coverage(&rectangle([100.0, 50.0], [260.0, 170.0]), DVec2::new(640.0, 480.0));
        close(view.share, 1.0 / 16.0, 1e-3);
        assert_eq!((view.in_view, longest_px(&view)), (1.0, 160.0));
    }

    #[test]
    fn rectangle_over_the_edge_is_in_view_by_its_share() {
        // A quarter of it is right of the edge.
        let view = coverage(&rectangle([520.0, 0.0], [680.0, 100.0]), DVec2::new(640.0, 480.0));
        close(view.in_view, 0.75, 0.01);
        close(view.share, 12_000.0 / 307_200.0, 1e-3);
        close(longest_px(&view), 120.0, 1e-9);
        assert_eq!(
            coverage(&rectangle([700.0, 0.0], [800.0, 100.0]), DVec2::new(640.0, 480.0)),
            PictureCoverage::default()
        );
        assert_eq!(coverage(&[], DVec2::new(640.0, 480.0)), PictureCoverage::default());
    }

    #[test]
    fn overlapping_triangles_count_once() {
        let twice = [rectangle([0.0, 0.0], [64.0, 48.0]), rectangle([0.0, 0.0], [64.0, 48.0])].concat();
        close(coverage(&twice, DVec2::new(640.0, 480.0)).share, 0.01, 1e-4);
    }
}
