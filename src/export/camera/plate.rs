//! The picture that another program renders. It is the recorded picture if the program's camera can
//! represent the lens. Otherwise it is an undistorted plate: a pinhole with square pixels and the
//! principal point in the centre, larger than the recorded picture (overscan), so that all of it is
//! inside. ST maps lead from one to the other.

use glam::DVec2;

use crate::camera::{Geometry, Intrinsics};

/// Tolerance of a lens that is written as another one, px of the recorded picture.
const LENS_TOLERANCE_PX: f64 = 0.1;
/// Rim of the undistorted plate around the recorded picture, px: for filters of redistorted
/// pictures.
const RIM_PX: f64 = 2.0;
/// Rounding errors of the border's rays, px: they add no pixel to the plate.
const ROUNDING_PX: f64 = 1e-6;
/// Largest ratio of the sides of the undistorted plate to those of the recorded picture. Beyond it
/// (about 150° across) a pinhole is no longer useful.
const MAX_ENLARGEMENT: f64 = 4.0;
/// Largest side of the undistorted plate, px.
const MAX_SIDE_PX: f64 = 32768.0;

/// Properties of a format's camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CameraAbilities {
    /// The principal point may lie off the centre.
    pub has_offsets: bool,
    /// The focal length may be animated.
    pub has_animated_lens: bool,
}

/// A pinhole, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateLens {
    pub focal_px: DVec2,
    pub principal_px: DVec2,
}

impl PlateLens {
    fn recorded(camera: &Geometry) -> Self {
        let i = &camera.intrinsics;
        Self { focal_px: DVec2::new(i.fx_px, i.fy_px), principal_px: DVec2::new(i.cx_px, i.cy_px) }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    pub width_px: u32,
    pub height_px: u32,
    /// Whether it is the recorded picture. Otherwise it needs ST maps.
    pub is_recorded: bool,
    /// One per camera of the recording.
    pub lenses: Vec<PlateLens>,
}

/// Why there is no plate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlateError {
    #[error(
        "the frames are 360° pictures, which no pinhole camera shows; render them into perspective pictures first, and \
         export the camera of those"
    )]
    Equirectangular,
    #[error(
        "the lens sees too far off its axis for a pinhole camera: the undistorted picture would be {} times the \
         recorded one; expected at most {MAX_ENLARGEMENT}. Crop the frames, and give the camera of the cropped ones",
        crate::text::fixed(*enlargement, 1)
    )]
    TooWide { enlargement: f64 },
}

impl Plate {
    /// The recorded picture as plate; `None` if a format's camera cannot represent one of the
    /// lenses within a tenth of a pixel.
    pub fn recorded(cameras: &[Geometry], abilities: CameraAbilities) -> Option<Self> {
        let first = cameras.first()?;
        let lens = PlateLens::recorded(first);
        let is_represented = |camera: &Geometry| {
            let Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px, .. } = camera.intrinsics;
            let half = 0.5 * DVec2::new(width_px.into(), height_px.into());
            // The anisotropy is largest at the picture's upper or lower border.
            let anisotropy_px = half.y * (fy_px / fx_px - 1.0).abs();
            let offset_px = (DVec2::new(cx_px, cy_px) - half).abs().max_element();
            camera.distortion.is_none()
                && anisotropy_px <= LENS_TOLERANCE_PX
                && (abilities.has_offsets || offset_px <= LENS_TOLERANCE_PX)
                && (abilities.has_animated_lens || PlateLens::recorded(camera) == lens)
        };
        let Intrinsics { width_px, height_px, .. } = first.intrinsics;
        cameras.iter().all(is_represented).then(|| Self {
            width_px,
            height_px,
            is_recorded: true,
            lenses: cameras.iter().map(PlateLens::recorded).collect(),
        })
    }

    /// The undistorted plate. All cameras share one lens, the one with the longest focal length;
    /// the maps of each camera lead to it.
    pub fn undistorted(cameras: &[Geometry]) -> Result<Self, PlateError> {
        if cameras.iter().any(Geometry::is_equirectangular) {
            return Err(PlateError::Equirectangular);
        }
        let focal_px = cameras.iter().map(|camera| camera.intrinsics.fx_px).fold(1e-3, f64::max);
        let mut half = DVec2::ONE;
        let mut enlargement = 0f64;
        for camera in cameras {
            let size = DVec2::new(camera.intrinsics.width_px.into(), camera.intrinsics.height_px.into());
            for at in border_px(size) {
                let ray = camera.unproject(at).ok_or(PlateError::TooWide { enlargement: f64::INFINITY })?;
                half = half.max(focal_px * ray.truncate().abs());
            }
            enlargement = enlargement.max((2.0 * half / size).max_element());
        }
        let size = 2.0 * (half + RIM_PX - ROUNDING_PX).ceil();
        if enlargement > MAX_ENLARGEMENT || size.max_element() > MAX_SIDE_PX {
            return Err(PlateError::TooWide { enlargement });
        }
        let lens = PlateLens { focal_px: DVec2::splat(focal_px), principal_px: 0.5 * size };
        Ok(Self {
            width_px: size.x as u32,
            height_px: size.y as u32,
            is_recorded: false,
            lenses: vec![lens; cameras.len()],
        })
    }

    pub fn size_px(&self) -> DVec2 {
        DVec2::new(self.width_px.into(), self.height_px.into())
    }

    /// Vertical field of view of a camera, rad, as if its principal point were in the centre.
    pub fn vertical_fov_rad(&self, camera: usize) -> f64 {
        2.0 * (0.5 * f64::from(self.height_px) / self.lenses[camera].focal_px.y).atan()
    }
}

