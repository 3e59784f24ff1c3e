use std::sync::LazyLock;

use super::*;
use proptest::prelude::*;

/// The published model of the camera of TUM's fr1 recordings.
static FR1: LazyLock<Distortion> = LazyLock::new(|| Distortion {
    model: LensModel::Opencv,
    k1: 0.2624,
    k2: -0.9531,
    p1: -0.0054,
    p2: 0.0026,
    k3: 1.1633,
    ..Default::default()
});
fn fisheye([k1, k2, k3, k4]: [f64; 4]) -> Distortion {
    Distortion { model: LensModel::OpencvFisheye, k1, k2, k3, k4, ..Default::default() }
}

#[test]
fn fisheye_matches_hand_calculation() {
    // (1, 1, √2): 45° off the axis. θ = 0.785398, θ² = 0.616850; 1 + 0.0616850 − 0.0190252 +
    // 0.0070415 − 0.0014478 = 1.0482535, times θ = 0.823296.
    let lens = fisheye([0.1, -0.05, 0.03, -0.01]);
    let at = lens.project(DVec3::new(1.0, 1.0, 2f64.sqrt()), lens.valid_radius()).unwrap();
    assert!((at - DVec2::splat(0.823_296 / 2f64.sqrt())).length() < 1e-6, "{at}");
    // Without coefficients, equal angles are equal distances, even behind the camera: 120° off
    // the axis.
    let equal = fisheye([0.0; 4]);
    let at = equal.project(DVec3::new(0.0, 3f64.sqrt(), -1.0), equal.valid_radius()).unwrap();
    assert!((at - DVec2::new(0.0, 120f64.to_radians())).length() < 1e-12, "{at}");
    assert_eq!(equal.project(DVec3::NEG_Z, equal.valid_radius()), None);
    assert_eq!(equal.project(DVec3::ZERO, equal.valid_radius()), None);
}

#[test]
fn folding_fisheye_continues_monotonically() {
    // θ(1 − 0.1 θ²): slope 1 − 0.3 θ² reaches 0.05 at θ = √(0.95/0.3) = 1.78, 102°.
    let lens = fisheye([-0.1, 0.0, 0.0, 0.0]);
    let valid = lens.valid_radius();
    assert!((valid - (0.95f64 / 0.3).sqrt()).abs() < 1e-9);
    let project = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        lens.project(DVec3::new(s, 0.0, c), valid)
    };
    assert!(project(101.0).is_some() && project(103.0).is_none());
    // This one folds before 90°: 0.05 at √(0.95/0.9) = 58.9°. From there to 90° it continues
    // along the tangent.
    let lens = fisheye([-0.3, 0.0, 0.0, 0.0]);
    let valid = lens.valid_radius();
    let mut last = -1.0;
    for i in 0..900 {
        let (s, c) = (f64::from(i) * 0.1).to_radians().sin_cos();
        let at = lens.project(DVec3::new(s, 0.0, c), valid).unwrap();
        assert!(at.x > last && at.y == 0.0, "folds back at {i}");
        last = at.x;
        let back = lens.unproject(at, valid).unwrap();
        assert!((back - DVec3::new(s, 0.0, c)).length() < 1e-9, "{i}: {back}");
    }
    assert_eq!(lens.unproject(DVec2::new(9.0, 0.0), valid), None);
}

#[test]
fn coefficients_of_another_model_are_reported() {
    assert_eq!(Distortion { p2: 0.1, ..fisheye([0.0; 4]) }.missing(), Some("p2"));
    assert_eq!(Distortion { k4: 0.1, ..FR1.clone() }.missing(), Some("k4"));
    assert_eq!((FR1.missing(), fisheye([0.1; 4]).missing()), (None, None));
    assert_eq!(Distortion { omega: 0.1, ..FR1.clone() }.missing(), Some("omega"));
    assert_eq!(Distortion { k1: 0.1, ..fov(0.9) }.missing(), Some("k1"));
    assert_eq!(Distortion { k6: 0.1, ..THIN_PRISM.clone() }.missing(), Some("k6"));
    assert_eq!(Distortion { sy1: 0.1, ..KINECT.clone() }.missing(), Some("sy1"));
    assert_eq!((fov(0.9).missing(), THIN_PRISM.missing(), KINECT.missing()), (None, None, None));
}

