//! Layout of the tags of a board: `board.toml`.

use std::fmt;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3, EulerRot};
use serde::Deserialize;

use super::family::Family;
use crate::document;
use crate::source::file::{self, MAX_DOCUMENT_BYTES};
use crate::text::{number, quoted, reason};

/// Tags at fixed positions. Their axes are the world's: metres, x to the right and y to the top of
/// the sheet, z out of it (up if it lies flat).
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    pub family: Family,
    pub tags: Vec<Tag>,
}

/// A tag of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tag {
    pub id: u32,
    /// Side of the black square, metres.
    pub size_m: f64,
    /// Centre of the black square, metres.
    pub center_m: DVec3,
    /// Rotation from lying upright on the board's plane, about x, then y, then z, degrees.
    pub rotation_deg: DVec3,
}

impl Tag {
    /// Corners of the black square in the world, metres, in the printed order: top left, top right,
    /// bottom right, bottom left.
    pub fn corners_m(&self) -> [DVec3; 4] {
        let [x, y, z] = self.rotation_deg.to_array().map(f64::to_radians);
        let turn = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        let corner = |x: f64, y: f64| self.center_m + turn * (0.5 * self.size_m * DVec3::new(x, y, 0.0));
        [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]
    }
}

/// Reason why a board is refused.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    #[error("{}: cannot be read: {}", file.display(), reason(source))]
    Read { file: PathBuf, source: std::io::Error },
    #[error("{}: {problem}", file.display())]
    Content { file: PathBuf, problem: String },
}

/// Accepted sizes and distances, metres; others are wrong units.
const SIZES_M: std::ops::RangeInclusive<f64> = 0.001..=10.0;
const MAX_DISTANCE_M: f64 = 1000.0;
/// Accepted scales. Printers that fit a page to the paper change its size by some percent.
const SCALES: std::ops::RangeInclusive<f64> = 0.1..=10.0;
/// Largest number of tags, that of the largest family. Tags are looked up linearly.
const MAX_TAGS: usize = 1000;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoardFile {
    version: u32,
    family: String,
    /// Ratio of the printed to the stated size.
    #[serde(default = "one")]
    scale: f64,
    tags: Vec<toml::Spanned<TagEntry>>,
}

fn one() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TagEntry {
    id: toml::Spanned<u32>,
    size_m: f64,
    /// Two numbers are a point on the board's plane.
    center_m: Vec<f64>,
    #[serde(default)]
    rotation_deg: [f64; 3],
}

impl Board {
    pub fn read(path: &Path) -> Result<Self, BoardError> {
        let text = file::read_text(path, MAX_DOCUMENT_BYTES)
            .map_err(|source| BoardError::Read { file: path.to_owned(), source })?;
        Self::parse(&text).map_err(|problem| BoardError::Content { file: path.to_owned(), problem })
    }

    /// The tags of a ChArUco board of OpenCV: a chessboard whose upper left square is black, with
    /// tags in its white squares, numbered row by row. `squares` are columns and rows. The origin
    /// is the middle of the board, x to the right, y up, as it is printed. If `is_legacy`, it is
    /// one of before OpenCV 4.6, whose upper left square is white if its number of rows is even.
    pub fn charuco(
        family: Family,
        squares: [u32; 2],
        square_m: f64,
        tag_m: f64,
        is_legacy: bool,
    ) -> Result<Self, String> {
        let [columns, rows] = squares;
        if columns < 2 || rows < 2 || u64::from(columns) * u64::from(rows) > 2 * MAX_TAGS as u64 {
            return Err(format!(
                "a board of {columns}x{rows} squares; expected at least 2x2, and {MAX_TAGS} tags at most"
            ));
        }
        if !(tag_m < square_m && SIZES_M.contains(&tag_m) && SIZES_M.contains(&square_m)) {
            return Err(format!(
                "tags of {} mm in squares of {} mm; expected 1 mm to 10 m, and a tag smaller than its square",
                number(1e3 * tag_m),
                number(1e3 * square_m)
            ));
        }
        let white = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let white_parity = u32::from(!(is_legacy && rows.is_multiple_of(2)));
        let white = white.filter(|(column, row)| (column + row) % 2 == white_parity);
        let middle = |count: u32| 0.5 * f64::from(count - 1);
        let tags: Vec<Tag> = (0..)
            .zip(white)
            .map(|(id, (column, row))| Tag {
                id,
                size_m: tag_m,
                center_m: square_m
                    * DVec3::new(f64::from(column) - middle(columns), middle(rows) - f64::from(row), 0.0),
                rotation_deg: DVec3::ZERO,
            })
            .collect();
        if tags.len() > family.count() as usize {
            return Err(format!("it has {} tags, and family {} {}", tags.len(), family.name(), family.count()));
        }
        Ok(Self { family, tags })
    }

