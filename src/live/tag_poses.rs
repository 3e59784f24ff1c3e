//! Poses from printed tags in the pictures.
//!
//! Not modelled: the readout time of a rolling shutter, which needs later pictures as well (`locard
//! track` has them).

use std::path::Path;

use glam::{DQuat, DVec3};

use super::board_check::BoardCheck;
use super::error::LiveError;
use super::opacity_fade::{FADE_S, FULL_OPACITY_S};
use super::pose_source::{MAX_GAP_S, PoseSource};
use crate::camera::{Camera, Intrinsics};
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::tags::{
    Board, BoardTracker, DetectError, Family, Paper, PoseFailure, Sheet, choose_pose, extrapolated_pose,
    other_family_message, repeated_message,
};
use crate::tracking::covariance::Covariance;
use crate::tracking::smooth::Smoother;
use crate::tracking::turn::ImagePyramid;

/// Detects a board in each picture. The world is the board's coordinate system.
pub struct TagPoses {
    searcher: BoardTracker,
    /// The last two detected poses, unsmoothed. They resolve the pose ambiguity of a flat tag.
    recent: Vec<(f64, Pose)>,
    smoother: Option<Smoother>,
    new_poses: Vec<(f64, Pose)>,
    /// Covariances of the poses that wait or were returned last.
    covariances: Vec<Covariance>,
    failure: Option<DetectError>,
    family: Family,
    /// Reason why the last picture has no pose.
    failure_reason: Option<PoseFailure>,
    /// Tags of the last picture that were left out because they occur several times, and whether
    /// this was reported.
    repeated: Vec<u32>,
    has_reported_repeated: bool,
    /// Verifies that the visible board is the described one.
    board_check: BoardCheck,
    /// Consecutive pictures without a tag, and another tag family that was seen in one of them.
    pictures_without_tag: u32,
    other_family: Option<Family>,
    dead_reckoning: Option<DeadReckoning>,
    dead_reckoned: Vec<(f64, Pose)>,
}

/// Longest time of dead reckoning after the last detection, seconds: until the evidence has faded
/// out.
const MAX_DEAD_RECKONING_S: f64 = FULL_OPACITY_S + FADE_S;

/// Smallest ratio of a picture's contrast to the reference's. Below it the picture shows something
/// else.
const MIN_CONTRAST_RATIO: f64 = 0.3;

/// Propagates the last pose by the rotation between pictures.
struct DeadReckoning {
    camera: Intrinsics,
    /// Time, pose and reduced picture of the last detection.
    reference: Option<(f64, Pose, ImagePyramid)>,
}

impl DeadReckoning {
    /// Pose of a picture without a detection. The position is kept: the estimated rotation also
    /// explains a small translation. `None` if the pictures do not match.
    fn propagate(&self, time_s: f64, pixels: &Pixels) -> Option<Pose> {
        let (_, pose, before) =
            self.reference.as_ref().filter(|(reference_s, ..)| time_s - reference_s <= MAX_DEAD_RECKONING_S)?;
        let now = ImagePyramid::new(pixels)?;
        // A covered lens or a light that goes out leaves nothing to compare.
        if now.contrast() < MIN_CONTRAST_RATIO * before.contrast() {
            return None;
        }
        let turn = DQuat::from_scaled_axis(before.rotation_to(&now, &self.camera)?);
        let world_from_camera = pose.world_from_camera_rotation() * turn.conjugate();
        Some(Pose::from_camera_in_world(pose.position_in_world_m(), world_from_camera.normalize()))
    }
}

impl TagPoses {
    /// Opens the board of a file, or the sheet that `locard board` prints. The camera must have a
    /// geometry. `smooth_s` is the time constant of the smoothing, if any.
    pub fn open(board: Option<&Path>, camera: &Camera, smooth_s: Option<f64>) -> Result<Self, LiveError> {
        let board = match board {
            Some(file) => Board::read(file)?,
            None => Sheet::new(Paper::A4).board,
        };
        let geometry = camera.geometry.clone().ok_or(LiveError::NoCamera)?;
        let family = board.family;
        let dead_reckoning = (!geometry.needs_cube_map())
            .then(|| DeadReckoning { camera: geometry.intrinsics.clone(), reference: None });
        let searcher = BoardTracker::new(board, geometry, &camera.response)?;
        Ok(Self {
            searcher,
            recent: Vec::new(),
            smoother: smooth_s.map(|tau_s| Smoother::new(tau_s, MAX_GAP_S)),
            new_poses: Vec::new(),
            covariances: Vec::new(),
            failure: None,
            family,
            failure_reason: None,
            repeated: Vec::new(),
            has_reported_repeated: false,
            board_check: BoardCheck::default(),
            pictures_without_tag: 0,
            other_family: None,
            dead_reckoning,
            dead_reckoned: Vec::new(),
        })
    }
}

