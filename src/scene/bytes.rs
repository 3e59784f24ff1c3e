//! Bytes from files, GLB containers and URIs, never more than the stated limits.

use std::borrow::Cow;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use super::SceneError;

/// Largest file of a scene.
pub(super) const MAX_FILE_BYTES: u64 = 1 << 30;

/// A whole file; `needed_by` is the file that names it.
pub(super) fn read(file: &Path, needed_by: Option<&Path>) -> Result<Vec<u8>, SceneError> {
    let failed = |source| SceneError::Read { file: file.to_owned(), needed_by: needed_by.map(Path::to_owned), source };
    crate::source::file::read(file, MAX_FILE_BYTES).map_err(failed)
}

/// The JSON and the binary chunk of a GLB container (glTF 2.0, section 4.4), or all bytes as JSON
/// if they do not start with `glTF`.
pub(super) fn split_glb<'a>(file: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), SceneError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let version = u32_at(bytes, 4).ok_or_else(|| incomplete(file, bytes.len(), 12))?;
    let length = u32_at(bytes, 8).ok_or_else(|| incomplete(file, bytes.len(), 12))? as usize;
    if version == 1 {
        return Err(gltf_1_error(file, "the GLB version", "glTF 1.0"));
    }
    if version != 2 {
        return Err(SceneError::bad(file, "the GLB version", version, "2"));
    }
    let bytes = bytes.get(..length).ok_or_else(|| incomplete(file, bytes.len(), length))?;
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while let (Some(size), Some(kind)) = (u32_at(bytes, at), bytes.get(at + 4..at + 8)) {
        let start = at + 8;
        let end = start.saturating_add(size as usize);
        let chunk = bytes.get(start..end).ok_or_else(|| incomplete(file, bytes.len(), end))?;
        match kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {} // chunks of unknown kind must be skipped
        }
        at = end;
    }
    let json = json.ok_or_else(|| SceneError::bad(file, "the GLB chunks", "no JSON", "a JSON chunk first"))?;
    Ok((json, binary))
}

/// A path as one word of a POSIX shell, never an option.
pub(super) fn shell_quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+,:@%=".contains(c);
    if text.chars().all(is_plain) && !text.starts_with('-') {
        return text;
    }
    // Even in quotes, a leading hyphen begins an option.
    let here = if text.starts_with('-') { "./" } else { "" };
    format!("'{here}{}'", text.replace('\'', r"'\''"))
}

/// The error of a file of glTF 1.0.
pub(super) fn gltf_1_error(file: &Path, location: &str, actual: impl Display) -> SceneError {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let converted = file.with_file_name(format!("{stem}-2.glb"));
    let (from, to) = (shell_quoted(file), shell_quoted(&converted));
    let accepted = format!("glTF 2.0; `gltf-pipeline -i {from} -o {to}` converts it");
    SceneError::bad(file, location, actual, accepted)
}

/// Strips U+FEFF, which some editors write at the start of UTF-8 text.
pub(super) fn without_byte_order_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// Magic bytes of other file formats, in lower case, and advice for such a file.
const OTHER_FORMATS: [(&[u8], &str); 5] = [
    (b"pk\x03\x04", "a ZIP archive; unpack it"),
    (b"\x1f\x8b", "a gzip file; unpack it"),
    (b"kaydara fbx", "an FBX file; Blender imports it and exports glTF"),
    (b"<!doctype html", "a web page; download the file itself"),
    (b"<html", "a web page; download the file itself"),
];

/// Advice for a file of another format, recognised by its first bytes.
pub(super) fn other_format_advice(bytes: &[u8]) -> Option<&'static str> {
    let bytes = without_byte_order_mark(bytes).trim_ascii_start();
    let starts = |start: &[u8]| bytes.get(..start.len()).is_some_and(|head| head.eq_ignore_ascii_case(start));
    OTHER_FORMATS.iter().find(|(start, _)| starts(start)).map(|(_, kind)| *kind)
}

