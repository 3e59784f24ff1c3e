//! Tests of the white level and its gate.

use super::*;

const EXPOSURE: ExposureLevel = ExposureLevel { level: 1.0, neutral: [1.0; 3] };

fn patch(at: DVec3, light: f64) -> Patch {
    Patch {
        position_m: at,
        normal: DVec3::Z,
        light: [light; 3],
        is_bound: false,
        parts: [None; 3],
        code: [light; 3],
        brightest: light,
    }
}

/// 1000 voxels of 2 cm that face up within 0.5 m, of which `white` show 0.8 and the others 0.3,
/// grey.
fn desk(white: usize) -> Vec<Patch> {
    let at = |n: usize| DVec3::new(0.02 * (n % 25) as f64 - 0.25, 0.02 * (n / 25) as f64 - 0.4, 0.0);
    (0..1000).map(|n| patch(at(n), if n < white { 0.8 } else { 0.3 })).collect()
}

#[test]
fn surfaces_in_deep_shadow_are_not_used_for_white() {
    // A desk of 0.8, of which 1 % lies in a shadow whose depth is overestimated by ten.
    let voxels: Vec<Voxel> = desk(1000).iter().map(|p| Voxel::of_surface(p.position_m, p.normal, [0.8; 3])).collect();
    let relative = |voxel: &Voxel| if voxel.position_m.x > 0.229 && voxel.position_m.y > 0.1 { 0.1 } else { 1.0 };
    let lit = patches(&voxels, relative);
    assert_eq!(lit.len(), 986);
    let level = white_level_by_lamps(&lit, DVec3::Z, DVec3::ZERO, &EXPOSURE).unwrap();
    assert!((relative_luminance(level.white) - 1.0).abs() < 1e-6, "{level:?}");
}

fn level(patches: &[Patch], exposure: &ExposureLevel) -> WhiteLevel {
    white_level(patches, DVec3::Z, DVec3::ZERO, exposure)
}

fn is_about(actual: f64, expected: f64) -> bool {
    (actual / expected - 1.0).abs() < 1e-5
}

#[test]
fn paper_on_a_desk_is_claimed_with_its_interval() {
    let white_level = level(&desk(200), &EXPOSURE);
    assert_eq!(white_level.unclaimed, None);
    // It agrees with the exposure: 0.8 / 0.8, never below 0.8 / 0.9, up to e^0.3.
    assert!(white_level.white.iter().all(|white| is_about(*white, 1.0)), "{white_level:?}");
    assert!(
        is_about(white_level.between[0], 0.8 / 0.9) && is_about(white_level.between[1], 0.3f64.exp()),
        "{white_level:?}"
    );
    // With an exposure of 1.4: 1.4^0.15, and 0.4·ln 1.4 widens the interval.
    let white_level = level(&desk(200), &ExposureLevel { level: 1.4, ..EXPOSURE });
    let (white, wide) = (1.4f64.powf(0.15), 0.3f64.hypot(0.4 * 1.4f64.ln()).exp());
    assert!(is_about(white_level.white[1], white) && is_about(white_level.between[1], white * wide), "{white_level:?}");
}

#[test]
fn clipped_desk_follows_the_exposure_within_its_bounds() {
    let mut patches = desk(200);
    patches.iter_mut().take(200).for_each(|patch| patch.is_bound = true);
    for (exposure, white) in [(0.6, 1.0), (1.2, 1.2), (1.9, 1.4)] {
        let level = level(&patches, &ExposureLevel { level: exposure, ..EXPOSURE });
        assert!(level.unclaimed.is_none() && is_about(level.white[1], white), "{exposure}: {level:?}");
        assert!(is_about(level.between[0], 0.8 / 0.9) && is_about(level.between[1], 1.6), "{level:?}");
    }
}

