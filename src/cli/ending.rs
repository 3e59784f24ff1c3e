//! How the program ends before it is done.

use anyhow::Context;

use super::{FAILED, say};
use crate::unfinished::undo_all;

/// From here on Ctrl-C, and being asked to end, end the program at once, whatever it is at: a frame may take minutes. What
/// is unfinished goes with it. A file that may grow no further is an error of writing from here on.
pub fn listen() -> anyhow::Result<()> {
    // Without a handler of any kind the system ends the program where `ulimit -f` is reached, without a word.
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default())?;
    ctrlc::set_handler(|| {
        // First, for whoever pressed it. Then nothing is finished any more.
        say("interrupted; what was finished stays, and nothing else");
        let _nothing_begins = undo_all();
        end_at_once();
    })
    .context("the program cannot listen for Ctrl-C, which needs a thread")
}

/// Ends with [`FAILED`] whatever other threads are at. An exit would first clear away, in C libraries, what a graphics
/// driver's threads are using, and crash now and then; a program put into this one's place clears nothing away.
fn end_at_once() -> ! {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        // Comes back only where there is no shell.
        let _ = std::process::Command::new("sh").args(["-c", &format!("exit {FAILED}")]).exec();
    }
    std::process::exit(i32::from(FAILED))
}
