//! Properties of a recording's frames as a video, which a written video takes over.

use std::ops::Range;
use std::sync::Arc;

use super::Recording;
use super::parts::Pictures;
use crate::camera::Response;
use crate::source::presentation::Presentation;
use crate::source::video::Soundtrack;
use crate::tracking::median_interval_s;

impl Recording {
    /// Times of all frames, unless those of the range are within 2 ms of a constant rate:
    /// containers round to about a millisecond.
    pub fn times_unless_steady(&self, range: Range<usize>) -> Option<Arc<[f64]>> {
        const TOLERANCE_S: f64 = 2e-3;
        let times_s = self.timestamps_s.get(range)?;
        let first_s = times_s.first()?;
        let steady_s = (0..).map(|i| first_s + f64::from(i) * self.frame_interval_s);
        let is_steady = times_s.iter().zip(steady_s).all(|(time_s, steady_s)| (time_s - steady_s).abs() < TOLERANCE_S);
        (!is_steady).then(|| Arc::clone(&self.timestamps_s))
    }

    /// Presentation of the pictures according to the video, or to the EXIF of all stills.
    pub fn presentation(&self) -> Presentation {
        self.presentation
    }

    /// The presentation of the part of a video that starts at a frame.
    pub fn presentation_from(&self, frame: usize) -> Presentation {
        let timecode = match &*self.pictures {
            Pictures::Video(video, numbers) => {
                let number = numbers.as_ref().and_then(|numbers| numbers.get(frame).copied()).unwrap_or(frame);
                let interval_s = median_interval_s(&video.timestamps_s).unwrap_or(self.frame_interval_s);
                let elapsed_s = |numbered: &[f64]| Some(numbered.get(number)? - numbered.first()?);
                // By time, since frames may have uneven intervals.
                let number = elapsed_s(&video.timestamps_s)
                    .map_or(number, |elapsed_s| (elapsed_s / interval_s).round() as usize);
                self.presentation.timecode.map(|timecode| timecode.advanced(number, 1.0 / interval_s))
            }
            Pictures::Stills(_) => None,
        };
        Presentation { timecode, ..self.presentation }
    }

    /// The sound of a range of frames; `None` if they are not in a video, or at another rate.
    pub fn soundtrack(&self, range: Range<usize>) -> Option<Soundtrack> {
        let Pictures::Video(video, _) = &*self.pictures else { return None };
        if video.is_retimed {
            return None;
        }
        let time_s = |frame: usize| self.timestamps_s.get(frame).copied();
        let (first_s, last_s) = (time_s(range.start)?, time_s(range.end.checked_sub(1)?)?);
        let zero_s = time_s(0)?;
        let length_s = last_s - first_s + self.interval_s(range.end - 1);
        Some(Soundtrack { file: video.file.clone(), start_s: video.start_s + first_s - zero_s, length_s })
    }

    /// The camera's response as far as the frames' file states it. Profiles override it.
    pub fn response(&self) -> &Response {
        &self.response
    }
}
