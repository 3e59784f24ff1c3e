//! How plots look: thin lines, axes with units, and one language of colours. What is real is grey, what is virtual has the
//! accent.

use eframe::egui::{self, Color32, Response, RichText, Ui, WidgetInfo};
use egui_plot::{Line, Plot, PlotPoints, PlotUi, Points};

use crate::calibrate::NoisePoint;

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
        .x_axis_label(RichText::new(axes.x).small())
        .y_axis_label(RichText::new(axes.y).small())
        .y_axis_min_width(34.0)
        .grid_spacing(egui::Rangef::new(24.0, 90.0));
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
    ui.horizontal_wrapped(|ui| {
        for (of, text) in entries {
            let (rect, _) = ui.allocate_exact_size(egui::vec2(10.0, 12.0), egui::Sense::hover());
            ui.painter().circle_filled(rect.center(), 3.0, of.color(ui));
            ui.label(RichText::new(*text).small());
        }
    });
}
