//! Features of the content by which the noise's amplitude varies: brightness, colour, activity.
//!
//! Of R'G'B' codes c on the 8-bit scale, m = c / 255 and y = (R + 2 G + B) / 4 of m:
//!
//! | feature | formula | reads, px around a pixel |
//! |---|---|---|
//! | 0 | y | 0 |
//! | 1 | √(max(y, 0) + 0.002) | 0 |
//! | 2 | R − G of m | 0 |
//! | 3 | B − G of m | 0 |
//! | 4 | ln(0.5 + i(s₂ * s * g)) | 10 |
//! | 5 | ln(0.5 + i(s * g)) | 6 |
//! | 6 | ln(0.05 + s * d²), d = 255 (y − s * y) | 2 |
//!
//! g: squared Sobel gradient of 255 y (code values per px), its mean over blocks of 2 × 2 px on the
//! coded picture's grid. d² is the energy of fine detail. s is the kernel (1 2 1)/4 along both
//! axes, over blocks for g, over pixels for d²; s₂ has its taps 2 blocks apart. i interpolates
//! bilinearly between the blocks' centres. Borders repeat.
//!
//! Each feature is then clamped to the range of the calibration and standardised
//! ([`FeatureScale`]). Features of a chroma sample are the means over its pixels.

use serde::{Deserialize, Serialize};

use crate::grey_image::GreyImage;

/// Features besides the constant 1.
pub const FEATURES: usize = 7;

/// Shares of the calibration's pixels beyond which features are clamped.
const CLAMPED_SHARE: f32 = 0.005;
/// The first feature of activity; all after it are, too.
const FIRST_ACTIVITY: usize = 4;

/// (1 2 1)/4: the middle, then one side.
const SMOOTHING: [f32; 2] = [0.5, 0.25];
/// (1 2 1)/4 with taps 2 apart.
const WIDE_SMOOTHING: [f32; 3] = [0.5, 0.0, 0.25];

/// Side of the blocks over which energies are averaged, px.
const ACTIVITY_BLOCK_PX: usize = 2;

/// Brightness of R', G', B', in their unit.
pub fn brightness([r, g, b]: [f32; 3]) -> f32 {
    0.25 * r + 0.5 * g + 0.25 * b
}

/// One plane per feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Features(pub [GreyImage; FEATURES]);

/// Range, mean and standard deviation of each feature over the calibration's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureScale {
    pub low: [f32; FEATURES],
    pub high: [f32; FEATURES],
    pub mean: [f32; FEATURES],
    /// Greater than 0.
    pub deviation: [f32; FEATURES],
}

impl Features {
    /// Features of a picture's R', G', B' codes on the 8-bit scale, without noise, not clipped,
    /// and not standardised.
    pub fn of(rgb: &[GreyImage; 3]) -> Self {
        let (width, height) = (rgb[0].width, rgb[0].height);
        let each = |value: &dyn Fn(f32, f32, f32) -> f32| {
            let [r, g, b] = [0, 1, 2].map(|c| &rgb[c].values);
            let values = r.iter().zip(g).zip(b).map(|((r, g), b)| value(r / 255.0, g / 255.0, b / 255.0)).collect();
            GreyImage { width, height, values }
        };
        let y = each(&|r, g, b| brightness([r, g, b]));
        let root = each(&|r, g, b| (brightness([r, g, b]).max(0.0) + 0.002).sqrt());
        let (along, down) = y.sobel();
        let energy = along.values.iter().zip(&down.values).map(|(x, y)| 255.0 * 255.0 * (x * x + y * y)).collect();
        let fine = GreyImage { width, height, values: energy }.reduced(ACTIVITY_BLOCK_PX).filtered(&SMOOTHING);
        let coarse = fine.filtered(&WIDE_SMOOTHING);
        let mut detail = detail_energy(&y).filtered(&SMOOTHING);
        let [coarse, fine] = [coarse, fine].map(|blocks| activity(&blocks, [width, height], 0.5));
        detail.values.iter_mut().for_each(|v| *v = (0.05 + *v).ln());
        Self([y, root, each(&|r, g, _| r - g), each(&|_, g, b| b - g), coarse, fine, detail])
    }

    pub fn width(&self) -> usize {
        self.0[0].width
    }

    pub fn height(&self) -> usize {
        self.0[0].height
    }

    /// Features of the i-th pixel, row by row.
    pub fn at(&self, i: usize) -> [f32; FEATURES] {
        std::array::from_fn(|f| self.0[f].values[i])
    }

