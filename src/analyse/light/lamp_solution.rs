//! Lamps of a room and their brightness from its surfaces, or the reason for which no lamp is
//! claimed.
//!
//! Lamps are claimed if they lower the residual by a fifth, and if the lamp that each half of the
//! frames finds by itself lowers the residual of the other half by a fifth, too. With two lamps of
//! similar brightness each half may find another one. The angle between them is therefore reported
//! but not a criterion. Reflectance and light have a common free factor here; it follows from the
//! white level ([`white_level`](mod@super::white_level)). Not modelled: lamps so low that they
//! light one side of the room only.

use glam::DVec3;

use super::bounce::{self, mean_share};
use super::lamp_fit::{self, LampSource, LightFit, MAX_LAMPS, fit, fit_with_bounce, lamp_irradiance};
use super::lamp_search::Search;
use super::occupancy::OccupancyGrid;
use super::room_light::{ASSUMED_LAMP_DIAMETER_M, LampEstimate};
use super::sample::relative_luminance;
use super::surfaces::{LightChannel, lit_points, search_volume};
use super::voxels::Voxel;

/// Smallest relative reduction of the residual by claimed lamps.
const MIN_EXPLAINED: f64 = 0.2;
/// Smallest number of surface patches.
pub const MIN_POINTS: usize = 200;
pub const INSUFFICIENT_SURFACES: &str = "too few surfaces were seen";
const ROUNDS: usize = 20;
/// Lower limit of light, in its own units.
const MIN_LIGHT: f64 = 1e-6;

/// Lamps, with their light and the ambient light in a common unknown unit.
pub struct LampSolution {
    pub lamps: Vec<LampSource>,
    /// Positions of each lamp's bounce light.
    spheres: Vec<Vec<LampSource>>,
    luminance: LightFit,
    colours: [LightFit; 3],
    occupancy: OccupancyGrid,
    up: DVec3,
    pub verdict: LampVerdict,
}

/// Result of the checks of the lamps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LampVerdict {
    pub explained: f64,
    pub halves: Option<HalvesCheck>,
    pub no_lamp: Option<String>,
}

/// The light at a place with a known white level.
pub struct PlaceLight {
    /// Ambient light.
    pub ambient: [f64; 3],
    pub lamps: Vec<LampEstimate>,
}

/// Cross-validation by the two halves of the frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalvesCheck {
    /// Relative reduction of one half's residual without lamps by the other half's lamp; the
    /// smaller of the two.
    pub explained: f64,
    /// Angle between the halves' lamps, seen from the place.
    pub apart_deg: f64,
}

/// Searches lamps in the room.
pub fn solve(voxels: &[Voxel], solid: &[DVec3], place: DVec3, up: DVec3, threads: usize) -> LampSolution {
    let occupancy = OccupancyGrid::new(solid);
    let volume = search_volume(solid, up);
    let points_of_half = |half: usize| lit_points(voxels, half, LightChannel::Luminance);
    let all = points_of_half(2);
    if all.len() < MIN_POINTS {
        return LampSolution::without_lamps(
            LampVerdict { no_lamp: Some(INSUFFICIENT_SURFACES.to_owned()), ..LampVerdict::default() },
            up,
        );
    }
    let search = Search { points: &all, occupancy: &occupancy, volume, threads };
    let result = search.lamps(MAX_LAMPS);
    let explained = 1.0 - result.fit.score / result.scores[0].max(1e-9);
    let halves = (!result.lamps.is_empty() && explained >= MIN_EXPLAINED)
        .then(|| {
            let points = [0, 1].map(points_of_half);
            let searches = points.each_ref().map(|points| Search { points, occupancy: &occupancy, volume, threads });
            let are_enough = points.iter().all(|points| points.len() >= MIN_POINTS);
            if are_enough { check_halves(&searches, place) } else { None }
        })
        .flatten();
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let no_lamp = match halves {
        _ if explained < MIN_EXPLAINED => {
            let by_one = result.scores.get(1).map_or(0.0, |score| 1.0 - score / result.scores[0].max(1e-9));
            let by = percent(by_one.max(explained).max(0.0));
            Some(format!(
                "a lamp explains {by} of the residual of light from all around, less than {}",
                percent(MIN_EXPLAINED)
            ))
        }
        None => Some("it is not found in one half of the frames alone".to_owned()),
        Some(HalvesCheck { explained, .. }) if explained < MIN_EXPLAINED => {
            let by = percent(explained.max(0.0));
            Some(format!(
                "the lamp found in one half of the frames explains {by} of the other half, less than {}",
                percent(MIN_EXPLAINED)
            ))
        }
        Some(_) => None,
    };
    let verdict = LampVerdict { explained, halves, no_lamp };
    if verdict.no_lamp.is_some() {
        return LampSolution::without_lamps(verdict, up);
    }
    let light = fit_light(voxels, &search, &result.lamps);
    LampSolution::new(result.lamps, light, occupancy, up, verdict)
}

