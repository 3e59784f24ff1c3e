//! Reasons why evidence can be neither drawn nor placed in a frame.

use crate::shot::{Shot, ShotError, SurfaceError};
use crate::words::without_options;

/// Why a frame shows no evidence and takes none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// The camera is missing, incomplete or refused; the text says which. A profile is the remedy.
    Camera(String),
    /// The frame has no pose. The nearest frame that has one is the remedy.
    NoPose { nearest: Option<usize> },
}

impl Obstacle {
    /// The obstacle in a frame, if there is one.
    pub fn of(shot: &Shot, frame: usize) -> Option<Self> {
        match shot.eye(frame).err()? {
            SurfaceError::NoPose(_) => Some(Self::NoPose { nearest: nearest_with_pose(shot, frame) }),
            SurfaceError::Shot(error) => Some(Self::Camera(camera_text(&error))),
            error => Some(Self::Camera(without_options(&error.to_string()))),
        }
    }

    pub fn text(&self) -> String {
        match self {
            Self::Camera(text) => text.clone(),
            Self::NoPose { nearest: Some(_) } => {
                "No camera position for this frame. Choose another frame to place evidence.".to_owned()
            }
            Self::NoPose { nearest: None } => {
                "No camera position for any frame: evidence can be neither placed nor drawn.".to_owned()
            }
        }
    }
}

/// What is wrong with a camera, for someone who has a window and no command line.
pub fn camera_text(error: &ShotError) -> String {
    match error {
        ShotError::NoCamera { .. } => "No camera profile for this recording. Choose one to place evidence.".to_owned(),
        ShotError::PartOfCamera { missing, .. } => {
            format!("The camera profile is incomplete: it lacks {}. Choose another one.", missing.join(", "))
        }
        ShotError::Size { camera, frames } => {
            format!("{}. Choose a profile for {}x{}.", size_text(*camera, *frames), frames.0, frames.1)
        }
        other => without_options(&other.to_string()),
    }
}

/// Why a click meets no surface.
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

/// The nearest frame that has a pose, the earlier one of two.
fn nearest_with_pose(shot: &Shot, frame: usize) -> Option<usize> {
    let count = shot.recording.frame_count();
    let has_pose = |frame: &usize| shot.recording.pose_at_frame(*frame).is_ok();
    (1..count)
        .flat_map(|by| [frame.checked_sub(by), Some(frame + by).filter(|at| *at < count)])
        .flatten()
        .find(has_pose)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::Given;

    #[test]
    fn the_obstacle_names_what_is_missing_and_the_sizes() {
        let open = |sets: &[&str]| {
            let sets = sets.iter().map(ToString::to_string).collect();
            Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given { sets, ..Given::default() })
                .unwrap()
        };
        assert_eq!(Obstacle::of(&open(&[]), 0), None);
        let other = Obstacle::of(&open(&["camera.width_px=1920", "camera.height_px=1080"]), 0).unwrap();
        let text = "This profile is for 1920x1080; the recording is 640x480. Choose a profile for 640x480.";
        assert_eq!(other, Obstacle::Camera(text.to_owned()));
        let missing = ShotError::NoCamera { path: "room".into() };
        assert_eq!(camera_text(&missing), "No camera profile for this recording. Choose one to place evidence.");
    }
}
