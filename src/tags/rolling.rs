//! Rows are read one after the other. In a picture of a camera that moves each row has a pose of its own, and what was
//! solved as if they had one is off by what the camera moved meanwhile.

use super::continuity::Chosen;
use super::sight::Sight;
use super::solve::solved;
use crate::camera::Geometry;
use crate::pose::Pose;

/// Poses farther apart in time do not say how the camera moved, seconds.
const REACH_S: f64 = 0.2;

/// The poses at the frames' times, of the middle row, from those that were chosen as if a picture were taken at once. How
/// the camera moved follows from the frames before and after. Without a readout time, and where a frame stands alone, the
/// pose stays.
pub fn rolled(geometry: &Geometry, sights: &[(f64, Option<Sight>)], chosen: &[Option<Chosen>]) -> Vec<Option<Chosen>> {
    let rolls = geometry.intrinsics.readout_time_s > 0.0;
    let one = |(i, own): (usize, &Option<Chosen>)| {
        let own = own.as_ref()?;
        let better = sights.get(i).and_then(|(_, sight)| better(geometry, sight.as_ref()?, own, chosen, i));
        Some(better.filter(|_| rolls).unwrap_or_else(|| own.clone()))
    };
    chosen.iter().enumerate().map(one).collect()
}

fn better(geometry: &Geometry, sight: &Sight, own: &Chosen, chosen: &[Option<Chosen>], i: usize) -> Option<Chosen> {
    let near = |other: &&Chosen| (other.time_s - own.time_s).abs() <= REACH_S;
    let before = chosen[..i].last().and_then(Option::as_ref).filter(near).unwrap_or(own);
    let after = chosen.get(i + 1).and_then(Option::as_ref).filter(near).unwrap_or(own);
    let apart_s = after.time_s - before.time_s;
    if apart_s <= 0.0 {
        return None;
    }
    // All of them are off alike, so the way from one to the next is right.
    let at = |time_s: f64| before.solved.pose.interpolate(&after.solved.pose, (time_s - before.time_s) / apart_s);
    let begin = at(own.time_s);
    let moved = sight.corners.seen_px.iter().map(|seen| {
        let then = at(own.time_s + geometry.row_time_s(seen.y));
        let rotation = then.rotation * begin.rotation.conjugate();
        Pose::new(rotation, then.translation_m - rotation * begin.translation_m)
    });
    let mut corners = sight.corners.clone();
    corners.moved = moved.collect();
    let solved = solved(geometry, &corners, &own.solved.pose)?;
    Some(Chosen { solved, ..own.clone() })
}