/// Fits the light of lamps at known positions, for luminance and for each colour channel. The ratio
/// of a lamp's bounce to its direct light follows from luminance, so that both have the same
/// colour.
pub fn fit_light(voxels: &[Voxel], search: &Search<'_>, lamps: &[LampSource]) -> (LightFit, [LightFit; 3]) {
    let shares = search.shares_with_bounce(lamps);
    let luminance = fit_with_bounce(search.points, &shares, lamps.len(), ROUNDS).light;
    let together: Vec<lamp_fit::BasisRow> = shares
        .iter()
        .map(|shares| {
            let mut together = [0.0; lamp_fit::MAX_UNKNOWNS];
            together[..2].copy_from_slice(&shares[..2]);
            for k in 0..lamps.len() {
                together[2 + k] =
                    luminance.lamps[k] * shares[2 + k] + luminance.bounce[k] * shares[2 + lamps.len() + k];
            }
            together
        })
        .collect();
    let colours = [0, 1, 2].map(|c| {
        // The same surfaces in the same order: materials do not depend on the colour.
        let points = lit_points(voxels, 2, LightChannel::Colour(c));
        let mut light = fit(&points, &together, lamps.len(), ROUNDS).light;
        for k in 0..lamps.len() {
            light.bounce[k] = light.lamps[k] * luminance.bounce[k];
            light.lamps[k] *= luminance.lamps[k];
        }
        light
    });
    (luminance, colours)
}

impl LampSolution {
    pub fn new(
        lamps: Vec<LampSource>,
        (luminance, colours): (LightFit, [LightFit; 3]),
        occupancy: OccupancyGrid,
        up: DVec3,
        verdict: LampVerdict,
    ) -> Self {
        let spheres = lamps.iter().map(|lamp| bounce::places(lamp, &occupancy)).collect();
        Self { lamps, spheres, luminance, colours, occupancy, up, verdict }
    }

    /// Uniform ambient light only.
    pub fn without_lamps(verdict: LampVerdict, up: DVec3) -> Self {
        let even = LightFit { around: 1.0, ..LightFit::default() };
        Self::new(Vec::new(), (even, [even; 3]), OccupancyGrid::new(&[]), up, verdict)
    }

    /// Light on a surface, relative to that on an unoccluded upward-facing surface at the place. 1
    /// without lamps.
    pub fn relative(&self, at: DVec3, normal: DVec3, place: DVec3) -> f64 {
        if self.lamps.is_empty() {
            return 1.0;
        }
        let by_lamps: f64 = self.by_lamps(&|lamp| self.occupancy.lamp_irradiance(at, normal, lamp), &self.luminance);
        let ambient = self.luminance.around + 0.5 * (1.0 + normal.dot(self.up)) * self.luminance.above;
        ((ambient + by_lamps) / self.upward(place, &self.luminance)).max(MIN_LIGHT)
    }

    fn by_lamps(&self, share: &impl Fn(&LampSource) -> f64, light: &LightFit) -> f64 {
        let direct: f64 = self.lamps.iter().zip(light.lamps).map(|(lamp, shown)| share(lamp) * shown).sum();
        let bounced = |(sphere, shown): (&Vec<LampSource>, f64)| {
            if shown > 0.0 { mean_share(sphere, share) * shown } else { 0.0 }
        };
        direct + self.spheres.iter().zip(light.bounce).map(bounced).sum::<f64>()
    }

    fn upward(&self, place: DVec3, light: &LightFit) -> f64 {
        (light.around + light.above + self.by_lamps(&|lamp| lamp_irradiance(place, self.up, lamp), light))
            .max(MIN_LIGHT)
    }

