//! From the room's surfaces to its lamps and the light from around, or why no lamp is claimed.
//!
//! A lamp is claimed if lamps lower what is left unexplained by a fifth, and the lamp that each half of the frames finds by itself
//! lowers what is left of the other half by a fifth, too. Where two lamps are about as bright, the halves may find one lamp each, far
//! from the other's: how far apart they see it is reported, and refuses nothing. Not modelled: lamps that hang so low that they light
//! one side of the room alone.

use glam::DVec3;

use super::blocked::Blocked;
use super::lit::{Fit, MOST_LAMPS, Place};
use super::search::Search;
use super::surfaces::{Of, points, room};
use super::voxels::Voxel;
use super::white::{Lit, white};

/// See above.
const EXPLAINED: f64 = 0.2;
/// Fewer surfaces tell nothing.
pub const FEWEST: usize = 200;
pub const TOO_FEW: &str = "too few surfaces were seen";
const ROUNDS: usize = 20;
/// Normals whose cosine with up is more than this look up.
const UPWARD: f64 = 0.9;

pub struct Solved {
    pub lamps: Vec<Place>,
    /// Of each lamp, by colour: what white that faces it shows at 1 m.
    pub shown_at_1_m: Vec<[f64; 3]>,
    pub around: [f64; 3],
    pub above: [f64; 3],
    pub between: [f64; 2],
    pub explained: f64,
    pub halves: Option<Halves>,
    pub no_lamp: Option<String>,
}

/// What each half of the frames says by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halves {
    /// Of what no lamp leaves unexplained in one half, what the other half's lamp explains: the lesser of the two.
    pub explained: f64,
    /// How far apart they see the lamp.
    pub apart_deg: f64,
}

/// Or why nothing can be said.
pub fn solve(voxels: &[Voxel], solid: &[DVec3], middle: DVec3, up: DVec3, threads: usize) -> Result<Solved, String> {
    let blocked = Blocked::new(solid);
    let room = room(solid, up);
    let by = |half: usize| points(voxels, half, Of::Luminance);
    let all = by(2);
    if all.len() < FEWEST {
        return Err(TOO_FEW.to_owned());
    }
    let search = Search { points: &all, blocked: &blocked, room, threads };
    let found = search.lamps(MOST_LAMPS);
    let explained = 1.0 - found.fit.score / found.scores[0].max(1e-9);
    let halves = (!found.lamps.is_empty() && explained >= EXPLAINED)
        .then(|| {
            let points = [0, 1].map(by);
            let searches = points.each_ref().map(|points| Search { points, blocked: &blocked, room, threads });
            let are_enough = points.iter().all(|points| points.len() >= FEWEST);
            if are_enough { told_by_halves(&searches, middle) } else { None }
        })
        .flatten();
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let no_lamp = match halves {
        _ if explained < EXPLAINED => {
            let by_one = found.scores.get(1).map_or(0.0, |score| 1.0 - score / found.scores[0].max(1e-9));
            let by = percent(by_one.max(explained).max(0.0));
            Some(format!("a lamp explains {by} of what light from all around leaves, less than {}", percent(EXPLAINED)))
        }
        None => Some("one half of the frames does not find it by itself".to_owned()),
        Some(Halves { explained, .. }) if explained < EXPLAINED => {
            let by = percent(explained.max(0.0));
            Some(format!(
                "the lamp that one half of the frames finds explains {by} of the other half, less than {}",
                percent(EXPLAINED)
            ))
        }
        Some(_) => None,
    };
    let lamps = if no_lamp.is_some() { Vec::new() } else { found.lamps };
    bright(voxels, &search, lamps, middle, Told { explained, halves, no_lamp })
}

/// What is said of the lamps.
pub struct Told {
    pub explained: f64,
    pub halves: Option<Halves>,
    pub no_lamp: Option<String>,
}

/// How bright all light is, by colour, with lamps whose places are known.
pub fn bright(
    voxels: &[Voxel],
    search: &Search<'_>,
    lamps: Vec<Place>,
    middle: DVec3,
    told: Told,
) -> Result<Solved, String> {
    let colours = [0, 1, 2].map(|c| {
        let points = points(voxels, 2, Of::Colour(c));
        Search { points: &points, ..*search }.with(&lamps, ROUNDS)
    });
    let luminance = search.with(&lamps, ROUNDS);
    let (factors, between) = white(&lit(voxels, search.blocked, search.room.up, &lamps, &luminance, &colours))
        .ok_or("no surface is bright enough to tell white")?;
    let each = |of: &dyn Fn(&Fit) -> f64| [0, 1, 2].map(|c| factors[c] * of(&colours[c]));
    // A panel shines less to its sides: as an even lamp it is as bright in the middle.
    let aside = |lamp: &Place| match lamp.along {
        Some(along) => along.dot((middle - lamp.at).normalize_or_zero()).max(0.0),
        None => 1.0,
    };
    let shown_at_1_m = lamps.iter().enumerate();
    let shown_at_1_m = shown_at_1_m.map(|(k, lamp)| each(&|fit: &Fit| aside(lamp) * fit.light.lamps[k])).collect();
    let Told { explained, halves, no_lamp } = told;
    Ok(Solved {
        shown_at_1_m,
        around: each(&|fit| fit.light.around),
        above: each(&|fit| fit.light.above),
        lamps,
        between,
        explained,
        halves,
        no_lamp,
    })
}

