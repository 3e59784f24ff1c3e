//! Tracks a fixed point of the room through the frames that show it.

use glam::{DVec2, DVec3};

use super::ReportSource;
use super::correction::{recorded, refined};
use super::places::Place;
use super::tile::Tile;
use crate::analyse::is_same_surface;
use crate::frame::Frame;
use crate::recording::RecordingError;

/// Number of frames in which places are selected.
const START_FRAMES: usize = 5;
/// Length of the search range around a start frame, frames, and number of searched frames in it.
const SEARCH_RANGE: usize = 96;
const SEARCHED_FRAMES: usize = 32;
/// Largest number of candidates in a start frame, and of start frames that are searched.
const MAX_CANDIDATES: usize = 3;
const MAX_SEARCHED_STARTS: usize = 3;
/// Smallest number of frames that show a place.
const MIN_VIEWS: usize = 4;
/// Number of frames in the figure.
const SHOWN_FRAMES: usize = 12;

/// A view of the place in one frame.
#[derive(Clone, Debug)]
pub struct TrackedView {
    pub frame: usize,
    /// Its pixel by recorded poses, and the picture there.
    pub recorded: DVec2,
    pub by_recorded: Tile,
    /// Its pixel by the poses in use, and the picture there.
    pub used: DVec2,
    pub by_used: Tile,
}

/// A place of the room with its views.
#[derive(Clone, Debug)]
pub struct TrackedPlace {
    /// The frame in which the place was chosen: recorded and refined poses agree there.
    pub start: usize,
    pub place: Place,
    /// Views in the order of their frames.
    pub views: Vec<TrackedView>,
}

/// Selection of a place.
pub struct PlaceCriteria<'a> {
    /// Candidates in a frame.
    pub places: fn(&Frame) -> Vec<Place>,
    /// Score of a place by the frames that show it.
    pub rank: &'a dyn Fn(&Place, &[usize]) -> f64,
    /// Accepts or rejects a view.
    pub is_sound: fn(&Tile) -> bool,
    /// Key by which the shown frames are spread evenly.
    pub order: &'a dyn Fn(usize) -> f64,
    /// Side of the pictures, px.
    pub side: usize,
}

struct Candidate {
    start: usize,
    place: Place,
    /// World points by recorded poses and by the poses in use.
    points: [DVec3; 2],
    score: f64,
}

/// The place with the best rank; `None` if none is visible in enough frames.
pub fn track_place(
    source: &ReportSource<'_>,
    criteria: &PlaceCriteria<'_>,
) -> Result<Option<TrackedPlace>, RecordingError> {
    let mut candidates = Vec::new();
    for start in source.recording.spread_frames(START_FRAMES) {
        let Some(frame) = source.recording.frames(start..start + 1)?.next().transpose()? else { continue };
        let mut of_frame: Vec<Candidate> = (criteria.places)(&frame)
            .into_iter()
            .filter_map(|place| candidate(source, criteria, start, place))
            .collect();
        of_frame.sort_by(|a, b| b.score.total_cmp(&a.score));
        of_frame.truncate(MAX_CANDIDATES);
        candidates.push(of_frame);
    }
    candidates.retain(|of_frame| !of_frame.is_empty());
    candidates.sort_by(|a, b| b[0].score.total_cmp(&a[0].score));
    for of_frame in candidates.into_iter().take(MAX_SEARCHED_STARTS) {
        let views_of_places = views(source, criteria, &of_frame)?;
        let ranked = of_frame
            .iter()
            .zip(views_of_places)
            .filter(|(_, views_of_places)| views_of_places.len() >= MIN_VIEWS)
            .map(|(of, views_of_places)| {
                let frames: Vec<usize> = views_of_places.iter().map(|views_of_places| views_of_places.frame).collect();
                ((criteria.rank)(&of.place, &frames), of, views_of_places)
            });
        if let Some((_, of, views_of_places)) = ranked.max_by(|a, b| a.0.total_cmp(&b.0)) {
            let tracked_views = spread_evenly(views_of_places, of.start, criteria.order);
            return Ok(Some(TrackedPlace { start: of.start, place: of.place, views: tracked_views }));
        }
    }
    Ok(None)
}

/// Frames around a start frame, including it.
fn search_frames(start: usize, count: usize) -> Vec<usize> {
    let reach = SEARCH_RANGE.min(count);
    let from = start.saturating_sub(reach / 2).min(count - reach);
    let every = reach.div_ceil(SEARCHED_FRAMES);
    (from..from + reach).filter(|n| n.abs_diff(start).is_multiple_of(every)).collect()
}

fn candidate(source: &ReportSource<'_>, criteria: &PlaceCriteria<'_>, start: usize, place: Place) -> Option<Candidate> {
    let times_s = &source.recording.timestamps_s;
    let recorded = recorded(source);
    let used = refined(source).unwrap_or(recorded);
    let point =
        |camera: &super::rolling_camera::RollingCamera<'_>| camera.unproject(times_s[start], place.at, place.depth_m);
    let points = [point(&recorded)?, point(&used)?];
    let is_seen =
        |n: &usize| used.project(times_s[*n], points[1]).is_some_and(|(at, _)| is_inside(source, criteria, at));
    let frames: Vec<usize> = search_frames(start, times_s.len()).into_iter().filter(is_seen).collect();
    let score = (criteria.rank)(&place, &frames);
    (frames.len() >= MIN_VIEWS).then_some(Candidate { start, place, points, score })
}

