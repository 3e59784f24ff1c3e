//! Sharpness of a straight edge by the slanted-edge method of ISO 12233, with a model fitted to the
//! pixels.
//!
//! As in the standard, the edge is located in each row with subpixel accuracy, by the centroid of
//! the row's derivative, and a line is fitted to those positions; pixels at many distances from the
//! line then sample the edge spread function finely, since the slant gives each row another phase.
//! Unlike the standard no bins are differentiated: the blur is fitted to the pixels themselves
//! (spread.rs), with a model of the pixel's own square and the edge's motion, so that the remaining
//! Gaussian is that of the lens and the later stages. The bins of a quarter pixel are for display
//! only.
//!
//! The uncertainty is the greater of the fit's own and of the jackknife's over pieces along the
//! edge (Tukey 1958), which includes correlated noise, texture and curved edges.
//!
//! Not modelled: non-Gaussian point spread functions, sharpening. [`SlantedEdge::misfit`] indicates
//! them.
//!
//! One file, because all steps share the samples of one edge.

use super::spread::{CONVERGENCE, EdgeFit, EdgeSample, EdgeStep, fit};
use super::{MeasureError, edge};
use crate::grey_image::GreyImage;
use crate::pixels::Rect;

/// Minimum number of pixels across and along an edge, px.
pub const MIN_EXTENT_PX: u32 = 10;
/// Bin width of the edge spread function, px.
const BIN_PX: f64 = 0.25;
/// Maximum searched blur, px.
const MAX_BLUR_PX: f64 = 24.0;
/// Number of pieces for the jackknife.
const JACKKNIFE_PIECES: usize = 8;
/// Minimum contrast of the sides, in standard deviations of a pixel's noise.
const MIN_CONTRAST_SIGMAS: f64 = 4.0;
/// Minimum share of rows whose edge lies on the line.
const MIN_INLIER_SHARE: f64 = 0.75;
/// Maximum deviation of pieces of a straight edge from the line, px.
const MAX_PIECE_DEVIATION_PX: f64 = 0.12;
/// Maximum deviation of single rows, px.
const MAX_ROW_DEVIATION_PX: f64 = 0.35;
/// Maximum deviation of a clean edge's bins from the fit, as a share of the step.
const MAX_BIN_MISFIT: f64 = 0.05;
/// Maximum change of light on one side within the fitted part, as a share of the step.
const MAX_SIDE_CHANGE: f64 = 0.35;
/// Maximum uncertainty of σ, as a share of the blur including the pixel's.
const MAX_RELATIVE_UNCERTAINTY: f64 = 0.25;

/// A measured straight edge. Light is in the picture's unit.
#[derive(Clone, Debug, PartialEq)]
pub struct SlantedEdge {
    /// The edge within the region, px.
    pub line_px: [[f64; 2]; 2],
    /// Angle between the edge and the rows or columns, whichever is nearer, 0 to 45 degrees.
    pub slant_deg: f64,
    /// Unit length, from the darker to the brighter side.
    pub normal: [f64; 2],
    /// Standard deviation of the Gaussian blur of the edge, without the pixel's own square and
    /// without the motion.
    pub sigma_px: f64,
    /// One standard deviation of `sigma_px`.
    pub uncertainty_px: f64,
    /// Width from 10 to 90 % of the step as sampled by the pixels. `None` if it is below the noise.
    pub rise_10_90_px: Option<f64>,
    /// The light of both sides at the edge.
    pub dark: f64,
    pub bright: f64,
    /// Standard deviation of a pixel's noise, mean of both sides.
    pub noise: f64,
    /// Deviation of the mean light from the fit, beyond noise: root mean square, as a share of the
    /// step. More than 0.02: the camera sharpens, or its blur is not Gaussian.
    pub misfit: f64,
    /// Distance from the edge, px, and mean light: the edge spread function.
    pub spread: Vec<[f64; 2]>,
    /// The fit at the same distances.
    pub fitted: Vec<f64>,
    /// Number of fitted pixels.
    pub pixels: usize,
}

