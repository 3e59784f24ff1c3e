//! XML files of photogrammetry programs. Document type declarations are refused, and with them all
//! entities but XML's own.

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use super::RecordingError;
use crate::text::quoted;
use crate::tracking::records::TextError;

/// Maximum number of nodes of a document, far above that of a hundred thousand cameras.
const MAX_NODES: u32 = 4_000_000;

/// Parses a document; `file` is named in errors.
pub fn parse<'a>(text: &'a str, file: &Path) -> Result<Document<'a>, TextError> {
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text.trim_start_matches('\u{feff}'), options).map_err(|error| {
        let problem =
            format!("is damaged or cut off: not well-formed XML ({}); export it again", quoted(&error.to_string()));
        TextError::line(file, error.pos().row as usize, problem)
    })
}

/// The offsets at which the lines of a text end. Lines of nodes that are looked up one by one take
/// a pass over the text each.
#[derive(Debug)]
pub struct LineIndex(Vec<usize>);

impl LineIndex {
    pub fn new(text: &str) -> Self {
        Self(text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(offset, _)| offset).collect())
    }

    /// The line of an offset, from 1.
    pub fn line_at(&self, offset: usize) -> usize {
        1 + self.0.partition_point(|end| *end < offset)
    }
}

/// The line of a node, from 1.
pub fn line(node: Node<'_, '_>) -> usize {
    node.document().text_pos_at(node.range().start).row as usize
}

/// An error at the line of a node.
pub fn error_at(node: Node<'_, '_>, file: &Path, problem: impl std::fmt::Display) -> RecordingError {
    TextError::line(file, line(node), problem).into()
}

/// The first child element of a name, in any namespace.
pub fn child<'a, 'b>(node: Node<'a, 'b>, name: &str) -> Option<Node<'a, 'b>> {
    node.children().find(|child| child.is_element() && child.tag_name().name() == name)
}

/// `N` numbers that are separated by whitespace, also non-finite ones.
pub fn numbers<const N: usize>(text: &str, name: &str) -> Result<[f64; N], String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let expected = || if N == 1 { "a number".to_owned() } else { format!("{N} numbers") };
    if words.len() != N {
        let actual = if words.len() == 1 { quoted(words[0]) } else { words.len().to_string() };
        return Err(format!("{name} holds {actual}; expected {}", expected()));
    }
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value = word.parse().map_err(|_| format!("{name} holds `{}`; expected {}", quoted(word), expected()))?;
    }
    Ok(values)
}

/// Like [`numbers`], all of them finite.
pub fn finite_numbers<const N: usize>(text: &str, name: &str) -> Result<[f64; N], String> {
    let values = numbers(text, name)?;
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(format!("{name} holds {value}; a finite number is needed")),
        None => Ok(values),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damaged_document_is_refused_with_its_line() {
        for text in ["", "<a>\n<b>\n</a>", "<a>\n<b", "<a b=\"1\" b=\"2\"/>", "<!DOCTYPE a><a/>", "plain"] {
            let error = parse(text, Path::new("c.xml")).unwrap_err().to_string();
            assert!(error.starts_with("c.xml, line ") && error.contains("export it again"), "{error}");
        }
        let error = parse("<a>\n<b>\n</a>", Path::new("c.xml")).unwrap_err().to_string();
        assert!(error.starts_with("c.xml, line 3: "), "{error}");
    }

    #[test]
    fn deeply_nested_document_does_not_overflow_the_stack() {
        let text = format!("{}{}", "<a>".repeat(200_000), "</a>".repeat(200_000));
        let document = parse(&text, Path::new("c.xml")).unwrap();
        assert_eq!(document.descendants().count(), 200_001);
    }

    #[test]
    fn numbers_are_counted_and_parsed() {
        assert_eq!(numbers::<3>(" 1\n2.5e0  nan", "v").map(|v| (v[0], v[1], v[2].is_nan())), Ok((1.0, 2.5, true)));
        for (text, expected) in [
            ("1 2", "v holds 2; expected 3 numbers"),
            ("1 2 x", "v holds `x`; expected 3 numbers"),
            ("", "v holds 0; expected 3 numbers"),
        ] {
            assert_eq!(numbers::<3>(text, "v"), Err(expected.to_owned()));
        }
        assert_eq!(finite_numbers::<1>("inf", "v"), Err("v holds inf; a finite number is needed".to_owned()));
    }
}
