//! TOML that people write: errors on one line, and edits that preserve the text.

use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml_edit::visit_mut::{VisitMut, visit_table_mut};
use toml_edit::{ArrayOfTables, DocumentMut, Formatted, Item, Table, TableLike, Value};

use crate::params::{self, Params};
use crate::text::{brief, quoted};

/// A problem with a text: its place, and the expected text. Displays as one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Problem {
    /// Starts at 1.
    pub line: Option<usize>,
    /// The key with its table, as in `frames.fps`. Empty if no key is to blame.
    pub key: String,
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.line.map(|line| format!("line {line}"));
        let key = Some(self.key.clone()).filter(|key| !key.is_empty());
        let place = line.into_iter().chain(key).collect::<Vec<_>>().join(", ");
        write!(f, "{place}{}{}", if place.is_empty() { "" } else { ": " }, self.message)
    }
}

impl Problem {
    fn of(text: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or_default();
        let (line, mut key) = place(text, span.start);
        let mut message = brief(&error.message().trim().replace('\n', "; "));
        if message.starts_with("expected ") {
            message = format!("{}: {message}", quoted(text.get(span.clone()).unwrap_or_default()));
        }
        // A field that is missing at the top belongs to no key.
        if message.starts_with("missing field") && span.is_empty() {
            key.clear();
        }
        if message == "missing field `version`" {
            message += "; add `version = 1`";
        }
        Self { line: error.span().map(|_| line), key, message }
    }
}

/// Parses a text as a `T`.
pub fn read<T: DeserializeOwned>(text: &str) -> Result<T, Problem> {
    toml::from_str(text).map_err(|error| Problem::of(text, &error))
}

/// The line (from 1) that a byte offset lies in, and the key it belongs to: the table above, and
/// the last name before `=`.
fn place(text: &str, at: usize) -> (usize, String) {
    let before = text.get(..at).unwrap_or(text);
    let line = 1 + before.matches('\n').count();
    let (mut table, mut key) = ("", "");
    for text in text.lines().take(line) {
        let bare = text.trim();
        match bare.strip_prefix('[').map(|header| header.trim_start_matches('[')) {
            // The continuation line of an array may also begin with a bracket.
            Some(header) if header.starts_with(|c: char| c.is_alphabetic() || c == '"') => {
                (table, key) = (header.split(']').next().unwrap_or_default().trim(), "");
            }
            _ if bare.starts_with('#') => {}
            _ => key = bare.split_once('=').map_or(key, |(name, _)| name.trim()),
        }
    }
    let parts = [table, key].into_iter().filter(|part| !part.is_empty());
    (line, parts.collect::<Vec<_>>().join("."))
}

/// A value and the text it was read from. A changed value changes the text only where it must:
/// comments, order and unknown keys stay.
#[derive(Clone, Debug)]
pub struct TomlDocument<T> {
    text: DocumentMut,
    value: T,
}

impl<T: PartialEq + Serialize + DeserializeOwned> TomlDocument<T> {
    /// Writes a new text for a value. Fails if TOML cannot express it.
    pub fn new(value: T) -> Result<Self, Problem> {
        Ok(Self { text: text_of(&value)?, value })
    }

    pub fn parse(text: &str) -> Result<Self, Problem> {
        let value = read(text)?;
        Ok(Self { text: edited(text)?, value })
    }

    pub fn value(&self) -> &T {
        &self.value
    }

    /// Replaces the value. On an error nothing changes.
    pub fn set(&mut self, value: T) -> Result<(), Problem> {
        let mut text = self.text.clone();
        merge(text.as_table_mut(), Some(text_of(&self.value)?.as_table()), text_of(&value)?.as_table());
        if read::<T>(&text.to_string())? != value {
            let message = "the text cannot be edited to hold these values; write it anew".to_owned();
            return Err(Problem { line: None, key: String::new(), message });
        }
        (self.text, self.value) = (text, value);
        Ok(())
    }
}

impl<T> fmt::Display for TomlDocument<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text.fmt(f)
    }
}

/// Parses a text for editing.
pub fn edited(text: &str) -> Result<DocumentMut, Problem> {
    // toml_edit's own messages always include the surrounding lines.
    let _: toml::Table = read(text)?;
    text.parse().map_err(|_| Problem { line: None, key: String::new(), message: "is no TOML".to_owned() })
}

fn text_of(value: &impl Serialize) -> Result<DocumentMut, Problem> {
    let failed = |error: toml::ser::Error| Problem { line: None, key: String::new(), message: error.to_string() };
    let mut text = edited(&toml::to_string(value).map_err(failed)?)?;
    Shortest.visit_document_mut(&mut text);
    Ok(text)
}

