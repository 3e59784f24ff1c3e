//! Calibrates a camera's noise from pictures, a recording or a video.
//!
//! `cargo run --example calibrate_noise -- INPUT`

use std::ops::ControlFlow;
use std::path::PathBuf;

use locard::calibrate::{NoiseOptions, NoiseSource, noise_from_paths};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let input = PathBuf::from(std::env::args().nth(1).ok_or("give pictures, a recording or a video")?);
    let calibration = noise_from_paths(&[input], NoiseSource::Best, &NoiseOptions::default(), &mut |done, all| {
        println!("{done} of {all} frames");
        ControlFlow::Continue(())
    })?;
    for warning in &calibration.table.warnings {
        println!("warning: {warning}");
    }
    for code in [32.0, 64.0, 128.0, 192.0] {
        let sigma = [0, 1, 2].map(|channel| calibration.table.profile.sigma(channel, code));
        println!("code {code}: sigma {sigma:.2?} codes of 8 bits");
    }
    Ok(())
}
