//! What was seen of a board, whatever is printed on it.

use std::fmt;

use glam::DVec2;

/// A chessboard's inner corners: where four squares meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Across its longer side.
    pub columns: u32,
    pub rows: u32,
}

impl Board {
    /// The longer side first.
    pub fn new(columns: u32, rows: u32) -> Self {
        Self { columns: columns.max(rows), rows: columns.min(rows) }
    }

    pub fn corners(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    pub(super) fn fits(&self, other: Self) -> bool {
        self.columns <= other.columns && self.rows <= other.rows
    }
}

impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

/// What a camera is calibrated from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    Chessboard(Board),
    /// A board of so many printed tags.
    Tags(usize),
}

impl Target {
    /// As many corners as there are to see.
    pub fn corners(&self) -> usize {
        match self {
            Self::Chessboard(board) => board.corners(),
            Self::Tags(tags) => 4 * tags,
        }
    }

    /// What it is, whatever its size.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Chessboard(_) => "a chessboard",
            Self::Tags(_) => "printed tags",
        }
    }
}

/// Corners of a board in a picture. Of a chessboard that is seen in part corners are numbered from the part's own corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Places on the board, x right and y down as seen or as printed; of a chessboard in squares, of tags in metres.
    pub board: Vec<DVec2>,
    /// Where they are seen, px, pixel centres at +0.5; as many.
    pub at_px: Vec<DVec2>,
    /// What was seen of a chessboard, or the whole board of tags.
    pub of: Target,
}
