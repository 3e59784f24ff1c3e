//! Pose of the camera from a single picture, before neighbouring pictures are considered.

use glam::{DVec2, DVec3};

use super::board::Board;
use super::detect::{DetectedTag, DetectedTags};
use super::solve::{Corners, PoseSolution, initial_poses, solve_pose};
use crate::camera::Geometry;
use crate::pose::Pose;

/// Two poses are equal if they differ by less than this rotation, rad...
const SAME_RAD: f64 = 0.5e-2;
/// ... and this share of the distance to the tags.
const SAME_SHARE: f64 = 0.5e-2;
/// A picture decides between two poses if the worse one's sum of squares is larger by this many
/// variances, five deviations squared...
const MIN_VARIANCES: f64 = 25.0;
/// ... with this smallest standard deviation of a corner, px.
const MIN_SIGMA_PX: f64 = 0.1;
/// Tags do not match the board if the median residual exceeds this share of their sides, and this
/// many px.
const MAX_MEDIAN_SHARE: f64 = 0.05;
const MAX_MEDIAN_PX: f64 = 1.0;
/// One of at least `MIN_TAGS` tags may be misread if the RMS residual exceeds this, px...
const MISREAD_RMS_PX: f64 = 0.5;
const MIN_TAGS: usize = 3;
/// ... and is left out if the RMS residual without it is at most this share.
const MAX_RMS_RATIO: f64 = 0.5;
/// Number of the largest tags from which the solver starts.
const MAX_INITIAL_TAGS: usize = 3;

/// Result of detecting a board in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPose {
    /// Ids of the tags, ascending.
    pub tags: Vec<u32>,
    /// Ids of the board's tags that were left out because they are detected several times.
    pub repeated: Vec<u32>,
    /// Corners of the tags, four for each.
    pub corners: Corners,
    pub best: PoseSolution,
    /// The second pose of a flat tag, if the picture does not rule it out.
    pub other: Option<PoseSolution>,
}

/// Reason why a picture gives no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PoseFailure {
    #[error("no tag is seen")]
    Nothing,
    #[error("the visible tags are not on the board: {}", ids(.0))]
    NotOnBoard(Vec<u32>),
    #[error("{}", repeated_message(.0))]
    Repeated(Vec<u32>),
    #[error("the tags {} are not arranged as on the board: off by {median_px:.1} px", ids(tags))]
    Misfit { tags: Vec<u32>, median_px: f64 },
    #[error("the tags {} do not determine the camera's pose", ids(.0))]
    Unsolved(Vec<u32>),
}

fn ids(ids: &[u32]) -> String {
    ids.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")
}

/// Message about tags that are detected several times.
pub fn repeated_message(tags: &[u32]) -> String {
    let (which, are) = if tags.len() == 1 { ("tag", "is") } else { ("tags", "are") };
    format!("the {which} {} {are} detected more than once; remove the other prints", ids(tags))
}

impl BoardPose {
    /// Estimates the poses from the tags of a picture. Also reports those of the board that are
    /// left out because they are detected several times.
    pub fn of_tags(geometry: &Geometry, board: &Board, tags: &DetectedTags) -> Result<Self, PoseFailure> {
        let repeated: Vec<u32> = tags.repeated.iter().copied().filter(|id| board.tag(*id).is_some()).collect();
        match Self::of(geometry, board, &tags.tags, &[]) {
            Ok(sight) => Ok(Self { repeated, ..sight }),
            Err(PoseFailure::Nothing | PoseFailure::NotOnBoard(_)) if !repeated.is_empty() => {
                Err(PoseFailure::Repeated(repeated))
            }
            Err(PoseFailure::Nothing) if !tags.repeated.is_empty() => {
                Err(PoseFailure::NotOnBoard(tags.repeated.clone()))
            }
            Err(failure) => Err(failure),
        }
    }

    /// Estimates the poses from the tags of a picture. `near` are additional initial poses, such as
    /// the last one.
    pub fn of(
        geometry: &Geometry,
        board: &Board,
        detected: &[DetectedTag],
        near: &[Pose],
    ) -> Result<Self, PoseFailure> {
        let tags_of_board = detected.iter().filter(|tag| board.tag(tag.id).is_some()).count();
        Self::leaving_out_at_most(geometry, board, detected, near, tags_of_board / MIN_TAGS)
    }