fn incomplete(file: &Path, length: usize, needed: usize) -> SceneError {
    SceneError::Incomplete { file: file.to_owned(), actual: length, needed }
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

/// Bytes of a URI in `file`: the content of a `data:` URI, or of a file relative to `file`.
pub(super) fn resolve(file: &Path, location: &str, uri: &str) -> Result<Vec<u8>, SceneError> {
    let accepted = "a relative file name or a base64 data: URI";
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data
            .split_once(";base64,")
            .ok_or_else(|| SceneError::bad(file, location, "a data: URI without base64", accepted))?;
        return base64(text).ok_or_else(|| SceneError::bad(file, location, "text that is not base64", accepted));
    }
    let path = relative_file(file, uri).ok_or_else(|| SceneError::bad(file, location, format!("{uri:?}"), accepted))?;
    read(&path, Some(file))
}

/// File of a relative URI in `file`; `None` for any other URI. If there is no such file,
/// backslashes are treated as slashes, as written by Windows programs, and `%` as a plain letter.
pub(super) fn relative_file(file: &Path, uri: &str) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let name = percent_decoded(uri);
    let spellings = [name.replace('\\', "/"), uri.to_owned()];
    let is_relative = |name: &str| {
        let is_drive = name.as_bytes().get(1..3).is_some_and(|two| two == b":/" || two == b":\\");
        !(is_drive || name.contains("://") || name.starts_with("file:") || Path::new(name).is_absolute())
    };
    if uri.starts_with("data:") || !is_relative(&name) || !is_relative(&spellings[0]) {
        return None;
    }
    let plain = folder.join(name.as_ref());
    if plain.exists() {
        return Some(plain);
    }
    Some(spellings.iter().map(|name| folder.join(name)).find(|path| path.exists()).unwrap_or(plain))
}

/// Decodes percent-encoding such as `%20` (RFC 3986, section 2.1).
fn percent_decoded(uri: &str) -> Cow<'_, str> {
    if !uri.contains('%') {
        return Cow::Borrowed(uri);
    }
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let hex = after.get(..2).and_then(|h| std::str::from_utf8(h).ok());
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) if first == b'%' => {
                bytes.push(byte);
                rest = &after[2..];
            }
            _ => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    Cow::Owned(String::from_utf8_lossy(&bytes).into_owned())
}

/// RFC 4648, section 4; padding may be missing.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 2);
    let (mut bits, mut count) = (0u32, 0);
    for c in text.bytes() {
        let six = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(six);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    (count < 6).then_some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_matches_the_test_vectors_of_rfc_4648() {
        for (text, bytes) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")] {
            assert_eq!(base64(text).unwrap(), bytes.as_bytes());
        }
        assert_eq!(base64("+/+/"), Some(vec![0xfb, 0xff, 0xbf]));
        assert_eq!(base64("Zm9*"), None);
        assert_eq!(base64("Z"), None);
    }

    #[test]
    fn uri_with_other_slashes_or_percent_resolves_to_the_existing_file() {
        let folder = tempfile::tempdir().unwrap();
        let (file, textures) = (folder.path().join("a.gltf"), folder.path().join("textures"));
        std::fs::create_dir(&textures).unwrap();
        for name in ["a b.png", "50%25.png"] {
            std::fs::write(textures.join(name), "").unwrap();
        }
        let resolved = |uri| relative_file(&file, uri);
        assert_eq!(resolved("textures\\a%20b.png"), Some(textures.join("a b.png")));
        assert_eq!(resolved("textures/50%25.png"), Some(textures.join("50%25.png")));
        assert_eq!(resolved("textures\\none.png"), Some(folder.path().join("textures\\none.png")));
        for elsewhere in ["C:\\t.png", "C:/t.png", "\\dev\\zero", "/dev/zero", "https://a.org/t.png", "data:,"] {
            assert_eq!(resolved(elsewhere), None, "{elsewhere}");
        }
    }

    #[test]
    fn shell_quoting_makes_a_path_one_word() {
        for (path, word) in [
            ("models/Möbel_1.glb", "models/Möbel_1.glb"),
            ("a b.glb", "'a b.glb'"),
            ("a;rm -rf ~.glb", "'a;rm -rf ~.glb'"),
            ("it's.glb", r"'it'\''s.glb'"),
            ("-o.glb", "'./-o.glb'"),
        ] {
            assert_eq!(shell_quoted(Path::new(path)), word);
        }
    }

    #[test]
    fn percent_encoding_decodes_to_bytes() {
        assert_eq!(percent_decoded("my%20knife%2.png"), "my knife%2.png");
        assert_eq!(percent_decoded("%C3%A4%"), "ä%");
    }
}
