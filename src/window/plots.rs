//! Style of plots: thin lines, axes with units, and consistent colours. Real data are grey, virtual
//! data have the accent colour.

use eframe::egui::{self, Color32, Response, RichText, Ui, Visuals, WidgetInfo};
use egui_plot::{AxisHints, GridInput, GridMark, Line, Plot, PlotPoints, PlotUi, Points};

use locard_engine::calibrate::NoisePoint;

/// Source of a plotted series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataSource {
    Real,
    Virtual,
    /// Model of the profile.
    Profile,
}

impl DataSource {
    pub fn color(self, ui: &Ui) -> Color32 {
        match self {
            Self::Real => ui.visuals().strong_text_color(),
            Self::Virtual => ui.visuals().hyperlink_color,
            Self::Profile => ui.visuals().weak_text_color(),
        }
    }
}

/// Categorical palette: colours on dark and on light; it repeats.
const PALETTE: [[[u8; 3]; 2]; 7] = [
    [[86, 180, 233], [0, 100, 170]],
    [[240, 160, 0], [165, 85, 0]],
    [[50, 205, 150], [0, 115, 75]],
    [[230, 130, 190], [165, 50, 125]],
    [[240, 228, 66], [100, 110, 0]],
    [[255, 115, 95], [195, 35, 15]],
    [[175, 165, 255], [90, 70, 200]],
];

/// Colour of an index.
pub fn palette_color(n: usize, visuals: &Visuals) -> Color32 {
    let [r, g, b] = PALETTE[n % PALETTE.len()][usize::from(!visuals.dark_mode)];
    Color32::from_rgb(r, g, b)
}

const CHANNELS: [&str; 3] = ["Red", "Green", "Blue"];

/// Chooses one of the camera's three channels.
pub fn choose_channel(ui: &mut Ui, channel: &mut usize) {
    for (n, name) in CHANNELS.into_iter().enumerate() {
        ui.selectable_value(channel, n, name);
    }
}

/// Chooses luma (0) or one of the three channels (1 to 3).
pub fn choose_luma_or_channel(ui: &mut Ui, chosen: &mut usize) {
    for (n, name) in ["Luma"].into_iter().chain(CHANNELS).enumerate() {
        ui.selectable_value(chosen, n, name);
    }
}

/// A plot's axes.
#[derive(Clone, Copy, Debug)]
pub struct Axes {
    pub name: &'static str,
    pub x: &'static str,
    pub y: &'static str,
    /// Values that the plot always includes.
    pub x_range: Option<[f64; 2]>,
    pub y_from: Option<f64>,
}

/// Shows a plot without pan and zoom.
pub fn show<'a>(ui: &mut Ui, axes: &Axes, add: impl FnOnce(&mut PlotUi<'a>) + 'a) -> Response {
    let mut plot = Plot::new(axes.name)
        .height(132.0)
        .show_background(false)
        .allow_zoom(false)
        .allow_drag(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .allow_axis_zoom_drag(false)
        .allow_double_click_reset(false)
        .custom_x_axes(vec![AxisHints::new_x().label(RichText::new(axes.x).small()).label_spacing(LABEL_SPACING_PT)])
        .custom_y_axes(vec![
            AxisHints::new_y().label(RichText::new(axes.y).small()).label_spacing(LABEL_SPACING_PT).min_thickness(34.0),
        ])
        .x_grid_spacer(marks)
        .y_grid_spacer(marks)
        .grid_spacing(GRID_SPACING_PT);
    for x in axes.x_range.into_iter().flatten() {
        plot = plot.include_x(x);
    }
    if let Some(y) = axes.y_from {
        plot = plot.include_y(y);
    }
    let response = plot.show(ui, add).response;
    response.widget_info(|| WidgetInfo::labeled(egui::Role::Image, true, axes.name));
    response
}

/// Spacing of axis labels, points: hidden below the minimum, fully opaque from the maximum.
const LABEL_SPACING_PT: egui::Rangef = egui::Rangef { min: 20.0, max: 32.0 };
/// Spacing of grid lines, points: hidden below the minimum, fully opaque from the maximum.
const GRID_SPACING_PT: egui::Rangef = egui::Rangef { min: 36.0, max: 360.0 };

/// Grid marks at multiples of 1, 2 or 5 times a power of ten. With powers of ten alone an axis
/// often has the 0 only.
fn marks(input: GridInput) -> Vec<GridMark> {
    let (step_size, (low, high)) = (step(input.base_step_size), input.bounds);
    let (first, last) = ((low / step_size).ceil(), (high / step_size).floor());
    // Guards against unbounded ranges.
    if !(last - first).is_finite() || last - first > 1e3 {
        return Vec::new();
    }
    (first as i64..=last as i64).map(|n| GridMark { value: n as f64 * step_size, step_size }).collect()
}