/// Writes numbers in the shortest form that reads back to the same bits: 1e300, not 301 digits.
struct Shortest;

impl VisitMut for Shortest {
    fn visit_float_mut(&mut self, node: &mut Formatted<f64>) {
        let decor = node.decor().clone();
        *node = float(*node.value());
        *node.decor_mut() = decor;
    }

    fn visit_table_mut(&mut self, node: &mut Table) {
        // Its position is decided by the text it is merged into.
        node.set_position(None);
        visit_table_mut(self, node);
    }
}

/// Rust's shortest form is valid TOML, with an exponent where there would be many zeros.
fn float(number: f64) -> Formatted<f64> {
    match format!("{number:?}").parse() {
        Ok(Value::Float(float)) => float,
        _ => Formatted::new(number),
    }
}

/// A number as a TOML float.
pub fn number(number: f64) -> Value {
    Value::Float(float(number))
}

/// Numbers as an array of floats.
pub fn numbers(values: impl IntoIterator<Item = f64>) -> Value {
    Value::Array(values.into_iter().map(number).collect())
}

/// A table of parameters, without those that have no value.
pub fn table_of(params: &dyn Params) -> Table {
    let mut table = Table::new();
    for spec in params.specs() {
        let value = match (params.get(spec.name), &spec.kind) {
            (Some(params::Value::Number(n)), params::Kind::Integer { .. }) => Value::from(n as i64),
            (Some(params::Value::Number(n)), _) => number(n),
            (Some(params::Value::Bool(b)), _) => Value::from(b),
            (Some(params::Value::Text(text)), _) => Value::from(text),
            (Some(params::Value::None) | None, _) => continue,
        };
        table.insert(spec.name, Item::Value(value));
    }
    table
}

/// Edits `old` so that it has the values of `after`. `before` has its values so far. Keys of `old`
/// that are not in `before` stay. Without `before`, every key that `after` lacks is removed.
pub fn merge(old: &mut dyn TableLike, before: Option<&dyn TableLike>, after: &dyn TableLike) {
    let is_gone = |key: &str| !after.contains_key(key) && before.is_none_or(|before| before.contains_key(key));
    let gone: Vec<String> = old.iter().map(|(key, _)| key.to_owned()).filter(|key| is_gone(key)).collect();
    for key in gone {
        old.remove(&key);
    }
    for (key, item) in after.iter() {
        let before = before.and_then(|before| before.get(key));
        match old.get_mut(key) {
            Some(old) => merge_item(old, before, item),
            None => _ = old.insert(key, item.clone()),
        }
    }
}

/// An item's full text. A table's own text omits its subtables.
fn item_text(item: Item) -> String {
    DocumentMut::from(Table::from_iter([("item", item)])).to_string()
}

fn merge_item(old: &mut Item, before: Option<&Item>, after: &Item) {
    if before.is_some_and(|before| item_text(before.clone()) == item_text(after.clone())) {
        return;
    }
    if let (Some(old), Some(after)) = (old.as_array_of_tables_mut(), after.as_array_of_tables()) {
        return merge_tables(old, before.and_then(Item::as_array_of_tables), after);
    }
    if let (Some(old), Some(after)) = (old.as_table_like_mut(), after.as_table_like()) {
        return merge(old, before.and_then(Item::as_table_like), after);
    }
    match (old.as_value_mut(), after.clone().into_value()) {
        (Some(old), Ok(mut value)) => {
            *value.decor_mut() = old.decor().clone();
            *old = value;
        }
        _ => *old = after.clone(),
    }
}

