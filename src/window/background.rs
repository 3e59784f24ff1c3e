//! Work on a thread of its own, one at a time: what was asked for last counts.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use eframe::egui::Context;

use super::task::BackgroundTask;

/// What work knows of whoever waits for it.
#[derive(Clone, Debug, Default)]
pub struct Ticket {
    cancelled: Arc<AtomicBool>,
    /// Thousandths.
    progress: Arc<AtomicU32>,
}

impl Ticket {
    /// Nobody waits for it any more.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Tells how much is done, 0 to 1.
    pub fn done(&self, share: f64) {
        self.progress.store((1e3 * share) as u32, Ordering::Relaxed);
    }
}

#[derive(Debug)]
struct Running<K, T> {
    key: K,
    ticket: Ticket,
    task: BackgroundTask<T>,
}

/// What is worked on, and what came of it last. A key says what was asked for.
#[derive(Debug)]
pub struct Background<K, T> {
    running: Option<Running<K, T>>,
    last: Option<(K, T)>,
    /// What was asked for when the work broke off, and why it did: it is not begun again for the same.
    broken: Option<(K, String)>,
}

impl<K, T> Default for Background<K, T> {
    fn default() -> Self {
        Self { running: None, last: None, broken: None }
    }
}

impl<K: PartialEq, T: Send + 'static> Background<K, T> {
    /// Has work done, unless it is done or under way. Other work that is under way is cancelled, and is waited for. Work
    /// that panics is not begun again until something else is asked for.
    pub fn want(&mut self, ctx: &Context, key: K, work: impl FnOnce(&Ticket) -> T + Send + 'static) {
        self.look();
        if let Some(running) = &self.running {
            if running.key != key {
                running.ticket.cancelled.store(true, Ordering::Relaxed);
            }
            return;
        }
        if self.is_of(&key) || self.broken.as_ref().is_some_and(|(of, _)| *of == key) {
            return;
        }
        self.broken = None;
        let (ticket, ctx) = (Ticket::default(), ctx.clone());
        let of_work = ticket.clone();
        match BackgroundTask::spawn("window work", move || ctx.request_repaint(), move || work(&of_work)) {
            Ok(task) => self.running = Some(Running { key, ticket, task }),
            Err(error) => self.broken = Some((key, format!("no thread can be had for it: {error}"))),
        }
    }

    /// Nothing is asked for now: what is under way is cancelled.
    pub fn rest(&mut self) {
        self.look();
        if let Some(running) = &self.running {
            running.ticket.cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn look(&mut self) {
        let Some(result) = self.running.as_ref().and_then(|running| running.task.take()) else { return };
        let Some(Running { key, ticket, .. }) = self.running.take() else { return };
        match result {
            Ok(result) if !ticket.is_cancelled() => self.last = Some((key, result)),
            Ok(_) => {}
            Err(why) => self.broken = Some((key, why)),
        }
    }

    /// Why there is no answer to what was asked for last: the work broke off.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_ref().map(|(_, why)| why.as_str())
    }

    /// What came last, which may be of an earlier key.
    pub fn last(&self) -> Option<&T> {
        self.last.as_ref().map(|(_, result)| result)
    }

    /// Whether what came last is of this key.
    pub fn is_of(&self, key: &K) -> bool {
        self.last.as_ref().is_some_and(|(of, _)| of == key)
    }

    /// What that was asked for by.
    pub fn last_key(&self) -> Option<&K> {
        self.last.as_ref().map(|(of, _)| of)
    }

    /// How much is done of what is under way, 0 to 1.
    pub fn progress(&self) -> Option<f32> {
        self.running.as_ref().map(|running| running.ticket.progress.load(Ordering::Relaxed) as f32 / 1e3)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        if let Some(running) = &self.running {
            running.ticket.cancelled.store(true, Ordering::Relaxed);
        }
        (self.last, self.broken) = (None, None);
    }
}

impl<K, T> Drop for Background<K, T> {
    fn drop(&mut self) {
        if let Some(running) = &self.running {
            running.ticket.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn work_that_panics_is_told_and_not_begun_again_until_something_else_is_asked_for() {
        let ctx = Context::default();
        let mut background: Background<u32, u32> = Background::default();
        let begun = Arc::new(AtomicU32::new(0));
        let ask = |background: &mut Background<u32, u32>, key: u32| {
            let begun = Arc::clone(&begun);
            background.want(&ctx, key, move |_| {
                begun.fetch_add(1, Ordering::Relaxed);
                assert_ne!(key, 1, "one is too few");
                key
            });
            std::thread::yield_now();
        };
        while background.broken().is_none() {
            ask(&mut background, 1);
        }
        (0..100).for_each(|_| ask(&mut background, 1));
        assert!(background.broken().unwrap().contains("one is too few") && begun.load(Ordering::Relaxed) == 1);
        while !background.is_of(&2) {
            ask(&mut background, 2);
        }
        assert!(background.broken().is_none() && begun.load(Ordering::Relaxed) == 2);
    }

    #[test]
    fn what_nobody_asks_for_is_cancelled() {
        let ctx = Context::default();
        let mut background: Background<u32, ()> = Background::default();
        let (tell, ended) = channel();
        background.want(&ctx, 1, move |ticket| {
            while !ticket.is_cancelled() {
                std::thread::yield_now();
            }
            tell.send(()).unwrap();
        });
        background.rest();
        ended.recv().unwrap();
        while background.progress().is_some() {
            background.rest();
        }
        assert!(background.last().is_none());
    }

    #[test]
    fn what_was_asked_for_last_counts() {
        let ctx = Context::default();
        let mut background: Background<u32, u32> = Background::default();
        let (go, waits) = channel::<()>();
        background.want(&ctx, 1, move |ticket| {
            ticket.done(0.25);
            let _ = waits.recv();
            1
        });
        while background.progress() != Some(0.25) {
            std::thread::yield_now();
        }
        // Another question: the first is cancelled, and its answer is not taken.
        background.want(&ctx, 2, |_| 2);
        go.send(()).unwrap();
        while !background.is_of(&2) {
            background.want(&ctx, 2, |_| 2);
            assert!(!background.is_of(&1));
            std::thread::yield_now();
        }
        assert_eq!((background.last(), background.progress()), (Some(&2), None));
        // It is not done twice.
        background.want(&ctx, 2, |_| 3);
        assert!(background.last() == Some(&2) && background.progress().is_none());
    }
}