    /// Parses a board. The error names line and key.
    pub fn parse(text: &str) -> Result<Self, String> {
        let written: BoardFile = document::read(text).map_err(|problem| problem.to_string())?;
        if written.version != 1 {
            return Err(format!("version = {} is not known; expected 1", written.version));
        }
        let family = Family::of_name(&written.family).ok_or_else(|| {
            let families = Family::names().join(", ");
            format!("family = \"{}\" is not known; expected {families}", quoted(&written.family))
        })?;
        if written.tags.is_empty() || written.tags.len() > MAX_TAGS {
            return Err(format!(
                "there are {} tags; expected 1 to {MAX_TAGS}, each a table [[tags]]",
                written.tags.len()
            ));
        }
        if !SCALES.contains(&written.scale) {
            let scale = number(written.scale);
            return Err(format!(
                "scale = {scale}: expected 0.1 to 10, the ruler's measured length divided by its nominal \
                 length"
            ));
        }
        let mut tags: Vec<Tag> = Vec::new();
        for tag in &written.tags {
            let line = |at: usize| 1 + text.get(..at).unwrap_or(text).matches('\n').count();
            let at = line(tag.get_ref().id.span().start);
            let tag = checked(tag.get_ref(), family).map_err(|problem| format!("line {at}, {problem}"))?;
            if tags.iter().any(|other| other.id == tag.id) {
                return Err(format!("line {at}, tags.id: {} occurs twice; each tag is in one place", tag.id));
            }
            tags.push(Tag { size_m: written.scale * tag.size_m, center_m: written.scale * tag.center_m, ..tag });
        }
        Ok(Self { family, tags })
    }

    pub fn tag(&self, id: u32) -> Option<&Tag> {
        self.tags.iter().find(|tag| tag.id == id)
    }
}

fn checked(tag: &TagEntry, family: Family) -> Result<Tag, String> {
    let id = *tag.id.get_ref();
    let named = |key: &str, problem: String| format!("tags.{key} of tag {id}: {problem}");
    if id >= family.count() {
        return Err(named("id", format!("family {} has the ids 0 to {}", family.name(), family.count() - 1)));
    }
    if !SIZES_M.contains(&tag.size_m) {
        let size_m = number(tag.size_m);
        return Err(named("size_m", format!("{size_m}: expected the black square's side, 0.001 to 10 metres")));
    }
    let center_m = match tag.center_m[..] {
        [x, y] => DVec3::new(x, y, 0.0),
        [x, y, z] => DVec3::new(x, y, z),
        _ => {
            return Err(named(
                "center_m",
                "expected two numbers on the board's plane, or three in space, metres".to_owned(),
            ));
        }
    };
    // NaN is refused too.
    if !(center_m.abs().max_element() <= MAX_DISTANCE_M && center_m.is_finite()) {
        return Err(named("center_m", "expected numbers from -1000 to 1000 metres".to_owned()));
    }
    let rotation_deg = DVec3::from_array(tag.rotation_deg);
    if !(rotation_deg.is_finite() && rotation_deg.abs().max_element() <= 360.0) {
        return Err(named("rotation_deg", "expected numbers from -360 to 360 degrees".to_owned()));
    }
    Ok(Tag { id, size_m: tag.size_m, center_m, rotation_deg })
}

