//! Reasons why evidence can be neither drawn nor placed in a frame.

use std::sync::Arc;

use locard_engine::memo::{ByAddress, Memo};
use locard_engine::recording::Recording;
use locard_engine::shot::{Shot, ShotError, SurfaceError};
use locard_engine::text::without_options;

/// Reason why evidence can be neither drawn nor placed in a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// The camera is missing, incomplete or rejected, with a message. A profile is the remedy.
    Camera(String),
    /// The frame has no pose. The nearest frame that has one is the remedy.
    NoPose,
    /// Another problem, for which there is no remedy here.
    Other(String),
}

impl Obstacle {
    /// The obstacle in a frame, if there is one.
    pub fn of(shot: &Shot, frame: usize) -> Option<Self> {
        shot.posed_camera(frame).err().map(|error| Self::of_error(&error))
    }

    fn of_error(error: &SurfaceError) -> Self {
        match error {
            SurfaceError::NoPose(_) => Self::NoPose,
            SurfaceError::Shot(error) if is_of_camera(error) => Self::Camera(camera_text(error)),
            SurfaceError::Shot(error) => Self::Other(camera_text(error)),
            error => Self::Other(without_options(&error.to_string())),
        }
    }
}

/// True if another profile is a remedy.
fn is_of_camera(error: &ShotError) -> bool {
    matches!(
        error,
        ShotError::NoCamera { .. }
            | ShotError::IncompleteCamera { .. }
            | ShotError::Size { .. }
            | ShotError::Coefficient { .. }
            | ShotError::PanoramaCamera
            | ShotError::PanoramaSize { .. }
            | ShotError::PanoramaReadout { .. }
            | ShotError::Lens(_)
            | ShotError::Profile(_)
    )
}

/// Text about a frame without a pose. `nearest` is the nearest frame that has one.
pub fn no_pose_text(nearest: Option<usize>) -> &'static str {
    match nearest {
        Some(_) => "No camera position for this frame. Choose another frame to place evidence.",
        None => "No camera position for any frame: evidence can be neither placed nor drawn.",
    }
}

/// Memo of the nearest frame that has a pose: without poses, a search visits every frame. A live
/// recording is a new allocation after each of its frames.
#[derive(Debug, Default)]
pub struct NearestPose(Memo<(ByAddress<Recording>, usize), Option<usize>>);

impl NearestPose {
    /// The nearest frame with a pose, the earlier one of two.
    pub fn of(&self, recording: &Arc<Recording>, frame: usize) -> Option<usize> {
        self.memoized(recording, frame, nearest_with_pose)
    }

    fn memoized(
        &self,
        recording: &Arc<Recording>,
        frame: usize,
        search: impl FnOnce(&Recording, usize) -> Option<usize>,
    ) -> Option<usize> {
        let key = (ByAddress(Arc::clone(recording)), frame);
        self.0.get_or_insert_with(key, |(recording, frame)| search(recording, *frame))
    }
}

/// Message about a camera, without options of the command line.
pub fn camera_text(error: &ShotError) -> String {
    match error {
        ShotError::NoCamera { .. } => "No camera profile for this recording. Choose one to place evidence.".to_owned(),
        ShotError::IncompleteCamera { missing, .. } => {
            format!("The camera profile is incomplete: it lacks {}. Choose another one.", missing.join(", "))
        }
        ShotError::Size { camera, frames } => {
            format!("{}. Choose a profile for {}x{}.", size_text(*camera, *frames), frames.0, frames.1)
        }
        other => without_options(&other.to_string()),
    }
}

/// Message about a click without a surface.
pub fn surface_text(error: &SurfaceError) -> String {
    match error {
        SurfaceError::NotMeasured { .. } => {
            "No depth was measured here. Click beside it, or define a plane by three points.".to_owned()
        }
        other => without_options(&other.to_string()),
    }
}

/// Names both sizes of a profile that is for pictures of another size.
pub fn size_text(profile: (u32, u32), recording: (u32, u32)) -> String {
    format!("This profile is for {}x{}; the recording is {}x{}", profile.0, profile.1, recording.0, recording.1)
}

fn nearest_with_pose(recording: &Recording, frame: usize) -> Option<usize> {
    let count = recording.frame_count();
    let has_pose = |frame: &usize| recording.pose_at_frame(*frame).is_ok();
    (1..count)
        .flat_map(|by| [frame.checked_sub(by), Some(frame + by).filter(|at| *at < count)])
        .flatten()
        .find(has_pose)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn obstacle_names_missing_values_and_both_sizes() {
        let open = |sets: &[&str]| {
            let sets = sets.iter().map(ToString::to_string).collect();
            Shot::open(
                Path::new("recordings/demo"),
                &OpenOptions::default(),
                &ShotOptions { sets, ..ShotOptions::default() },
            )
            .unwrap()
        };
        assert_eq!(Obstacle::of(&open(&[]), 0), None);
        let other = Obstacle::of(&open(&["camera.width_px=1920", "camera.height_px=1080"]), 0).unwrap();
        let text = "This profile is for 1920x1080; the recording is 640x480. Choose a profile for 640x480.";
        assert_eq!(other, Obstacle::Camera(text.to_owned()));
        let missing = ShotError::NoCamera { path: "room".into() };
        assert_eq!(camera_text(&missing), "No camera profile for this recording. Choose one to place evidence.");
        let other = SurfaceError::NoDepth { frame: 3 };
        assert!(matches!(Obstacle::of_error(&other), Obstacle::Other(_)), "a profile cannot help");
        let black = SurfaceError::from(Box::new(ShotError::Black { frame: 3 }));
        assert!(matches!(Obstacle::of_error(&black), Obstacle::Other(_)), "a profile cannot help");
    }

    #[test]
    fn nearest_pose_is_searched_once_for_a_frame_of_a_recording() {
        let open = || Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
        let mut recording = Arc::new(open());
        let nearest = NearestPose::default();
        assert_eq!(nearest.of(&recording, 4), Some(3));
        assert_eq!(nearest.memoized(&recording, 4, |_, _| unreachable!()), Some(3));
        assert_eq!(nearest.memoized(&recording, 5, |_, _| None), None);
        assert_eq!(nearest.memoized(&recording, 5, |_, _| unreachable!()), None);
        // A frame that arrives brings a pose.
        Arc::make_mut(&mut recording);
        assert_eq!(nearest.memoized(&recording, 5, |_, _| Some(6)), Some(6));
    }
}