    /// Scaled to the white level of the place.
    pub fn at(&self, place: DVec3, white: [f64; 3]) -> PlaceLight {
        let scale = [0, 1, 2].map(|c| white[c] / self.upward(place, &self.colours[c]));
        let of_even = |at: DVec3| lamp_irradiance(place, self.up, &LampSource { position_m: at, along: None });
        // A panel is replaced by an isotropic lamp that is as bright at the place.
        let aside = |lamp: &LampSource| match lamp.along {
            Some(along) => along.dot((place - lamp.position_m).normalize_or_zero()).max(0.0),
            None => 1.0,
        };
        let direct = self.lamps.iter().enumerate().map(|(k, lamp)| LampEstimate {
            at_m: lamp.position_m.to_array(),
            shown_at_1_m: [0, 1, 2].map(|c| scale[c] * aside(lamp) * self.colours[c].lamps[k]),
            diameter_m: ASSUMED_LAMP_DIAMETER_M,
        });
        let bounce = self.lamps.iter().zip(&self.spheres).enumerate().map(|(k, (lamp, sphere))| {
            // 1 while the sphere is above the horizon. Clamped, because it diverges for a lamp at
            // the horizon.
            let share =
                mean_share(sphere, |on_sphere| lamp_irradiance(place, self.up, on_sphere)) / of_even(lamp.position_m);
            let even_share = if share < 1.0 { share } else { 1.0 };
            LampEstimate {
                at_m: lamp.position_m.to_array(),
                shown_at_1_m: [0, 1, 2].map(|c| scale[c] * even_share * self.colours[c].bounce[k]),
                diameter_m: bounce::DIAMETER_M,
            }
        });
        let upward = |lamp: &LampEstimate| lamp.shown_at_1_m.map(|shown| shown * of_even(lamp.at_m.into()));
        let min_luminance = bounce::MIN_SHARE * relative_luminance(white);
        let lamps: Vec<LampEstimate> =
            direct.chain(bounce.filter(|lamp| relative_luminance(upward(lamp)) > min_luminance)).collect();
        let by_lamps = |c: usize| lamps.iter().map(|lamp| upward(lamp)[c]).sum::<f64>();
        let ambient = [0, 1, 2].map(|c| (white[c] - by_lamps(c)).max(0.0));
        PlaceLight { ambient, lamps }
    }
}

/// Fits each half's single lamp to the other half. `None` if one half finds no lamp.
fn check_halves(halves: &[Search; 2], place: DVec3) -> Option<HalvesCheck> {
    let half_solutions = halves.each_ref().map(|half| half.lamps(1));
    let at = |half: usize| Some(half_solutions[half].lamps.first()?.position_m - place);
    let apart_deg = at(0)?.angle_between(at(1)?).to_degrees();
    let explained = [0, 1].map(|half: usize| {
        let none = half_solutions[half].scores[0].max(1e-9);
        1.0 - halves[half].with(&half_solutions[1 - half].lamps, ROUNDS).score / none
    });
    Some(HalvesCheck { explained: explained[0].min(explained[1]), apart_deg })
}

#[cfg(test)]
mod tests {
    use super::super::test_room::{room, room_with_discs};
    use super::*;

    const UP: DVec3 = DVec3::Z;
    const PLACE: DVec3 = DVec3::new(0.0, 0.0, 0.0);

    fn solved(lamps: [&[DVec3]; 2]) -> LampSolution {
        let (voxels, solid) = room(lamps);
        solve(&voxels, &solid, PLACE, UP, 2)
    }

    #[test]
    fn lamp_over_a_floor_and_a_box_is_found_with_its_brightness() {
        let lamp = DVec3::new(-0.6, 0.5, 2.0);
        let solution = solved([&[lamp]; 2]);
        assert!(
            solution.verdict.no_lamp.is_none() && solution.lamps.len() == 1,
            "{:?} {:?}",
            solution.verdict,
            solution.lamps
        );
        let off_deg = (solution.lamps[0].position_m - PLACE).angle_between(lamp - PLACE).to_degrees();
        assert!(off_deg < 2.0, "{off_deg}: {}", solution.lamps[0].position_m);
        // Scaled to the white level at the place, the lamp's light at 1 m is 2 and all other light
        // 0.15.
        let by_lamp = |shown: f64| shown * lamp_irradiance(PLACE, UP, &LampSource { position_m: lamp, along: None });
        let PlaceLight { ambient, lamps } = solution.at(PLACE, [0.15 + by_lamp(2.0); 3]);
        assert!((lamps[0].shown_at_1_m[1] / 2.0 - 1.0).abs() < 0.06, "{lamps:?}");
        assert!((ambient[1] - 0.15).abs() < 0.03, "{ambient:?}");
        // Twice as far away, and behind the box.
        let relative = solution.relative(PLACE - DVec3::Z * (lamp.z), UP, PLACE);
        assert!(relative < 0.6, "{relative}");
    }

