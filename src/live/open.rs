//! A source of poses by what a person calls it.

use std::path::Path;

use glam::DVec3;

use super::error::LiveError;
use super::listening::Streamed;
use super::playing::RecordedPoses;
use super::source::PoseSource;
use super::tagged::TaggedPoses;
use crate::camera::Camera;
use crate::pose::Pose;
use crate::stream::Protocol;

/// `tags`, `tags:BOARD.toml`, `opentrackio://…`, `freed://…`, `file:RECORDING`, or `none`. Tags are seen by a camera.
pub fn open_poses(asked: &str, camera: Option<&Camera>) -> Result<Box<dyn PoseSource>, LiveError> {
    if asked == "none" {
        return Ok(Box::new(NoPoses));
    }
    let board = asked.strip_prefix("tags:").map(Path::new);
    if asked == "tags" || board.is_some() {
        return Ok(Box::new(TaggedPoses::open(board, camera.ok_or(LiveError::NoCamera)?)?));
    }
    if let Some(path) = asked.strip_prefix("file:") {
        return Ok(Box::new(RecordedPoses::open(Path::new(path))?));
    }
    match Protocol::of(asked) {
        Some(_) => Ok(Box::new(Streamed::open(asked)?)),
        None => Err(LiveError::Poses { asked: asked.to_owned() }),
    }
}

struct NoPoses;

impl PoseSource for NoPoses {
    fn poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        Ok(Vec::new())
    }
    fn up(&self) -> Option<DVec3> {
        None
    }
    fn is_live(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_gives_no_poses_is_refused() {
        let error = open_poses("http://x", None).err().unwrap().to_string();
        assert!(error.contains("opentrackio://…, freed://…, file:RECORDING, none"), "{error}");
        let error = open_poses("tags", None).err().unwrap().to_string();
        assert!(error.contains("--profile"), "{error}");
        assert!(open_poses("none", None).unwrap().poses(1e9).unwrap().is_empty());
    }
}
