//! How bright each frame is of the same things: exposure, gain and white balance that the camera changes by itself.
//!
//! A point with known depth, or one that a recording itself recognised in its frames, is seen in two of them; the logarithm of its light in one by that in the other is the frames' gain,
//! for each colour. Of each pair the median ℓ_ij over many points; then all frames at once:
//!
//!   least Σ w·ρ_Cauchy(ℓ_ij − (g_j − g_i); 0.01),   w⁻² = 0.003² + 20·MAD²/n + (0.0005·gap)²
//!
//! Poses that registration refused are unsure. There a pair counts if its places match and the same pictures, compared pixel by
//! pixel as if the camera rested, either do not match, which confirms the poses, or say the same gain, which then depends on no pose.
//!
//! The places of a pair are the same things if their log ratios scatter by less than half of their
//! light's own scatter s. Both scatters contain the noise n of the smoothed pictures, which has no
//! part in that comparison:
//!
//!   scatter² < max(0.05, ½·√(s² − n²))² + (1.2·√2·n)²
//!
//! Only flat places count, so that blur and places that are off do little. The response's exponent cancels out of what is done
//! with the result: ratios are taken and given back by one curve. What differs across the picture is `across`'s. Not modelled:
//! lamps that flicker, what moves and fills the frame.

use std::collections::VecDeque;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::across::{self, OfPair};
use super::eye::Eye;
use super::noise_level::{share_kept, variance_bound};
use super::pyramid::{Plane, gaussian};
use super::robust::{median, scatter};
use super::state::{State, moved, seen};
use super::taken::Taken;
use super::tone::{self, Toned};
use super::view::scattered;
use crate::camera::{NoiseProfile, Response};
use crate::frame::Frame;
use crate::parallel::over_rows;
use crate::recording::Landmark;
use crate::text::count;

/// Distances between compared frames.
pub const GAPS: [usize; 6] = [1, 2, 5, 10, 20, 40];
/// Pictures are halved until they are not wider than this, px.
const WIDEST: usize = 400;
/// Points of a frame at most.
const MOST_POINTS: usize = 8000;
/// Points count with codes between, of 255, where the picture is flatter than this, codes per px of the small picture.
const CODES: (f32, f32) = (15.0, 240.0);
const FLAT: f32 = 5.0;
/// σ of the blur over the small picture, px.
const BLUR_PX: f32 = 1.0;
/// A point is the same surface if depth agrees by this share.
const SAME: f64 = 0.03;
/// Fewer points say nothing of a pair; fewer landmarks do not either.
const LEAST_POINTS: usize = 150;
const LEAST_LANDMARKS: usize = 50;
/// Landmarks of a frame at most: the same ones of all.
const MOST_LANDMARKS: usize = 4000;
/// Places are the same things if their ratios scatter by less than this share of their light, or by less than this, ln.
const MATCHED: (f64, f64) = (0.5, 0.05);
/// Tolerance of the noise that is known, as a factor of its σ.
const NOISE_TOLERANCE: f64 = 1.2;
/// The gain of a pair depends on no pose if a camera at rest says the same within this, ln, or within so many σ.
const SAME_AT_REST: f64 = 0.005;
const SAME_AT_REST_SIGMAS: f64 = 2.0;
/// So many pairs confirm unsure poses, and this share of those that could contradict them.
const LEAST_CONFIRMING: usize = 12;
const CONFIRMING: f64 = 0.75;

/// What is kept of a frame for comparing it.
struct Seen {
    index: usize,
    state: State,
    /// Red, green, blue, codes of 255.
    colours: [Plane; 3],
    /// σ of the noise in `colours`, codes of 255.
    noise: [f64; 3],
    depth: Vec<f32>,
    points: Vec<Point>,
    /// Ascending in number.
    landmarks: Vec<(u64, Spot)>,
}

struct Point {
    at: DVec3,
    spot: Spot,
}

/// A place of a picture.
#[derive(Clone, Copy)]
struct Spot {
    /// Shares of width and height.
    at: [f32; 2],
    /// ln of light, and codes of 255.
    light: [f64; 3],
    codes: [f32; 3],
}

