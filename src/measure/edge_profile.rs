//! Light profile across a region, for diagnosing an edge that cannot be measured.

use crate::grey_image::GreyImage;
use crate::pixels::Rect;

/// Width of a bin, px.
const BIN_PX: f64 = 0.5;
/// Minimum number of pixels per bin.
const MIN_BIN_PIXELS: usize = 4;

/// Distance from the region's centre, px, and mean light there, along the direction of greatest
/// change: the principal axis of the structure tensor (Bigün and Granlund 1987), from the darker to
/// the brighter side. Empty if the region has fewer than 3x3 px in the picture.
pub fn light_profile(light: &GreyImage<f64>, region: Rect) -> Vec<[f64; 2]> {
    let region = region.intersection(&Rect::full(light.width as u32, light.height as u32));
    if region.width().min(region.height()) < 3 {
        return Vec::new();
    }
    let at = |x: i32, y: i32| light.clamped(i64::from(x), i64::from(y));
    let (mut xx, mut xy, mut yy, mut sum) = (0.0, 0.0, 0.0, [0.0; 2]);
    for (y, x) in (region.y0 + 1..region.y1 - 1).flat_map(|y| (region.x0 + 1..region.x1 - 1).map(move |x| (y, x))) {
        let (gx, gy) = (at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1));
        (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
        sum = [sum[0] + gx, sum[1] + gy];
    }
    let angle = 0.5 * f64::atan2(2.0 * xy, xx - yy);
    let (mut sin, mut cos) = angle.sin_cos();
    if sum[0] * cos + sum[1] * sin < 0.0 {
        (sin, cos) = (-sin, -cos);
    }
    let middle = [0.5 * f64::from(region.x0 + region.x1), 0.5 * f64::from(region.y0 + region.y1)];
    let mut bins = std::collections::BTreeMap::new();
    for (y, x) in (region.y0..region.y1).flat_map(|y| (region.x0..region.x1).map(move |x| (y, x))) {
        let way = (f64::from(x) + 0.5 - middle[0]) * cos + (f64::from(y) + 0.5 - middle[1]) * sin;
        let bin: &mut (f64, usize) = bins.entry((way / BIN_PX).round() as i64).or_default();
        *bin = (bin.0 + at(x, y), bin.1 + 1);
    }
    let full = bins.into_iter().filter(|(_, (_, count))| *count >= MIN_BIN_PIXELS);
    full.map(|(bin, (light, count))| [bin as f64 * BIN_PX, light / count as f64]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A soft line of light that crosses 40x30 px at 30 degrees from vertical, between a dark and a
    /// brighter side.
    fn crossed() -> GreyImage<f64> {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let light = |x: usize, y: usize| {
            let way = (x as f64 + 0.5 - 20.0) * cos + (y as f64 + 0.5 - 15.0) * sin;
            0.1 + 0.2 / (1.0 + (-3.0 * way).exp()) + 0.7 * (-way * way / 4.5).exp()
        };
        GreyImage::new(40, 30, (0..1200).map(|i| light(i % 40, i / 40)).collect()).unwrap()
    }

    #[test]
    fn profile_of_a_line_has_its_shape() {
        let profile = light_profile(&crossed(), Rect::full(40, 30));
        let near = |at: f64| profile.iter().min_by(|a, b| (a[0] - at).abs().total_cmp(&(b[0] - at).abs())).unwrap()[1];
        assert!((near(-6.0) - 0.1).abs() < 0.02 && (near(6.0) - 0.3).abs() < 0.02, "{profile:?}");
        // 0.1, half of 0.2, and 0.7; minus the effect of a half-pixel bin on the peak.
        assert!((near(0.0) - 0.9).abs() < 0.02, "{profile:?}");
        // From the darker side, even if it is on the right.
        let mut turned = crossed();
        turned.values.reverse();
        let profile = light_profile(&turned, Rect::full(40, 30));
        assert!(profile[0][1] < 0.15 && profile[profile.len() - 1][1] > 0.25, "{profile:?}");
        assert!(light_profile(&turned, Rect::new(39, 0, 50, 30)).is_empty());
    }
}
