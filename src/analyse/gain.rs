//! Gain of each frame: exposure, sensor gain and white balance that the camera changes by itself.
//!
//! Points are matched between two frames by depth, or by landmarks of the recording. The log ratio
//! of a point's light is the gain between the frames, for each colour channel. A pair has the
//! median ℓ_ij over its points. All frames are solved jointly:
//!
//!   min Σ w·ρ_Cauchy(ℓ_ij − (g_j − g_i); 0.01),   w⁻² = 0.003² + 20·MAD²/n + (0.0005·gap)²
//!
//! Poses that registration refused are unsure. A pair then needs matching points, and a second
//! comparison of the same pictures with the camera assumed at rest, pixel by pixel. If the pixels
//! at rest do not match, the pair confirms the poses. If they match with the same gain, the gain
//! does not depend on the poses. Otherwise the pair is rejected.
//!
//! The points of a pair match if their log ratios scatter by less than half of the scatter s of
//! their light. Both scatters contain the noise n of the smoothed pictures, which is taken into
//! account:
//!
//!   scatter² < max(0.05, ½·√(s² − n²))² + (1.2·√2·n)²
//!
//! Only flat areas are used, which limits the effect of blur and of misalignment. The response's
//! exponent cancels, because ratios are measured and applied by one curve. Gain that varies within
//! the picture: [`spatial_gain`]. Not modelled: flickering lamps, moving objects that fill the
//! frame.

mod prepare;

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::camera_model::CameraModel;
use super::capture_info::CaptureInfo;
use super::noise_level::{share_kept, variance_bound};
use super::spatial_gain::{self, SpatialGainPair};
use super::state::{CameraState, project_rolling_shutter};
use super::tone::{self, ToneSample};
use crate::camera::{NoiseProfile, Response};
use crate::fit::quantile::{median_and_sigma, upper_median};
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::parallel::over_rows;
use crate::recording::Landmark;
use crate::text::count;

/// Distances between compared frames.
pub const GAPS: [usize; 6] = [1, 2, 5, 10, 20, 40];
/// Largest width of the reduced pictures, px.
const MAX_WIDTH_PX: usize = 400;
/// Largest number of points in a frame.
const MAX_POINTS: usize = 8000;
/// Limits of usable codes, of 255.
const MIN_CODE: f32 = 15.0;
const MAX_CODE: f32 = 240.0;
/// Largest gradient of a flat area, codes per px of the reduced picture.
const MAX_GRADIENT: f32 = 5.0;
/// σ of the blur of the reduced picture, px.
const BLUR_PX: f32 = 1.0;
/// Largest relative difference between depths of one surface.
const DEPTH_TOLERANCE: f64 = 0.03;
/// Smallest numbers of matched points or landmarks in a pair.
const MIN_POINTS: usize = 150;
const MIN_LANDMARKS: usize = 50;
/// Largest number of landmarks in a frame; all frames use the same ones.
const MAX_LANDMARKS: usize = 4000;
/// Largest scatter of the log ratios of matching points, relative to the scatter of the log of
/// their light.
const MAX_RELATIVE_SCATTER: f64 = 0.5;
/// Scatter of the log ratios that is accepted of any points, ln.
const ACCEPTED_SCATTER_LN: f64 = 0.05;
/// Tolerance of the known noise, as a factor of its σ.
const NOISE_TOLERANCE: f64 = 1.2;
/// A gain does not depend on the poses if a camera at rest gives the same one within this, ln, or
/// within this many σ.
const AT_REST_TOLERANCE_LN: f64 = 0.005;
const AT_REST_TOLERANCE_SIGMAS: f64 = 2.0;
/// Smallest number of pairs that confirm unsure poses, and smallest fraction of the pairs that
/// could contradict them.
const MIN_CONFIRMING_PAIRS: usize = 12;
const MIN_CONFIRMING_SHARE: f64 = 0.75;

/// A frame as it is compared with others.
struct GainFrame {
    index: usize,
    state: CameraState,
    /// Red, green, blue, codes of 255.
    colours: [GreyImage; 3],
    /// σ of the noise in `colours`, codes of 255.
    noise: [f64; 3],
    depth: Vec<f32>,
    points: Vec<GainPoint>,
    /// Frames in ascending order of their numbers.
    landmarks: Vec<(u64, PixelSample)>,
}

struct GainPoint {
    /// Position in the camera's axes at the middle row's time, m.
    at: DVec3,
    sample: PixelSample,
}

#[derive(Clone, Copy)]
struct PixelSample {
    /// Position as fractions of width and height.
    at: [f32; 2],
    /// ln of light, and codes of 255, by channel.
    light: [f64; 3],
    codes: [f32; 3],
}

