//! Plot of the footage's brightness over the frames, from its analysis.

use eframe::egui::{RichText, Ui};

use super::plots::{self, Axes};
use super::session::Session;
use locard_engine::shot::AnalysisState;
use locard_engine::text::fixed;

/// Palette indices for red, green and blue.
const COLORS: [(usize, &str); 3] = [(5, "red"), (2, "green"), (0, "blue")];

/// Shows the plot, or the reason why there is none.
pub fn show(ui: &mut Ui, session: &Session) {
    let shot = session.project.shot();
    let seen_ev = shot.relative_ev();
    if seen_ev.is_empty() {
        let why = match &shot.analysis {
            AnalysisState::Used(_, findings) => match &findings.gain {
                Some(gain) => format!("The footage was analysed: {gain}."),
                None => "The footage was analysed, but too few surfaces are seen twice.".to_owned(),
            },
            _ => "Unknown: the footage is not analysed.".to_owned(),
        };
        ui.label(RichText::new(why).weak());
        return;
    }
    let here = session.player.frame();
    let colors = COLORS.map(|(n, name)| (plots::palette_color(n, ui.visuals()), name));
    let axes = Axes { name: "Brightness over time", x: "frame", y: "stops", x_range: None, y_from: Some(0.0) };
    let now = seen_ev.get(here).copied();
    let curve = |c: usize| seen_ev.iter().enumerate().map(|(n, ev)| [n as f64, ev[c]]).collect::<Vec<_>>();
    let curves = [0, 1, 2].map(curve);
    plots::show(ui, &axes, move |plot| {
        for (c, (curve, (color, name))) in curves.into_iter().zip(colors).enumerate() {
            plot.line(plots::line(name, curve, color));
            plot.points(plots::dots("this frame", now.iter().map(|now| [here as f64, now[c]]).collect(), color));
        }
    });
    plots::legend_of(ui, &colors);
    if let Some(now) = now {
        let [r, g, b] = now.map(|ev| fixed(ev, 2));
        let text = format!("this frame: red {r}, green {g}, blue {b} stops over the recording's median");
        ui.label(RichText::new(text).small());
    }
}
