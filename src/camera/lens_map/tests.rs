use super::*;
use crate::camera::{Distortion, Geometry, LensModel};
use crate::params::{Field, Kind, Params};
use glam::DVec3;

/// The camera of TUM's freiburg1, and a wide fisheye.
fn lenses() -> [Geometry; 2] {
    let intrinsics = Intrinsics { fx_px: 517.3, fy_px: 516.5, cx_px: 319.1, cy_px: 255.8, ..Intrinsics::default() };
    let brown = Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Default::default() };
    let fisheye = Distortion { model: LensModel::OpencvFisheye, k1: -0.012, k2: 0.004, ..Default::default() };
    let wide = Intrinsics { fx_px: 300.0, fy_px: 301.0, cx_px: 322.0, cy_px: 236.0, ..Intrinsics::default() };
    [Geometry::new(intrinsics, brown), Geometry::new(wide, fisheye)]
}

/// A plate with the lens's focal length, centred, and pairs of places all over it.
fn pairs(lens: &Geometry) -> ([u32; 2], Vec<MapSample>) {
    let i = &lens.intrinsics;
    let reach = |at_px: DVec2| lens.unproject(at_px).unwrap().truncate().abs() * i.fx_px;
    let far = grid_px(DVec2::new(640.0, 480.0), 24).map(reach).fold(DVec2::ZERO, DVec2::max);
    let size = (2.0 * (far + 3.0)).ceil();
    let place = |x: u32, y: u32| {
        let undistorted_px = DVec2::new(x.into(), y.into()) + 0.5;
        let at = (undistorted_px - 0.5 * size) / i.fx_px;
        MapSample { undistorted_px, recorded: lens.project(at.extend(1.0)).unwrap() / DVec2::new(640.0, 480.0) }
    };
    let [width, height] = [size.x as u32, size.y as u32];
    let all = (0..height).step_by(3).flat_map(|y| (0..width).step_by(3).map(move |x| place(x, y)));
    let is_near = |sample: &MapSample| sample.recorded.min_element() > -0.1 && sample.recorded.max_element() < 1.1;
    ([width, height], all.filter(is_near).collect())
}

/// The camera of the plate, laid over the recorded picture's centre.
fn plate_camera(lens: &Geometry) -> Intrinsics {
    let focal_px = lens.intrinsics.fx_px;
    Intrinsics { fx_px: focal_px, fy_px: focal_px, cx_px: 320.0, cy_px: 240.0, ..Intrinsics::default() }
}

fn with_table(lens: &Geometry) -> Geometry {
    let (undistorted_px, samples) = pairs(lens);
    let map = fit(&samples, undistorted_px, None).unwrap();
    assert_eq!(map.check(&plate_camera(lens)), Ok(()));
    Geometry::new(plate_camera(lens), Distortion { model: LensModel::StMap, map: Some(map), ..Default::default() })
}

#[test]
fn spline_reproduces_cubics_and_its_weights_their_derivatives() {
    for t in [0.0, 0.2, 0.7, 1.0] {
        let weights = spline_weights(t);
        let sum = |k: usize, power: i32| -> f64 {
            weights.iter().zip([-1.0f64, 0.0, 1.0, 2.0]).map(|(w, at)| w[k] * at.powi(power)).sum()
        };
        assert!((sum(0, 0) - 1.0).abs() < 1e-15 && sum(1, 0).abs() < 1e-15);
        assert!((sum(0, 1) - t).abs() < 1e-15 && (sum(1, 1) - 1.0).abs() < 1e-15);
        // Control points i² give t² + 1/3 (de Boor).
        assert!((sum(0, 2) - t * t - 1.0 / 3.0).abs() < 1e-15 && (sum(1, 2) - 2.0 * t).abs() < 1e-15);
    }
}

#[test]
fn table_of_a_lens_projects_like_its_formula() {
    for lens in lenses() {
        let table = with_table(&lens);
        for at_px in grid_px(DVec2::new(640.0, 480.0), 40) {
            let ray = lens.unproject(at_px).unwrap();
            let own = table.project(3.0 * ray).unwrap();
            assert!(own.distance(at_px) < 0.01, "{own} {at_px}");
            let back = table.unproject(at_px).unwrap();
            let off_px = (back - ray).length() * lens.intrinsics.fx_px;
            assert!(off_px < 0.02 && table.project(back).unwrap().distance(at_px) < 1e-7, "{off_px} at {at_px}");
        }
        // A crop of the picture has the same rays.
        let crop = crate::camera::Crop { left_px: 100.0, top_px: 60.0, step: 0.5 };
        let part = crop.geometry(&table, 320, 240, 36.0);
        let point = DVec3::new(-0.1, 0.05, 1.0);
        assert!(crop.source_px(part.project(point).unwrap()).distance(table.project(point).unwrap()) < 1e-9);
    }
}

