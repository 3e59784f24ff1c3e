//! Cost of a frame in the whole program, from PNG files to raw frames, relative to compositing
//! alone.
//!
//! `cargo bench --bench whole_program [-- FRAMES]`. The load is that of `locard bench`, over the
//! demonstration's frames as PNG. Decoding, GPU work, readback and writing overlap; the ratio shows
//! the part that does not.

use std::borrow::Cow;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use locard::bench::{ALL_EFFECTS, INTERVAL_S, Load, bench};
use locard::compositor::{Compositor, IN_FLIGHT, Settings, StreamFrame, StreamInputs};
use locard::frame::Frame;
use locard::gpu::Gpu;
use locard::recording::{OpenOptions, Recording, RecordingError};
use locard::sink::raw::RawSink;
use locard::sink::{Sink, SinkOptions};
use locard::source::presentation::Presentation;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;
/// Shader compilation and texture creation happen during these frames.
const WARM_UP: usize = 10;

/// Writes a recording of this number of PNG files, repeating the demonstration's frames.
fn write_recording(folder: &Path, frames: usize) -> Result<()> {
    let mut sources: Vec<_> = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/demo/rgb"))?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()?;
    sources.sort();
    let mut list = std::fs::File::create(folder.join("rgb.txt"))?;
    for n in 0..frames {
        let name = format!("{n:04}.png");
        if n < sources.len() {
            image::open(&sources[n])?.to_rgb8().save(folder.join(&name))?;
        } else {
            std::fs::copy(folder.join(format!("{:04}.png", n % sources.len())), folder.join(&name))?;
        }
        writeln!(list, "{:.6} {name}", n as f64 * INTERVAL_S)?;
    }
    std::fs::write(folder.join("recording.toml"), "version = 1\n[frames]\nlist = \"rgb.txt\"\n")?;
    Ok(())
}

fn main() -> Result<()> {
    // Tests build this benchmark too, and run it without the flag.
    if !std::env::args().any(|a| a == "--bench") {
        return Ok(());
    }
    let frames = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(150);
    let gpu = Gpu::open()?;
    let alone = bench(&gpu, WIDTH, HEIGHT, Some(ALL_EFFECTS))?;
    let alone = alone.iter().find(|row| row.name == ALL_EFFECTS).context("no row for all effects")?;

    let folder = tempfile::tempdir()?;
    write_recording(folder.path(), frames)?;
    let recording = Recording::open(folder.path(), &OpenOptions::default())?;
    let load = Load::new(WIDTH, HEIGHT);
    let mut compositor = Compositor::new(gpu, load.scene);
    let options = SinkOptions {
        force: false,
        fps: 30.0,
        times_s: None,
        presentation: Presentation::default(),
        lossless: false,
        codec: None,
        soundtrack: None,
        label: None,
        width: WIDTH,
        height: HEIGHT,
        bits: 8,
    };
    let mut sink = RawSink::new(std::io::sink(), &options);
    // The load's poses cover only a moment: every frame is drawn at its middle.
    let settings = Settings::default();
    let inputs = StreamInputs {
        camera: Cow::Borrowed(&load.camera),
        settings: &settings,
        track: &load.track,
        want_layers: false,
        in_flight: IN_FLIGHT,
    };
    let frames_in = recording.frames(0..frames)?.map(|frame| {
        let frame = Frame { timestamp_s: 0.0, ..frame? };
        Ok::<_, RecordingError>(StreamFrame { frame, geometry: load.geometry.clone(), interval_s: INTERVAL_S })
    });
    let mut start = Instant::now();
    let mut count = 0;
    for done in compositor.composite_stream(inputs, frames_in) {
        let done = done?;
        sink.write(done.frame, &done.pixels)?;
        count += 1;
        if count == WARM_UP {
            start = Instant::now();
        }
    }
    let ms = start.elapsed().as_secs_f64() * 1e3 / (count - WARM_UP) as f64;
    println!("a frame alone, upload to readback     {:8.2} ms {:7.2} copies", alone.ms, alone.copies);
    println!("a frame of {frames}, PNG to raw               {ms:8.2} ms {:7.2} times that", ms / alone.ms);
    Ok(())
}
