//! A fixed point of the room, in the frames that show it.

use glam::{DVec2, DVec3};

use super::Source;
use super::correction::{recorded, refined};
use super::places::Place;
use super::tile::Tile;
use crate::analyse::is_same_surface;
use crate::frame::Frame;
use crate::recording::RecordingError;

/// Frames in which places are looked for.
const STARTS: usize = 5;
/// A place is looked for in so many frames about its own, one in so many of them.
const AROUND: usize = 96;
const LOOKS: usize = 32;
/// Of a frame's places, and frames, that are looked at more closely.
const PLACES: usize = 3;
const TRIES: usize = 3;
/// Fewer frames show nothing.
const LEAST_SEEN: usize = 4;
/// Frames that are shown.
const SHOWN: usize = 12;

/// A place in one frame.
#[derive(Clone, Debug)]
pub struct Seen {
    pub frame: usize,
    /// Where recorded poses say it is, and the picture there.
    pub recorded: DVec2,
    pub by_recorded: Tile,
    /// The same by the poses that are used.
    pub used: DVec2,
    pub by_used: Tile,
}

#[derive(Clone, Debug)]
pub struct Followed {
    /// The frame in which the place was chosen: recorded and refined poses agree there.
    pub start: usize,
    pub place: Place,
    /// In order.
    pub seen: Vec<Seen>,
}

/// What is looked for.
pub struct Wanted<'a> {
    /// Places of a frame.
    pub places: fn(&Frame) -> Vec<Place>,
    /// How well a place serves that those frames show.
    pub rank: &'a dyn Fn(&Place, &[usize]) -> f64,
    /// Whether a picture of it counts.
    pub is_sound: fn(&Tile) -> bool,
    /// How a frame is known from others when twelve of many are chosen evenly.
    pub order: &'a dyn Fn(usize) -> f64,
    /// Size of the pictures, px.
    pub side: usize,
}

struct Candidate {
    start: usize,
    place: Place,
    /// By recorded poses and by those that are used.
    points: [DVec3; 2],
    score: f64,
}

/// The place that serves best; `None` if none is seen in enough frames.
pub fn followed(source: &Source<'_>, wanted: &Wanted<'_>) -> Result<Option<Followed>, RecordingError> {
    let count = source.recording.frame_count();
    let mut candidates = Vec::new();
    let mut starts: Vec<usize> = (0..STARTS).map(|k| (2 * k + 1) * count / (2 * STARTS)).collect();
    starts.dedup();
    for start in starts {
        let Some(frame) = source.recording.frames(start..start + 1)?.next().transpose()? else { continue };
        let mut of_frame: Vec<Candidate> =
            (wanted.places)(&frame).into_iter().filter_map(|place| candidate(source, wanted, start, place)).collect();
        of_frame.sort_by(|a, b| b.score.total_cmp(&a.score));
        of_frame.truncate(PLACES);
        candidates.push(of_frame);
    }
    candidates.retain(|of_frame| !of_frame.is_empty());
    candidates.sort_by(|a, b| b[0].score.total_cmp(&a[0].score));
    for of_frame in candidates.into_iter().take(TRIES) {
        let seen = look(source, wanted, &of_frame)?;
        let ranked = of_frame.iter().zip(seen).filter(|(_, seen)| seen.len() >= LEAST_SEEN).map(|(of, seen)| {
            let frames: Vec<usize> = seen.iter().map(|seen| seen.frame).collect();
            ((wanted.rank)(&of.place, &frames), of, seen)
        });
        if let Some((_, of, seen)) = ranked.max_by(|a, b| a.0.total_cmp(&b.0)) {
            let seen = evenly(seen, of.start, wanted.order);
            return Ok(Some(Followed { start: of.start, place: of.place, seen }));
        }
    }
    Ok(None)
}

/// Frames about another, which is one of them.
fn around(start: usize, count: usize) -> Vec<usize> {
    let reach = AROUND.min(count);
    let from = start.saturating_sub(reach / 2).min(count - reach);
    let every = reach.div_ceil(LOOKS);
    (from..from + reach).filter(|n| n.abs_diff(start).is_multiple_of(every)).collect()
}

fn candidate(source: &Source<'_>, wanted: &Wanted<'_>, start: usize, place: Place) -> Option<Candidate> {
    let times_s = &source.recording.timestamps_s;
    let recorded = recorded(source);
    let used = refined(source).unwrap_or(recorded);
    let point = |sight: &super::sight::Sight<'_>| sight.point(times_s[start], place.at, place.depth_m);
    let points = [point(&recorded)?, point(&used)?];
    let is_seen = |n: &usize| used.seen(times_s[*n], points[1]).is_some_and(|(at, _)| is_inside(source, wanted, at));
    let frames: Vec<usize> = around(start, times_s.len()).into_iter().filter(is_seen).collect();
    let score = (wanted.rank)(&place, &frames);
    (frames.len() >= LEAST_SEEN).then_some(Candidate { start, place, points, score })
}

