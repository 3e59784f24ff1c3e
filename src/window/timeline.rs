//! The time line below the picture: a strip of thumbnails for seeking and for the loop; playback
//! controls.

use eframe::egui::{self, Align2, Color32, CursorIcon, FontId, Pos2, Rect, Sense, Stroke, Ui, pos2, vec2};

use super::thumbnails::Thumbnails;
use super::{Pace, Player};

/// Height of the strip, points.
pub const HEIGHT: f32 = 40.0;
/// Distance from an end of the loop within which a drag moves it, points.
const GRIP_PT: f32 = 6.0;

/// Target of a drag on the strip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StripDrag {
    #[default]
    Time,
    Start,
    End,
}

/// Playback information beside the controls.
#[derive(Clone, Debug, Default)]
pub struct PlaybackInfo {
    pub time_s: f64,
    /// Pictures shown in the last second.
    pub shown_per_s: f64,
    /// Reduction factor of the composite's size.
    pub reduced_by: u32,
}

/// Icons of the buttons, painted since not every font has them.
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

pub fn show(ui: &mut Ui, player: &mut Player, info: &PlaybackInfo) {
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
            Pace::EveryFrame | Pace::Arriving => "every frame".to_owned(),
            Pace::Recorded(speed) => format!("{}×", locard_engine::text::number(speed)),
        };
        let combo = egui::ComboBox::from_id_salt("pace").width(92.0).selected_text(pace);
        let response = combo.show_ui(ui, |ui| {
            for speed in [0.1, 0.25, 0.5, 1.0, 2.0] {
                let text = format!("{}×", locard_engine::text::number(speed));
                ui.selectable_value(&mut player.pace, Pace::Recorded(speed), text);
            }
            ui.selectable_value(&mut player.pace, Pace::EveryFrame, "every frame");
        });
        response
            .response
            .on_hover_text("How fast it plays")
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Speed"));
        let last = player.count().saturating_sub(1);
        let dropped = if player.dropped > 0 { format!(", {} dropped", player.dropped) } else { String::new() };
        let rate = if playing { format!(", {:.0}/s{dropped}", info.shown_per_s) } else { String::new() };
        ui.monospace(format!("frame {} of 0–{last}  {:.3} s{rate}", player.frame(), info.time_s));
        if info.reduced_by > 1 {
            ui.label(format!("1/{} size", info.reduced_by))
                .on_hover_text("Reduced for speed; full size when the picture rests");
        }
        let range = player.range();
        if range.len() < player.count() {
            ui.separator();
            ui.label(format!("loop {} to {}", range.start, range.end - 1));
            if ui.small_button("All").on_hover_text("Play all (Shift+I)").clicked() {
                player.set_range(0..player.count());
            }
        }
    });
}

/// The strip: clicks and drags seek; the ends of the loop can be dragged.
pub fn strip(ui: &mut Ui, player: &mut Player, thumbnails: Option<&Thumbnails>, drag: &mut StripDrag) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), HEIGHT), Sense::click_and_drag());
    let (count, frame) = (player.count().max(1), player.frame());
    response.widget_info(|| egui::WidgetInfo::slider(true, frame as f64, "Frame"));
    // All frames have equal widths.
    let x_of = |frame: usize| rect.min.x + rect.width() * frame as f32 / count as f32;
    let at = |x: f32| (((x - rect.min.x) / rect.width() * count as f32).floor().max(0.0) as usize).min(count - 1);
    let range = player.range();
    let (start_x, end_x) = (x_of(range.start), x_of(range.end));
    let hold = |x: f32| match ((x - start_x).abs() <= GRIP_PT, (x - end_x).abs() <= GRIP_PT) {
        (true, _) if range.len() < count || x < rect.min.x + GRIP_PT => StripDrag::Start,
        (_, true) => StripDrag::End,
        _ => StripDrag::Time,
    };
    let pointer_x = response.interact_pointer_pos().map(|at| at.x);
    let hover = response.hover_pos();
    if response.drag_started() {
        *drag = ui.input(|i| i.pointer.press_origin()).map_or(StripDrag::Time, |origin| hold(origin.x));
    }
    if let Some(x) = pointer_x.filter(|_| response.dragged() || response.clicked()) {
        let edge = ((x - rect.min.x) / rect.width() * count as f32).round().clamp(0.0, count as f32) as usize;
        match if response.clicked() { StripDrag::Time } else { *drag } {
            StripDrag::Time => player.seek(at(x)),
            StripDrag::Start => player.set_range(edge.min(range.end - 1)..range.end),
            StripDrag::End => player.set_range(range.start..edge.max(range.start + 1)),
        }
    }
    if hover.is_some_and(|at| hold(at.x) != StripDrag::Time) || response.dragged() && *drag != StripDrag::Time {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
    }

    let painter = ui.painter().with_clip_rect(rect);
    let visuals = ui.visuals();
    painter.rect_filled(rect, 0.0, visuals.extreme_bg_color);
    if let Some(thumbnails) = thumbnails {
        let width = HEIGHT * thumbnails.aspect();
        let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
        for n in 0..(rect.width() / width).ceil() as usize {
            let tile = Rect::from_min_size(rect.min + vec2(n as f32 * width, 0.0), vec2(width, HEIGHT));
            if let Some(texture) = thumbnails.nearest(at(tile.center().x)) {
                painter.image(texture.id(), tile, whole, Color32::WHITE);
            }
        }
    }
    let dim = Color32::from_black_alpha(150);
    let accent = visuals.selection.bg_fill;
    if range.len() < count {
        painter.rect_filled(Rect::everything_left_of(start_x), 0.0, dim);
        painter.rect_filled(Rect::everything_right_of(end_x), 0.0, dim);
        painter.vline(start_x + 1.0, rect.y_range(), Stroke::new(2.0, accent));
        painter.vline(end_x - 1.0, rect.y_range(), Stroke::new(2.0, accent));
    }
    let head = Rect::from_x_y_ranges(x_of(frame)..=x_of(frame + 1), rect.y_range());
    if head.width() > 3.0 {
        painter.rect_filled(head, 0.0, Color32::from_white_alpha(40));
    }
    painter.vline(head.min.x + 1.0, rect.y_range(), Stroke::new(1.0, Color32::from_black_alpha(200)));
    painter.vline(head.min.x, rect.y_range(), Stroke::new(1.0, Color32::WHITE));
    if let Some(hover) = hover {
        let text = at(hover.x).to_string();
        let anchor = if hover.x > rect.center().x { Align2::RIGHT_TOP } else { Align2::LEFT_TOP };
        let offset = vec2(if hover.x > rect.center().x { -8.0 } else { 8.0 }, 4.0);
        let place = pos2(hover.x, rect.min.y) + offset;
        let galley = painter.layout_no_wrap(text, FontId::monospace(12.0), Color32::WHITE);
        let back = anchor.anchor_size(place, galley.size());
        painter.rect_filled(back.expand(2.0), 2.0, Color32::from_black_alpha(190));
        painter.galley(back.min, galley, Color32::WHITE);
    }
}
