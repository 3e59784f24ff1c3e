//! Still pictures, distinguished by content (still_format.rs). Pixels come as stored: no colour
//! profile, gamma or rotation is applied, and transparency is dropped. Pictures of linear light are
//! encoded (scene_linear.rs).

use std::io::{BufReader, Read};
use std::path::Path;

use image::DynamicImage;

pub(crate) use super::still_decoder::bare_png;
pub use super::still_decoder::decode_pixels;
pub use super::still_format::PictureHeader;

use super::still_decoder::{self as decoder, decode, no_picture, png_end};
use super::still_format::StillFormat;
use super::{SourceError, developed, file as plain, jpeg, jpeg_tables, scene_linear, unsupported};
use crate::pixels::{DepthMap, Pixels};
use crate::program::ProgramError;

/// True if an error of [`read_header`] is about the file's content (another kind of file, damage,
/// or a Git LFS pointer file), not about access to it.
pub fn is_no_picture(error: &SourceError) -> bool {
    match error {
        SourceError::Read { source, .. } => plain::is_lfs_pointer(source),
        SourceError::Content { .. } => true,
        // A missing program is no fault of the file.
        SourceError::Undeveloped { source, .. } => matches!(source, ProgramError::Failed { .. }),
        _ => false,
    }
}

/// True if a file is a JPEG by its content.
pub fn is_jpeg(file: &Path) -> Result<bool, SourceError> {
    Ok(StillFormat::of_file(file)? == Some(StillFormat::Jpeg))
}

/// The format of a picture's file. Files of another kind are refused.
fn format_of(file: &Path) -> Result<StillFormat, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    if let Some(format) = StillFormat::of_file(file)? {
        if format == StillFormat::Exr && scene_linear::is_dwa(BufReader::new(plain::open(file).map_err(failed)?)) {
            return Ok(StillFormat::DwaExr);
        }
        return Ok(format);
    }
    let mut start = Vec::new();
    plain::open(file).map_err(failed)?.take(16).read_to_end(&mut start).map_err(failed)?;
    let kind = unsupported::by_content(&start).or_else(|| unsupported::by_name(file));
    Err(SourceError::content(file, kind.map_or_else(no_picture, unsupported::UnsupportedKind::refusal)))
}

/// Reads only the part of the file that contains the header, except for pictures that another
/// program has to develop first.
pub fn read_header(file: &Path) -> Result<PictureHeader, SourceError> {
    let format = format_of(file)?;
    if format.is_developed() {
        return developed::read_header(file, format);
    }
    decoder::read_header(file, format)
}

/// The picture in a file. A truncated file is an error.
pub fn read_pixels(file: &Path) -> Result<Pixels, SourceError> {
    let format = format_of(file)?;
    if format.is_developed() {
        return developed::read_pixels(file, format);
    }
    decoder::read_pixels(file, format)
}

/// The depth in a 16-bit grey PNG, TIFF or PGM: value / `codes_per_metre`, 0 where nothing was
/// measured.
pub fn read_depth(file: &Path, codes_per_metre: f64, timestamp_s: f64) -> Result<DepthMap, SourceError> {
    let format = format_of(file)?;
    let picture =
        decode(&decoder::read(file, format)?, format).map_err(|problem| SourceError::content(file, problem))?;
    let DynamicImage::ImageLuma16(grey) = picture else {
        let problem = format!("holds {:?} pixels; depth must be a 16-bit grey picture", picture.color());
        return Err(SourceError::content(file, problem));
    };
    let (width, height) = grey.dimensions();
    let depth_m = grey.into_raw().into_iter().map(|code| (f64::from(code) / codes_per_metre) as f32).collect();
    Ok(DepthMap { width, height, depth_m, timestamp_s })
}

/// Checks that a picture's file is complete. The pixels of PNG and JPEG are not decoded for this.
pub fn check_end(file: &Path) -> Result<(), SourceError> {
    let end = match format_of(file)? {
        StillFormat::Png => png_end(&read(file)?),
        StillFormat::Jpeg => jpeg::check(&jpeg_tables::with_tables(&read(file)?)).map(drop),
        _ => return read_pixels(file).map(drop),
    };
    end.map_err(|problem| SourceError::content(file, problem))
}

/// A picture's file, limited to the size that such a picture can have.
pub fn read(file: &Path) -> Result<Vec<u8>, SourceError> {
    decoder::read(file, format_of(file)?)
}

#[cfg(test)]
mod tests;