/// Interval at which other tag families are searched for, pictures without a tag.
const FAMILY_SEARCH_INTERVAL: u32 = 10;

impl TagPoses {
    /// Searches for another tag family while no tag of the board is visible.
    fn search_other_family(&mut self, why: &PoseFailure, pixels: &Pixels) {
        self.pictures_without_tag = if *why == PoseFailure::Nothing { self.pictures_without_tag + 1 } else { 0 };
        // A confirmed board has the right family.
        if self.pictures_without_tag % FAMILY_SEARCH_INTERVAL == 1
            && self.other_family.is_none()
            && !self.board_check.is_confirmed()
        {
            self.other_family = self.searcher.other_family(pixels).unwrap_or_default();
        }
    }
}

impl PoseSource for TagPoses {
    fn add_picture(&mut self, time_s: f64, pixels: &Pixels) {
        match self.searcher.look(pixels) {
            Ok(Ok(sight)) => {
                self.failure_reason = None;
                (self.pictures_without_tag, self.other_family) = (0, None);
                self.repeated.clone_from(&sight.repeated);
                let chosen = choose_pose(time_s, &sight, extrapolated_pose(&self.recent, time_s).as_ref());
                let pose = chosen.solved.pose;
                if !self.board_check.add(time_s, &sight, &pose) {
                    return;
                }
                if self.new_poses.is_empty() {
                    self.covariances.clear();
                }
                self.recent.push((time_s, pose));
                if self.recent.len() > 2 {
                    self.recent.remove(0);
                }
                let detected = (pose, chosen.covariance());
                let (pose, covariance) = match &mut self.smoother {
                    Some(smoother) => smoother.next(&detected.0, &detected.1),
                    None => detected,
                };
                if let Some(dead_reckoning) = &mut self.dead_reckoning {
                    dead_reckoning.reference = ImagePyramid::new(pixels).map(|reduced| (time_s, pose, reduced));
                }
                self.covariances.push(covariance);
                self.new_poses.push((time_s, pose));
            }
            Ok(Err(why)) => {
                self.search_other_family(&why, pixels);
                if matches!(why, PoseFailure::Misfit { .. } | PoseFailure::NotOnBoard(_)) {
                    self.board_check.add_misfit();
                }
                self.failure_reason = Some(why);
                let pose =
                    self.dead_reckoning.as_ref().and_then(|dead_reckoning| dead_reckoning.propagate(time_s, pixels));
                self.dead_reckoned.extend(pose.map(|pose| (time_s, pose)));
            }
            Err(error) => self.failure = Some(error),
        }
    }
    fn take_poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        match self.failure.take() {
            Some(error) => Err(error.into()),
            None => Ok(std::mem::take(&mut self.new_poses)),
        }
    }
    fn take_dead_reckoned(&mut self) -> Vec<(f64, Pose)> {
        std::mem::take(&mut self.dead_reckoned)
    }
    fn covariance(&self, time_s: f64) -> Option<Covariance> {
        self.covariances.iter().find(|covariance| covariance.time_s == time_s).copied()
    }
    /// The time stamps are those of the pictures.
    fn has_own_clock(&self) -> bool {
        false
    }
    /// The board's normal.
    fn up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }
    fn take_message(&mut self) -> Option<String> {
        let is_new = !(self.repeated.is_empty() || std::mem::replace(&mut self.has_reported_repeated, true));
        is_new.then(|| repeated_message(&self.repeated))
    }
    fn no_pose_reason(&self) -> Option<String> {
        let Some(failure_reason) = &self.failure_reason else {
            let why = if self.board_check.has_misfits() {
                "the visible tags are not arranged as on the board: do its file and the camera's profile describe this \
                 board and this camera?"
            } else {
                "the visible tags are not confirmed as the board's yet; show several of them"
            };
            return (!self.board_check.is_confirmed()).then(|| why.to_owned());
        };
        Some(match failure_reason {
            PoseFailure::Nothing => {
                format!("no tag of family {} is seen{}", self.family.name(), other_family_message(&self.other_family))
            }
            why @ (PoseFailure::Unsolved(_) | PoseFailure::Repeated(_)) => why.to_string(),
            why => format!("{why}; does the board's file describe this board?"),
        })
    }
    /// Poses arrive with their picture. The second half of the exposure is predicted: waiting for
    /// the next picture would delay everything by a frame.
    fn has_latency(&self) -> bool {
        false
    }
    fn has_floor(&self) -> bool {
        true
    }
}
