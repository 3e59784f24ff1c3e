//! A folder in the TUM RGB-D benchmark's format: `rgb.txt`, `groundtruth.txt`, optionally
//! `depth.txt`. Its world is a motion-capture room with z up; its other conventions are Locard's.

use std::path::Path;

use glam::DVec3;

use super::depth::{DepthEncoding, DepthFiles};
use super::parts::{Parts, Pictures, RecordingFormat, file_or_in_folder, folder_of, track_from};
use super::{OpenOptions, RecordingError, listing};
use crate::tracking::records;
use crate::tracking::tum::parse_trajectory;

const FRAME_LIST: &str = "rgb.txt";

pub static FORMAT: RecordingFormat = RecordingFormat {
    name: "TUM RGB-D",
    has_times: true,
    is_metric: true,
    find: |path| file_or_in_folder(path, FRAME_LIST).map(|list| folder_of(&list)),
    open: |folder, _, options| open(folder, options),
};

/// The benchmark's depth: value / 5000 is metres.
const CODES_PER_METRE: f64 = 5000.0;

fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let frame_list = folder.join(FRAME_LIST);
    let (timestamps_s, files) = listing::read_pictures(&frame_list)?.into_iter().unzip();
    let mut parts = Parts::new(folder, Pictures::Stills(files), timestamps_s);
    parts.up = Some(DVec3::Z);
    let file = folder.join("groundtruth.txt");
    let trajectory = parse_trajectory(&records::read(&file)?, &file)?;
    parts.warnings.extend(trajectory.warnings);
    parts.track = track_from(trajectory.poses, options.max_gap_s, &file)?;
    let depth_list = folder.join("depth.txt");
    parts.description_files = vec![frame_list, file];
    if depth_list.exists() {
        let files = listing::read_pictures(&depth_list)?;
        parts.description_files.push(depth_list);
        let unit_advice = Some("describe the recording by a recording.toml with `scale = 1` in [depth]");
        let stored = DepthEncoding { unit_advice, ..DepthEncoding::plain(CODES_PER_METRE) };
        parts.depth = Some(DepthFiles { by_time: files, stored });
    }
    Ok(parts)
}
