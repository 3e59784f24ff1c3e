//! The samples of a frame, and the resulting layer.

use crate::gpu::Texture;

/// One rendered sample in a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSample {
    pub weight: f32,
    /// Relative to the middle of each row's exposure, seconds.
    pub time_s: f64,
    /// Point on the aperture, metres from its centre along the picture's axes.
    pub lens_m: [f64; 2],
    /// Shift of each object, px (raster axes); empty for none.
    pub offsets_px: Vec<[f32; 2]>,
}

/// The samples that the renderer sums. The weights sum to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePlan {
    pub samples: Vec<RenderSample>,
    /// Focus distance, metres; up to infinity.
    pub focus_distance_m: f64,
}

impl RenderSample {
    /// A sample of this weight without offsets.
    pub fn plain(weight: f32) -> Self {
        Self { weight, time_s: 0.0, lens_m: [0.0; 2], offsets_px: Vec::new() }
    }
}

impl SamplePlan {
    /// One sample at the middle of the exposure.
    pub fn single() -> Self {
        Self { samples: vec![RenderSample::plain(1.0)], focus_distance_m: f64::INFINITY }
    }
}

/// The virtual layer on the GPU: premultiplied linear colour, and the geometry (depth and velocity,
/// packed as in shaders/shared/layer.wgsl) of the nearest sample. Only the upper left `size` is in
/// use.
///
/// Alpha is the coverage of a pixel. Where it is 0 there is no geometry and, unless
/// [`Layer::light_alone`] is set, no light. Pixels without coverage and light are left to the
/// camera's picture unchanged. Without `light_alone`, residual light from rounding at zero coverage
/// is dropped. An effect that spreads light spreads coverage with it, unless it is a glow, which
/// covers nothing. Where coverage is spread, so is the geometry, if anything reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    pub color: Texture,
    pub geometry: Texture,
    pub size: (u32, u32),
    /// Coverage of red, green and blue, if they differ; alpha is then their mean by luminance.
    pub coverage: Option<Texture>,
    /// True if uncovered pixels may have light: a glow, which is added to the camera's light.
    pub light_alone: bool,
    /// The real part, if effects apply to it as well.
    pub real: Option<RealLayer>,
    /// Added to the camera's light where the layer covers it: at edge pixels of a nearer real
    /// object, the difference of their light to that of the background behind the object.
    pub fringe: Option<Texture>,
}

impl Layer {
    /// A layer without optional parts.
    pub fn new(color: Texture, geometry: Texture, size: (u32, u32)) -> Self {
        Self { color, geometry, size, coverage: None, light_alone: false, real: None, fringe: None }
    }
}

/// The real part of a photograph in the layer's area.
#[derive(Clone, Debug, PartialEq)]
pub struct RealLayer {
    /// Linear light. A: 1 if unchanged, otherwise the remaining share of the noise σ.
    pub light: Texture,
    /// Reconstructed light of the background behind the nearest surface.
    pub behind: Texture,
    /// Depths of both, metres: 32-bit floats as two words each.
    pub depths: Texture,
    /// Depth margin by which a real surface must be nearer to occlude an object, metres. `None`: no
    /// occlusion.
    pub tolerance_m: Option<f32>,
    /// Minimum and maximum depth (background included) in squares of [`RealLayer::SIDE_PX`],
    /// metres, row by row.
    pub ranges_m: Vec<[f32; 2]>,
}

impl RealLayer {
    /// Side of the squares of `ranges_m`, px.
    pub const SIDE_PX: u32 = 64;
}
