//! Intrinsic parameters of the pinhole model.

crate::params! {
    /// Size of the picture, focal lengths and principal point in pixels, film width, readout.
    pub struct Intrinsics in "camera" at Depth {
        "width of the picture" width_px: u32 = 640, "px", 1.0..=65536.0;
        "height of the picture" height_px: u32 = 480, "px", 1.0..=65536.0;
        "focal length in pixel widths" fx_px as "Focal length, x": f64 = 525.0, "px", 1e-3..=1e7, by_ratio;
        "focal length in pixel heights" fy_px as "Focal length, y": f64 = 525.0, "px", 1e-3..=1e7, by_ratio;
        "principal point from the left edge; pixel centres at +0.5" cx_px as "Principal point, x": f64 = 320.0, "px", -1e6..=1e6;
        "principal point from the upper edge; pixel centres at +0.5" cy_px as "Principal point, y": f64 = 240.0, "px", -1e6..=1e6;
        "width of the film or sensor" film_width_mm: f64 = 36.0, "mm", 0.1..=1000.0, by_ratio;
        "from the first row's exposure to the last row's, top to bottom; 0 is a global shutter" readout_time_s: f64 = 0.0, "s", 0.0..=1.0, by_ratio;
    }
}
