//! Tracks a board of tags through a video.

use std::ops::{ControlFlow, Range};

use super::board::Board;
use super::continuity::{ChosenPose, choose_along};
use super::detect::{DetectError, DetectedTags, Detector};
use super::family::Family;
use super::luma_codes::LumaCodes;
use super::refine::refine_corners;
use super::rolling::correct_rolling_shutter;
use super::sight::{BoardPose, PoseFailure};
use crate::camera::{Geometry, Response};
use crate::pixels::Pixels;
use crate::source::SourceError;
use crate::source::video::Video;
use crate::tracking::smooth::smooth_poses;

/// Called with the number of completed frames and of all frames. A break stops the search.
pub type TrackProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

/// Detects a board in pictures of one camera.
pub struct BoardTracker {
    board: Board,
    geometry: Geometry,
    light: Vec<f32>,
    detector: Detector,
}

impl BoardTracker {
    pub fn new(board: Board, geometry: Geometry, response: &Response) -> Result<Self, DetectError> {
        let intrinsics = &geometry.intrinsics;
        if geometry.is_equirectangular() {
            let problem = "360° pictures are not tracked; crop a view out of them";
            return Err(DetectError::new(intrinsics.width_px, intrinsics.height_px, problem));
        }
        let detector = Detector::new(board.family, intrinsics.width_px, intrinsics.height_px)?;
        Ok(Self { board, geometry, light: LumaCodes::table(response), detector })
    }

    /// Another tag family that is detected in a picture. 16h5 is skipped because of its false
    /// detections.
    pub fn other_family(&self, pixels: &Pixels) -> Result<Option<Family>, DetectError> {
        other_family(self.board.family, pixels)
    }

    /// Estimates the pose in a picture. The picture has the geometry's size.
    pub fn look(&mut self, pixels: &Pixels) -> Result<Result<BoardPose, PoseFailure>, DetectError> {
        let grey = LumaCodes::of(pixels, self.light.clone());
        let mut tags = self.detector.find_board(&grey, &self.board)?;
        for tag in &mut tags.tags {
            *tag = refine_corners(&grey, &self.geometry, self.board.family.cells(), tag);
        }
        Ok(BoardPose::of_tags(&self.geometry, &self.board, &tags))
    }
}

/// Reason why a video cannot be tracked.
#[derive(Debug, thiserror::Error)]
pub enum TrackError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    Detect(#[from] DetectError),
    #[error("the video is {width}x{height} px and the profile's camera {}x{}: name the profile of the camera as it was when it recorded", camera.0, camera.1)]
    Size { width: u32, height: u32, camera: (u32, u32) },
    #[error("no tag of family {} is seen in any of {frames} frames{}", family.name(), other_family_message(other))]
    Nothing { family: Family, frames: usize, other: Option<Family> },
    #[error("no frame gives a pose; in frame {frame} {why}. Does the board's file describe the board that was filmed?")]
    NoPose { frame: usize, why: PoseFailure },
    #[error("no frame gives a pose; in frame {frame} {why}")]
    Repeated { frame: usize, why: PoseFailure },
    #[error("stopped")]
    Stopped,
}

/// Message about another family that is detected; empty for `None`.
pub fn other_family_message(other: &Option<Family>) -> String {
    other.map_or(String::new(), |family| {
        format!("; tags of {} are: `family` in the board's file names another", family.name())
    })
}

/// Families that are not detected by chance where there are no tags. Of the ArUco dictionaries of a
/// size the largest, which contains the others.
const DISTINCTIVE_FAMILIES: [Family; 5] =
    [Family::Tag36h11, Family::Tag25h9, Family::Aruco5x5N1000, Family::Aruco6x6N1000, Family::Aruco7x7N1000];

fn other_family(own: Family, pixels: &Pixels) -> Result<Option<Family>, DetectError> {
    let grey = LumaCodes::of(pixels, Vec::new());
    for family in DISTINCTIVE_FAMILIES.into_iter().filter(|family| *family != own) {
        if Detector::new(family, pixels.width, pixels.height)?.find(&grey, 1, |_| true)? != DetectedTags::default() {
            return Ok(Some(family));
        }
    }
    Ok(None)
}

