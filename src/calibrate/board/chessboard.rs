//! A chessboard in a picture: its inner corners with their places on the board.
//!
//! Pictures are searched small, where squares are a few pixels to a few dozens wide, and corners are then refined in the
//! picture as it was taken.

use glam::DVec2;

use super::plane::Plane;
use super::seen::{Board, Seen, Target};
use super::{corners, grid, refine};

/// Why no board was found in a picture.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq, Eq)]
pub enum NoBoard {
    #[error(
        "no chessboard is seen: it must be in focus and at rest, lit evenly, with squares some 10 px wide and a white rim"
    )]
    None,
    #[error("only {corners} corners of a chessboard are seen; {LEAST_CORNERS} in {LEAST_LINES} rows are needed")]
    Few { corners: usize },
    #[error("a grid of {found} corners is seen, more than the board's {board}; is --board right?")]
    Larger { found: Board, board: Board },
}

/// A view of fewer corners says little more than where its board is.
const LEAST_CORNERS: usize = 12;
const LEAST_LINES: u32 = 3;
/// Longest side of the pictures that are searched, px, one after the other.
const SEARCHED_PX: [usize; 3] = [1400, 700, 3600];

/// Looks for a chessboard in a picture of 8-bit codes. With `board`, for one of that size or a part of it.
pub fn find(picture: &Plane, board: Option<Board>) -> Result<Seen, NoBoard> {
    let mut best: Result<Seen, NoBoard> = Err(NoBoard::None);
    let mut tried = Vec::new();
    for longest in SEARCHED_PX {
        let by = picture.width.max(picture.height).div_ceil(longest).max(1);
        // The largest pictures are searched for boards far away, which no smaller picture shows.
        if tried.contains(&by) || (longest > SEARCHED_PX[0] && best.is_ok()) {
            continue;
        }
        tried.push(by);
        let seen = find_at(picture, by, board);
        let count = |seen: &Result<Seen, NoBoard>| match seen {
            Ok(seen) => (2, seen.at_px.len()),
            Err(NoBoard::None) => (0, 0),
            Err(NoBoard::Few { corners }) => (1, *corners),
            Err(NoBoard::Larger { .. }) => (1, usize::MAX),
        };
        if count(&seen) > count(&best) {
            best = seen;
        }
        if board.is_some_and(|board| best.as_ref().is_ok_and(|seen| seen.at_px.len() == board.corners())) {
            break;
        }
    }
    best
}

fn find_at(picture: &Plane, by: usize, board: Option<Board>) -> Result<Seen, NoBoard> {
    let small = picture.reduced(by).blurred(corners::BLUR_PX);
    let coarse = grid::largest(&small, &corners::corners(&small));
    let scale = by as f64;
    let refined = |(place, corner): (&(i32, i32), &corners::Corner)| {
        let room = grid::room_px(&coarse, *place)?;
        let at = refine::refined(picture, scale * corner.at, scale * room)?;
        Some((*place, corners::Corner { at, ..*corner }))
    };
    let mut grid: grid::Grid = coarse.iter().filter_map(refined).collect();
    grid::prune(&mut grid);
    let (places, at_px): (Vec<_>, Vec<_>) = grid.iter().map(|(place, corner)| (*place, corner.at)).unzip();
    let span = |of: fn(&(i32, i32)) -> i32| {
        let low = places.iter().map(of).min().unwrap_or(0);
        (low, places.iter().map(of).max().map_or(0, |high| high.abs_diff(low) + 1))
    };
    let ((left, columns), (top, rows)) = (span(|place| place.0), span(|place| place.1));
    let extent = Board::new(columns, rows);
    match board {
        _ if places.is_empty() => Err(NoBoard::None),
        _ if places.len() < LEAST_CORNERS || extent.rows < LEAST_LINES => Err(NoBoard::Few { corners: places.len() }),
        Some(board) if !extent.fits(board) => Err(NoBoard::Larger { found: extent, board }),
        _ => {
            let place = |(column, row): (i32, i32)| DVec2::new(f64::from(column - left), f64::from(row - top));
            Ok(Seen { board: places.into_iter().map(place).collect(), at_px, of: Target::Chessboard(extent) })
        }
    }
}