/// Each half's one lamp, tried on the other half. `None` where one half finds none.
fn told_by_halves(halves: &[Search; 2], middle: DVec3) -> Option<Halves> {
    let found = halves.each_ref().map(|half| half.lamps(1));
    let at = |half: usize| Some(found[half].lamps.first()?.at - middle);
    let apart_deg = at(0)?.angle_between(at(1)?).to_degrees();
    let explained = [0, 1].map(|half: usize| {
        let none = found[half].scores[0].max(1e-9);
        1.0 - halves[half].with(&found[1 - half].lamps, ROUNDS).score / none
    });
    Some(Halves { explained: explained[0].min(explained[1]), apart_deg })
}

/// Every surface under the light that was found, the unknown factor left as it is.
fn lit(
    voxels: &[Voxel],
    blocked: &Blocked,
    up: DVec3,
    lamps: &[Place],
    luminance: &Fit,
    colours: &[Fit; 3],
) -> Vec<Lit> {
    let of = |voxel: &Voxel| -> Option<Lit> {
        let light = voxel.light[2]?.map(f64::from);
        let shares: Vec<f64> = lamps.iter().map(|lamp| blocked.of_lamp(voxel.at, voxel.normal, lamp)).collect();
        let comes = |fit: &Fit| {
            let above = 0.5 * (1.0 + voxel.normal.dot(up)) * fit.light.above;
            let by_lamps: f64 = shares.iter().zip(fit.light.lamps).map(|(share, lamp)| share * lamp).sum();
            (fit.light.around + above + by_lamps).max(1e-6)
        };
        Some(Lit {
            brightest: f64::from(voxel.brightest) / comes(luminance),
            is_clipped: voxel.is_clipped,
            looks_up: voxel.normal.dot(up) > UPWARD,
            albedo: [0, 1, 2].map(|c| light[c] / comes(&colours[c])),
            light,
        })
    };
    voxels.iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::lit_room::room;
    use super::*;
    use crate::analyse::light::lit::of_lamp;

    const UP: DVec3 = DVec3::Z;
    const MIDDLE: DVec3 = DVec3::new(0.0, 0.0, 0.1);

    fn solved(lamps: [&[DVec3]; 2]) -> Solved {
        let (voxels, solid) = room(lamps);
        solve(&voxels, &solid, MIDDLE, UP, 2).unwrap()
    }

    #[test]
    fn a_lamp_over_a_floor_and_a_box_is_found_with_its_brightness() {
        let lamp = DVec3::new(-0.6, 0.5, 2.0);
        let found = solved([&[lamp]; 2]);
        assert!(found.no_lamp.is_none() && found.lamps.len() == 1, "{:?} {:?}", found.no_lamp, found.lamps);
        let off_deg = (found.lamps[0].at - MIDDLE).angle_between(lamp - MIDDLE).to_degrees();
        assert!(off_deg < 2.0, "{off_deg}: {}", found.lamps[0].at);
        let shown = |at: DVec3, shown: f64| shown * of_lamp(MIDDLE, UP, &Place { at, along: None });
        let (upward, truth) = (
            found.around[1] + found.above[1] + shown(found.lamps[0].at, found.shown_at_1_m[0][1]),
            0.15 + shown(lamp, 2.0),
        );
        // The pattern's brightest places count as white.
        assert!((upward / truth - 1.1).abs() < 0.06, "{upward} {truth}");
        assert!(found.between[0] < 1.0 && found.between[1] > 1.0);
    }

    // Slow: lamps are searched in all frames and in each half of them.
    #[test]
    fn two_lamps_as_bright_as_each_other_are_not_taken_for_one_between_them() {
        let lamps = [DVec3::new(0.8, -0.5, 1.9), DVec3::new(-0.7, 0.4, 2.1)];
        let found = solved([&lamps; 2]);
        for lamp in lamps {
            let off = |place: &Place| (place.at - MIDDLE).angle_between(lamp - MIDDLE).to_degrees();
            let least_deg = found.lamps.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(least_deg < 5.0, "{least_deg}: {:?}", found.lamps);
        }
        // The halves see the same.
        assert!(found.halves.unwrap().explained > 0.5 && found.halves.unwrap().apart_deg < 1.0, "{:?}", found.halves);
    }

    #[test]
    fn light_from_everywhere_has_no_lamp() {
        let found = solved([&[]; 2]);
        assert!(found.lamps.is_empty() && found.explained < EXPLAINED);
        assert!(found.no_lamp.unwrap().contains("explains"));
        assert!((found.around[1] + found.above[1] - 0.165).abs() < 0.02, "{:?} {:?}", found.around, found.above);
    }

    #[test]
    fn halves_whose_lamps_do_not_explain_each_other_see_none() {
        let found = solved([&[DVec3::new(-0.6, 0.5, 2.0)], &[DVec3::new(0.9, -0.6, 1.8)]]);
        assert!(found.lamps.is_empty());
        assert!(found.no_lamp.unwrap().contains("explains"), "{:?}", found.halves);
    }
}
