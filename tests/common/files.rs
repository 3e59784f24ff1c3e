//! Pictures and recordings on disk.

use std::path::{Path, PathBuf};

use locard::frame::Frame;
use locard::pixels::Pixels;
use locard::recording::{OpenOptions, Recording};
use locard::sink::{self, OutPath, SinkOptions};
use locard::source::presentation::Presentation;

/// A picture with pseudo-random codes, which differ in every frame.
pub fn picture(frame: usize, width: u32, height: u32, bits: u32) -> Pixels {
    let code = |i: usize| (i * 40_503 + frame * 7_919) % 65_521;
    let count = 3 * width as usize * height as usize;
    match bits {
        8 => Pixels::from_u8(width, height, (0..count).map(|i| code(i) as u8).collect()).unwrap(),
        _ => Pixels::from_u16(width, height, (0..count).map(|i| code(i) as u16).collect()).unwrap(),
    }
}

pub fn options(width: u32, height: u32, bits: u32) -> SinkOptions {
    let presentation = Presentation::default();
    SinkOptions {
        force: false,
        fps: 30.0,
        times_s: None,
        presentation,
        lossless: true,
        codec: None,
        soundtrack: None,
        label: None,
        width,
        height,
        bits,
    }
}

pub fn write(path: &Path, options: &SinkOptions, pictures: &[Pixels]) {
    let mut sink = sink::open(&OutPath::parse(path).unwrap(), options).unwrap();
    for (i, pixels) in pictures.iter().enumerate() {
        sink.write(i, pixels).unwrap();
    }
    sink.finish().unwrap();
}

pub fn open(path: &Path) -> Recording {
    Recording::open(path, &OpenOptions::default()).unwrap()
}

pub fn refused(path: &Path) -> String {
    Recording::open(path, &OpenOptions::default()).unwrap_err().to_string()
}

pub fn frames(recording: &Recording, range: std::ops::Range<usize>) -> Vec<Frame> {
    recording.frames(range).unwrap().map(Result::unwrap).collect()
}

pub fn describe(folder: &Path, rest: &str) -> PathBuf {
    std::fs::write(folder.join("recording.toml"), format!("version = 1\n{rest}")).unwrap();
    folder.to_owned()
}