/// Errors of the edge measurement.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum EdgeError {
    #[error(
        "the rectangle is {width}x{height} px within the picture; an edge needs {MIN_EXTENT_PX} px across and along it"
    )]
    Small { width: u32, height: u32 },
    #[error(
        "there is no edge: brightness differs by {times:.1} times the noise; {MIN_CONTRAST_SIGMAS} and more are needed"
    )]
    Faint { times: f64 },
    #[error(
        "no single straight edge: {percent:.0} % of the rows show it on one line; choose a rectangle that one straight edge \
         crosses from side to side, with nothing else in it"
    )]
    NoLine { percent: f64 },
    #[error(
        "the edge is not straight: it lies {deviation_px:.2} px beside a line; choose a shorter or straighter part"
    )]
    Bent { deviation_px: f64 },
    #[error(
        "beside the edge it is not even ({percent:.0} % of the step): choose an edge between two uniform areas, or a smaller \
         rectangle"
    )]
    Uneven { percent: f64 },
    #[error(
        "no more than {across_px:.1} px beside the edge lie within the rectangle, for a blur of {blur_px:.1} px: choose a \
         wider one"
    )]
    Narrow { across_px: f64, blur_px: f64 },
    #[error(
        "the width is not determined: {sigma_px:.2} ± {uncertainty_px:.2} px; choose a longer edge, or one of more contrast"
    )]
    Unsure { sigma_px: f64, uncertainty_px: f64 },
    #[error(transparent)]
    Measure(#[from] MeasureError),
}

/// Measures the edge that crosses a region in any direction. `moved_px`: motion of the edge during
/// the exposure.
pub fn slanted_edge(light: &GreyImage<f64>, region: Rect, moved_px: [f64; 2]) -> Result<SlantedEdge, EdgeError> {
    let region = region.intersection(&Rect::full(light.width as u32, light.height as u32));
    let small = EdgeError::Small { width: region.width(), height: region.height() };
    if region.width().min(region.height()) < MIN_EXTENT_PX {
        return Err(small);
    }
    if let Some(odd) = moved_px.into_iter().find(|way| !way.is_finite()) {
        return Err(MeasureError::Option { what: "moved_px", actual: odd, accepted: "a number" }.into());
    }
    let edge_region = EdgeRegion::new(light, region);
    let line = edge_region.line()?;
    let moved = |step: &EdgeStep| {
        let (sin, cos) = step.angle.sin_cos();
        (moved_px[0] * cos + moved_px[1] * sin).abs()
    };
    let mut step = EdgeStep { moved_px: moved(&line), ..line };
    let mut samples = edge_region.near(&step, MAX_BLUR_PX);
    let nothing = || EdgeError::NoLine { percent: 0.0 };
    let mut fitted = fit(&samples, step, CONVERGENCE).ok_or_else(nothing)?;
    // Dark and bright pixels have different noise; pixels far from the edge no longer count.
    for _ in 0..2 {
        step = EdgeStep { moved_px: moved(&fitted.step), ..fitted.step };
        let reach = (4.0 * blur_px(&step) + 2.0).clamp(5.0, MAX_BLUR_PX);
        samples = edge_region.near(&step, reach);
        weigh(&mut samples, &fitted);
        fitted = fit(&samples, step, CONVERGENCE).ok_or_else(nothing)?;
    }
    edge_region.judge(fitted, samples)
}

/// Standard deviation of the total blur, px.
fn blur_px(step: &EdgeStep) -> f64 {
    (step.variance_px2 + (1.0 + step.moved_px * step.moved_px) / 12.0).sqrt()
}

/// The variances of both sides' pixels about the fit.
fn noise(samples: &[EdgeSample], fit: &EdgeFit) -> [f64; 2] {
    let mut sums = [(0.0, 0.0); 2];
    let mut all = (0.0, 0.0);
    for sample in samples {
        let share = fit.step.share(fit.step.place(sample.x, sample.y).0);
        let square = (sample.light - fit.light(sample.x, sample.y)).powi(2);
        all = (all.0 + square, all.1 + 1.0);
        if !(0.05..=0.95).contains(&share) {
            let side = &mut sums[usize::from(share > 0.5)];
            *side = (side.0 + square, side.1 + 1.0);
        }
    }
    let step = (fit.sides[1][0] - fit.sides[0][0]).powi(2);
    sums.map(|(squares, count)| if count >= 20.0 { squares / count } else { all.0 / all.1 }.max(1e-10 * step))
}

/// Weights each sample by its noise, interpolated between that of the sides.
fn weigh(samples: &mut [EdgeSample], fit: &EdgeFit) {
    let [dark, bright] = noise(samples, fit);
    for sample in samples {
        let share = fit.step.share(fit.step.place(sample.x, sample.y).0);
        sample.weight = 1.0 / (dark + (bright - dark) * share);
    }
}

