//! Views that are taken by themselves from a camera's pictures as they come: of a board that is at rest, where it says
//! something new. Plain values in and out: it is told what is seen and when, and says what it made of that and what is
//! missing.

use glam::DVec2;

use super::calibrated::{Calibrated, LensOptions, NamedView};
use super::choose::{LensError, calibrate};
use super::missing::{Wish, missing, tilt_deg};
use super::model::Lens;
use super::parameter::Parameter;
use super::start::stand;
use crate::calibrate::board::Seen;
use crate::camera::LensModel;
use crate::fit::Stand;
use crate::fit::robust::median;

/// A board rests if it moves by less than this from picture to picture: this share of the picture's diagonal, but...
///
/// While the picture is read row by row the board goes on, by as much as from picture to picture at most. Over half of the
/// picture's height that is half as much, of which a turn and a step of the board explain the most. What remains is to be
/// less than corners are off by for other reasons: 0.1 to 0.2 px in a picture of 640x480 px.
const RESTS: f64 = 1e-3;
/// ... not less than this, px: corners of a board at rest are read as differently.
const RESTS_PX: f64 = 0.5;
/// After so long without a board nothing is known of how it moved, s.
const LONGEST_S: f64 = 0.5;
/// A view is another one if the board is elsewhere by this share of the picture's diagonal, larger by this factor, or tilted
/// otherwise by this, degrees...
const OTHER: Differs = Differs { place: 0.12, size: 1.3, tilt_deg: 12.0 };
/// ... and by as much if it shows what was missing.
const NOT_THE_SAME: Differs = Differs { place: 0.03, size: 1.08, tilt_deg: 4.0 };
/// The longer side of the picture in focal lengths, before anything is known.
const USUAL_FOCAL: f64 = 0.9;
/// A focal length that is known to this share says how boards are tilted.
const ROUGHLY: f64 = 0.1;
/// Parts of the picture that are told as seen or not.
const CELLS: (usize, usize) = (8, 6);

struct Differs {
    place: f64,
    size: f64,
    tilt_deg: f64,
}

/// What was made of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    NoBoard,
    Moving,
    /// It rests, and says nothing new.
    Known,
    Taken,
}

/// Where in the picture corners have been seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    pub columns: usize,
    pub rows: usize,
    /// Row by row from the top left.
    pub seen: Vec<bool>,
}

impl Coverage {
    /// The share of the picture that was seen, 0 to 1.
    pub fn share(&self) -> f64 {
        self.seen.iter().filter(|seen| **seen).count() as f64 / self.seen.len().max(1) as f64
    }
}

/// Takes views until nothing is missing.
#[derive(Debug)]
pub struct Taking {
    size: (u32, u32),
    options: LensOptions,
    wanted: usize,
    /// As far as it is known by now, without distortion.
    lens: Lens,
    before: Option<(f64, Seen)>,
    views: Vec<NamedView>,
    missing: Vec<Wish>,
}

impl Taking {
    /// From pictures of this size. At least `wanted` views are taken.
    pub fn new(size: (u32, u32), wanted: usize, options: LensOptions) -> Self {
        let size_px = DVec2::new(size.0.into(), size.1.into());
        let model = options.model.unwrap_or(LensModel::Opencv);
        let lens = Lens::plain(model, USUAL_FOCAL * size_px.max_element(), 0.5 * size_px);
        let missing = missing(size_px, &[], &[], &[], wanted);
        Self { size, options, wanted, lens, before: None, views: Vec::new(), missing }
    }

    /// What is still missing, most needed first. If nothing is, it is done.
    pub fn missing(&self) -> &[Wish] {
        &self.missing
    }

    /// What to do next, for somebody who holds the board. `None` if nothing is missing.
    pub fn hint(&self) -> Option<String> {
        // Any other wish makes a view more, too.
        let special = self.missing.iter().find(|wish| wish.things() > 0);
        special.or(self.missing.first()).map(Wish::hint)
    }

    pub fn views(&self) -> &[NamedView] {
        &self.views
    }

    pub fn wanted(&self) -> usize {
        self.wanted
    }

    pub fn coverage(&self) -> Coverage {
        let (columns, rows) = CELLS;
        let mut seen = vec![false; columns * rows];
        let cell = DVec2::new(columns as f64, rows as f64) / self.size_px();
        for at in self.views.iter().flat_map(|view| &view.seen.at_px) {
            let at = *at * cell;
            let (column, row) = (at.x.max(0.0) as usize, at.y.max(0.0) as usize);
            seen[row.min(rows - 1) * columns + column.min(columns - 1)] = true;
        }
        Coverage { columns, rows, seen }
    }

    /// Looks at what was found in the next picture, taken at a time, s, and known by a name.
    pub fn look(&mut self, time_s: f64, name: &str, seen: Option<Seen>) -> Look {
        let Some(seen) = seen else {
            self.before = None;
            return Look::NoBoard;
        };
        let limit_px = (RESTS * self.size_px().length()).max(RESTS_PX);
        let rests = self.before.replace((time_s, seen.clone())).is_some_and(|(before_s, before)| {
            (0.0..LONGEST_S).contains(&(time_s - before_s)) && moved_px(&before, &seen) < limit_px
        });
        if !rests {
            return Look::Moving;
        }
        if !self.is_new(&seen) {
            return Look::Known;
        }
        self.views.push(NamedView { name: name.to_owned(), seen });
        self.update();
        Look::Taken
    }