#[test]
fn table_continues_along_its_tangent() {
    let table = with_table(&lenses()[0]);
    let bound = table.distortion.bound_map().unwrap();
    let corner = bound.low;
    let [inside, outside] = [1e-6, -1e-6].map(|step| bound.distort(corner + step));
    assert!(inside.distance(outside) < 1e-5);
    let at = |steps: f64| bound.distort(corner - steps);
    assert!((at(0.2) - at(0.1) - (at(0.1) - at(0.0))).length() < 1e-12);
    assert!(at(3.0).x < at(0.0).x && at(3.0).y < at(0.0).y);
}

#[test]
fn text_of_a_table_preserves_it_and_its_camera() {
    let lens = with_table(&lenses()[1]);
    let kind = LensMap::kind(None);
    assert_eq!(kind, Kind::LensTable);
    let map = lens.distortion.map.clone().unwrap();
    for map in [map.unbound(), map] {
        let text = map.to_value();
        let back = LensMap::from_value(&text, &kind).unwrap();
        assert_eq!(back, map);
        assert_eq!(back.bound(), map.bound());
    }
    let value = lens.distortion.get("map").unwrap();
    let crate::params::Value::Text(text) = value else { panic!("no text") };
    assert!(text.len() < 100_000, "{} bytes", text.len());
    let (first, rest) = text.split_once(' ').unwrap();
    for wrong in [format!("{first} nan {rest}"), format!("{first}{rest}"), format!("0.5 {rest}"), format!("0 {rest}")] {
        let is_refused = LensMap::from_value(&crate::params::Value::Text(wrong), &kind).is_none();
        assert!(is_refused);
    }
}

#[test]
fn noise_of_codes_is_averaged_and_rough_maps_are_refused() {
    let lens = &lenses()[0];
    let (undistorted_px, samples) = pairs(lens);
    let coded = |steps: f64| -> Vec<MapSample> {
        let step = |sample: &MapSample| MapSample { recorded: (sample.recorded * steps).round() / steps, ..*sample };
        samples.iter().map(step).collect()
    };
    let map = fit(&coded(65535.0), undistorted_px, Some([640, 480])).unwrap();
    let table = Geometry::new(
        plate_camera(lens),
        Distortion { model: LensModel::StMap, map: Some(map), ..Distortion::default() },
    );
    for at_px in grid_px(DVec2::new(640.0, 480.0), 20) {
        let own = table.project(lens.unproject(at_px).unwrap()).unwrap();
        assert!(own.distance(at_px) < 0.01, "{own} {at_px}");
    }
    let error = fit(&coded(255.0), undistorted_px, Some([640, 480])).unwrap_err().to_string();
    assert!(error.contains("is not smooth") && error.contains("column"), "{error}");
    assert_eq!(fit(&samples[..20], undistorted_px, None), Err(FitError::TooFew));
    assert_eq!(fit(&[samples[0]; 100], undistorted_px, None), Err(FitError::TooFew));
}

#[test]
fn map_of_another_picture_is_refused() {
    let lens = &lenses()[0];
    let (undistorted_px, samples) = pairs(lens);
    let map = fit(&samples, undistorted_px, Some([640, 480])).unwrap();
    let camera = plate_camera(lens);
    let check = |change: &dyn Fn(&mut Intrinsics)| {
        let mut other = camera.clone();
        change(&mut other);
        map.check(&other)
    };
    assert_eq!(check(&|_| ()), Ok(()));
    assert!(check(&|i| i.width_px = 1280).unwrap_err().contains("640x480 px, and the recorded picture is 1280x480"));
    let open = fit(&samples, undistorted_px, None).unwrap();
    let error = open.check(&Intrinsics { width_px: 853, cx_px: 426.5, ..camera.clone() }).unwrap_err();
    assert!(error.contains("another aspect than 853x480"), "{error}");
    let large = Intrinsics { width_px: 1920, height_px: 1440, cx_px: 960.0, cy_px: 720.0, ..camera.clone() };
    assert!(open.check(&large).unwrap_err().contains("full resolution"));
    // Without the outer tenth of the picture.
    let inner: Vec<MapSample> = samples.iter().copied().filter(|s| s.recorded.min_element() > 0.1).collect();
    let error = fit(&inner, undistorted_px, None).unwrap().check(&camera).unwrap_err();
    assert!(error.contains("ends before the border") && error.contains("overscan"), "{error}");
    let place = |n: u32| {
        let undistorted_px = DVec2::new((n % 71).into(), (n / 71).into()) * 10.0;
        let recorded = (undistorted_px - DVec2::new(30.0, 20.0)) / DVec2::new(640.0, 480.0);
        MapSample { undistorted_px, recorded }
    };
    let same: Vec<MapSample> = (0..71 * 53).map(place).collect();
    let error = fit(&same, [700, 520], None).unwrap().check(&camera).unwrap_err();
    assert!(error.contains("is the identity"), "{error}");
}
