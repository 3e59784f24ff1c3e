//! `locard inspect --clock`.

use anyhow::Result;

use locard_engine::shot::{Shot, ShotError};
use locard_engine::text::{count, fixed, shown};
use locard_engine::tracking::delay::{FrameRotation, MAX_SEARCHED_DELAY_S, estimate};
use locard_engine::tracking::turn::ImagePyramid;

/// Largest distance of two compared frames, in usual frame intervals.
const MAX_FRAME_INTERVALS: f64 = 2.5;

/// The line about the offset of the poses' clock, estimated from the pictures' motion. Decodes
/// every frame.
pub fn line(shot: &Shot) -> Result<String, ShotError> {
    let recording = &shot.recording;
    let mut motions = Vec::new();
    let mut before: Option<(f64, ImagePyramid)> = None;
    for frame in recording.frames(0..recording.frame_count())? {
        let frame = frame?;
        let geometry = shot.geometry_at(frame.index)?;
        if geometry.needs_cube_map() {
            return Ok("clock      unknown: only pictures that fit a plane are compared".to_owned());
        }
        let time_s = frame.timestamp_s;
        let now = ImagePyramid::new(&frame.pixels);
        let near = before.take().filter(|(t, _)| time_s - t <= MAX_FRAME_INTERVALS * recording.frame_interval_s);
        if let (Some((from_s, before)), Some(now)) = (near, &now)
            && let Some(turn) = before.rotation_to(now, &geometry.intrinsics)
        {
            motions.push(FrameRotation { from_s, to_s: time_s, turn });
        }
        before = now.map(|now| (time_s, now));
    }
    let (track, offset_s) = (&recording.track, recording.track.clock_offset_s());
    Ok(match estimate(&motions, |from_s, to_s| track.motion_between(from_s, to_s), MAX_SEARCHED_DELAY_S) {
        Ok(delay) => {
            let milliseconds = |s: f64| fixed(1e3 * s, 1);
            let fit = if delay.delay_s.abs() <= 2.0 * delay.sigma_s {
                format!("as recorded, within {} ms", milliseconds(2.0 * delay.sigma_s))
            } else {
                format!(
                    "poses {} ms {} fit the pictures best: time_offset_s = {} (now {})",
                    milliseconds(delay.delay_s.abs()),
                    if delay.delay_s > 0.0 { "later" } else { "earlier" },
                    fixed(offset_s + delay.delay_s, 4),
                    fixed(offset_s, 4)
                )
            };
            let quarters = match delay.quarters {
                0 => String::new(),
                quarters => format!(
                    "; the poses' camera is rotated by {}° about its optical axis relative to the pictures",
                    90 * quarters
                ),
            };
            format!(
                "clock      {fit}; ± {} ms by {}, likeness {}{quarters}",
                milliseconds(delay.sigma_s),
                count(delay.motions, "motion"),
                fixed(delay.likeness, 2)
            )
        }
        Err(why) => format!("clock      unknown: {}", shown(&why.to_string())),
    })
}
