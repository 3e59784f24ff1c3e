//! XYZ and PTS: text with a point on each line. The first three columns are the coordinates.
//!
//! Columns are separated by white space, commas or semicolons. Lines before the first point that
//! are not numbers are titles; comments begin with `#` or `//`. A single whole number is the count
//! of points of a scan that begins (PTS, Leica). There is no standard; neither a unit nor an up is
//! defined.

use glam::DVec3;

use super::geometry_builder::GeometryBuilder;
use super::input::{ScanReader, number};
use super::{ScanError, ScanGeometry};
use crate::text::quoted;

/// Most lines of titles.
const MAX_TITLE_LINES: usize = 100;

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let mut builder = GeometryBuilder::default();
    let mut line = Vec::new();
    let mut titles = 0;
    while input.next_line(&mut line)? {
        let text = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&line).trim_ascii();
        if text.is_empty() || text.starts_with(b"#") || text.starts_with(b"//") {
            continue;
        }
        if let Some(position) = position(text) {
            builder.push(position);
        } else if str::from_utf8(text).is_ok_and(|text| text.parse::<u64>().is_ok()) {
            // The count of a scan's points.
        } else if builder.len() == 0 && titles < MAX_TITLE_LINES {
            titles += 1;
        } else {
            let actual = quoted(&String::from_utf8_lossy(text));
            let problem = format!("found `{actual}`; expected `X Y Z`, numbers with a point before the decimals");
            return Err(input.line_error(problem));
        }
    }
    builder.finish(input.file)
}

/// The first three columns.
fn position(line: &[u8]) -> Option<DVec3> {
    // A comma separates columns only where nothing else does. Elsewhere it is a decimal comma,
    // which is refused.
    let is_semicolon = line.contains(&b';');
    let has_spaces = line.iter().any(u8::is_ascii_whitespace);
    let is_separator = |byte: &u8| match byte {
        b';' => true,
        b',' => !is_semicolon && !has_spaces,
        _ => byte.is_ascii_whitespace(),
    };
    let mut words = line.split(is_separator).filter(|word| !word.is_empty());
    // In "1.5, 2.5, 3.5" the comma ends a word.
    let mut coordinate = || words.next().and_then(|word| number(word.strip_suffix(b",").unwrap_or(word)));
    Some(DVec3::new(coordinate()?, coordinate()?, coordinate()?))
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{read_bytes, refusal};
    use glam::Vec3;

    #[test]
    fn columns_of_any_separator_are_read() {
        for line in
            ["1 -2.5 3e1", "1\t-2.5\t30 255 0 0", "1,-2.5,30,9", "1; -2.5; 30", "1, -2.5, 30, 7", " 1 -2.5 30\r"]
        {
            let file = format!("\u{feff}//X Y Z\n# comment\nX Y Z\n2\n{line}\n\n3\n0 nan 0\n0 0 1");
            let read = read_bytes("a.pts", file.as_bytes()).unwrap();
            assert_eq!(read.positions, [Vec3::new(1.0, -2.5, 30.0), Vec3::Z], "{line}");
            assert!(read.triangles.is_empty() && read.metres_per_unit.is_none() && read.up.is_none());
        }
    }

    #[test]
    fn other_text_is_refused_by_line() {
        for line in ["1 2", "1,5 2,5 3,5", "1,5;2,5;3,5", "a b c"] {
            let error = refusal("a.xyz", format!("0 0 0\n{line}\n").as_bytes());
            assert!(error.starts_with(&format!("a.xyz, line 2: found `{line}`; expected `X Y Z`")), "{error}");
        }
        assert!(refusal("a.txt", b"notes\nof a day\n").contains("it holds no points"));
    }
}
