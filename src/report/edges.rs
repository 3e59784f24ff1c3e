//! Edges of one frame, projected into later ones by recorded and by refined poses.

use glam::{DVec2, DVec3};

use super::chart::Ink;
use super::correction::{recorded, refined};
use super::page::{Body, Cell, Figure};
use super::places::smooth;
use super::point_track::is_unoccluded;
use super::rolling_camera::RollingCamera;
use super::strips::lacking;
use super::tile::Tile;
use super::{ReportError, ReportSource};
use crate::fit::quantile::upper_median_in_place;
use crate::frame::Frame;
use crate::grey_image::{GreyImage, gaussian};

/// Distances to the later frames, frames.
const LATER: [usize; 4] = [0, 5, 10, 20];
/// Side of a picture, px, and step between its candidate positions, px.
const SIDE: usize = 160;
const CANDIDATE_STEP_PX: usize = 16;
/// Smallest gradient of an edge, codes of 255 per px.
const MIN_GRADIENT: f32 = 9.0;
/// Smallest number of edge points in a picture.
const MIN_POINTS: usize = 60;

pub fn edges(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Edges of the room";
    if let Some(why) = lacking(source) {
        return Ok(Figure::left_out(title, why.to_owned()));
    }
    let count = source.recording.frame_count();
    let start = (count / 2).min(count.saturating_sub(LATER[LATER.len() - 1] + 1));
    let mut frames = Vec::new();
    for later in LATER.into_iter().filter(|later| start + later < count) {
        frames.extend(source.recording.frames(start + later..start + later + 1)?.next().transpose()?);
    }
    let none = || Ok(Figure::left_out(title, "no edges with depth are seen in two frames".to_owned()));
    let Some(first) = frames.first() else { return none() };
    let edge_points = points(first);
    let was = recorded(source);
    let now = refined(source).unwrap_or(was);
    let Some(centre) = centre(&edge_points, first, &frames, &now) else { return none() };
    let near = |at: &DVec2| (*at - centre.0).abs().max_element() < SIDE as f64 / 2.0;
    let edge_points: Vec<(DVec2, f64)> = edge_points.into_iter().filter(|(at, _)| near(at)).collect();
    let world = |camera: &RollingCamera<'_>| -> Vec<DVec3> {
        edge_points.iter().filter_map(|(at, z)| camera.unproject(first.timestamp_s, *at, *z)).collect()
    };
    let is_refined = source.analysis.refined().is_some();
    let cameras = if is_refined { vec![was, now] } else { vec![was] };
    let mut cells = Vec::new();
    for frame in &frames {
        let about =
            now.unproject(first.timestamp_s, centre.0, centre.1).and_then(|p| now.project(frame.timestamp_s, p));
        let Some((about, _)) = about.filter(|(at, _)| is_inside(frame, *at)) else { continue };
        let tile = Tile::cut(&frame.pixels, about, SIDE);
        let mut pictures = Vec::new();
        for camera in &cameras {
            let projected = world(camera).into_iter().filter_map(|point| camera.project(frame.timestamp_s, point));
            let places: Vec<DVec2> =
                projected.filter(|(at, z)| is_unoccluded(frame, *at, *z)).map(|(at, _)| at).collect();
            pictures.push(tile.dotted(about, &places)?);
        }
        cells.push(Cell { frame: frame.index, is_start: frame.index == start, pictures });
    }
    if cells.len() < 2 {
        return none();
    }
    let caption = format!(
        "Steep places of frame {start}, on surfaces with depth, drawn at their positions by the poses in it and up to {} frames later{}",
        LATER[LATER.len() - 1],
        if is_refined { ": above as recorded, below refined." } else { ", as recorded." }
    );
    let rows = [(Ink::Recorded, "as recorded"), (Ink::Found, "refined")];
    let rows = rows[..cameras.len()].to_vec();
    Ok(Figure { title, caption, legend: rows.clone(), body: Body::Strip { rows, side: 2 * SIDE, cells } })
}

/// Maxima of the gradient across edges, with their depths.
fn points(frame: &Frame) -> Vec<(DVec2, f64)> {
    let Some(depth) = frame.depth.as_ref() else { return Vec::new() };
    let (width, height) = (frame.pixels.width as usize, frame.pixels.height as usize);
    if (depth.width as usize, depth.height as usize) != (width, height) {
        return Vec::new();
    }
    let (along, down) = GreyImage::luma_601(&frame.pixels).filtered(&gaussian(1.0)).sobel();
    let slope = |x: usize, y: usize| along.values[y * width + x].hypot(down.values[y * width + x]);
    let mut edge_points = Vec::new();
    for y in 8..height.saturating_sub(8) {
        for x in 8..width.saturating_sub(8) {
            let here = slope(x, y);
            if here < MIN_GRADIENT {
                continue;
            }
            let (dx, dy) = (along.values[y * width + x] / here, down.values[y * width + x] / here);
            let at = |by: f32| slope((x as f32 + by * dx).round() as usize, (y as f32 + by * dy).round() as usize);
            if here >= at(1.0)
                && here > at(-1.0)
                && let Some(z) = smooth(depth, x, y)
            {
                edge_points.push((DVec2::new(x as f64 + 0.5, y as f64 + 0.5), z));
            }
        }
    }
    edge_points
}

fn is_inside(frame: &Frame, at: DVec2) -> bool {
    let rim = SIDE as f64 / 2.0;
    let size = DVec2::new(frame.pixels.width.into(), frame.pixels.height.into());
    at.x >= rim && at.y >= rim && at.x <= size.x - rim && at.y <= size.y - rim
}

/// The position that most frames show, and with the most edge points around among these; with its
/// depth.
fn centre(
    edge_points: &[(DVec2, f64)],
    first: &Frame,
    frames: &[Frame],
    camera: &RollingCamera<'_>,
) -> Option<(DVec2, f64)> {
    let (width, height) = (first.pixels.width as usize, first.pixels.height as usize);
    let half = SIDE / 2;
    let mut best: Option<((usize, usize), DVec2, f64)> = None;
    for y in (half..(height + 1).saturating_sub(half)).step_by(CANDIDATE_STEP_PX) {
        for x in (half..(width + 1).saturating_sub(half)).step_by(CANDIDATE_STEP_PX) {
            let at = DVec2::new(x as f64, y as f64);
            let within = edge_points.iter().filter(|(place, _)| (*place - at).abs().max_element() < half as f64);
            let mut depths: Vec<f64> = within.map(|(_, z)| *z).collect();
            if depths.len() < MIN_POINTS {
                continue;
            }
            let Some(z) = upper_median_in_place(&mut depths) else { continue };
            let Some(point) = camera.unproject(first.timestamp_s, at, z) else { continue };
            let shows =
                |frame: &&Frame| camera.project(frame.timestamp_s, point).is_some_and(|(at, _)| is_inside(frame, at));
            let score = (frames.iter().filter(shows).count(), depths.len());
            if best.is_none_or(|(best_score, ..)| score > best_score) {
                best = Some((score, at, z));
            }
        }
    }
    best.map(|(_, at, z)| (at, z))
}
