//! The time below the picture: play, step, go anywhere.

use eframe::egui::{self, Color32, Pos2, Rect, Ui, vec2};

use super::{Pace, Player};

/// What is said beside the time.
#[derive(Clone, Debug, Default)]
pub struct Told {
    pub time_s: f64,
    /// Pictures shown in the last second.
    pub shown_per_s: f64,
}

/// The signs on the buttons, drawn: not every font has them.
#[derive(Clone, Copy)]
enum Icon {
    First,
    Back,
    Play,
    Pause,
    On,
    Last,
}

impl Icon {
    fn paint(self, ui: &Ui, middle: Pos2, color: Color32) {
        let painter = ui.painter();
        let bar = |x: f32, width: f32| {
            painter.rect_filled(Rect::from_center_size(middle + vec2(x, 0.0), vec2(width, 11.0)), 0.0, color);
        };
        // Points right, or left where `side` is negative.
        let arrow = |x: f32, side: f32| {
            let corners = [vec2(x - 4.0 * side, -5.5), vec2(x - 4.0 * side, 5.5), vec2(x + 5.0 * side, 0.0)];
            let corners = corners.map(|corner| middle + corner).to_vec();
            painter.add(egui::Shape::convex_polygon(corners, color, egui::Stroke::NONE));
        };
        match self {
            Self::First => {
                bar(-5.0, 2.0);
                arrow(1.5, -1.0);
            }
            Self::Back => {
                arrow(-2.5, -1.0);
                bar(5.0, 2.0);
            }
            Self::Play => arrow(0.0, 1.0),
            Self::Pause => {
                bar(-3.0, 3.0);
                bar(3.0, 3.0);
            }
            Self::On => {
                bar(-5.0, 2.0);
                arrow(2.5, 1.0);
            }
            Self::Last => {
                arrow(-1.5, 1.0);
                bar(5.0, 2.0);
            }
        }
    }
}

pub fn show(ui: &mut Ui, player: &mut Player, told: &Told) {
    ui.horizontal(|ui| {
        let playing = player.playing;
        let button = |ui: &mut Ui, icon: Icon, name: &str, hint: &str| {
            let response = ui.add_sized([28.0, 24.0], egui::Button::new(""));
            icon.paint(ui, response.rect.center(), ui.style().interact(&response).text_color());
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
            response.on_hover_text(format!("{name} ({hint})")).clicked()
        };
        if button(ui, Icon::First, "First frame", "Home") {
            player.step(isize::MIN);
        }
        if button(ui, Icon::Back, "One frame back", "Left") {
            player.step(-1);
        }
        let (icon, name) = if playing { (Icon::Pause, "Pause") } else { (Icon::Play, "Play") };
        if button(ui, icon, name, "Space") {
            player.play(!playing);
        }
        if button(ui, Icon::On, "One frame on", "Right") {
            player.step(1);
        }
        if button(ui, Icon::Last, "Last frame", "End") {
            player.step(isize::MAX);
        }
        let pace = match player.pace {
            Pace::EveryFrame => "every frame".to_owned(),
            Pace::Recorded(speed) => format!("{}×", crate::words::number(speed)),
        };
        let combo = egui::ComboBox::from_id_salt("pace").width(92.0).selected_text(pace);
        let response = combo.show_ui(ui, |ui| {
            for speed in [0.1, 0.25, 0.5, 1.0, 2.0] {
                let text = format!("{}×", crate::words::number(speed));
                ui.selectable_value(&mut player.pace, Pace::Recorded(speed), text);
            }
            ui.selectable_value(&mut player.pace, Pace::EveryFrame, "every frame");
        });
        response
            .response
            .on_hover_text("How fast it plays")
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Speed"));
        let last = player.count().saturating_sub(1);
        let mut frame = player.frame();
        let text_width = 320.0;
        ui.spacing_mut().slider_width = (ui.available_width() - text_width - 16.0).max(60.0);
        let slider = ui.add_enabled(last > 0, egui::Slider::new(&mut frame, 0..=last).show_value(false));
        slider.widget_info(|| egui::WidgetInfo::slider(true, frame as f64, "Frame"));
        if slider.changed() {
            player.seek(frame);
        }
        let dropped = if player.dropped > 0 { format!(", {} dropped", player.dropped) } else { String::new() };
        let rate = if playing { format!(", {:.0}/s{dropped}", told.shown_per_s) } else { String::new() };
        ui.monospace(format!("{}/{last}  {:.3} s{rate}", player.frame(), told.time_s));
    });
}
