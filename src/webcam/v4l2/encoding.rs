//! The Y'CbCr encoding of a camera's pictures: the driver's `ycbcr_enc`, else the default of its
//! colour space.
//!
//! The kernel's videodev2.h has the numbers and the defaults (V4L2_YCBCR_ENC_*,
//! V4L2_MAP_YCBCR_ENC_DEFAULT). Not modelled: SMPTE 240M, whose matrix is that of BT.709 within
//! 0.015, and constant luminance of BT.2020.

use v4l::Device;
use v4l::buffer::Type;
use v4l::format::Colorspace;
use v4l::v4l_sys::v4l2_format;
use v4l::v4l2::{ioctl, vidioc::VIDIOC_G_FMT};

use crate::coding::ColorMatrix;

/// `ycbcr_enc` of a format that leaves it to its colour space.
pub const DEFAULT: u32 = 0;

/// Reads `ycbcr_enc` of the current format, which the `v4l` crate drops.
#[expect(unsafe_code, reason = "no safe interface of the driver has this field")]
pub fn stated(device: &Device) -> std::io::Result<u32> {
    // SAFETY: `v4l2_format` is plain data of C, valid as zeros. The ioctl writes one of it, which
    // outlives the call. For a format of a capture device `pix` is the member in use, and each
    // member of its union is the same u32.
    unsafe {
        let mut format: v4l2_format = std::mem::zeroed();
        format.type_ = Type::VideoCapture as u32;
        ioctl(device.handle().fd(), VIDIOC_G_FMT, (&raw mut format).cast())?;
        Ok(format.fmt.pix.__bindgen_anon_1.ycbcr_enc)
    }
}

/// The matrix of an encoding.
pub fn matrix(ycbcr_enc: u32, colorspace: Colorspace) -> ColorMatrix {
    match (ycbcr_enc, colorspace) {
        // 601, xvYCC 601, sYCC
        (1 | 3 | 5, _) => ColorMatrix::Bt601,
        // 709, xvYCC 709, SMPTE 240M
        (2 | 4 | 8, _) => ColorMatrix::Bt709,
        // BT.2020 without and with constant luminance
        (6 | 7, _) => ColorMatrix::Bt2020,
        (_, Colorspace::Rec709 | Colorspace::DCIP3 | Colorspace::SMPTE240M) => ColorMatrix::Bt709,
        (_, Colorspace::Rec2020) => ColorMatrix::Bt2020,
        _ => ColorMatrix::Bt601,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stated_encoding_precedes_the_default_of_the_colorspace() {
        for (ycbcr_enc, colorspace, expected) in [
            (DEFAULT, Colorspace::SRGB, ColorMatrix::Bt601),
            (DEFAULT, Colorspace::Rec709, ColorMatrix::Bt709),
            (DEFAULT, Colorspace::Rec2020, ColorMatrix::Bt2020),
            (DEFAULT, Colorspace::SMPTE240M, ColorMatrix::Bt709),
            (2, Colorspace::SRGB, ColorMatrix::Bt709),
            (1, Colorspace::Rec709, ColorMatrix::Bt601),
            (6, Colorspace::SRGB, ColorMatrix::Bt2020),
            // A number of a later kernel
            (99, Colorspace::Rec709, ColorMatrix::Bt709),
        ] {
            assert_eq!(matrix(ycbcr_enc, colorspace), expected, "{ycbcr_enc} {colorspace}");
        }
    }
}
