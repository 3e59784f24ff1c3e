//! Detected corners of a calibration target.

use std::fmt;

use glam::DVec2;

/// Size of a chessboard in inner corners, where four squares meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChessboardSize {
    /// Along its longer side.
    pub columns: u32,
    pub rows: u32,
}

impl ChessboardSize {
    /// Orders the sides, the longer one first.
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

impl fmt::Display for ChessboardSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

/// A calibration target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DetectedTarget {
    Chessboard(ChessboardSize),
    /// A board with this many printed tags.
    Tags(usize),
}

impl DetectedTarget {
    /// Number of corners of the whole target.
    pub fn corners(&self) -> usize {
        match self {
            Self::Chessboard(board) => board.corners(),
            Self::Tags(tags) => 4 * tags,
        }
    }

    /// Kind of target for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Chessboard(_) => "a chessboard",
            Self::Tags(_) => "printed tags",
        }
    }
}

/// Corners of a board in a picture. Those of a chessboard that is seen in part are numbered from
/// the corner of the visible part.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardDetection {
    /// Positions on the board, x right and y down as seen or as printed; of a chessboard in
    /// squares, of tags in metres.
    pub board: Vec<DVec2>,
    /// Detected positions, px, pixel centres at +0.5; one for each board position.
    pub corners_px: Vec<DVec2>,
    /// The visible part of a chessboard, or the whole board of tags.
    pub target: DetectedTarget,
}