/// The logarithm of light from one frame to another.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Pair {
    pub from: usize,
    pub to: usize,
    /// ln of `to`'s light by `from`'s: red, green, blue.
    pub ratio: [f64; 3],
    /// One standard deviation of each.
    pub sigma: [f64; 3],
}

/// What pairs of frames were compared, and how many of them tell nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tried {
    pub pairs: usize,
    /// They have too few flat places in common.
    pub few: usize,
    /// What lies where the poses say is not alike.
    pub unlike: usize,
    /// Of unsure poses: it is alike, and without the poses it is not; and the gain depends on them.
    pub confirming: usize,
    pub unsure: usize,
}

impl Tried {
    /// Whether the places that pictures have in common confirm unsure poses: they match by them and not without them.
    pub fn confirms_poses(&self) -> bool {
        let of = (self.confirming + self.unlike) as f64;
        self.confirming >= LEAST_CONFIRMING && self.confirming as f64 >= CONFIRMING * of
    }

    /// Why nothing is known where no pair tells anything.
    pub fn why(&self) -> String {
        let Self { pairs, few, unlike, unsure, .. } = self;
        if *pairs == 0 {
            return "no frames could be compared".to_owned();
        }
        let few = format!(
            "{few} have fewer than {LEAST_POINTS} flat places with depth, or {LEAST_LANDMARKS} landmarks, in common"
        );
        let unsure = match unsure {
            0 => String::new(),
            _ => format!(", {unsure} say another gain by other poses, and these are not sure"),
        };
        format!("of {} of frames {few}, {unlike} do not match where the poses say{unsure}", count(*pairs, "pair"))
    }
}

/// Compares frames as they come, in order.
pub struct Gains<'a> {
    eye: &'a Eye,
    /// ln of light by code of 255, and the light of a code.
    response: Response,
    noise: Option<NoiseProfile>,
    threads: usize,
    gaps: &'a [usize],
    /// Whether registration refused the poses.
    is_unsure: bool,
    window: VecDeque<Seen>,
    pub pairs: Vec<Pair>,
    /// What they say of the response, and of single places.
    pub toned: Vec<Toned>,
    pub across: Vec<OfPair>,
    pub tried: Tried,
}

/// What a pair says.
struct Compared {
    pair: Pair,
    toned: Vec<Toned>,
    across: Option<OfPair>,
    /// Whether places match by the poses and not without them.
    confirms: bool,
}

type Comparison = Result<Compared, Unknown>;

/// Why a pair tells nothing.
enum Unknown {
    Few,
    Unlike,
    /// The gain depends on poses that are unsure.
    Unsure,
}

impl<'a> Gains<'a> {
    /// `is_unsure`: whether registration refused the poses.
    pub fn new(eye: &'a Eye, taken: &Taken<'_>, gaps: &'a [usize], is_unsure: bool, threads: usize) -> Self {
        Self {
            eye,
            response: taken.response.clone(),
            noise: taken.noise.cloned(),
            threads,
            gaps,
            is_unsure,
            window: VecDeque::new(),
            pairs: Vec::new(),
            toned: Vec::new(),
            across: Vec::new(),
            tried: Tried::default(),
        }
    }

    /// `depth`: at the frame's moment, in its picture. `landmarks`: what the recording recognised in it.
    pub fn add(&mut self, frame: &Frame, state: State, depth: &[f32], landmarks: &[Landmark]) {
        let new = self.seen(frame, state, depth, landmarks);
        let window = &self.window;
        let mut found: Vec<(usize, Comparison)> = self
            .gaps
            .iter()
            .filter_map(|gap| window.iter().position(|old| old.index + gap == new.index))
            .map(|old| (old, Err(Unknown::Few)))
            .collect();
        over_rows(&mut found, 1, self.threads, |_, slot| slot[0].1 = self.compared(&window[slot[0].0], &new));
        for (_, compared) in found {
            self.tried.pairs += 1;
            match compared {
                Ok(Compared { pair, toned, across, confirms }) => {
                    self.tried.confirming += usize::from(confirms);
                    self.pairs.push(pair);
                    self.toned.extend(toned);
                    self.across.extend(across);
                }
                Err(Unknown::Few) => self.tried.few += 1,
                Err(Unknown::Unsure) => self.tried.unsure += 1,
                Err(Unknown::Unlike) => self.tried.unlike += 1,
            }
        }
        let reach = self.gaps.iter().copied().max().unwrap_or(0);
        self.window.push_back(new);
        while self.window.front().is_some_and(|old| old.index + reach <= frame.index) {
            self.window.pop_front();
        }
    }