/// The light of a region, with rows across the edge.
struct EdgeRegion {
    rows: Vec<Vec<f64>>,
    /// True if the picture's rows are columns here.
    turned: bool,
    /// 1 if it gets brighter along the rows.
    sign: f64,
    region: Rect,
}

impl EdgeRegion {
    fn new(light: &GreyImage<f64>, region: Rect) -> Self {
        let at = |x: i32, y: i32| light.clamped(i64::from(x), i64::from(y));
        // Direction of increasing brightness: means over 3 pixels at right angles, two pixels
        // apart.
        let (mut across, mut down) = (0.0, 0.0);
        for (y, x) in (region.y0 + 1..region.y1 - 1).flat_map(|y| (region.x0 + 1..region.x1 - 1).map(move |x| (y, x))) {
            let gx: f64 = (-1..=1).map(|k| at(x + 1, y + k) - at(x - 1, y + k)).sum();
            let gy: f64 = (-1..=1).map(|k| at(x + k, y + 1) - at(x + k, y - 1)).sum();
            (across, down) = (across + gx * gx, down + gy * gy);
        }
        let turned = down > across;
        let rows: Vec<Vec<f64>> = if turned {
            (region.x0..region.x1).map(|x| (region.y0..region.y1).map(|y| at(x, y)).collect()).collect()
        } else {
            (region.y0..region.y1).map(|y| (region.x0..region.x1).map(|x| at(x, y)).collect()).collect()
        };
        let rise: f64 =
            rows.iter().flat_map(|row| (3..row.len() - 3).map(|j| slope(row, j)).map(|s| s * s.abs())).sum();
        Self { rows, turned, sign: if rise < 0.0 { -1.0 } else { 1.0 }, region }
    }

    /// The line through the steepest point of each row, as a step with a guessed blur. Coordinates
    /// are relative to the region's centre.
    fn line(&self) -> Result<EdgeStep, EdgeError> {
        let width = self.rows[0].len();
        let best = |row: &Vec<f64>| {
            let steepest = (3..width - 3).max_by(|a, b| {
                let slope = |j: usize| self.sign * slope(row, j);
                slope(*a).total_cmp(&slope(*b))
            });
            steepest.map_or(0.0, |j| j as f64)
        };
        let places: Vec<f64> = self.rows.iter().map(best).collect();
        // The line with the largest consensus of rows, through any two of them.
        let count = places.len();
        let every = count.div_ceil(40);
        let mut line = (0.0, 0.0, 0);
        for i in (0..count).step_by(every) {
            for j in (i + 3..count).step_by(every) {
                let tilt = (places[j] - places[i]) / (j - i) as f64;
                let at = |k: usize| places[i] + tilt * (k as f64 - i as f64);
                let near = (0..count).filter(|k| (places[*k] - at(*k)).abs() <= 1.6).count();
                if near > line.2 && tilt.abs() <= 1.3 {
                    line = (at(0), tilt, near);
                }
            }
        }
        let (mut start, mut tilt, _) = line;
        // Centroids of the derivative around it, three iterations.
        for _ in 0..3 {
            let mut points = Vec::new();
            for (k, row) in self.rows.iter().enumerate() {
                let middle = start + tilt * k as f64;
                if let Some(place) = self.centroid(row, middle) {
                    points.push((k as f64, place, (place - middle).abs()));
                }
            }
            let within: usize = self
                .rows
                .iter()
                .enumerate()
                .filter(|(k, _)| {
                    let middle = start + tilt * *k as f64;
                    middle >= 3.0 && middle <= width as f64 - 4.0
                })
                .count();
            let agreeing = points.iter().filter(|p| p.2 <= 1.6).count();
            let enough = within.max(MIN_EXTENT_PX as usize) as f64;
            if (agreeing as f64) < MIN_INLIER_SHARE * enough || agreeing < MIN_EXTENT_PX as usize {
                return Err(EdgeError::NoLine { percent: 100.0 * agreeing as f64 / enough });
            }
            points.retain(|p| p.2 <= 1.6);
            let n = points.len() as f64;
            let (mk, mp) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
            let above: f64 = points.iter().map(|p| (p.0 - mk) * (p.1 - mp)).sum();
            let below: f64 = points.iter().map(|p| (p.0 - mk).powi(2)).sum();
            tilt = above / below;
            start = mp - tilt * mk;
        }
        // In the picture's axes: along = start + tilt·row, from the region's centre.
        let (columns, rows) = (width as f64, count as f64);
        let (mut nx, mut ny) = (1.0, -tilt);
        let mut offset = start + 0.5 - 0.5 * columns - tilt * (0.5 - 0.5 * rows);
        if self.turned {
            (nx, ny) = (ny, nx);
        }
        if self.sign < 0.0 {
            (nx, ny, offset) = (-nx, -ny, -offset);
        }
        let length = (1.0 + tilt * tilt).sqrt();
        Ok(EdgeStep { offset_px: offset / length, angle: f64::atan2(ny, nx), variance_px2: 0.7, moved_px: 0.0 })
    }

