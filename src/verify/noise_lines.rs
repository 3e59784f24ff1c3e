//! The comparison of noise as lines of text.

use super::noise::NoiseComparison;
use super::noise_figures::RealAndVirtual;
use crate::text::{count, fixed};

impl NoiseComparison {
    /// Labels and texts: the verdict first, then figures, then a line for each detector.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let pair = |pair: &RealAndVirtual| format!("{} (real {})", fixed(pair.virtual_, 2), fixed(pair.real, 2));
        let ratio = |pair: &RealAndVirtual| match pair.ratio() {
            ratio if ratio.is_finite() => fixed(ratio, 2),
            _ => "–".to_owned(),
        };
        let mut lines = vec![("noise", self.verdict())];
        if let Some((median, worst)) = self.figures.sigma_ratio() {
            let channel = ["red", "green", "blue"][worst.channel];
            let (code, worst) = (fixed(worst.code, 0), ratio(&worst.sigma));
            lines.push(("  σ", format!("{} of real, worst {worst} ({channel} at code {code})", fixed(median, 2))));
        }
        let octaves = self.figures.octaves.each_ref().map(ratio).join(", ");
        lines.push(("  octaves", format!("power {octaves} of real, fine to coarse")));
        let [red_green, red_blue, green_blue] = self.figures.channel_correlation.each_ref().map(pair);
        lines.push(("  channels", format!("correlation R-G {red_green}, R-B {red_blue}, G-B {green_blue}")));
        lines.push(("  tails", format!("excess kurtosis {}", pair(&self.figures.kurtosis))));
        if self.has_blocks {
            lines.push(("  blocks", format!("contrast at edges {}", pair(&self.figures.block_contrast))));
        }
        let [virtual_, real] = [self.repeats.virtual_, self.repeats.real].map(|number| fixed(number, 0));
        lines.push(("  repeats", format!("{virtual_} (real {real}) of {}", count(self.repeat_tiles, "tile"))));
        lines.extend(self.scores.iter().map(|score| ("  detector", score.to_string())));
        lines
    }

    fn verdict(&self) -> String {
        let strongest = self.strongest().map_or(String::new(), |score| format!(" by {score}"));
        format!(
            "{}{strongest}; mean of {} {}, 0.5 is chance; {} flat patches in {}",
            if self.is_separated() { "separated" } else { "not separated" },
            count(self.scores.len(), "detector"),
            fixed(self.mean_auc(), 2),
            self.patches,
            count(self.frames.len(), "frame")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::detectors::{DetectorClassifier, DetectorFamily};
    use crate::verify::{NoiseFigures, NoiseScore, SigmaBin};

    #[test]
    fn lines_have_the_verdict_first_and_blocks_only_where_there_are_any() {
        let pair = |real: f64, virtual_: f64| RealAndVirtual { real, virtual_ };
        let score = |classifier, auc| NoiseScore {
            family: DetectorFamily::BlockDct,
            classifier,
            auc,
            standard_error: 0.02,
            floor: 0.55,
        };
        let mut noise = NoiseComparison {
            frames: vec![3, 9],
            patches: 120,
            figures: NoiseFigures {
                sigma: [(1, 40.0, 1.1), (0, 200.0, 0.5), (2, 8.0, 1.2)]
                    .map(|(channel, code, ratio)| SigmaBin { channel, code, sigma: pair(2.0, 2.0 * ratio) })
                    .to_vec(),
                octaves: [pair(1.0, 1.5), pair(2.0, 2.0), pair(4.0, 1.0), pair(1.0, 0.1)],
                channel_correlation: [pair(0.5, 0.25); 3],
                kurtosis: pair(0.5, 0.0),
                block_contrast: pair(1.1, 1.0),
            },
            has_blocks: false,
            repeats: pair(1.0, 0.0),
            repeat_tiles: 90,
            scores: vec![score(DetectorClassifier::Logistic, 0.9), score(DetectorClassifier::Boosted, 0.7)],
        };
        let lines = noise.lines();
        assert_eq!(
            lines[0].1,
            "separated by block DCT, logistic: 0.90 ± 0.02, floor 0.55; mean of 2 detectors 0.80, 0.5 is chance; \
             120 flat patches in 2 frames"
        );
        assert_eq!(lines[1].1, "1.10 of real, worst 0.50 (red at code 200)");
        assert_eq!(lines[2].1, "power 1.50, 1.00, 0.25, 0.10 of real, fine to coarse");
        assert!(lines.iter().all(|(label, _)| *label != "  blocks"));
        noise.has_blocks = true;
        assert_eq!(noise.lines().len(), lines.len() + 1);
        noise.scores[0].auc = 0.73;
        assert!(noise.lines()[0].1.starts_with("not separated by block DCT, logistic"));
    }
}
