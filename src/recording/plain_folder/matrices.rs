//! Matrices in text files: camera matrices and poses. Numbers are separated by blanks, commas,
//! semicolons or brackets.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::recording::rigid::{NOT_RIGID, is_lost, rigid};
use crate::text::quoted;
use crate::tracking::records::{self, TextError};

/// Rotation and translation as written.
pub type PoseMatrix = (DMat3, DVec3);

/// A pose of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseLine {
    /// `None`: lost, not finite or without a rotation.
    pub matrix: Option<PoseMatrix>,
    /// Line or file, for messages.
    pub place: String,
}

/// The numbers of a line, also non-finite ones.
fn numbers(record: &str) -> Result<Vec<f64>, String> {
    let words = record.split(|c: char| c.is_whitespace() || matches!(c, ',' | ';' | '[' | ']'));
    let number = |word: &str| word.parse().map_err(|_| format!("holds `{}`; numbers are expected", quoted(word)));
    words.filter(|word| !word.is_empty()).map(number).collect()
}

/// The numbers of each line.
fn rows(text: &str, file: &Path) -> Result<Vec<(usize, Vec<f64>)>, TextError> {
    let row = |(line, record)| match numbers(record) {
        Ok(row) => Ok((line, row)),
        Err(problem) => Err(TextError::line(file, line, problem)),
    };
    records::records(text).map(row).filter(|row| !matches!(row, Ok((_, row)) if row.is_empty())).collect()
}

/// Accepted forms of a camera matrix.
const CAMERA_FORMS: &str =
    "expected a 3×3 camera matrix with the rows fx 0 cx, 0 fy cy, 0 0 1, or the four numbers fx fy cx cy";

/// fx, fy, cx, cy as written.
pub fn parse_camera(text: &str, file: &Path) -> Result<[f64; 4], TextError> {
    let rows = rows(text, file)?;
    let first = rows.first().map_or(1, |(line, _)| *line);
    let refuse = |problem: String| TextError::line(file, first, format!("{problem}; {CAMERA_FORMS}"));
    let values: Vec<f64> = rows.iter().flat_map(|(_, row)| row.iter().copied()).collect();
    if let Some(value) = values.iter().find(|value| !value.is_finite()) {
        return Err(refuse(format!("holds {value}")));
    }
    let [fx, skew, cx, below, fy, cy, last @ ..] = match *values.as_slice() {
        [fx, fy, cx, cy] => return Ok([fx, fy, cx, cy]),
        [a, b, c, d, e, f, g, h, i] => [a, b, c, d, e, f, g, h, i],
        // With a fourth column, and a fourth row, of zeros and a one.
        [a, b, c, _, d, e, f, _, g, h, i, _] | [a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _] => {
            [a, b, c, d, e, f, g, h, i]
        }
        _ => return Err(refuse(format!("holds {} numbers", values.len()))),
    };
    if last != [0.0, 0.0, 1.0] || below != 0.0 {
        return Err(refuse("is not a camera matrix".to_owned()));
    }
    if skew != 0.0 {
        return Err(refuse(format!("has the skew {skew}, which is not supported")));
    }
    Ok([fx, fy, cx, cy])
}

/// Poses of 12 or 16 numbers a line, or of four lines of four.
pub fn parse_pose_list(text: &str, file: &Path) -> Result<Vec<PoseLine>, TextError> {
    let rows = rows(text, file)?;
    let is_block = !rows.is_empty() && rows.iter().all(|(_, row)| row.len() == 4);
    let poses: Vec<(usize, Vec<f64>)> = if is_block {
        if rows.len() % 4 != 0 {
            let line = rows.last().map_or(1, |(line, _)| *line);
            let problem = format!("is the last of {} lines of four numbers; a pose has four such lines", rows.len());
            return Err(TextError::line(file, line, problem));
        }
        let block = |block: &[(usize, Vec<f64>)]| {
            let values = block.iter().flat_map(|(_, row)| row.iter().copied()).collect();
            (block.first().map_or(1, |(line, _)| *line), values)
        };
        rows.chunks(4).map(block).collect()
    } else {
        rows
    };
    let line = |(line, values): (usize, Vec<f64>)| {
        let matrix = matrix(&values).map_err(|problem| TextError::line(file, line, problem))?;
        Ok(PoseLine { matrix, place: format!("line {line}") })
    };
    poses.into_iter().map(line).collect()
}

/// A file with one pose, in lines of any length. An empty file is a lost pose.
pub fn parse_pose_file(text: &str, file: &Path) -> Result<PoseLine, TextError> {
    let rows = rows(text, file)?;
    let values: Vec<f64> = rows.iter().flat_map(|(_, row)| row.iter().copied()).collect();
    let first = rows.first().map_or(1, |(line, _)| *line);
    let place = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if values.is_empty() {
        return Ok(PoseLine { matrix: None, place });
    }
    let matrix = matrix(&values).map_err(|problem| TextError::line(file, first, problem))?;
    Ok(PoseLine { matrix, place })
}

