//! Work on background threads. All threads of the window start here.
//!
//! A task sends values, which its owner takes once a frame. A panic is a value too: the owner gets
//! its message. A task that is dropped is cancelled.

use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// Cancellation flag and progress of a task.
#[derive(Clone, Debug, Default)]
pub struct TaskControl {
    cancelled: Arc<AtomicBool>,
    /// Progress in thousandths.
    progress: Arc<AtomicU32>,
}

impl TaskControl {
    /// True if the result is no longer needed.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }

    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
    }

    /// Sets the progress, 0 to 1.
    pub fn set_progress(&self, share: f64) {
        self.progress.store((1e3 * share) as u32, Ordering::Relaxed);
    }

    /// Progress, 0 to 1.
    pub fn progress(&self) -> f32 {
        self.progress.load(Ordering::Relaxed) as f32 / 1e3
    }
}

/// The side of a task that runs on the thread.
pub struct Reporter<'a, T> {
    values: &'a Sender<Result<T, String>>,
    pub control: &'a TaskControl,
    wake: &'a dyn Fn(),
}

impl<T> Reporter<'_, T> {
    /// Sends a value and wakes the owner. Returns false if no further value is needed.
    pub fn send(&self, value: T) -> bool {
        let is_sent = self.values.send(Ok(value)).is_ok();
        self.wake();
        is_sent && !self.control.is_cancelled()
    }

    /// Wakes the owner.
    pub fn wake(&self) {
        (self.wake)();
    }
}

/// A task that has been started.
#[derive(Debug)]
pub struct BackgroundTask<T> {
    values: Receiver<Result<T, String>>,
    control: TaskControl,
    thread: Option<JoinHandle<()>>,
    /// A drop waits for the end of the thread.
    is_joined: bool,
}

impl<T: Send + 'static> BackgroundTask<T> {
    /// Starts work with a single value. `wake` is called from the thread when it ends, even by a
    /// panic.
    pub fn spawn(
        name: &str,
        wake: impl FnOnce() + Send + 'static,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<Self> {
        Self::start(name, move |values, _| {
            // The receiver may be gone.
            let _ = values.send(caught(work));
            wake();
        })
    }

    /// Starts work with any number of values. `wake` is called from the thread for each value and
    /// for a panic.
    pub fn stream(
        name: &str,
        wake: impl Fn() + Send + 'static,
        work: impl FnOnce(&Reporter<'_, T>) + Send + 'static,
    ) -> io::Result<Self> {
        Self::start(name, move |values, control| {
            let reporter = Reporter { values: &values, control: &control, wake: &wake };
            if let Err(why) = caught(|| work(&reporter)) {
                let _ = values.send(Err(why));
                wake();
            }
        })
    }

    fn start(
        name: &str,
        run: impl FnOnce(Sender<Result<T, String>>, TaskControl) + Send + 'static,
    ) -> io::Result<Self> {
        let ((sender, values), control) = (channel(), TaskControl::default());
        let of_thread = control.clone();
        let thread = start_thread(name, move || run(sender, of_thread))?;
        Ok(Self { values, control, thread: Some(thread), is_joined: false })
    }

    /// Lets a drop wait for the end of the thread.
    pub fn joined(mut self) -> Self {
        self.is_joined = true;
        self
    }

    /// The next value, if there is one. The error is the message of a panic.
    pub fn take(&self) -> Option<Result<T, String>> {
        self.values.try_recv().ok()
    }

    pub fn control(&self) -> &TaskControl {
        &self.control
    }
}

impl<T> Drop for BackgroundTask<T> {
    fn drop(&mut self) {
        self.control.cancel();
        if let Some(thread) = self.thread.take().filter(|_| self.is_joined) {
            let _ = thread.join();
        }
    }
}

/// Starts a thread of the window.
fn start_thread(name: &str, run: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    Builder::new().name(name.to_owned()).spawn(run)
}

/// Runs work; the error is the message of a panic.
fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| panic_message(&*panic))
}

/// The message of a panic, for the user.
fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    format!("it failed because of a bug in the program: {}", text.unwrap_or("no message"))
}

/// Drops a value that waits for threads on a background thread.
pub fn drop_in_background(value: impl Send + 'static) {
    // If no thread can be started, the value is dropped here.
    let _ = start_thread("window end", move || drop(value));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panicking_task_wakes_and_returns_the_message() {
        let (woken, wakes) = channel();
        let task = BackgroundTask::spawn("test", move || woken.send(()).unwrap(), || panic!("no {}", "bread")).unwrap();
        wakes.recv().unwrap();
        let result: Result<(), String> = task.take().unwrap();
        assert!(result.unwrap_err().ends_with("bug in the program: no bread"));
    }

    #[test]
    fn stream_delivers_its_values_then_the_message_of_a_panic() {
        let (woken, wakes) = channel();
        let task = BackgroundTask::stream(
            "test",
            move || woken.send(()).unwrap(),
            |reporter| {
                assert!(reporter.send(1) && reporter.send(2), "the owner waits");
                panic!("no bread");
            },
        );
        let task = task.unwrap().joined();
        (0..3).for_each(|_| wakes.recv().unwrap());
        assert_eq!((task.take(), task.take()), (Some(Ok(1)), Some(Ok(2))));
        assert!(task.take().unwrap().unwrap_err().ends_with("no bread"));
    }

    #[test]
    fn dropped_task_is_cancelled_and_joined() {
        let (sender, ended) = channel();
        let task = BackgroundTask::<()>::stream(
            "test",
            || (),
            move |reporter| {
                while !reporter.control.is_cancelled() {
                    std::thread::yield_now();
                }
                sender.send(()).unwrap();
            },
        );
        drop(task.unwrap().joined());
        ended.try_recv().unwrap();
    }

    #[test]
    fn dropping_in_background_does_not_block() {
        struct Slow(Receiver<()>, std::sync::mpsc::Sender<()>);
        impl Drop for Slow {
            fn drop(&mut self) {
                self.0.recv().unwrap();
                self.1.send(()).unwrap();
            }
        }
        let ((go, waits), (sender, gone)) = (channel(), channel());
        drop_in_background(Slow(waits, sender));
        // The value is not dropped yet, and this thread was not blocked.
        assert!(gone.try_recv().is_err());
        go.send(()).unwrap();
        gone.recv().unwrap();
    }
}
