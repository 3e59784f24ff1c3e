//! Which frames are aligned with which, in one pass over the recording.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::align::{Link, LinkFailure, align};
use super::depths::{Depths, measured};
use super::eye::Eye;
use super::reading::frames;
use super::state::State;
use super::view::View;
use crate::camera::NoiseProfile;
use crate::parallel::over_rows;
use crate::pixels::Pixels;
use crate::recording::{Recording, RecordingError};

/// Frames that are made ready together, per thread.
const BATCH: usize = 4;

/// What a pass looks at.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// Distances between linked frames, in frames.
    pub gaps: &'a [usize],
    /// Those of them at which later frames are aligned to earlier ones too.
    pub back: &'a [usize],
    /// More distances, at which only every so many frames are aligned to later ones.
    pub rare: (&'a [usize], usize),
    /// Levels of the pictures, from the finest to the coarsest: `usize::MAX` for all.
    pub coarsest: usize,
    /// No finer ones are looked at.
    pub finest: usize,
    /// Whether each link says what the readout time lacks.
    pub asks_readout: bool,
    /// Only every so many frames are aligned to later ones.
    pub every: usize,
    /// Whether every frame is looked at, to find those that repeat.
    pub finds_repeats: bool,
}

impl Pass<'_> {
    /// Whether a frame takes part.
    fn needs(&self, index: usize) -> bool {
        let begins = |gap: &usize| index.checked_sub(*gap).is_some_and(|from| from.is_multiple_of(self.every));
        index.is_multiple_of(self.every) || self.gaps.iter().chain(self.rare.0).any(begins)
    }
}

/// Aligned frames, in order of `from` of the later frame of each pair; `refused` of them found no match.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Links {
    pub good: Vec<Link>,
    pub refused: usize,
    /// Number of those that fail by [`LinkFailure::FewPoints`].
    #[serde(default)]
    pub few_points: usize,
    /// So many of those in which noise takes much of the correlation.
    pub faint: usize,
    /// One per frame: whether its picture has the code values of the one before. Only if it was asked for.
    pub repeats: Vec<bool>,
    /// How long it waited for pictures.
    #[serde(skip)]
    pub waited: Duration,
}

/// `states`: one per frame; frames without one are left out. `seen` is told how far it is, and
/// ends it by `false`. The result depends on
/// neither `threads` nor time.
#[expect(clippy::too_many_arguments)]
pub fn links(
    eye: &Eye,
    recording: &Recording,
    states: &[Option<State>],
    depths: &mut Depths<'_>,
    pass: Pass<'_>,
    noise: Option<&NoiseProfile>,
    threads: usize,
    seen: &mut dyn FnMut(usize) -> bool,
) -> Result<Links, RecordingError> {
    let reach = pass.gaps.iter().chain(pass.rare.0).copied().max().unwrap_or(0);
    let mut window: VecDeque<View> = VecDeque::new();
    let mut found = Links::default();
    let mut before: Option<Pixels> = None;
    let mut frames = frames(recording, (0..recording.frame_count()).filter(|n| pass.finds_repeats || pass.needs(*n)));
    loop {
        let begun = Instant::now();
        let batch: Vec<_> = frames.by_ref().take(BATCH * threads.max(1)).collect::<Result<_, _>>()?;
        found.waited += begun.elapsed();
        let (Some(first), Some(last)) = (batch.first(), batch.last()) else { return Ok(found) };
        let (first, last) = (first.index, last.index);
        for frame in batch.iter().filter(|_| pass.finds_repeats) {
            found.repeats.push(before.as_ref() == Some(&frame.pixels));
            before = Some(frame.pixels.clone());
        }
        let mut views = Vec::new();
        for frame in batch {
            let needs = pass.needs(frame.index) && states[frame.index].is_some();
            let swept = if needs { depths.swept(frame.index)? } else { None };
            views.push((frame, swept, None));
        }
        let later_s = depths.later_s();
        over_rows(&mut views, 1, threads, |_, slot| {
            let (frame, swept, view) = &mut slot[0];
            let state = states[frame.index].filter(|_| pass.needs(frame.index));
            *view = state.map(|state| {
                let depth = swept.take().unwrap_or_else(|| measured(eye, frame, &state, later_s));
                View::new(eye, frame, state, depth, pass.finest, noise)
            });
        });
        window.extend(views.into_iter().filter_map(|(.., view)| view));
        let at = |index: usize| window.binary_search_by_key(&index, |view| view.index).ok();
        let mut tasks = Vec::new();
        for index in first..=last {
            let Some(new) = at(index) else { continue };
            let rare = pass.rare.0.iter().map(|gap| (gap, pass.rare.1));
            for (gap, every) in pass.gaps.iter().map(|gap| (gap, pass.every)).chain(rare) {
                let Some(old) = index.checked_sub(*gap).and_then(at) else { continue };
                if (index - gap).is_multiple_of(every) {
                    tasks.push(((old, new), Err(LinkFailure::FewPoints)));
                }
                if pass.back.contains(gap) && index.is_multiple_of(pass.every) {
                    tasks.push(((new, old), Err(LinkFailure::FewPoints)));
                }
            }
        }
        over_rows(&mut tasks, 1, threads, |_, slot| {
            let ((from, to), link) = &mut slot[0];
            *link = align(eye, &window[*from], &window[*to], pass.coarsest, pass.asks_readout);
        });
        for (_, link) in tasks {
            match link {
                Ok(link) if link.is_good() => found.good.push(link),
                other => {
                    found.refused += 1;
                    found.few_points += usize::from(matches!(other, Err(LinkFailure::FewPoints)));
                    found.faint += usize::from(other.is_ok_and(|link| link.is_faint()));
                }
            }
        }
        while window.front().is_some_and(|view| view.index + reach <= last) {
            window.pop_front();
        }
        if !seen(last) {
            return Ok(found);
        }
    }
}
