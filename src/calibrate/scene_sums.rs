//! The running sums of one static scene. Their memory does not depend on the number of frames.
//!
//! All sums are integers in 16-bit codes (8-bit codes times 257), so they are exact.

use super::common_motion::CommonMotion;
use super::rounding::CODES16_PER_CODE8;
use crate::pixels::{Codes, Pixels};

/// Side of the blocks in which motion is detected and correlations are summed, pixels.
pub(crate) const BLOCK: usize = 8;
/// More frames than this could overflow a pixel's sums.
pub(crate) const MAX_FRAMES: u32 = 30_000;
/// Pixels of the largest picture. Each takes 80 bytes while a scene is summed.
pub(crate) const MAX_PIXELS: usize = 1 << 26;

/// Summed products of a block's differences d. d is a frame minus the one before, or minus the
/// known mean.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BlockSums {
    /// d² of R, G, B.
    pub squares: [i64; 3],
    /// R·G, R·B, G·B.
    pub cross: [i64; 3],
    /// d times that of the right neighbour in the same block.
    pub right: [i64; 3],
    /// d times that of the neighbour below in the same block.
    pub below: [i64; 3],
    /// Sum of (block's mean d − frame's mean d)², green only. 8-bit codes squared.
    pub even: f64,
}

/// One channel of one pixel over the frames, in 8-bit code values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelSums {
    pub mean: f64,
    /// Sum of squared variations.
    pub squares: f64,
    /// Sum of variations: 0 around the frames' own mean.
    pub sum: f64,
    /// A sample was at an end of the code range.
    pub touched: bool,
}

/// A block's place in the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockArea {
    pub x0: usize,
    pub y0: usize,
    pub x1: usize,
    pub y1: usize,
}

impl BlockArea {
    pub fn pixels(&self) -> usize {
        (self.x1 - self.x0) * (self.y1 - self.y0)
    }
    pub fn pairs_right(&self) -> usize {
        (self.x1 - self.x0 - 1) * (self.y1 - self.y0)
    }
    pub fn pairs_below(&self) -> usize {
        (self.x1 - self.x0) * (self.y1 - self.y0 - 1)
    }
}

/// Sums over the frames of one scene, code values.
#[derive(Clone, Debug)]
pub(crate) struct SceneSums {
    pub width: usize,
    pub height: usize,
    pub frames: u32,
    /// Variations are relative to a known mean.
    pub known_mean: bool,
    pub blocks: Vec<BlockSums>,
    pub motion: CommonMotion,
    /// The known mean, or the first frame: the sums are relative to it.
    reference: Vec<u16>,
    /// The previous frame; only without a known mean.
    previous: Vec<u16>,
    sum: Vec<i32>,
    squares: Vec<u64>,
    touched: Vec<bool>,
    /// Mean and sum of squared deviations of the whole frames' means, for each channel (Welford).
    brightness: [(f64, f64); 3],
}

/// A picture's codes on the 16-bit scale.
fn codes_16(pixels: &Pixels) -> Vec<u16> {
    match &pixels.codes {
        Codes::U8(codes) => codes.iter().map(|&c| u16::from(c) * CODES16_PER_CODE8 as u16).collect(),
        Codes::U16(codes) => codes.clone(),
    }
}

impl SceneSums {
    /// Sums around a known mean, or around the frames' own. Every frame must have the size of
    /// `first`.
    pub fn new(first: &Pixels, mean: Option<&Pixels>) -> Self {
        let (width, height) = (first.width as usize, first.height as usize);
        let n = 3 * width * height;
        let blocks = width.div_ceil(BLOCK) * height.div_ceil(BLOCK);
        Self {
            width,
            height,
            frames: 0,
            known_mean: mean.is_some(),
            blocks: vec![BlockSums::default(); blocks],
            motion: CommonMotion::default(),
            reference: codes_16(mean.unwrap_or(first)),
            previous: Vec::new(),
            sum: vec![0; n],
            squares: vec![0; n],
            touched: vec![false; n],
            brightness: [(0.0, 0.0); 3],
        }
    }

