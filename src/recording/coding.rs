//! Coding of a recording's pictures: stated by their files, or estimated for PNG files that were
//! JPEGs, from frames spread over the recording.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::Recording;
use super::parts::Pictures;
use crate::coding::PictureCoding;
use crate::coding::estimate::estimate;
use crate::parallel;
use crate::source::still_format::StillFormat;
use crate::source::{SourceError, jpeg_header, still};

/// An estimate that is made at its first use. Clones share it. No memo: a recording's pictures do
/// not change, so that it has no key.
pub(super) type CodingEstimate = Arc<OnceLock<Option<Arc<PictureCoding>>>>;

impl Recording {
    /// The coding of the frames' pictures before they were saved as PNG. `None` for files that hold
    /// their coding, for 16 bits, and if the first, middle and last frame are not all estimated
    /// alike ([`crate::coding::estimate`]).
    ///
    /// The first call decodes up to three frames, in 0.1 s (no JPEG) to 0.6 s for 640×480 px; later
    /// calls, also of clones, return its result.
    pub fn estimated_coding(&self) -> Option<Arc<PictureCoding>> {
        self.estimated_coding.get_or_init(|| self.estimate_coding().map(Arc::new)).clone()
    }

    /// The format of the pictures, as the video or the first frame's header states it, for a
    /// message. Pixels are not decoded.
    pub fn stored_format(&self) -> Result<String, SourceError> {
        let (kind, coding) = match &*self.pictures {
            Pictures::Video(video, _) => ("video", video.coding.as_deref().cloned().ok_or_else(String::new)),
            Pictures::Stills(files) => match files.first() {
                Some(file) if still::is_jpeg(file)? => ("JPEG", jpeg_header::coding(&still::read(file)?)),
                Some(file) => (StillFormat::of_file(file)?.map_or("none", StillFormat::name), Err(String::new())),
                None => ("none", Err(String::new())),
            },
        };
        Ok(match coding {
            Ok(coding) => format!("{kind}, {coding}"),
            Err(reason) if reason.is_empty() => kind.to_owned(),
            Err(reason) => format!("{kind}, {reason}"),
        })
    }

    fn estimate_coding(&self) -> Option<PictureCoding> {
        let files: Vec<&Path> = self.stills().collect();
        let last = files.len().checked_sub(1).filter(|_| self.bits == 8)?;
        // Most PNG files never were JPEGs, which the first frame shows.
        let first = estimate_file(files[0])?;
        let others = [last / 2, last];
        let mut agrees = others.map(|index| index == 0);
        parallel::over_rows(&mut agrees, 1, others.len(), |n, agrees| {
            agrees[0] = agrees[0] || estimate_file(files[others[n]]).as_ref() == Some(&first);
        });
        agrees.iter().all(|agrees| *agrees).then_some(first)
    }
}

