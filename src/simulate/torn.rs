//! Which pixel's surface a pixel of a depth map shows: a sensor compares patches, so things' edges are torn, and near things, whose
//! patches stand out more, are wider than in the picture. What lies within one surface stays where it is.

use super::returned::Returned;

/// The map before its noise, row by row.
pub struct Map<'a> {
    pub width: usize,
    /// m; 0 for none.
    pub depth_m: &'a [f32],
    pub returned: &'a [Returned],
    pub has_depth: &'a [bool],
}

impl Map<'_> {
    fn height(&self) -> usize {
        self.depth_m.len() / self.width.max(1)
    }

    fn is_alike(&self, a: usize, b: usize) -> bool {
        self.returned[a].surface == self.returned[b].surface && self.has_depth[a] == self.has_depth[b]
    }

    /// The pixel so far from another, at the map's rim the last one.
    fn beside(&self, i: usize, way_px: [f64; 2]) -> usize {
        let along = |at: usize, way_px: f64, count: usize| {
            (at as f64 + way_px.round()).clamp(0.0, count.saturating_sub(1) as f64) as usize
        };
        along(i / self.width, way_px[1], self.height()) * self.width + along(i % self.width, way_px[0], self.width)
    }

    /// Whose depth pixel `i` shows, where edges there are torn by `way_px` (x, y) and near things are wider by so many pixels.
    pub fn shown(&self, i: usize, way_px: [f64; 2], wider_px: f64) -> usize {
        let torn = self.beside(i, way_px);
        let reach = wider_px.floor() as usize;
        let (x, y) = (torn % self.width, torn / self.width);
        let mut shown = torn;
        for other_y in y.saturating_sub(reach)..=(y + reach).min(self.height() - 1) {
            for other_x in x.saturating_sub(reach)..=(x + reach).min(self.width - 1) {
                let other = other_y * self.width + other_x;
                let apart = (other_x.abs_diff(x).pow(2) + other_y.abs_diff(y).pow(2)) as f64;
                let is_nearer = self.has_depth[other] && self.depth_m[other] < self.depth_m[shown];
                if is_nearer
                    && apart <= wider_px * wider_px
                    && self.returned[other].surface != self.returned[torn].surface
                {
                    shown = other;
                }
            }
        }
        if self.is_alike(i, shown) { i } else { shown }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thing 1 m away in the columns from 20 on, the wall 2 m away, and right before the thing a shade of 4 columns.
    fn with_map(see: impl Fn(&Map)) {
        let (width, height) = (40, 30);
        let of = |i: usize| i % width;
        let depth_m: Vec<f32> = (0..width * height).map(|i| if of(i) < 20 { 2.0 } else { 1.0 }).collect();
        let returned: Vec<Returned> = (0..width * height)
            .map(|i| Returned { surface: if of(i) < 20 { 1 } else { 2 }, light_per_m2: Some(1.0) })
            .collect();
        let has_depth: Vec<bool> = (0..width * height).map(|i| !(16..20).contains(&of(i))).collect();
        see(&Map { width, depth_m: &depth_m, returned: &returned, has_depth: &has_depth });
    }

    /// Row 10's columns by what they show: w(all), t(hing), and a dot for none.
    fn row(map: &Map, way_px: [f64; 2], wider_px: f64) -> String {
        let letter = |x: usize| {
            let shown = map.shown(10 * map.width + x, way_px, wider_px);
            match (map.has_depth[shown], map.depth_m[shown] > 1.5) {
                (false, _) => '.',
                (true, true) => 'w',
                (true, false) => 't',
            }
        };
        (12..24).map(letter).collect()
    }

    #[test]
    fn edges_go_where_they_are_torn_and_near_things_into_the_shade() {
        with_map(|map| {
            assert_eq!(row(map, [0.0; 2], 0.0), "wwww....tttt");
            assert_eq!(row(map, [2.0, 0.0], 0.0), "ww....tttttt");
            assert_eq!(row(map, [-1.4, 7.0], 0.0), "wwwww....ttt");
            assert_eq!(row(map, [0.0; 2], 3.0), "wwww.ttttttt");
            assert_eq!(row(map, [0.0; 2], 3.9), "wwww.ttttttt");
            assert_eq!(row(map, [0.0; 2], 6.0), "wwtttttttttt");
            assert_eq!(row(map, [-2.0, 0.0], 3.0), "wwwwww.ttttt");
        });
    }

    #[test]
    fn within_a_surface_and_at_the_rim_nothing_is_amiss() {
        with_map(|map| {
            for i in [0, 39, 29 * 40, 29 * 40 + 39, 15 * 40 + 30] {
                assert_eq!(map.shown(i, [-3.0, 3.0], 2.0), i);
            }
        });
    }
}
