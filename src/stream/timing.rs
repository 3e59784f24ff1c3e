//! Time of a sample.

use super::sample::Sample;

/// Origin of a sample's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// `timing.sampleTimestamp`: PTP's seconds.
    Timestamp,
    /// `timing.timecode`: seconds since midnight.
    Timecode,
    /// Arrival: seconds since the start. For samples without a time, and for FreeD, which has none.
    Arrival,
}

impl std::fmt::Display for Clock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Timestamp => "its timestamps",
            Self::Timecode => "its timecode",
            Self::Arrival => "its arrival, for it has no time of its own",
        })
    }
}

/// A sample's time, seconds, and its origin. `None` if it has none.
pub fn clock(sample: &Sample) -> Option<(f64, Clock)> {
    let stamp = |name| sample.number(&["timing", "sampleTimestamp", name]);
    if let Some(seconds) = stamp("seconds") {
        return Some((seconds + 1e-9 * stamp("nanoseconds").unwrap_or(0.0), Clock::Timestamp));
    }
    timecode_s(sample).map(|time_s| (time_s, Clock::Timecode))
}

/// SMPTE ST 12-1: frames are counted at the rate rounded up. With `dropFrame` the first two numbers
/// (four at 60) of each minute are skipped, except in every tenth. Subframes are samples.
fn timecode_s(sample: &Sample) -> Option<f64> {
    let part = |name| sample.unsigned(&["timing", "timecode", name]).filter(|number| *number < 1 << 32);
    let rate_hz = sample.ratio(&["timing", "timecode", "frameRate"]).filter(|rate| (1.0..1e6).contains(rate))?;
    let per_second = rate_hz.ceil() as u64;
    let minutes = 60 * part("hours")? + part("minutes")?;
    let mut frames = (60 * minutes + part("seconds")?) * per_second + part("frames")?;
    if sample.get(&["timing", "timecode", "dropFrame"]).and_then(|drop| drop.as_bool()) == Some(true) {
        frames -= (per_second / 15) * (minutes - minutes / 10);
    }
    let subframe_s = sample.ratio(&["timing", "sampleRate"]).map_or(0.0, |rate_hz| 1.0 / rate_hz);
    Some(frames as f64 / rate_hz + part("subFrame").unwrap_or(0) as f64 * subframe_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Encoding;

    fn of(timing: &str) -> Option<(f64, Clock)> {
        clock(&Sample::decode(Encoding::Json, format!(r#"{{"timing":{timing}}}"#).as_bytes()).unwrap())
    }

    #[test]
    fn times_match_computed_values() {
        let time = of(r#"{"sampleTimestamp":{"seconds":1718806554,"nanoseconds":500000000}}"#);
        assert_eq!(time, Some((1_718_806_554.5, Clock::Timestamp)));
        // The official examples: 1:02:03:04 at 24000/1001 are 3723·24 + 4 = 89356 frames, each
        // 1001/24000 s.
        let code =
            r#"{"timecode":{"hours":1,"minutes":2,"seconds":3,"frames":4,"frameRate":{"num":24000,"denom":1001}}}"#;
        let (time_s, kind) = of(code).unwrap();
        assert!((time_s - 89356.0 * 1001.0 / 24000.0).abs() < 1e-9 && kind == Clock::Timecode, "{time_s}");
        // One hour of drop frame is an hour but for 3.6 ms: 108000 − 2·54 = 107892 frames.
        let hour = r#"{"timecode":{"hours":1,"minutes":0,"seconds":0,"frames":0,"dropFrame":true,"frameRate":{"num":30000,"denom":1001}}}"#;
        let (time_s, _) = of(hour).unwrap();
        assert!((time_s - 3599.9964).abs() < 1e-6, "{time_s}");
        // Two samples a frame: the second is half a frame later.
        let half = r#"{"sampleRate":{"num":50,"denom":1},"timecode":{"hours":0,"minutes":0,"seconds":1,"frames":5,"subFrame":1,"frameRate":{"num":25,"denom":1}}}"#;
        assert!((of(half).unwrap().0 - 1.22).abs() < 1e-12);
    }

    #[test]
    fn sample_without_a_time_gives_none() {
        for timing in [
            "{}",
            r#"{"sampleTimestamp":{"nanoseconds":1}}"#,
            r#"{"timecode":{"hours":1,"minutes":0,"seconds":0,"frames":0}}"#,
            r#"{"timecode":{"hours":-1,"minutes":0,"seconds":0,"frames":0,"frameRate":{"num":25,"denom":1}}}"#,
            r#"{"timecode":{"hours":1,"minutes":0,"seconds":0,"frames":0,"frameRate":{"num":25,"denom":0}}}"#,
        ] {
            assert_eq!(of(timing), None, "{timing}");
        }
        // The largest numbers give a time, not a panic.
        let largest = r#"{"timecode":{"hours":4294967295,"minutes":4294967295,"seconds":4294967295,"frames":0,"dropFrame":true,"frameRate":{"num":15,"denom":1}}}"#;
        assert!(of(largest).is_some());
    }
}
