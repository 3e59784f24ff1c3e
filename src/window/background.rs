//! Work on a thread of its own, one at a time: what was asked for last counts.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use eframe::egui::Context;

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
    result: Receiver<T>,
}

/// What is worked on, and what came of it last. A key says what was asked for.
#[derive(Debug)]
pub struct Background<K, T> {
    running: Option<Running<K, T>>,
    last: Option<(K, T)>,
}

impl<K, T> Default for Background<K, T> {
    fn default() -> Self {
        Self { running: None, last: None }
    }
}

impl<K: PartialEq, T: Send + 'static> Background<K, T> {
    /// Has work done, unless it is done or under way. Other work that is under way is cancelled, and is waited for.
    pub fn want(&mut self, ctx: &Context, key: K, work: impl FnOnce(&Ticket) -> T + Send + 'static) {
        self.look();
        if let Some(running) = &self.running {
            if running.key != key {
                running.ticket.cancelled.store(true, Ordering::Relaxed);
            }
            return;
        }
        if self.is_of(&key) {
            return;
        }
        let (ticket, ctx, (done, result)) = (Ticket::default(), ctx.clone(), channel());
        let of_work = ticket.clone();
        let thread = std::thread::Builder::new().name("window work".to_owned()).spawn(move || {
            // Whoever waited may be gone.
            let _ = done.send(work(&of_work));
            ctx.request_repaint();
        });
        if thread.is_ok() {
            self.running = Some(Running { key, ticket, result });
        }
    }

    fn look(&mut self) {
        let Some(running) = &self.running else { return };
        match running.result.try_recv() {
            Ok(result) => {
                if let Some(Running { key, ticket, .. }) = self.running.take()
                    && !ticket.is_cancelled()
                {
                    self.last = Some((key, result));
                }
            }
            Err(TryRecvError::Disconnected) => self.running = None,
            Err(TryRecvError::Empty) => {}
        }
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
        self.last = None;
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