    /// Centroid of a row's derivative around a position.
    fn centroid(&self, row: &[f64], middle: f64) -> Option<f64> {
        const HALF: f64 = 4.0;
        let first = (middle - HALF).ceil().max(1.0) as usize;
        let last = ((middle + HALF).floor() as usize).min(row.len().checked_sub(2)?);
        let rise = |j: usize| self.sign * 0.5 * (row[j + 1] - row[j - 1]);
        let (mut sum, mut moment) = (0.0, 0.0);
        for j in first..=last {
            // Hamming window, as in the standard.
            let window = 0.54 + 0.46 * (std::f64::consts::PI * (j as f64 - middle) / HALF).cos();
            sum += window * rise(j);
            moment += window * rise(j) * j as f64;
        }
        let place = moment / sum;
        (sum > 0.0 && place.is_finite()).then_some(place)
    }

    fn middle(&self) -> [f64; 2] {
        let Rect { x0, y0, x1, y1 } = self.region;
        [0.5 * f64::from(x0 + x1), 0.5 * f64::from(y0 + y1)]
    }

    /// The pixels at most `reach` from the edge.
    fn near(&self, step: &EdgeStep, reach: f64) -> Vec<EdgeSample> {
        let (columns, rows) = (self.rows[0].len() as f64, self.rows.len() as f64);
        let mut samples = Vec::new();
        for (k, row) in self.rows.iter().enumerate() {
            for (j, &light) in row.iter().enumerate() {
                let (along, down) = (j as f64 + 0.5 - 0.5 * columns, k as f64 + 0.5 - 0.5 * rows);
                let (x, y) = if self.turned { (down, along) } else { (along, down) };
                if step.place(x, y).0.abs() <= reach {
                    samples.push(EdgeSample { x, y, light, weight: 1.0 });
                }
            }
        }
        samples
    }

    /// The result, or the reason for rejecting it.
    fn judge(&self, fit: EdgeFit, samples: Vec<EdgeSample>) -> Result<SlantedEdge, EdgeError> {
        let step = fit.step;
        let [dark, bright] = [fit.sides[0][0], fit.sides[1][0]];
        let height = bright - dark;
        let noise = (0.5 * noise(&samples, &fit).iter().sum::<f64>()).sqrt();
        if height.is_nan() || height <= MIN_CONTRAST_SIGMAS * noise {
            return Err(EdgeError::Faint { times: height.max(0.0) / noise });
        }
        let distances = || samples.iter().map(|sample| step.place(sample.x, sample.y).0);
        let beside = distances().fold(0.0, f64::max).min(-distances().fold(0.0, f64::min));
        if beside < 1.5 * blur_px(&step) + 1.0 {
            return Err(EdgeError::Narrow { across_px: beside, blur_px: blur_px(&step) });
        }
        let slope = fit.sides.iter().map(|side| side[1].abs() * beside).fold(0.0, f64::max);
        if slope > MAX_SIDE_CHANGE * height {
            return Err(EdgeError::Uneven { percent: 100.0 * slope / height });
        }
        let (pieces, rows) = deviations(&fit, &samples);
        let [bent, rough] = [(pieces, MAX_PIECE_DEVIATION_PX), (rows, MAX_ROW_DEVIATION_PX)]
            .map(|(d, limit)| (d.beyond() > limit + d.noise).then(|| d.beyond()));
        if let Some(deviation_px) = bent.or(rough) {
            return Err(EdgeError::Bent { deviation_px });
        }
        let (spread, fitted, misfit) = binned(&fit, &samples);
        let misfit = misfit / height;
        if misfit > MAX_BIN_MISFIT {
            return Err(EdgeError::Uneven { percent: 100.0 * misfit });
        }
        // The weights are the inverse noise variances estimated from the pixels themselves.
        let own = fit.variances[2] * fit.left / (samples.len() as f64 - 9.0).max(1.0);
        let variance = own.max(jackknife(&samples, &fit).unwrap_or(0.0)).sqrt();
        let root = |v: f64| v.max(0.0).sqrt();
        let sigma_px = if step.variance_px2 < 1e-6 { 0.0 } else { step.variance_px2.sqrt() };
        let uncertainty_px = 0.5 * (root(step.variance_px2 + variance) - root(step.variance_px2 - variance));
        if uncertainty_px > MAX_RELATIVE_UNCERTAINTY * blur_px(&step) {
            return Err(EdgeError::Unsure { sigma_px, uncertainty_px });
        }
        let rise_10_90_px = rise(&spread);
        let (sin, cos) = step.angle.sin_cos();
        let slant_deg = sin.abs().min(cos.abs()).asin().to_degrees();
        let line_px = self.ends(&step);
        Ok(SlantedEdge {
            line_px,
            slant_deg,
            normal: [cos, sin],
            sigma_px,
            uncertainty_px,
            rise_10_90_px,
            dark,
            bright,
            noise,
            misfit,
            spread,
            fitted,
            pixels: samples.len(),
        })
    }

