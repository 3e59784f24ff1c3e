//! Film strips: a fixed point of the room at its projections by recorded and by refined poses, and
//! a flat place as recorded and divided by the frames' gains.

use super::chart::Ink;
use super::correction::{recorded, refined};
use super::page::{Body, Cell, Figure};
use super::places::{Place, flat, textured};
use super::point_track::{PlaceCriteria, TrackedPlace, track_place};
use super::tile::Tile;
use super::{ReportError, ReportSource};
use crate::text::fixed;

/// Size of a tile, px.
const SIDE: usize = 64;
/// Range of the mean codes of a flat place in a usable frame.
const CODES: (f64, f64) = (8.0, 247.0);

/// The reason for which no place of a recording can be tracked, if there is one.
pub fn lacking(source: &ReportSource<'_>) -> Option<&'static str> {
    let camera = refined(source).unwrap_or(recorded(source));
    let posed = source.recording.timestamps_s.iter().filter(|t| camera.pose(**t).is_some()).count();
    if !source.recording.has_depth() {
        Some("there is no depth, so no place of the room can be followed")
    } else if posed < 2 {
        Some("there are no poses, so no place of the room can be followed")
    } else if source.camera.needs_cube_map() {
        Some("the picture does not fit a plane in front of the camera")
    } else {
        None
    }
}

pub fn point(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "A fixed point of the room";
    if let Some(why) = lacking(source) {
        return Ok(Figure::left_out(title, why.to_owned()));
    }
    let criteria = PlaceCriteria {
        places: textured,
        rank: &|place: &Place, frames: &[usize]| frames.len() as f64 * place.score.sqrt(),
        is_sound: |_| true,
        order: &|frame| frame as f64,
        side: SIDE,
    };
    let Some(track) = track_place(source, &criteria)? else {
        return Ok(Figure::left_out(title, "no textured place with depth is seen in four frames".to_owned()));
    };
    let is_refined = source.analysis.refined().is_some();
    let mut cells = Vec::new();
    for view in &track.views {
        let mut pictures = vec![view.by_recorded.crossed(view.recorded)?];
        if is_refined {
            pictures.push(view.by_used.crossed(view.used)?);
        }
        cells.push(Cell { frame: view.frame, is_start: view.frame == track.start, pictures });
    }
    let apart = track.views.iter().map(|view| (view.recorded - view.used).length()).fold(0.0, f64::max);
    let mut caption = format!("{}, in frames that show it. ", chosen(&track));
    caption += &if is_refined {
        format!(
            "The cross is its position by the poses: above as recorded, below refined. They are up to {} px apart; in \
             frame {} they agree.",
            fixed(apart, 1),
            track.start
        )
    } else {
        "The cross is its position by the recorded poses.".to_owned()
    };
    let rows = [(Ink::Recorded, "as recorded"), (Ink::Found, "refined")];
    let rows = rows[..if is_refined { 2 } else { 1 }].to_vec();
    Ok(Figure { title, caption, legend: rows.clone(), body: Body::Strip { rows, side: 2 * SIDE, cells } })
}

pub fn brightness(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "A flat place of the room";
    let gains = &source.analysis.gains;
    if gains.is_empty() {
        return Ok(Figure::left_out(title, "no change of light is followed".to_owned()));
    }
    if let Some(why) = lacking(source) {
        return Ok(Figure::left_out(title, why.to_owned()));
    }
    let green = |frame: &usize| gains[*frame][1].log2();
    let range = |frames: &[usize]| {
        let (low, high) = (frames.iter().map(green)).fold((f64::MAX, f64::MIN), |(l, h), g| (l.min(g), h.max(g)));
        (high - low).max(0.0)
    };
    let criteria = PlaceCriteria {
        places: flat,
        rank: &|place: &Place, frames: &[usize]| range(frames) * place.score * (frames.len() as f64).sqrt(),
        is_sound: |tile| mean(tile).iter().all(|code| *code > CODES.0 && *code < CODES.1),
        order: &|frame| green(&frame),
        side: SIDE,
    };
    let Some(track) = track_place(source, &criteria)? else {
        return Ok(Figure::left_out(title, "no flat place with depth is seen in four frames".to_owned()));
    };
    let response = source.response;
    let evened = |frame: usize, tile: &Tile| {
        let table = [0, 1, 2].map(|c| -> Vec<u8> {
            let corrected_code =
                |code: u16| response.encode(response.decode(f64::from(code) / 255.0) / gains[frame][c]);
            (0..256).map(|code| (255.0 * corrected_code(code)).round() as u8).collect()
        });
        tile.with(|codes| [0, 1, 2].map(|c| table[c][usize::from(codes[c])]))
    };
    let light = |tile: &Tile| response.decode(mean(tile)[1] / 255.0).max(1e-6).log2();
    let (mut cells, mut before, mut after) = (Vec::new(), Vec::new(), Vec::new());
    for view in &track.views {
        let even = evened(view.frame, &view.by_used);
        before.push(light(&view.by_used));
        after.push(light(&even));
        let pictures = vec![view.by_used.plain()?, even.plain()?];
        cells.push(Cell { frame: view.frame, is_start: view.frame == track.start, pictures });
    }
    let caption = format!(
        "{}, in frames that show it, the darkest and the brightest among them: above as recorded, below divided by the gain that \
         was found. Its green light scatters by {} stops above, {} below (root mean square).",
        chosen(&track),
        fixed(scatter(&before), 2),
        fixed(scatter(&after), 2)
    );
    let rows = vec![(Ink::Recorded, "as recorded"), (Ink::Found, "divided by its gain")];
    Ok(Figure { title, caption, legend: rows.clone(), body: Body::Strip { rows, side: 2 * SIDE, cells } })
}

fn chosen(place: &TrackedPlace) -> String {
    let [x, y] = place.place.at.to_array().map(|v| fixed(v, 0));
    format!("The place at column {x}, row {y} of frame {}, {} m away", place.start, fixed(place.place.depth_m, 2))
}

/// Codes by channel.
fn mean(tile: &Tile) -> [f64; 3] {
    let count = tile.pixels().len().max(1) as f64;
    [0, 1, 2].map(|c| tile.pixels().iter().map(|codes| f64::from(codes[c])).sum::<f64>() / count)
}

fn scatter(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}