    fn halvings(&self) -> usize {
        let width = self.eye.size().0;
        (0..).find(|n| width >> n <= WIDEST).unwrap_or(0)
    }

    fn seen(&self, frame: &Frame, state: State, depth: &[f32], landmarks: &[Landmark]) -> Seen {
        let halvings = self.halvings();
        let colours = [0, 1, 2].map(|channel| {
            let mut plane = Plane::of_channel(&frame.pixels, channel);
            for _ in 0..halvings {
                plane = plane.halved();
            }
            plane.filtered(&gaussian(BLUR_PX))
        });
        let noise = [0, 1, 2].map(|channel| self.noise_sigma(&colours[channel], channel, halvings));
        let (w, h) = (colours[0].width, colours[0].height);
        let (width, _) = self.eye.size();
        let scale = 1usize << halvings;
        let small: Vec<f32> = (0..w * h).map(|i| depth[(i / w) * scale * width + (i % w) * scale]).collect();
        let mut sound = Vec::new();
        for y in 2..h.saturating_sub(2) {
            for x in 2..w.saturating_sub(2) {
                let i = y * w + x;
                let is_sound = |plane: &Plane| {
                    let v = &plane.values;
                    let slope = (0.5 * (v[i + 1] - v[i - 1])).hypot(0.5 * (v[i + w] - v[i - w]));
                    v[i] > CODES.0 && v[i] < CODES.1 && slope < FLAT
                };
                if small[i] > 0.0 && colours.iter().all(is_sound) {
                    sound.push(i);
                }
            }
        }
        if sound.len() > MOST_POINTS {
            sound.sort_unstable_by_key(|i| (scattered(*i as u64), *i));
            sound.truncate(MOST_POINTS);
        }
        let point = |i: usize| {
            let (x, y) = ((i % w) * scale, (i / w) * scale);
            let there = f64::from(small[i]) * DVec3::from(self.eye.rays[y * width + x].map(f64::from));
            let at = moved(there, &state.twist, self.eye.geometry.row_time_s(y as f64 + 0.5));
            let codes = [0, 1, 2].map(|c| colours[c].values[i]);
            Point { at, spot: self.spot([(i % w) as f32 / w as f32, (i / w) as f32 / h as f32], codes) }
        };
        let points = sound.into_iter().map(point).collect();
        let mut landmarks: Vec<&Landmark> = landmarks.iter().collect();
        if landmarks.len() > MOST_LANDMARKS {
            landmarks.sort_unstable_by_key(|landmark| scattered(landmark.number));
            landmarks.truncate(MOST_LANDMARKS);
        }
        let landmark = |landmark: &&Landmark| {
            let [x, y] = landmark.at_px.map(|px| (px - 0.5) / scale as f32);
            let [red, green, blue] = [0, 1, 2].map(|c| colours[c].at(x, y));
            let codes = [red?, green?, blue?];
            let is_sound = codes.iter().all(|code| *code > CODES.0 && *code < CODES.1);
            is_sound.then(|| (landmark.number, self.spot([x / w as f32, y / h as f32], codes)))
        };
        let mut landmarks: Vec<_> = landmarks.iter().filter_map(landmark).collect();
        landmarks.sort_by_key(|(number, _)| *number);
        Seen { index: frame.index, state, colours, noise, depth: small, points, landmarks }
    }

    /// Upper bound on the noise of a small, smoothed picture, codes ([`noise_level`](super::noise_level)).
    /// The profile's bound ignores the blur that follows the halvings.
    fn noise_sigma(&self, plane: &Plane, channel: usize, halvings: usize) -> f64 {
        let by_profile = self.noise.as_ref().map(|profile| {
            let mean = plane.values.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.values.len().max(1) as f64;
            profile.sigma(channel, mean).powi(2) * share_kept(profile, halvings)
        });
        variance_bound(by_profile, plane).sqrt()
    }

