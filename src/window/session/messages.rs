//! Messages and errors of a session.

use std::time::Duration;

use eframe::egui;

use super::Session;
use locard_engine::text::without_options;

/// A report of success or failure.
#[derive(Debug)]
pub(super) struct StatusMessage {
    text: String,
    /// Longer text, shown on request.
    details: Option<String>,
    is_error: bool,
    /// Project version and frame at the time of the message: it disappears after the next action.
    shown_at: (u64, usize),
    /// Time of the window's clock at which it was first shown.
    since_s: Option<f64>,
}

/// A message that has just been shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewMessage<'a> {
    pub text: &'a str,
    /// Longer text, shown on request.
    pub details: Option<&'a str>,
    pub is_error: bool,
}

/// Shortest time for which a message stays visible, s.
const MIN_MESSAGE_S: f64 = 4.0;

impl Session {
    /// Shows a message.
    pub fn show_message(&mut self, text: impl Into<String>) {
        self.set_message(&text.into(), None, false);
    }

    /// Shows a message whose longer text can be opened.
    pub fn show_message_with_details(&mut self, text: &str, details: &str) {
        self.set_message(text, Some(details), false);
    }

    pub fn message(&self) -> Option<&str> {
        self.message.as_ref().filter(|message| !message.is_error).map(|message| message.text.as_str())
    }

    /// Shows an error message.
    pub fn show_error(&mut self, text: impl Into<String>) {
        self.set_message(&text.into(), None, true);
    }

    /// The longer text of the message.
    pub fn message_details(&self) -> Option<&str> {
        self.message.as_ref().filter(|message| !message.is_error)?.details.as_deref()
    }

    fn set_message(&mut self, text: &str, details: Option<&str>, is_error: bool) {
        let shown_at = (self.project.version(), self.player.frame());
        let (text, details) = (without_options(text), details.map(without_options));
        self.message = Some(StatusMessage { text, details, is_error, shown_at, since_s: None });
    }

    /// The last message, if it is still new at a time of the window's clock.
    pub fn new_message(&self, now_s: f64) -> Option<NewMessage<'_>> {
        let message = self.message.as_ref()?;
        let is_new = message.since_s.is_none_or(|since_s| now_s - since_s < MIN_MESSAGE_S);
        is_new.then_some(NewMessage {
            text: &message.text,
            details: message.details.as_deref(),
            is_error: message.is_error,
        })
    }

    /// Removes a message that had time to be read, after another action.
    pub(super) fn expire_message(&mut self, ctx: &egui::Context) {
        let (now_s, done) = (ctx.input(|i| i.time), (self.project.version(), self.player.frame()));
        let Some(message) = &mut self.message else { return };
        let since_s = *message.since_s.get_or_insert(now_s);
        let left_s = MIN_MESSAGE_S - (now_s - since_s);
        if left_s > 0.0 {
            ctx.request_repaint_after(Duration::from_secs_f64(left_s));
        } else if message.shown_at != done {
            self.message = None;
        }
    }

    pub fn problem(&self) -> Option<&str> {
        let message = self.message.as_ref().filter(|message| message.is_error).map(|message| message.text.as_str());
        let picture = self.pictures.problem.as_deref();
        // Advice about a lost device is more useful than the error of a picture.
        let own = if self.pictures.is_lost { message.or(picture) } else { picture.or(message) };
        self.project.problem().or(own)
    }
}
