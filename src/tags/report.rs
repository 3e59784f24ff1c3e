//! Report of a track.

use std::fmt;
use std::ops::Range;

use super::sight::repeated_message;
use super::track::Track;
use crate::fit::quantile::upper_median;
use crate::text::{count, fixed};

/// Largest number of runs of lost frames that are listed.
const MAX_LISTED: usize = 20;

impl Track {
    /// Median of the frames' residuals (root mean square over a frame's corners), px.
    pub fn median_residual_px(&self) -> f64 {
        upper_median(self.chosen().map(|chosen| chosen.solved.rms_px())).unwrap_or(f64::NAN)
    }

    /// Medians of the standard deviations of the camera's position (m) and rotation (rad), each the
    /// length over three axes.
    pub fn median_deviations(&self) -> (f64, f64) {
        let turn = |c: &nalgebra::SMatrix<f64, 6, 6>| (0..3).map(|i| c[(i, i)]).sum::<f64>().sqrt();
        let place = self.chosen().map(|chosen| chosen.solved.place_covariance().trace().sqrt());
        let turns = self.chosen().map(|chosen| turn(&chosen.solved.covariance));
        (upper_median(place).unwrap_or(f64::NAN), upper_median(turns).unwrap_or(f64::NAN))
    }

    fn run_label(&self, run: &Range<usize>) -> String {
        let at = |i: usize| fixed(self.times_s.get(i).copied().unwrap_or_default(), 3);
        match run.len() {
            1 => format!("frame {} ({} s)", run.start, at(run.start)),
            _ => format!("frames {} to {} ({} to {} s)", run.start, run.end - 1, at(run.start), at(run.end - 1)),
        }
    }
}

impl fmt::Display for Track {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (all, solved) = (self.frames.len(), self.chosen().count());
        let tags = self.tags.iter().sum::<usize>() as f64 / solved.max(1) as f64;
        writeln!(f, "poses      {solved} of {}, from {} tags each in the mean", count(all, "frame"), fixed(tags, 1))?;
        let (place_m, turn) = self.median_deviations();
        writeln!(
            f,
            "residuals  {} px in the median; one standard deviation {} mm, {}°",
            fixed(self.median_residual_px(), 3),
            fixed(1e3 * place_m, 2),
            fixed(turn.to_degrees(), 3)
        )?;
        if let Some(tau_s) = self.smoothed_s {
            writeln!(f, "smoothed   by a line through the poses around each, {} s to 1/e", crate::text::number(tau_s))?;
        }
        let unsolved_ranges = self.unsolved_ranges();
        for (run, why) in unsolved_ranges.iter().take(MAX_LISTED) {
            writeln!(f, "lost       {}: {why}", self.run_label(run))?;
        }
        if unsolved_ranges.len() > MAX_LISTED {
            writeln!(f, "lost       {} more times", unsolved_ranges.len() - MAX_LISTED)?;
        }
        for (run, tags) in self.repeated().iter().take(MAX_LISTED) {
            let kept = if run.len() == 1 { "the frame keeps its pose" } else { "the frames keep their poses" };
            writeln!(f, "repeated   {}: {}; {kept}, by the other tags", self.run_label(run), repeated_message(tags))?;
        }
        for run in self.doubtful().iter().take(MAX_LISTED) {
            writeln!(
                f,
                "doubtful   {}: a flat tag may lean the other way, and no frame nearby decides",
                self.run_label(run)
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tags::sight::PoseFailure;

    #[test]
    fn repeated_tags_are_listed_apart_from_lost_frames() {
        let track = Track {
            times_s: vec![0.0, 0.1, 0.2],
            frames: vec![Err(PoseFailure::Nothing); 3],
            tags: vec![2; 3],
            repeated: vec![vec![4, 5], vec![4, 5], vec![1]],
            smoothed_s: None,
        };
        let text = track.to_string();
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("repeated")).collect();
        assert_eq!(
            lines,
            [
                "repeated   frames 0 to 1 (0.000 to 0.100 s): the tags 4, 5 are detected more than once; remove the other \
                 prints; the frames keep their poses, by the other tags",
                "repeated   frame 2 (0.200 s): the tag 1 is detected more than once; remove the other prints; the frame keeps \
                 its pose, by the other tags",
            ]
        );
        assert!(!text.contains("left out"), "{text}");
    }
}
