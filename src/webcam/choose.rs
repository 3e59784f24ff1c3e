//! The choice of a camera's mode.

use super::list::CameraMode;
use super::negotiation::FormatRequest;
use super::picture::Layout;

/// The rates of 24000/1001, 30000/1001, 60000/1001 and 120000/1001 Hz, as a driver that lists whole
/// numbers truncates them.
const TRUNCATED_NTSC_HZ: [f64; 4] = [23.0, 29.0, 59.0, 119.0];

/// The rate that a driver means: 30 for 29.
fn nominal_hz(listed_hz: f64) -> f64 {
    if TRUNCATED_NTSC_HZ.contains(&listed_hz) { listed_hz + 1.0 } else { listed_hz }
}

/// The layout that was requested, or the best of those that come in this size at this rate, else of
/// all.
pub fn layout(offered: &[CameraMode], requested: &FormatRequest) -> Option<Layout> {
    let has = |layout: Layout, fits: &dyn Fn(&CameraMode) -> bool| {
        offered.iter().any(|mode| mode.layout == Some(layout) && fits(mode))
    };
    if let Some(layout) = requested.layout {
        return has(layout, &|_| true).then_some(layout);
    }
    let fits = |mode: &CameraMode| {
        let [min, max] = mode.sizes;
        let (w, h) = requested.size;
        let in_size = (min.0..=max.0).contains(&w) && (min.1..=max.1).contains(&h);
        let is_met = |rate: &f64| nominal_hz(*rate) > 0.99 * requested.rate_hz;
        in_size && (mode.rates_hz.is_empty() || mode.rates_hz.iter().any(is_met))
    };
    let preferred_layout =
        |fits: &dyn Fn(&CameraMode) -> bool| Layout::PREFERRED.into_iter().find(|layout| has(*layout, fits));
    preferred_layout(&fits).or_else(|| preferred_layout(&|_| true))
}

/// A mode of one size and one rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactMode {
    pub layout: Layout,
    pub size: (u32, u32),
    pub rate_hz: f64,
}

/// The mode nearest to the request, of modes of single sizes: layout first, then size, then rate.
/// The faster of two equally near rates wins.
pub fn exact(offered: &[CameraMode], requested: &FormatRequest) -> Option<ExactMode> {
    let layout = layout(offered, requested)?;
    let of_layout = offered.iter().filter(|mode| mode.layout == Some(layout) && !mode.rates_hz.is_empty());
    let distance_px = |mode: &&CameraMode| {
        let (width, height) = mode.sizes[0];
        width.abs_diff(requested.size.0) + height.abs_diff(requested.size.1)
    };
    let size = of_layout.clone().min_by_key(distance_px)?.sizes[0];
    let rates = of_layout.filter(|mode| mode.sizes[0] == size).flat_map(|mode| &mode.rates_hz);
    let away = |rate: &&f64| (**rate - requested.rate_hz).abs();
    let rate_hz = *rates.min_by(|a, b| away(a).total_cmp(&away(b)).then(b.total_cmp(a)))?;
    Some(ExactMode { layout, size, rate_hz })
}

/// The requested layout, for a message.
#[cfg(feature = "camera")]
pub fn names(layout: Option<Layout>) -> String {
    layout.map_or_else(|| Layout::PREFERRED.map(Layout::name).join(", "), |layout| layout.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(layout: Layout, size: (u32, u32), rates_hz: &[f64]) -> CameraMode {
        CameraMode { code: String::new(), layout: Some(layout), sizes: [size; 2], rates_hz: rates_hz.to_vec() }
    }

    /// A webcam as they are: raw at 30 Hz only when small.
    fn webcam() -> [CameraMode; 3] {
        [
            mode(Layout::Yuyv, (640, 480), &[30.0, 15.0]),
            mode(Layout::Yuyv, (1280, 720), &[10.0]),
            mode(Layout::Mjpeg, (1280, 720), &[29.97]),
        ]
    }

    #[test]
    fn layout_is_the_best_that_comes_as_fast_as_requested() {
        let layout_for =
            |size, layout| super::layout(&webcam(), &FormatRequest { size, layout, ..FormatRequest::default() });
        assert_eq!(layout_for((640, 480), None), Some(Layout::Yuyv));
        assert_eq!(layout_for((1280, 720), None), Some(Layout::Mjpeg));
        assert_eq!(layout_for((1280, 720), Some(Layout::Yuyv)), Some(Layout::Yuyv));
        assert_eq!(layout_for((640, 480), Some(Layout::Nv12)), None);
        // Nothing fits: the nearest of all.
        assert_eq!(layout_for((99, 99), None), Some(Layout::Yuyv));
        // A driver that truncates 29.97.
        let truncated = [mode(Layout::Yuyv, (640, 480), &[5.0]), mode(Layout::Mjpeg, (640, 480), &[29.0])];
        assert_eq!(super::layout(&truncated, &FormatRequest::default()), Some(Layout::Mjpeg));
    }

    #[test]
    fn truncated_rates_meet_the_ntsc_rates_alone() {
        let is_met = |listed_hz, rate_hz| {
            let offered = [mode(Layout::Yuyv, (640, 480), &[listed_hz]), mode(Layout::Mjpeg, (640, 480), &[1000.0])];
            super::layout(&offered, &FormatRequest { rate_hz, ..FormatRequest::default() }) == Some(Layout::Yuyv)
        };
        for (listed_hz, rate_hz) in [(23.0, 24.0), (29.0, 30.0), (29.0, 29.97), (59.0, 60.0), (119.0, 120.0)] {
            assert!(is_met(listed_hz, rate_hz), "{listed_hz} meets {rate_hz}");
        }
        for (listed_hz, rate_hz) in [(24.0, 25.0), (14.0, 15.0), (28.0, 30.0), (49.0, 50.0)] {
            assert!(!is_met(listed_hz, rate_hz), "{listed_hz} does not meet {rate_hz}");
        }
    }

    #[test]
    fn exact_mode_is_the_nearest_one() {
        let exact_mode = |size, rate_hz, layout| {
            exact(&webcam(), &FormatRequest { size, rate_hz, layout, ..FormatRequest::default() })
        };
        let mode = |layout, size, rate_hz| Some(ExactMode { layout, size, rate_hz });
        assert_eq!(exact_mode((640, 480), 25.0, None), mode(Layout::Yuyv, (640, 480), 30.0));
        assert_eq!(exact_mode((640, 480), 22.5, None), mode(Layout::Yuyv, (640, 480), 30.0));
        assert_eq!(exact_mode((640, 480), 16.0, None), mode(Layout::Yuyv, (640, 480), 15.0));
        assert_eq!(exact_mode((1920, 1080), 30.0, Some(Layout::Yuyv)), mode(Layout::Yuyv, (1280, 720), 10.0));
        assert_eq!(exact_mode((640, 480), 30.0, Some(Layout::Rgb)), None);
        assert_eq!(exact(&[super::tests::mode(Layout::Rgb, (2, 2), &[])], &FormatRequest::default()), None);
    }
}