/// Log ratio of light between two frames.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Pair {
    pub from: usize,
    pub to: usize,
    /// ln of `to`'s light by `from`'s: red, green, blue.
    pub ratio: [f64; 3],
    /// One standard deviation of each.
    pub sigma: [f64; 3],
}

/// Numbers of compared pairs by result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PairCounts {
    pub pairs: usize,
    /// Pairs with too few common flat areas.
    pub few: usize,
    /// Pairs with inconsistent points.
    pub unlike: usize,
    /// Pairs with uncertain poses whose points match by the poses only.
    pub confirming: usize,
    /// Pairs with uncertain poses whose gain depends on the poses.
    pub unsure: usize,
}

impl PairCounts {
    /// True if enough pairs confirm unsure poses: their points match by the poses and not without
    /// them.
    pub fn confirms_poses(&self) -> bool {
        let decisive = (self.confirming + self.unlike) as f64;
        self.confirming >= MIN_CONFIRMING_PAIRS && self.confirming as f64 >= MIN_CONFIRMING_SHARE * decisive
    }

    /// The reason for which no gain is known, if no pair has a ratio.
    pub fn why(&self) -> String {
        let Self { pairs, few, unlike, unsure, .. } = self;
        if *pairs == 0 {
            return "no frames could be compared".to_owned();
        }
        let few = format!(
            "{few} have fewer than {MIN_POINTS} flat places with depth, or {MIN_LANDMARKS} landmarks, in common"
        );
        let unsure = match unsure {
            0 => String::new(),
            _ => format!(", {unsure} have a gain that depends on uncertain poses"),
        };
        format!(
            "of {} of frames {few}, {unlike} do not match at the positions given by the poses{unsure}",
            count(*pairs, "pair")
        )
    }
}

/// Compares frames, which are added in order.
pub struct Gains<'a> {
    model: &'a CameraModel,
    response: Response,
    noise: Option<NoiseProfile>,
    threads: usize,
    gaps: &'a [usize],
    /// Whether registration refused the poses.
    is_unsure: bool,
    window: VecDeque<GainFrame>,
    pub pairs: Vec<Pair>,
    pub tone_samples: Vec<ToneSample>,
    pub across: Vec<SpatialGainPair>,
    pub counts: PairCounts,
}

/// Result of a pair.
struct PairComparison {
    pair: Pair,
    tone_samples: Vec<ToneSample>,
    across: Option<SpatialGainPair>,
    /// Whether the points match by the poses and not without them.
    confirms: bool,
}

type PairResult = Result<PairComparison, PairFailure>;

/// Why a pair has no ratio.
enum PairFailure {
    /// Too few common flat areas.
    TooFew,
    /// The points do not match.
    Mismatch,
    /// The gain depends on unsure poses.
    UnsurePoses,
}

impl<'a> Gains<'a> {
    /// `is_unsure`: whether registration refused the poses.
    pub fn new(
        model: &'a CameraModel,
        capture: &CaptureInfo<'_>,
        gaps: &'a [usize],
        is_unsure: bool,
        threads: usize,
    ) -> Self {
        Self {
            model,
            response: capture.response.clone(),
            noise: capture.noise.cloned(),
            threads,
            gaps,
            is_unsure,
            window: VecDeque::new(),
            pairs: Vec::new(),
            tone_samples: Vec::new(),
            across: Vec::new(),
            counts: PairCounts::default(),
        }
    }

    /// `depth`: at the frame's time and pixels. `landmarks`: those of the recording in this frame.
    pub fn add(&mut self, frame: &Frame, state: CameraState, depth: &[f32], landmarks: &[Landmark]) {
        let new = self.prepare_frame(frame, state, depth, landmarks);
        let window = &self.window;
        let mut results: Vec<(usize, PairResult)> = self
            .gaps
            .iter()
            .filter_map(|gap| window.iter().position(|old| old.index + gap == new.index))
            .map(|old| (old, Err(PairFailure::TooFew)))
            .collect();
        over_rows(&mut results, 1, self.threads, |_, slot| slot[0].1 = self.compared(&window[slot[0].0], &new));
        for (_, compared) in results {
            self.counts.pairs += 1;
            match compared {
                Ok(PairComparison { pair, tone_samples, across, confirms }) => {
                    self.counts.confirming += usize::from(confirms);
                    self.pairs.push(pair);
                    self.tone_samples.extend(tone_samples);
                    self.across.extend(across);
                }
                Err(PairFailure::TooFew) => self.counts.few += 1,
                Err(PairFailure::UnsurePoses) => self.counts.unsure += 1,
                Err(PairFailure::Mismatch) => self.counts.unlike += 1,
            }
        }
        let reach = self.gaps.iter().copied().max().unwrap_or(0);
        self.window.push_back(new);
        while self.window.front().is_some_and(|old| old.index + reach <= frame.index) {
            self.window.pop_front();
        }
    }

