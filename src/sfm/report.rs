//! Report of solved footage.

use std::fmt;
use std::ops::Range;

use super::gauge::{ScaleSource, UpSource};
use super::solution::Solution;
use crate::text::{count, fixed, number};

/// Largest number of runs of frames without a pose that are listed.
const MAX_LISTED: usize = 10;

impl Solution {
    fn run_label(&self, run: &Range<usize>) -> String {
        let at = |i: usize| fixed(self.times_s.get(i).copied().unwrap_or_default(), 3);
        match run.len() {
            1 => format!("frame {} ({} s)", run.start, at(run.start)),
            _ => format!("frames {} to {} ({} to {} s)", run.start, run.end - 1, at(run.start), at(run.end - 1)),
        }
    }
}

impl fmt::Display for ScaleSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Board { tags, rms_m } => {
                write!(
                    f,
                    "by {} of the board; their corners fit it within {} mm",
                    count(*tags, "tag"),
                    fixed(1e3 * rms_m, 2)
                )
            }
            Self::Distance { length_m, views } => {
                write!(f, "by the measured distance of {} m, seen in {}", number(*length_m), count(*views, "frame"))
            }
            Self::Assumed { height_m: Some(height_m), .. } => write!(
                f,
                "assumed: the camera is {} m above the largest level surface; measure a distance (--distance) or film a \
                 board of tags",
                number(*height_m)
            ),
            Self::Assumed { height_m: None, distance_m } => write!(
                f,
                "assumed: surfaces are {} m away in the median; measure a distance (--distance) or film a board of tags",
                number(*distance_m)
            ),
        }
    }
}

impl fmt::Display for UpSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Board => f.write_str("the board's; its plane is the floor"),
            Self::Surface { share } => {
                write!(
                    f,
                    "the normal of a level surface, with {} % of the landmarks; it is the floor",
                    fixed(100.0 * share, 0)
                )
            }
            Self::Cameras => {
                f.write_str("the cameras' own, in the mean: no level surface was found, and there is no floor")
            }
        }
    }
}

impl fmt::Display for Solution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let posed = self.frames.iter().flatten().count();
        let solved = self.frames.iter().flatten().filter(|frame| frame.is_keyframe).count();
        writeln!(
            f,
            "poses      {posed} of {}: {solved} of {} chosen ones by COLMAP, {} by tracked landmarks",
            count(self.frames.len(), "frame"),
            self.chosen,
            posed - solved
        )?;
        writeln!(
            f,
            "residuals  {} px in the median, of {}",
            fixed(self.median_residual_px(), 2),
            count(self.landmarks, "landmark")
        )?;
        let intrinsics = &self.geometry.intrinsics;
        let origin = if self.is_camera_given { "as given" } else { "estimated" };
        writeln!(
            f,
            "lens       focal length {} px in a picture {} px wide, {origin}",
            fixed(intrinsics.fx_px, 1),
            intrinsics.width_px
        )?;
        writeln!(f, "scale      {}", self.gauge.scale)?;
        writeln!(f, "up         {}", self.gauge.up)?;
        let unsolved_ranges = self.unsolved_ranges();
        for run in unsolved_ranges.iter().take(MAX_LISTED) {
            writeln!(f, "lost       {}", self.run_label(run))?;
        }
        if unsolved_ranges.len() > MAX_LISTED {
            writeln!(f, "lost       {} more times", unsolved_ranges.len() - MAX_LISTED)?;
        }
        for frames in &self.apart {
            let (first, last) =
                (frames.first().copied().unwrap_or_default(), frames.last().copied().unwrap_or_default());
            writeln!(
                f,
                "apart      {} from {first} to {last} fit each other but not the rest: more overlap is needed there",
                count(frames.len(), "chosen frame")
            )?;
        }
        Ok(())
    }
}