    fn spot(&self, at: [f32; 2], codes: [f32; 3]) -> Spot {
        Spot { at, light: codes.map(|code| self.light(code)), codes }
    }

    fn light(&self, code: f32) -> f64 {
        self.response.decode(f64::from(code) / 255.0).max(1e-9).ln()
    }

    /// Places that both frames show, by depth: in one and in the other.
    fn by_depth(&self, from: &Seen, to: &Seen, to_state: &State) -> Vec<(Spot, Spot)> {
        let motion = to_state.world_from_camera.inverse() * from.state.world_from_camera;
        let (w, h) = (to.colours[0].width, to.colours[0].height);
        let scale = (1usize << self.halvings()) as f64;
        let pair = |point: &Point| {
            let there = motion.transform_point3(point.at);
            if there.z <= 0.0 {
                return None;
            }
            let (at, far) = seen(&self.eye.geometry, there, &to_state.twist, None, 2)?;
            let (x, y) = ((at.x - 0.5) / scale, (at.y - 0.5) / scale);
            if !(x >= 2.0 && y >= 2.0 && x < w as f64 - 3.0 && y < h as f64 - 3.0) {
                return None;
            }
            let depth = f64::from(to.depth[y.round() as usize * w + x.round() as usize]);
            if depth <= 0.0 || (depth - far).abs() > SAME * far + self.eye.slack_m(far) {
                return None;
            }
            let codes = [0, 1, 2].map(|c| to.colours[c].at(x as f32, y as f32).unwrap_or(0.0));
            let is_sound = codes.iter().all(|code| *code > CODES.0 && *code < CODES.1);
            is_sound.then(|| (point.spot, self.spot([x as f32 / w as f32, y as f32 / h as f32], codes)))
        };
        from.points.iter().filter_map(pair).collect()
    }

    /// σ of ln light of the places by their pictures' noise, root mean square of the two frames, at
    /// the median code.
    fn log_noise(&self, places: &[(Spot, Spot)], of: [&Seen; 2], channel: usize) -> f64 {
        let mut codes: Vec<f64> = places.iter().map(|(from, _)| f64::from(from.codes[channel])).collect();
        let code = median(&mut codes) as f32;
        let per_code = 0.5 * (self.light(code + 1.0) - self.light(code - 1.0));
        per_code * of.map(|seen| seen.noise[channel]).into_iter().fold(0.0, f64::hypot) / 2f64.sqrt()
    }

    fn compared(&self, from: &Seen, to: &Seen) -> Comparison {
        let mut places = by_landmarks(from, to);
        // What a recording recognised lies where it is by no pose.
        let mut is_unsure = false;
        if places.len() < LEAST_LANDMARKS {
            is_unsure = self.is_unsure;
            places = self.by_depth(from, to, &to.state);
            if places.len() < LEAST_POINTS {
                return Err(Unknown::Few);
            }
        }
        let gap = from.index.abs_diff(to.index);
        // Unsure poses get no allowance for noise: a plain floor looks alike everywhere.
        let noise = if is_unsure { [0.0; 3] } else { [0, 1, 2].map(|c| self.log_noise(&places, [from, to], c)) };
        let (ratios, Ratio { ratio, sigma }) = ratio(&places, noise, gap)?;
        let mut confirms = false;
        if is_unsure {
            // As if the camera rested: each pixel by itself.
            let at_rest = self.by_depth(from, to, &from.state);
            match ratio_if_any(&at_rest, noise, gap) {
                None => return Err(Unknown::Few),
                Some(Err(_)) => confirms = true,
                Some(Ok(other)) => {
                    let is_same =
                        |c: usize| (other.ratio[c] - ratio[c]).abs() < SAME_AT_REST.max(SAME_AT_REST_SIGMAS * sigma[c]);
                    if !(0..3).all(is_same) {
                        return Err(Unknown::Unsure);
                    }
                }
            }
        }
        let mean = |of: &[f64; 3]| of.iter().sum::<f64>() / 3.0;
        let is_asked = |gap: usize| across::GAPS.contains(&gap) || across::HELD_OUT.contains(&gap);
        let across = is_asked(to.index - from.index).then(|| {
            let point = |((from, to), of): (&(Spot, Spot), &[f64; 3])| across::Point {
                from: from.at,
                to: to.at,
                ratio: mean(of),
            };
            let points: Vec<_> = places.iter().zip(&ratios).map(point).collect();
            across::of_pair(from.index, to.index, &points, mean(&ratio))
        });
        let codes = places.iter().map(|(from, to)| [0, 1, 2].map(|c| 0.5 * (from.codes[c] + to.codes[c])));
        let toned = tone::of_pair(to.index, codes.zip(ratios.iter().copied()), ratio);
        let pair = Pair { from: from.index, to: to.index, ratio, sigma };
        Ok(Compared { pair, toned, across, confirms })
    }
}

