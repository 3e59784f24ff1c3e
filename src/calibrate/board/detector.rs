//! Detection of any calibration target.

use super::chessboard::{ChessboardError, find_chessboard};
use super::detection::{BoardDetection, ChessboardSize};
use super::tag_board::{NotOnPlane, TagBoardDetector, TagsError};
use crate::camera::Response;
use crate::grey_image::GreyImage;
use crate::pixels::{Pixels, WEIGHTS_709};
use crate::tags::{self, Paper, Sheet};

/// The target to detect.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum TargetChoice {
    /// The sheet of tags that `locard board` prints, or a chessboard of any size.
    #[default]
    Any,
    /// A chessboard of this size.
    Chessboard(ChessboardSize),
    /// These tags.
    Tags(tags::Board),
}

/// Detects the target in a series of pictures.
pub struct BoardDetector {
    chessboard: Option<Option<ChessboardSize>>,
    tags: Option<TagBoardDetector>,
}

impl BoardDetector {
    /// `response` linearizes the camera's codes.
    pub fn new(target: &TargetChoice, response: &Response) -> Result<Self, NotOnPlane> {
        let printed = |board| Ok(Some(TagBoardDetector::new(board, response)?));
        Ok(match target {
            TargetChoice::Any => Self { chessboard: Some(None), tags: printed(Sheet::new(Paper::A4).board)? },
            TargetChoice::Chessboard(board) => Self { chessboard: Some(Some(*board)), tags: None },
            TargetChoice::Tags(board) => Self { chessboard: None, tags: printed(board.clone())? },
        })
    }

    /// The detected corners, or the reason why there are none.
    pub fn find(&mut self, pixels: &Pixels) -> Result<BoardDetection, String> {
        // The tag detector is faster and rarely fires on anything else.
        let no_tags = match self.tags.as_mut().map(|tags| tags.find(pixels)) {
            Some(Ok(detection)) => return Ok(detection),
            Some(Err(why)) => Some(why),
            None => None,
        };
        let Some(size) = self.chessboard else { return Err(no_tags.map_or(String::new(), |why| why.to_string())) };
        find_chessboard(&grey(pixels), size).map_err(|why| match (no_tags, why) {
            (Some(TagsError::NotOnBoard(_)), ChessboardError::None) => {
                "tags are seen, but not those of the sheet that `locard board` prints: name their file with --board"
                    .to_owned()
            }
            (Some(no_tags @ (TagsError::Few { .. } | TagsError::Repeated(_))), ChessboardError::None) => {
                no_tags.to_string()
            }
            (Some(_), ChessboardError::None) => {
                "neither printed tags nor a chessboard are seen: they must be in focus and at rest, lit evenly, with \
                 squares about 10 px wide and a white rim"
                    .to_owned()
            }
            (_, why) => why.to_string(),
        })
    }
}

/// BT.709 luma in 8-bit codes.
fn grey(pixels: &Pixels) -> GreyImage {
    let per_code = (pixels.max_code() / 255) as f32;
    GreyImage::of_codes(pixels, |codes| {
        let [r, g, b] = codes.map(|code| code as f32 / per_code);
        let [red, green, blue] = WEIGHTS_709.map(|weight| weight as f32);
        red * r + green * g + blue * b
    })
}
