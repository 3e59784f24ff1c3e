//! Detection of a chessboard: its inner corners and their positions on the board.
//!
//! The picture is searched at reduced sizes, at which squares are a few pixels to a few dozen wide.
//! The corners are then refined in the original picture.

use glam::DVec2;

use super::detection::{BoardDetection, ChessboardSize, DetectedTarget};
use super::{corners, grid, refine};
use crate::grey_image::GreyImage;

/// Reason why no board was found in a picture.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq, Eq)]
pub enum ChessboardError {
    #[error(
        "no chessboard is seen: it must be in focus and at rest, lit evenly, with squares about 10 px wide and a white rim"
    )]
    None,
    #[error("only {corners} corners of a chessboard are seen; {MIN_CORNERS} in {MIN_ROWS} rows are needed")]
    Few { corners: usize },
    #[error("a grid of {actual} corners is seen, more than the board's {board}; is --board right?")]
    Larger { actual: ChessboardSize, board: ChessboardSize },
}

/// Views with fewer corners contribute little more than the board's pose.
const MIN_CORNERS: usize = 12;
const MIN_ROWS: u32 = 3;
/// Longest sides of the searched pictures, px, in order.
const SEARCH_SIZES_PX: [usize; 3] = [1400, 700, 3600];

/// Finds a chessboard in a picture of 8-bit codes; if `board` is given, one of that size or a part
/// of it.
pub fn find_chessboard(picture: &GreyImage, board: Option<ChessboardSize>) -> Result<BoardDetection, ChessboardError> {
    let mut best: Result<BoardDetection, ChessboardError> = Err(ChessboardError::None);
    let mut tried = Vec::new();
    for longest in SEARCH_SIZES_PX {
        let by = picture.width.max(picture.height).div_ceil(longest).max(1);
        // The largest size is only needed for distant boards that no smaller one shows.
        if tried.contains(&by) || (longest > SEARCH_SIZES_PX[0] && best.is_ok()) {
            continue;
        }
        tried.push(by);
        let detection = find_at_scale(picture, by, board);
        let count = |detection: &Result<BoardDetection, ChessboardError>| match detection {
            Ok(detection) => (2, detection.corners_px.len()),
            Err(ChessboardError::None) => (0, 0),
            Err(ChessboardError::Few { corners }) => (1, *corners),
            Err(ChessboardError::Larger { .. }) => (1, usize::MAX),
        };
        if count(&detection) > count(&best) {
            best = detection;
        }
        if board.is_some_and(|board| best.as_ref().is_ok_and(|detection| detection.corners_px.len() == board.corners()))
        {
            break;
        }
    }
    best
}

fn find_at_scale(
    picture: &GreyImage,
    by: usize,
    board: Option<ChessboardSize>,
) -> Result<BoardDetection, ChessboardError> {
    let small = picture.reduced(by).blurred(corners::BLUR_PX);
    let coarse = grid::largest_grid(&small, &corners::detect(&small));
    let scale = by as f64;
    let refined = |(place, corner): (&(i32, i32), &corners::Corner)| {
        let room = grid::clearance_px(&coarse, *place)?;
        let at = refine::refine_corner(picture, scale * corner.at, scale * room)?;
        Some((*place, corners::Corner { at, ..*corner }))
    };
    let mut grid: grid::Grid = coarse.iter().filter_map(refined).collect();
    grid::prune(&mut grid);
    let (places, corners_px): (Vec<_>, Vec<_>) = grid.iter().map(|(place, corner)| (*place, corner.at)).unzip();
    let span = |of: fn(&(i32, i32)) -> i32| {
        let low = places.iter().map(of).min().unwrap_or(0);
        (low, places.iter().map(of).max().map_or(0, |high| high.abs_diff(low) + 1))
    };
    let ((left, columns), (top, rows)) = (span(|place| place.0), span(|place| place.1));
    let extent = ChessboardSize::new(columns, rows);
    match board {
        _ if places.is_empty() => Err(ChessboardError::None),
        _ if places.len() < MIN_CORNERS || extent.rows < MIN_ROWS => {
            Err(ChessboardError::Few { corners: places.len() })
        }
        Some(board) if !extent.fits(board) => Err(ChessboardError::Larger { actual: extent, board }),
        _ => {
            let place = |(column, row): (i32, i32)| DVec2::new(f64::from(column - left), f64::from(row - top));
            Ok(BoardDetection {
                board: places.into_iter().map(place).collect(),
                corners_px,
                target: DetectedTarget::Chessboard(extent),
            })
        }
    }
}
