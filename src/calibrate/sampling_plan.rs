//! Frames of a scene, and windows in them, from which an atlas of noise is taken: whole frames that
//! are evenly spaced, or windows of large ones, each in another quarter of the picture.

/// Largest area of all frames of a model, px. Its file has 3 to 4 bytes for each.
pub const MAX_ATLAS_PX: usize = 1 << 21;
/// Windows of a picture that is too large for its whole frames.
const WINDOWS: usize = 4;
/// Windows start at multiples of this: the largest unit of a coding, px.
const GRID_PX: usize = 16;
/// Smallest side of a window with tiles of two classes, px.
const MIN_WINDOW_PX: usize = 160;

/// A part of the picture, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasWindow {
    pub at: [usize; 2],
    pub size: [usize; 2],
}

/// Frames and windows that are sampled.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SamplingPlan {
    /// Index of the frame, ascending, and the window.
    pub samples: Vec<(usize, AtlasWindow)>,
}

impl SamplingPlan {
    /// Samples of `frames` frames, of at most `budget_px` altogether.
    pub fn of(size: [usize; 2], frames: usize, budget_px: usize) -> Self {
        let area = (size[0] * size[1]).max(1);
        // Independent of the number of frames: all scenes have the same size.
        if budget_px / area >= WINDOWS {
            let whole = (budget_px / area).min(frames);
            let frame = |i: usize| (i * frames / whole, AtlasWindow { at: [0, 0], size });
            return Self { samples: (0..whole).map(frame).collect() };
        }
        let side = (budget_px / WINDOWS).isqrt() / GRID_PX * GRID_PX;
        // Halves do not overlap, so that a frame's windows have different noise.
        let half = size.map(|length| length / 2 / GRID_PX * GRID_PX);
        let window = [0, 1].map(|axis| if half[axis] >= MIN_WINDOW_PX { half[axis] } else { size[axis] }.min(side));
        let sample = |i: usize| {
            let at = [i % 2, i / 2 % 2];
            let first = |axis: usize| {
                let middle = size[axis] * (1 + 2 * at[axis]) / 4;
                let last = size[axis] - window[axis];
                middle.saturating_sub(window[axis] / 2).min(last) / GRID_PX * GRID_PX
            };
            (i * frames / WINDOWS, AtlasWindow { at: [first(0), first(1)], size: window })
        };
        let mut samples: Vec<(usize, AtlasWindow)> = Vec::new();
        for (frame, window) in (0..WINDOWS).map(sample) {
            // Tiles of two windows must not have the same noise.
            if !samples.contains(&(frame, window)) {
                samples.push((frame, window));
            }
        }
        Self { samples }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_frames_are_sampled_whole_and_evenly() {
        let plan = SamplingPlan::of([640, 480], 50, MAX_ATLAS_PX);
        let frames: Vec<usize> = plan.samples.iter().map(|sample| sample.0).collect();
        // 2,097,152 / 307,200 = 6.8.
        assert_eq!(frames, [0, 8, 16, 25, 33, 41]);
        assert!(plan.samples.iter().all(|sample| sample.1 == AtlasWindow { at: [0, 0], size: [640, 480] }));
        assert_eq!(SamplingPlan::of([640, 480], 4, MAX_ATLAS_PX).samples.len(), 4);
        // One frame of a pair.
        assert_eq!(SamplingPlan::of([640, 480], 1, MAX_ATLAS_PX).samples.len(), 1);
    }

    #[test]
    fn large_frames_are_sampled_as_aligned_windows_within_the_budget() {
        for (size, frames) in
            [([1920, 1080], 30), ([6000, 4000], 1), ([1000, 800], 1), ([6000, 300], 9), ([6000, 300], 1)]
        {
            let plan = SamplingPlan::of(size, frames, MAX_ATLAS_PX);
            let mut area = 0;
            for (i, (frame, window)) in plan.samples.iter().enumerate() {
                let is_disjoint = |other: &AtlasWindow| {
                    (0..2).any(|axis| other.at[axis].abs_diff(window.at[axis]) >= window.size[axis])
                };
                let others = plan.samples[i + 1..].iter().filter(|sample| sample.0 == *frame);
                assert!(others.clone().all(|(_, other)| is_disjoint(other)), "{size:?}");
            }
            for (frame, window) in &plan.samples {
                assert!(*frame < frames && (0..2).all(|axis| window.at[axis] + window.size[axis] <= size[axis]));
                assert!(window.at.iter().all(|at| at % GRID_PX == 0), "{window:?}");
                area += window.size[0] * window.size[1];
            }
            assert!(area <= MAX_ATLAS_PX, "{size:?}: {area}");
            assert!(plan.samples[0].1.at[0] < plan.samples[1].1.at[0]);
        }
    }
}
