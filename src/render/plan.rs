//! The drawings of a frame, and their result.

use crate::gpu::Texture;

/// One drawing of the scene in a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    pub weight: f32,
    /// Relative to the middle of each row's exposure, seconds.
    pub time_s: f64,
    /// Point of the aperture that is looked through, metres from its middle along the picture's axes.
    pub lens_m: [f64; 2],
    /// Shift of each object, px (raster axes); empty for none.
    pub offsets_px: Vec<[f32; 2]>,
}

/// The drawings that the renderer sums. The weights sum to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePlan {
    pub samples: Vec<Sample>,
    /// The distance at which all points of the aperture see the same, metres; up to infinity.
    pub focus_distance_m: f64,
}

impl Sample {
    /// A plain drawing of this weight.
    pub fn plain(weight: f32) -> Self {
        Self { weight, time_s: 0.0, lens_m: [0.0; 2], offsets_px: Vec::new() }
    }
}

impl SamplePlan {
    /// One plain drawing at the middle of the exposure.
    pub fn single() -> Self {
        Self { samples: vec![Sample::plain(1.0)], focus_distance_m: f64::INFINITY }
    }
}

/// The virtual layer on the GPU: premultiplied linear colour, and the geometry (depth and velocity, packed as in
/// shaders/shared/layer.wgsl) of the nearest sample. Only the upper left `size` is in use.
///
/// Alpha is how much of a pixel is covered. Where it is 0 there is no geometry and, unless [`Layer::light_alone`] is
/// set, no light. A pixel without coverage and light is untouched: the composite leaves it to the camera. Without
/// `light_alone`, light that rounding leaves where nothing is covered is dropped. An effect that spreads light spreads
/// coverage with it, unless it is a glow, which covers nothing. Where coverage is spread, so is the geometry, if
/// anything reads it.
#[derive(Clone, Debug)]
pub struct Layer {
    pub color: Texture,
    pub geometry: Texture,
    pub size: (u32, u32),
    /// Coverage of red, green and blue, if they differ; alpha is then their mean by luminance.
    pub coverage: Option<Texture>,
    /// Whether there may be light where nothing is covered: a glow, which is added to the camera's light.
    pub light_alone: bool,
    /// The real part, if effects act on it too.
    pub real: Option<RealLayer>,
    /// Added to the camera's light where the layer covers it: of pixels at the edge of a nearer real thing, by how much the
    /// light differs from what lies behind the thing.
    pub fringe: Option<Texture>,
}

impl Layer {
    /// A layer with nothing else.
    pub fn new(color: Texture, geometry: Texture, size: (u32, u32)) -> Self {
        Self { color, geometry, size, coverage: None, light_alone: false, real: None, fringe: None }
    }
}

/// The real part of a photograph in the layer's area.
#[derive(Clone, Debug)]
pub struct RealLayer {
    /// Linear light. A: 1 where it is as recorded, otherwise the share of its noise's σ that is left.
    pub light: Texture,
    /// The light from behind the nearest surface, reconstructed.
    pub behind: Texture,
    /// Depths of both, metres: 32-bit floats as two words each.
    pub depths: Texture,
    /// How much nearer a real surface must be to hide an object, metres. `None`: nothing is hidden.
    pub tolerance_m: Option<f32>,
    /// Nearest and farthest depth (including behind) in squares of [`RealLayer::SIDE_PX`], metres, row by row.
    pub ranges_m: Vec<[f32; 2]>,
}

impl RealLayer {
    /// Side of the squares of `ranges_m`, px.
    pub const SIDE_PX: u32 = 64;
}