    /// Adds a frame of the same size.
    pub fn add(&mut self, frame: &Pixels) {
        let codes = codes_16(frame);
        let mut totals = [0i64; 3];
        for (i, (&code, &reference)) in codes.iter().zip(&self.reference).enumerate() {
            let d = i32::from(code) - i32::from(reference);
            self.sum[i] += d;
            self.squares[i] += u64::from(d.unsigned_abs()).pow(2);
            self.touched[i] |= code == 0 || code == u16::MAX;
            totals[i % 3] += i64::from(d);
        }
        self.frames += 1;
        for (total, (mean, squares)) in totals.iter().zip(&mut self.brightness) {
            let value = *total as f64 / (self.width * self.height * CODES16_PER_CODE8 as usize) as f64;
            let from_old = value - *mean;
            *mean += from_old / f64::from(self.frames);
            *squares += from_old * (value - *mean);
        }
        if self.known_mean {
            self.add_differences(&codes, true);
        } else {
            if !self.previous.is_empty() {
                self.add_differences(&codes, false);
            }
            self.previous = codes;
        }
    }

    fn add_differences(&mut self, codes: &[u16], from_reference: bool) {
        let base = if from_reference { &self.reference } else { &self.previous };
        self.motion.add(self.width, self.height, base, codes);
        let difference = |i: usize| i64::from(codes[i]) - i64::from(base[i]);
        let (width, columns) = (self.width, self.width.div_ceil(BLOCK));
        let mut totals = vec![0i64; self.blocks.len()];
        for i in 0..width * self.height {
            let (x, y) = (i % width, i / width);
            let d = [0, 1, 2].map(|c| difference(3 * i + c));
            let place = y / BLOCK * columns + x / BLOCK;
            totals[place] += d[1];
            let block = &mut self.blocks[place];
            let pairs = [d[0] * d[1], d[0] * d[2], d[1] * d[2]];
            for c in 0..3 {
                block.squares[c] += d[c] * d[c];
                block.cross[c] += pairs[c];
                if x % BLOCK != 0 {
                    block.right[c] += d[c] * difference(3 * i - 3 + c);
                }
                if y % BLOCK != 0 {
                    block.below[c] += d[c] * difference(3 * (i - width) + c);
                }
            }
        }
        let whole = totals.iter().sum::<i64>() as f64 / (self.width * self.height) as f64;
        for (i, total) in totals.into_iter().enumerate() {
            let pixels = self.area(i).pixels() as f64;
            self.blocks[i].even += ((total as f64 / pixels - whole) / CODES16_PER_CODE8 as f64).powi(2);
        }
    }

    /// Degrees of freedom of a pixel's squared variations: J, or J − 1 around the frames' own mean.
    pub fn freedom(&self) -> f64 {
        f64::from(self.frames) - if self.known_mean { 0.0 } else { 1.0 }
    }

    /// Variance of the mean relative to the noise's: 1/J, or 0 if the mean is known.
    pub fn mean_noise(&self) -> f64 {
        if self.known_mean { 0.0 } else { 1.0 / f64::from(self.frames) }
    }

    /// How many differences were summed, and how many times the noise's variance each of them has.
    pub fn differences(&self) -> (f64, f64) {
        if self.known_mean { (f64::from(self.frames), 1.0) } else { (f64::from(self.frames) - 1.0, 2.0) }
    }

    /// One channel of one pixel. `i` is its index among the interleaved codes.
    pub fn pixel(&self, i: usize) -> PixelSums {
        let (sum, squares, frames) = (i64::from(self.sum[i]), self.squares[i], i64::from(self.frames));
        let unit = CODES16_PER_CODE8 as f64;
        let reference = f64::from(self.reference[i]) / unit;
        let touched = self.touched[i];
        if self.known_mean {
            return PixelSums {
                mean: reference,
                squares: squares as f64 / (unit * unit),
                sum: sum as f64 / unit,
                touched,
            };
        }
        let deviations = i128::from(squares) * i128::from(frames) - i128::from(sum) * i128::from(sum);
        PixelSums {
            mean: reference + sum as f64 / (frames as f64 * unit),
            squares: deviations as f64 / (frames as f64 * unit * unit),
            sum: 0.0,
            touched,
        }
    }

