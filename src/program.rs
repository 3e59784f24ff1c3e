//! Other programs, as child processes that never outlive their owner.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use crate::cleanup::{Undo, UndoGuard};
use crate::text::reason;

/// Number of message lines kept: the first ones name the cause.
const MAX_MESSAGE_LINES: usize = 4;
/// The C library's word for a full disk.
const NO_SPACE: &str = "No space left on device";

/// Why a program gave no result.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    #[error("the program `{program}` is missing; {}", advice(program))]
    Missing { program: String },
    #[error("the program `{program}` cannot be started: {source}")]
    Start { program: String, source: std::io::Error },
    #[error("{program} failed: {problem}")]
    Failed { program: String, problem: String },
}

/// Installation of a missing program, and alternatives to it.
fn advice(program: &str) -> &'static str {
    match program {
        "ffmpeg" | "ffprobe" => {
            "video needs it: install ffmpeg (Debian, Ubuntu: apt-get install ffmpeg; macOS: brew install ffmpeg; \
             Windows: winget install ffmpeg) or use a folder of PNG files"
        }
        "colmap" => {
            "it finds the camera's motion: install COLMAP (Debian, Ubuntu: apt-get install colmap; macOS: brew install \
             colmap; Windows: https://github.com/colmap/colmap/releases), or film a sheet of tags and use `locard track`"
        }
        "heif-dec" | "heif-convert" => {
            "HEIC and AVIF pictures need it: install libheif's programs (Debian, Ubuntu: apt-get install \
             libheif-examples; macOS: brew install libheif), or convert the pictures to PNG or JPEG"
        }
        "dcraw_emu" => {
            "camera raw files need it: install LibRaw's programs (Debian, Ubuntu: apt-get install libraw-bin; macOS: brew \
             install libraw), or develop the pictures to TIFF or PNG"
        }
        "djxl" => {
            "JPEG XL pictures need it: install libjxl's programs (Debian, Ubuntu: apt-get install libjxl-tools; macOS: \
             brew install jpeg-xl), or convert the pictures to PNG"
        }
        "curl" => {
            "time stamps need it: install curl (Debian, Ubuntu: apt-get install curl; macOS and Windows have it), or sign \
             without --time-stamp"
        }
        _ => "install it, or add its folder to PATH",
    }
}

/// A program's standard output, and the first of its complaints, which need not be failures.
#[derive(Debug)]
pub struct Output {
    pub written: Vec<u8>,
    pub complaints: String,
}

/// Runs a program to completion, without input.
pub fn output(program: &str, arguments: &[OsString]) -> Result<Output, ProgramError> {
    let mut running = Running::start(program, arguments)?;
    drop(running.take_stdin());
    let mut written = Vec::new();
    if let Some(mut stdout) = running.take_stdout() {
        stdout
            .read_to_end(&mut written)
            .map_err(|source| ProgramError::Start { program: program.to_owned(), source })?;
    }
    let complaints = running.finish()?;
    Ok(Output { written, complaints })
}

/// Runs a program to completion and passes each line of its output and of its messages to
/// `on_line` as it comes. A break kills the program: `Ok(None)`. A failure is reported by the last
/// lines: a program that reports its progress gives the cause at the end.
pub fn follow(
    program: &str,
    arguments: &[OsString],
    on_line: &mut dyn FnMut(&str) -> ControlFlow<()>,
) -> Result<Option<()>, ProgramError> {
    let (sender, lines) = channel();
    let messages = sender.clone();
    let mut running = Running::start_with(program, arguments, move |stderr, kept| {
        send_lines(BufReader::new(stderr), &messages, kept)
    })?;
    if let Some(stdout) = running.take_stdout() {
        let kept = Arc::clone(&running.complaints);
        let listen = move || send_lines(BufReader::new(stdout), &sender, &kept);
        let spawned = std::thread::Builder::new().name(program.to_owned()).spawn(listen);
        spawned.map_err(|source| ProgramError::Start { program: program.to_owned(), source })?;
    }
    drop(running.take_stdin());
    for line in lines {
        if on_line(&line).is_break() {
            return Ok(None);
        }
    }
    running.finish().map(|_| Some(()))
}

