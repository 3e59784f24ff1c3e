//! Poses from printed tags in the pictures themselves.
//!
//! Not modelled: the readout time, which needs the pictures behind a frame as well (`locard track` has them).

use std::path::Path;

use glam::{DQuat, DVec3};

use super::error::LiveError;
use super::fitting::Fitting;
use super::presence::{FADE_S, WHOLE_S};
use super::source::{MAX_GAP_S, PoseSource};
use crate::camera::{Camera, Intrinsics};
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::tags::{Board, DetectError, Family, Lost, Paper, Searcher, Sheet, also, chosen, expected, repeated};
use crate::tracking::covariance::Covariance;
use crate::tracking::smooth::Smoother;
use crate::tracking::turn::Reduced;

/// A board that is searched for in each picture. The world is the board's.
pub struct TaggedPoses {
    searcher: Searcher,
    /// The last two as they were seen, by which a flat tag's pose is told from its other one.
    past: Vec<(f64, Pose)>,
    smoother: Option<Smoother>,
    found: Vec<(f64, Pose)>,
    /// Of those that were found or given last.
    covariances: Vec<Covariance>,
    failure: Option<DetectError>,
    family: Family,
    /// Why the last picture had no pose.
    lost: Option<Lost>,
    /// Which tags were left out in the last one because they were seen in several places, and whether that was told.
    repeated: Vec<u32>,
    has_told_repeated: bool,
    /// Whether the board is the one that is seen.
    fitting: Fitting,
    /// Pictures in a row without a tag, and another family that was seen in one of them.
    without: u32,
    other: Option<Family>,
    carrying: Option<Carrying>,
    carried: Vec<(f64, Pose)>,
}

/// So long after the tags were seen last the pictures are still compared with that one, seconds: until nothing is seen of the
/// evidence.
const CARRIED_S: f64 = WHOLE_S + FADE_S;

/// A picture with less of the last one's contrast shows something else.
const LEAST_CONTRAST: f64 = 0.3;

/// Carries the last pose on by how the picture turns.
struct Carrying {
    camera: Intrinsics,
    /// The last picture in which the tags were found, and its pose.
    last: Option<(f64, Pose, Reduced)>,
}

impl Carrying {
    /// Where the camera stands in a picture in which nothing was found. Its place stays: what fits the picture best is taken
    /// for a turn, a small step aside, too. `None` where the pictures do not say it.
    fn on(&self, time_s: f64, pixels: &Pixels) -> Option<Pose> {
        let (_, pose, before) = self.last.as_ref().filter(|(last_s, ..)| time_s - last_s <= CARRIED_S)?;
        let now = Reduced::new(pixels)?;
        // A lens that is covered, or a light that goes out, leaves nothing to compare.
        if now.contrast() < LEAST_CONTRAST * before.contrast() {
            return None;
        }
        let turn = DQuat::from_scaled_axis(before.turn_to(&now, &self.camera)?);
        let world_from_camera = pose.world_from_camera_rotation() * turn.conjugate();
        Some(Pose::from_camera_in_world(pose.position_in_world_m(), world_from_camera.normalize()))
    }
}

impl TaggedPoses {
    /// The board of a file, or the sheet that `locard board` prints. The camera has a geometry.
    /// Poses are smoothed by a time constant, seconds, where one is given.
    pub fn open(board: Option<&Path>, camera: &Camera, smooth_s: Option<f64>) -> Result<Self, LiveError> {
        let board = match board {
            Some(file) => Board::read(file)?,
            None => Sheet::new(Paper::A4).board,
        };
        let geometry = camera.geometry.clone().ok_or(LiveError::NoCamera)?;
        let family = board.family;
        let carrying = (!geometry.sees_around()).then(|| Carrying { camera: geometry.intrinsics.clone(), last: None });
        let searcher = Searcher::new(board, geometry, &camera.response)?;
        Ok(Self {
            searcher,
            past: Vec::new(),
            smoother: smooth_s.map(|tau_s| Smoother::new(tau_s, MAX_GAP_S)),
            found: Vec::new(),
            covariances: Vec::new(),
            failure: None,
            family,
            lost: None,
            repeated: Vec::new(),
            has_told_repeated: false,
            fitting: Fitting::default(),
            without: 0,
            other: None,
            carrying,
            carried: Vec::new(),
        })
    }
}