/// Coefficients of the size that depth cameras have: numerator and denominator nearly cancel.
static KINECT: LazyLock<Distortion> = LazyLock::new(|| Distortion {
    model: LensModel::OpencvRational,
    k1: 0.5,
    k2: -2.6,
    p1: 0.0007,
    p2: -0.0002,
    k3: 1.5,
    k4: 0.38,
    k5: -2.4,
    k6: 1.44,
    ..Default::default()
});

static THIN_PRISM: LazyLock<Distortion> = LazyLock::new(|| Distortion {
    model: LensModel::ThinPrismFisheye,
    k1: -0.03,
    k2: 0.01,
    p1: 0.002,
    p2: -0.001,
    k3: 0.004,
    sx1: 0.003,
    sy1: -0.002,
    ..Default::default()
});

fn fov(omega: f64) -> Distortion {
    Distortion { model: LensModel::Fov, omega, ..Default::default() }
}

#[test]
fn rational_distortion_matches_opencv() {
    // cv2.projectPoints, OpenCV 4, with an identity camera matrix.
    for (p, expected) in [
        ([0.3, -0.2], [0.303_515_593_404_482_5, -0.202_270_062_269_655]),
        ([0.6, 0.45], [0.612_699_139_751_552_8, 0.460_002_479_813_664_6]),
        ([-0.1, 0.7], [-0.102_474_727_272_727_3, 0.716_973_090_909_091]),
    ] {
        let at = KINECT.distort(p.into(), KINECT.valid_radius());
        assert!((at - DVec2::from(expected)).length() < 1e-14, "{at}");
    }
    // Without a denominator it is `opencv`.
    let plain = Distortion { model: LensModel::OpencvRational, ..FR1.clone() };
    assert_eq!(plain.valid_radius(), FR1.valid_radius());
    let p = DVec2::new(0.3, -0.2);
    assert_eq!(plain.distort(p, 1.0), FR1.distort(p, 1.0));
}

#[test]
fn rational_lens_is_continued_before_its_pole() {
    // 1/(1 − 0.25 r²): the pole is at 2, the denominator 0.05 at √3.8.
    let lens = Distortion { model: LensModel::OpencvRational, k4: -0.25, ..Default::default() };
    let valid = lens.valid_radius();
    assert!((valid - 3.8f64.sqrt()).abs() < 1e-9, "{valid}");
    // d/dr r/(1 − 0.25 r²) = (1 + 0.25 r²)/(1 − 0.25 r²)²; at 1: 1.25/0.5625.
    assert!((lens.slope(1.0) - 1.25 / 0.5625).abs() < 1e-12);
    let mut last = -1.0;
    for i in 0..400 {
        let at = lens.distort(DVec2::new(f64::from(i) * 0.01, 0.0), valid).x;
        assert!(at > last, "{i}");
        last = at;
    }
}

#[test]
fn fov_matches_hand_calculation() {
    // ω = 0.9: 2 tan 0.45 = 0.966 110 1. (0.3, −0.2): r = 0.360 555 1, atan(0.348 336 0) =
    // 0.335 191 6, over 0.9: 0.372 435 1.
    let lens = fov(0.9);
    let at = lens.distort(DVec2::new(0.3, -0.2), lens.valid_radius());
    assert!((at - DVec2::new(0.309_884_754, -0.206_589_836)).length() < 1e-9, "{at}");
    let at = lens.distort(DVec2::new(1.5, 2.0), lens.valid_radius());
    assert!((at - DVec2::new(0.785_501_786, 1.047_335_714)).length() < 1e-9, "{at}");
    // Without an angle it is a pinhole.
    let p = DVec2::new(0.3, -0.2);
    assert!((fov(0.0).distort(p, 10.0) - p).length() < 1e-8);
    // d/dr: 0.966 110 1/0.9/(1 + 0.933 368 8) at 1.
    assert!((lens.slope(1.0) - 0.555_226).abs() < 1e-5, "{}", lens.slope(1.0));
    assert_eq!(lens.distort(DVec2::ZERO, 10.0), DVec2::ZERO);
}

