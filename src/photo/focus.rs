//! Autofocus on the nearest surface, real or virtual, around the picture's centre.

use crate::fit::quantile::upper_median;
use crate::pixels::{LayerImage, Rect};

/// Side of the focus field relative to the picture's.
const FOCUS_FIELD_SHARE: f64 = 0.06;
/// Minimum coverage of a virtual pixel for focusing.
const MIN_COVERAGE: f32 = 0.5;

/// The focus distance, metres: the median over the focus field of the smaller of real and virtual
/// depth. Without depth there, the median over the virtual objects of the whole picture. `None`
/// without any.
pub fn distance_m(layer: &LayerImage, depth_m: Option<&[f32]>, picture: Rect) -> Option<f64> {
    let depths_around = |part: f64| {
        let half = |side: u32| (0.5 * part * f64::from(side)).ceil() as i32;
        let middle = [(picture.x0 + picture.x1) / 2, (picture.y0 + picture.y1) / 2];
        let (w, h) = (half(picture.width()), half(picture.height()));
        let whole = Rect::full(layer.width, layer.height);
        Rect::new(middle[0] - w, middle[1] - h, middle[0] + w, middle[1] + h).intersection(&whole)
    };
    let depth_m = depth_m.filter(|depth_m| depth_m.len() == layer.depth_m.len());
    let nearest = |i: usize, real: bool| {
        let drawn = Some(layer.depth_m[i]).filter(|_| layer.rgba[i][3] > MIN_COVERAGE);
        let measured = depth_m.filter(|_| real).map(|depth_m| depth_m[i]);
        [drawn, measured].into_iter().flatten().filter(|z| *z > 0.0).min_by(f32::total_cmp)
    };
    let median = |rect: Rect, real: bool| {
        let width = layer.width as usize;
        let index = |y: i32, x: i32| y as usize * width + x as usize;
        let depths =
            (rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).filter_map(move |x| nearest(index(y, x), real)));
        upper_median(depths).map(f64::from)
    };
    median(depths_around(FOCUS_FIELD_SHARE), true).or_else(|| median(depths_around(1.0), false))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn focus_is_the_nearer_of_real_and_virtual_in_the_centre() {
        let mut layer = LayerImage::empty(100, 100);
        let mut depth_m = vec![2.0; 10000];
        let whole = Rect::full(100, 100);
        assert_eq!(distance_m(&layer, None, whole), None);
        assert_eq!(distance_m(&layer, Some(&depth_m), whole), Some(2.0));
        // An object off the centre counts if no other depth is known.
        (layer.rgba[10 * 100 + 10], layer.depth_m[10 * 100 + 10]) = ([1.0; 4], 0.7);
        assert_eq!(distance_m(&layer, Some(&depth_m), whole), Some(2.0));
        depth_m.fill(0.0);
        assert_eq!(distance_m(&layer, Some(&depth_m), whole), Some(f64::from(0.7f32)));
        // An object in the centre, nearer than the wall; a faint one is ignored.
        depth_m.fill(2.0);
        for y in 45..55 {
            for x in 45..55 {
                (layer.rgba[y * 100 + x], layer.depth_m[y * 100 + x]) = ([0.9; 4], 1.25);
            }
        }
        assert_eq!(distance_m(&layer, Some(&depth_m), whole), Some(1.25));
        layer.rgba.iter_mut().for_each(|p| *p = p.map(|c| 0.2 * c));
        assert_eq!(distance_m(&layer, Some(&depth_m), whole), Some(2.0));
    }
}