/// Points of a picture's border, 128 for each side.
fn border_px(size: DVec2) -> impl Iterator<Item = DVec2> {
    const STEPS: u32 = 128;
    (0..STEPS).flat_map(move |step| {
        let along = size * (f64::from(step) / f64::from(STEPS));
        let back = size - along;
        [DVec2::new(along.x, 0.0), DVec2::new(size.x, along.y), DVec2::new(back.x, size.y), DVec2::new(0.0, back.y)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, LensModel};

    const CENTRED: CameraAbilities = CameraAbilities { has_offsets: false, has_animated_lens: true };
    const OFFSETS: CameraAbilities = CameraAbilities { has_offsets: true, has_animated_lens: true };

    fn with(change: impl Fn(&mut Intrinsics, &mut Distortion)) -> Geometry {
        let Geometry { mut intrinsics, mut distortion, .. } = Geometry::pinhole(640, 480, 500.0);
        change(&mut intrinsics, &mut distortion);
        Geometry::new(intrinsics, distortion)
    }

    #[test]
    fn recorded_picture_is_the_plate_of_a_camera_that_the_format_represents() {
        let is_recorded =
            |camera: &Geometry, abilities| Plate::recorded(std::slice::from_ref(camera), abilities).is_some();
        assert!(is_recorded(&Geometry::pinhole(640, 480, 500.0), CENTRED));
        let off = with(|i, _| i.cx_px += 0.2);
        assert_eq!((is_recorded(&off, CENTRED), is_recorded(&off, OFFSETS)), (false, true));
        assert!(is_recorded(&with(|i, _| i.cx_px += 0.05), CENTRED));
        // A tenth of a percent of 240 px is more than a tenth of a pixel.
        assert!(!is_recorded(&with(|i, _| i.fy_px *= 1.001), OFFSETS));
        assert!(!is_recorded(&with(|_, d| d.k1 = 1e-3), OFFSETS));
        let zoom = [Geometry::pinhole(640, 480, 500.0), Geometry::pinhole(640, 480, 600.0)];
        assert!(Plate::recorded(&zoom, CENTRED).is_some_and(|plate| plate.lenses[1].focal_px.x == 600.0));
        assert_eq!(Plate::recorded(&zoom, CameraAbilities { has_animated_lens: false, ..CENTRED }), None);
    }

    #[test]
    fn undistorted_plate_holds_the_picture_and_is_centred() {
        // 20 px off the centre: 340 px on the wider side, and the rim.
        let plate = Plate::undistorted(&[with(|i, _| i.cx_px += 20.0)]).unwrap();
        assert_eq!((plate.width_px, plate.height_px), (2 * 342, 2 * 242));
        assert_eq!(plate.lenses[0].principal_px, DVec2::new(342.0, 242.0));
        assert!((plate.vertical_fov_rad(0) - 2.0 * (242.0f64 / 500.0).atan()).abs() < 1e-12);
        // A barrel's corners are farther out.
        let barrel = with(|_, d| d.k1 = -0.2);
        let plate = Plate::undistorted(std::slice::from_ref(&barrel)).unwrap();
        let corner = 500.0 * barrel.unproject(DVec2::ZERO).unwrap();
        assert!(-corner.x > 320.0 && f64::from(plate.width_px) * 0.5 >= -corner.x + RIM_PX - 1e-9, "{corner}");
        assert!(f64::from(plate.width_px) * 0.5 < -corner.x + RIM_PX + 1.0);
    }

    #[test]
    fn lenses_beyond_a_pinhole_are_refused() {
        let fisheye = with(|i, d| {
            d.model = LensModel::OpencvFisheye;
            i.fx_px = 260.0;
            i.fy_px = 260.0;
        });
        let error = Plate::undistorted(&[fisheye]).unwrap_err().to_string();
        assert!(error.starts_with("the lens sees too far off its axis"), "{error}");
        let around = with(|i, d| {
            d.model = LensModel::Equirectangular;
            i.height_px = 320;
        });
        assert_eq!(Plate::undistorted(&[around]), Err(PlateError::Equirectangular));
    }
}
