//! Rolling shutter correction. Rows are read one after the other, so each row of a moving camera
//! has a pose of its own. A pose estimated for a global shutter is off by the motion during the
//! readout.

use super::continuity::ChosenPose;
use super::sight::BoardPose;
use super::solve::solve_pose;
use crate::camera::Geometry;
use crate::pose::Pose;

/// Longest interval between poses from which motion is estimated, seconds.
const MAX_INTERVAL_S: f64 = 0.2;

/// Corrects poses estimated for a global shutter: returns those of the middle row, at the frames'
/// times. The motion follows from the neighbouring frames. Without a readout time, and for isolated
/// frames, the pose is unchanged.
pub fn correct_rolling_shutter(
    geometry: &Geometry,
    sights: &[(f64, Option<BoardPose>)],
    chosen: &[Option<ChosenPose>],
) -> Vec<Option<ChosenPose>> {
    let rolls = geometry.intrinsics.readout_time_s > 0.0;
    let one = |(i, own): (usize, &Option<ChosenPose>)| {
        let own = own.as_ref()?;
        let corrected = sights.get(i).and_then(|(_, sight)| corrected(geometry, sight.as_ref()?, own, chosen, i));
        Some(corrected.filter(|_| rolls).unwrap_or_else(|| own.clone()))
    };
    chosen.iter().enumerate().map(one).collect()
}

fn corrected(
    geometry: &Geometry,
    sight: &BoardPose,
    own: &ChosenPose,
    chosen: &[Option<ChosenPose>],
    i: usize,
) -> Option<ChosenPose> {
    let near = |other: &&ChosenPose| (other.time_s - own.time_s).abs() <= MAX_INTERVAL_S;
    let before = chosen[..i].last().and_then(Option::as_ref).filter(near).unwrap_or(own);
    let after = chosen.get(i + 1).and_then(Option::as_ref).filter(near).unwrap_or(own);
    let apart_s = after.time_s - before.time_s;
    if apart_s <= 0.0 {
        return None;
    }
    // All poses have about the same error, so the motion between them is correct.
    let at = |time_s: f64| before.solved.pose.interpolate(&after.solved.pose, (time_s - before.time_s) / apart_s);
    let begin = at(own.time_s);
    let moved = sight.corners.seen_px.iter().map(|corner_px| {
        let then = at(own.time_s + geometry.row_time_s(corner_px.y));
        let rotation = then.rotation * begin.rotation.conjugate();
        Pose::new(rotation, then.translation_m - rotation * begin.translation_m)
    });
    let mut corners = sight.corners.clone();
    corners.moved = moved.collect();
    let solved = solve_pose(geometry, &corners, &own.solved.pose)?;
    Some(ChosenPose { solved, ..own.clone() })
}
