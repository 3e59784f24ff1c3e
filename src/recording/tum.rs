//! A folder as the TUM RGB-D benchmark has it: `rgb.txt`, `groundtruth.txt`, maybe `depth.txt`.
//! Its world is a motion-capture room with z up; its conventions are ours otherwise.

use std::path::Path;

use glam::DVec3;

use super::parts::{DepthFiles, Parts, Pictures, track_from};
use super::{Kind, OpenOptions, RecordingError, listing};
use crate::tracking::text;
use crate::tracking::tum::parse_trajectory;

pub const FRAME_LIST: &str = "rgb.txt";
/// The benchmark's depth: value / 5000 is metres.
const CODES_PER_METRE: f64 = 5000.0;

pub fn open(folder: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let frame_list = folder.join(FRAME_LIST);
    let (timestamps_s, files) = listing::read_pictures(&frame_list)?.into_iter().unzip();
    let mut parts = Parts::new(Kind::Tum, folder, Pictures::Stills(files), timestamps_s);
    parts.up = Some(DVec3::Z);
    let file = folder.join("groundtruth.txt");
    let trajectory = parse_trajectory(&text::read(&file)?, &file)?;
    parts.warnings.extend(trajectory.warnings);
    parts.track = track_from(trajectory.poses, options.max_gap_s, &file)?;
    let depth_list = folder.join("depth.txt");
    parts.described_by = vec![frame_list, file];
    if depth_list.exists() {
        let files = listing::read_pictures(&depth_list)?;
        parts.described_by.push(depth_list);
        parts.depth = Some(DepthFiles { by_time: files, codes_per_metre: CODES_PER_METRE });
    }
    Ok(parts)
}