/// The camera's path through a video.
#[derive(Clone, Debug)]
pub struct Track {
    pub times_s: Vec<f64>,
    /// Pose of each frame, or the reason for its absence.
    pub frames: Vec<Result<ChosenPose, PoseFailure>>,
    /// Number of tags used in each frame.
    pub tags: Vec<usize>,
    /// Tags of each frame that were left out because they were detected several times.
    pub repeated: Vec<Vec<u32>>,
    /// Time constant of the smoothing, seconds.
    pub smoothed_s: Option<f64>,
}

/// Tracks a board through a whole video.
pub fn track(
    video: &Video,
    board: &Board,
    geometry: &Geometry,
    response: &Response,
    progress: TrackProgress<'_>,
) -> Result<Track, TrackError> {
    let camera = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
    if camera != (video.width, video.height) {
        return Err(TrackError::Size { width: video.width, height: video.height, camera });
    }
    let mut searcher = BoardTracker::new(board.clone(), geometry.clone(), response)?;
    let count = video.timestamps_s.len();
    let mut looks: Vec<Result<BoardPose, PoseFailure>> = Vec::with_capacity(count);
    for pixels in video.read(0..count)? {
        if progress(looks.len(), count).is_break() {
            return Err(TrackError::Stopped);
        }
        looks.push(searcher.look(&pixels?)?);
    }
    if looks.iter().all(Result::is_err) {
        return Err(nothing(video, board, &looks)?);
    }
    let tags = looks.iter().map(|look| look.as_ref().map_or(0, |sight| sight.tags.len())).collect();
    let repeated = looks.iter().map(|look| look.as_ref().map_or(Vec::new(), |sight| sight.repeated.clone())).collect();
    let sights: Vec<_> =
        video.timestamps_s.iter().copied().zip(looks.iter().map(|look| look.as_ref().ok().cloned())).collect();
    let frames = correct_rolling_shutter(geometry, &sights, &choose_along(&sights)).into_iter().zip(looks).map(
        |(chosen, look)| match (chosen, look) {
            (Some(chosen), _) => Ok(chosen),
            (None, Err(failure)) => Err(failure),
            (None, Ok(sight)) => Err(PoseFailure::Unsolved(sight.tags)),
        },
    );
    Ok(Track { times_s: video.timestamps_s.clone(), frames: frames.collect(), tags, repeated, smoothed_s: None })
}

/// Reason why no frame gives a pose.
fn nothing(video: &Video, board: &Board, looks: &[Result<BoardPose, PoseFailure>]) -> Result<TrackError, TrackError> {
    let failures = looks.iter().enumerate().filter_map(|(frame, look)| Some((frame, look.as_ref().err()?)));
    if let Some((frame, why)) = failures.into_iter().find(|(_, why)| **why != PoseFailure::Nothing) {
        let why = why.clone();
        return Ok(match why {
            PoseFailure::Repeated(_) => TrackError::Repeated { frame, why },
            _ => TrackError::NoPose { frame, why },
        });
    }
    let frames = looks.len();
    // A few frames suffice to detect another family.
    let first = 0..frames.min(30);
    let mut other = None;
    for pixels in video.read(first)? {
        other = other_family(board.family, &pixels?)?;
        if other.is_some() {
            break;
        }
    }
    Ok(TrackError::Nothing { family: board.family, frames, other })
}

impl Track {
    /// The poses, ascending in time.
    pub fn chosen(&self) -> impl Iterator<Item = &ChosenPose> {
        self.frames.iter().flatten()
    }

    /// Runs of frames without a pose, each with the reason for its first frame.
    pub fn unsolved_ranges(&self) -> Vec<(Range<usize>, &PoseFailure)> {
        runs(&self.frames, |frame| frame.as_ref().err())
    }

