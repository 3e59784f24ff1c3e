//! Videos of JPEG pictures (Motion JPEG). `ffmpeg` copies the packets, each of which is one JPEG
//! file, and the project's JPEG reader decodes them: pixels and coding are those of a folder of the
//! files.
//!
//! The packets come through a pipe in ffmpeg's multipart format `mpjpeg`. It states the length of
//! each packet, so that neither a truncated picture nor a missing end marker shifts the frames.
//!
//! ffmpeg decodes the frames instead, as of other codecs, if the first packet is not a JPEG of the
//! video's size whose coding is represented (12 bits, arithmetic coding, two fields in a packet),
//! or if colours other than JPEG's are stated.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::sync::Arc;

use super::ffmpeg;
use super::index::DecodingStart;
use super::orientation::Orientation;
use super::oriented_coding::oriented_coding;
use super::still_decoder::decode_pixels;
use super::still_format::JPEG_SIGNATURE;
use crate::coding::{PictureCoding, YcbcrColor};
use crate::pixels::Pixels;
use crate::program::Running;

/// Longest header line of a packet, bytes.
const MAX_LINE_BYTES: u64 = 256;
/// Largest number of header lines of a packet.
const MAX_LINES: usize = 16;
/// Largest packet, bytes.
const MAX_PACKET_BYTES: u64 = 256 << 20;

/// ffmpeg's arguments for the packets from the one at `start`, or all packets of the file.
pub(super) fn arguments(file: &Path, start: Option<&DecodingStart>) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = ["-nostdin", "-v", "error"].map(OsString::from).into();
    if let Some(DecodingStart { time_s, .. }) = start {
        let seek = ["-copyts", "-seek_timestamp", "1", "-noaccurate_seek", "-ss", &format!("{time_s:.6}")];
        arguments.extend(seek.map(OsString::from));
    }
    arguments.extend(ffmpeg::input(file));
    let copy = ["-map", "0:v:0", "-c:v", "copy", "-copyinkf:v", "-copypriorss:v", "1"];
    arguments.extend(copy.map(OsString::from));
    if let Some(DecodingStart { ticks, tick_s, .. }) = start {
        // Drops the packets before the frame's. If seeking fails to land before it, all of them.
        let is_frame = format!("lt(abs(pts*tb-({ticks})*{tick_s})\\,0.5*{tick_s})");
        let dropped = format!("noise=drop='not(st(0\\,max(ld(0)\\,{is_frame})))'");
        arguments.extend(["-bsf:v", &dropped].map(OsString::from));
    }
    arguments.extend(["-f", "mpjpeg", "pipe:1"].map(OsString::from));
    arguments
}

/// The packets of a multipart stream. Ends with the stream, and where it is truncated.
#[derive(Debug)]
pub(super) struct Packets<R> {
    stream: R,
}

impl<R: Read> Packets<BufReader<R>> {
    pub(super) fn new(stream: R) -> Self {
        Self { stream: BufReader::new(stream) }
    }
}

impl<R: BufRead> Packets<R> {
    /// The length in a packet's header, which ends with an empty line. Empty lines before it belong
    /// to the packet before.
    fn length(&mut self) -> Option<u64> {
        let mut length = None;
        for _ in 0..MAX_LINES {
            let mut line = Vec::new();
            self.stream.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line).ok()?;
            let line = std::str::from_utf8(line.strip_suffix(b"\n")?).ok()?.trim_end();
            match (line.split_once(':'), length) {
                (Some((name, value)), _) if name.eq_ignore_ascii_case("content-length") => {
                    length = Some(value.trim().parse().ok().filter(|length| *length <= MAX_PACKET_BYTES)?);
                }
                (None, Some(_)) if line.is_empty() => return length,
                _ => {}
            }
        }
        None
    }
}

impl<R: BufRead> Iterator for Packets<R> {
    type Item = Vec<u8>;

    fn next(&mut self) -> Option<Vec<u8>> {
        let length = self.length()?;
        let mut packet = Vec::new();
        self.stream.by_ref().take(length).read_to_end(&mut packet).ok()?;
        (packet.len() as u64 == length).then_some(packet)
    }
}

/// The picture of a packet, of `size` px as stored. Bytes before the JPEG's start and after its end
/// are ignored, and omitted Huffman tables are those of the standard. The error describes the
/// problem.
pub(super) fn decode(packet: &[u8], size: (u32, u32), orientation: Orientation) -> Result<Pixels, String> {
    let start = packet.windows(JPEG_SIGNATURE.len()).position(|bytes| bytes == JPEG_SIGNATURE);
    let jpeg = start.and_then(|at| packet.get(at..)).ok_or("has no JPEG picture")?;
    let pixels = decode_pixels(jpeg)?;
    if (pixels.width, pixels.height) != size {
        let ((w, h), Pixels { width, height, .. }) = (size, pixels);
        return Err(format!("is {width}x{height}; the video is {w}x{h}"));
    }
    let coding = pixels.coding.as_deref().and_then(|coding| oriented_coding(coding, orientation, size.into()));
    let pixels = orientation.apply(pixels);
    Ok(Pixels { coding: coding.map(Arc::new), ..pixels })
}

/// The coding of the first frame, if the frames are to be decoded here: a JPEG of the video's size
/// and colours. `None` also if ffmpeg fails; then its own decoding reports the problem.
pub(super) fn first_coding(
    file: &Path,
    size: (u32, u32),
    orientation: Orientation,
    color: YcbcrColor,
) -> Option<PictureCoding> {
    let mut running = Running::start("ffmpeg", &arguments(file, None)).ok()?;
    let packet = Packets::new(running.take_stdout()?).next()?;
    let pixels = decode(&packet, size, orientation).ok()?;
    let coding = pixels.coding.as_deref().cloned()?;
    // A grey picture has no matrix.
    let matches = coding.color.range == color.range && (coding.chroma.is_none() || coding.color == color);
    matches.then_some(coding)
}

#[cfg(test)]
mod tests;
