//! Opens a glTF file and reads its buffers with bounds checks.

use std::borrow::Cow;
use std::cell::{OnceCell, RefCell};
use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::bytes::{self, MAX_FILE_BYTES};
use super::schema::{Accessor, ExtensionNames, Head, Root};
use super::{SceneError, extension, schema};

/// Length limit of an accessor without a buffer view, which takes no space in the file.
const MAX_COUNT_WITHOUT_BYTES: usize = 1 << 20;

/// A glTF file: its JSON and its buffers.
pub(super) struct Gltf {
    pub file: PathBuf,
    pub json: Root,
    /// Binary chunk of a GLB container, until it is taken as the first buffer.
    chunk: RefCell<Option<Vec<u8>>>,
    /// Loaded on first use. No memo: slices of them are borrowed while the file is read.
    buffers: Vec<OnceCell<Vec<u8>>>,
}

impl Gltf {
    pub fn open(file: &Path, needed_by: Option<&Path>) -> Result<Self, SceneError> {
        let bytes = bytes::read(file, needed_by)?;
        if bytes.is_empty() {
            return Err(SceneError::Empty { file: file.to_owned() });
        }
        let (json, chunk) = bytes::split_glb(file, &bytes)?;
        let json = bytes::without_byte_order_mark(json);
        // The version is checked first: the JSON of other versions has other types.
        if let Ok(Head { asset }) = serde_json::from_slice(json) {
            check_version(file, &asset.version)?;
        }
        let parsed = serde_json::from_slice(json)
            .or_else(|error| serde_json::from_slice(&with_plain_integers(json)).map_err(|_| error));
        let json: Root = parsed.map_err(|error| {
            let kind = bytes::other_format_advice(&bytes);
            if kind.is_none() && !json.trim_ascii_start().starts_with(b"{") {
                return SceneError::NotGltf { file: file.to_owned() };
            }
            let problem = kind.map_or_else(|| error.to_string(), str::to_owned);
            SceneError::bad(file, "the glTF JSON", problem, "valid glTF 2.0")
        })?;
        check_version(file, &json.asset.version)?;
        let buffers = json.buffers.iter().map(|_| OnceCell::new()).collect();
        let gltf = Self { file: file.to_owned(), json, chunk: RefCell::new(chunk.map(<[u8]>::to_vec)), buffers };
        gltf.check_required_extensions()?;
        Ok(gltf)
    }

