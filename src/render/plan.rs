//! What is drawn, and what comes of it.

use crate::gpu::Texture;

/// One drawing of the scene in a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    pub weight: f32,
    /// Relative to the middle of each row's exposure, seconds.
    pub time_s: f64,
    /// Point on the aperture through which is looked, metres from its middle along the picture's axes.
    pub lens_m: [f64; 2],
    /// Shift of each object, px (raster axes); empty for none.
    pub offsets_px: Vec<[f32; 2]>,
}

/// What the renderer draws and sums. The weights sum to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct SamplePlan {
    pub samples: Vec<Sample>,
    /// What all points of the aperture see at the same place, metres; up to infinity.
    pub focus_distance_m: f64,
}

impl Sample {
    /// A plain drawing of this weight.
    pub fn plain(weight: f32) -> Self {
        Self { weight, time_s: 0.0, lens_m: [0.0; 2], offsets_px: Vec::new() }
    }
}

impl SamplePlan {
    /// One plain rendering at the middle of the exposure.
    pub fn single() -> Self {
        Self { samples: vec![Sample::plain(1.0)], focus_distance_m: f64::INFINITY }
    }
}

/// The virtual layer on the GPU: premultiplied linear colour, and the geometry (depth and
/// velocity, packed as in shaders/shared/layer.wgsl) of the nearest sample. Only the upper left `size` is in use.
///
/// What a pixel's colour says: A is how much of it is covered; where A is 0 there is no geometry, and no light either
/// but where [`Layer::light_alone`] says that there may be some. A pixel of which neither is there is untouched: the
/// composite leaves it to the camera. Else what light rounding leaves where nothing is covered is dropped. An
/// effect that spreads light spreads coverage with it, unless it is a glow, which covers nothing; where coverage is
/// spread the geometry goes with it, if that is read.
#[derive(Clone, Debug)]
pub struct Layer {
    pub color: Texture,
    pub geometry: Texture,
    pub size: (u32, u32),
    /// How much of red, green and blue is covered, where they differ; A is then their mean by luminance.
    pub coverage: Option<Texture>,
    /// Whether there is light where nothing is covered: a glow, which is added to the camera's.
    pub light_alone: bool,
    /// Where effects act on the real part too.
    pub real: Option<RealLayer>,
}

impl Layer {
    /// A layer without more.
    pub fn new(color: Texture, geometry: Texture, size: (u32, u32)) -> Self {
        Self { color, geometry, size, coverage: None, light_alone: false, real: None }
    }
}

/// The real part of a photograph where the layer is.
#[derive(Clone, Debug)]
pub struct RealLayer {
    /// Linear light; A: 1 where it is as it was recorded, else the share of its noise's σ that is left.
    pub light: Texture,
    /// What stands behind the nearest surface, made up.
    pub behind: Texture,
    /// Depths of both, metres: 32-bit floats in two words each.
    pub depths: Texture,
    /// How much nearer a real surface must be to hide an object, metres; none: nothing is hidden.
    pub tolerance_m: Option<f32>,
    /// Nearest and farthest depth (behind it) in squares of [`RealLayer::SIDE_PX`], metres, row by row.
    pub ranges_m: Vec<[f32; 2]>,
}

impl RealLayer {
    /// Side of the squares whose depths are told, px.
    pub const SIDE_PX: u32 = 64;
}
