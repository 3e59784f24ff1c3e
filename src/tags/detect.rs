//! Detection of tags in a picture.

use glam::DVec2;
use kornia_apriltag::errors::AprilTagError;
use kornia_apriltag::{AprilTagDecoder, DecodeTagsConfig};
use kornia_image::{Image, ImageSize};

use super::board::Board;
use super::family::Family;
use super::luma_codes::LumaCodes;

/// A detected tag.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectedTag {
    pub id: u32,
    /// Corners of the black square in the printed order: top left, top right, bottom right, bottom
    /// left. Px, pixel centres at +0.5.
    pub corners_px: [DVec2; 4],
}

/// The detected tags of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetectedTags {
    /// Tags that are detected once, by id.
    pub tags: Vec<DetectedTag>,
    /// Ids that are detected several times, ascending: they are ambiguous.
    pub repeated: Vec<u32>,
}

/// Reason why tags cannot be detected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("tags cannot be searched for in a picture of {width}x{height} px: {problem}")]
pub struct DetectError {
    width: usize,
    height: usize,
    problem: String,
}

impl DetectError {
    pub(super) fn new(width: u32, height: u32, problem: &str) -> Self {
        Self { width: width as usize, height: height as usize, problem: problem.to_owned() }
    }
}

/// Detector of one tag family in pictures of one size.
pub struct Detector {
    /// Decoder at half the resolution, four times as fast; corners are refined at full resolution.
    half: AprilTagDecoder,
    whole: AprilTagDecoder,
    size: (usize, usize),
}

impl Detector {
    pub fn new(family: Family, width: u32, height: u32) -> Result<Self, DetectError> {
        let size @ (width, height) = (width as usize, height as usize);
        let decoder = |reduced: usize| {
            let mut config = DecodeTagsConfig::new(vec![family.decoder_family()?])?;
            config.min_tag_width = config.min_tag_width * config.downscale_factor / reduced;
            config.downscale_factor = reduced;
            AprilTagDecoder::new(config, ImageSize { width, height })
        };
        let failed = |error: AprilTagError| DetectError { width, height, problem: error.to_string() };
        Ok(Self { half: decoder(2).map_err(failed)?, whole: decoder(1).map_err(failed)?, size })
    }

    /// Detects the tags of a picture. If fewer than `enough` expected ones are found at half the
    /// resolution, small tags are detected at full resolution as well.
    pub fn find(
        &mut self,
        grey: &LumaCodes,
        enough: usize,
        is_expected: impl Fn(u32) -> bool,
    ) -> Result<DetectedTags, DetectError> {
        let (width, height) = self.size;
        let failed = |problem: String| DetectError { width, height, problem };
        let image = Image::<u8, 1>::from_size_slice(ImageSize { width, height }, &grey.codes.values)
            .map_err(|error| failed(error.to_string()))?;
        let detection = sought(&mut self.half, &image).map_err(|error| failed(error.to_string()))?;
        if detection.tags.iter().filter(|tag| is_expected(tag.id)).count() >= enough.max(1) {
            return Ok(detection);
        }
        sought(&mut self.whole, &image).map_err(|error| failed(error.to_string()))
    }

    /// Detects the tags of a picture; half of a board's are enough.
    pub fn find_board(&mut self, grey: &LumaCodes, board: &Board) -> Result<DetectedTags, DetectError> {
        self.find(grey, board.tags.len().div_ceil(2), |id| board.tag(id).is_some())
    }
}

fn sought(decoder: &mut AprilTagDecoder, image: &Image<u8, 1>) -> Result<DetectedTags, AprilTagError> {
    let decoded = decoder.decode(image)?;
    decoder.clear();
    let detected = decoded.iter().map(|tag| {
        // Only the quadrilateral's homography has the printed orientation; its y axis points down.
        let corner = |x, y| tag.quad.homography_project(x, y);
        let corners_px = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]
            .map(|at| DVec2::new(at.x.into(), at.y.into()));
        DetectedTag { id: tag.id.into(), corners_px }
    });
    let mut tags: Vec<DetectedTag> =
        detected.filter(|tag| tag.corners_px.iter().all(|corner| corner.is_finite())).collect();
    tags.sort_by_key(|tag| tag.id);
    let same = tags.windows(2).filter(|pair| pair[0].id == pair[1].id);
    let mut repeated: Vec<u32> = same.map(|pair| pair[0].id).collect();
    repeated.dedup();
    tags.retain(|tag| !repeated.contains(&tag.id));
    Ok(DetectedTags { tags, repeated })
}