    /// Runs of frames whose pose may be the other one of a flat tag.
    pub fn doubtful(&self) -> Vec<Range<usize>> {
        let doubtful = |frame: &Result<ChosenPose, PoseFailure>| matches!(frame, Ok(chosen) if !chosen.is_certain);
        runs(&self.frames, |frame| doubtful(frame).then_some(frame)).into_iter().map(|(run, _)| run).collect()
    }

    /// Runs of frames in which the same tags were left out because they are detected several times.
    pub fn repeated(&self) -> Vec<(Range<usize>, &[u32])> {
        let mut runs: Vec<(Range<usize>, &[u32])> = Vec::new();
        for (i, tags) in self.repeated.iter().enumerate().filter(|(_, tags)| !tags.is_empty()) {
            match runs.last_mut().filter(|(run, before)| run.end == i && *before == tags.as_slice()) {
                Some((run, _)) => run.end = i + 1,
                None => runs.push((i..i + 1, tags)),
            }
        }
        runs
    }

    /// Smooths the poses and their covariances ([`smooth_poses`]) with a time constant above 0,
    /// seconds. Residuals stay as measured.
    pub fn smooth(&mut self, tau_s: f64) {
        let solved: Vec<_> = self.chosen().map(|chosen| (chosen.solved.pose, chosen.covariance())).collect();
        let after = smooth_poses(&solved, tau_s, self.max_gap_s());
        for (chosen, (pose, sure)) in self.frames.iter_mut().flatten().zip(after) {
            chosen.solved.pose = pose;
            chosen.set_covariance(&sure);
        }
        self.smoothed_s = Some(tau_s);
    }

    /// Longest gap across which poses may be interpolated, seconds: longer than any frame interval,
    /// and shorter than any gap in the track.
    pub fn max_gap_s(&self) -> f64 {
        let solved: Vec<usize> = (0..self.frames.len()).filter(|i| self.frames[*i].is_ok()).collect();
        let apart_s = |pair: &[usize]| self.times_s[pair[1]] - self.times_s[pair[0]];
        let (adjacent, gaps): (Vec<_>, Vec<_>) = solved.windows(2).partition(|pair| pair[1] == pair[0] + 1);
        let longest_s = adjacent.into_iter().map(apart_s).fold(0.0, f64::max);
        let shortest_s = gaps.into_iter().map(apart_s).fold(f64::INFINITY, f64::min);
        // A single pose has no interval.
        let longest_s = if longest_s > 0.0 { longest_s } else { 1.0 / 30.0 };
        (1.5 * longest_s).min(0.5 * (longest_s + shortest_s)).min(0.99 * shortest_s)
    }
}

/// Runs of items for which `of` returns a value, with the value of the first item.
fn runs<'a, T, U>(all: &'a [T], of: impl Fn(&'a T) -> Option<U>) -> Vec<(Range<usize>, U)> {
    let mut runs: Vec<(Range<usize>, U)> = Vec::new();
    for (i, item) in all.iter().enumerate() {
        let Some(what) = of(item) else { continue };
        match runs.last_mut().filter(|(run, _)| run.end == i) {
            Some((run, _)) => run.end = i + 1,
            None => runs.push((i..i + 1, what)),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics, LensModel};
    use crate::tags::{Paper, Sheet};

    #[test]
    fn panoramas_are_refused() {
        let intrinsics = Intrinsics { width_px: 640, height_px: 320, ..Intrinsics::default() };
        let round = Distortion { model: LensModel::Equirectangular, ..Distortion::default() };
        let searcher = |distortion| {
            BoardTracker::new(
                Sheet::new(Paper::A4).board,
                Geometry::new(intrinsics.clone(), distortion),
                &Response::default(),
            )
        };
        let error = searcher(round).err().unwrap().to_string();
        assert!(error.contains("640x320 px: 360° pictures are not tracked"), "{error}");
        assert!(searcher(Distortion::default()).is_ok());
    }
}
