//! Recordings as text. The reader of the native format reads back all numbers exactly.

use std::path::Path;

pub use super::camera_file::SensorPose;
pub use super::cameras::write_cameras as cameras;
pub use super::listing::{write_exposures as exposures, write_pictures as pictures};
pub use super::native::{
    CameraFile, CameraKind, DepthList, Description, ExposureList, FILE_NAME, FrameFiles, LiveMetadata, PoseFile,
};
pub use crate::tracking::covariance::{Covariance, write_covariances as covariances};
pub use crate::tracking::tum::{Line, write_trajectory as trajectory};

use super::{RecordingError, native};
use crate::document::TomlDocument;

/// A description as the text of a `recording.toml`. Returns the errors that the reader would
/// return.
pub fn description(description: Description) -> Result<TomlDocument<Description>, RecordingError> {
    let file = Path::new(FILE_NAME);
    let document = TomlDocument::new(description).map_err(|problem| RecordingError::content(file, problem))?;
    native::parse(&document.to_string(), file)?;
    Ok(document)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::{ColorMatrix, ColorRange};
    use proptest::prelude::*;

    fn number() -> impl Strategy<Value = f64> {
        any::<f64>().prop_map(f64::abs).prop_filter("finite and above 0", |n| n.is_finite() && *n > 0.0)
    }

    fn frames() -> impl Strategy<Value = FrameFiles> {
        let none = FrameFiles::default;
        prop_oneof![
            "\\PC{1,9}".prop_map(move |list| FrameFiles { list: Some(list.into()), ..none() }),
            ("\\PC{1,9}", number()).prop_map(move |(images, fps)| FrameFiles {
                images: Some(images.into()),
                fps: Some(fps),
                ..none()
            }),
            ("\\PC{1,9}", any::<bool>()).prop_map(move |(video, limited)| FrameFiles {
                video: Some(video.into()),
                range: limited.then_some(ColorRange::Limited),
                matrix: (!limited).then_some(ColorMatrix::Bt2020),
                ..none()
            }),
        ]
    }

    proptest! {
        #[test]
        fn written_description_reads_back_equal(
            frames in frames(),
            name in prop::option::of("\\PC{0,9}"),
            trajectory in prop::option::of("[ -~]{1,9}"),
            (offset, gap, scale) in (prop::option::of(number()), prop::option::of(number()), prop::option::of(number())),
            (round, live) in any::<(bool, bool)>(),
        ) {
            let live = (live && frames.list.is_some()).then(|| LiveMetadata { interval_s: 0.1, ..LiveMetadata::default() });
            let written = Description {
                version: 1,
                name,
                up: offset.map(|x| [x.min(1e100), -1e-100, 0.1]),
                floor: round && offset.is_some(),
                frames,
                poses: PoseFile {
                    trajectory: trajectory.map(Into::into),
                    time_offset_s: offset,
                    max_gap_s: gap,
                    ..PoseFile::default()
                },
                depth: scale.map(|scale| DepthList {
                    list: "depth.txt".into(),
                    scale,
                    camera: round.then(|| "depth.toml".into()),
                    colour_from_depth: round.then_some(SensorPose {
                        position_m: [scale.min(1e100), -0.1, 0.0],
                        quaternion: [0.6, 0.0, 0.0, 0.8],
                    }),
                }),
                exposure: scale.map(|_| ExposureList { list: "exposure.txt".into() }),
                camera: round.then_some(CameraFile { profile: None, kind: Some(CameraKind::Equirectangular), list: None }),
                live,
            };
            let text = description(written.clone()).unwrap().to_string();
            prop_assert_eq!(native::parse(&text, Path::new(FILE_NAME)).unwrap(), written);
        }
    }

    #[test]
    fn unreadable_description_is_not_written() {
        let nothing = Description {
            version: 1,
            name: None,
            up: None,
            floor: false,
            frames: FrameFiles::default(),
            poses: PoseFile::default(),
            depth: None,
            exposure: None,
            camera: None,
            live: None,
        };
        assert!(description(nothing).unwrap_err().to_string().contains("exactly one of list, images, video"));
    }
}