#[test]
fn thin_prism_fisheye_matches_opencv() {
    // cv2.projectPoints with twelve coefficients at (θ cos φ, θ sin φ, 1): k4 = 0, s1 = sx1, s3
    // = sy1. The last direction is behind the camera.
    for (d, expected) in [
        ([1.0, 1.0, 2f64.sqrt()], [0.549_568_265_866_994_4, 0.548_334_565_316_858_2]),
        ([0.75, -1.0, 1.0], [0.528_748_277_019_620_5, -0.702_856_595_353_575_9]),
        ([0.9, 0.1, -0.2], [2.022_351_967_860_098_7, 0.223_995_207_352_206_57]),
    ] {
        let at = THIN_PRISM.project(DVec3::from(d), THIN_PRISM.valid_radius()).unwrap();
        assert!((at - DVec2::from(expected)).length() < 1e-14, "{at}");
    }
    // θ⁸: 45° off the axis, k4 = 0.1: 0.785398 · (1 + 0.1 · 0.144786) = 0.796769.
    let lens = Distortion { model: LensModel::ThinPrismFisheye, k4: 0.1, ..Default::default() };
    let at = lens.project(DVec3::new(1.0, 0.0, 1.0), lens.valid_radius()).unwrap();
    assert!((at - DVec2::new(0.796_769_5, 0.0)).length() < 1e-6, "{at}");
}

#[test]
fn distortion_matches_hand_calculation() {
    // x = 0.3, y = -0.2: r² = 0.13; radial = 1 + 0.034112 - 0.01610739 + 0.0025557701 =
    // 1.02056038 x' = 0.3·1.02056038 + 2·(-0.0054)(-0.06) + 0.0026·(0.13 + 0.18) = 0.306168114
    // + 0.000648 + 0.000806
    let d = FR1.distort(DVec2::new(0.3, -0.2), FR1.valid_radius());
    assert!((d.x - 0.307_622_11).abs() < 1e-7, "{}", d.x);
    // y' = -0.2·1.02056038 - 0.0054·(0.13 + 0.08) + 2·0.0026·(-0.06) = -0.204112076 - 0.001134
    // - 0.000312
    assert!((d.y + 0.205_558_08).abs() < 1e-7, "{}", d.y);
}

#[test]
fn valid_radius_is_where_the_slope_vanishes() {
    // r(1 - 0.25 r²): slope 1 - 0.75 r² reaches 0.05 at r = sqrt(0.95/0.75).
    let barrel = Distortion { k1: -0.25, ..Default::default() };
    let valid = barrel.valid_radius();
    assert!((valid - (0.95f64 / 0.75).sqrt()).abs() < 1e-9);
    let mut last = -1.0;
    for i in 0..1000 {
        let r = f64::from(i) * 0.01;
        let d = barrel.distort(DVec2::new(r, 0.0), valid).x;
        assert!(d > last, "folds back at {r}");
        last = d;
    }
}

proptest! {
    /// One round trip for all models, over their whole field of view.
    #[test]
    fn round_trip(
        around in 0.0..std::f64::consts::TAU, share in 0.0f64..1.0, k1 in -0.4f64..0.4, k2 in -0.1f64..0.1, p in -0.004f64..0.004,
        k in prop::array::uniform4(-0.05f64..0.05),
    ) {
        let brown = Distortion { k1, k2, p1: p, p2: -p, ..Default::default() };
        let round = Distortion { model: LensModel::Equirectangular, ..Default::default() };
        let rational = Distortion { model: LensModel::OpencvRational, k4: k[0], k5: k[1], k6: k[2], ..brown.clone() };
        let prism = Distortion { model: LensModel::ThinPrismFisheye, p1: p, p2: -p, sx1: p, sy1: 0.5 * p, ..fisheye(k) };
        let models = [
            FR1.clone(), brown, fisheye(k), fisheye([k1, k2, 0.0, 0.0]), fisheye([0.0; 4]), round, rational, KINECT.clone(), prism,
            THIN_PRISM.clone(), fov(0.01 + 5.0 * k1.abs()),
        ];
        for model in models {
            let valid = model.valid_radius();
            let theta = share * match model.model {
                LensModel::Opencv | LensModel::OpencvRational | LensModel::StMap => (0.95 * valid).atan().min(0.85),
                LensModel::Fov => 1.5,
                LensModel::OpencvFisheye | LensModel::ThinPrismFisheye => valid,
                LensModel::Equirectangular => PI,
            };
            let d = DVec3::new(theta.sin() * around.cos(), theta.sin() * around.sin(), theta.cos());
            let back = model.unproject(model.project(3.0 * d, valid).unwrap(), valid).unwrap();
            prop_assert!((back - d).length() < 1e-7, "{:?}: {} {}", model, d, back);
        }
    }
}
