//! Describes the recording selected in the list. It is read on a background thread, because the
//! headers of all frames are read.

use std::path::{Path, PathBuf};

use eframe::egui::Context;

use super::super::task::BackgroundTask;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::text::{count, fixed, without_options};

/// The summary of one recording at a time.
#[derive(Debug, Default)]
pub struct RecordingSummary {
    path: Option<PathBuf>,
    reading: Option<BackgroundTask<String>>,
    summary: String,
}

impl RecordingSummary {
    /// Frame count, size and duration, or an error.
    pub fn of(&mut self, ctx: &Context, path: &Path) -> &str {
        if self.path.as_deref() != Some(path) {
            let (wake, requested) = (ctx.clone(), path.to_owned());
            self.reading =
                BackgroundTask::spawn("read summary", move || wake.request_repaint(), move || read(&requested)).ok();
            (self.path, self.summary) = (Some(path.to_owned()), "…".to_owned());
        }
        if let Some(summary) = self.reading.as_ref().and_then(BackgroundTask::take) {
            (self.reading, self.summary) = (None, summary.unwrap_or_else(|why| why));
        }
        &self.summary
    }
}

fn read(path: &Path) -> String {
    match Recording::open(path, &OpenOptions::default()) {
        Ok(recording) => summary(&recording),
        Err(error) => without_options(&error.to_string()),
    }
}

fn summary(recording: &Recording) -> String {
    let times_s = &recording.timestamps_s;
    // The last frame is as long as the others.
    let lasts_s = times_s.last().zip(times_s.first()).map_or(0.0, |(l, f)| l - f + recording.frame_interval_s);
    let (frames, size) = (count(times_s.len(), "frame"), format!("{} × {} px", recording.width, recording.height));
    let time = if recording.kind.has_times() { format!(", {} s", fixed(lasts_s, 1)) } else { String::new() };
    format!("{frames}, {size}{time}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_has_frame_count_size_and_duration() {
        // 72 frames at 30 a second.
        assert_eq!(read(Path::new("recordings/demo")), "72 frames, 640 × 480 px, 2.4 s");
        assert!(read(Path::new("scenes")).contains("scenes"));
    }
}
