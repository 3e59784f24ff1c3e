//! Detection of printed tags by a camera that is not calibrated yet.

use glam::{DVec2, DVec3};

use super::detection::{BoardDetection, DetectedTarget};
use crate::camera::Response;
use crate::pixels::Pixels;
use crate::tags::{self, DetectError, DetectedTag, Detector, LumaCodes, refine_corners_without_lens};
use crate::text::count;

/// Smallest number of tags. A single tag's four corners fit nearly any camera.
const MIN_TAGS: usize = 2;
/// Largest distance of a tag from the board's plane, as a share of its size: the bend of paper.
const MAX_OFF_PLANE: f64 = 0.01;

/// Reason why tags give no view.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum TagsError {
    #[error("no tags are seen")]
    None,
    #[error("of {} that are seen {readable} can be read to their edges; {MIN_TAGS} are needed", count(*detected, "tag"))]
    Few { detected: usize, readable: usize },
    #[error("the visible tags are not on the board: {}", .0.iter().map(u32::to_string).collect::<Vec<_>>().join(", "))]
    NotOnBoard(Vec<u32>),
    #[error("{}", tags::repeated_message(.0))]
    Repeated(Vec<u32>),
    #[error(transparent)]
    Detect(#[from] DetectError),
}

/// A tag of a board that is not on the board's plane.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("tag {0} of the board does not lie on its plane z = 0: a camera is calibrated from tags that do")]
pub struct NotOnPlane(u32);

/// Detector of a board of printed tags.
pub struct TagBoardDetector {
    board: tags::Board,
    light: Vec<f32>,
    /// Detector for pictures of one size. No memo: detection changes its buffers.
    detector: Option<((u32, u32), Detector)>,
}

impl TagBoardDetector {
    /// `response` linearizes the camera's codes.
    pub fn new(board: tags::Board, response: &Response) -> Result<Self, NotOnPlane> {
        let slanted = board.tags.iter().find(|tag| {
            let off = tag.corners_m().into_iter().map(|corner| corner.z.abs()).fold(0.0, f64::max);
            off > MAX_OFF_PLANE * tag.size_m || faces_down(&tag.corners_m())
        });
        match slanted {
            Some(tag) => Err(NotOnPlane(tag.id)),
            None => Ok(Self { board, light: LumaCodes::table(response), detector: None }),
        }
    }

    /// Detects and refines the corners of the board's tags in a picture.
    pub fn find(&mut self, pixels: &Pixels) -> Result<BoardDetection, TagsError> {
        let size = (pixels.width, pixels.height);
        let kept = self.detector.take().filter(|(own, _)| *own == size);
        let (_, detector) = match kept {
            Some(kept) => self.detector.insert(kept),
            None => self.detector.insert((size, Detector::new(self.board.family, size.0, size.1)?)),
        };
        let grey = LumaCodes::of(pixels, self.light.clone());
        let tags::DetectedTags { tags, mut repeated } = detector.find_board(&grey, &self.board)?;
        repeated.retain(|id| self.board.tag(*id).is_some());
        let board_tags: Vec<(&DetectedTag, [DVec3; 4])> =
            tags.iter().filter_map(|tag| Some((tag, self.board.tag(tag.id)?.corners_m()))).collect();
        if board_tags.is_empty() && !repeated.is_empty() {
            return Err(TagsError::Repeated(repeated));
        }
        if board_tags.is_empty() {
            let ids: Vec<u32> = tags.iter().map(|tag| tag.id).collect();
            return Err(if ids.is_empty() { TagsError::None } else { TagsError::NotOnBoard(ids) });
        }
        let tag_count = board_tags.len();
        let (mut board, mut corners_px) = (Vec::new(), Vec::new());
        for (tag, corners_m) in board_tags {
            let Some(refined) = refine_corners_without_lens(&grey, self.board.family.cells(), tag) else { continue };
            // The board's y axis points up the sheet.
            board.extend(corners_m.map(|corner| DVec2::new(corner.x, -corner.y)));
            corners_px.extend(refined.corners_px);
        }
        let readable = corners_px.len() / 4;
        if readable < MIN_TAGS {
            return Err(TagsError::Few { detected: tag_count, readable });
        }
        Ok(BoardDetection { board, corners_px, target: DetectedTarget::Tags(self.board.tags.len()) })
    }
}

/// True if a tag lies face down on the plane.
fn faces_down([a, b, _, d]: &[DVec3; 4]) -> bool {
    (*b - *a).cross(*a - *d).z < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn board_that_is_not_flat_is_refused() {
        let board = |tag: &str| {
            let first = "version = 1\nfamily = \"36h11\"\n[[tags]]\nid = 7\nsize_m = 0.1\ncenter_m = [1.0, 2.0]\n";
            tags::Board::parse(&format!("{first}[[tags]]\nid = 9\nsize_m = 0.1\n{tag}")).unwrap()
        };
        let of =
            |tag: &str| TagBoardDetector::new(board(tag), &Response::default()).map(|_| ()).map_err(|e| e.to_string());
        assert_eq!(of("center_m = [0, 0]\nrotation_deg = [0, 0, 35]"), Ok(()));
        for tag in [
            "center_m = [0, 0, 0.1]",
            "center_m = [0, 0]\nrotation_deg = [4, 0, 0]",
            "center_m = [0, 0]\nrotation_deg = [180, 0, 0]",
        ] {
            assert!(of(tag).unwrap_err().starts_with("tag 9 of the board does not lie on its plane z = 0"), "{tag}");
        }
    }
}
