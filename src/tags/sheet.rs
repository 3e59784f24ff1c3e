//! The printed sheet: tags, a ruler to check the scale, and labels.

use glam::DVec2;

use super::board::{Board, Tag};
use super::family::Family;

crate::choices! {
    /// A size of paper.
    pub enum Paper {
        /// 210 by 297 mm.
        A4 = "a4",
        /// 8.5 by 11 inches.
        Letter = "letter",
    }
}

impl Paper {
    /// Width and height, mm.
    pub fn size_mm(self) -> DVec2 {
        match self {
            Self::A4 => DVec2::new(210.0, 297.0),
            Self::Letter => DVec2::new(215.9, 279.4),
        }
    }
}

/// The tags are the same on every paper. They are as large as possible while a hand, or a piece of
/// evidence, can only cover one. At 640 pixels across a webcam's 60° their cells are 3 px wide at 2
/// m.
const COLUMNS: u32 = 2;
const ROWS: u32 = 3;
const SIDE_MM: f64 = 65.0;
/// Gap between two tags: a white border of a cell for each, and a line of text.
const GAP_MM: f64 = 20.0;
/// Distance from the paper's upper edge.
const TOP_MM: f64 = 12.0;
const RULER_MM: f64 = 150.0;
/// The label starts below the tag's white border.
const LABEL_MM: f64 = 12.0;
const LETTERS_MM: f64 = 2.6;

/// A rectangle: its lower left corner and its size, mm from the paper's lower left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SheetRect {
    pub at_mm: DVec2,
    pub size_mm: DVec2,
}

impl SheetRect {
    fn new(x: f64, y: f64, width: f64, height: f64) -> Self {
        Self { at_mm: DVec2::new(x, y), size_mm: DVec2::new(width, height) }
    }
}

/// An element of the sheet. Later ones cover earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub enum SheetMark {
    Black(Vec<SheetRect>),
    White(Vec<SheetRect>),
    /// ASCII, from the left end of its baseline.
    Text {
        at_mm: DVec2,
        height_mm: f64,
        text: String,
    },
}

/// A sheet of tags with its board.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    pub paper: Paper,
    pub board: Board,
    pub marks: Vec<SheetMark>,
}

impl Sheet {
    /// The sheet that `locard board` prints: six tags of 36h11.
    pub fn new(paper: Paper) -> Self {
        let family = Family::Tag36h11;
        let page = paper.size_mm();
        let pitch = SIDE_MM + GAP_MM;
        let tags_mm = DVec2::new(f64::from(COLUMNS), f64::from(ROWS)) * pitch - GAP_MM;
        let corner = DVec2::new(0.5 * (page.x - tags_mm.x), page.y - TOP_MM - tags_mm.y);
        let (mut tags, mut marks) = (Vec::new(), Vec::new());
        for id in 0..COLUMNS * ROWS {
            let (column, row) = (f64::from(id % COLUMNS), f64::from(ROWS - 1 - id / COLUMNS));
            let at = corner + pitch * DVec2::new(column, row);
            marks.extend(tag_marks(family, id, at));
            let text = format!("{} id {id}, {SIDE_MM} mm", family.name());
            marks.push(SheetMark::Text { at_mm: at - DVec2::new(0.0, LABEL_MM), height_mm: LETTERS_MM, text });
            // The origin of the world is the centre of the tags.
            let middle = 0.5 * DVec2::new(f64::from(COLUMNS - 1), f64::from(ROWS - 1));
            let center_mm = pitch * (DVec2::new(column, row) - middle);
            tags.push(Tag {
                id,
                size_m: SIDE_MM / 1e3,
                center_m: (center_mm / 1e3).extend(0.0),
                rotation_deg: glam::DVec3::ZERO,
            });
        }
        marks.extend(cross(corner + 0.5 * tags_mm));
        marks.extend(ruler(DVec2::new(0.5 * (page.x - RULER_MM), corner.y - LABEL_MM - 8.0)));
        Self { paper, board: Board { family, tags }, marks }
    }
}