    /// Intersections of the line with the region's border.
    fn ends(&self, step: &EdgeStep) -> [[f64; 2]; 2] {
        let [mx, my] = self.middle();
        let (sin, cos) = step.angle.sin_cos();
        let (half_x, half_y) = (0.5 * f64::from(self.region.width()), 0.5 * f64::from(self.region.height()));
        let is_inside = |t: f64| {
            let (x, y) = (step.offset_px * cos - t * sin, step.offset_px * sin + t * cos);
            x.abs() <= half_x + 1e-9 && y.abs() <= half_y + 1e-9
        };
        let crossings = [
            (half_x - step.offset_px * cos) / -sin,
            (-half_x - step.offset_px * cos) / -sin,
            (half_y - step.offset_px * sin) / cos,
            (-half_y - step.offset_px * sin) / cos,
        ];
        let within: Vec<f64> = crossings.into_iter().filter(|t| t.is_finite() && is_inside(*t)).collect();
        let ends = [
            within.iter().copied().fold(f64::INFINITY, f64::min),
            within.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ];
        ends.map(|t| [mx + step.offset_px * cos - t * sin, my + step.offset_px * sin + t * cos])
    }
}

/// The mean of three pixels after a position minus that of three before it.
fn slope(row: &[f64], j: usize) -> f64 {
    (1..=3).map(|k| row[j + k] - row[j - k]).sum::<f64>() / 3.0
}

/// Deviation of parts of an edge from the line.
struct Deviation {
    /// Root mean square, px.
    all: f64,
    /// Expected contribution of noise.
    noise: f64,
}

impl Deviation {
    fn beyond(&self) -> f64 {
        (self.all * self.all - self.noise * self.noise).max(0.0).sqrt()
    }
}

/// Deviations of pieces and of single rows: each is shifted to its best fit.
fn deviations(fit: &EdgeFit, samples: &[EdgeSample]) -> (Deviation, Deviation) {
    let ways = || samples.iter().map(|sample| fit.step.place(sample.x, sample.y).1);
    let (first, last) = (ways().fold(f64::INFINITY, f64::min), ways().fold(f64::NEG_INFINITY, f64::max));
    let height = fit.sides[1][0] - fit.sides[0][0];
    let within = |count: usize| {
        let mut sums = vec![(0.0, 0.0); count];
        for sample in samples {
            let (d, t) = fit.step.place(sample.x, sample.y);
            let place = ((t - first) / (last - first) * count as f64) as usize;
            let slope = -height * (fit.step.share(d + 0.05) - fit.step.share(d - 0.05)) / 0.1;
            let sum = &mut sums[place.min(count - 1)];
            sum.0 += sample.weight * slope * (sample.light - fit.light(sample.x, sample.y));
            sum.1 += sample.weight * slope * slope;
        }
        sums.retain(|sum| sum.1 > 0.0);
        // A part with few pixels across the edge is uncertain.
        let max_weight = sums.iter().map(|sum| sum.1).fold(0.0, f64::max);
        sums.retain(|sum| sum.1 > 0.2 * max_weight);
        let n = sums.len().max(1) as f64;
        let all = (sums.iter().map(|sum| (sum.0 / sum.1).powi(2)).sum::<f64>() / n).sqrt();
        let noise = (sums.iter().map(|sum| 1.0 / sum.1).sum::<f64>() / n).sqrt();
        Deviation { all, noise }
    };
    (within(JACKKNIFE_PIECES), within((last - first).max(1.0) as usize))
}

