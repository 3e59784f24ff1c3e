//! Frames with a variable rate for ffmpeg: a Matroska stream of uncompressed pictures, one cluster
//! each. Raw video has no times. Source: RFC 8794 (EBML), RFC 9559 (Matroska; element names and
//! numbers).

use super::SinkOptions;

/// The size of an element as eight bytes.
fn size(bytes: usize) -> [u8; 8] {
    (1 << 56 | bytes as u64).to_be_bytes()
}

fn element(id: &[u8], content: &[u8]) -> Vec<u8> {
    [id, &size(content.len()), content].concat()
}

fn number(id: &[u8], number: u64) -> Vec<u8> {
    element(id, &number.to_be_bytes())
}

/// The size of an element that ends with the stream.
const UNKNOWN_SIZE: [u8; 8] = [1, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
/// Nanoseconds in the unit of the times.
const TIMESTAMP_SCALE: u64 = 1000;

/// Header of the stream.
pub fn head(options: &SinkOptions) -> Vec<u8> {
    let ebml = [element(b"\x42\x82", b"matroska"), number(b"\x42\x87", 4), number(b"\x42\x85", 2)].concat();
    let video = [
        number(b"\xb0", options.width.into()),
        number(b"\xba", options.height.into()),
        // UncompressedFourCC: R, G, B and the bits of a pixel.
        element(b"\x2e\xb5\x24", &[b'R', b'G', b'B', 3 * options.bits as u8]),
    ];
    let track = [
        number(b"\xd7", 1),
        number(b"\x73\xc5", 1),
        number(b"\x83", 1),
        element(b"\x86", b"V_UNCOMPRESSED"),
        // DefaultDuration
        number(b"\x23\xe3\x83", (1e9 / options.fps).round().max(1.0) as u64),
        element(b"\xe0", &video.concat()),
    ];
    [
        element(b"\x1a\x45\xdf\xa3", &ebml),
        [&b"\x18\x53\x80\x67"[..], &UNKNOWN_SIZE].concat(),
        element(b"\x15\x49\xa9\x66", &number(b"\x2a\xd7\xb1", TIMESTAMP_SCALE)),
        element(b"\x16\x54\xae\x6b", &element(b"\xae", &track.concat())),
    ]
    .concat()
}

/// Header of a frame's pixels.
pub fn frame_head(time_us: u64, bytes: usize) -> Vec<u8> {
    let time = number(b"\xe7", time_us);
    // Track 1, at the cluster's own time, keyframe.
    let block = [b'\x81', 0, 0, 0x80];
    let block_head = [&b"\xa3"[..], &size(block.len() + bytes), &block].concat();
    let cluster = size(time.len() + block_head.len() + bytes);
    [&b"\x1f\x43\xb6\x75"[..], &cluster, &time, &block_head].concat()
}