/// Unchanged tables at both ends stay as they are, whatever was inserted or removed between them.
fn merge_tables(old: &mut ArrayOfTables, before: Option<&ArrayOfTables>, after: &ArrayOfTables) {
    let text =
        |tables: &ArrayOfTables| tables.iter().map(|table| item_text(Item::Table(table.clone()))).collect::<Vec<_>>();
    let (was, is) = (before.map(text).unwrap_or_default(), text(after));
    if was.len() != old.len() {
        *old = after.clone();
        return;
    }
    let first = was.iter().zip(&is).take_while(|(a, b)| a == b).count();
    let same_last = was.iter().rev().zip(is.iter().rev()).take_while(|(a, b)| a == b).count();
    let last = same_last.min(was.len().min(is.len()) - first);
    let mut tables: Vec<Table> = old.iter().take(first).cloned().collect();
    for i in first..is.len() - last {
        let (before, after) = (before.and_then(|before| before.get(i)), after.get(i));
        let (kept, after) = (old.get(i).filter(|_| i < was.len() - last).cloned(), after.cloned().unwrap_or_default());
        tables.push(match kept {
            Some(mut kept) => {
                merge(&mut kept, before.map(|table| table as &dyn TableLike), &after);
                kept
            }
            None => after,
        });
    }
    tables.extend(old.iter().skip(was.len() - last).cloned());
    *old = tables.into_iter().collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde::Deserialize;

    #[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
    struct Thing {
        name: String,
        #[serde(skip_serializing_if = "Option::is_none")]
        at: Option<[f64; 3]>,
    }

    #[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
    struct Toy {
        version: u32,
        size: f64,
        #[serde(default)]
        things: Vec<Thing>,
    }

    const TEXT: &str = "# mine\nsize = 2.50 # m\nversion = 1\nowner = 'me'\n\n# the first\n[[things]]\nname = 'a' # A\n\n\
        # the second\n[[things]]\nat = [1, 2, 3]\nname = 'b'\ncolour = 'red'\n";

    #[test]
    fn edit_preserves_user_formatting() {
        let mut document = TomlDocument::<Toy>::parse(TEXT).unwrap();
        let mut site = document.value().clone();
        document.set(site.clone()).unwrap();
        assert_eq!(document.to_string(), TEXT);

        site.size = 3.0;
        site.things[1].at = Some([1.0, 2.0, 3.5]);
        document.set(site.clone()).unwrap();
        let expected = TEXT.replace("2.50", "3.0").replace("[1, 2, 3]", "[1.0, 2.0, 3.5]");
        assert_eq!(document.to_string(), expected);

        site.things[1].at = None;
        document.set(site.clone()).unwrap();
        assert_eq!(document.to_string(), expected.replace("at = [1.0, 2.0, 3.5]\n", ""));

        let first = site.things.remove(0);
        document.set(site.clone()).unwrap();
        let text = document.to_string();
        assert!(text.contains("# the second\n[[things]]\nname = 'b'\ncolour = 'red'") && !text.contains("the first"));

        site.things.push(first);
        document.set(site).unwrap();
        let text = document.to_string();
        assert!(
            text.ends_with("colour = 'red'\n\n[[things]]\nname = \"a\"\n") && text.contains("owner = 'me'"),
            "{text}"
        );
    }

    #[test]
    fn a_problem_names_line_and_key() {
        let problem = |text: &str| read::<Toy>(text).unwrap_err().to_string();
        let message = problem("version = 1\nsize = 1\n[[things]]\nname = 'a'\nat = [1,\n[2], 3]\n");
        assert!(message.starts_with("line 6, things.at: invalid type") && !message.contains('\n'), "{message}");
        assert!(
            problem("version = 1\nsize = = 2\n").starts_with("line 2, size: "),
            "{}",
            problem("version = 1\nsize = = 2\n")
        );
        assert!(problem("version = 1\n").contains("missing field `size`"));
    }

    #[test]
    fn large_and_small_numbers_have_exponents() {
        let text = TomlDocument::new(Toy { size: 1e300, ..Toy::default() }).unwrap().to_string();
        assert!(text.contains("size = 1e300\n"), "{text}");
        assert_eq!(number(0.1).to_string() + &number(-1e-7).to_string() + &number(3.0).to_string(), "0.1-1e-73.0");
    }

    fn things() -> impl Strategy<Value = Vec<Thing>> {
        let number = || prop_oneof![any::<f64>().prop_filter("finite", |n| n.is_finite()), -9.0..9.0f64];
        let thing = ("\\PC{0,5}", prop::option::of([number(), number(), number()]));
        prop::collection::vec(thing.prop_map(|(name, at)| Thing { name, at }), 0..5)
    }

    proptest! {
        #[test]
        fn written_document_reads_back(size in any::<f64>(), before in things(), after in things()) {
            prop_assume!(size.is_finite());
            let toy = |things| Toy { version: 1, size, things };
            let mut document = TomlDocument::new(toy(before)).unwrap();
            prop_assert_eq!(&read::<Toy>(&document.to_string()).unwrap(), document.value());
            document.set(toy(after.clone())).unwrap();
            let read = read::<Toy>(&document.to_string()).unwrap();
            prop_assert_eq!(read.size.to_bits(), size.to_bits());
            prop_assert_eq!(read.things, after);
        }

        #[test]
        fn no_text_panics(text in "[ -~\n]{0,60}") {
            let _ = TomlDocument::<Toy>::parse(&text);
            for at in 0..text.len() + 2 {
                let _ = place(&text, at);
            }
        }
    }
}
