//! A frame's depth: as it was measured, carried to the frame's moment; or as its neighbours say ([`sweep`](super::sweep)).

use super::carried::carried;
use super::eye::Eye;
use super::state::State;
use super::sweep::Sweep;
use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};

pub enum Depths<'a> {
    /// Added to the maps' times, s.
    Measured {
        later_s: f64,
    },
    Swept(Box<Sweep<'a>>),
}

impl<'a> Depths<'a> {
    /// `states`: one per frame. A sweep asks for frames in order.
    pub fn new(
        eye: &'a Eye,
        recording: &Recording,
        states: &'a [Option<State>],
        later_s: f64,
        threads: usize,
    ) -> Result<Self, RecordingError> {
        if recording.has_depth() || eye.geometry.sees_around() {
            return Ok(Self::Measured { later_s });
        }
        Ok(Self::Swept(Box::new(Sweep::new(eye, recording, states, threads)?)))
    }

    /// Added to the maps' times, s.
    pub fn later_s(&self) -> f64 {
        match self {
            Self::Measured { later_s } => *later_s,
            Self::Swept(_) => 0.0,
        }
    }

    /// A frame's depth as its neighbours say, `None` where it is measured. Frames are asked for in order.
    pub fn swept(&mut self, frame: usize) -> Result<Option<Vec<f32>>, RecordingError> {
        match self {
            Self::Measured { .. } => Ok(None),
            Self::Swept(sweep) => sweep.depth(frame).map(Some),
        }
    }

    /// At the frame's moment, in its picture, m or the recording's unit; 0 where unknown.
    pub fn of(&mut self, eye: &Eye, frame: &Frame, state: &State) -> Result<Vec<f32>, RecordingError> {
        match self {
            Self::Measured { later_s } => Ok(measured(eye, frame, state, *later_s)),
            Self::Swept(sweep) => sweep.depth(frame.index),
        }
    }
}

/// The frame's measured depth at its moment, m, 0 where unknown. `later_s` is added to its map's time.
pub fn measured(eye: &Eye, frame: &Frame, state: &State, later_s: f64) -> Vec<f32> {
    let (width, height) = eye.size();
    match &frame.depth {
        Some(map) if (map.width as usize, map.height as usize) == (width, height) => {
            let later_s = map.timestamp_s + later_s - frame.timestamp_s;
            let later_s = if later_s.abs() < 1e-4 { 0.0 } else { later_s };
            carried(&eye.geometry, &eye.rays, map, state, later_s)
        }
        _ => vec![0.0; width * height],
    }
}