/// After so many pictures without a tag other families are looked for, and again after as many.
const OTHERS_AFTER: u32 = 10;

impl TaggedPoses {
    /// Looks for another family where no tag of the board's is seen.
    fn looked_for(&mut self, why: &Lost, pixels: &Pixels) {
        self.without = if *why == Lost::Nothing { self.without + 1 } else { 0 };
        // A board that was seen is of the right family.
        if self.without % OTHERS_AFTER == 1 && self.other.is_none() && !self.fitting.is_sure() {
            self.other = self.searcher.other_family(pixels).unwrap_or_default();
        }
    }
}

impl PoseSource for TaggedPoses {
    fn picture(&mut self, time_s: f64, pixels: &Pixels) {
        match self.searcher.look(pixels) {
            Ok(Ok(sight)) => {
                self.lost = None;
                (self.without, self.other) = (0, None);
                self.repeated.clone_from(&sight.repeated);
                let chosen = chosen(time_s, &sight, expected(&self.past, time_s).as_ref());
                let pose = chosen.solved.pose;
                if !self.fitting.takes(time_s, &sight, &pose) {
                    return;
                }
                if self.found.is_empty() {
                    self.covariances.clear();
                }
                self.past.push((time_s, pose));
                if self.past.len() > 2 {
                    self.past.remove(0);
                }
                let seen = (pose, chosen.covariance());
                let (pose, sure) = match &mut self.smoother {
                    Some(smoother) => smoother.next(&seen.0, &seen.1),
                    None => seen,
                };
                if let Some(carrying) = &mut self.carrying {
                    carrying.last = Reduced::new(pixels).map(|reduced| (time_s, pose, reduced));
                }
                self.covariances.push(sure);
                self.found.push((time_s, pose));
            }
            Ok(Err(why)) => {
                self.looked_for(&why, pixels);
                if matches!(why, Lost::Misfit { .. } | Lost::NotOnBoard(_)) {
                    self.fitting.misfit();
                }
                self.lost = Some(why);
                let pose = self.carrying.as_ref().and_then(|carrying| carrying.on(time_s, pixels));
                self.carried.extend(pose.map(|pose| (time_s, pose)));
            }
            Err(error) => self.failure = Some(error),
        }
    }
    fn poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        match self.failure.take() {
            Some(error) => Err(error.into()),
            None => Ok(std::mem::take(&mut self.found)),
        }
    }
    fn carried(&mut self) -> Vec<(f64, Pose)> {
        std::mem::take(&mut self.carried)
    }
    fn covariance(&self, time_s: f64) -> Option<Covariance> {
        self.covariances.iter().find(|covariance| covariance.time_s == time_s).copied()
    }
    /// They are of the pictures themselves.
    fn has_clock(&self) -> bool {
        false
    }
    /// Out of the board.
    fn up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }
    fn told(&mut self) -> Option<String> {
        let is_new = !(self.repeated.is_empty() || std::mem::replace(&mut self.has_told_repeated, true));
        is_new.then(|| repeated(&self.repeated))
    }
    fn lacks(&self) -> Option<String> {
        let Some(lost) = &self.lost else {
            let why = match self.fitting.has_misfits() {
                false => "the tags that are seen do not say yet that they are the board's; show several of them",
                true => {
                    "the tags that are seen do not stand to each other as on the board: do its file and the camera's profile \
                     describe this board and this camera?"
                }
            };
            return (!self.fitting.is_sure()).then(|| why.to_owned());
        };
        Some(match lost {
            Lost::Nothing => format!("no tag of family {} is seen{}", self.family.name(), also(&self.other)),
            why @ (Lost::Unsolved(_) | Lost::Repeated(_)) => why.to_string(),
            why => format!("{why}; does the board's file describe this board?"),
        })
    }
    /// They come with their picture. What the shutter sees after its middle is predicted: to wait for the next picture would
    /// show everything a frame later.
    fn are_awaited(&self) -> bool {
        false
    }
    fn has_floor(&self) -> bool {
        true
    }
}
