//! Aligns pairs of frames in one pass over the recording.

use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::align::{Link, LinkFailure, align};
use super::camera_model::CameraModel;
use super::depth_source::DepthSource;
use super::sparse_frames::frames;
use super::state::CameraState;
use super::view::LinkView;
use crate::camera::NoiseProfile;
use crate::frame::Frame;
use crate::parallel::over_items;
use crate::pixels::Pixels;
use crate::recording::{Recording, RecordingError};

/// Frames that are prepared together, per thread.
const BATCH_PER_THREAD: usize = 4;

/// The pairs that a pass aligns.
#[derive(Clone, Copy, Debug)]
pub struct LinkPass<'a> {
    /// Distances between linked frames, in frames.
    pub gaps: &'a [usize],
    /// Those of the distances at which later frames are also aligned to earlier ones.
    pub backward_gaps: &'a [usize],
    /// Additional distances, and the stride of the frames that are aligned to later ones at these.
    pub sparse: (&'a [usize], usize),
    /// Coarsest pyramid level; `usize::MAX` for the coarsest there is.
    pub coarsest: usize,
    /// Finest pyramid level.
    pub finest: usize,
    /// Whether each link has a correction of the readout time.
    pub estimates_readout: bool,
    /// Stride of the frames that are aligned to later ones.
    pub stride: usize,
    /// Whether all frames are read to find repeated pictures.
    pub finds_repeats: bool,
}

impl LinkPass<'_> {
    /// True if a frame is part of a pair.
    fn needs(&self, index: usize) -> bool {
        let begins = |gap: &usize| index.checked_sub(*gap).is_some_and(|from| from.is_multiple_of(self.stride));
        index.is_multiple_of(self.stride) || self.gaps.iter().chain(self.sparse.0).any(begins)
    }
}

/// Links in the order of the later frame of each pair.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Links {
    pub good: Vec<Link>,
    /// Number of pairs that could not be aligned, or whose link is not accepted.
    pub refused: usize,
    /// Number of refused pairs with [`LinkFailure::FewPoints`].
    #[serde(default)]
    pub few_points: usize,
    /// Number of refused links in which noise accounts for much of the missing correlation.
    pub faint: usize,
    /// One per frame: whether its picture has the code values of the one before. Empty unless
    /// requested.
    pub repeats: Vec<bool>,
    /// Time spent waiting for pictures.
    #[serde(skip)]
    pub waited: Duration,
}

/// Frames, and how their pairs are aligned.
#[derive(Clone, Copy, Debug)]
pub struct LinkRequest<'a> {
    pub recording: &'a Recording,
    pub model: &'a CameraModel,
    /// One per frame; frames without one are left out.
    pub states: &'a [Option<CameraState>],
    pub pass: LinkPass<'a>,
    pub noise: Option<&'a NoiseProfile>,
    /// The result is the same for any number.
    pub threads: usize,
}

/// A frame of a batch. Views are made in parallel.
struct FrameTask {
    frame: Frame,
    /// By plane sweep, m.
    swept: Option<Vec<f32>>,
    view: Option<LinkView>,
}

/// A pair of views of the window, by their places in it. Pairs are aligned in parallel.
struct PairTask {
    from: usize,
    to: usize,
    link: Option<Result<Link, LinkFailure>>,
}

