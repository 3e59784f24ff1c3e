//! The gains of all frames from the gains of pairs, by robust least squares
//! ([`gain`](super::gain)).

use super::gain::Pair;
use crate::fit::band::BandMatrix;
use crate::fit::quantile::upper_median;

/// Scale of the Cauchy loss, ln.
const CAUCHY_SCALE_LN: f64 = 0.01;
const MAX_REWEIGHTINGS: usize = 30;

/// ln of each frame's gain, by channel; the recording's median is 0. `None` for frames without
/// pairs.
pub fn solve(pairs: &[Pair], frames: usize) -> Vec<Option<[f64; 3]>> {
    let mut is_linked = vec![false; frames];
    pairs.iter().for_each(|pair| (is_linked[pair.from], is_linked[pair.to]) = (true, true));
    let each = [0, 1, 2].map(|channel| of_channel(pairs, frames, channel));
    let middle = each.clone().map(|values| {
        let linked = values.iter().zip(&is_linked).filter(|(_, linked)| **linked).map(|(g, _)| *g);
        upper_median(linked).unwrap_or(0.0)
    });
    (0..frames).map(|n| is_linked[n].then(|| [0, 1, 2].map(|c| each[c][n] - middle[c]))).collect()
}

/// The gains of one channel, by banded normal equations.
fn of_channel(pairs: &[Pair], frames: usize, channel: usize) -> Vec<f64> {
    /// Weight of the prior at 0. It fixes the mean, which pairs do not determine, and frames
    /// without pairs.
    const PRIOR_WEIGHT: f64 = 1e-3;
    let width = pairs.iter().map(|pair| pair.from.abs_diff(pair.to)).max().unwrap_or(0);
    let mut gains = vec![0.0; frames];
    for _ in 0..MAX_REWEIGHTINGS {
        let mut equations = BandMatrix::new(frames, width);
        for frame in 0..frames {
            equations.add(frame, frame, PRIOR_WEIGHT);
        }
        for pair in pairs {
            let (i, j) = (pair.from, pair.to);
            let residual = pair.ratio[channel] - (gains[j] - gains[i]);
            let w = pair.sigma[channel].powi(-2) / (1.0 + (residual / CAUCHY_SCALE_LN).powi(2));
            equations.add(i, i, w);
            equations.add(j, j, w);
            equations.add(i.max(j), i.min(j), -w);
            equations.add_right(j, w * pair.ratio[channel]);
            equations.add_right(i, -w * pair.ratio[channel]);
        }
        // The matrix is diagonally dominant.
        let Some(next) = equations.solved() else { return gains };
        let moved = next.iter().zip(&gains).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        gains = next;
        if moved < 1e-7 {
            break;
        }
    }
    gains
}

/// Root mean square of the pairs' log ratios without and with the gains subtracted, over all
/// channels.
pub fn residuals(pairs: &[Pair], gains: &[Option<[f64; 3]>]) -> Option<(f64, f64)> {
    let (mut with, mut without, mut count) = (0.0, 0.0, 0);
    for pair in pairs {
        if let (Some(i), Some(j)) = (gains[pair.from], gains[pair.to]) {
            for c in 0..3 {
                with += (pair.ratio[c] - (j[c] - i[c])).powi(2);
                without += pair.ratio[c].powi(2);
                count += 1;
            }
        }
    }
    (count > 0).then(|| ((without / f64::from(count)).sqrt(), (with / f64::from(count)).sqrt()))
}
