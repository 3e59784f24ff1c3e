//! Framing: the part of the recorded picture seen by a film and a lens.

use glam::DVec2;

use crate::camera::{Crop, Film, FilmError, Geometry, ThinLens, ThinLensError};

/// Requested part of the recorded picture. The default is its centre, with the field of view of the
/// lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aim {
    /// The centre, px of the recorded picture. It is shifted by the minimum that keeps the frame
    /// inside the recording.
    pub at_px: Option<DVec2>,
    /// Minimum width and height, px of the recorded picture; replaces a focal length.
    pub around_px: Option<DVec2>,
}

/// Film, lens and picture of the virtual camera, and its crop of the recorded picture.
#[derive(Clone, Debug)]
pub struct Framing {
    pub film: Film,
    /// Focal length of the lens focused at infinity, metres.
    pub focal_length_m: f64,
    /// May be infinite.
    pub focus_distance_m: f64,
    pub framed: Crop,
    /// The camera that takes the photograph.
    pub geometry: Geometry,
    /// Delay of the photograph's middle row after the recorded picture's, seconds. 0 if the
    /// photograph was not aimed.
    pub later_s: f64,
}

/// Errors of framing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FramingError {
    #[error(
        "a focal length of {actual_mm:.1} mm on {film} covers more than the recording, {needed_deg:.1} degrees across \
         instead of {recorded_deg:.1}: expected {min_mm:.2} mm or more"
    )]
    TooWide { actual_mm: f64, film: Film, needed_deg: f64, recorded_deg: f64, min_mm: f64 },
    #[error(
        "a picture {actual} px wide and {height} px high: expected sides of 16 to 20000 px. The picture \
         covers {columns:.0} px of the recording across; a longer lens or a nearer focus covers fewer"
    )]
    Size { actual: u32, height: u32, columns: f64 },
    #[error(
        "{actual} px across: the picture covers {max_columns} px of the recording with a film of this shape; \
         expected 1 to {max_columns}"
    )]
    TooMany { actual: f64, max_columns: f64 },
    #[error("camera.film_width_mm with the picture's shape: {0}")]
    Film(#[from] FilmError),
    #[error(transparent)]
    Lens(#[from] ThinLensError),
}

const SIDE_PX: std::ops::RangeInclusive<u32> = 16..=20000;

impl Framing {
    /// Frames the centre of a camera's picture. Defaults: the camera's own film; the focal length
    /// (metres) with the whole field of view; the width with as many pixels as the recording has
    /// there.
    ///
    /// With a focal length f the image distance is v = f·d/(d − f) (vSLRcam (2)): focusing nearer
    /// narrows the view.
    pub fn new(
        whole: &Geometry,
        film: Option<Film>,
        focal_length_m: Option<f64>,
        focus_distance_m: f64,
        width_px: Option<u32>,
    ) -> Result<Self, FramingError> {
        Self::aimed(whole, film, focal_length_m, focus_distance_m, width_px, Aim::default())
    }

    /// Framing with an aim. `Aim::around_px` replaces the focal length.
    pub fn aimed(
        whole: &Geometry,
        film: Option<Film>,
        focal_length_m: Option<f64>,
        focus_distance_m: f64,
        width_px: Option<u32>,
        aim: Aim,
    ) -> Result<Self, FramingError> {
        let i = &whole.intrinsics;
        let (whole_width, whole_height) = (f64::from(i.width_px), f64::from(i.height_px));
        let film = match film {
            Some(film) => film.turned_for(i.width_px, i.height_px),
            None => Film::new(i.film_width_mm, i.film_width_mm * whole_height / whole_width)?,
        };
        let aspect = film.width_mm() / film.height_mm();
        let max_columns = whole_width.min(whole_height * aspect);
        // A part `columns` wide fills the film at the image distance fx · film width / columns.
        let across = i.fx_px * 1e-3 * film.width_mm();
        let focal_length_m = focal_length_m.filter(|_| aim.around_px.is_none());
        let columns = match (focal_length_m, aim.around_px) {
            (_, Some(around)) => {
                let columns = around.x.max(around.y * aspect);
                if !(1.0..=max_columns * 1.0001).contains(&columns) {
                    return Err(FramingError::TooMany { actual: columns.round(), max_columns: max_columns.floor() });
                }
                columns.min(max_columns)
            }
            (Some(f), None) => {
                // Rejects a focus within the focal length, and invalid lengths.
                let columns = across / ThinLens::with_diameter(f, 0.0, focus_distance_m)?.image_distance_m();
                // Exif and the message below round to about a ten-thousandth.
                if columns > max_columns * 1.0001 {
                    let degrees = |columns: f64| 2.0 * (0.5 * columns / i.fx_px).atan().to_degrees();
                    let min_m = ThinLens::focal_length_behind_m(across / max_columns, focus_distance_m);
                    return Err(FramingError::TooWide {
                        actual_mm: 1e3 * f,
                        film,
                        needed_deg: degrees(columns),
                        recorded_deg: degrees(max_columns),
                        // Rounded so that the printed value is accepted.
                        min_mm: (1e5 * min_m).ceil() * 1e-2,
                    });
                }
                columns.min(max_columns)
            }
            (None, None) => max_columns,
        };
        let width = width_px.unwrap_or(columns.round() as u32);
        let step = if width_px.is_none() && columns.fract() == 0.0 { 1.0 } else { columns / f64::from(width) };
        let height = (columns / aspect / step).round() as u32;
        if !SIDE_PX.contains(&width) || !SIDE_PX.contains(&height) {
            return Err(FramingError::Size { actual: width, height, columns });
        }
        let edge = |whole: f64, pixels: u32, aimed: Option<f64>| {
            let left_over = whole - step * f64::from(pixels);
            let edge = match aimed {
                // Rounding may make the part slightly wider than the whole.
                Some(at) => (at - 0.5 * step * f64::from(pixels)).clamp(0.0, left_over.max(0.0)),
                None => 0.5 * left_over,
            };
            // Aligned to whole pixels if possible.
            if step == 1.0 { edge.floor() } else { edge }
        };
        let framed = Crop {
            left_px: edge(whole_width, width, aim.at_px.map(|at| at.x)),
            top_px: edge(whole_height, height, aim.at_px.map(|at| at.y)),
            step,
        };
        let v = across / (step * f64::from(width));
        Ok(Self {
            film,
            focal_length_m: focal_length_m.unwrap_or_else(|| ThinLens::focal_length_behind_m(v, focus_distance_m)),
            focus_distance_m,
            framed,
            later_s: aim
                .at_px
                .map_or(0.0, |_| whole.row_time_s(framed.source_px(DVec2::new(0.0, 0.5 * f64::from(height))).y)),
            geometry: framed.geometry(whole, width, height, film.width_mm()),
        })
    }

    /// Width and height, px.
    pub fn size(&self) -> (u32, u32) {
        (self.geometry.intrinsics.width_px, self.geometry.intrinsics.height_px)
    }

    /// Pixels of the photograph per pixel of the recording.
    pub fn enlargement(&self) -> f64 {
        1.0 / self.framed.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};

    fn close(actual: f64, expected: f64, within: f64) {
        assert!((actual - expected).abs() <= within, "{actual} is not {expected}");
    }

    /// 640×480 with fx 525, film 36 mm: v = 525 · 36 / 640 = 29.53125 mm.
    fn whole() -> Geometry {
        Geometry::new(Intrinsics::default(), Distortion::default())
    }

    #[test]
    fn default_framing_is_the_recorded_picture() {
        let framing = Framing::new(&whole(), None, None, f64::INFINITY, None).unwrap();
        assert_eq!(framing.geometry, whole());
        assert!(framing.framed.is_exact());
        close(framing.focal_length_m, 0.029_531_25, 1e-12);
        // Focused at 1 m, a shorter lens has the same image distance: 29.53125 / 1.02953125.
        let near = Framing::new(&whole(), None, None, 1.0, None).unwrap();
        close(near.focal_length_m, 0.028_684_17, 1e-8);
        assert_eq!(near.geometry, whole());
    }

    #[test]
    fn framing_by_lens_and_film_matches_hand_calculation() {
        // 36×24 of a 4:3 picture is 640 × 426.67.
        let film: Film = "36x24".parse().unwrap();
        let full = Framing::new(&whole(), Some(film), None, f64::INFINITY, None).unwrap();
        assert_eq!((full.size(), full.framed.top_px), ((640, 427), 26.0));
        // 59.0625 mm is twice 29.53125: half of the columns.
        let tele = Framing::new(&whole(), Some(film), Some(0.059_062_5), f64::INFINITY, Some(960)).unwrap();
        close(tele.enlargement(), 3.0, 1e-9);
        assert_eq!(tele.size(), (960, 640));
        close(tele.framed.left_px, 160.0, 1e-9);
        close(tele.geometry.intrinsics.fx_px, 1575.0, 1e-6);
        // At 1 m the image distance is 59.0625 / 0.9409375 = 62.770 mm: 301.1 columns.
        let near = Framing::new(&whole(), Some(film), Some(0.059_062_5), 1.0, None).unwrap();
        close(near.framed.step * f64::from(near.size().0), 301.1, 1e-6);
        // A smaller film behind the same lens sees less.
        let small = Framing::new(&whole(), Some("aps-c".parse().unwrap()), Some(0.05), f64::INFINITY, None).unwrap();
        close(small.framed.step * f64::from(small.size().0), 525.0 * 23.6 / 50.0, 1e-9);
    }

    #[test]
    fn aimed_framing_matches_hand_calculation() {
        let aimed = |at: [f64; 2], around: [f64; 2]| {
            let aim = Aim { at_px: Some(at.into()), around_px: Some(around.into()) };
            Framing::aimed(&whole(), None, None, f64::INFINITY, None, aim).unwrap()
        };
        // 160 of 640 columns and 120 of 480 rows around (400, 100), starting at (320, 40), pixel on
        // pixel.
        let part = aimed([400.0, 100.0], [160.0, 90.0]);
        assert_eq!((part.size(), part.framed), ((160, 120), Crop { left_px: 320.0, top_px: 40.0, step: 1.0 }));
        // Seeing a quarter needs a lens four times as long.
        close(part.focal_length_m, 4.0 * 0.029_531_25, 1e-12);
        // Rows from 40 to 160 have their middle at 100, 140 above that of the whole.
        close(part.later_s, -140.0 / 480.0 * whole().intrinsics.readout_time_s, 1e-15);
        // Something tall: as many columns as 4:3 needs. At the corner nothing beyond the picture is
        // seen.
        let part = aimed([639.0, 479.0], [10.0, 120.0]);
        assert_eq!((part.size(), part.framed), ((160, 120), Crop { left_px: 480.0, top_px: 360.0, step: 1.0 }));
        let all = aimed([0.0, 0.0], [640.0, 10.0]);
        assert_eq!((all.framed.left_px, all.framed.top_px), (0.0, 0.0));
        for wrong in [641.0, 0.5, f64::NAN] {
            let aim = Aim { around_px: Some(DVec2::new(wrong, 0.0)), ..Aim::default() };
            let error = Framing::aimed(&whole(), None, None, 1.0, None, aim).unwrap_err().to_string();
            assert!(error.contains("covers 640 px"), "{error}");
        }
    }

    #[test]
    fn impossible_framing_is_refused_with_the_accepted_range() {
        let film = Some("36x24".parse().unwrap());
        let error = Framing::new(&whole(), film, Some(0.020), f64::INFINITY, None).unwrap_err().to_string();
        assert!(error.contains("20.0 mm") && error.contains("29.54 mm or more"), "{error}");
        assert!(Framing::new(&whole(), film, Some(0.029_54), f64::INFINITY, None).is_ok());
        let error = Framing::new(&whole(), film, Some(0.05), 0.04, None).unwrap_err().to_string();
        assert!(error.contains("within the focal length"), "{error}");
        assert!(Framing::new(&whole(), film, None, 1.0, Some(5)).is_err());
    }
}
