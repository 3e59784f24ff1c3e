//! Cost of a part, by timed samples.

/// Cost of compositing on one machine: a part of n frames takes `startup_s + n · frame_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartCost {
    /// Time from the start of the program to the first frame, s.
    pub startup_s: f64,
    /// Time of each frame, s.
    pub frame_s: f64,
}

/// Smallest measurable cost of a frame, s.
const MIN_FRAME_S: f64 = 1e-3;

impl PartCost {
    /// Cost by the time of a run of one frame, and by the shortest of runs of `frames` frames
    /// elsewhere in the recording: other work on the machine only lengthens a run. `None` if the
    /// runs show no cost of a frame.
    pub fn of_samples(one_frame_s: f64, frames: usize, runs_s: &[f64]) -> Option<Self> {
        let shortest_s = runs_s.iter().copied().reduce(f64::min).filter(|_| frames > 1)?;
        let frame_s = Some((shortest_s - one_frame_s) / (frames - 1) as f64).filter(|s| *s > MIN_FRAME_S)?;
        Some(Self { startup_s: (one_frame_s - frame_s).max(0.0), frame_s })
    }

    /// Duration of a part, s.
    pub fn of_part_s(self, frames: usize) -> f64 {
        self.startup_s + frames as f64 * self.frame_s
    }

    /// Number of parts of about `part_s` seconds into which frames divide; at least 1.
    pub fn parts(self, frames: usize, part_s: f64) -> usize {
        let per_part = ((part_s - self.startup_s) / self.frame_s).floor().max(1.0);
        (frames as f64 / per_part).ceil().max(1.0) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn startup_and_frame_follow_from_two_lengths_of_runs() {
        // 2 s to start and 0.5 s a frame: 2.5 s for one frame, 4 s for four.
        let cost = PartCost::of_samples(2.5, 4, &[4.8, 4.0, 9.0]).unwrap();
        assert!((cost.startup_s - 2.0).abs() < 1e-12 && (cost.frame_s - 0.5).abs() < 1e-12);
        assert!((cost.of_part_s(100) - 52.0).abs() < 1e-9);
        // 600 s: 1196 frames a part.
        assert_eq!(cost.parts(1196, 600.0), 1);
        assert_eq!(cost.parts(1197, 600.0), 2);
        assert_eq!(cost.parts(3, 0.1), 3);
        assert_eq!(PartCost::of_samples(1.0, 1, &[1.0]), None);
    }

    #[test]
    fn samples_without_a_cost_of_a_frame_give_none() {
        assert_eq!(PartCost::of_samples(2.0, 4, &[1.9, 3.0]), None);
        assert_eq!(PartCost::of_samples(2.0, 4, &[2.002]), None);
        assert_eq!(PartCost::of_samples(2.0, 4, &[]), None);
    }
}