/// The edge spread function, the fit at its positions, and their deviation beyond noise.
fn binned(fit: &EdgeFit, samples: &[EdgeSample]) -> (Vec<[f64; 2]>, Vec<f64>, f64) {
    let place = |sample: &EdgeSample| fit.step.place(sample.x, sample.y).0;
    let far = samples.iter().map(|sample| place(sample).abs()).fold(0.0, f64::max);
    let half = (far / BIN_PX).ceil() as i64;
    // Number of samples, light, fitted light, variance.
    let mut bins = vec![(0.0, 0.0, 0.0, 0.0); 2 * half as usize + 1];
    for sample in samples {
        let bin = ((place(sample) / BIN_PX).round() as i64 + half) as usize;
        let bin = &mut bins[bin];
        *bin = (bin.0 + 1.0, bin.1 + sample.light, bin.2 + fit.light(sample.x, sample.y), bin.3 + 1.0 / sample.weight);
    }
    let (mut spread, mut fitted, mut apart, mut counted) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for (i, (count, light, model, variance)) in bins.into_iter().enumerate() {
        // At the edge's ends only some rows reach that far.
        if count < 4.0 {
            continue;
        }
        let distance = (i as i64 - half) as f64 * BIN_PX;
        let [behind, before] = fit.sides.map(|[a, b, _]| a + b * distance);
        let share = fit.step.share(distance);
        let at_middle = behind * (1.0 - share) + before * share;
        // Deviation from the fit at the same pixels, since bins are not filled evenly.
        spread.push([distance, at_middle + (light - model) / count]);
        fitted.push(at_middle);
        apart += ((light - model) / count).powi(2) - variance / (count * count);
        counted += 1.0;
    }
    (spread, fitted, (apart.max(0.0) / f64::max(counted, 1.0)).sqrt())
}

/// The rise of a spread function with possibly empty bins.
fn rise(spread: &[[f64; 2]]) -> Option<f64> {
    let (first, last) = (spread.first()?[0], spread.last()?[0]);
    let even = (0..=((last - first) / BIN_PX).round() as usize).map(|i| {
        let at = first + BIN_PX * i as f64;
        let after = spread.partition_point(|[d, _]| *d <= at).clamp(1, spread.len() - 1);
        let ([da, a], [db, b]) = (spread[after - 1], spread[after]);
        a + (b - a) * (at - da) / (db - da)
    });
    let values: Vec<f64> = if spread.len() < 2 { Vec::new() } else { even.collect() };
    edge::edge(&values, BIN_PX).ok().map(|edge| edge.width_10_90_px)
}

/// Jackknife variance of σ² over pieces along the edge.
fn jackknife(samples: &[EdgeSample], edge_fit: &EdgeFit) -> Option<f64> {
    let way = |sample: &EdgeSample| edge_fit.step.place(sample.x, sample.y).1;
    let mut ways: Vec<f64> = samples.iter().map(way).collect();
    ways.sort_by(f64::total_cmp);
    let ends: Vec<f64> = (1..JACKKNIFE_PIECES).map(|k| ways[k * ways.len() / JACKKNIFE_PIECES]).collect();
    let without = |piece: usize| {
        let rest: Vec<EdgeSample> =
            samples.iter().filter(|sample| ends.partition_point(|end| *end <= way(sample)) != piece).copied().collect();
        fit(&rest, edge_fit.step, CONVERGENCE).map(|fit| fit.step.variance_px2)
    };
    let all: Vec<f64> = (0..JACKKNIFE_PIECES).map(without).collect::<Option<_>>()?;
    let n = JACKKNIFE_PIECES as f64;
    let mean = all.iter().sum::<f64>() / n;
    Some((n - 1.0) / n * all.iter().map(|v| (v - mean).powi(2)).sum::<f64>())
}
