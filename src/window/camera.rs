//! The bar below a live picture: status and commands of the camera.

use eframe::egui::{self, Color32, RichText, Stroke, Ui};

use super::session::{LiveStatus, RECENT_S, Session};
use super::timeline;
use locard_engine::live::{FeedStatus, Tracking};
use locard_engine::text::{count, without_options};

/// A command for the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraCommand {
    /// Turns the last seconds into a recording and shows it.
    Freeze,
    /// Returns to the live picture.
    Live,
    /// Starts a recording.
    Record,
    /// Ends the recording.
    Stop,
    /// Copies the last seconds into a permanent recording.
    Keep,
}

/// Latency at the full height of the strip, seconds.
const MAX_SHOWN_LATENCY_S: f64 = 0.2;
/// Colour of the light of a running camera.
const LIGHT: Color32 = Color32::from_rgb(222, 54, 54);

/// Status in place of the time line during a live view.
pub fn show(ui: &mut Ui, session: &Session) {
    let Some(live) = session.live_status() else { return };
    strip(ui, session);
    ui.add_space(3.0);
    ui.horizontal(|ui| {
        light(ui, state_word(&live.status));
        ui.separator();
        status_line(ui, session, &live);
    });
}

/// Buttons of the camera, if there is one.
pub fn buttons(ui: &mut Ui, session: &Session) -> Option<CameraCommand> {
    let live = session.live_status()?;
    let mut command = None;
    ui.horizontal(|ui| {
        let mut button = |ui: &mut Ui, enabled: bool, text: &str, hint: &str, what: CameraCommand| {
            if ui.add_enabled(enabled, egui::Button::new(text)).on_hover_text(hint).clicked() {
                command = Some(what);
            }
        };
        if session.is_frozen() {
            button(ui, true, "Back to live", "Back to the camera (C)", CameraCommand::Live);
            button(ui, true, "Keep as a recording…", "A copy in a folder of yours", CameraCommand::Keep);
            ui.label("The last seconds, as they were seen");
        } else {
            let hint = "Its last seconds become a recording (Space)";
            button(ui, !live.is_freezing, "Freeze", hint, CameraCommand::Freeze);
        }
        match live.status.recorded {
            None if session.is_frozen() => {}
            None => button(ui, true, "Record…", "Its pictures from now on, into a new folder", CameraCommand::Record),
            Some(frames) => {
                button(ui, true, "Stop", "Ends the recording", CameraCommand::Stop);
                ui.colored_label(LIGHT, format!("recording, {}", count(frames, "frame")));
            }
        }
    });
    command
}

/// Latency strip of the last seconds: a line for each displayed picture.
fn strip(ui: &mut Ui, session: &Session) {
    let (rect, response) =
        ui.allocate_exact_size(egui::vec2(ui.available_width(), timeline::HEIGHT), egui::Sense::hover());
    let Some(camera) = session.camera() else { return };
    let (past, now_s) = camera.recent();
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    let good = ui.visuals().selection.bg_fill;
    for shown in past {
        let x = rect.max.x - rect.width() * ((now_s - shown.taken_s) / RECENT_S) as f32;
        let height = rect.height() * (shown.latency_s / MAX_SHOWN_LATENCY_S).min(1.0) as f32;
        let color = match shown.tracking {
            Tracking::Tracked => good,
            Tracking::Predicted => ui.visuals().warn_fg_color,
            Tracking::Lost => LIGHT,
        };
        painter.vline(x, (rect.max.y - height)..=rect.max.y, Stroke::new(2.0, color));
    }
    response.on_hover_text(format!(
        "Last {RECENT_S:.0} s: one bar per picture, height = latency (full scale {:.0} ms). Orange: predicted pose. Red: \
         no pose.",
        1e3 * MAX_SHOWN_LATENCY_S
    ));
}

/// State of a camera that delivers pictures.
const LIVE: &str = "LIVE";

/// State of a camera in a word. The last picture stays on display in every state.
fn state_word(status: &FeedStatus) -> &'static str {
    match (status.is_over, &status.outage) {
        (true, _) => "ENDED",
        (false, Some(_)) => "WAITING",
        (false, None) => LIVE,
    }
}

fn light(ui: &mut Ui, state: &str) {
    let (rect, _) = ui.allocate_exact_size(egui::vec2(12.0, 24.0), egui::Sense::hover());
    let color = if state == LIVE { LIGHT } else { ui.visuals().weak_text_color() };
    ui.painter().circle_filled(rect.center(), 5.0, color);
    ui.label(RichText::new(state).strong());
}

/// Message about a camera that has ended.
fn ended_text(has_picture: bool) -> &'static str {
    if has_picture {
        "the camera has ended; its last picture is shown"
    } else {
        "the camera has ended without a picture"
    }
}

fn status_line(ui: &mut Ui, session: &Session, live: &LiveStatus) {
    let status = &live.status;
    if live.is_freezing {
        ui.spinner();
        ui.label("the last seconds are being written");
        return;
    }
    if status.is_over {
        ui.label(ended_text(session.frame().is_some()));
        if let Some(why) = &status.outage {
            ui.colored_label(ui.visuals().warn_fg_color, without_options(why));
        }
        return;
    }
    if let Some(why) = &status.outage {
        ui.colored_label(ui.visuals().warn_fg_color, format!("{why}; waiting for it"));
        return;
    }
    match live.tracking {
        Tracking::Tracked => _ = ui.label("tracked"),
        Tracking::Predicted => _ = ui.colored_label(ui.visuals().warn_fg_color, "predicted"),
        Tracking::Lost => {
            let why = status.no_pose_reason.as_ref().map_or(String::new(), |why| format!(": {}", without_options(why)));
            let hint = "No pose is known for this frame: nothing is drawn into it";
            let text = format!("not tracked{why}");
            ui.colored_label(ui.visuals().warn_fg_color, text).on_hover_text(hint);
        }
    }
    let latency = live.latency_s.map_or(String::new(), |latency_s| format!(", {:3.0} ms old", 1e3 * latency_s));
    ui.monospace(format!("{:2.0}/s{latency}", session.pictures_per_s()))
        .on_hover_text("Pictures of the last second; from when they were taken until they were composited");
    let drops = status.drops;
    let parts = [
        (drops.dropped_frames, "by the driver"),
        (drops.damaged, "damaged"),
        (drops.replaced, "before they were decoded"),
        (status.not_recorded, "for the disk"),
        (live.not_shown, "not shown"),
    ];
    let lost: u64 = parts.iter().map(|(n, _)| n).sum();
    if lost > 0 {
        let hint = parts.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}"));
        ui.label(format!("{lost} dropped")).on_hover_text(hint.collect::<Vec<_>>().join("\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_state_mentions_the_picture_on_display() {
        let over = FeedStatus { is_over: true, ..FeedStatus::default() };
        let gone = FeedStatus { outage: Some("unplugged".to_owned()), ..FeedStatus::default() };
        assert_eq!([&FeedStatus::default(), &gone, &over].map(state_word), [LIVE, "WAITING", "ENDED"]);
        assert!(ended_text(true).contains("its last picture is shown"));
        assert!(ended_text(false).contains("without a picture"));
    }
}