    /// The area of block `index`.
    pub fn area(&self, index: usize) -> BlockArea {
        let columns = self.width.div_ceil(BLOCK);
        let (x0, y0) = (index % columns * BLOCK, index / columns * BLOCK);
        BlockArea { x0, y0, x1: (x0 + BLOCK).min(self.width), y1: (y0 + BLOCK).min(self.height) }
    }

    /// The indices of one channel's codes in a block.
    pub fn places(&self, area: BlockArea, channel: usize) -> impl Iterator<Item = usize> {
        let width = self.width;
        (area.y0..area.y1).flat_map(move |y| (area.x0..area.x1).map(move |x| 3 * (y * width + x) + channel))
    }

    /// Mean variation of the whole picture for each channel, in 8-bit code values; 0 around the
    /// frames' own mean.
    pub fn offset(&self) -> [f64; 3] {
        if self.known_mean { self.brightness.map(|b| b.0) } else { [0.0; 3] }
    }

    /// Standard deviation of the whole frames' means over time, the largest channel's, in 8-bit
    /// code values.
    pub fn flicker(&self) -> f64 {
        let divisor = (f64::from(self.frames) - 1.0).max(1.0);
        self.brightness.iter().map(|(_, squares)| (squares / divisor).sqrt()).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(value: u8) -> Pixels {
        Pixels::from_u8(9, 9, (0..243).map(|i| value + (i % 3) as u8).collect()).unwrap()
    }

    #[test]
    fn sums_match_computed_values_around_own_and_known_means() {
        let frames = [10, 12, 17].map(frame);
        let mut own = SceneSums::new(&frames[0], None);
        let mut around_mean = SceneSums::new(&frames[0], Some(&frame(12)));
        for frame in &frames {
            own.add(frame);
            around_mean.add(frame);
        }
        let p = own.pixel(1);
        // 11, 13, 18: mean 14, squares 9 + 1 + 16.
        assert!((p.mean - 14.0).abs() < 1e-12 && (p.squares - 26.0).abs() < 1e-12 && p.sum == 0.0);
        let p = around_mean.pixel(1);
        // −2, 0, 5 around 13.
        assert!((p.mean - 13.0).abs() < 1e-12 && (p.squares - 29.0).abs() < 1e-12 && (p.sum - 3.0).abs() < 1e-12);
        assert_eq!((own.freedom(), around_mean.freedom()), (2.0, 3.0));
        // Differences 2 and 5 in every pixel: 64 pixels, 56 pairs in each direction.
        let unit = CODES16_PER_CODE8 * CODES16_PER_CODE8;
        assert_eq!(own.blocks[0].squares, [64 * 29 * unit; 3]);
        assert_eq!(own.blocks[0].right, [56 * 29 * unit; 3]);
        assert_eq!(own.blocks[0].below, [56 * 29 * unit; 3]);
        assert_eq!(own.blocks[0].cross, [64 * 29 * unit; 3]);
        // The last column's block is one pixel wide.
        assert_eq!((own.blocks.len(), own.area(1).pixels(), own.area(1).pairs_right()), (4, 8, 0));
        assert_eq!(own.blocks[1].right, [0; 3]);
        assert!((own.flicker() - 13f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn sixteen_bit_codes_have_the_same_scale() {
        let frames = [0u16, 257, 514].map(|v| Pixels::from_u16(1, 1, vec![v; 3]).unwrap());
        let mut sums = SceneSums::new(&frames[0], None);
        frames.iter().for_each(|f| sums.add(f));
        let p = sums.pixel(0);
        assert!((p.mean - 1.0).abs() < 1e-12 && (p.squares - 2.0).abs() < 1e-12 && p.touched);
    }
}