#[test]
fn each_refusal_has_its_reason() {
    let why =
        |patches: &[Patch], exposure: f64| level(patches, &ExposureLevel { level: exposure, ..EXPOSURE }).unclaimed;
    assert_eq!(why(&desk(200)[..600], 1.0), Some(WhiteLevelRefusal::TooFew));
    assert_eq!(why(&desk(600), 1.0), Some(WhiteLevelRefusal::Ground));
    assert_eq!(why(&desk(40), 1.0), Some(WhiteLevelRefusal::Scrap));
    let wooden = desk(200).into_iter().map(|patch| Patch { code: [0.8, 0.6, 0.4], ..patch });
    assert_eq!(why(&wooden.collect::<Vec<_>>(), 1.0), Some(WhiteLevelRefusal::Coloured { saturation: 0.5 }));
    // 1 m away, within 1.2 m: twice as bright.
    let beyond = (0..200).map(|n| patch(DVec3::new(1.0, 0.001 * f64::from(n), 0.0), 1.6));
    let sunlit = why(&desk(200).into_iter().chain(beyond).collect::<Vec<_>>(), 1.0);
    assert!(matches!(sunlit, Some(WhiteLevelRefusal::Varies { growth }) if is_about(growth, 2.0)), "{sunlit:?}");
    // Both halves saw all 200, one of them twice as bright; or a third of the frames saw
    // specular reflections.
    let seen_as = |parts: [Option<[f64; 3]>; 3]| desk(200).into_iter().map(move |patch| Patch { parts, ..patch });
    for (parts, by) in [([0.6, 1.2, 0.8], 2.0), ([0.8, 0.8, 0.5], 1.6)] {
        let differing = why(&seen_as(parts.map(|light| Some([light; 3]))).collect::<Vec<_>>(), 1.0);
        assert!(
            matches!(differing, Some(WhiteLevelRefusal::Differs { factor }) if is_about(factor, by)),
            "{differing:?}"
        );
    }
    let alike = [0.75, 0.85, 0.8].map(|light| Some([light; 3]));
    assert_eq!(why(&seen_as(alike).collect::<Vec<_>>(), 1.0), None);
    let dark = why(&desk(200), 0.5);
    assert!(matches!(dark, Some(WhiteLevelRefusal::Disagrees { factor }) if is_about(factor, 2.0)), "{dark:?}");
}

#[test]
fn unclaimed_level_is_the_exposure_raised_to_the_largest_reflectance() {
    for (exposure, white) in [(2.0, 2.0), (0.7, 0.8 / 0.9), (0.5, 0.75)] {
        let neutral = ExposureLevel { level: exposure, neutral: [1.2, 1.0, 0.8] };
        let level = level(&desk(600), &neutral);
        assert!(level.unclaimed.is_some() && is_about(relative_luminance(level.white), white), "{level:?}");
        assert!(is_about(level.white[0] / level.white[1], 1.2), "{level:?}");
        assert!(is_about(level.between[0], exposure / 2.0) && is_about(level.between[1], 2.0 * white), "{level:?}");
    }
}

#[test]
fn colour_is_weighted_by_the_area_of_neutral_surfaces() {
    // 225 voxels of 4 cm² are 0.09 m², half the weight: √(0.9/1) in red.
    let mut patches = desk(225);
    patches.iter_mut().take(225).for_each(|patch| patch.light[0] = 0.72);
    let level = level(&patches, &EXPOSURE);
    assert!(level.unclaimed.is_none() && is_about(level.white[0] / level.white[1], 0.9f64.sqrt()), "{level:?}");
    assert!(is_about(level.white[2], level.white[1]), "{level:?}");
}

#[test]
fn known_lamps_use_the_whitest_surfaces_unless_the_exposure_contradicts() {
    // 20 of 1000 show 0.8 by their brightest spots: W = 1, moved by the exposure of 1.4 as a
    // claim is.
    let by_lamps = |exposure: f64| {
        white_level_by_lamps(&desk(20), DVec3::Z, DVec3::ZERO, &ExposureLevel { level: exposure, ..EXPOSURE })
    };
    let level = by_lamps(1.4).unwrap();
    let white = 1.4f64.powf(0.15);
    assert!(is_about(level.white[1], white) && level.unclaimed.is_none(), "{level:?}");
    assert!(is_about(level.between[0], 1.0 / 1.1) && is_about(level.between[1], 1.1 * white), "{level:?}");
    assert!(by_lamps(2.1).is_none() && by_lamps(0.49).is_none());
    // Clipped, they are lower bounds: the exposure counts up to 1.4 times them.
    let mut clipped = desk(20);
    clipped.iter_mut().take(20).for_each(|patch| patch.is_bound = true);
    for (exposure, white) in [(0.7, 1.0), (1.3, 1.3), (1.9, 1.4)] {
        let exposure_level = ExposureLevel { level: exposure, ..EXPOSURE };
        let level = white_level_by_lamps(&clipped, DVec3::Z, DVec3::ZERO, &exposure_level).unwrap();
        assert!(is_about(level.white[1], white) && is_about(level.between[1], 1.6), "{exposure}: {level:?}");
    }
}
