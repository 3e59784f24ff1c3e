//! ST maps in Nuke's convention: for each pixel of the output, the place in the input where its
//! value comes from. S counts to the right and T upwards, 0 to 1 across the input. The centre of
//! the pixel in column x of w is at (x + 0.5)/w. Source: Nuke's reference guide, `STMap`.

use glam::{DVec2, DVec3};

use super::plate::{Plate, PlateLens};
use crate::camera::Geometry;
use crate::parallel::{over_rows, processors};
use crate::sink::exr::StMap;

/// Value of pixels without a place in the input: outside it.
const OUTSIDE: [f32; 2] = [-1.0, -1.0];

fn filled(size_px: [u32; 2], source_size_px: DVec2, source_px: impl Fn(DVec2) -> Option<DVec2> + Sync) -> StMap {
    let [width, height] = size_px;
    let mut st = vec![OUTSIDE; width as usize * height as usize];
    over_rows(&mut st, width as usize, processors(), |y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let Some(at) = source_px(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) else { continue };
            let at = at / source_size_px;
            *value = [at.x as f32, (1.0 - at.y) as f32];
        }
    });
    StMap { width, height, st }
}

/// The map that makes the undistorted plate of a recorded picture.
pub fn undistort(camera: &Geometry, plate: &Plate, lens: &PlateLens) -> StMap {
    let i = &camera.intrinsics;
    let recorded_size = DVec2::new(i.width_px.into(), i.height_px.into());
    filled([plate.width_px, plate.height_px], recorded_size, |at| {
        camera.project(DVec3::from(((at - lens.principal_px) / lens.focal_px, 1.0))).filter(|at| at.is_finite())
    })
}

/// The map that makes a recorded picture of the undistorted plate.
pub fn redistort(camera: &Geometry, plate: &Plate, lens: &PlateLens) -> StMap {
    let i = &camera.intrinsics;
    filled([i.width_px, i.height_px], plate.size_px(), |at| {
        let ray = camera.unproject(at)?;
        Some(lens.focal_px * ray.truncate() + lens.principal_px)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use crate::interpolation::bilinear;

    #[test]
    fn map_of_a_pinhole_is_the_identity_with_a_rim() {
        let camera = Geometry::pinhole(64, 48, 50.0);
        let plate = Plate::undistorted(std::slice::from_ref(&camera)).unwrap();
        assert_eq!((plate.width_px, plate.height_px), (68, 52));
        let map = undistort(&camera, &plate, &plate.lenses[0]);
        // Column 2 of the plate is column 0 of the picture, row 49 its lowest, 47.
        let at = |x: usize, y: usize| map.st[68 * y + x];
        assert_eq!(at(2, 49), [0.5 / 64.0, 0.5 / 48.0]);
        assert_eq!(at(65, 2), [63.5 / 64.0, 47.5 / 48.0]);
        assert!(at(0, 0)[0] < 0.0 && at(0, 0)[1] > 1.0);
        let map = redistort(&camera, &plate, &plate.lenses[0]);
        assert_eq!((map.width, map.height, map.st[0]), (64, 48, [2.5 / 68.0, 1.0 - 2.5 / 52.0]));
    }

    #[test]
    fn maps_match_the_polynomial_and_invert_each_other() {
        let intrinsics = Intrinsics {
            width_px: 320,
            height_px: 240,
            fx_px: 258.0,
            fy_px: 257.0,
            cx_px: 157.0,
            cy_px: 126.0,
            ..Default::default()
        };
        let camera =
            Geometry::new(intrinsics, Distortion { k1: -0.12, k2: 0.03, p1: 0.002, p2: -0.003, ..Default::default() });
        let plate = Plate::undistorted(std::slice::from_ref(&camera)).unwrap();
        let lens = &plate.lenses[0];
        let (to_plate, to_picture) = (undistort(&camera, &plate, lens), redistort(&camera, &plate, lens));
        // Brown's polynomial at one pixel of the plate.
        let (column, row) = (90usize, 60usize);
        let x = (column as f64 + 0.5 - 0.5 * f64::from(plate.width_px)) / 258.0;
        let y = (row as f64 + 0.5 - 0.5 * f64::from(plate.height_px)) / 258.0;
        let r2 = x * x + y * y;
        let radial = 1.0 - 0.12 * r2 + 0.03 * r2 * r2;
        let u = 258.0 * (x * radial + 2.0 * 0.002 * x * y - 0.003 * (r2 + 2.0 * x * x)) + 157.0;
        let v = 257.0 * (y * radial + 0.002 * (r2 + 2.0 * y * y) - 2.0 * 0.003 * x * y) + 126.0;
        let [s, t] = to_plate.st[plate.width_px as usize * row + column];
        assert!((f64::from(s) * 320.0 - u).abs() < 1e-3 && ((1.0 - f64::from(t)) * 240.0 - v).abs() < 1e-3);

        // Each recorded pixel, through both maps.
        let channel = |i: usize| to_plate.st.iter().map(|st| st[i]).collect::<Vec<f32>>();
        let (s, t) = (channel(0), channel(1));
        let size = [plate.width_px as usize, plate.height_px as usize];
        for (n, [plate_s, plate_t]) in to_picture.st.iter().enumerate() {
            let at = DVec2::new(f64::from(*plate_s), 1.0 - f64::from(*plate_t)) * plate.size_px() - 0.5;
            let [s, t] = [&s, &t].map(|values| bilinear_at(values, size, at));
            let back = DVec2::new(s * 320.0, (1.0 - t) * 240.0);
            let own = DVec2::new((n % 320) as f64 + 0.5, (n / 320) as f64 + 0.5);
            assert!((back - own).length() < 0.01, "{own}: {back}");
        }
    }

    fn bilinear_at(values: &[f32], [width, _]: [usize; 2], at: DVec2) -> f64 {
        let (x, y) = (at.x.floor() as usize, at.y.floor() as usize);
        let value = |x: usize, y: usize| f64::from(values[width * y + x]);
        bilinear([value(x, y), value(x + 1, y), value(x, y + 1), value(x + 1, y + 1)], [at.x.fract(), at.y.fract()])
    }
}
