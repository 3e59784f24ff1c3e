//! Tests of multipart streams of JPEG files.

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::*;
use crate::source::jpeg_header;

const SIZE: (u32, u32) = (64, 32);
/// Markers (T.81, table B.1).
const END: [u8; 2] = [0xff, 0xd9];
const SCAN: [u8; 2] = [0xff, 0xda];

fn jpeg(seed: u32, quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let code = |i: u32| (128.0 + 90.0 * (f64::from(i * (7 + seed)) * 0.01).sin()) as u8;
    let codes: Vec<u8> = (0..SIZE.0 * SIZE.1 * 3).map(code).collect();
    let mut encoder = JpegEncoder::new_with_quality(&mut file, quality);
    encoder.encode(&codes, SIZE.0, SIZE.1, ExtendedColorType::Rgb8).unwrap();
    file
}

/// As ffmpeg writes it.
fn stream(packets: &[Vec<u8>]) -> Vec<u8> {
    let part = |packet: &Vec<u8>| {
        let head = format!("--ffmpeg\r\nContent-type: image/jpeg\r\nContent-length: {}\r\n\r\n", packet.len());
        [head.as_bytes(), packet, b"\r\n"].concat()
    };
    packets.iter().flat_map(part).collect()
}

fn packets(stream: &[u8]) -> Vec<Vec<u8>> {
    Packets::new(stream).collect()
}

fn position(bytes: &[u8], marker: [u8; 2]) -> usize {
    bytes.windows(2).position(|pair| pair == marker).unwrap()
}

/// A grey JPEG of 32×8 px whose four blocks are separated by restart markers: each block is a DC
/// difference of 0 and an end of block, codes 00 and 1010 of the standard's tables.
fn restarted() -> Vec<u8> {
    let mut file = b"\xff\xd8\xff\xdb\x00\x43\x00".to_vec();
    file.extend([3; 64]);
    file.extend(b"\xff\xc0\x00\x0b\x08\x00\x08\x00\x20\x01\x01\x11\x00");
    file.extend(b"\xff\xdd\x00\x04\x00\x01");
    file.extend(b"\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00");
    for restart in 0..4 {
        // 001010 and ones.
        file.push(0x2b);
        file.extend([0xff, if restart < 3 { 0xd0 + restart } else { 0xd9 }]);
    }
    file
}

#[test]
fn stream_gives_the_packets_byte_for_byte() {
    // Padding, a missing end marker, an empty packet, and lines like those of the format.
    let odd = [&jpeg(1, 80)[..], b"\r\n--ffmpeg\r\nContent-length: 3\r\n\r\nabc\r\n"].concat();
    let cut = jpeg(2, 90)[..99].to_vec();
    let written = [jpeg(0, 50), odd, cut, Vec::new(), restarted(), jpeg(3, 95)];
    assert_eq!(packets(&stream(&written)), written);
    // The end of the stream is missing.
    let bytes = stream(&written);
    for length in [0, 9, 50, bytes.len() - 3, bytes.len() - 900] {
        let read = packets(&bytes[..length]);
        assert!(read.len() < written.len() && written.starts_with(&read), "{length}");
    }
}

#[test]
fn header_without_a_usable_length_ends_the_stream() {
    let endless = vec![b'a'; 100_000];
    let many_lines = b"a: b\r\n".repeat(MAX_LINES + 1);
    for head in [&b"Content-length: x\r\n\r\n"[..], b"Content-length: 99999999999\r\n\r\n", &endless, &many_lines] {
        assert!(packets(&[head, &stream(&[jpeg(0, 50)])].concat()).is_empty());
    }
    // An unknown length of the header's other lines does no harm.
    assert_eq!(packets(b"--b\r\nX: 1\r\nCONTENT-LENGTH: 2\r\nY: 3\r\n\r\nab\r\n"), [b"ab"]);
}

#[test]
fn picture_has_the_pixels_and_the_coding_of_the_file() {
    for quality in [30, 75, 98] {
        let file = jpeg(5, quality);
        let expected = decode_pixels(&file).unwrap();
        assert_eq!(expected.coding.as_deref(), Some(&jpeg_header::coding(&file).unwrap()));
        let padded = [b"AVI1\xff\x00", &file[..], &[0; 9]].concat();
        for packet in [&file, &padded] {
            assert_eq!(decode(packet, SIZE, Orientation::default()).unwrap(), expected);
        }
        let turned = decode(&file, SIZE, Orientation::of_exif(6)).unwrap();
        assert_eq!((turned.width, turned.height), (SIZE.1, SIZE.0));
        assert_eq!(turned.at(0, 5), expected.at(5, SIZE.1 - 1));
        assert!(turned.coding.is_some_and(|coding| coding.quantization.is_some()));
    }
}

#[test]
fn restart_markers_and_missing_huffman_tables_are_decoded() {
    let pixels = decode(&restarted(), (32, 8), Orientation::default()).unwrap();
    assert_eq!([pixels.at(0, 0), pixels.at(31, 7)], [[128; 3]; 2]);
    assert_eq!(pixels.coding.unwrap().quantization.as_ref().unwrap().steps[0], [3; 64]);
}

#[test]
fn truncated_picture_is_refused_at_every_length() {
    let file = jpeg(7, 90);
    let scan = position(&file, SCAN);
    for length in [0, 2, 40, scan, scan + 20, file.len() / 2, file.len() - 40] {
        assert!(decode(&file[..length], SIZE, Orientation::default()).is_err(), "{length}");
    }
    // All blocks are there.
    assert!(file.ends_with(&END));
    let unmarked = decode(&file[..file.len() - 2], SIZE, Orientation::default()).unwrap();
    assert_eq!(unmarked.codes, decode_pixels(&file).unwrap().codes);
}

#[test]
fn picture_of_another_size_is_refused_with_both_sizes() {
    // As a field of an interlaced frame.
    let error = decode(&jpeg(0, 80), (64, 64), Orientation::default()).unwrap_err();
    assert_eq!(error, "is 64x32; the video is 64x64");
    let error = decode(b"RIFF", SIZE, Orientation::default()).unwrap_err();
    assert_eq!(error, "has no JPEG picture");
}

#[test]
fn arguments_drop_the_packets_before_the_frame() {
    let start = DecodingStart { time_s: 0.2, ticks: -8, tick_s: "1/30".to_owned() };
    let list = |start| arguments(Path::new("v.avi"), start).join(std::ffi::OsStr::new(" ")).into_string().unwrap();
    let sought = list(Some(&start));
    assert!(sought.contains("-ss 0.200000") && sought.contains(r"lt(abs(pts*tb-(-8)*1/30)\,0.5*1/30)"), "{sought}");
    assert!(!list(None).contains("-bsf:v") && list(None).ends_with("-f mpjpeg pipe:1"));
}
