//! How plots look: thin lines, axes with units, and one language of colours. What is real is grey, what is virtual has the
//! accent.

use eframe::egui::{self, Color32, Response, RichText, Ui, Visuals, WidgetInfo};
use egui_plot::{AxisHints, GridInput, GridMark, Line, Plot, PlotPoints, PlotUi, Points};

use locard_engine::calibrate::NoisePoint;

/// What a line or a point stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    Real,
    Virtual,
    /// What a profile says.
    Profile,
}

impl Of {
    pub fn color(self, ui: &Ui) -> Color32 {
        match self {
            Self::Real => ui.visuals().strong_text_color(),
            Self::Virtual => ui.visuals().hyperlink_color,
            Self::Profile => ui.visuals().weak_text_color(),
        }
    }
}

/// Colours of things of one kind in one plot, on dark and on light; then they begin again.
const TOLD_APART: [[[u8; 3]; 2]; 7] = [
    [[86, 180, 233], [0, 100, 170]],
    [[240, 160, 0], [165, 85, 0]],
    [[50, 205, 150], [0, 115, 75]],
    [[230, 130, 190], [165, 50, 125]],
    [[240, 228, 66], [100, 110, 0]],
    [[255, 115, 95], [195, 35, 15]],
    [[175, 165, 255], [90, 70, 200]],
];

/// The colour of the one of that number.
pub fn told_apart(n: usize, visuals: &Visuals) -> Color32 {
    let [r, g, b] = TOLD_APART[n % TOLD_APART.len()][usize::from(!visuals.dark_mode)];
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
    /// Always within the plot.
    pub x_range: Option<[f64; 2]>,
    pub y_from: Option<f64>,
}

/// Draws a plot that stays where it is, as high as it needs to be.
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
        .custom_x_axes(vec![AxisHints::new_x().label(RichText::new(axes.x).small()).label_spacing(LABELS)])
        .custom_y_axes(vec![
            AxisHints::new_y().label(RichText::new(axes.y).small()).label_spacing(LABELS).min_thickness(34.0),
        ])
        .x_grid_spacer(marks)
        .y_grid_spacer(marks)
        .grid_spacing(GRID);
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

/// Between an axis' numbers, points: closer ones are left out, and those further apart are plain.
const LABELS: egui::Rangef = egui::Rangef { min: 20.0, max: 32.0 };
/// Between the lines of the grid, points: at least, and from where on they are plain.
const GRID: egui::Rangef = egui::Rangef { min: 36.0, max: 360.0 };

/// Marks at whole multiples of 1, 2 or 5, each with its number. Powers of ten alone would often leave the 0.
fn marks(input: GridInput) -> Vec<GridMark> {
    let (step_size, (low, high)) = (step(input.base_step_size), input.bounds);
    let (first, last) = ((low / step_size).ceil(), (high / step_size).floor());
    // No plot has more.
    if !(last - first).is_finite() || last - first > 1e3 {
        return Vec::new();
    }
    (first as i64..=last as i64).map(|n| GridMark { value: n as f64 * step_size, step_size }).collect()
}

/// 1, 2 or 5 times a power of ten, at least that large.
fn step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    let times = [1.0, 2.0, 5.0].into_iter().find(|times| times * power >= least * (1.0 - 1e-9));
    times.unwrap_or(10.0) * power
}

/// A line through points.
pub fn line(name: &str, points: Vec<[f64; 2]>, color: Color32) -> Line<'static> {
    Line::new(name, PlotPoints::from(points)).color(color).width(1.2)
}

pub fn dots(name: &str, points: Vec<[f64; 2]>, color: Color32) -> Points<'static> {
    Points::new(name, PlotPoints::from(points)).color(color).radius(2.6)
}

/// Points of noise with the bars of their intervals.
pub fn noise(plot: &mut PlotUi<'_>, name: &str, points: &[NoisePoint], color: Color32) {
    for point in points {
        let [low, high] = point.sigma_ci95;
        plot.line(line(name, vec![[point.code, low], [point.code, high]], color.gamma_multiply(0.6)));
    }
    plot.points(dots(name, points.iter().map(|point| [point.code, point.sigma]).collect(), color));
}

/// Points of noise as rings, to tell them from dots of the same colour.
pub fn noise_rings(plot: &mut PlotUi<'_>, name: &str, points: &[NoisePoint], color: Color32) {
    let places = points.iter().map(|point| [point.code, point.sigma]).collect();
    plot.points(dots(name, places, color).filled(false).radius(4.0));
}

/// What the colours mean here, in a line below a plot.
pub fn legend(ui: &mut Ui, entries: &[(Of, &str)]) {
    let colored: Vec<_> = entries.iter().map(|(of, text)| (of.color(ui), *text)).collect();
    legend_of(ui, &colored);
}

/// The same for colours of any kind.
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

    /// Far apart by the differences of their codes, and from the ground by lightness.
    #[test]
    fn colours_can_be_told_apart_in_light_and_dark() {
        let luma = |c: Color32| 0.3 * f64::from(c.r()) + 0.6 * f64::from(c.g()) + 0.1 * f64::from(c.b());
        let apart = |a: Color32, b: Color32| {
            let way = [a.r().abs_diff(b.r()), a.g().abs_diff(b.g()), a.b().abs_diff(b.b())];
            way.iter().map(|d| f64::from(*d).powi(2)).sum::<f64>().sqrt()
        };
        for visuals in [Visuals::dark(), Visuals::light()] {
            let colors: Vec<Color32> = (0..TOLD_APART.len()).map(|n| told_apart(n, &visuals)).collect();
            for (n, a) in colors.iter().enumerate() {
                assert!((luma(*a) - luma(visuals.panel_fill)).abs() > 80.0, "{a:?}");
                assert!(colors[..n].iter().all(|b| apart(*a, *b) > 60.0), "{a:?}");
            }
            assert_eq!(told_apart(colors.len(), &visuals), colors[0]);
        }
    }

    #[test]
    fn an_axis_has_more_than_its_zero() {
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