/// Sends each line, and keeps the last ones. Ends with the reader.
fn send_lines(mut reader: impl BufRead, lines: &Sender<String>, kept: &Mutex<Vec<String>>) {
    let mut line = Vec::new();
    while matches!(reader.read_until(b'\n', &mut line), Ok(n) if n > 0) {
        let text = String::from_utf8_lossy(&line).trim().to_owned();
        if !text.is_empty() {
            let mut kept = locked(kept);
            if kept.len() == MAX_MESSAGE_LINES {
                kept.remove(0);
            }
            kept.push(text.clone());
            // Nobody listens once the program is to be killed.
            let _ = lines.send(text);
        }
        line.clear();
    }
}

/// A running program with piped input, output and messages. Killed and reaped when dropped, and
/// when our own program is ended.
#[derive(Debug)]
pub struct Running {
    program: String,
    stdin: Option<ChildStdin>,
    stdout: Option<ChildStdout>,
    child: Arc<Mutex<Child>>,
    listener: Option<JoinHandle<()>>,
    complaints: Arc<Mutex<Vec<String>>>,
    /// Kills and reaps the child.
    _unfinished: UndoGuard,
}

impl Running {
    pub fn start(program: &str, arguments: &[OsString]) -> Result<Self, ProgramError> {
        Self::start_with(program, arguments, |messages, kept| keep_first_lines(BufReader::new(messages), kept))
    }

    /// `listen` reads the program's messages to their end and keeps those that explain a failure.
    fn start_with(
        program: &str,
        arguments: &[OsString],
        listen: impl FnOnce(ChildStderr, &Mutex<Vec<String>>) + Send + 'static,
    ) -> Result<Self, ProgramError> {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is for our program, which then ends this one.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let failed = |source: std::io::Error| match source.kind() {
            std::io::ErrorKind::NotFound => ProgramError::Missing { program: program.to_owned() },
            _ => ProgramError::Start { program: program.to_owned(), source },
        };
        let ((stdin, stdout, stderr, child), unfinished) = UndoGuard::begin(|| {
            let mut child = command.spawn().map_err(failed)?;
            let (stdin, stdout, stderr) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
            let child = Arc::new(Mutex::new(child));
            let killed = Arc::clone(&child);
            let undo: Undo = Box::new(move || {
                // If the lock is taken, the child has ended and is being waited for.
                let Ok(mut child) = killed.try_lock() else { return };
                // Both fail only if the child has already ended and been reaped.
                let _ = child.kill();
                let _ = child.wait();
            });
            Ok::<_, ProgramError>(((stdin, stdout, stderr, child), undo))
        })?;
        let complaints = Arc::new(Mutex::new(Vec::new()));
        let spawn = |stderr| {
            let kept = Arc::clone(&complaints);
            std::thread::Builder::new().name(program.to_owned()).spawn(move || listen(stderr, &kept)).map_err(failed)
        };
        let listener = stderr.map(spawn).transpose()?;
        Ok(Self { program: program.to_owned(), stdin, stdout, child, listener, complaints, _unfinished: unfinished })
    }

    pub fn take_stdin(&mut self) -> Option<ChildStdin> {
        self.stdin.take()
    }

    pub fn take_stdout(&mut self) -> Option<ChildStdout> {
        self.stdout.take()
    }

    /// The program's first message lines so far, joined; empty if it has not complained.
    pub fn complaints(&self) -> String {
        locked(&self.complaints).join("; ")
    }