impl LinkRequest<'_> {
    /// Aligns the pairs of the pass. `on_batch` receives the index of the last frame of each batch,
    /// and ends the pass by `false`.
    pub fn links(
        &self,
        depths: &mut DepthSource<'_>,
        on_batch: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Links, RecordingError> {
        let Self { recording, pass, threads, .. } = *self;
        let reach = pass.gaps.iter().chain(pass.sparse.0).copied().max().unwrap_or(0);
        let mut window: VecDeque<LinkView> = VecDeque::new();
        let mut links = Links::default();
        let mut before: Option<Arc<Pixels>> = None;
        let needed = (0..recording.frame_count()).filter(|n| pass.finds_repeats || pass.needs(*n));
        let mut frames = frames(recording, needed);
        loop {
            let begun = Instant::now();
            let batch: Vec<_> = frames.by_ref().take(BATCH_PER_THREAD * threads.max(1)).collect::<Result<_, _>>()?;
            links.waited += begun.elapsed();
            let (Some(first), Some(last)) = (batch.first(), batch.last()) else { return Ok(links) };
            let (first, last) = (first.index, last.index);
            for frame in batch.iter().filter(|_| pass.finds_repeats) {
                links.repeats.push(before.as_ref() == Some(&frame.pixels));
                before = Some(frame.pixels.clone());
            }
            window.extend(self.views(batch, depths)?);
            for link in self.aligned_pairs(&window, first..=last) {
                links.add(link);
            }
            while window.front().is_some_and(|view| view.index + reach <= last) {
                window.pop_front();
            }
            if !on_batch(last) {
                return Ok(links);
            }
        }
    }

    /// Views of the frames that are parts of pairs and have states.
    fn views(&self, batch: Vec<Frame>, depths: &mut DepthSource<'_>) -> Result<Vec<LinkView>, RecordingError> {
        let Self { model, states, pass, noise, threads, .. } = *self;
        let mut tasks = Vec::new();
        for frame in batch.into_iter().filter(|frame| pass.needs(frame.index) && states[frame.index].is_some()) {
            let swept = depths.swept(frame.index)?;
            tasks.push(FrameTask { frame, swept, view: None });
        }
        let single = depths.single();
        over_items(tasks.iter_mut().collect(), threads, |task: &mut FrameTask| {
            let FrameTask { frame, swept, view } = task;
            *view = states[frame.index].map(|state| {
                let depth = swept.take().unwrap_or_else(|| single.of(model, frame, &state));
                LinkView::new(model, frame, state, depth, pass.finest, noise)
            });
        });
        Ok(tasks.into_iter().filter_map(|task| task.view).collect())
    }

    /// Aligns the pairs whose later frame is in `frames`, ordered by that frame.
    fn aligned_pairs(
        &self,
        window: &VecDeque<LinkView>,
        frames: RangeInclusive<usize>,
    ) -> impl Iterator<Item = Result<Link, LinkFailure>> + use<> {
        let Self { model, pass, threads, .. } = *self;
        let at = |index: usize| window.binary_search_by_key(&index, |view| view.index).ok();
        let mut tasks = Vec::new();
        for index in frames {
            let Some(new) = at(index) else { continue };
            let sparse = pass.sparse.0.iter().map(|gap| (gap, pass.sparse.1));
            for (gap, stride) in pass.gaps.iter().map(|gap| (gap, pass.stride)).chain(sparse) {
                let Some(old) = index.checked_sub(*gap).and_then(at) else { continue };
                if (index - gap).is_multiple_of(stride) {
                    tasks.push(PairTask { from: old, to: new, link: None });
                }
                if pass.backward_gaps.contains(gap) && index.is_multiple_of(pass.stride) {
                    tasks.push(PairTask { from: new, to: old, link: None });
                }
            }
        }
        over_items(tasks.iter_mut().collect(), threads, |task: &mut PairTask| {
            let [from, to] = [task.from, task.to].map(|at| &window[at]);
            task.link = Some(align(model, from, to, pass.coarsest, pass.estimates_readout));
        });
        tasks.into_iter().filter_map(|task| task.link)
    }
}

impl Links {
    fn add(&mut self, link: Result<Link, LinkFailure>) {
        match link {
            Ok(link) if link.is_good() => self.good.push(link),
            other => {
                self.refused += 1;
                self.few_points += usize::from(matches!(other, Err(LinkFailure::FewPoints)));
                self.faint += usize::from(other.is_ok_and(|link| link.is_faint()));
            }
        }
    }
}