fn tag_marks(family: Family, id: u32, at: DVec2) -> [SheetMark; 2] {
    let cells = family.cells();
    let cell = SIDE_MM / f64::from(cells);
    let white = family.white_cells(id).unwrap_or_default();
    let rect = |(x, y): (u32, u32)| {
        SheetRect::new(at.x + cell * f64::from(x), at.y + cell * f64::from(cells - 1 - y), cell, cell)
    };
    [
        SheetMark::Black(vec![SheetRect::new(at.x, at.y, SIDE_MM, SIDE_MM)]),
        // One shape, so that no renderer draws seams between its cells.
        SheetMark::White(white.into_iter().map(rect).collect()),
    ]
}

/// Mark at the origin of the world.
fn cross(at: DVec2) -> [SheetMark; 1] {
    const LONG: f64 = 3.0;
    const THIN: f64 = 0.2;
    [SheetMark::Black(vec![
        SheetRect::new(at.x - 0.5 * LONG, at.y - 0.5 * THIN, LONG, THIN),
        SheetRect::new(at.x - 0.5 * THIN, at.y - 0.5 * LONG, THIN, LONG),
    ])]
}

fn ruler(at: DVec2) -> Vec<SheetMark> {
    const THIN: f64 = 0.2;
    let mut lines = vec![SheetRect::new(at.x, at.y - 0.5 * THIN, RULER_MM, THIN)];
    let mut marks = Vec::new();
    for mm in (0..=RULER_MM as u32).step_by(5) {
        let (x, long) = (at.x + f64::from(mm), if mm % 10 == 0 { 3.0 } else { 1.5 });
        lines.push(SheetRect::new(x - 0.5 * THIN, at.y, THIN, long));
        if mm % 50 == 0 {
            let text = if mm == 0 { "0 mm".to_owned() } else { mm.to_string() };
            marks.push(SheetMark::Text { at_mm: DVec2::new(x + 0.8, at.y + 3.2), height_mm: LETTERS_MM, text });
        }
    }
    let text = format!(
        "Print at 100 %. This ruler must be {RULER_MM} mm long. If it is not, write its length / {RULER_MM} as scale into the board's file."
    );
    marks.push(SheetMark::Text { at_mm: at - DVec2::new(0.0, 4.5), height_mm: LETTERS_MM, text });
    marks.push(SheetMark::Black(lines));
    marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn board_is_the_same_on_both_papers_and_fits() {
        let [a4, letter] = [Paper::A4, Paper::Letter].map(Sheet::new);
        for (a, b) in a4.board.tags.iter().zip(&letter.board.tags) {
            assert!(a.id == b.id && a.size_m == b.size_m && a.center_m.distance(b.center_m) < 1e-12);
        }
        // Tag 0 is at the upper left: half a pitch to the left, a whole one up.
        assert!(a4.board.tags[0].center_m.distance(DVec3::new(-0.0425, 0.085, 0.0)) < 1e-12);
        for sheet in [a4, letter] {
            let page = sheet.paper.size_mm();
            let is_inside = |at: DVec2| at.cmpge(DVec2::splat(6.0)).all() && at.cmple(page - 6.0).all();
            for mark in &sheet.marks {
                match mark {
                    SheetMark::Black(rects) | SheetMark::White(rects) => {
                        assert!(
                            rects.iter().all(|r| is_inside(r.at_mm) && is_inside(r.at_mm + r.size_mm)),
                            "{rects:?}"
                        );
                    }
                    // Letters of Helvetica are about half as wide as high.
                    SheetMark::Text { at_mm, height_mm, text } => {
                        assert!(text.is_ascii());
                        let end = *at_mm + DVec2::new(0.55 * height_mm * text.len() as f64, *height_mm);
                        assert!(is_inside(*at_mm) && is_inside(end), "{text}: {at_mm} to {end}");
                    }
                }
            }
        }
    }
}