    /// Closes the input, waits for the end, and reports a failure in the program's own words.
    /// Returns the complaints of a program that succeeded.
    pub fn finish(mut self) -> Result<String, ProgramError> {
        drop(self.stdin.take());
        // It may be killed from elsewhere until it ends, so the lock is not held meanwhile.
        if let Some(thread) = self.listener.take() {
            // It panics only if one of our locks does; its data are available anyway.
            let _ = thread.join();
        }
        let status = locked(&self.child).wait();
        let complaints = self.complaints();
        let failed = |problem| Err(ProgramError::Failed { program: self.program.clone(), problem });
        match status {
            Ok(status) if status.success() => Ok(complaints),
            Ok(status) if complaints.is_empty() => failed(format!("it ended with {status}")),
            Ok(_) if complaints.contains(NO_SPACE) => failed(reason(&std::io::ErrorKind::StorageFull.into())),
            Ok(_) => failed(complaints),
            Err(e) => failed(e.to_string()),
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads everything, so that the program never waits for a reader. ffmpeg's names of its own parts,
/// `[h264 @ 0x5581...]`, are shortened to something readable.
fn keep_first_lines(mut reader: impl BufRead, kept: &Mutex<Vec<String>>) {
    let mut line = Vec::new();
    while matches!(reader.read_until(b'\n', &mut line), Ok(n) if n > 0) {
        let text = without_address(String::from_utf8_lossy(&line).trim());
        let mut kept = locked(kept);
        if kept.len() < MAX_MESSAGE_LINES && !text.is_empty() {
            kept.push(text);
        }
        line.clear();
    }
}

fn without_address(line: &str) -> String {
    let named = line.strip_prefix('[').and_then(|rest| rest.split_once(" @ 0x"));
    match named.and_then(|(part, rest)| Some((part, rest.split_once("] ")?.1))) {
        Some((part, text)) => format!("{part}: {text}"),
        None => line.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_program_is_one_line_with_installation_advice() {
        let error = Running::start("not-there", &[]).unwrap_err().to_string();
        assert!(error.starts_with("the program `not-there` is missing; install it"), "{error}");
        for (program, package) in [("ffprobe", "apt-get install ffmpeg"), ("colmap", "apt-get install colmap")] {
            let error = ProgramError::Missing { program: program.to_owned() }.to_string();
            assert!(error.contains(package) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn failure_is_reported_in_the_programs_words() {
        let error = output("sh", &["-c".into(), "echo no such thing >&2; exit 3".into()]).unwrap_err();
        assert_eq!(error.to_string(), "sh failed: no such thing");
        let full = "echo 'av_interleaved_write_frame(): No space left on device' >&2; exit 1";
        let error = output("sh", &["-c".into(), full.into()]).unwrap_err();
        assert_eq!(error.to_string(), "sh failed: the disk is full; make room, or write elsewhere");
    }

    #[test]
    fn complaints_without_a_failure_are_kept() {
        let script = "echo '[h264 @ 0x55ad] gray chroma' >&2; echo '[a] b' >&2; echo out";
        let output = output("sh", &["-c".into(), script.into()]).unwrap();
        assert_eq!(
            (output.complaints.as_str(), output.written.as_slice()),
            ("h264: gray chroma; [a] b", &b"out\n"[..])
        );
    }

    #[test]
    fn followed_program_reports_every_line_and_its_last_ones_on_failure() {
        let mut lines_seen = Vec::new();
        let mut follow_sh = |script: &str, max_lines: usize| {
            lines_seen.clear();
            let followed = follow("sh", &["-c".into(), script.into()], &mut |line| {
                lines_seen.push(line.to_owned());
                if lines_seen.len() == max_lines { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            (followed, lines_seen.clone())
        };
        let (followed, lines) = follow_sh("echo a; echo b >&2; echo; echo c", 9);
        assert_eq!(followed.unwrap(), Some(()));
        let lines: std::collections::BTreeSet<&str> = lines.iter().map(String::as_str).collect();
        assert_eq!(lines, ["a", "b", "c"].into());
        let (followed, _) = follow_sh("for i in 1 2 3 4 5 6; do echo line $i >&2; done; exit 3", 9);
        assert_eq!(followed.unwrap_err().to_string(), "sh failed: line 3; line 4; line 5; line 6");
        // Stopped in the middle: the program never ends by itself.
        let (followed, lines) = follow_sh("while :; do echo more; done", 2);
        assert_eq!((followed.unwrap(), lines.len()), (None, 2));
    }

    #[test]
    fn dropping_kills_and_reaps() {
        let running = Running::start("sh", &["-c".into(), "exec sleep 1000".into()]).unwrap();
        let id = locked(&running.child).id();
        drop(running);
        assert!(!std::path::Path::new(&format!("/proc/{id}")).exists());
    }
}
