//! Header of a PLY file: elements and their properties.

use super::ScanError;
use super::input::{ScanReader, words};
use crate::text::quoted;

/// Most lines of a header. Comments may hold a scanner's settings.
const MAX_HEADER_LINES: usize = 10_000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PlyEncoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PlyScalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl PlyScalar {
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    pub fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

pub(super) struct PlyProperty {
    pub name: String,
    /// Type of a list's length. `None` if it is a single number.
    pub length: Option<PlyScalar>,
    pub scalar: PlyScalar,
}

pub(super) struct PlyElement {
    pub name: String,
    pub count: u64,
    pub properties: Vec<PlyProperty>,
}

impl PlyElement {
    /// Least space of a record, bytes. In ASCII a value takes a digit and a separator.
    pub fn min_bytes(&self, encoding: PlyEncoding) -> u64 {
        let bytes = |property: &PlyProperty| match encoding {
            PlyEncoding::Ascii => 2,
            _ => property.length.unwrap_or(property.scalar).bytes(),
        };
        // The last line may lack its end.
        let total: u64 = self.properties.iter().map(bytes).sum();
        if encoding == PlyEncoding::Ascii { total.saturating_sub(1) } else { total }
    }

    /// Names of the properties, for messages.
    pub fn property_names(&self) -> String {
        let names: Vec<&str> = self.properties.iter().map(|property| property.name.as_str()).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    }
}

pub(super) struct PlyHeader {
    pub encoding: PlyEncoding,
    pub elements: Vec<PlyElement>,
}

impl PlyHeader {
    pub fn read(input: &mut ScanReader<'_>) -> Result<Self, ScanError> {
        let mut line = Vec::new();
        let mut encoding = None;
        let mut elements: Vec<PlyElement> = Vec::new();
        for _ in 0..MAX_HEADER_LINES {
            if !input.next_line(&mut line)? {
                return Err(input.line_error("the header has no line `end_header`: the file is cut off".to_owned()));
            }
            let parts: Vec<&[u8]> = words(&line).collect();
            let invalid = |expected: &str| {
                let actual = quoted(&String::from_utf8_lossy(&line));
                input.line_error(format!("found `{actual}`; expected {expected}"))
            };
            match parts[..] {
                [] | [b"ply" | b"comment" | b"obj_info", ..] => {}
                [b"end_header"] => {
                    let expected = "`format ascii 1.0`, `format binary_little_endian 1.0` or `format binary_big_endian \
                                    1.0` before it";
                    return Ok(Self { encoding: encoding.ok_or_else(|| invalid(expected))?, elements });
                }
                [b"format", name, ..] => {
                    encoding = match name {
                        b"ascii" => Some(PlyEncoding::Ascii),
                        b"binary_little_endian" => Some(PlyEncoding::LittleEndian),
                        b"binary_big_endian" => Some(PlyEncoding::BigEndian),
                        _ => return Err(invalid("ascii, binary_little_endian or binary_big_endian")),
                    };
                }
                [b"element", name, count] => {
                    let count = str::from_utf8(count).ok().and_then(|count| count.parse().ok());
                    let count = count.ok_or_else(|| invalid("`element NAME COUNT`"))?;
                    let name = String::from_utf8_lossy(name).into_owned();
                    elements.push(PlyElement { name, count, properties: Vec::new() });
                }
                [b"property", ref rest @ ..] => {
                    let property = property(rest).ok_or_else(|| {
                        invalid(
                            "`property TYPE NAME` or `property list TYPE TYPE NAME` with a type of char, uchar, short, \
                             ushort, int, uint, float or double",
                        )
                    })?;
                    let element = elements.last_mut().ok_or_else(|| invalid("an element before its properties"))?;
                    element.properties.push(property);
                }
                _ => return Err(invalid("format, element, property, comment or end_header")),
            }
        }
        Err(input.line_error(format!("the header has more than {MAX_HEADER_LINES} lines")))
    }
}

fn property(words: &[&[u8]]) -> Option<PlyProperty> {
    let text = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
    match *words {
        [b"list", length, scalar, name] => {
            let length = PlyScalar::named(length)?;
            Some(PlyProperty { name: text(name), length: Some(length), scalar: PlyScalar::named(scalar)? })
        }
        [scalar, name] => Some(PlyProperty { name: text(name), length: None, scalar: PlyScalar::named(scalar)? }),
        _ => None,
    }
}
