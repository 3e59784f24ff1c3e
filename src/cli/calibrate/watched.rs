//! Automatic collection of calibration views from a camera.

use std::iter;
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::cli::progress_of;
use crate::cli::warn;
use crate::cli::watching::{OpenCamera, PicturesArgs};
use locard_engine::calibrate::board::{BoardDetector, TargetChoice};
use locard_engine::calibrate::geometry::{LensOptions, ViewCollector, ViewOutcome};
use locard_engine::camera::Response;
use locard_engine::live::CaptureEvent;
use locard_engine::text::{count, fixed};

/// Collects views until none is missing, or until the program is interrupted.
pub fn collect_views(
    camera: &str,
    pictures: &PicturesArgs,
    min_views: usize,
    (board, response): (&TargetChoice, &Response),
    options: LensOptions,
) -> Result<ViewCollector> {
    let mut search = BoardDetector::new(board, response)?;
    let camera = OpenCamera::without_poses(camera, pictures)?;
    let (format, interval_s) = (camera.opened.camera.negotiated.picture_format, camera.opened.interval_s);
    let mut collector = ViewCollector::new((format.width, format.height), min_views, options);
    let line = progress_of(pictures.quiet, 0, "{wide_msg}");
    let mut session = camera.start()?;
    let (mut frames, mut searched_s) = (0, f64::NEG_INFINITY);
    while !collector.missing().is_empty() && session.is_running(frames) {
        let first = match session.next(Instant::now() + Duration::from_millis(50)) {
            CaptureEvent::Picture(decoded) => (decoded.0.time_s, decoded.1),
            CaptureEvent::Nothing => continue,
            CaptureEvent::Ended => break,
        };
        let next = || match session.next(Instant::now() + Duration::from_millis(500)) {
            CaptureEvent::Picture(decoded) => Some((decoded.0.time_s, decoded.1)),
            CaptureEvent::Nothing | CaptureEvent::Ended => None,
        };
        for (time_s, pixels) in next_searched(first, searched_s, interval_s, next) {
            let outcome = collector.add(time_s, &format!("frame {frames}"), search.find(&pixels).ok());
            (frames, searched_s) = (frames + 1, time_s);
            line.set_message(status_line(&collector, outcome));
            // Without a terminal, one line for each view.
            if outcome == ViewOutcome::Accepted && line.is_hidden() {
                warn(pictures.quiet, &status_line(&collector, outcome));
            }
        }
    }
    line.finish_and_clear();
    session.close(&format!("{} of ", count(collector.views().len(), "view")), frames, 0);
    Ok(collector)
}

/// The next pictures to search. If pictures were skipped since the last search, because it took too
/// long, the following picture is searched too: two consecutive ones are needed to decide if the
/// board is at rest.
fn next_searched<T>(
    first: (f64, T),
    searched_s: f64,
    interval_s: f64,
    next: impl FnOnce() -> Option<(f64, T)>,
) -> impl Iterator<Item = (f64, T)> {
    let is_left_out = first.0 - searched_s > 1.5 * interval_s;
    let second = is_left_out.then(next).flatten();
    iter::once(first).chain(second)
}

/// The progress and the next step, in 80 columns.
fn status_line(collector: &ViewCollector, outcome: ViewOutcome) -> String {
    let (views, share) = (collector.views().len(), fixed(100.0 * collector.coverage().share(), 0));
    let next = collector.hint().unwrap_or("nothing is missing".to_owned());
    let now = match outcome {
        ViewOutcome::NoBoard => "no board; ",
        ViewOutcome::Moving => "moving; ",
        ViewOutcome::Accepted => "taken; ",
        ViewOutcome::Redundant => "",
    };
    format!("{views} of {} views, {share} % seen; {now}{next}", collector.min_views())
}

#[cfg(test)]
mod tests {
    use super::next_searched;

    /// The times of the searched pictures of a camera with 30 a second, if a search takes
    /// `search_s`.
    fn times_s(search_s: f64) -> Vec<f64> {
        let interval_s = 1.0 / 30.0;
        let newest = |now_s: f64| (now_s / interval_s + 1e-6).floor() * interval_s;
        let (mut now_s, mut times_s): (f64, Vec<f64>) = (0.0, Vec::new());
        while times_s.len() < 20 {
            let searched_s = times_s.last().copied().unwrap_or(f64::NEG_INFINITY);
            let first_s = newest(now_s).max(searched_s + interval_s);
            let all = next_searched((first_s, ()), searched_s, interval_s, || Some((first_s + interval_s, ())));
            for (time_s, ()) in all.collect::<Vec<_>>() {
                now_s = now_s.max(time_s) + search_s;
                times_s.push(time_s);
            }
        }
        times_s
    }

    #[test]
    fn consecutive_pictures_are_searched_however_long_a_search_takes() {
        let near = |times_s: &[f64]| times_s.windows(2).filter(|pair| pair[1] - pair[0] < 0.05).count();
        assert!(near(&times_s(0.01)) == 19);
        for search_s in [0.2, 0.7, 3.0] {
            assert!(near(&times_s(search_s)) >= 10, "{search_s}");
        }
    }
}
