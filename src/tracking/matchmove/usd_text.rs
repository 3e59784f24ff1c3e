//! Parser of USD's text format (`.usda`): the tree of prims with their properties. Values of
//! metadata, connections and variants are skipped. Source: OpenUSD, "USDA file format"
//! specification, version 1.0.

/// A value of a property.
#[derive(Clone, Debug, PartialEq)]
pub enum UsdValue {
    Number(f64),
    /// A string or a token.
    Text(String),
    /// A tuple or an array.
    List(Vec<UsdValue>),
    /// Any other: paths, assets, dictionaries, `None`.
    Opaque,
}

impl UsdValue {
    /// All numbers, nested lists in order; `None` if there is anything else.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        fn collect(value: &UsdValue, numbers: &mut Vec<f64>) -> bool {
            match value {
                UsdValue::Number(number) => {
                    numbers.push(*number);
                    true
                }
                UsdValue::List(values) => values.iter().all(|value| collect(value, numbers)),
                _ => false,
            }
        }
        let mut numbers = Vec::new();
        collect(self, &mut numbers).then_some(numbers)
    }
}

/// An attribute: its default value, its time samples, or both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsdProperty {
    pub name: String,
    /// Counts from 1.
    pub line: usize,
    pub value: Option<UsdValue>,
    /// Values by time code.
    pub samples: Option<Vec<(f64, UsdValue)>>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsdPrim {
    pub name: String,
    /// The type, empty if it has none.
    pub kind: String,
    pub line: usize,
    pub properties: Vec<UsdProperty>,
    pub children: Vec<UsdPrim>,
}

impl UsdPrim {
    pub fn property(&self, name: &str) -> Option<&UsdProperty> {
        self.properties.iter().find(|property| property.name == name)
    }
}

/// A layer's metadata and its root prims.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsdLayer {
    pub metadata: Vec<(String, UsdValue)>,
    pub prims: Vec<UsdPrim>,
}

/// A problem with its line, from 1.
pub type UsdTextError = (usize, String);

/// Deepest nesting of prims and values.
const MAX_DEPTH: usize = 64;

#[derive(Clone, Debug, PartialEq)]
enum Lexeme<'a> {
    /// A keyword, a type or a name, with its namespaces and `[]`.
    Word(&'a str),
    Text(&'a str),
    Number(f64),
    /// A path or an asset.
    Reference,
    Sign(char),
    End,
}

impl Lexeme<'_> {
    fn description(&self) -> String {
        match self {
            Lexeme::Word(word) => format!("`{}`", crate::text::quoted(word)),
            Lexeme::Text(text) => format!("the text \"{}\"", crate::text::quoted(text)),
            Lexeme::Number(number) => crate::text::number(*number),
            Lexeme::Reference => "a path or an asset".to_owned(),
            Lexeme::Sign(sign) => format!("`{sign}`"),
            Lexeme::End => "the end of the file".to_owned(),
        }
    }
}

struct Parser<'a> {
    text: &'a str,
    /// Byte after the present lexeme.
    at: usize,
    line: usize,
    lexeme: Lexeme<'a>,
}

/// Parses a layer. The text begins with `#usda`.
pub fn parse(text: &str) -> Result<UsdLayer, UsdTextError> {
    let text = text.trim_start_matches('\u{feff}');
    if !text.starts_with("#usda") {
        return Err((1, "does not begin with `#usda 1.0`; expected USD's text format".to_owned()));
    }
    let mut parser = Parser { text, at: 0, line: 1, lexeme: Lexeme::End };
    parser.advance()?;
    let mut layer = UsdLayer::default();
    if parser.lexeme == Lexeme::Sign('(') {
        layer.metadata = parser.metadata(0)?;
    }
    while parser.lexeme != Lexeme::End {
        match parser.lexeme {
            Lexeme::Word("reorder") => parser.skip_assignment(0)?,
            _ => layer.prims.push(parser.prim(0)?),
        }
    }
    Ok(layer)
}

impl<'a> Parser<'a> {
    fn refuse<T>(&self, expected: &str) -> Result<T, UsdTextError> {
        Err((self.line, format!("found {}; expected {expected}", self.lexeme.description())))
    }