    /// Upper bound on the noise of a reduced, smoothed picture, codes
    /// ([`noise_level`](super::noise_level)). The profile's bound ignores the blur that follows the
    /// halvings.
    fn noise_sigma(&self, plane: &GreyImage, channel: usize, halvings: usize) -> f64 {
        let by_profile = self.noise.as_ref().map(|profile| {
            let mean = plane.values.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.values.len().max(1) as f64;
            profile.sigma(channel, mean).powi(2) * share_kept(profile, halvings)
        });
        variance_bound(by_profile, plane).sqrt()
    }

    fn sample(&self, at: [f32; 2], codes: [f32; 3]) -> PixelSample {
        PixelSample { at, light: codes.map(|code| self.light(code)), codes }
    }

    fn light(&self, code: f32) -> f64 {
        self.response.decode(f64::from(code) / 255.0).max(1e-9).ln()
    }

    /// Samples of the points that are visible in both frames.
    fn match_by_depth(
        &self,
        from: &GainFrame,
        to: &GainFrame,
        to_state: &CameraState,
    ) -> Vec<(PixelSample, PixelSample)> {
        let motion = to_state.world_from_camera.inverse() * from.state.world_from_camera;
        let (w, h) = (to.colours[0].width, to.colours[0].height);
        let scale = (1usize << self.halvings()) as f64;
        let pair = |point: &GainPoint| {
            let there = motion.transform_point3(point.at);
            if there.z <= 0.0 {
                return None;
            }
            let (at, far) = project_rolling_shutter(&self.model.geometry, there, &to_state.twist, None, 2)?;
            let (x, y) = ((at.x - 0.5) / scale, (at.y - 0.5) / scale);
            if !(x >= 2.0 && y >= 2.0 && x < w as f64 - 3.0 && y < h as f64 - 3.0) {
                return None;
            }
            let depth = f64::from(to.depth[y.round() as usize * w + x.round() as usize]);
            if depth <= 0.0 || (depth - far).abs() > DEPTH_TOLERANCE * far + self.model.depth_tolerance_m(far) {
                return None;
            }
            let codes = [0, 1, 2].map(|c| to.colours[c].sample_inside(x as f32, y as f32).unwrap_or(0.0));
            let is_sound = codes.iter().all(|code| *code > MIN_CODE && *code < MAX_CODE);
            is_sound.then(|| (point.sample, self.sample([x as f32 / w as f32, y as f32 / h as f32], codes)))
        };
        from.points.iter().filter_map(pair).collect()
    }

    /// σ of ln light by the pictures' noise, root mean square of the two frames, at the median
    /// code.
    fn log_noise(&self, matches: &[(PixelSample, PixelSample)], of: [&GainFrame; 2], channel: usize) -> f64 {
        let codes = matches.iter().map(|(from, _)| f64::from(from.codes[channel]));
        let code = upper_median(codes).unwrap_or(0.0) as f32;
        let per_code = 0.5 * (self.light(code + 1.0) - self.light(code - 1.0));
        per_code * of.map(|other| other.noise[channel]).into_iter().fold(0.0, f64::hypot) / 2f64.sqrt()
    }

    fn compared(&self, from: &GainFrame, to: &GainFrame) -> PairResult {
        let mut matches = match_by_landmarks(from, to);
        // Matches by landmarks do not depend on poses.
        let mut is_unsure = false;
        if matches.len() < MIN_LANDMARKS {
            is_unsure = self.is_unsure;
            matches = self.match_by_depth(from, to, &to.state);
            if matches.len() < MIN_POINTS {
                return Err(PairFailure::TooFew);
            }
        }
        let gap = from.index.abs_diff(to.index);
        // No allowance for noise with unsure poses: a plain floor matches everywhere.
        let noise = if is_unsure { [0.0; 3] } else { [0, 1, 2].map(|c| self.log_noise(&matches, [from, to], c)) };
        let (ratios, Ratio { ratio, sigma }) = ratio(&matches, noise, gap)?;
        let mut confirms = false;
        if is_unsure {
            // With the camera assumed at rest.
            let at_rest = self.match_by_depth(from, to, &from.state);
            match ratio_if_any(&at_rest, noise, gap) {
                None => return Err(PairFailure::TooFew),
                Some(Err(_)) => confirms = true,
                Some(Ok(other)) => {
                    let is_same = |c: usize| {
                        (other.ratio[c] - ratio[c]).abs()
                            < AT_REST_TOLERANCE_LN.max(AT_REST_TOLERANCE_SIGMAS * sigma[c])
                    };
                    if !(0..3).all(is_same) {
                        return Err(PairFailure::UnsurePoses);
                    }
                }
            }
        }
        let mean = |of: &[f64; 3]| of.iter().sum::<f64>() / 3.0;
        let is_used = |gap: usize| spatial_gain::GAPS.contains(&gap) || spatial_gain::HELD_OUT.contains(&gap);
        let across = is_used(to.index - from.index).then(|| {
            let sample = |((from, to), of): (&(PixelSample, PixelSample), &[f64; 3])| spatial_gain::RatioSample {
                from: from.at,
                to: to.at,
                ratio: mean(of),
            };
            let samples: Vec<_> = matches.iter().zip(&ratios).map(sample).collect();
            spatial_gain::of_pair(from.index, to.index, &samples, mean(&ratio))
        });
        let codes = matches.iter().map(|(from, to)| [0, 1, 2].map(|c| 0.5 * (from.codes[c] + to.codes[c])));
        let tone_samples = tone::of_pair(to.index, codes.zip(ratios.iter().copied()), ratio);
        let pair = Pair { from: from.index, to: to.index, ratio, sigma };
        Ok(PairComparison { pair, tone_samples, across, confirms })
    }
}

