//! How much of the evidence is seen while the camera is lost and found: it fades, and never jumps.

/// All of it is seen for so long after the last real pose, seconds: three frames of 30 Hz. A tag that is missed in one or two
/// pictures must not make it flicker, and motion that is predicted on for longer is seen to be wrong.
pub const WHOLE_S: f64 = 0.1;
/// Then it falls to nothing, and once the camera is found it rises to all, within so long, seconds: six frames of 30 Hz. The
/// eye sums light over about a tenth of a second (Bloch's law): what takes twice as long is seen to fade. Evidence that is
/// held still while the picture moves on must not be seen for longer than that.
pub const FADE_S: f64 = 0.2;

/// The share that may be seen so long after the last real pose, 0 to 1.
fn after_s(since_real_s: f64) -> f64 {
    (1.0 - (since_real_s - WHOLE_S) / FADE_S).clamp(0.0, 1.0)
}

/// The presence of frame after frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Presence {
    /// The frame before: its time, and the share that was seen.
    before: Option<(f64, f64)>,
}

impl Presence {
    /// The share of the layer that is seen in the next frame, 0 to 1. `since_real_s`: how long ago the last real pose was,
    /// nothing or less if there are some on both sides; `None` if the frame has no pose. `trust`: how far its pose can be
    /// trusted, 0 to 1; evidence that may be in a wrong place fades sooner, and no faster. A first frame has nothing to rise from.
    pub fn next(&mut self, at_s: f64, since_real_s: Option<f64>, trust: f64) -> f64 {
        let most = since_real_s.map_or(0.0, after_s);
        let (fallen, risen) = self.before.map_or((trust, 1.0), |(before_s, share)| {
            let step = (at_s - before_s) / FADE_S;
            (trust.max(share - step), share + step)
        });
        let share = most.min(fallen).min(risen);
        self.before = Some((at_s, share));
        share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const INTERVAL_S: f64 = 1.0 / 30.0;

    #[test]
    fn a_lost_camera_by_hand() {
        let mut presence = Presence::default();
        let mut at = |frame: u32, since_s| (600.0 * presence.next(0.05 * f64::from(frame), since_s, 1.0)).round();
        // Frames at 20 Hz: there from the first on, missed twice, lost for 0.3 s, found.
        assert_eq!([0, 1].map(|n| at(n, Some(-0.01))), [600.0; 2]);
        assert_eq!([(2, 0.05), (3, 0.1)].map(|(n, since_s)| at(n, Some(since_s))), [600.0; 2]);
        assert_eq!([4, 5, 6, 7].map(|n| at(n, Some(0.05 * f64::from(n - 1)))), [450.0, 300.0, 150.0, 0.0]);
        assert_eq!(at(8, None), 0.0);
        assert_eq!([9, 10, 11, 12, 13].map(|n| at(n, Some(0.0))), [150.0, 300.0, 450.0, 600.0, 600.0]);
    }

    #[test]
    fn what_is_found_while_it_falls_rises_from_there() {
        let mut presence = Presence::default();
        presence.next(0.0, Some(0.0), 1.0);
        let fallen = presence.next(0.2, Some(0.2), 1.0);
        assert!((fallen - 0.5).abs() < 1e-12);
        assert!((presence.next(0.25, Some(0.0), 1.0) - 0.75).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_trusted_fades_at_once_and_no_faster() {
        let mut presence = Presence::default();
        let mut at = |frame: u32, trust| (600.0 * presence.next(0.05 * f64::from(frame), Some(0.0), trust)).round();
        let seen = [(0, 1.0), (1, 0.9), (2, 0.0), (3, 0.0), (4, 1.0), (5, 1.0)].map(|(n, trust)| at(n, trust));
        assert_eq!(seen, [600.0, 540.0, 390.0, 240.0, 390.0, 540.0]);
    }

    proptest! {
        /// Whatever is seen and missed: the share is one, and changes by no more than the time since the frame before allows.
        #[test]
        fn it_never_jumps(seen in prop::collection::vec((any::<bool>(), 0.0f64..=1.0), 1..100)) {
            let (mut presence, mut real_s, mut before) = (Presence::default(), None, None);
            for (frame, (seen, trust)) in seen.into_iter().enumerate() {
                let at_s = INTERVAL_S * frame as f64;
                real_s = if seen { Some(at_s) } else { real_s };
                // Live gives it up once nothing of it is seen.
                let since_s = real_s.map(|real_s| at_s - real_s).filter(|since_s| *since_s < WHOLE_S + FADE_S);
                let share = presence.next(at_s, since_s, trust);
                prop_assert!((0.0..=1.0).contains(&share));
                if let Some(before) = before {
                    let step: f64 = share - before;
                    prop_assert!(step.abs() <= INTERVAL_S / FADE_S + 1e-9, "{before} {share}");
                }
                before = Some(share);
            }
        }
    }
}
