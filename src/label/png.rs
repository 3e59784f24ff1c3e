//! Chunks of PNG files. Source: PNG specification (third edition), 5.3, 11.3.2.6 and 11.3.3.

/// Length of a PNG's signature and first chunk.
const IHDR_END_BYTES: usize = 8 + 25;

/// Type and content of a chunk.
pub type Chunk = ([u8; 4], Vec<u8>);

/// The chunk of an XMP packet: uncompressed international text.
pub fn xmp_chunk(packet: &str) -> Chunk {
    // Keyword, no compression, no language, no translated keyword.
    let head = b"XML:com.adobe.xmp\0\0\0\0\0";
    (*b"iTXt", [&head[..], packet.as_bytes()].concat())
}

/// A PNG with chunks inserted after its header. A file that is shorter than a header stays as it
/// is.
pub fn with_chunks(png: &[u8], chunks: &[Chunk]) -> Vec<u8> {
    let Some((header, rest)) = png.split_at_checked(IHDR_END_BYTES) else { return png.to_vec() };
    let mut out = Vec::with_capacity(png.len() + chunks.iter().map(|(_, content)| content.len() + 12).sum::<usize>());
    out.extend_from_slice(header);
    for (kind, content) in chunks {
        let at = out.len() + 4;
        out.extend_from_slice(&(content.len() as u32).to_be_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(content);
        let checksum = crc32fast::hash(&out[at..]);
        out.extend_from_slice(&checksum.to_be_bytes());
    }
    out.extend_from_slice(rest);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inserted_chunks_follow_the_header_and_the_picture_reads_back() {
        let pixels = crate::pixels::Pixels::from_u8(2, 1, vec![1, 2, 3, 250, 251, 252]).unwrap();
        let mut png = Vec::new();
        pixels.write_png(&mut png).unwrap();
        let chunks = [(*b"cICP", vec![9, 18, 0, 1]), xmp_chunk("<x/>")];
        let tagged = with_chunks(&png, &chunks);
        assert_eq!(&tagged[IHDR_END_BYTES..][..12], b"\0\0\0\x04cICP\x09\x12\0\x01");
        assert_eq!(&tagged[IHDR_END_BYTES + 16..][..34], b"\0\0\0\x1aiTXtXML:com.adobe.xmp\0\0\0\0\0<x/>");
        // The decoder checks the checksum of each chunk.
        assert_eq!(image::load_from_memory(&tagged).unwrap().to_rgb8().into_raw(), [1, 2, 3, 250, 251, 252]);
        assert_eq!(with_chunks(b"short", &chunks), b"short");
    }
}
