//! Edge errors of depth maps. A sensor matches patches, so depth edges are displaced irregularly,
//! and near objects, whose patches have more contrast, are dilated. Interiors of surfaces are
//! unaffected.

use super::sensor_return::SensorReturn;

/// Depth map before its noise, row by row.
pub struct DepthMapView<'a> {
    pub width: usize,
    /// m; 0 for none.
    pub depth_m: &'a [f32],
    pub sensor_return: &'a [SensorReturn],
    pub has_depth: &'a [bool],
}

impl DepthMapView<'_> {
    fn height(&self) -> usize {
        self.depth_m.len() / self.width.max(1)
    }

    fn is_same_surface(&self, a: usize, b: usize) -> bool {
        self.sensor_return[a].surface == self.sensor_return[b].surface && self.has_depth[a] == self.has_depth[b]
    }

    /// Index of the pixel at an offset, clamped to the map.
    fn pixel_at_offset(&self, i: usize, way_px: [f64; 2]) -> usize {
        let shifted = |at: usize, way_px: f64, count: usize| {
            (at as f64 + way_px.round()).clamp(0.0, count.saturating_sub(1) as f64) as usize
        };
        shifted(i / self.width, way_px[1], self.height()) * self.width + shifted(i % self.width, way_px[0], self.width)
    }

    /// Index of the pixel whose depth pixel `i` shows, where edges are displaced by `way_px` (x, y)
    /// and near objects dilated by `dilation_px`.
    pub fn source_pixel(&self, i: usize, way_px: [f64; 2], dilation_px: f64) -> usize {
        let jittered = self.pixel_at_offset(i, way_px);
        let reach = dilation_px.floor() as usize;
        let (x, y) = (jittered % self.width, jittered / self.width);
        let mut source = jittered;
        for other_y in y.saturating_sub(reach)..=(y + reach).min(self.height() - 1) {
            for other_x in x.saturating_sub(reach)..=(x + reach).min(self.width - 1) {
                let other = other_y * self.width + other_x;
                let squared_distance = (other_x.abs_diff(x).pow(2) + other_y.abs_diff(y).pow(2)) as f64;
                let is_nearer = self.has_depth[other] && self.depth_m[other] < self.depth_m[source];
                if is_nearer
                    && squared_distance <= dilation_px * dilation_px
                    && self.sensor_return[other].surface != self.sensor_return[jittered].surface
                {
                    source = other;
                }
            }
        }
        if self.is_same_surface(i, source) { i } else { source }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object 1 m away in columns from 20 on, a wall 2 m away, and a shadow of 4 columns
    /// directly before the object.
    fn with_map(see: impl Fn(&DepthMapView)) {
        let (width, height) = (40, 30);
        let column = |i: usize| i % width;
        let depth_m: Vec<f32> = (0..width * height).map(|i| if column(i) < 20 { 2.0 } else { 1.0 }).collect();
        let sensor_return: Vec<SensorReturn> = (0..width * height)
            .map(|i| SensorReturn { surface: if column(i) < 20 { 1 } else { 2 }, light_per_m2: Some(1.0) })
            .collect();
        let has_depth: Vec<bool> = (0..width * height).map(|i| !(16..20).contains(&column(i))).collect();
        see(&DepthMapView { width, depth_m: &depth_m, sensor_return: &sensor_return, has_depth: &has_depth });
    }

    /// Sources of row 10's columns: w(all), t(arget), and a dot for none.
    fn row(map: &DepthMapView, way_px: [f64; 2], dilation_px: f64) -> String {
        let letter = |x: usize| {
            let source = map.source_pixel(10 * map.width + x, way_px, dilation_px);
            match (map.has_depth[source], map.depth_m[source] > 1.5) {
                (false, _) => '.',
                (true, true) => 'w',
                (true, false) => 't',
            }
        };
        (12..24).map(letter).collect()
    }

    #[test]
    fn edges_are_jittered_and_near_objects_dilated_into_the_shadow() {
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
    fn interiors_and_map_borders_are_unchanged() {
        with_map(|map| {
            for i in [0, 39, 29 * 40, 29 * 40 + 39, 15 * 40 + 30] {
                assert_eq!(map.source_pixel(i, [-3.0, 3.0], 2.0), i);
            }
        });
    }
}