/// A 3×4 or 4×4 matrix, row by row. `None` if the pose is lost.
fn matrix(values: &[f64]) -> Result<Option<PoseMatrix>, String> {
    let (upper, last) = match values.len() {
        12 => (values, None),
        16 => (&values[..12], Some(&values[12..])),
        8 => {
            return Err("holds 8 numbers, as a TUM trajectory does; expected 12 or 16 (name a trajectory in a \
                        recording.toml)"
                .to_owned());
        }
        other => return Err(format!("holds {other} numbers; a pose is a matrix of 12 or 16, row by row")),
    };
    let mut rows = [[0.0; 4]; 3];
    rows.iter_mut().flatten().zip(upper).for_each(|(entry, value)| *entry = *value);
    if is_lost(&rows) {
        return Ok(None);
    }
    if last.is_some_and(|last| last != [0.0, 0.0, 0.0, 1.0]) {
        return Err("the last row of the pose must be 0 0 0 1 (is it stored column by column?)".to_owned());
    }
    rigid(rows).map(Some).ok_or_else(|| format!("the pose {NOT_RIGID}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const IDENTITY_12: &str = "1 0 0 1 0 1 0 2 0 0 1 3";

    fn list(text: &str) -> Result<Vec<PoseLine>, String> {
        parse_pose_list(text, Path::new("poses.txt")).map_err(|e| e.to_string())
    }

    #[test]
    fn all_forms_of_a_pose_are_equal() {
        let expected = Some((DMat3::IDENTITY, DVec3::new(1.0, 2.0, 3.0)));
        let sixteen = format!("{IDENTITY_12} 0 0 0 1");
        let block = "[[1, 0, 0, 1],\n [0, 1, 0, 2],\n [0, 0, 1, 3],\n [0, 0, 0, 1]]\n";
        for text in [IDENTITY_12, &sixteen, block] {
            let read = list(&format!("# c\n{text}\n\n{text}\n")).unwrap();
            assert!(read.len() == 2 && read.iter().all(|pose| pose.matrix == expected), "{text}");
            assert_eq!(parse_pose_file(text, Path::new("pose/1.txt")).unwrap().matrix, expected);
        }
        assert_eq!(list(&format!("{IDENTITY_12}\n{}", IDENTITY_12.replace('1', "-inf"))).unwrap()[1].matrix, None);
        assert_eq!(
            parse_pose_file("\n", Path::new("pose/1.txt")).unwrap(),
            PoseLine { matrix: None, place: "1.txt".into() }
        );
    }

    #[test]
    fn all_forms_of_a_camera_matrix_are_equal() {
        let read = |text: &str| parse_camera(text, Path::new("K.txt")).map_err(|e| e.to_string());
        for text in [
            "500 501 320 240",
            "500 0 320\n0 501 240\n0 0 1",
            "[[500, 0, 320, 0], [0, 501, 240, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "500 0 320 0 0 501 240 0 0 0 1 0",
        ] {
            assert_eq!(read(text).unwrap(), [500.0, 501.0, 320.0, 240.0], "{text}");
        }
        for (text, expected) in [
            ("", "K.txt, line 1: holds 0 numbers; expected a 3×3"),
            ("# c\n500 0 320\n0 501 240\n0 0", "K.txt, line 2: holds 8 numbers; expected a 3×3"),
            ("500 0 320\n0 501 240\n0 0 2", "K.txt, line 1: is not a camera matrix"),
            ("500 1 320\n0 501 240\n0 0 1", "K.txt, line 1: has the skew 1"),
            ("500 nan 320\n0 501 240\n0 0 1", "K.txt, line 1: holds NaN; expected"),
            ("500 x 320", "K.txt, line 1: holds `x`; numbers are expected"),
        ] {
            assert!(read(text).unwrap_err().starts_with(expected), "{}", read(text).unwrap_err());
        }
    }

    #[test]
    fn refusals_name_file_and_line() {
        for (text, expected) in [
            ("1 2 3", "poses.txt, line 1: holds 3 numbers; a pose is a matrix of 12 or 16"),
            ("\n0 1 2 3 0 0 0 1", "poses.txt, line 2: holds 8 numbers, as a TUM trajectory"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1", "poses.txt, line 1: the last row of the pose must be 0 0 0 1"),
            ("2 0 0 0 0 1 0 0 0 0 1 0", "poses.txt, line 1: the pose is not a rotation"),
            ("1 0 0 0\n0 1 0 0", "poses.txt, line 2: is the last of 2 lines of four numbers"),
            ("1 0 0 y 0 1 0 0 0 0 1 0", "poses.txt, line 1: holds `y`; numbers are expected"),
        ] {
            let error = list(text).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{1,4}[ ,\n]){0,40}") {
            for text in [&text, &near] {
                let _ = (list(text), parse_camera(text, Path::new("K")), parse_pose_file(text, Path::new("p")));
            }
        }
    }
}