    /// The camera that the views give. What was taken stays what it is, whatever is missing.
    pub fn calibrated(&self) -> Result<Calibrated, LensError> {
        calibrate(self.size, self.views.clone(), Vec::new(), &self.options)
    }

    fn size_px(&self) -> DVec2 {
        DVec2::new(self.size.0.into(), self.size.1.into())
    }

    fn is_new(&self, seen: &Seen) -> bool {
        let Some(own) = self.place(seen) else { return false };
        let places: Vec<Place> = self.views.iter().filter_map(|view| self.place(&view.seen)).collect();
        let diagonal_px = self.size_px().length();
        let differs = |by: &Differs| places.iter().all(|other| own.differs(other, diagonal_px, by));
        let more = self.missing.iter().any(|wish| wish.things() == 0);
        if more && differs(&OTHER) {
            return true;
        }
        let things = |wishes: &[Wish]| wishes.iter().map(Wish::things).sum::<usize>();
        let before: Vec<&Seen> = self.views.iter().map(|view| &view.seen).collect();
        // Judged by the same lens, with the view and without it.
        let stands: Vec<Option<Stand>> = before.iter().map(|seen| self.stand(seen)).collect();
        let Some(stands) = stands.into_iter().collect::<Option<Vec<Stand>>>() else { return differs(&OTHER) };
        let of = |views: &[&Seen], stands: &[Stand]| things(&missing(self.size_px(), &[], views, stands, 0));
        let without = of(&before, &stands);
        let with = of(&[&before[..], &[seen]].concat(), &[&stands[..], &[own.stand]].concat());
        with < without && differs(&NOT_THE_SAME)
    }

    /// What is known after another view.
    fn update(&mut self) {
        let known = |parameter: &Parameter| parameter.sigma < ROUGHLY * parameter.value;
        let calibrated = self.calibrated().ok().filter(|calibrated| calibrated.parameters.iter().take(2).all(known));
        if let Some(calibrated) = calibrated {
            let of = &calibrated.geometry.intrinsics;
            let centre_px = DVec2::new(of.cx_px, of.cy_px);
            self.lens = Lens::plain(calibrated.geometry.distortion.model, of.fx_px, centre_px);
            let views: Vec<&Seen> = calibrated.views.iter().map(|view| &view.seen).collect();
            let (parameters, stands) = (&calibrated.parameters, &calibrated.stands);
            self.missing = missing(self.size_px(), parameters, &views, stands, self.wanted);
            return;
        }
        let seen = self.views.iter().filter_map(|view| Some((&view.seen, self.stand(&view.seen)?)));
        let (views, stands): (Vec<&Seen>, Vec<Stand>) = seen.unzip();
        // It is not done before it is known.
        let wanted = self.wanted.max(self.views.len() + 1);
        self.missing = missing(self.size_px(), &[], &views, &stands, wanted);
    }

    fn stand(&self, seen: &Seen) -> Option<Stand> {
        stand(&self.lens, &seen.board, &seen.at_px)
    }

    fn place(&self, seen: &Seen) -> Option<Place> {
        let stand = self.stand(seen)?;
        let (low, high) = bounds(&seen.at_px);
        // Per length of the board, so that parts of one are compared.
        let (board_low, board_high) = bounds(&seen.board);
        let size = (high - low).length() / (board_high - board_low).length().max(1e-9);
        Some(Place { middle_px: middle(&seen.at_px), size, tilt_deg: tilt_deg(&stand), stand })
    }
}

/// How a board is seen.
struct Place {
    middle_px: DVec2,
    /// Px per length of the board.
    size: f64,
    tilt_deg: DVec2,
    stand: Stand,
}

impl Place {
    fn differs(&self, other: &Self, diagonal_px: f64, by: &Differs) -> bool {
        self.middle_px.distance(other.middle_px) > by.place * diagonal_px
            || (self.size / other.size).max(other.size / self.size) > by.size
            || self.tilt_deg.distance(other.tilt_deg) > by.tilt_deg
    }
}

fn middle(places: &[DVec2]) -> DVec2 {
    places.iter().sum::<DVec2>() / places.len().max(1) as f64
}

fn bounds(places: &[DVec2]) -> (DVec2, DVec2) {
    places.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(*at), high.max(*at)))
}

/// How far a board has moved in the picture: half of its corners by less. Of a chessboard that is seen in part the same
/// corner may bear another number, so each is compared with the nearest one before; and a move by a whole square shows in
/// the middle of all.
fn moved_px(before: &Seen, now: &Seen) -> f64 {
    if before.at_px.is_empty() || now.at_px.is_empty() {
        return f64::INFINITY;
    }
    let to_nearest = |at: &DVec2| {
        let ways = before.at_px.iter().map(|other| *other - *at);
        ways.min_by(|a, b| a.length_squared().total_cmp(&b.length_squared())).unwrap_or(DVec2::INFINITY)
    };
    let ways: Vec<DVec2> = now.at_px.iter().map(to_nearest).collect();
    let whole =
        if before.at_px.len() == now.at_px.len() { middle(&before.at_px).distance(middle(&now.at_px)) } else { 0.0 };
    median(ways.iter()).max(whole)
}
