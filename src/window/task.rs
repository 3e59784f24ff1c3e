//! One-shot tasks on background threads.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::Builder;

/// A task that has been started.
#[derive(Debug)]
pub struct BackgroundTask<T>(Receiver<Result<T, String>>);

impl<T: Send + 'static> BackgroundTask<T> {
    /// `wake` is called from the thread when the task ends, even by a panic.
    pub fn spawn(
        name: &str,
        wake: impl FnOnce() + Send + 'static,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let (sender, done) = channel();
        Builder::new().name(name.to_owned()).spawn(move || {
            let result = catch_unwind(AssertUnwindSafe(work)).map_err(|panic| panic_message(&*panic));
            // The receiver may be gone.
            let _ = sender.send(result);
            wake();
        })?;
        Ok(Self(done))
    }

    /// The result, once. The error is the message of a panic.
    pub fn take(&self) -> Option<Result<T, String>> {
        match self.0.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("its thread has ended".to_owned())),
        }
    }
}

/// The message of a panic, for the user.
fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    format!("it broke off by a mistake in the program: {}", text.unwrap_or("nothing more is known"))
}

/// Drops a value that waits for threads on a background thread.
pub fn drop_in_background(value: impl Send + 'static) {
    // If no thread can be started, the value is dropped here.
    let _ = Builder::new().name("window end".to_owned()).spawn(move || drop(value));
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
        assert!(result.unwrap_err().ends_with("mistake in the program: no bread"));
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
