//! Background computation of a keyed value, one at a time. Only the result for the last requested
//! key counts.

use eframe::egui::Context;

use super::task::{BackgroundTask, Reporter, TaskControl};

#[derive(Debug)]
struct RunningTask<K, T> {
    key: K,
    task: BackgroundTask<T>,
}

/// The running computation and the last result, each with its key.
#[derive(Debug)]
pub struct Background<K, T> {
    running: Option<RunningTask<K, T>>,
    /// No memo: it is shown until the result for a newer key has arrived.
    last: Option<(K, T)>,
    /// Key and message of a computation that panicked: it is not started again for the same key.
    /// No memo: it is the counterpart of `last`.
    failure: Option<(K, String)>,
}

impl<K, T> Default for Background<K, T> {
    fn default() -> Self {
        Self { running: None, last: None, failure: None }
    }
}

impl<K: PartialEq, T: Send + 'static> Background<K, T> {
    /// Starts a computation unless its result exists or it is running. A computation for another
    /// key is cancelled; the new one starts with a later call, when that has ended. After a panic
    /// it is not started again until another key is requested.
    pub fn request(&mut self, ctx: &Context, key: K, work: impl FnOnce(&TaskControl) -> T + Send + 'static) {
        self.poll();
        if let Some(running) = &self.running {
            if running.key != key {
                running.task.control().cancel();
            }
            return;
        }
        if self.is_of(&key) || self.failure.as_ref().is_some_and(|(of, _)| *of == key) {
            return;
        }
        self.failure = None;
        let ctx = ctx.clone();
        let run = move |reporter: &Reporter<'_, T>| _ = reporter.send(work(reporter.control));
        match BackgroundTask::stream("measure", move || ctx.request_repaint(), run) {
            Ok(task) => self.running = Some(RunningTask { key, task }),
            Err(error) => self.failure = Some((key, format!("its thread could not be started: {error}"))),
        }
    }

    /// Cancels the running computation.
    pub fn cancel(&mut self) {
        self.poll();
        if let Some(running) = &self.running {
            running.task.control().cancel();
        }
    }

    fn poll(&mut self) {
        let Some(result) = self.running.as_ref().and_then(|running| running.task.take()) else { return };
        let Some(RunningTask { key, task }) = self.running.take() else { return };
        match result {
            Ok(result) if !task.control().is_cancelled() => self.last = Some((key, result)),
            Ok(_) => {}
            Err(why) => self.failure = Some((key, why)),
        }
    }

    /// Message of a computation that panicked or could not start.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_ref().map(|(_, why)| why.as_str())
    }

    /// The last result, possibly for an earlier key.
    pub fn last(&self) -> Option<&T> {
        self.last.as_ref().map(|(_, result)| result)
    }

    /// True if the last result is for this key.
    pub fn is_of(&self, key: &K) -> bool {
        self.last.as_ref().is_some_and(|(of, _)| of == key)
    }

    /// Key of the last result.
    pub fn last_key(&self) -> Option<&K> {
        self.last.as_ref().map(|(of, _)| of)
    }

    /// Progress of the running computation, 0 to 1.
    pub fn progress(&self) -> Option<f32> {
        self.running.as_ref().map(|running| running.task.control().progress())
    }

    /// Drops all results and cancels the running computation.
    pub fn clear(&mut self) {
        if let Some(running) = &self.running {
            running.task.control().cancel();
        }
        (self.last, self.failure) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::sync::mpsc::channel;

    #[test]
    fn panicked_work_is_reported_and_not_repeated_for_the_same_key() {
        let ctx = Context::default();
        let mut background: Background<u32, u32> = Background::default();
        let begun = Arc::new(AtomicU32::new(0));
        let ask = |background: &mut Background<u32, u32>, key: u32| {
            let begun = Arc::clone(&begun);
            background.request(&ctx, key, move |_| {
                begun.fetch_add(1, Ordering::Relaxed);
                assert_ne!(key, 1, "one is too few");
                key
            });
            std::thread::yield_now();
        };
        while background.failure().is_none() {
            ask(&mut background, 1);
        }
        (0..100).for_each(|_| ask(&mut background, 1));
        assert!(background.failure().unwrap().contains("one is too few") && begun.load(Ordering::Relaxed) == 1);
        while !background.is_of(&2) {
            ask(&mut background, 2);
        }
        assert!(background.failure().is_none() && begun.load(Ordering::Relaxed) == 2);
    }

    #[test]
    fn cancelled_work_has_no_result() {
        let ctx = Context::default();
        let mut background: Background<u32, ()> = Background::default();
        let (tell, ended) = channel();
        background.request(&ctx, 1, move |control| {
            while !control.is_cancelled() {
                std::thread::yield_now();
            }
            tell.send(()).unwrap();
        });
        background.cancel();
        ended.recv().unwrap();
        while background.progress().is_some() {
            background.cancel();
        }
        assert!(background.last().is_none());
    }

    #[test]
    fn last_requested_key_wins() {
        let ctx = Context::default();
        let mut background: Background<u32, u32> = Background::default();
        let (go, waits) = channel::<()>();
        background.request(&ctx, 1, move |control| {
            control.set_progress(0.25);
            let _ = waits.recv();
            1
        });
        while background.progress() != Some(0.25) {
            std::thread::yield_now();
        }
        // Another key: the first computation is cancelled, and its result is dropped.
        background.request(&ctx, 2, |_| 2);
        go.send(()).unwrap();
        while !background.is_of(&2) {
            background.request(&ctx, 2, |_| 2);
            assert!(!background.is_of(&1));
            std::thread::yield_now();
        }
        assert_eq!((background.last(), background.progress()), (Some(&2), None));
        // A result is not computed twice.
        background.request(&ctx, 2, |_| 3);
        assert!(background.last() == Some(&2) && background.progress().is_none());
    }
}