/// `None` also for unreadable files: the frame itself reports the error.
fn estimate_file(file: &Path) -> Option<PictureCoding> {
    // Other formats hold their coding, or another one than that of JPEG.
    if !matches!(
        StillFormat::of_file(file),
        Ok(Some(StillFormat::Png | StillFormat::Bmp | StillFormat::Pnm | StillFormat::Tiff))
    ) {
        return None;
    }
    let pixels = still::read_pixels(file).ok()?;
    let size = [pixels.width as usize, pixels.height as usize];
    Some(estimate(pixels.codes.eight_bit()?, size)?.coding)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::coding::ChromaSampling;
    use crate::recording::parts::{Parts, Pictures};
    use crate::recording::{OpenOptions, native};

    const SIZE: [u32; 2] = [208, 176];

    /// Waves with noise.
    fn scene(frame: u32) -> image::RgbImage {
        image::RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
            let mut hash = (x + SIZE[0] * (y + SIZE[1] * frame)).wrapping_mul(0x9e37_79b9);
            hash = (hash ^ hash >> 15).wrapping_mul(0x85eb_ca6b);
            let noise = |shift: u32| ((hash >> shift) % 21) as f32 - 10.0;
            let wave = 128.0 + 50.0 * (x as f32 * 0.09).sin() * (y as f32 * 0.05).cos();
            image::Rgb([5, 13, 21].map(|shift| (wave + 0.7 * noise(9) + 0.3 * noise(shift)) as u8))
        })
    }

    /// The picture after a JPEG file of a quality from 1 to 100.
    fn through_jpeg(picture: &image::RgbImage, quality: u8) -> image::RgbImage {
        let mut file = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality).encode_image(picture).unwrap();
        image::load_from_memory(&file).unwrap().into_rgb8()
    }

    /// A recording of five PNG files, each made of a JPEG of a quality, or not.
    fn recording(folder: &Path, quality: impl Fn(u32) -> Option<u8>) -> Recording {
        let save = |frame: u32| -> PathBuf {
            let file = folder.join(format!("{frame}.png"));
            let picture = scene(frame);
            quality(frame).map_or(picture.clone(), |quality| through_jpeg(&picture, quality)).save(&file).unwrap();
            file
        };
        let pictures = Pictures::Stills((0..5).map(save).collect());
        let times_s = (0..5).map(|frame| 0.1 * f64::from(frame)).collect();
        Parts::new(folder, pictures, times_s).assemble(&native::FORMAT, &OpenOptions::default()).unwrap()
    }

    #[test]
    fn frames_of_former_jpegs_are_composited_with_their_coding() {
        let folder = tempfile::tempdir().unwrap();
        let recording = recording(folder.path(), |_| Some(80));
        let plain = recording.frames(2..3).unwrap().next().unwrap().unwrap();
        assert!(plain.pixels.coding.is_none() && recording.estimated_coding.get().is_none(), "not estimated yet");

        let clone = recording.clone();
        let composited = recording.frames_with_neighbours(2..3).unwrap().next().unwrap().unwrap();
        let coding = composited.pixels.coding.clone().unwrap();
        assert_eq!(coding.chroma, Some(ChromaSampling::FULL));
        let quantization = coding.quantization.as_ref().unwrap();
        assert_eq!(quantization.origin, [0, 0]);
        // Annex K's first steps, 16, 11, 10, 16, at quality 80: times 0.4.
        assert_eq!(quantization.steps[0][..4], [6, 4, 4, 6]);
        assert!(Arc::ptr_eq(&coding, &clone.estimated_coding().unwrap()), "estimated once for all clones");
    }

    #[test]
    fn recordings_of_plain_files_and_of_different_jpegs_have_no_coding() {
        let folder = tempfile::tempdir().unwrap();
        let is_found = |quality: &dyn Fn(u32) -> Option<u8>| {
            let recording = recording(folder.path(), quality);
            let frame = recording.frames_with_neighbours(1..2).unwrap().next().unwrap().unwrap();
            assert_eq!(frame.pixels.coding, recording.estimated_coding());
            frame.pixels.coding.is_some()
        };
        assert!(!is_found(&|_| None), "never a JPEG");
        assert!(!is_found(&|frame| Some(if frame == 2 { 60 } else { 80 })), "the middle one has other tables");
        assert!(is_found(&|frame| (frame != 3).then_some(80)), "frame 3 is not examined");
    }

    /// The file's own coding stays, and a recording without frames has none.
    #[test]
    fn files_with_their_own_coding_are_not_estimated() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.jpg");
        scene(0).save(&file).unwrap();
        let parts = Parts::new(folder.path(), Pictures::Stills(vec![file]), vec![0.0]);
        let recording = parts.assemble(&native::FORMAT, &OpenOptions::default()).unwrap();
        assert_eq!(recording.estimated_coding(), None);
        let frame = recording.frames_with_neighbours(0..1).unwrap().next().unwrap().unwrap();
        assert!(frame.pixels.coding.is_some());
        assert_eq!(Recording::live("camera", 8, 8, 0.1, None).estimated_coding(), None);
    }
}
