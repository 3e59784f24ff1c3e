//! Ranges of frames for parts.

use std::ops::Range;

use super::error::FarmError;
use crate::text::count;

/// Largest number of parts. Slurm's default limit of an array is 1001 tasks (`MaxArraySize`), Open
/// Job Description's of a list of task parameters 1024.
pub const MAX_PARTS: usize = 1000;

/// A range of frames and its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct FarmPlan {
    /// Frames of the recording.
    pub frames: Range<usize>,
    /// Parts in order, without holes; none is empty.
    pub parts: Vec<Range<usize>>,
}

impl FarmPlan {
    /// Divides frames into parts of equal length. Each but the last has a multiple of `group`
    /// frames. There are fewer parts if there are fewer groups.
    pub fn new(frames: Range<usize>, parts: usize, group: usize) -> Result<Self, FarmError> {
        if parts == 0 || group == 0 || frames.is_empty() {
            return Err(FarmError::Plan(
                "a plan needs at least one frame, one part and groups of one frame".to_owned(),
            ));
        }
        if parts > MAX_PARTS {
            return Err(FarmError::Plan(format!(
                "{} are refused: engines accept up to {MAX_PARTS}; make longer parts, or divide the range (--frames)",
                count(parts, "part")
            )));
        }
        let groups = frames.len().div_ceil(group);
        let parts = parts.min(groups);
        let boundary = |part: usize| (frames.start + part * groups / parts * group).min(frames.end);
        let ranges = (0..parts).map(|part| boundary(part)..boundary(part + 1)).collect();
        Ok(Self { frames, parts: ranges })
    }

    /// Number and length of the parts: "5 parts of up to 15 frames".
    pub fn summary(&self) -> String {
        let longest = self.longest();
        let bound = if self.parts.iter().all(|part| part.len() == longest) { "" } else { "up to " };
        format!("{} of {bound}{}", count(self.parts.len(), "part"), count(longest, "frame"))
    }

    /// Frames of the longest part.
    pub fn longest(&self) -> usize {
        self.parts.iter().map(Range::len).max().unwrap_or_default()
    }
}

/// Name of a part's output without an extension: it sorts in frame order.
pub fn part_name(frames: &Range<usize>) -> String {
    format!("part_{:06}_{:06}", frames.start, frames.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_the_frames_without_holes_and_differ_by_one_group() {
        let plan = FarmPlan::new(10..17, 3, 1).unwrap();
        assert_eq!(plan.parts, [10..12, 12..14, 14..17]);
        assert_eq!(plan.summary(), "3 parts of up to 3 frames");
        assert_eq!(FarmPlan::new(0..72, 400, 1).unwrap().summary(), "72 parts of 1 frame");
        assert_eq!(FarmPlan::new(0..72, 1, 1).unwrap().summary(), "1 part of 72 frames");
        for (length, parts, group) in [(72, 16, 1), (100, 7, 12), (5, 9, 1), (216_000, 1000, 30), (13, 2, 12)] {
            let plan = FarmPlan::new(3..3 + length, parts, group).unwrap();
            let (first, last) = (plan.parts.first().unwrap(), plan.parts.last().unwrap());
            assert_eq!((first.start, last.end), (3, 3 + length));
            assert!(plan.parts.windows(2).all(|pair| pair[0].end == pair[1].start));
            let groups = plan.parts.iter().map(|part| part.len().div_ceil(group));
            assert!(groups.clone().min().unwrap() > 0 && groups.clone().max().unwrap() - groups.min().unwrap() <= 1);
            let whole = &plan.parts[..plan.parts.len() - 1];
            assert!(whole.iter().all(|part| part.len().is_multiple_of(group)));
        }
    }

    #[test]
    fn impossible_plan_is_refused() {
        assert!(FarmPlan::new(4..4, 1, 1).is_err() && FarmPlan::new(0..4, 0, 1).is_err());
        let error = FarmPlan::new(0..5000, 1001, 1).unwrap_err().to_string();
        assert!(error.contains("1001 parts are refused: engines accept up to 1000"), "{error}");
    }

    #[test]
    fn part_names_sort_in_frame_order() {
        assert_eq!(part_name(&(50..100)), "part_000050_000100");
        assert!(part_name(&(9..10)) < part_name(&(10..11)));
    }
}
