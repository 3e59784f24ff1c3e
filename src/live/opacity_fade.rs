//! Opacity of the evidence while tracking is lost and regained. It fades and never jumps.

/// Time of full opacity after the last measured pose, seconds: three frames at 30 Hz. A tag that is
/// missed in one or two pictures must not cause flicker. Motion predicted for longer is visibly
/// wrong.
pub const FULL_OPACITY_S: f64 = 0.1;
/// Duration of a full fade out or in, seconds: six frames at 30 Hz. The eye integrates light over
/// about a tenth of a second (Bloch's law), so twice that is perceived as a fade. Evidence that is
/// held still while the picture moves must not be visible for longer.
pub const FADE_S: f64 = 0.2;

/// Largest opacity at a time after the last measured pose, 0 to 1.
fn max_opacity(since_measured_s: f64) -> f64 {
    (1.0 - (since_measured_s - FULL_OPACITY_S) / FADE_S).clamp(0.0, 1.0)
}

/// Opacity over consecutive frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OpacityFade {
    /// Time and opacity of the previous frame.
    previous: Option<(f64, f64)>,
}

impl OpacityFade {
    /// Opacity of the next frame's virtual layer, 0 to 1.
    ///
    /// `since_measured_s` is the time since the last measured pose, at most 0 if there are measured
    /// ones on both sides, and `None` if the frame has no pose. `confidence` is that of the frame's
    /// pose, 0 to 1: at a doubtful place evidence fades sooner, but no faster. The first frame does
    /// not fade in.
    pub fn next(&mut self, at_s: f64, since_measured_s: Option<f64>, confidence: f64) -> f64 {
        let limit = since_measured_s.map_or(0.0, max_opacity);
        let (falling, rising) = self.previous.map_or((confidence, 1.0), |(previous_s, opacity)| {
            let step = (at_s - previous_s) / FADE_S;
            (confidence.max(opacity - step), opacity + step)
        });
        let opacity = limit.min(falling).min(rising);
        self.previous = Some((at_s, opacity));
        opacity
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const INTERVAL_S: f64 = 1.0 / 30.0;

    #[test]
    fn lost_camera_fades_out_and_in_by_the_computed_steps() {
        let mut fade = OpacityFade::default();
        let mut at = |frame: u32, since_s| (600.0 * fade.next(0.05 * f64::from(frame), since_s, 1.0)).round();
        // Frames at 20 Hz: tracked from the start, missed twice, lost for 0.3 s, found.
        assert_eq!([0, 1].map(|n| at(n, Some(-0.01))), [600.0; 2]);
        assert_eq!([(2, 0.05), (3, 0.1)].map(|(n, since_s)| at(n, Some(since_s))), [600.0; 2]);
        assert_eq!([4, 5, 6, 7].map(|n| at(n, Some(0.05 * f64::from(n - 1)))), [450.0, 300.0, 150.0, 0.0]);
        assert_eq!(at(8, None), 0.0);
        assert_eq!([9, 10, 11, 12, 13].map(|n| at(n, Some(0.0))), [150.0, 300.0, 450.0, 600.0, 600.0]);
    }

    #[test]
    fn regained_tracking_fades_in_from_the_current_opacity() {
        let mut fade = OpacityFade::default();
        fade.next(0.0, Some(0.0), 1.0);
        let falling = fade.next(0.2, Some(0.2), 1.0);
        assert!((falling - 0.5).abs() < 1e-12);
        assert!((fade.next(0.25, Some(0.0), 1.0) - 0.75).abs() < 1e-12);
    }

    #[test]
    fn low_confidence_fades_at_once_at_the_usual_rate() {
        let mut fade = OpacityFade::default();
        let mut at =
            |frame: u32, confidence| (600.0 * fade.next(0.05 * f64::from(frame), Some(0.0), confidence)).round();
        let opacities =
            [(0, 1.0), (1, 0.9), (2, 0.0), (3, 0.0), (4, 1.0), (5, 1.0)].map(|(n, confidence)| at(n, confidence));
        assert_eq!(opacities, [600.0, 540.0, 390.0, 240.0, 390.0, 540.0]);
    }

    proptest! {
        /// For any sequence of hits and misses, the opacity is in range and changes no faster than
        /// the fade.
        #[test]
        fn opacity_never_jumps(frames in prop::collection::vec((any::<bool>(), 0.0f64..=1.0), 1..100)) {
            let (mut fade, mut measured_s, mut previous) = (OpacityFade::default(), None, None);
            for (frame, (is_tracked, confidence)) in frames.into_iter().enumerate() {
                let at_s = INTERVAL_S * frame as f64;
                measured_s = if is_tracked { Some(at_s) } else { measured_s };
                // The caller gives the pose up once the opacity is 0.
                let since_s = measured_s.map(|measured_s| at_s - measured_s).filter(|since_s| *since_s < FULL_OPACITY_S + FADE_S);
                let opacity = fade.next(at_s, since_s, confidence);
                prop_assert!((0.0..=1.0).contains(&opacity));
                if let Some(previous) = previous {
                    let step: f64 = opacity - previous;
                    prop_assert!(step.abs() <= INTERVAL_S / FADE_S + 1e-9, "{previous} {opacity}");
                }
                previous = Some(opacity);
            }
        }
    }
}
