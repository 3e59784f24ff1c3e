//! Which frames are aligned with which, in one pass over the recording.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::align::{Link, align};
use super::eye::Eye;
use super::state::State;
use super::view::View;
use crate::pixels::Pixels;
use crate::recording::{Recording, RecordingError};
use crate::rows::over_rows;

/// Frames that are made ready together, per thread.
const BATCH: usize = 4;

/// What a pass looks at.
#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    /// Distances between linked frames, in frames.
    pub gaps: &'a [usize],
    /// Those of them at which later frames are aligned to earlier ones too.
    pub back: &'a [usize],
    /// Levels of the pictures, from the finest to the coarsest: `usize::MAX` for all.
    pub coarsest: usize,
    /// No finer ones are looked at.
    pub finest: usize,
    /// Whether each link says what the readout time lacks.
    pub asks_readout: bool,
    /// Only every so many frames are aligned to later ones.
    pub every: usize,
}

impl Pass<'_> {
    /// Whether a frame takes part.
    fn needs(&self, index: usize) -> bool {
        let begins = |gap: &usize| index.checked_sub(*gap).is_some_and(|from| from.is_multiple_of(self.every));
        index.is_multiple_of(self.every) || self.gaps.iter().any(begins)
    }
}

/// Aligned frames, in order of `from` of the later frame of each pair; `refused` of them found no match.
#[derive(Debug, Default)]
pub struct Links {
    pub good: Vec<Link>,
    pub refused: usize,
    /// One per frame: whether its picture has the code values of the one before.
    pub repeats: Vec<bool>,
    /// How long it waited for pictures.
    pub waited: Duration,
}

/// `states`: one per frame; frames without one are left out. `seen` is told how far it is, and
/// ends it by `false`. The result depends on
/// neither `threads` nor time.
pub fn links(
    eye: &Eye,
    recording: &Recording,
    states: &[Option<State>],
    depth_later_s: f64,
    pass: Pass<'_>,
    threads: usize,
    seen: &mut dyn FnMut(usize) -> bool,
) -> Result<Links, RecordingError> {
    let reach = pass.gaps.iter().copied().max().unwrap_or(0);
    let mut window: VecDeque<View> = VecDeque::new();
    let mut found = Links::default();
    let mut before: Option<Pixels> = None;
    let mut frames = recording.frames(0..recording.frame_count())?;
    loop {
        let begun = Instant::now();
        let batch: Vec<_> = frames.by_ref().take(BATCH * threads.max(1)).collect::<Result<_, _>>()?;
        found.waited += begun.elapsed();
        let (Some(first), Some(last)) = (batch.first(), batch.last()) else { return Ok(found) };
        let (first, last) = (first.index, last.index);
        for frame in &batch {
            found.repeats.push(before.as_ref() == Some(&frame.pixels));
            before = Some(frame.pixels.clone());
        }
        let mut views: Vec<_> = batch.into_iter().map(|frame| (frame, None)).collect();
        over_rows(&mut views, 1, threads, |_, slot| {
            let (frame, view) = &mut slot[0];
            let state = states[frame.index].filter(|_| pass.needs(frame.index));
            *view = state.map(|state| View::new(eye, frame, state, depth_later_s, pass.finest));
        });
        window.extend(views.into_iter().filter_map(|(_, view)| view));
        let at = |index: usize| window.binary_search_by_key(&index, |view| view.index).ok();
        let mut tasks = Vec::new();
        for index in first..=last {
            let Some(new) = at(index) else { continue };
            for gap in pass.gaps {
                let Some(old) = index.checked_sub(*gap).and_then(at) else { continue };
                if (index - gap).is_multiple_of(pass.every) {
                    tasks.push(((old, new), None));
                }
                if pass.back.contains(gap) && index.is_multiple_of(pass.every) {
                    tasks.push(((new, old), None));
                }
            }
        }
        over_rows(&mut tasks, 1, threads, |_, slot| {
            let ((from, to), link) = &mut slot[0];
            *link = align(eye, &window[*from], &window[*to], pass.coarsest, pass.asks_readout);
        });
        for (_, link) in tasks {
            match link {
                Some(link) if link.is_good() => found.good.push(link),
                _ => found.refused += 1,
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
