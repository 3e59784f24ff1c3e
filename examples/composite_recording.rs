//! Composites the demo recording into a video.
//!
//! `cargo run --example composite_recording`, from the repository's root.

use std::path::Path;

use locard::export::{Export, Inputs};
use locard::gpu::Gpu;
use locard::recording::OpenOptions;
use locard::shot::{Shot, ShotOptions};
use locard::sink::OutPath;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let options = ShotOptions { scene: Some("scenes/demo.toml".into()), ..ShotOptions::default() };
    let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options)?;
    let frames = 0..shot.recording.frame_count();
    shot.check(frames.clone())?;

    let video = OutPath::parse(Path::new("out/composite_recording.mp4"))?;
    let export = Export { force: true, ..Export::new(frames, video) };
    export.check(&Inputs::of(&shot))?;

    let mut compositor = shot.compositor(Gpu::open()?);
    let exported = export.run(&shot, &mut compositor, |frame| {
        println!("frame {}", frame.frame);
        true
    })?;
    println!("{} frames in out/composite_recording.mp4", exported.frames());
    Ok(())
}