/// True if a whole tile lies in the picture.
fn is_inside(source: &ReportSource<'_>, criteria: &PlaceCriteria<'_>, at: DVec2) -> bool {
    let (rim, size) = (criteria.side as f64 / 2.0 + 1.0, &source.recording);
    at.x > rim && at.y > rim && at.x < f64::from(size.width) - rim && at.y < f64::from(size.height) - rim
}

/// Views of each candidate of one frame.
fn views(
    source: &ReportSource<'_>,
    criteria: &PlaceCriteria<'_>,
    of_frame: &[Candidate],
) -> Result<Vec<Vec<TrackedView>>, RecordingError> {
    let frames = search_frames(of_frame[0].start, source.recording.frame_count());
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return Ok(Vec::new()) };
    let recorded = recorded(source);
    let used = refined(source).unwrap_or(recorded);
    let mut views_of_places: Vec<Vec<TrackedView>> = of_frame.iter().map(|_| Vec::new()).collect();
    for frame in source.recording.frames(*first..*last + 1)? {
        let frame = frame?;
        if frames.binary_search(&frame.index).is_err() {
            continue;
        }
        for (candidate, views_of_places) in of_frame.iter().zip(&mut views_of_places) {
            let at =
                |camera: &super::rolling_camera::RollingCamera<'_>, point| camera.project(frame.timestamp_s, point);
            let (Some((was, _)), Some((now, far_m))) =
                (at(&recorded, candidate.points[0]), at(&used, candidate.points[1]))
            else {
                continue;
            };
            if !is_inside(source, criteria, now) || !is_unoccluded(&frame, now, far_m) {
                continue;
            }
            let by_used = Tile::cut(&frame.pixels, now, criteria.side);
            if (criteria.is_sound)(&by_used) {
                let by_recorded = Tile::cut(&frame.pixels, was, criteria.side);
                views_of_places.push(TrackedView {
                    frame: frame.index,
                    recorded: was,
                    by_recorded,
                    used: now,
                    by_used,
                });
            }
        }
    }
    Ok(views_of_places)
}

/// True if the measured depth agrees, so that the point is not occluded.
pub fn is_unoccluded(frame: &Frame, at: DVec2, far_m: f64) -> bool {
    let depth = frame.depth.as_ref().filter(|map| (map.width, map.height) == (frame.pixels.width, frame.pixels.height));
    let depth_m = depth.and_then(|map| map.depth_m.get(at.y as usize * map.width as usize + at.x as usize));
    depth_m.is_some_and(|z| *z > 0.0 && is_same_surface(f64::from(*z), far_m, 0.0))
}

/// Selects twelve views, spread evenly by `order`, with the start frame and both ends.
fn spread_evenly(mut views: Vec<TrackedView>, start: usize, order: &dyn Fn(usize) -> f64) -> Vec<TrackedView> {
    if views.len() <= SHOWN_FRAMES {
        return views;
    }
    views.sort_by(|a, b| order(a.frame).total_cmp(&order(b.frame)).then(a.frame.cmp(&b.frame)));
    let last = views.len() - 1;
    let mut taken: Vec<usize> = (0..SHOWN_FRAMES).map(|k| k * last / (SHOWN_FRAMES - 1)).collect();
    if let Some(own) = views.iter().position(|views| views.frame == start) {
        let near = (1..SHOWN_FRAMES - 1).min_by_key(|k| taken[*k].abs_diff(own)).filter(|_| own != 0 && own != last);
        near.into_iter().for_each(|near| taken[near] = own);
    }
    let mut kept: Vec<TrackedView> = taken.into_iter().map(|n| views[n].clone()).collect();
    kept.sort_by_key(|views| views.frame);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::Pixels;

    #[test]
    fn searched_frames_include_the_start_and_stay_in_the_recording() {
        for (start, count) in [(0, 1), (2, 5), (0, 90), (89, 90), (45, 90), (1000, 5000), (4999, 5000)] {
            let frames = search_frames(start, count);
            assert!(frames.contains(&start) && frames.iter().all(|n| *n < count), "{start} {count}");
            assert!(frames.len() <= SEARCHED_FRAMES + 1 && frames.is_sorted());
        }
    }

    #[test]
    fn twelve_views_are_selected_with_both_ends_and_the_start() {
        let tile = Tile::cut(&Pixels::from_u8(4, 4, vec![0; 48]).unwrap(), DVec2::splat(2.0), 2);
        let tracked_view = |frame: usize| TrackedView {
            frame,
            recorded: DVec2::ZERO,
            by_recorded: tile.clone(),
            used: DVec2::ZERO,
            by_used: tile.clone(),
        };
        for start in [10, 13, 20, 42] {
            let kept = spread_evenly((10..43).map(tracked_view).collect(), start, &|frame| frame as f64);
            let frames: Vec<usize> = kept.iter().map(|view| view.frame).collect();
            assert_eq!((frames.len(), frames[0], frames[11]), (12, 10, 42));
            assert!(frames.contains(&start) && frames.is_sorted(), "{frames:?}");
        }
        assert_eq!(spread_evenly((3..8).map(tracked_view).collect(), 5, &|_| 0.0).len(), 5);
    }
}