/// Log ratio of light between two frames, with one standard deviation, by channel.
struct Ratio {
    ratio: [f64; 3],
    sigma: [f64; 3],
}

/// Log ratios of the matched samples of two frames `gap` apart, and their median. `noise`: σ of a
/// sample's ln light by the pictures' noise, by channel.
fn ratio(
    matches: &[(PixelSample, PixelSample)],
    noise: [f64; 3],
    gap: usize,
) -> Result<(Vec<[f64; 3]>, Ratio), PairFailure> {
    let ratios: Vec<[f64; 3]> =
        matches.iter().map(|(from, to)| [0, 1, 2].map(|c| to.light[c] - from.light[c])).collect();
    let green = matches.iter().map(|(from, _)| from.light[1]);
    let texture = (median_and_sigma(green).1.powi(2) - noise[1].powi(2)).max(0.0).sqrt();
    let (mut ratio, mut sigma) = ([0.0; 3], [0.0; 3]);
    for c in 0..3 {
        let (middle, spread) = median_and_sigma(ratios.iter().map(|of| of[c]));
        if spread
            > ACCEPTED_SCATTER_LN.max(MAX_RELATIVE_SCATTER * texture).hypot(NOISE_TOLERANCE * 2f64.sqrt() * noise[c])
        {
            return Err(PairFailure::Mismatch);
        }
        ratio[c] = middle;
        sigma[c] =
            (0.003f64.powi(2) + 20.0 * spread * spread / matches.len() as f64 + (0.0005 * gap as f64).powi(2)).sqrt();
    }
    Ok((ratios, Ratio { ratio, sigma }))
}

/// The [`ratio`], or `None` for too few samples.
fn ratio_if_any(
    matches: &[(PixelSample, PixelSample)],
    noise: [f64; 3],
    gap: usize,
) -> Option<Result<Ratio, PairFailure>> {
    (matches.len() >= MIN_POINTS).then(|| ratio(matches, noise, gap).map(|(_, ratio)| ratio))
}

/// Samples of the landmarks that both frames have.
fn match_by_landmarks(from: &GainFrame, to: &GainFrame) -> Vec<(PixelSample, PixelSample)> {
    let (mut matches, mut others) = (Vec::new(), to.landmarks.iter().peekable());
    for (number, sample) in &from.landmarks {
        while others.next_if(|(other, _)| other < number).is_some() {}
        if let Some((_, other)) = others.peek().filter(|(other, _)| other == number) {
            matches.push((*sample, *other));
        }
    }
    matches
}

#[cfg(test)]
mod tests {
    use super::super::blur_frame::unit_noise;
    use super::*;

    /// Samples of one brightness with independent noise in both frames, ln.
    fn matches(noise: f64, step: f64) -> Vec<(PixelSample, PixelSample)> {
        let sample = |light: f64| PixelSample { at: [0.0; 2], light: [light; 3], codes: [110.0; 3] };
        let noises = unit_noise(800, 1, 1, [0.0; 2]).values;
        let pair = |of: &[f32]| (sample(noise * f64::from(of[0])), sample(step + noise * f64::from(of[1])));
        noises.chunks(2).map(pair).collect()
    }

    #[test]
    fn known_noise_does_not_prevent_the_match() {
        // √2 · 0.06 is more than 0.05, and than half of the light's own scatter.
        let of = matches(0.06, 0.3);
        let (_, gain) = ratio(&of, [0.06; 3], 1).unwrap_or_else(|_| panic!("refused"));
        assert!((gain.ratio[1] - 0.3).abs() < 3.0 * gain.sigma[1] && gain.sigma[1] < 0.03, "{:?}", gain.ratio);
        assert!(ratio(&of, [0.0; 3], 1).is_err(), "unknown noise is a mismatch");
        assert!(ratio(&of, [0.03; 3], 1).is_err(), "twice the known noise");
    }
}
