//! Lamps that a user marked, in place of a search.
//!
//! Their positions are known. Each is modelled as a bulb or as a panel that shines down, whichever
//! has the smaller residual. Lamps of an earlier search stay if they still lower the residual
//! enough ([`lamp_search`](super::lamp_search)); one that stood for a marked lamp no longer does.
//! Brightness follows from the light of the surfaces, as after a search. Marked lamps are always
//! kept.

use glam::DVec3;

use super::lamp_fit::{LampSource, MAX_LAMPS};
use super::lamp_search::{FINAL_ITERATIONS, MIN_GAIN, MIN_GAIN_OF_TOTAL, MIN_LAMP_DISTANCE_M, Search};
use super::lamp_solution::{INSUFFICIENT_SURFACES, LampSolution, LampVerdict, MIN_POINTS, fit_light};
use super::occupancy::OccupancyGrid;
use super::surfaces::{LightChannel, lit_points, search_volume};
use super::voxels::Voxel;

/// Lamps by their places, world axes, m.
#[derive(Clone, Copy, Debug)]
pub struct KnownLamps<'a> {
    /// Marked by a user; at most [`MAX_LAMPS`].
    pub marked: &'a [DVec3],
    /// Found by an earlier search.
    pub estimated: &'a [DVec3],
}

/// Solves for the light like [`solve`](super::lamp_solution::solve), without a search.
pub fn solve(
    voxels: &[Voxel],
    solid: &[DVec3],
    up: DVec3,
    threads: usize,
    known_lamps: &KnownLamps<'_>,
) -> Result<LampSolution, String> {
    let points = lit_points(voxels, 2, LightChannel::Luminance);
    if points.len() < MIN_POINTS {
        return Err(INSUFFICIENT_SURFACES.to_owned());
    }
    let occupancy = OccupancyGrid::new(solid);
    let search = Search { points: &points, occupancy: &occupancy, volume: search_volume(solid, up), threads };
    let (lamps, explained) = lamps(&search, known_lamps);
    let light = fit_light(voxels, &search, &lamps);
    Ok(LampSolution::new(lamps, light, occupancy, up, LampVerdict { explained, ..LampVerdict::default() }))
}

/// The accepted lamps, the marked ones first, and the relative reduction of the residual.
fn lamps(search: &Search<'_>, known_lamps: &KnownLamps<'_>) -> (Vec<LampSource>, f64) {
    let none = search.with(&[], FINAL_ITERATIONS).score;
    let (mut lamps, mut score): (Vec<LampSource>, f64) = (Vec::new(), none);
    let marked = known_lamps.marked.iter().map(|at| (*at, true));
    for (at, is_marked) in marked.chain(known_lamps.estimated.iter().map(|at| (*at, false))) {
        let is_there = |lamp: &LampSource| lamp.position_m.distance(at) < MIN_LAMP_DISTANCE_M;
        if lamps.len() == MAX_LAMPS || (!is_marked && lamps.iter().any(is_there)) {
            continue;
        }
        let with = [None, Some(-search.volume.up)].map(|along| {
            let more = [&lamps[..], &[LampSource { position_m: at, along }]].concat();
            (search.with(&more, FINAL_ITERATIONS).score, more)
        });
        let [bulb, panel] = with;
        let (better, more) = if panel.0 < bulb.0 { panel } else { bulb };
        if is_marked || score - better > (MIN_GAIN * score).max(MIN_GAIN_OF_TOTAL * none) {
            (lamps, score) = (more, better);
        }
    }
    (lamps, 1.0 - score / none.max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::super::lamp_fit::lamp_irradiance;
    use super::super::lamp_solution::PlaceLight;
    use super::super::test_room::room as lit_test_room;
    use super::*;

    const UP: DVec3 = DVec3::Z;

    /// Scaled to the white level in the middle of the floor.
    fn scaled(solved: &LampSolution, lamps: &[DVec3]) -> PlaceLight {
        let lamp_light =
            |at: &DVec3| 2.0 * lamp_irradiance(DVec3::ZERO, UP, &LampSource { position_m: *at, along: None });
        solved.at(DVec3::ZERO, [0.15 + lamps.iter().map(lamp_light).sum::<f64>(); 3])
    }

    fn solved(lamps: &[DVec3], marked: &[DVec3], estimated: &[DVec3]) -> LampSolution {
        let (voxels, solid) = lit_test_room([lamps; 2]);
        solve(&voxels, &solid, UP, 2, &KnownLamps { marked, estimated }).unwrap()
    }

    #[test]
    fn marked_lamp_has_its_true_brightness_and_replaces_its_stand_in() {
        let lamp = DVec3::new(-0.6, 0.5, 2.0);
        let solution = solved(&[lamp], &[lamp], &[DVec3::new(-0.9, 0.1, 1.7)]);
        assert_eq!(solution.lamps.iter().map(|lamp| lamp.position_m).collect::<Vec<_>>(), [lamp]);
        let PlaceLight { ambient, lamps } = scaled(&solution, &[lamp]);
        assert!((lamps[0].shown_at_1_m[1] / 2.0 - 1.0).abs() < 0.05, "{lamps:?}");
        assert!((ambient[1] - 0.15).abs() < 0.03, "{ambient:?}");
        assert!(solution.verdict.explained > 0.5 && solution.verdict.no_lamp.is_none(), "{:?}", solution.verdict);
    }

    #[test]
    fn found_lamp_stays_beside_a_marked_one_and_a_marked_dark_lamp_is_kept() {
        let lamps = [DVec3::new(0.8, -0.5, 1.9), DVec3::new(-0.7, 0.4, 2.1)];
        let solution = solved(&lamps, &lamps[..1], &lamps[1..]);
        assert_eq!(solution.lamps.iter().map(|lamp| lamp.position_m).collect::<Vec<_>>(), lamps);
        let of_all = scaled(&solution, &lamps).lamps;
        for at in lamps {
            let of_one = of_all.iter().filter(|lamp| DVec3::from(lamp.at_m) == at).map(|lamp| lamp.shown_at_1_m[1]);
            let shown: Vec<f64> = of_one.collect();
            assert!((shown.iter().sum::<f64>() / 2.0 - 1.0).abs() < 0.1, "{of_all:?}");
            // The room has no bounce light. With few shadows up to a third of the direct light is
            // mistaken for it.
            assert!(shown[0] > 2.0 / 1.5, "{of_all:?}");
        }
        // This lamp is off.
        let dark = DVec3::new(1.2, 1.0, 1.5);
        let solution = solved(&lamps[1..], &[dark], &lamps[1..]);
        assert_eq!(solution.lamps.iter().map(|lamp| lamp.position_m).collect::<Vec<_>>(), [dark, lamps[1]]);
        let of_all = scaled(&solution, &lamps[1..]).lamps;
        let shown = |at: DVec3| -> f64 {
            of_all.iter().filter(|lamp| DVec3::from(lamp.at_m) == at).map(|lamp| lamp.shown_at_1_m[1]).sum()
        };
        assert!(shown(dark) < 0.1 * shown(lamps[1]), "{of_all:?}");
    }
}