    /// The file itself and all referenced files.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let images = self.json.images.iter().filter_map(|image| image.uri.as_deref());
        let uris = self.json.buffers.iter().filter_map(|buffer| buffer.uri.as_deref()).chain(images);
        let named = uris.filter_map(|uri| bytes::relative_file(&self.file, uri));
        std::iter::once(self.file.clone()).chain(named)
    }

    pub fn bad(&self, location: impl Display, actual: impl Display, accepted: impl Display) -> SceneError {
        SceneError::bad(&self.file, location, actual, accepted)
    }

    /// `list[index]`; `location` is the place that contains the index.
    pub fn get<'a, T>(
        &self,
        list: &'a [T],
        list_name: &str,
        index: usize,
        location: impl Display,
    ) -> Result<&'a T, SceneError> {
        list.get(index).ok_or_else(|| self.bad(location, index, format!("an index into {} {list_name}", list.len())))
    }

    fn check_required_extensions(&self) -> Result<(), SceneError> {
        let Some(name) = self.json.extensions_required.iter().find(|name| !extension::is_supported(name)) else {
            return Ok(());
        };
        let accepted = extension::with_conversion(extension::SUPPORTED.join(", "), name, &self.file);
        Err(self.bad("extensionsRequired", name, accepted))
    }

    /// Error for content that is only available in an unsupported extension, if there is one.
    pub fn only_in_extension(
        &self,
        location: &str,
        extensions: &ExtensionNames,
        accepted: &str,
    ) -> Result<(), SceneError> {
        let Some(name) = extensions.keys().find(|name| !extension::is_supported(name)) else { return Ok(()) };
        let actual = format!("its content in {name} only, which is not supported");
        Err(self.bad(location, actual, extension::with_conversion(accepted, name, &self.file)))
    }

    /// Bytes of a buffer; `location` is its place for errors.
    fn buffer(&self, index: usize, location: &str) -> Result<&[u8], SceneError> {
        let buffer = self.get(&self.json.buffers, "buffers", index, location)?;
        if let Some(bytes) = self.buffers[index].get() {
            return Ok(bytes);
        }
        let location = format!("buffers[{index}]");
        let chunk = if index == 0 && buffer.uri.is_none() { self.chunk.take() } else { None };
        let mut bytes = match (&buffer.uri, chunk) {
            (Some(uri), _) => bytes::resolve(&self.file, &format!("{location}.uri"), uri)?,
            (None, Some(chunk)) => chunk,
            (None, None) => {
                self.only_in_extension(&location, &buffer.extensions, "a uri or a binary chunk")?;
                return Err(self.bad(location, "neither a uri nor a binary chunk", "one of them"));
            }
        };
        if bytes.len() < buffer.byte_length {
            let actual = format!("{} bytes", bytes.len());
            return Err(self.bad(location, actual, format!("{} bytes, its byteLength", buffer.byte_length)));
        }
        bytes.truncate(buffer.byte_length);
        let loaded_len: usize = self.buffers.iter().filter_map(OnceCell::get).map(Vec::len).sum();
        let total = (loaded_len + bytes.len()) as u64;
        if total > MAX_FILE_BYTES {
            return Err(self.bad(location, format!("{total} bytes in all"), format!("up to {MAX_FILE_BYTES}")));
        }
        Ok(self.buffers[index].get_or_init(|| bytes))
    }

    /// All bytes of a buffer view and its stride, 0 if its elements are contiguous.
    pub fn view(&self, index: usize, location: &str) -> Result<(&[u8], usize), SceneError> {
        let view = self.get(&self.json.buffer_views, "bufferViews", index, location)?;
        let location = format!("bufferViews[{index}]");
        let buffer = self.buffer(view.buffer, &format!("{location}.buffer"))?;
        let bytes = view.byte_offset.checked_add(view.byte_length).and_then(|end| buffer.get(view.byte_offset..end));
        let bytes = bytes.ok_or_else(|| {
            let actual = format!("{} bytes from byte {}", view.byte_length, view.byte_offset);
            self.bad(&location, actual, format!("a part of the {} bytes of buffers[{}]", buffer.len(), view.buffer))
        })?;
        match view.byte_stride {
            Some(stride) if !(4..=252).contains(&stride) => {
                Err(self.bad(format!("{location}.byteStride"), stride, "4 to 252"))
            }
            stride => Ok((bytes, stride.unwrap_or(0))),
        }
    }

    /// The accessor's elements as finite numbers; see [`Self::numbers`].
    pub fn floats<const N: usize>(
        &self,
        index: usize,
        location: &str,
        shapes: &[&str],
        fill: f32,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let rows = self.numbers(index, location, shapes, fill)?;
        for (row, values) in rows.iter().enumerate() {
            if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
                return Err(self.bad(format!("{location} (accessors[{index}], element {row})"), bad, "finite numbers"));
            }
        }
        Ok(rows)
    }

    /// The accessor's elements as numbers; `location` is for errors. Missing components up to
    /// N are set to `fill`. Normalized integers become -1 to 1 (glTF 2.0, section 3.6.2.2).
    pub fn numbers<const N: usize>(
        &self,
        index: usize,
        location: &str,
        shapes: &[&str],
        fill: f32,
    ) -> Result<Vec<[f32; N]>, SceneError> {
        let accessor = self.accessor(index, location, shapes)?;
        let elements = self.elements(index, accessor, location)?;
        let component = elements.component;
        if accessor.normalized && component == Component::U32 {
            return Err(self.bad(location, "normalized 32-bit numbers", "normalized numbers of 8 or 16 bits"));
        }
        let mut rows = Vec::with_capacity(elements.count);
        for element in elements.bytes.chunks_exact(elements.size) {
            let mut values = [fill; N];
            for (value, bytes) in values.iter_mut().zip(element.chunks_exact(component.size())) {
                *value = component.number(bytes, accessor.normalized);
            }
            rows.push(values);
        }
        Ok(rows)
    }

    /// An accessor of vertex indices, each below `vertices`.
    pub fn indices(&self, index: usize, location: &str, vertices: usize) -> Result<Vec<u32>, SceneError> {
        let accessor = self.accessor(index, location, &["SCALAR"])?;
        let elements = self.elements(index, accessor, location)?;
        if !elements.component.is_unsigned() {
            return Err(self.bad(location, accessor.component_type, "componentType 5121, 5123 or 5125 (unsigned)"));
        }
        let mut indices = Vec::with_capacity(elements.count);
        for (row, bytes) in elements.bytes.chunks_exact(elements.size).enumerate() {
            let value = elements.component.unsigned(bytes);
            if value as usize >= vertices {
                let place = format!("{location} (accessors[{index}], element {row})");
                return Err(self.bad(place, value, format!("an index into {vertices} vertices")));
            }
            indices.push(value);
        }
        Ok(indices)
    }

    /// Number of elements declared by an accessor, without reading them.
    pub fn count(&self, index: usize, location: &str) -> Result<usize, SceneError> {
        Ok(self.get(&self.json.accessors, "accessors", index, location)?.count)
    }

    /// True if an accessor has bytes in the file; otherwise all its elements are zero.
    pub fn has_bytes(&self, index: usize, location: &str) -> Result<bool, SceneError> {
        let accessor = self.get(&self.json.accessors, "accessors", index, location)?;
        Ok(accessor.buffer_view.is_some() || accessor.sparse.is_some())
    }

    fn accessor(&self, index: usize, location: &str, shapes: &[&str]) -> Result<&Accessor, SceneError> {
        let accessor = self.get(&self.json.accessors, "accessors", index, location)?;
        if !shapes.contains(&accessor.shape.as_str()) {
            let place = format!("{location} (accessors[{index}].type)");
            return Err(self.bad(place, format!("{:?}", accessor.shape), shapes.join(" or ")));
        }
        Ok(accessor)
    }

    /// The accessor's bytes without gaps, including sparse elements.
    fn elements(&self, index: usize, accessor: &Accessor, location: &str) -> Result<Elements, SceneError> {
        let location = format!("{location} (accessors[{index}])");
        let component = Component::from_code(accessor.component_type)
            .ok_or_else(|| self.bad(&location, accessor.component_type, "componentType 5120 to 5123, 5125 or 5126"))?;
        let size = component.size() * components(&accessor.shape);
        let count = accessor.count;
        let mut bytes = match accessor.buffer_view {
            Some(view) => self.packed(view, accessor.byte_offset, count, size, &location)?,
            None if count <= MAX_COUNT_WITHOUT_BYTES => vec![0; count * size],
            None => {
                let accepted = format!("up to {MAX_COUNT_WITHOUT_BYTES} where there is no bufferView");
                return Err(self.bad(format!("{location}.count"), count, accepted));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            self.put_sparse(sparse, &mut bytes, size, &location)?;
        }
        Ok(Elements { bytes, component, size, count })
    }

    fn put_sparse(
        &self,
        sparse: &schema::Sparse,
        bytes: &mut [u8],
        size: usize,
        location: &str,
    ) -> Result<(), SceneError> {
        let location = format!("{location}.sparse");
        let code = sparse.indices.component_type.unwrap_or(0);
        let component = Component::from_code(code).filter(|c| c.is_unsigned()).ok_or_else(|| {
            self.bad(format!("{location}.indices.componentType"), code, "5121, 5123 or 5125 (unsigned)")
        })?;
        let part = &sparse.indices;
        let places = self.packed(part.buffer_view, part.byte_offset, sparse.count, component.size(), &location)?;
        let part = &sparse.values;
        let values = self.packed(part.buffer_view, part.byte_offset, sparse.count, size, &location)?;
        let count = bytes.len() / size;
        for (place, value) in places.chunks_exact(component.size()).zip(values.chunks_exact(size)) {
            let place = component.unsigned(place) as usize;
            let element = place.checked_mul(size).and_then(|at| bytes.get_mut(at..at + size)).ok_or_else(|| {
                self.bad(format!("{location}.indices"), place, format!("an index into {count} elements"))
            })?;
            element.copy_from_slice(value);
        }
        Ok(())
    }

    /// `count` elements of `size` bytes, `offset` bytes into a view, tightly packed.
    fn packed(
        &self,
        view: usize,
        offset: usize,
        count: usize,
        size: usize,
        location: &str,
    ) -> Result<Vec<u8>, SceneError> {
        let (bytes, stride) = self.view(view, location)?;
        let stride = if stride == 0 { size } else { stride };
        if stride < size {
            return Err(self.bad(location, format!("a byteStride of {stride}"), format!("{size} or more")));
        }
        if count == 0 {
            return Ok(Vec::new());
        }
        // The last element may lack the padding of its stride.
        let end = (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)).and_then(|n| n.checked_add(offset));
        let part = end.and_then(|end| bytes.get(offset..end)).ok_or_else(|| {
            let actual = format!("{count} elements of {size} bytes, {stride} apart, from byte {offset}");
            self.bad(location, actual, format!("elements within the {} bytes of bufferViews[{view}]", bytes.len()))
        })?;
        if stride == size {
            return Ok(part.to_vec());
        }
        Ok(part.chunks(stride).flat_map(|element| element.iter().take(size)).copied().collect())
    }
}

