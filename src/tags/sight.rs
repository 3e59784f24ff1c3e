//! What one picture says of the camera's pose, before it is known what stood in the pictures around it.

use glam::{DVec2, DVec3};

use super::board::Board;
use super::detect::{Found, Tags};
use super::solve::{Corners, Solved, begun, solved};
use crate::camera::Geometry;
use crate::pose::Pose;

/// Two poses are one if they differ by less than this, rad...
const SAME_RAD: f64 = 0.5e-2;
/// ... and this share of the distance to the tags.
const SAME_WAY: f64 = 0.5e-2;
/// The picture decides between two poses if the worse one's squares are larger by that of five deviations...
const DECIDES: f64 = 25.0;
/// ... of a corner, which is read no better than this, px.
const READ_PX: f64 = 0.1;
/// Residuals whose median is larger than this share of the tags' sides, and than so many px, are no board's.
const MISFIT: f64 = 0.05;
const MISFIT_PX: f64 = 1.0;
/// With residuals of this root mean square, px, one of so many tags may be misread...
const ODD_PX: f64 = 0.5;
const LEAST_TAGS: usize = 3;
/// ... which is left out if without it this share of them remains.
const FAR_BETTER: f64 = 0.5;
/// Poses begin from as many tags, the largest ones.
const MOST_BEGUN: usize = 3;

/// What was seen of a board.
#[derive(Clone, Debug, PartialEq)]
pub struct Sight {
    /// Ids of the tags, ascending.
    pub tags: Vec<u32>,
    /// Ids of the board's tags that are seen in several places and were left out.
    pub repeated: Vec<u32>,
    /// Their corners, four for each.
    pub corners: Corners,
    pub best: Solved,
    /// The other pose of a flat tag, where the picture does not rule it out.
    pub other: Option<Solved>,
}

/// Why a picture gives no pose.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Lost {
    #[error("no tag is seen")]
    Nothing,
    #[error("the tags that are seen are not on the board: {}", ids(.0))]
    NotOnBoard(Vec<u32>),
    #[error("{}", repeated(.0))]
    Repeated(Vec<u32>),
    #[error("the tags {} do not stand to each other as on the board: off by {median_px:.1} px", ids(tags))]
    Misfit { tags: Vec<u32>, median_px: f64 },
    #[error("the tags {} do not say where the camera stood", ids(.0))]
    Unsolved(Vec<u32>),
}

fn ids(ids: &[u32]) -> String {
    ids.iter().map(u32::to_string).collect::<Vec<_>>().join(", ")
}

/// What is told of tags that are seen in several places.
pub fn repeated(tags: &[u32]) -> String {
    let (which, are) = if tags.len() == 1 { ("tag", "is") } else { ("tags", "are") };
    format!("the {which} {} {are} detected more than once; remove the other prints", ids(tags))
}

impl Sight {
    /// The poses that explain the tags of a picture, with those of the board that are left out because they are seen in
    /// several places.
    pub fn of_tags(geometry: &Geometry, board: &Board, tags: &Tags) -> Result<Self, Lost> {
        let repeated: Vec<u32> = tags.repeated.iter().copied().filter(|id| board.tag(*id).is_some()).collect();
        match Self::of(geometry, board, &tags.found, &[]) {
            Ok(sight) => Ok(Self { repeated, ..sight }),
            Err(Lost::Nothing | Lost::NotOnBoard(_)) if !repeated.is_empty() => Err(Lost::Repeated(repeated)),
            Err(Lost::Nothing) if !tags.repeated.is_empty() => Err(Lost::NotOnBoard(tags.repeated.clone())),
            Err(lost) => Err(lost),
        }
    }

    /// The poses that explain the tags of a picture. `near` are poses to try besides, such as the last one.
    pub fn of(geometry: &Geometry, board: &Board, found: &[Found], near: &[Pose]) -> Result<Self, Lost> {
        let known = found.iter().filter(|tag| board.tag(tag.id).is_some()).count();
        Self::of_most(geometry, board, found, near, known / LEAST_TAGS)
    }

