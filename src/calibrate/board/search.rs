//! Looks for whatever a camera can be calibrated from.

use super::chessboard::{NoBoard, find};
use super::plane::Plane;
use super::printed::{NoTags, Printed, Slanted};
use super::seen::{Board, Seen};
use crate::camera::Response;
use crate::pixels::{Codes, Pixels};
use crate::tags::{self, Paper, Sheet};

/// What is looked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Wanted {
    /// The sheet of tags that `locard board` prints, or a chessboard of any size.
    #[default]
    Any,
    /// A chessboard of this size.
    Chessboard(Board),
    /// These tags.
    Tags(tags::Board),
}

/// Looks for it in one picture after the other.
pub struct Search {
    chessboard: Option<Option<Board>>,
    tags: Option<Printed>,
}

impl Search {
    /// `response` turns the camera's codes to light.
    pub fn new(wanted: &Wanted, response: &Response) -> Result<Self, Slanted> {
        let printed = |board| Ok(Some(Printed::new(board, response)?));
        Ok(match wanted {
            Wanted::Any => Self { chessboard: Some(None), tags: printed(Sheet::new(Paper::A4).board)? },
            Wanted::Chessboard(board) => Self { chessboard: Some(Some(*board)), tags: None },
            Wanted::Tags(board) => Self { chessboard: None, tags: printed(board.clone())? },
        })
    }

    /// What is seen, or why nothing is.
    pub fn find(&mut self, pixels: &Pixels) -> Result<Seen, String> {
        // Tags are told from anything else at once; a chessboard takes longer.
        let no_tags = match self.tags.as_mut().map(|tags| tags.find(pixels)) {
            Some(Ok(seen)) => return Ok(seen),
            Some(Err(why)) => Some(why),
            None => None,
        };
        let Some(size) = self.chessboard else { return Err(no_tags.map_or(String::new(), |why| why.to_string())) };
        find(&grey(pixels), size).map_err(|why| match (no_tags, why) {
            (Some(NoTags::NotOnBoard(_)), NoBoard::None) => {
                "tags are seen, but not those of the sheet that `locard board` prints: name their file with --board"
                    .to_owned()
            }
            (Some(no_tags @ (NoTags::Few { .. } | NoTags::Repeated(_))), NoBoard::None) => no_tags.to_string(),
            (Some(_), NoBoard::None) => {
                "neither printed tags nor a chessboard are seen: they must be in focus and at rest, lit evenly, with \
                 squares some 10 px wide and a white rim"
                    .to_owned()
            }
            (_, why) => why.to_string(),
        })
    }
}

/// Codes of 8 bits, BT.709 luma.
fn grey(pixels: &Pixels) -> Plane {
    let (width, height) = (pixels.width as usize, pixels.height as usize);
    let luma = |rgb: [f32; 3]| 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    Plane::new(width, height, |x, y| {
        let i = 3 * (y * width + x);
        match &pixels.codes {
            Codes::U8(codes) => luma([0, 1, 2].map(|c| f32::from(codes[i + c]))),
            Codes::U16(codes) => luma([0, 1, 2].map(|c| f32::from(codes[i + c]) / 257.0)),
        }
    })
}
