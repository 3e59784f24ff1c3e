//! Takes changed pixels through the format of the camera's picture: chroma at the file's
//! resolution, quantised blocks, and the arithmetic of the decoder (coding/).
//!
//! Every real pixel came that way. Pixels that did not differ from it by their chroma, by the
//! spectrum of their blocks and by codes that cannot occur. It runs after all other effects,
//! over the mixed codes before they are rounded or clipped. Passes: compositor/coded.rs.
//!
//! Not modelled: prediction between blocks and frames of video.

use super::{Effect, FrameContext};
use crate::coding::PictureCoding;

crate::params! {
    /// Parameters of the format.
    pub struct FrameFormat in "format" at Mix {
        "quantise blocks as the frame's file does; off: only its resolution of chroma and rounding"
        quantization: bool = true;
    }
}

impl Effect for FrameFormat {
    fn summary(&self) -> &'static str {
        "codes virtual pixels as the frame's file codes the camera's"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        context.capture.whole || context.coding.is_none()
    }
    fn coding(&self, context: &FrameContext<'_>) -> Option<PictureCoding> {
        let coding = context.coding?.clone();
        let quantization = coding.quantization.filter(|_| self.quantization);
        Some(PictureCoding { quantization, ..coding })
    }
    fn neutral_hint(&self) -> &'static str {
        "the frames' format is not known: they are neither JPEG nor 8-bit video, or were scaled or turned since; recording \
         the camera's own files enables it"
    }
}
