//! Noise that persists from frame to frame.
//!
//! A video coder copies most of a resting picture from one frame to the next, with its noise. Here
//! each cell is refreshed in a frame with probability 1 − ρ, by its hash, and else keeps its noise.
//! So the noise of two frames n apart correlates by ρⁿ, and each frame's noise alone is that of the
//! model. The frame of a cell's last refresh is found by its hashes in that frame and in those
//! before it: no state.
//!
//! Not modelled: noise that a coder moves with the content. Noise persists over the frames in which
//! the objects are at rest in the picture; in motion, each frame has its own.

use crate::hash::pcg3d;

/// Largest number of frames that show one noise, about half a second.
pub const MAX_PERSISTENCE_FRAMES: usize = 16;
/// Smallest correlation of consecutive frames that is modelled. Below it, estimates from a few
/// frames do not differ from chance.
pub const MIN_FRAME_CORRELATION: f32 = 0.05;
/// Largest one. Noise that never changes is a fixed pattern.
const MAX_FRAME_CORRELATION: f32 = 0.95;

/// Hash keys of a frame and of the resting frames before it. Each cell uses one of them.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameKeys {
    /// This frame's key, then those of the resting frames before it. At least one, at most
    /// [`MAX_PERSISTENCE_FRAMES`].
    keys: Vec<[u32; 3]>,
    /// A cell is refreshed unless its hash is below this.
    kept_below: u32,
}

impl FrameKeys {
    /// Noise of one frame alone.
    pub fn single(key: [u32; 3]) -> Self {
        Self { keys: vec![key], kept_below: 0 }
    }

    /// `key_before` is the key of the frame so many frames earlier, of which `resting_frames` are
    /// at rest.
    pub fn new(frame_correlation: f32, resting_frames: usize, key_before: impl Fn(usize) -> [u32; 3]) -> Self {
        if frame_correlation.is_nan() || frame_correlation < MIN_FRAME_CORRELATION {
            return Self::single(key_before(0));
        }
        let kept_share = f64::from(frame_correlation.min(MAX_FRAME_CORRELATION));
        let last = resting_frames.min(MAX_PERSISTENCE_FRAMES - 1);
        Self { keys: (0..=last).map(key_before).collect(), kept_below: (kept_share * 2f64.powi(32)) as u32 }
    }

    pub fn keys(&self) -> &[[u32; 3]] {
        &self.keys
    }

    pub fn kept_below(&self) -> u32 {
        self.kept_below
    }

    /// The key of the frame in which a cell was last refreshed. The third word of
    /// pcg3d(key + (i, j, 0)), of which the others give the tile's mirroring, decides.
    pub fn of_cell(&self, cell: [u32; 2]) -> [u32; 3] {
        let is_kept = |key: &&[u32; 3]| {
            pcg3d([cell[0].wrapping_add(key[0]), cell[1].wrapping_add(key[1]), key[2]])[2] < self.kept_below
        };
        let age = self.keys.iter().take_while(is_kept).count();
        self.keys[age.min(self.keys.len() - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(frame: usize) -> [u32; 3] {
        pcg3d([frame as u32, 7, 9])
    }

    /// Keys of cells in a frame before which all are at rest.
    fn cells(frame: usize, correlation: f32) -> Vec<[u32; 3]> {
        let keys = FrameKeys::new(correlation, frame, |before| key(frame - before));
        (0..10_000).map(|i| keys.of_cell([i % 100, i / 100])).collect()
    }

    #[test]
    fn share_of_kept_cells_falls_by_the_correlation_with_each_frame() {
        let first = cells(40, 0.6);
        for (lag, share) in [(1, 0.6), (2, 0.36), (5, 0.078)] {
            let equal = cells(40 + lag, 0.6).iter().zip(&first).filter(|(a, b)| a == b).count();
            // Three standard deviations of 10,000 draws at most.
            assert!((equal as f64 / 10_000.0 - share).abs() < 0.015, "{lag}: {equal}");
        }
    }

    #[test]
    fn without_correlation_or_rest_each_frame_has_its_own_noise() {
        assert!(cells(40, 0.0).iter().all(|cell| *cell == key(40)));
        assert_eq!(FrameKeys::new(0.6, 0, key).keys(), [key(0)]);
        assert_eq!(FrameKeys::new(f32::NAN, 9, key), FrameKeys::single(key(0)));
        assert_eq!(FrameKeys::new(0.99, 99, key).keys().len(), MAX_PERSISTENCE_FRAMES);
    }

    /// Frames after a motion agree on the cells that they keep since then.
    #[test]
    fn rest_after_motion_keeps_the_same_cells_in_every_frame() {
        let at = |frame: usize| FrameKeys::new(0.9, frame - 30, |before| key(frame - before));
        let [earlier, later] = [at(33), at(34)];
        let equal_count = (0..1000).filter(|&i| earlier.of_cell([i, 3]) == later.of_cell([i, 3])).count();
        assert!((870..930).contains(&equal_count), "{equal_count}");
        assert!((0..1000).all(|i| (30..=33).map(key).any(|key| key == earlier.of_cell([i, 3]))));
    }
}
