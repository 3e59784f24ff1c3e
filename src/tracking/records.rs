//! Text files with one record per line, and errors that name file and line.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::source::file::{self, MAX_DOCUMENT_BYTES, MAX_LISTING_BYTES, MAX_TEXT_BYTES};
use crate::text::{quoted, reason};

/// A text file cannot be read or has invalid contents.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    #[error("{}: cannot be read: {}", file.display(), reason(source))]
    Read { file: PathBuf, source: std::io::Error },
    /// Lines count from 1.
    #[error("{}, line {line}: {problem}", file.display())]
    Line { file: PathBuf, line: usize, problem: String },
}

impl TextError {
    pub fn line(file: &Path, line: usize, problem: impl fmt::Display) -> Self {
        Self::Line { file: file.to_owned(), line, problem: problem.to_string() }
    }
}

/// Reads a plain UTF-8 file: a list or a trajectory.
pub fn read(file: &Path) -> Result<String, TextError> {
    read_limited(file, MAX_TEXT_BYTES)
}

/// Like [`read`], for a description of a recording.
pub fn read_description(file: &Path) -> Result<String, TextError> {
    read_limited(file, MAX_DOCUMENT_BYTES)
}

/// Like [`read`], for a description that lists the frames.
pub fn read_listing(file: &Path) -> Result<String, TextError> {
    read_limited(file, MAX_LISTING_BYTES)
}

fn read_limited(file: &Path, max_bytes: u64) -> Result<String, TextError> {
    file::read_text(file, max_bytes).map_err(|source| TextError::Read { file: file.to_owned(), source })
}

/// The lines with content, numbered from 1; blank lines and `#` comments are skipped.
pub fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    lines.map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Drops a last line without a line end, and returns its number from 1: its last number may be
/// truncated.
pub fn drop_unended(text: &mut String) -> Option<usize> {
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    let is_unended = whole < text.len();
    text.truncate(whole);
    is_unended.then(|| text.lines().count() + 1)
}

/// Takes the next word off the front of a line; empty at the end.
pub fn word<'a>(line: &mut &'a str) -> &'a str {
    let start = line.trim_start();
    let (word, rest) = start.split_at(start.find(char::is_whitespace).unwrap_or(start.len()));
    *line = rest;
    word
}

/// The next word of a line as a finite number. The error quotes the word.
pub fn number(line: &mut &str, name: &str) -> Result<f64, String> {
    let mut rest = *line;
    match pose_number(&mut rest, name)? {
        n if n.is_finite() => {
            *line = rest;
            Ok(n)
        }
        _ => Err(format!("{name} is `{}`; a finite number is needed", quoted(word(line)))),
    }
}

/// Like [`number`], but accepts NaN and infinity, which trackers write for the pose of a camera
/// that they have lost.
pub fn pose_number(line: &mut &str, name: &str) -> Result<f64, String> {
    match word(line) {
        "" => Err(format!("{name} is missing")),
        text => text.parse().map_err(|_| format!("{name} is `{}`; a finite number is needed", quoted(text))),
    }
}

/// Checks that a line has no more words.
pub fn end(line: &str) -> Result<(), String> {
    match line.trim() {
        "" => Ok(()),
        more => Err(format!("there is more than expected: `{}`", quoted(more))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_line_without_an_end_is_dropped() {
        for (text, whole, line) in
            [("", "", None), ("1\n2\n", "1\n2\n", None), ("1\n2", "1\n", Some(2)), ("1", "", Some(1))]
        {
            let mut left = text.to_owned();
            assert_eq!((drop_unended(&mut left), left.as_str()), (line, whole));
        }
    }
}
