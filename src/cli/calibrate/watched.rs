//! Views for a calibration, taken from a camera by themselves.

use std::iter;
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::cli::progress_of;
use crate::cli::warn;
use crate::cli::watching::{Agreed, PicturesArgs};
use locard_engine::calibrate::board::{BoardDetector, TargetChoice};
use locard_engine::calibrate::geometry::{LensOptions, ViewCollector, ViewOutcome};
use locard_engine::camera::Response;
use locard_engine::live::CaptureEvent;
use locard_engine::text::{count, fixed};

/// Watches a camera until nothing is missing, or until somebody ends it.
pub fn taken(
    camera: &str,
    pictures: &PicturesArgs,
    wanted: usize,
    (board, response): (&TargetChoice, &Response),
    options: LensOptions,
) -> Result<ViewCollector> {
    let mut search = BoardDetector::new(board, response)?;
    let agreed = Agreed::without_poses(camera, pictures)?;
    let (delivered, interval_s) = (agreed.opened.camera.given.delivered, agreed.opened.interval_s);
    let mut taking = ViewCollector::new((delivered.width, delivered.height), wanted, options);
    let line = progress_of(pictures.quiet, 0, "{wide_msg}");
    let mut watching = agreed.start()?;
    let (mut frames, mut looked_s) = (0, f64::NEG_INFINITY);
    while !taking.missing().is_empty() && watching.goes_on(frames) {
        let first = match watching.next(Instant::now() + Duration::from_millis(50)) {
            CaptureEvent::Picture(decoded) => (decoded.0.time_s, decoded.1),
            CaptureEvent::Nothing => continue,
            CaptureEvent::Ended => break,
        };
        let next = || match watching.next(Instant::now() + Duration::from_millis(500)) {
            CaptureEvent::Picture(decoded) => Some((decoded.0.time_s, decoded.1)),
            CaptureEvent::Nothing | CaptureEvent::Ended => None,
        };
        for (time_s, pixels) in looked_at(first, looked_s, interval_s, next) {
            let look = taking.add(time_s, &format!("frame {frames}"), search.find(&pixels).ok());
            (frames, looked_s) = (frames + 1, time_s);
            line.set_message(told(&taking, look));
            // A pipe gets a line for each view.
            if look == ViewOutcome::Accepted && line.is_hidden() {
                warn(pictures.quiet, &told(&taking, look));
            }
        }
    }
    line.finish_and_clear();
    watching.close(&format!("{} of ", count(taking.views().len(), "view")), frames, 0);
    Ok(taking)
}

/// A picture, by its time. Where looking takes so long that some were left out since the last one that was looked at, the one
/// after it too: only two in a row tell whether the board rests.
fn looked_at<T>(
    first: (f64, T),
    looked_s: f64,
    interval_s: f64,
    next: impl FnOnce() -> Option<(f64, T)>,
) -> impl Iterator<Item = (f64, T)> {
    let is_left_out = first.0 - looked_s > 1.5 * interval_s;
    let second = is_left_out.then(next).flatten();
    iter::once(first).chain(second)
}

/// How far it is, and what to do: in 80 columns.
fn told(taking: &ViewCollector, look: ViewOutcome) -> String {
    let (views, share) = (taking.views().len(), fixed(100.0 * taking.coverage().share(), 0));
    let next = taking.hint().unwrap_or("nothing is missing".to_owned());
    let now = match look {
        ViewOutcome::NoBoard => "no board; ",
        ViewOutcome::Moving => "moving; ",
        ViewOutcome::Accepted => "taken; ",
        ViewOutcome::Redundant => "",
    };
    format!("{views} of {} views, {share} % seen; {now}{next}", taking.wanted())
}

#[cfg(test)]
mod tests {
    use super::looked_at;

    /// The times of a camera's pictures that are looked at, if that takes so long; 30 come in a second.
    fn times_s(look_s: f64) -> Vec<f64> {
        let interval_s = 1.0 / 30.0;
        let newest = |now_s: f64| (now_s / interval_s + 1e-6).floor() * interval_s;
        let (mut now_s, mut times_s): (f64, Vec<f64>) = (0.0, Vec::new());
        while times_s.len() < 20 {
            let looked_s = times_s.last().copied().unwrap_or(f64::NEG_INFINITY);
            let first_s = newest(now_s).max(looked_s + interval_s);
            let all = looked_at((first_s, ()), looked_s, interval_s, || Some((first_s + interval_s, ())));
            for (time_s, ()) in all.collect::<Vec<_>>() {
                now_s = now_s.max(time_s) + look_s;
                times_s.push(time_s);
            }
        }
        times_s
    }

    #[test]
    fn two_in_a_row_are_looked_at_however_long_that_takes() {
        let near = |times_s: &[f64]| times_s.windows(2).filter(|pair| pair[1] - pair[0] < 0.05).count();
        assert!(near(&times_s(0.01)) == 19);
        for look_s in [0.2, 0.7, 3.0] {
            assert!(near(&times_s(look_s)) >= 10, "{look_s}");
        }
    }
}