    fn advance(&mut self) -> Result<(), UsdTextError> {
        let bytes = self.text.as_bytes();
        // Blanks, separators and comments.
        while let Some(byte) = bytes.get(self.at) {
            match byte {
                b'\n' => self.line += 1,
                b'#' => {
                    let rest = &self.text[self.at..];
                    self.at += rest.find('\n').unwrap_or(rest.len());
                    continue;
                }
                byte if byte.is_ascii_whitespace() || *byte == b';' => {}
                _ => break,
            }
            self.at += 1;
        }
        let rest = &self.text[self.at..];
        let Some(first) = rest.chars().next() else {
            self.lexeme = Lexeme::End;
            return Ok(());
        };
        let (lexeme, length) = match first {
            '"' | '\'' => self.quoted(rest)?,
            '@' => {
                let quote = if rest.starts_with("@@@") { "@@@" } else { "@" };
                (Lexeme::Reference, self.enclosed(rest, quote, quote)?)
            }
            '<' => (Lexeme::Reference, self.enclosed(rest, "<", ">")?),
            c if c.is_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !(c.is_alphanumeric() || "_:.".contains(c))).unwrap_or(rest.len());
                let end = if rest[end..].starts_with("[]") { end + 2 } else { end };
                let lexeme = match &rest[..end] {
                    "inf" => Lexeme::Number(f64::INFINITY),
                    "nan" => Lexeme::Number(f64::NAN),
                    word => Lexeme::Word(word),
                };
                (lexeme, end)
            }
            c if c.is_ascii_digit() || "+-.".contains(c) => {
                let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || "+-.".contains(c))).unwrap_or(rest.len());
                match rest[..end].parse() {
                    Ok(number) => (Lexeme::Number(number), end),
                    Err(_) => {
                        return Err((
                            self.line,
                            format!("found `{}`; expected a number", crate::text::quoted(&rest[..end])),
                        ));
                    }
                }
            }
            c => (Lexeme::Sign(c), c.len_utf8()),
        };
        self.line += rest[..length].matches('\n').count();
        self.at += length;
        self.lexeme = lexeme;
        Ok(())
    }

    /// A string in quotes or in triple quotes, and its length with them. Escapes stay as they are.
    fn quoted(&self, rest: &'a str) -> Result<(Lexeme<'a>, usize), UsdTextError> {
        let quote = ["\"\"\"", "'''", "\"", "'"].into_iter().find(|quote| rest.starts_with(quote)).unwrap_or("\"");
        let mut from = quote.len();
        while let Some(offset) = rest[from..].find(['\\', quote.chars().next().unwrap_or('"')]) {
            let at = from + offset;
            if rest[at..].starts_with('\\') {
                // The escaped character.
                from = at + 1 + rest[at + 1..].chars().next().map_or(0, char::len_utf8);
            } else if rest[at..].starts_with(quote) {
                return Ok((Lexeme::Text(&rest[quote.len()..at]), at + quote.len()));
            } else {
                from = at + 1;
            }
        }
        Err((self.line, "the text in quotes has no end; the file may be truncated".to_owned()))
    }

    fn enclosed(&self, rest: &str, open: &str, close: &str) -> Result<usize, UsdTextError> {
        let end = rest[open.len()..].find(close);
        let end = end.ok_or_else(|| (self.line, format!("`{open}` has no `{close}`; the file may be truncated")))?;
        Ok(open.len() + end + close.len())
    }

    fn expect(&mut self, sign: char) -> Result<(), UsdTextError> {
        if self.lexeme == Lexeme::Sign(sign) { self.advance() } else { self.refuse(&format!("`{sign}`")) }
    }

    fn check_depth(&self, depth: usize) -> Result<(), UsdTextError> {
        if depth < MAX_DEPTH { Ok(()) } else { Err((self.line, format!("is nested deeper than {MAX_DEPTH} levels"))) }
    }

    /// `( key = value … )`, with documentation strings and list operations.
    fn metadata(&mut self, depth: usize) -> Result<Vec<(String, UsdValue)>, UsdTextError> {
        self.check_depth(depth)?;
        self.expect('(')?;
        let mut entries = Vec::new();
        loop {
            match self.lexeme {
                Lexeme::Sign(')') => {
                    self.advance()?;
                    return Ok(entries);
                }
                Lexeme::Text(_) => self.advance()?,
                Lexeme::Word(_) => {
                    let mut key = String::new();
                    while let Lexeme::Word(word) = self.lexeme {
                        word.clone_into(&mut key);
                        self.advance()?;
                    }
                    self.expect('=')?;
                    let value = self.value(depth + 1)?;
                    entries.push((key, value));
                }
                _ => return self.refuse("`)` or an entry `name = value`"),
            }
        }
    }

    fn skip_assignment(&mut self, depth: usize) -> Result<(), UsdTextError> {
        while matches!(self.lexeme, Lexeme::Word(_)) {
            self.advance()?;
        }
        self.expect('=')?;
        self.value(depth + 1).map(drop)
    }

    /// Skips a block in braces.
    fn skip_block(&mut self) -> Result<(), UsdTextError> {
        self.expect('{')?;
        let mut open = 1;
        while open > 0 {
            match self.lexeme {
                Lexeme::Sign('{') => open += 1,
                Lexeme::Sign('}') => open -= 1,
                Lexeme::End => return self.refuse("`}`; the file may be truncated"),
                _ => {}
            }
            self.advance()?;
        }
        Ok(())
    }

    fn prim(&mut self, depth: usize) -> Result<UsdPrim, UsdTextError> {
        self.check_depth(depth)?;
        let line = self.line;
        let Lexeme::Word("def" | "over" | "class") = self.lexeme else {
            return self.refuse("`def`, `over` or `class`");
        };
        self.advance()?;
        let mut prim = UsdPrim { line, ..UsdPrim::default() };
        if let Lexeme::Word(kind) = self.lexeme {
            kind.clone_into(&mut prim.kind);
            self.advance()?;
        }
        let Lexeme::Text(name) = self.lexeme else { return self.refuse("the prim's name in quotes") };
        name.clone_into(&mut prim.name);
        self.advance()?;
        if self.lexeme == Lexeme::Sign('(') {
            self.metadata(depth + 1)?;
        }
        self.expect('{')?;
        loop {
            match self.lexeme {
                Lexeme::Sign('}') => {
                    self.advance()?;
                    return Ok(prim);
                }
                Lexeme::Word("def" | "over" | "class") => prim.children.push(self.prim(depth + 1)?),
                Lexeme::Word("variantSet") => {
                    while self.lexeme != Lexeme::Sign('{') && self.lexeme != Lexeme::End {
                        self.advance()?;
                    }
                    self.skip_block()?;
                }
                Lexeme::Word("reorder") => self.skip_assignment(depth)?,
                Lexeme::Word(_) => self.property(depth, &mut prim.properties)?,
                _ => return self.refuse("`}`, a property or a prim"),
            }
        }
    }

    /// `[custom] [uniform] type name[.timeSamples] = value [(metadata)]`.
    fn property(&mut self, depth: usize, properties: &mut Vec<UsdProperty>) -> Result<(), UsdTextError> {
        let line = self.line;
        let mut name = "";
        while let Lexeme::Word(word) = self.lexeme {
            name = word;
            self.advance()?;
        }
        let (base, field) = name.split_once('.').unwrap_or((name, ""));
        let mut property = UsdProperty { name: base.to_owned(), line, ..UsdProperty::default() };
        if self.lexeme == Lexeme::Sign('=') {
            self.advance()?;
            match field {
                "timeSamples" => property.samples = Some(self.time_samples(depth + 1)?),
                "" => property.value = Some(self.value(depth + 1)?),
                // A connection, or a spline.
                _ if self.lexeme == Lexeme::Sign('{') => self.skip_block()?,
                _ => drop(self.value(depth + 1)?),
            }
        }
        if self.lexeme == Lexeme::Sign('(') {
            self.metadata(depth + 1)?;
        }
        match properties.iter_mut().find(|existing| existing.name == base) {
            Some(existing) => {
                existing.value = property.value.or(existing.value.take());
                existing.samples = property.samples.or(existing.samples.take());
            }
            None => properties.push(property),
        }
        Ok(())
    }

    fn time_samples(&mut self, depth: usize) -> Result<Vec<(f64, UsdValue)>, UsdTextError> {
        self.expect('{')?;
        let mut samples: Vec<(f64, UsdValue)> = Vec::new();
        loop {
            match self.lexeme {
                Lexeme::Sign('}') => {
                    self.advance()?;
                    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
                    return Ok(samples);
                }
                Lexeme::Sign(',') => self.advance()?,
                Lexeme::Number(time) if time.is_finite() => {
                    self.advance()?;
                    self.expect(':')?;
                    let value = self.value(depth + 1)?;
                    samples.push((time, value));
                }
                _ => return self.refuse("a time sample `time: value`"),
            }
        }
    }

    fn value(&mut self, depth: usize) -> Result<UsdValue, UsdTextError> {
        self.check_depth(depth)?;
        let close = match self.lexeme {
            Lexeme::Number(number) => {
                self.advance()?;
                return Ok(UsdValue::Number(number));
            }
            Lexeme::Text(text) => {
                let text = text.to_owned();
                self.advance()?;
                return Ok(UsdValue::Text(text));
            }
            Lexeme::Reference => {
                // An asset may be followed by a path in it, and by a layer offset.
                while self.lexeme == Lexeme::Reference {
                    self.advance()?;
                }
                if self.lexeme == Lexeme::Sign('(') {
                    self.metadata(depth + 1)?;
                }
                return Ok(UsdValue::Opaque);
            }
            Lexeme::Word(_) => {
                self.advance()?;
                return Ok(UsdValue::Opaque);
            }
            Lexeme::Sign('{') => {
                self.skip_block()?;
                return Ok(UsdValue::Opaque);
            }
            Lexeme::Sign('(') => ')',
            Lexeme::Sign('[') => ']',
            _ => return self.refuse("a value"),
        };
        self.advance()?;
        let mut values = Vec::new();
        loop {
            match self.lexeme {
                Lexeme::Sign(sign) if sign == close => {
                    self.advance()?;
                    return Ok(UsdValue::List(values));
                }
                Lexeme::Sign(',') => self.advance()?,
                _ => values.push(self.value(depth + 1)?),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LAYER: &str = r#"#usda 1.0
(
    "A comment."
    upAxis = "Z" # another
    metersPerUnit = 0.01
    customLayerData = { string tool = "x"; dictionary more = { int a = 1 } }
    subLayers = [@a.usda@ (offset = 1; scale = 2)]
)
over "shot" (prepend apiSchemas = ["A"]
    references = @@@b.usda@@@</c>)
{
    custom uniform token[] xformOpOrder = ["xformOp:translate", "!invert!xformOp:translate:pivot"]
    double3 xformOp:translate.timeSamples = {
        2: (1, 2e0, -3.5),
        1: (0, 0, 0),
    }
    double3 xformOp:translate = (9, 9, 9) (
        doc = """with "quotes" \""""
    )
    float f.connect = </a.b>
    rel target = [</a>, </b>]
    variantSet "x" = { "y" { float z = 1 } }
    def Camera "cam" { float focalLength = 5 }
}
"#;

    #[test]
    fn layer_becomes_prims_and_properties() {
        let layer = parse(LAYER).unwrap();
        assert_eq!(layer.metadata[0], ("upAxis".to_owned(), UsdValue::Text("Z".to_owned())));
        assert_eq!(layer.metadata[1], ("metersPerUnit".to_owned(), UsdValue::Number(0.01)));
        let shot = &layer.prims[0];
        assert_eq!((shot.name.as_str(), shot.kind.as_str(), shot.line), ("shot", "", 9));
        let translate = shot.property("xformOp:translate").unwrap();
        assert_eq!(translate.value.as_ref().unwrap().numbers(), Some(vec![9.0; 3]));
        let samples = translate.samples.as_ref().unwrap();
        assert_eq!((samples[0].0, samples[1].1.numbers()), (1.0, Some(vec![1.0, 2.0, -3.5])));
        assert_eq!(shot.children[0].kind, "Camera");
        assert_eq!(shot.children[0].property("focalLength").unwrap().value, Some(UsdValue::Number(5.0)));
        assert!(shot.property("z").is_none());
    }

    #[test]
    fn mistakes_name_the_line() {
        for (text, line, expected) in [
            ("", 1, "does not begin with `#usda 1.0`"),
            ("#usda 1.0\ndef \"a\" {", 2, "found the end of the file; expected `}`"),
            ("#usda 1.0\n\ndef Xform a {}", 3, "found `a`; expected the prim's name in quotes"),
            ("#usda 1.0\ndef \"a\" {\n float f = 1..2 }", 3, "found `1..2`; expected a number"),
            ("#usda 1.0\ndef \"a\" {\n float f.timeSamples = {\n x: 1 } }", 4, "found `x:`; expected a time sample"),
            ("#usda 1.0\ndef \"a", 2, "the text in quotes has no end"),
        ] {
            let (at, problem) = parse(text).unwrap_err();
            assert!(at == line && problem.starts_with(expected), "{at}: {problem}");
        }
        let deep = format!("#usda 1.0\ndef \"a\" {{ float f = {} }}", "[".repeat(100_000));
        assert!(parse(&deep).unwrap_err().1.contains("nested deeper"));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "(def|\"[a\\\\]\"|[{}()\\[\\]=:,.<>@#'é]|[0-9e.]{1,3}|x|\n| ){0,40}") {
            let _ = parse(&format!("#usda{text}"));
            let _ = parse(&format!("#usda 1.0\n{near}"));
        }
    }
}