/// The place of an attribute of a primitive.
pub(super) fn place(location: &str, attribute: &str) -> String {
    format!("{location}.attributes.{attribute}")
}

fn check_version(file: &Path, version: &Value) -> Result<(), SceneError> {
    let version = version.as_str().map_or_else(|| version.to_string(), str::to_owned);
    match version.split('.').next() {
        Some("2") => Ok(()),
        Some("1") => Err(bytes::gltf_1_error(file, "asset.version", format!("glTF {version}"))),
        _ => Err(SceneError::bad(file, "asset.version", format!("{version:?}"), "2.0")),
    }
}

/// Rewrites integers in the form `4.0` or `4e0` as `4`. JSON does not distinguish them (RFC 8259,
/// section 6), but the parser does.
fn with_plain_integers(json: &[u8]) -> Cow<'_, [u8]> {
    /// Largest magnitude up to which every integer is exact in double precision.
    const MAX_EXACT: f64 = 9_007_199_254_740_992.0;
    let mut out = Vec::new();
    let (mut copied, mut at) = (0, 0);
    while let Some(&byte) = json.get(at) {
        let start = at;
        if byte == b'"' {
            at += 1;
            while json.get(at).is_some_and(|&b| b != b'"') {
                at += if json[at] == b'\\' { 2 } else { 1 };
            }
            at += 1;
        } else if byte.is_ascii_digit() || byte == b'-' {
            while json.get(at).is_some_and(|b| b"+-.eE".contains(b) || b.is_ascii_digit()) {
                at += 1;
            }
            let number = str::from_utf8(&json[start..at]).ok().filter(|text| text.contains(['.', 'e', 'E']));
            let value = number.and_then(|text| text.parse::<f64>().ok());
            if let Some(value) = value.filter(|v| v.fract() == 0.0 && (0.0..=MAX_EXACT).contains(v)) {
                out.extend_from_slice(&json[copied..start]);
                out.extend_from_slice((value as u64).to_string().as_bytes());
                copied = at;
            }
        } else {
            at += 1;
        }
    }
    if copied == 0 {
        return Cow::Borrowed(json);
    }
    out.extend_from_slice(&json[copied..]);
    Cow::Owned(out)
}