/// The smallest 1, 2 or 5 times a power of ten that is at least `min`.
fn step(min: f64) -> f64 {
    let power = 10f64.powf(min.log10().floor());
    let times = [1.0, 2.0, 5.0].into_iter().find(|times| times * power >= min * (1.0 - 1e-9));
    times.unwrap_or(10.0) * power
}

/// A line through points.
pub fn line(name: &str, points: Vec<[f64; 2]>, color: Color32) -> Line<'static> {
    Line::new(name, PlotPoints::from(points)).color(color).width(1.2)
}

pub fn dots(name: &str, points: Vec<[f64; 2]>, color: Color32) -> Points<'static> {
    Points::new(name, PlotPoints::from(points)).color(color).radius(2.6)
}

/// Noise points with error bars, 95 % confidence intervals.
pub fn noise(plot: &mut PlotUi<'_>, name: &str, points: &[NoisePoint], color: Color32) {
    for point in points {
        let [low, high] = point.sigma_ci95;
        plot.line(line(name, vec![[point.code, low], [point.code, high]], color.gamma_multiply(0.6)));
    }
    plot.points(dots(name, points.iter().map(|point| [point.code, point.sigma]).collect(), color));
}

/// Noise points as rings, distinct from dots of the same colour.
pub fn noise_rings(plot: &mut PlotUi<'_>, name: &str, points: &[NoisePoint], color: Color32) {
    let places = points.iter().map(|point| [point.code, point.sigma]).collect();
    plot.points(dots(name, places, color).filled(false).radius(4.0));
}

/// Legend below a plot.
pub fn legend(ui: &mut Ui, entries: &[(DataSource, &str)]) {
    let colored: Vec<_> = entries.iter().map(|(of, text)| (of.color(ui), *text)).collect();
    legend_of(ui, &colored);
}

/// Legend for arbitrary colours.
pub fn legend_of(ui: &mut Ui, entries: &[(Color32, &str)]) {
    ui.horizontal_wrapped(|ui| {
        for (color, text) in entries {
            let (rect, _) = ui.allocate_exact_size(egui::vec2(10.0, 12.0), egui::Sense::hover());
            ui.painter().circle_filled(rect.center(), 3.0, *color);
            ui.label(RichText::new(*text).small());
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairwise distance in RGB, and contrast in luma against the background.
    #[test]
    fn palette_is_distinct_in_light_and_dark() {
        let luma = |c: Color32| 0.3 * f64::from(c.r()) + 0.6 * f64::from(c.g()) + 0.1 * f64::from(c.b());
        let color_distance = |a: Color32, b: Color32| {
            let way = [a.r().abs_diff(b.r()), a.g().abs_diff(b.g()), a.b().abs_diff(b.b())];
            way.iter().map(|d| f64::from(*d).powi(2)).sum::<f64>().sqrt()
        };
        for visuals in [Visuals::dark(), Visuals::light()] {
            let colors: Vec<Color32> = (0..PALETTE.len()).map(|n| palette_color(n, &visuals)).collect();
            for (n, a) in colors.iter().enumerate() {
                assert!((luma(*a) - luma(visuals.panel_fill)).abs() > 80.0, "{a:?}");
                assert!(colors[..n].iter().all(|b| color_distance(*a, *b) > 60.0), "{a:?}");
            }
            assert_eq!(palette_color(colors.len(), &visuals), colors[0]);
        }
    }

    #[test]
    fn grid_steps_are_round_numbers() {
        let steps = [0.7, 1.0, 1.3, 2.1, 5.5, 0.03, 40.0].map(step);
        for (found, expected) in steps.into_iter().zip([1.0, 1.0, 2.0, 5.0, 10.0, 0.05, 50.0]) {
            assert!((found / expected - 1.0).abs() < 1e-12, "{steps:?}");
        }
        let values = |low, high, base_step_size| -> Vec<f64> {
            marks(GridInput { bounds: (low, high), base_step_size }).into_iter().map(|mark| mark.value).collect()
        };
        assert_eq!(values(-8.2, 8.2, 1.9), [-8.0, -6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(values(0.0, 255.0, 40.0), [0.0, 50.0, 100.0, 150.0, 200.0, 250.0]);
        assert!(values(0.0, f64::INFINITY, 1.0).is_empty() && values(0.0, 1.0, 0.0).is_empty());
    }
}