    /// The same, with at most so many tags left out.
    fn of_most(
        geometry: &Geometry,
        board: &Board,
        found: &[Found],
        near: &[Pose],
        left_out: usize,
    ) -> Result<Self, Lost> {
        let ids = |found: &[Found]| found.iter().map(|tag| tag.id).collect::<Vec<_>>();
        let mut known: Vec<(&Found, [DVec3; 4])> =
            found.iter().filter_map(|tag| Some((tag, board.tag(tag.id)?.corners_m()))).collect();
        if known.is_empty() {
            return Err(if found.is_empty() { Lost::Nothing } else { Lost::NotOnBoard(ids(found)) });
        }
        let tags: Vec<u32> = known.iter().map(|(tag, _)| tag.id).collect();
        let mut corners = Corners::default();
        for (tag, places) in &known {
            corners.in_world_m.extend(places);
            corners.seen_px.extend(tag.corners_px);
        }
        let side = |tag: &Found| {
            tag.corners_px[0].distance(tag.corners_px[2]).max(tag.corners_px[1].distance(tag.corners_px[3]))
        };
        let side_px = known.iter().map(|(tag, _)| side(tag)).sum::<f64>() / (2f64.sqrt() * known.len() as f64);
        known.sort_by(|a, b| side(b.0).total_cmp(&side(a.0)));
        let begun = known.iter().take(MOST_BEGUN).filter_map(|(tag, places)| begun(geometry, places, &tag.corners_px));
        let mut solutions: Vec<Solved> = Vec::new();
        for pose in near.iter().copied().chain(begun.flatten()) {
            let Some(found) = solved(geometry, &corners, &pose) else { continue };
            if faces(geometry, &corners, &found) && !solutions.iter().any(|other| same(other, &found, &corners)) {
                solutions.push(found);
            }
        }
        solutions.sort_by(|a, b| a.rms_px().total_cmp(&b.rms_px()));
        let mut solutions = solutions.into_iter();
        let Some(best) = solutions.next() else { return Err(Lost::Unsolved(tags)) };
        if let Some(without) = without_the_oddest(geometry, board, found, &tags, &best, left_out) {
            return Ok(without);
        }
        let median_px = crate::fit::robust::median(best.residuals_px.iter());
        if median_px > MISFIT_PX.max(MISFIT * side_px) {
            return Err(Lost::Misfit { tags, median_px });
        }
        let other = solutions.next().filter(|other| !ruled_out(other, &best));
        Ok(Self { tags, repeated: Vec::new(), corners, best, other })
    }
}

/// The same from all tags but the one that fits worst, if that explains the others far better: a tag that was misread, bent
/// or moved.
fn without_the_oddest(
    geometry: &Geometry,
    board: &Board,
    found: &[Found],
    tags: &[u32],
    best: &Solved,
    left_out: usize,
) -> Option<Sight> {
    if left_out == 0 || best.rms_px() < ODD_PX {
        return None;
    }
    let squares = |corners: &[DVec2; 4]| corners.iter().map(|r| r.length_squared()).sum::<f64>();
    let off = tags.iter().zip(best.residuals_px.as_chunks::<4>().0);
    let (oddest, _) = off.max_by(|a, b| squares(a.1).total_cmp(&squares(b.1)))?;
    let others: Vec<Found> = found.iter().filter(|tag| tag.id != *oddest).cloned().collect();
    let sight = Sight::of_most(geometry, board, &others, &[best.pose], left_out - 1).ok()?;
    (sight.best.rms_px() < FAR_BETTER * best.rms_px()).then_some(sight)
}

/// Whether the picture speaks against a pose.
fn ruled_out(other: &Solved, best: &Solved) -> bool {
    let count = best.residuals_px.len() as f64;
    let variance_px2 = (best.squares_px2 / (2.0 * count - 6.0).max(1.0)).max(READ_PX * READ_PX);
    other.squares_px2 - best.squares_px2 > DECIDES * variance_px2
}

/// Whether the corners lie in front of the camera that stands there: a tag's back shows nothing.
fn faces(geometry: &Geometry, corners: &Corners, solved: &Solved) -> bool {
    corners.in_world_m.as_chunks::<4>().0.iter().all(|[a, b, _, d]| {
        let towards = solved.pose.position_in_world_m() - *a;
        (*b - *a).cross(*a - *d).dot(towards) > 0.0 && geometry.project(solved.pose.transform_point(*a)).is_some()
    })
}

fn same(a: &Solved, b: &Solved, corners: &Corners) -> bool {
    let turn = a.pose.rotation.angle_between(b.pose.rotation);
    let way = a.pose.position_in_world_m().distance(b.pose.position_in_world_m());
    let distance = corners.in_world_m.first().map_or(0.0, |place| a.pose.transform_point(*place).length());
    turn < SAME_RAD && way < SAME_WAY * distance
}