/// ln of light from one frame to another, with one standard deviation of each.
struct Ratio {
    ratio: [f64; 3],
    sigma: [f64; 3],
}

/// By places that two frames `gap` apart have in common: of each place, and the median. Refused where places are not alike.
/// `noise`: σ of a place's ln light by the pictures' noise, for each colour.
fn ratio(places: &[(Spot, Spot)], noise: [f64; 3], gap: usize) -> Result<(Vec<[f64; 3]>, Ratio), Unknown> {
    let ratios: Vec<[f64; 3]> =
        places.iter().map(|(from, to)| [0, 1, 2].map(|c| to.light[c] - from.light[c])).collect();
    let mut green: Vec<f64> = places.iter().map(|(from, _)| from.light[1]).collect();
    let texture = (scatter(&mut green).1.powi(2) - noise[1].powi(2)).max(0.0).sqrt();
    let (mut ratio, mut sigma) = ([0.0; 3], [0.0; 3]);
    for c in 0..3 {
        let (middle, spread) = scatter(&mut ratios.iter().map(|of| of[c]).collect::<Vec<_>>());
        if spread > MATCHED.1.max(MATCHED.0 * texture).hypot(NOISE_TOLERANCE * 2f64.sqrt() * noise[c]) {
            return Err(Unknown::Unlike);
        }
        ratio[c] = middle;
        sigma[c] =
            (0.003f64.powi(2) + 20.0 * spread * spread / places.len() as f64 + (0.0005 * gap as f64).powi(2)).sqrt();
    }
    Ok((ratios, Ratio { ratio, sigma }))
}

/// The same of places that may be too few: `None`.
fn ratio_if_any(places: &[(Spot, Spot)], noise: [f64; 3], gap: usize) -> Option<Result<Ratio, Unknown>> {
    (places.len() >= LEAST_POINTS).then(|| ratio(places, noise, gap).map(|(_, ratio)| ratio))
}

/// Places that were recognised in both frames.
fn by_landmarks(from: &Seen, to: &Seen) -> Vec<(Spot, Spot)> {
    let (mut places, mut others) = (Vec::new(), to.landmarks.iter().peekable());
    for (number, spot) in &from.landmarks {
        while others.next_if(|(other, _)| other < number).is_some() {}
        if let Some((_, other)) = others.peek().filter(|(other, _)| other == number) {
            places.push((*spot, *other));
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::super::blurred::unit_noise;
    use super::*;

    /// Places of one brightness, ln, each with noise of its own in both frames.
    fn places(noise: f64, step: f64) -> Vec<(Spot, Spot)> {
        let spot = |light: f64| Spot { at: [0.0; 2], light: [light; 3], codes: [110.0; 3] };
        let noises = unit_noise(800, 1, 1, [0.0; 2]).values;
        let pair = |of: &[f32]| (spot(noise * f64::from(of[0])), spot(step + noise * f64::from(of[1])));
        noises.chunks(2).map(pair).collect()
    }

    #[test]
    fn noise_that_is_known_does_not_hide_the_gain() {
        // √2 · 0.06 is more than 0.05, and than half of the light's own scatter.
        let of = places(0.06, 0.3);
        let (_, found) = ratio(&of, [0.06; 3], 1).unwrap_or_else(|_| panic!("refused"));
        assert!((found.ratio[1] - 0.3).abs() < 3.0 * found.sigma[1] && found.sigma[1] < 0.03, "{:?}", found.ratio);
        assert!(ratio(&of, [0.0; 3], 1).is_err(), "unknown noise is what does not match");
        assert!(ratio(&of, [0.03; 3], 1).is_err(), "twice the noise that is known");
    }
}