    // Slow: lamps are searched in two rooms.
    #[test]
    fn bounce_and_direct_light_are_separated() {
        let lamp = DVec3::new(-0.6, 0.5, 2.0);
        let (voxels, solid) = room_with_discs([&[lamp]; 2], 0.5);
        let solution = solve(&voxels, &solid, PLACE, UP, 2);
        let by_lamp = 2.0 * lamp_irradiance(PLACE, UP, &LampSource { position_m: lamp, along: None });
        let PlaceLight { ambient, lamps } = solution.at(PLACE, [0.15 + by_lamp; 3]);
        assert_eq!(lamps.iter().map(LampEstimate::is_bounce).collect::<Vec<_>>(), [false, true]);
        // By hand each is half of the lamp's light, and the rest stays ambient. The room's disc is
        // level, that of the model is not.
        let upward = lamps.iter().map(|lamp| {
            lamp.shown_at_1_m[1] * lamp_irradiance(PLACE, UP, &LampSource { position_m: lamp.at_m.into(), along: None })
                / by_lamp
        });
        let upward: Vec<f64> = upward.collect();
        assert!(upward.iter().all(|share| (share - 0.5).abs() < 0.25), "{upward:?}");
        assert!((ambient[1] - 0.15).abs() < 0.04, "{ambient:?}");
        // A bare lamp has next to none.
        let bare = solved([&[lamp]; 2]).at(PLACE, [0.15 + by_lamp; 3]).lamps;
        assert!(bare.len() == 1 || bare[1].shown_at_1_m[1] < 0.1 * bare[0].shown_at_1_m[1], "{bare:?}");
    }

    // Slow: lamps are searched in all frames and in each half of them.
    #[test]
    fn two_lamps_of_equal_brightness_are_not_merged_into_one() {
        let lamps = [DVec3::new(0.8, -0.5, 1.9), DVec3::new(-0.7, 0.4, 2.1)];
        let solution = solved([&lamps; 2]);
        for lamp in lamps {
            let error_deg = |place: &LampSource| (place.position_m - PLACE).angle_between(lamp - PLACE).to_degrees();
            let nearest_deg = solution.lamps.iter().map(error_deg).fold(f64::INFINITY, f64::min);
            assert!(nearest_deg < 5.0, "{nearest_deg}: {:?}", solution.lamps);
        }
        // Both halves have the same light.
        assert!(
            solution.verdict.halves.unwrap().explained > 0.5 && solution.verdict.halves.unwrap().apart_deg < 1.0,
            "{:?}",
            solution.verdict.halves
        );
    }

    #[test]
    fn no_lamp_is_found_in_uniform_light() {
        let solution = solved([&[]; 2]);
        assert!(solution.lamps.is_empty() && solution.verdict.explained < MIN_EXPLAINED);
        assert!(solution.verdict.no_lamp.as_ref().unwrap().contains("explains"));
        let PlaceLight { ambient, lamps } = solution.at(PLACE, [0.3, 0.2, 0.1]);
        assert!(
            ambient == [0.3, 0.2, 0.1] && lamps.is_empty() && solution.relative(UP, UP, PLACE) == 1.0,
            "{ambient:?}"
        );
    }

    #[test]
    fn no_lamp_is_claimed_if_the_halves_contradict_each_other() {
        let solution = solved([&[DVec3::new(-0.6, 0.5, 2.0)], &[DVec3::new(0.9, -0.6, 1.8)]]);
        assert!(solution.lamps.is_empty());
        assert!(solution.verdict.no_lamp.as_ref().unwrap().contains("explains"), "{:?}", solution.verdict.halves);
    }
}
