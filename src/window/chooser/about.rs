//! What a recording is that was chosen in the list: read on a thread of its own, since the headers of all its frames are.

use std::path::{Path, PathBuf};

use eframe::egui::Context;

use super::super::errand::Errand;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::text::{count, fixed, without_options};

/// Of one recording at a time.
#[derive(Debug, Default)]
pub struct About {
    of: Option<PathBuf>,
    reading: Option<Errand<String>>,
    told: String,
}

impl About {
    /// How many frames it has, how large, and how long it lasts; or why it is none.
    pub fn of(&mut self, ctx: &Context, path: &Path) -> &str {
        if self.of.as_deref() != Some(path) {
            let (wake, wanted) = (ctx.clone(), path.to_owned());
            self.reading = Errand::begin("about", move || wake.request_repaint(), move || read(&wanted)).ok();
            (self.of, self.told) = (Some(path.to_owned()), "…".to_owned());
        }
        if let Some(told) = self.reading.as_ref().and_then(Errand::take) {
            (self.reading, self.told) = (None, told.unwrap_or_else(|why| why));
        }
        &self.told
    }
}

fn read(path: &Path) -> String {
    match Recording::open(path, &OpenOptions::default()) {
        Ok(recording) => told(&recording),
        Err(error) => without_options(&error.to_string()),
    }
}

fn told(recording: &Recording) -> String {
    let times_s = &recording.timestamps_s;
    // The last frame lasts as long as the others do.
    let lasts_s = times_s.last().zip(times_s.first()).map_or(0.0, |(l, f)| l - f + recording.frame_interval_s);
    let (frames, size) = (count(times_s.len(), "frame"), format!("{} × {} px", recording.width, recording.height));
    let time = if recording.kind.has_times() { format!(", {} s", fixed(lasts_s, 1)) } else { String::new() };
    format!("{frames}, {size}{time}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_says_how_long_and_how_large_it_is() {
        // 72 frames at 30 a second.
        assert_eq!(read(Path::new("recordings/demo")), "72 frames, 640 × 480 px, 2.4 s");
        assert!(read(Path::new("scenes")).contains("scenes"));
    }
}
