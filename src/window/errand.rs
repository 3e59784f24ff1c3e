//! Work that is done once on a thread of its own, and what is dropped there.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::Builder;

/// Work that has been begun.
#[derive(Debug)]
pub struct Errand<T>(Receiver<Result<T, String>>);

impl<T: Send + 'static> Errand<T> {
    /// `wake` is called from the thread when it is over, however it ended.
    pub fn begin(
        name: &str,
        wake: impl FnOnce() + Send + 'static,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let (tell, done) = channel();
        Builder::new().name(name.to_owned()).spawn(move || {
            let result = catch_unwind(AssertUnwindSafe(work)).map_err(|panic| said(&*panic));
            // Whoever waited may be gone.
            let _ = tell.send(result);
            wake();
        })?;
        Ok(Self(done))
    }

    /// What came of it, once it is there. Work that panicked says so in words.
    pub fn take(&self) -> Option<Result<T, String>> {
        match self.0.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("its thread has ended".to_owned())),
        }
    }
}

/// What a panic says, for a person.
fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    format!("it broke off by a mistake in the program: {}", text.unwrap_or("nothing more is known"))
}

/// Drops on a thread of its own what has threads to wait for.
pub fn let_go(value: impl Send + 'static) {
    // Where no thread can be had, it is dropped here.
    let _ = Builder::new().name("window end".to_owned()).spawn(move || drop(value));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_errand_that_panics_wakes_and_says_why() {
        let (woken, wakes) = channel();
        let errand = Errand::begin("test", move || woken.send(()).unwrap(), || panic!("no {}", "bread")).unwrap();
        wakes.recv().unwrap();
        let result: Result<(), String> = errand.take().unwrap();
        assert!(result.unwrap_err().ends_with("mistake in the program: no bread"));
    }

    #[test]
    fn what_is_let_go_is_not_waited_for() {
        struct Slow(Receiver<()>, std::sync::mpsc::Sender<()>);
        impl Drop for Slow {
            fn drop(&mut self) {
                self.0.recv().unwrap();
                self.1.send(()).unwrap();
            }
        }
        let ((go, waits), (tell, gone)) = (channel(), channel());
        let_go(Slow(waits, tell));
        // It is not dropped yet, and this thread has come here.
        assert!(gone.try_recv().is_err());
        go.send(()).unwrap();
        gone.recv().unwrap();
    }
}
