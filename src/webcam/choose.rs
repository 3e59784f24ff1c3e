//! The choice of a camera's mode.

use super::list::Mode;
use super::picture::Layout;
use super::wanted::Wanted;

/// The layout that was requested, or the best of those that come in this size at this rate, else of
/// all.
pub fn layout(offered: &[Mode], wanted: &Wanted) -> Option<Layout> {
    let has = |layout: Layout, fits: &dyn Fn(&Mode) -> bool| {
        offered.iter().any(|mode| mode.layout == Some(layout) && fits(mode))
    };
    if let Some(layout) = wanted.layout {
        return has(layout, &|_| true).then_some(layout);
    }
    let fits = |mode: &Mode| {
        let [least, most] = mode.sizes;
        let (w, h) = wanted.size;
        let in_size = (least.0..=most.0).contains(&w) && (least.1..=most.1).contains(&h);
        // A rate of 30 is met by 29.97, and by 29 where a driver lists whole numbers.
        let is_met = |rate: &f64| *rate > 0.99 * wanted.rate_hz || *rate == (0.999 * wanted.rate_hz).floor();
        in_size && (mode.rates_hz.is_empty() || mode.rates_hz.iter().any(is_met))
    };
    let of = |fits: &dyn Fn(&Mode) -> bool| Layout::PREFERRED.into_iter().find(|layout| has(*layout, fits));
    of(&fits).or_else(|| of(&|_| true))
}

/// A mode of one size and one rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactMode {
    pub layout: Layout,
    pub size: (u32, u32),
    pub rate_hz: f64,
}

/// The mode nearest to the request, of modes of single sizes: layout first, then size, then rate.
/// Of two rates equally near, the faster one.
pub fn exact(offered: &[Mode], wanted: &Wanted) -> Option<ExactMode> {
    let layout = layout(offered, wanted)?;
    let of_layout = offered.iter().filter(|mode| mode.layout == Some(layout) && !mode.rates_hz.is_empty());
    let distance_px = |mode: &&Mode| {
        let (width, height) = mode.sizes[0];
        width.abs_diff(wanted.size.0) + height.abs_diff(wanted.size.1)
    };
    let size = of_layout.clone().min_by_key(distance_px)?.sizes[0];
    let rates = of_layout.filter(|mode| mode.sizes[0] == size).flat_map(|mode| &mode.rates_hz);
    let away = |rate: &&f64| (**rate - wanted.rate_hz).abs();
    let rate_hz = *rates.min_by(|a, b| away(a).total_cmp(&away(b)).then(b.total_cmp(a)))?;
    Some(ExactMode { layout, size, rate_hz })
}

/// What was requested, for a message.
pub fn names(layout: Option<Layout>) -> String {
    layout.map_or_else(|| Layout::PREFERRED.map(Layout::name).join(", "), |layout| layout.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(layout: Layout, size: (u32, u32), rates_hz: &[f64]) -> Mode {
        Mode { code: String::new(), layout: Some(layout), sizes: [size; 2], rates_hz: rates_hz.to_vec() }
    }

    /// A webcam as they are: raw at 30 Hz only when small.
    fn webcam() -> [Mode; 3] {
        [
            mode(Layout::Yuyv, (640, 480), &[30.0, 15.0]),
            mode(Layout::Yuyv, (1280, 720), &[10.0]),
            mode(Layout::Mjpeg, (1280, 720), &[29.97]),
        ]
    }

    #[test]
    fn layout_is_the_best_that_comes_as_fast_as_requested() {
        let of = |size, layout| super::layout(&webcam(), &Wanted { size, layout, ..Wanted::default() });
        assert_eq!(of((640, 480), None), Some(Layout::Yuyv));
        assert_eq!(of((1280, 720), None), Some(Layout::Mjpeg));
        assert_eq!(of((1280, 720), Some(Layout::Yuyv)), Some(Layout::Yuyv));
        assert_eq!(of((640, 480), Some(Layout::Nv12)), None);
        // Nothing fits: the nearest of all.
        assert_eq!(of((99, 99), None), Some(Layout::Yuyv));
        // A driver that truncates 29.97.
        let truncated = [mode(Layout::Yuyv, (640, 480), &[5.0]), mode(Layout::Mjpeg, (640, 480), &[29.0])];
        assert_eq!(super::layout(&truncated, &Wanted::default()), Some(Layout::Mjpeg));
    }

    #[test]
    fn exact_mode_is_the_nearest_one() {
        let of = |size, rate_hz, layout| exact(&webcam(), &Wanted { size, rate_hz, layout, ..Wanted::default() });
        let mode = |layout, size, rate_hz| Some(ExactMode { layout, size, rate_hz });
        assert_eq!(of((640, 480), 25.0, None), mode(Layout::Yuyv, (640, 480), 30.0));
        assert_eq!(of((640, 480), 22.5, None), mode(Layout::Yuyv, (640, 480), 30.0));
        assert_eq!(of((640, 480), 16.0, None), mode(Layout::Yuyv, (640, 480), 15.0));
        assert_eq!(of((1920, 1080), 30.0, Some(Layout::Yuyv)), mode(Layout::Yuyv, (1280, 720), 10.0));
        assert_eq!(of((640, 480), 30.0, Some(Layout::Rgb)), None);
        assert_eq!(exact(&[super::tests::mode(Layout::Rgb, (2, 2), &[])], &Wanted::default()), None);
    }
}