/// The text that [`Board::parse`] reads.
impl fmt::Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "# Metres; z out of the board, x to its right, y to its top. The origin of a ChArUco board is its middle,"
        )?;
        writeln!(
            f,
            "# on the sheet of `locard board` the small cross in the middle of the tags, not the middle of the paper."
        )?;
        writeln!(f, "# size_m is the side of a tag's black square, center_m its middle. If the print is larger or")?;
        writeln!(f, "# smaller: scale = measured length / nominal length.")?;
        writeln!(f, "version = 1\nfamily = \"{}\"", self.family.name())?;
        for tag in &self.tags {
            let row = |v: DVec3| v.to_array().map(number).join(", ");
            write!(
                f,
                "\n[[tags]]\nid = {}\nsize_m = {}\ncenter_m = [{}]\n",
                tag.id,
                number(tag.size_m),
                row(tag.center_m)
            )?;
            if tag.rotation_deg != DVec3::ZERO {
                writeln!(f, "rotation_deg = [{}]", row(tag.rotation_deg))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ONE: &str = "version = 1\nfamily = \"36h11\"\n[[tags]]\nid = 7\nsize_m = 0.1\ncenter_m = [1.0, 2.0]\n";

    #[test]
    fn tag_corners_match_computed_values() {
        let lying = Board::parse(ONE).unwrap();
        let [a, b, c, d] = lying.tag(7).unwrap().corners_m();
        assert!(a.distance(DVec3::new(0.95, 2.05, 0.0)) < 1e-12 && b.distance(DVec3::new(1.05, 2.05, 0.0)) < 1e-12);
        assert!(c.distance(DVec3::new(1.05, 1.95, 0.0)) < 1e-12 && d.distance(DVec3::new(0.95, 1.95, 0.0)) < 1e-12);
        // On a wall: tilted up about x, then turned by 90° about z, so that it faces +x and its
        // right is +y.
        let wall = ONE.replace("[1.0, 2.0]", "[0, 0, 1]\nrotation_deg = [90, 0, 90]");
        let [a, b, ..] = Board::parse(&wall).unwrap().tags[0].corners_m();
        assert!(a.distance(DVec3::new(0.0, -0.05, 1.05)) < 1e-12 && b.distance(DVec3::new(0.0, 0.05, 1.05)) < 1e-12);
    }

    /// OpenCV: CharucoBoard((3, 4), 0.04, 0.03), whose objPoints are from the upper left corner, y
    /// down.
    #[test]
    fn charuco_board_has_its_tags_in_the_white_squares() {
        let family = Family::of_name("4x4_50").unwrap();
        let board = Board::charuco(family, [3, 4], 0.04, 0.03, false).unwrap();
        // Its first tag is in the upper left square.
        let legacy = Board::charuco(family, [3, 4], 0.04, 0.03, true).unwrap();
        assert!((legacy.tags[0].center_m - DVec3::new(-0.04, 0.06, 0.0)).length() < 1e-12);
        let [odd, legacy_odd] = [false, true].map(|legacy| Board::charuco(family, [4, 3], 0.04, 0.03, legacy).unwrap());
        assert_eq!(odd, legacy_odd);
        let centers: Vec<[f64; 2]> = board.tags.iter().map(|tag| [tag.center_m.x, tag.center_m.y]).collect();
        let expected = [[1, 0], [0, 1], [2, 1], [1, 2], [0, 3], [2, 3]].map(|[column, row]: [i32; 2]| {
            [0.04 * f64::from(column) + 0.02 - 0.06, 0.08 - (0.04 * f64::from(row) + 0.02)]
        });
        assert_eq!(centers.len(), expected.len());
        for (center, expected) in centers.iter().zip(expected) {
            assert!((center[0] - expected[0]).abs() + (center[1] - expected[1]).abs() < 1e-12, "{centers:?}");
        }
        assert_eq!(Board::parse(&board.to_string()).unwrap(), board);
        for (squares, tag_m, problem) in [
            ([1, 4], 0.03, "expected at least 2x2"),
            ([3, 4], 0.05, "smaller than its square"),
            ([12, 12], 0.03, "72 tags"),
        ] {
            let error = Board::charuco(family, squares, 0.04, tag_m, false).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
    }

    #[test]
    fn errors_name_line_and_key() {
        for (from, to, message) in [
            ("version = 1", "version = 2", "version = 2 is not known"),
            ("36h11", "36h12", "family = \"36h12\" is not known; expected 36h11, 25h9, 16h5, 4x4_50"),
            ("id = 7", "id = 587", "line 4, tags.id of tag 587: family 36h11 has the ids 0 to 586"),
            ("id = 7", "id = -1", "line 4, tags.id: "),
            ("size_m = 0.1", "size_m = 100", "line 4, tags.size_m of tag 7: 100: expected"),
            ("size_m = 0.1", "size_m = nan", "line 4, tags.size_m of tag 7: NaN"),
            ("size_m = 0.1", "size = 0.1", "line 5, tags.size: unknown field `size`"),
            ("[1.0, 2.0]", "[1.0]", "line 4, tags.center_m of tag 7: expected two numbers"),
            ("[1.0, 2.0]", "[1.0, inf]", "line 4, tags.center_m of tag 7: expected numbers"),
            ("[1.0, 2.0]", "[1, 2]\nrotation_deg = [0, 0, 720]", "line 4, tags.rotation_deg of tag 7"),
            (
                "[[tags]]",
                "[[tags]]\nid = 7\nsize_m = 0.2\ncenter_m = [0, 0]\n[[tags]]",
                "line 8, tags.id: 7 occurs twice",
            ),
        ] {
            let error = Board::parse(&ONE.replace(from, to)).unwrap_err();
            assert!(error.starts_with(message) && !error.contains('\n'), "{error}");
        }
        let scaled = Board::parse(&ONE.replace("[[tags]]", "scale = 0.5\n[[tags]]")).unwrap();
        assert_eq!((scaled.tags[0].size_m, scaled.tags[0].center_m), (0.05, DVec3::new(0.5, 1.0, 0.0)));
        assert!(
            Board::parse(&ONE.replace("[[tags]]", "scale = 0\n[[tags]]"))
                .unwrap_err()
                .starts_with("scale = 0: expected")
        );
        assert!(Board::parse("version = 1\nfamily = \"36h11\"\ntags = []").unwrap_err().contains("there are 0 tags"));
        let error = Board::read(Path::new("no/board.toml")).unwrap_err().to_string();
        assert!(error.starts_with("no/board.toml: cannot be read"), "{error}");
    }

    proptest! {
        #[test]
        fn board_round_trips(
            places in prop::collection::vec((1e-3f64..10.0, prop::array::uniform3(-1e3f64..1e3), prop::array::uniform3(-360.0f64..360.0)), 1..9)
        ) {
            let tags = places.into_iter().zip(3..);
            let tags = tags.map(|((size_m, center, turn), id)| Tag { id, size_m, center_m: center.into(), rotation_deg: turn.into() });
            let board = Board { family: Family::Tag16h5, tags: tags.collect() };
            prop_assert_eq!(Board::parse(&board.to_string()).unwrap(), board);
        }

        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "version = 1\nfamily = \"16h5\"\n\\[\\[tags\\]\\]\n([a-z_]{2,9} = [-0-9.\\[\\], ]{0,9}\n){0,4}") {
            let _ = Board::parse(&text);
            let _ = Board::parse(&near);
        }
    }
}
