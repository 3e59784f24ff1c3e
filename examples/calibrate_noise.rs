//! Calibrates a camera's noise from frames of a static scene.
//!
//! `cargo run --example calibrate_noise -- FOLDER`, with a folder of PNG or JPEG files.

use std::ops::ControlFlow;
use std::path::PathBuf;

use locard::calibrate::{NoiseOptions, noise_from_paths};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("give a folder of frames")?);
    let calibration = noise_from_paths(&[folder], &[], &NoiseOptions::default(), &mut |done, all| {
        println!("{done} of {all} frames");
        ControlFlow::Continue(())
    })?;
    for warning in &calibration.warnings {
        println!("warning: {warning}");
    }
    for code in [32.0, 64.0, 128.0, 192.0] {
        let sigma = [0, 1, 2].map(|channel| calibration.profile.sigma(channel, code));
        println!("code {code}: sigma {sigma:.2?} codes of 8 bits");
    }
    Ok(())
}
