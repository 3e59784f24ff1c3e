//! Report of a noise calibration as a table.

use super::bins::BinReport;
use super::noise::{NoiseCalibration, SceneMotion};
use crate::text::count;
use std::fmt;

fn cell(bin: &BinReport) -> String {
    match bin.sigma_ci95 {
        Some([low, high]) => format!("{:7.3} [{low:6.3} {high:6.3}] {:9.0}", bin.sigma, bin.independent_count),
        None => format!("{:7.3}  from neighbours {:9.0}", bin.sigma, bin.independent_count),
    }
}

impl fmt::Display for NoiseCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [red, green, blue] = &self.bins;
        let (frames, left_out) = (count(self.frames, "frame"), 100.0 * self.excluded_share);
        match self.motion {
            SceneMotion::Resting => writeln!(
                f,
                "{}, {frames}; {left_out:.2} % of the pixels moved or drifted and are left out",
                count(self.scenes, "scene")
            )?,
            SceneMotion::Moving => writeln!(
                f,
                "{frames} of a moving camera; noise from textureless places: {left_out:.2} % of the blocks are left out"
            )?,
        }
        writeln!(f, "sigma in 8-bit codes [95 % interval] and independent samples, for each channel")?;
        writeln!(f, "{:>11}   {:^33}   {:^33}   {:^33}", "codes", "R", "G", "B")?;
        for ((r, g), b) in red.iter().zip(green).zip(blue) {
            let clipped = [r, g, b].iter().map(|b| b.clipped_share).fold(0.0, f64::max);
            let note = if clipped > 0.001 { format!("   {:.1} % clipped", 100.0 * clipped) } else { String::new() };
            let [low, high] = r.code_range;
            writeln!(f, "{low:5.0}-{high:5.0}   {}   {}   {}{note}", cell(r), cell(g), cell(b))?;
        }
        let [rg, rb, gb] = self.profile.channel_correlation;
        let [right, below] = self.profile.neighbour_correlation;
        writeln!(
            f,
            "correlation of channels: R-G {rg:.3}, R-B {rb:.3}, G-B {gb:.3}; of neighbours: right {right:.3}, below {below:.3}"
        )?;
        for warning in &self.warnings {
            writeln!(f, "note: {warning}")?;
        }
        Ok(())
    }
}
