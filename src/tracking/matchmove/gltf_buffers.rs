//! The JSON of a glTF file (2.0), and accessors of floats in its buffers, with bounds checks.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use crate::source::file::{self, MAX_TEXT_BYTES};
use crate::text::quoted;
use crate::tracking::records::TextError;

/// A file with its buffers.
#[derive(Debug)]
pub struct GltfAnimationFile {
    pub json: Value,
    buffers: Vec<Vec<u8>>,
}

/// `componentType` of 32-bit floats.
const FLOAT: u64 = 5126;

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    let bytes: [u8; 4] = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
    Some(u32::from_le_bytes(bytes) as usize)
}

/// The JSON and the binary chunk of a GLB container (glTF 2.0, section 4.4); other files are JSON.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while let (Some(size), Some(kind)) = (u32_at(bytes, at), bytes.get(at + 4..at + 8)) {
        let end = (at + 8).saturating_add(size);
        let chunk = bytes.get(at + 8..end).ok_or("the GLB container is truncated; copy the file again")?;
        match kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at = end;
    }
    Ok((json.ok_or("the GLB container has no JSON")?, binary))
}

/// An index or a count in JSON.
pub fn index(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|n| usize::try_from(n).ok())
}

impl GltfAnimationFile {
    pub fn read(path: &Path) -> Result<Self, TextError> {
        let bytes =
            file::read(path, MAX_TEXT_BYTES).map_err(|source| TextError::Read { file: path.to_owned(), source })?;
        let refuse = |problem: String| TextError::line(path, 1, problem);
        let (json, binary) = chunks(&bytes).map_err(refuse)?;
        let json: Value =
            serde_json::from_slice(json).map_err(|error| refuse(format!("is not valid glTF 2.0: {error}")))?;
        let mut buffers = Vec::new();
        for (n, buffer) in json["buffers"].as_array().into_iter().flatten().enumerate() {
            let bytes = match buffer["uri"].as_str() {
                None => binary.filter(|_| n == 0).map(<[u8]>::to_vec).unwrap_or_default(),
                Some(uri) => match uri.split_once(";base64,").filter(|_| uri.starts_with("data:")) {
                    Some((_, text)) => STANDARD
                        .decode(text)
                        .map_err(|error| refuse(format!("buffers[{n}].uri is not base64: {error}")))?,
                    None => {
                        // A name in the same folder or below it.
                        let name = Path::new(uri);
                        let is_inside = name.components().all(|part| matches!(part, std::path::Component::Normal(_)));
                        if !is_inside {
                            return Err(refuse(format!(
                                "buffers[{n}].uri is {}; expected a file beside it",
                                quoted(uri)
                            )));
                        }
                        let at = path.parent().unwrap_or(Path::new("")).join(name);
                        file::read(&at, MAX_TEXT_BYTES).map_err(|source| TextError::Read { file: at, source })?
                    }
                },
            };
            buffers.push(bytes);
        }
        Ok(Self { json, buffers })
    }

    /// Values of an accessor of floats with `N` components.
    pub fn floats<const N: usize>(&self, accessor: usize) -> Result<Vec<[f64; N]>, String> {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(N - 1).copied().unwrap_or_default();
        let description = &self.json["accessors"][accessor];
        if description["type"].as_str() != Some(kind) || description["componentType"].as_u64() != Some(FLOAT) {
            return Err(format!(
                "accessors[{accessor}] is not {kind} of 32-bit floats; expected them for an animation"
            ));
        }
        if !description["sparse"].is_null() {
            return Err(format!("accessors[{accessor}] is sparse, which is not read"));
        }
        let view = index(&description["bufferView"]).map(|view| &self.json["bufferViews"][view]);
        let values = || {
            let (view, count) = (view?, index(&description["count"])?);
            let buffer = self.buffers.get(index(&view["buffer"])?)?;
            let offset = |value: &Value| index(value).unwrap_or_default();
            let start = offset(&view["byteOffset"]).checked_add(offset(&description["byteOffset"]))?;
            let stride = index(&view["byteStride"]).unwrap_or(4 * N);
            let element = |i: usize| -> Option<[f64; N]> {
                let at = i.checked_mul(stride)?.checked_add(start)?;
                let bytes = buffer.get(at..at.checked_add(4 * N)?)?;
                let floats = bytes.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
                floats.collect::<Vec<_>>().try_into().ok()
            };
            // A false count ends at the buffer's end.
            (0..count).map(element).collect::<Option<Vec<_>>>()
        };
        let values = values().ok_or_else(|| format!("accessors[{accessor}] lies outside its buffer"))?;
        if values.iter().flatten().all(|value| value.is_finite()) {
            Ok(values)
        } else {
            Err(format!("accessors[{accessor}] has values that are not finite"))
        }
    }
}