    /// Means over `factor` pixels across and down.
    pub fn reduced(&self, factor: [usize; 2]) -> Self {
        Self(std::array::from_fn(|f| block_means(&self.0[f], factor)))
    }
}

/// Means over blocks of `factor` pixels across and down; incomplete blocks are dropped.
pub fn block_means(image: &GreyImage, factor: [usize; 2]) -> GreyImage {
    let [across, down] = factor;
    let share = 1.0 / (across * down) as f32;
    GreyImage::from_fn(image.width / across, image.height / down, |x, y| {
        let row = |j: usize| {
            let from = (down * y + j) * image.width + across * x;
            image.values[from..from + across].iter().sum::<f32>()
        };
        share * (0..down).map(row).sum::<f32>()
    })
}

/// Energy of fine detail of a brightness from 0 to 1, code values².
fn detail_energy(brightness: &GreyImage) -> GreyImage {
    let mut energy = brightness.filtered(&SMOOTHING);
    for (e, y) in energy.values.iter_mut().zip(&brightness.values) {
        let detail = 255.0 * (y - *e);
        *e = detail * detail;
    }
    energy
}

/// Logarithm of energies of blocks, interpolated at the pixels of a picture. `floor` is added to
/// the energies.
fn activity(blocks: &GreyImage, [width, height]: [usize; 2], floor: f32) -> GreyImage {
    if blocks.values.is_empty() {
        return GreyImage::uniform(width, height, floor.ln());
    }
    let place = |x: usize| {
        let at = (x as f32 + 0.5) / ACTIVITY_BLOCK_PX as f32 - 0.5;
        let first = at.floor();
        (first as i64, at - first)
    };
    GreyImage::from_fn(width, height, |x, y| {
        let ((column, across), (row, down)) = (place(x), place(y));
        let mix = |row: i64| {
            let (left, right) = (blocks.clamped(column, row), blocks.clamped(column + 1, row));
            left + across * (right - left)
        };
        let (upper, lower) = (mix(row), mix(row + 1));
        (floor + upper + down * (lower - upper)).ln()
    })
}

impl FeatureScale {
    /// The scale of these values, one list per feature. Lists must not be empty.
    pub fn of(mut values: [Vec<f32>; FEATURES]) -> Self {
        let mut scale =
            Self { low: [0.0; FEATURES], high: [0.0; FEATURES], mean: [0.0; FEATURES], deviation: [1.0; FEATURES] };
        for (f, values) in values.iter_mut().enumerate() {
            values.sort_unstable_by(f32::total_cmp);
            let at = |share: f32| values[(share * (values.len() - 1) as f32).round() as usize];
            let count = values.len() as f64;
            let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
            let variance = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / count;
            scale.low[f] = at(CLAMPED_SHARE);
            scale.high[f] = at(1.0 - CLAMPED_SHARE);
            scale.mean[f] = mean as f32;
            scale.deviation[f] = variance.sqrt() as f32 + 1e-6;
        }
        scale
    }

    /// The scale with activity clamped to `deviations` standard deviations about its mean.
    pub fn with_clamped_activity(mut self, deviations: f32) -> Self {
        for f in FIRST_ACTIVITY..FEATURES {
            self.high[f] = (self.mean[f] + deviations * self.deviation[f]).clamp(self.low[f], self.high[f]);
        }
        self
    }

    /// With the lower ends of another range, where they are lower, but at most two standard
    /// deviations below the mean: rounding is no feature.
    pub fn reaching_down_to(mut self, other: &Self) -> Self {
        for (f, low) in self.low.iter_mut().enumerate() {
            *low = low.min(other.low[f].max(self.mean[f] - 2.0 * self.deviation[f]));
        }
        self
    }

    /// Features clamped and standardised.
    pub fn standardised(&self, mut features: Features) -> Features {
        for (f, plane) in features.0.iter_mut().enumerate() {
            let (low, high, mean, inverse) = (self.low[f], self.high[f], self.mean[f], 1.0 / self.deviation[f]);
            plane.values.iter_mut().for_each(|v| *v = (v.clamp(low, high) - mean) * inverse);
        }
        features
    }

    /// True if all values are finite, ranges are ordered and deviations are greater than 0.
    pub fn is_valid(&self) -> bool {
        let finite = [self.low, self.high, self.mean, self.deviation].iter().flatten().all(|v| v.is_finite());
        let ordered = self.low.iter().zip(&self.high).all(|(low, high)| low <= high);
        finite && ordered && self.deviation.iter().all(|&v| v > 0.0)
    }
}
