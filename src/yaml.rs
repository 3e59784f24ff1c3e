//! A subset of YAML, as calibrations of cameras have it: `key: value`, keys nested by indentation,
//! lists of numbers in brackets, also over several lines, or by dashes. A full parser rejects the
//! header `%YAML:1.0` that OpenCV writes. Everything else is skipped.

use std::collections::BTreeMap;

/// Keys with their lines, from 1, and values. A nested key has its parents' names before it, as in
/// `T_BS.data`. A list by dashes has the form of one in brackets.
pub type YamlKeys = BTreeMap<String, (usize, String)>;

/// Parses a text. Of equal keys the last counts.
pub fn parse(text: &str) -> YamlKeys {
    let mut keys = YamlKeys::new();
    // The key of each level above, with its indentation.
    let mut parents: Vec<(usize, String)> = Vec::new();
    let mut last: Option<String> = None;
    // Brackets of the last value that are not closed.
    let mut open_brackets = 0;
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.split_once(" #").map_or(line, |(before, _)| before);
        let bare = line.trim();
        if bare.is_empty() || bare.starts_with(['#', '%']) || matches!(bare, "---" | "...") {
            continue;
        }
        let value = last.as_ref().and_then(|key| keys.get_mut(key)).map(|entry| &mut entry.1);
        match value {
            // A list continues until its brackets close.
            Some(value) if open_brackets > 0 => {
                *value += bare;
                open_brackets += unclosed(bare);
            }
            Some(value) if bare.starts_with("- ") || bare == "-" => {
                add_item(value, bare.trim_start_matches('-').trim())
            }
            _ => {
                let Some((key, value)) = bare.split_once(':') else { continue };
                let indentation = line.len() - line.trim_start().len();
                while parents.last().is_some_and(|(above, _)| *above >= indentation) {
                    parents.pop();
                }
                let key = match parents.last() {
                    Some((_, parent)) => format!("{parent}.{}", key.trim()),
                    None => key.trim().to_owned(),
                };
                parents.push((indentation, key.clone()));
                let value = value.trim();
                open_brackets = if value.starts_with('[') { unclosed(value) } else { 0 };
                keys.insert(key.clone(), (i + 1, value.to_owned()));
                last = Some(key);
            }
        }
    }
    keys
}

/// Opening brackets less closing ones.
fn unclosed(text: &str) -> i64 {
    text.bytes().map(|byte| i64::from(byte == b'[') - i64::from(byte == b']')).sum()
}

/// Adds an item by a dash to a list.
fn add_item(list: &mut String, item: &str) {
    if list.ends_with(']') {
        list.pop();
        list.push_str(", ");
    } else {
        *list = "[".to_owned();
    }
    list.push_str(item);
    list.push(']');
}

/// The finite numbers of a list, or a single number. `None` if the value has anything else.
pub fn numbers(value: &str) -> Option<Vec<f64>> {
    let finite = |part: &str| part.trim().parse().ok().filter(|number: &f64| number.is_finite());
    let bare = value.trim().trim_start_matches('[').trim_end_matches(']').trim();
    // An empty list.
    if bare.is_empty() && value.contains('[') {
        return Some(Vec::new());
    }
    bare.trim_end_matches(',').split(',').map(finite).collect()
}

/// A value without quotation marks.
pub fn word(value: &str) -> &str {
    value.trim().trim_matches(['"', '\''])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn value<'a>(keys: &'a YamlKeys, key: &str) -> (usize, &'a str) {
        keys.get(key).map(|(line, value)| (*line, value.as_str())).unwrap()
    }

    #[test]
    fn nested_keys_and_both_forms_of_lists_are_read() {
        let text = "%YAML:1.0\n---\na: 1 # one\nm: !!opencv-matrix\n   rows: 3\n   data: [ 1., 2.,\n       3. ]\n\
                    d:\n- 0.5\n- -1\ncam0:\n  T:\n  - [1, 2]\n  - [3, 4]\n  k: 'x'\nb: \"cam: grey\"\n";
        let keys = parse(text);
        assert_eq!((value(&keys, "a"), value(&keys, "m.rows")), ((3, "1"), (5, "3")));
        assert_eq!(numbers(value(&keys, "m.data").1), Some(vec![1.0, 2.0, 3.0]));
        assert_eq!((value(&keys, "d"), value(&keys, "cam0.T")), ((8, "[0.5, -1]"), (12, "[[1, 2], [3, 4]]")));
        assert_eq!((word(value(&keys, "cam0.k").1), word(value(&keys, "b").1)), ("x", "cam: grey"));
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(numbers("[1, 2.5e0]"), Some(vec![1.0, 2.5]));
        assert_eq!(
            (numbers("4"), numbers("[]"), numbers("[1, 2, ]")),
            (Some(vec![4.0]), Some(vec![]), Some(vec![1.0, 2.0]))
        );
        assert_eq!((numbers("[1, nan]"), numbers("[x]"), numbers("")), (None, None, None));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-a:#\\[\\] ,0-9]{0,6}\n){0,20}") {
            for text in [text, near] {
                parse(&text).values().for_each(|(_, value)| drop(numbers(value)));
            }
        }
    }
}