struct Elements {
    bytes: Vec<u8>,
    component: Component,
    /// Bytes per element, 1 to 64.
    size: usize,
    count: usize,
}

/// Number of components of an element. Unknown types (1 here) were already rejected by `shapes`.
fn components(shape: &str) -> usize {
    match shape {
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        "MAT4" => 16,
        _ => 1,
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_unsigned(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    /// The little-endian number in `bytes`, which has `size` bytes.
    fn unsigned(self, bytes: &[u8]) -> u32 {
        bytes.iter().rev().fold(0, |n, &byte| (n << 8) | u32::from(byte))
    }

    fn number(self, bytes: &[u8], normalized: bool) -> f32 {
        let n = self.unsigned(bytes);
        let (value, largest) = match self {
            Self::F32 => return f32::from_bits(n),
            Self::I8 => (f32::from(n as u8 as i8), 127.0),
            Self::U8 => (n as f32, 255.0),
            Self::I16 => (f32::from(n as u16 as i16), 32767.0),
            Self::U16 => (n as f32, 65535.0),
            Self::U32 => (n as f32, 1.0),
        };
        if normalized { (value / largest).max(-1.0) } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::{Component, with_plain_integers};

    #[test]
    fn integers_written_as_floats_become_integers_outside_strings() {
        let json = br#"{"count": 4.0, "n\"4.0": "4.0", "list": [2e0, -1.0, 0.5, 1e300, 12, 1.0]}"#;
        let expected = r#"{"count": 4, "n\"4.0": "4.0", "list": [2, -1.0, 0.5, 1e300, 12, 1]}"#;
        assert_eq!(String::from_utf8_lossy(&with_plain_integers(json)), expected);
        for open in ["\"4.0", "\"\\", "-", "4.0.0"] {
            assert_eq!(*with_plain_integers(open.as_bytes()), *open.as_bytes());
        }
    }

    #[test]
    fn normalized_integers_convert_as_specified_by_gltf() {
        assert_eq!(Component::U8.number(&[255], true), 1.0);
        assert_eq!(Component::I8.number(&[0x80], true), -1.0);
        assert_eq!(Component::I8.number(&[0x80], false), -128.0);
        assert_eq!(Component::I16.number(&[0xff, 0x7f], true), 1.0);
        assert_eq!(Component::U16.number(&[1, 2], false), 513.0);
        assert_eq!(Component::F32.number(&1.5f32.to_le_bytes(), false), 1.5);
    }
}
