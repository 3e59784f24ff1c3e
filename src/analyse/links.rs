//! Aligns pairs of frames in one pass over the recording.

use std::collections::VecDeque;
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
use crate::parallel::over_rows;
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

/// Aligns the pairs of a pass. `states`: one per frame; frames without one are left out. `go_on`
/// receives the index of the last frame of each batch, and ends the pass by `false`. The result is
/// the same for any number of `threads`.
#[expect(clippy::too_many_arguments)]
pub fn links(
    model: &CameraModel,
    recording: &Recording,
    states: &[Option<CameraState>],
    depths: &mut DepthSource<'_>,
    pass: LinkPass<'_>,
    noise: Option<&NoiseProfile>,
    threads: usize,
    go_on: &mut dyn FnMut(usize) -> bool,
) -> Result<Links, RecordingError> {
    let reach = pass.gaps.iter().chain(pass.sparse.0).copied().max().unwrap_or(0);
    let mut window: VecDeque<LinkView> = VecDeque::new();
    let mut links_found = Links::default();
    let mut before: Option<Arc<Pixels>> = None;
    let mut frames = frames(recording, (0..recording.frame_count()).filter(|n| pass.finds_repeats || pass.needs(*n)));
    loop {
        let begun = Instant::now();
        let batch: Vec<_> = frames.by_ref().take(BATCH_PER_THREAD * threads.max(1)).collect::<Result<_, _>>()?;
        links_found.waited += begun.elapsed();
        let (Some(first), Some(last)) = (batch.first(), batch.last()) else { return Ok(links_found) };
        let (first, last) = (first.index, last.index);
        for frame in batch.iter().filter(|_| pass.finds_repeats) {
            links_found.repeats.push(before.as_ref() == Some(&frame.pixels));
            before = Some(frame.pixels.clone());
        }
        let mut views = Vec::new();
        for frame in batch {
            let needs = pass.needs(frame.index) && states[frame.index].is_some();
            let swept = if needs { depths.swept(frame.index)? } else { None };
            views.push((frame, swept, None));
        }
        let single = depths.single();
        over_rows(&mut views, 1, threads, |_, slot| {
            let (frame, swept, view) = &mut slot[0];
            let state = states[frame.index].filter(|_| pass.needs(frame.index));
            *view = state.map(|state| {
                let depth = swept.take().unwrap_or_else(|| single.of(model, frame, &state));
                LinkView::new(model, frame, state, depth, pass.finest, noise)
            });
        });
        window.extend(views.into_iter().filter_map(|(.., view)| view));
        let at = |index: usize| window.binary_search_by_key(&index, |view| view.index).ok();
        let mut tasks = Vec::new();
        for index in first..=last {
            let Some(new) = at(index) else { continue };
            let sparse = pass.sparse.0.iter().map(|gap| (gap, pass.sparse.1));
            for (gap, stride) in pass.gaps.iter().map(|gap| (gap, pass.stride)).chain(sparse) {
                let Some(old) = index.checked_sub(*gap).and_then(at) else { continue };
                if (index - gap).is_multiple_of(stride) {
                    tasks.push(((old, new), Err(LinkFailure::FewPoints)));
                }
                if pass.backward_gaps.contains(gap) && index.is_multiple_of(pass.stride) {
                    tasks.push(((new, old), Err(LinkFailure::FewPoints)));
                }
            }
        }
        over_rows(&mut tasks, 1, threads, |_, slot| {
            let ((from, to), link) = &mut slot[0];
            *link = align(model, &window[*from], &window[*to], pass.coarsest, pass.estimates_readout);
        });
        for (_, link) in tasks {
            match link {
                Ok(link) if link.is_good() => links_found.good.push(link),
                other => {
                    links_found.refused += 1;
                    links_found.few_points += usize::from(matches!(other, Err(LinkFailure::FewPoints)));
                    links_found.faint += usize::from(other.is_ok_and(|link| link.is_faint()));
                }
            }
        }
        while window.front().is_some_and(|view| view.index + reach <= last) {
            window.pop_front();
        }
        if !go_on(last) {
            return Ok(links_found);
        }
    }
}