    /// Like [`BoardPose::of`], with a limit on the number of tags that are left out.
    fn leaving_out_at_most(
        geometry: &Geometry,
        board: &Board,
        detected: &[DetectedTag],
        near: &[Pose],
        left_out: usize,
    ) -> Result<Self, PoseFailure> {
        let ids = |tags: &[DetectedTag]| tags.iter().map(|tag| tag.id).collect::<Vec<_>>();
        let mut tags_of_board: Vec<(&DetectedTag, [DVec3; 4])> =
            detected.iter().filter_map(|tag| Some((tag, board.tag(tag.id)?.corners_m()))).collect();
        if tags_of_board.is_empty() {
            return Err(if detected.is_empty() {
                PoseFailure::Nothing
            } else {
                PoseFailure::NotOnBoard(ids(detected))
            });
        }
        let tags: Vec<u32> = tags_of_board.iter().map(|(tag, _)| tag.id).collect();
        let mut corners = Corners::default();
        for (tag, places) in &tags_of_board {
            corners.in_world_m.extend(places);
            corners.seen_px.extend(tag.corners_px);
        }
        let side = |tag: &DetectedTag| {
            tag.corners_px[0].distance(tag.corners_px[2]).max(tag.corners_px[1].distance(tag.corners_px[3]))
        };
        let side_px =
            tags_of_board.iter().map(|(tag, _)| side(tag)).sum::<f64>() / (2f64.sqrt() * tags_of_board.len() as f64);
        tags_of_board.sort_by(|a, b| side(b.0).total_cmp(&side(a.0)));
        let begun = tags_of_board
            .iter()
            .take(MAX_INITIAL_TAGS)
            .filter_map(|(tag, places)| initial_poses(geometry, places, &tag.corners_px));
        let mut solutions: Vec<PoseSolution> = Vec::new();
        for pose in near.iter().copied().chain(begun.flatten()) {
            let Some(solution) = solve_pose(geometry, &corners, &pose) else { continue };
            if faces(geometry, &corners, &solution) && !solutions.iter().any(|other| same(other, &solution, &corners)) {
                solutions.push(solution);
            }
        }
        solutions.sort_by(|a, b| a.rms_px().total_cmp(&b.rms_px()));
        let mut solutions = solutions.into_iter();
        let Some(best) = solutions.next() else { return Err(PoseFailure::Unsolved(tags)) };
        if let Some(without) = without_the_worst(geometry, board, detected, &tags, &best, left_out) {
            return Ok(without);
        }
        let median_px = crate::fit::robust::median_length(best.residuals_px.iter());
        if median_px > MAX_MEDIAN_PX.max(MAX_MEDIAN_SHARE * side_px) {
            return Err(PoseFailure::Misfit { tags, median_px });
        }
        let other = solutions.next().filter(|other| !ruled_out(other, &best));
        Ok(Self { tags, repeated: Vec::new(), corners, best, other })
    }
}

/// Repeats the estimate without the tag that fits worst, if that improves the fit far: a tag that
/// was misread, bent or moved.
fn without_the_worst(
    geometry: &Geometry,
    board: &Board,
    detected: &[DetectedTag],
    tags: &[u32],
    best: &PoseSolution,
    left_out: usize,
) -> Option<BoardPose> {
    if left_out == 0 || best.rms_px() < MISREAD_RMS_PX {
        return None;
    }
    let squares = |corners: &[DVec2; 4]| corners.iter().map(|r| r.length_squared()).sum::<f64>();
    let off = tags.iter().zip(best.residuals_px.as_chunks::<4>().0);
    let (worst, _) = off.max_by(|a, b| squares(a.1).total_cmp(&squares(b.1)))?;
    let others: Vec<DetectedTag> = detected.iter().filter(|tag| tag.id != *worst).cloned().collect();
    let sight = BoardPose::leaving_out_at_most(geometry, board, &others, &[best.pose], left_out - 1).ok()?;
    (sight.best.rms_px() < MAX_RMS_RATIO * best.rms_px()).then_some(sight)
}

/// True if the picture contradicts a pose.
fn ruled_out(other: &PoseSolution, best: &PoseSolution) -> bool {
    let count = best.residuals_px.len() as f64;
    let variance_px2 = (best.squares_px2 / (2.0 * count - 6.0).max(1.0)).max(MIN_SIGMA_PX * MIN_SIGMA_PX);
    other.squares_px2 - best.squares_px2 > MIN_VARIANCES * variance_px2
}

/// True if the tags face the camera and are in front of it: a tag's back shows nothing.
fn faces(geometry: &Geometry, corners: &Corners, solved: &PoseSolution) -> bool {
    corners.in_world_m.as_chunks::<4>().0.iter().all(|[a, b, _, d]| {
        let towards = solved.pose.position_in_world_m() - *a;
        (*b - *a).cross(*a - *d).dot(towards) > 0.0 && geometry.project(solved.pose.transform_point(*a)).is_some()
    })
}

fn same(a: &PoseSolution, b: &PoseSolution, corners: &Corners) -> bool {
    let turn = a.pose.rotation.angle_between(b.pose.rotation);
    let way = a.pose.position_in_world_m().distance(b.pose.position_in_world_m());
    let distance = corners.in_world_m.first().map_or(0.0, |place| a.pose.transform_point(*place).length());
    turn < SAME_RAD && way < SAME_SHARE * distance
}