/// Whether a whole tile lies in the picture.
fn is_inside(source: &Source<'_>, wanted: &Wanted<'_>, at: DVec2) -> bool {
    let (rim, size) = (wanted.side as f64 / 2.0 + 1.0, &source.recording);
    at.x > rim && at.y > rim && at.x < f64::from(size.width) - rim && at.y < f64::from(size.height) - rim
}

/// For each candidate of one frame, the frames that do show it.
fn look(source: &Source<'_>, wanted: &Wanted<'_>, of_frame: &[Candidate]) -> Result<Vec<Vec<Seen>>, RecordingError> {
    let frames = around(of_frame[0].start, source.recording.frame_count());
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Ok(Vec::new()) };
    let recorded = recorded(source);
    let used = refined(source).unwrap_or(recorded);
    let mut found: Vec<Vec<Seen>> = of_frame.iter().map(|_| Vec::new()).collect();
    for frame in source.recording.frames(*first..*last + 1)? {
        let frame = frame?;
        if frames.binary_search(&frame.index).is_err() {
            continue;
        }
        for (candidate, found) in of_frame.iter().zip(&mut found) {
            let at = |sight: &super::sight::Sight<'_>, point| sight.seen(frame.timestamp_s, point);
            let (Some((was, _)), Some((now, far_m))) =
                (at(&recorded, candidate.points[0]), at(&used, candidate.points[1]))
            else {
                continue;
            };
            if !is_inside(source, wanted, now) || !is_there(&frame, now, far_m) {
                continue;
            }
            let by_used = Tile::cut(&frame.pixels, now, wanted.side);
            if (wanted.is_sound)(&by_used) {
                let by_recorded = Tile::cut(&frame.pixels, was, wanted.side);
                found.push(Seen { frame: frame.index, recorded: was, by_recorded, used: now, by_used });
            }
        }
    }
    Ok(found)
}

/// Whether depth says that nothing is in front of it.
pub fn is_there(frame: &Frame, at: DVec2, far_m: f64) -> bool {
    let depth = frame.depth.as_ref().filter(|map| (map.width, map.height) == (frame.pixels.width, frame.pixels.height));
    let depth_m = depth.and_then(|map| map.depth_m.get(at.y as usize * map.width as usize + at.x as usize));
    depth_m.is_some_and(|z| *z > 0.0 && is_same_surface(f64::from(*z), far_m, 0.0))
}

/// Twelve of them, evenly by `order`, with the frame it began in and both ends.
fn evenly(mut seen: Vec<Seen>, start: usize, order: &dyn Fn(usize) -> f64) -> Vec<Seen> {
    if seen.len() <= SHOWN {
        return seen;
    }
    seen.sort_by(|a, b| order(a.frame).total_cmp(&order(b.frame)).then(a.frame.cmp(&b.frame)));
    let last = seen.len() - 1;
    let mut taken: Vec<usize> = (0..SHOWN).map(|k| k * last / (SHOWN - 1)).collect();
    if let Some(own) = seen.iter().position(|seen| seen.frame == start) {
        let near = (1..SHOWN - 1).min_by_key(|k| taken[*k].abs_diff(own)).filter(|_| own != 0 && own != last);
        near.into_iter().for_each(|near| taken[near] = own);
    }
    let mut kept: Vec<Seen> = taken.into_iter().map(|n| seen[n].clone()).collect();
    kept.sort_by_key(|seen| seen.frame);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::Pixels;

    #[test]
    fn frames_about_another_contain_it_and_stay_in_the_recording() {
        for (start, count) in [(0, 1), (2, 5), (0, 90), (89, 90), (45, 90), (1000, 5000), (4999, 5000)] {
            let frames = around(start, count);
            assert!(frames.contains(&start) && frames.iter().all(|n| *n < count), "{start} {count}");
            assert!(frames.len() <= LOOKS + 1 && frames.is_sorted());
        }
    }

    #[test]
    fn twelve_are_taken_with_both_ends_and_the_frame_it_began_in() {
        let tile = Tile::cut(&Pixels::from_u8(4, 4, vec![0; 48]).unwrap(), DVec2::splat(2.0), 2);
        let of = |frame: usize| Seen {
            frame,
            recorded: DVec2::ZERO,
            by_recorded: tile.clone(),
            used: DVec2::ZERO,
            by_used: tile.clone(),
        };
        for start in [10, 13, 20, 42] {
            let kept = evenly((10..43).map(of).collect(), start, &|frame| frame as f64);
            let frames: Vec<usize> = kept.iter().map(|seen| seen.frame).collect();
            assert_eq!((frames.len(), frames[0], frames[11]), (12, 10, 42));
            assert!(frames.contains(&start) && frames.is_sorted(), "{frames:?}");
        }
        assert_eq!(evenly((3..8).map(of).collect(), 5, &|_| 0.0).len(), 5);
    }
}
