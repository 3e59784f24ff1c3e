//! WGSL sources, embedded, and their one-line import.
//!
//! A line `// @import shared/hash` is replaced by that file's text, once per module. Development
//! builds read the files themselves, so that an edit takes effect without a rebuild.

use std::borrow::Cow;

use crate::assets;

/// Lists the files below shaders/.
macro_rules! shaders {
    ($($(#[$meta:meta])* $variant:ident = $name:literal),* $(,)?) => {
        /// A file below shaders/.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Shader { $($(#[$meta])* $variant),* }

        impl Shader {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$variant),*];

            /// Its path below shaders/, without `.wgsl`.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }

            fn embedded(self) -> &'static str {
                match self { $(Self::$variant => include_str!(concat!("../../shaders/", $name, ".wgsl"))),* }
            }
        }
    };
}

shaders! {
    Fullscreen = "shared/fullscreen",
    Half = "shared/half",
    Hash = "shared/hash",
    SharedCoding = "shared/coding",
    SharedHighlights = "shared/highlights",
    SharedLayer = "shared/layer",
    SharedLens = "shared/lens",
    SharedLensTable = "shared/lens_table",
    SharedMixed = "shared/mixed",
    SharedNoise = "shared/noise",
    SharedExampleNoise = "shared/example_noise",
    SharedNoiseOverlay = "shared/noise_overlay",
    SharedNoiseSpeed = "shared/noise_speed",
    Response = "shared/response",
    SharedShadowRatio = "shared/shadow_ratio",
    SharedSrgb = "shared/srgb",
    SharedSurfaceShading = "shared/surface_shading",
    Accumulate = "accumulate",
    Accumulated = "accumulated",
    Around = "around",
    Blur = "blur",
    ChromaticAberration = "chromatic_aberration",
    Clipped = "clipped",
    CodingBlocks = "coding_blocks",
    CodingChroma = "coding_chroma",
    CodingDecode = "coding_decode",
    Composite = "composite",
    CompositeRecorded = "composite_recorded",
    CompositeReal = "composite_real",
    Copy = "copy",
    DepthOfField = "depth_of_field",
    DepthOfFieldDiffusion = "depth_of_field_diffusion",
    DepthOfFieldHighlights = "depth_of_field_highlights",
    DepthOfFieldPoisson = "depth_of_field_poisson",
    DepthOfFieldPyramid = "depth_of_field_pyramid",
    DepthOfFieldSlices = "depth_of_field_slices",
    DepthOfFieldSurroundings = "depth_of_field_surroundings",
    DepthOfFieldTiles = "depth_of_field_tiles",
    EdgeBlend = "edge_blend",
    Exposure = "exposure",
    ForegroundMatte = "foreground_matte",
    Halation = "halation",
    MotionBlur = "motion_blur",
    MotionBlurTiles = "motion_blur_tiles",
    Noise = "noise",
    NoiseContent = "noise_content",
    ExampleNoise = "example_noise",
    NoiseGrain = "noise_grain",
    NoisePattern = "noise_pattern",
    NoisePlanes = "noise_planes",
    NoiseSources = "noise_sources",
    NoiseWhite = "noise_white",
    Raster = "raster",
    RealPart = "real_part",
    Resolve = "resolve",
    ShadowMask = "shadow_mask",
    Show = "show",
    SpreadGeometry = "spread_geometry",
    Vignetting = "vignetting",
    Window = "window",
}

impl Shader {
    /// The file's text, without its imports.
    pub fn text(self) -> Cow<'static, str> {
        if cfg!(development) {
            let file = assets::source_folder().join("shaders").join(self.name()).with_extension("wgsl");
            // Missing if the program runs outside its build folder.
            if let Ok(text) = std::fs::read_to_string(file) {
                return text.into();
            }
        }
        self.embedded().into()
    }

    /// # Panics
    /// If an import names no file: a programming error that the shader test finds.
    fn named(name: &str) -> Self {
        *Self::ALL.iter().find(|s| s.name() == name).unwrap_or_else(|| panic!("no shader is called {name}"))
    }

    /// The text with its imports.
    pub fn module(self) -> String {
        module(&[self])
    }
}

/// The texts of several files as one module, each with its imports, without duplicates.
pub fn module(shaders: &[Shader]) -> String {
    let (mut included, mut out) = (Vec::new(), String::new());
    shaders.iter().for_each(|shader| append(*shader, &mut included, &mut out));
    out
}

fn append(shader: Shader, included: &mut Vec<Shader>, out: &mut String) {
    if included.contains(&shader) {
        return;
    }
    included.push(shader);
    for line in shader.text().lines() {
        match line.trim().strip_prefix("// @import ") {
            Some(name) => append(Shader::named(name), included, out),
            None => {
                out.push_str(line);
                out.push('\n');
            }
        }
    }
}

/// The value of `const NAME` in a WGSL text, for comparison with Rust in tests.
#[cfg(test)]
pub fn constant(wgsl: &str, name: &str) -> f64 {
    let line = wgsl.lines().find_map(|l| l.strip_prefix("const ")?.strip_prefix(name)?.strip_prefix(": ")).expect(name);
    let (_, value) = line.split_once("= ").expect(name);
    value.trim_end_matches(['u', ';']).parse().expect(name)
}
