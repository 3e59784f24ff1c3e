//! The `ffmpeg` and `ffprobe` programs, as child processes that never outlive their owner.

use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use crate::cleanup::{Undo, Unfinished};
use crate::text::reason;

/// Number of message lines kept: the first ones name the cause.
const MAX_MESSAGE_LINES: usize = 4;
/// The C library's word for a full disk.
const NO_SPACE: &str = "No space left on device";

/// Why a program did not run, or failed.
#[derive(Debug, thiserror::Error)]
pub enum FfmpegError {
    #[error(
        "the program `{program}` is missing; video needs it: install ffmpeg (Debian, Ubuntu: apt-get install ffmpeg; \
         macOS: brew install ffmpeg; Windows: winget install ffmpeg) or use a folder of PNG files"
    )]
    Missing { program: String },
    #[error("the program `{program}` cannot be started: {source}")]
    Start { program: String, source: std::io::Error },
    #[error("{program} failed: {problem}")]
    Failed { program: String, problem: String },
}

/// ffmpeg's names of the containers that are read. None of them names other files. Playlists, which
/// do, are not read.
const CONTAINERS: &str = "mov,matroska,avi,mpegts,mpeg,mxf";
/// Names of the containers for messages.
const CONTAINERS_READ: &str = "MP4, QuickTime, Matroska, WebM, AVI, MPEG-TS, MPEG-PS and MXF";
/// ffmpeg's words for a file of another kind.
const NOT_WHITELISTED: &str = "not on whitelist";

/// A video file as ffmpeg's or ffprobe's input: this file alone, and only if it is a container that
/// is read.
pub fn input(path: &Path) -> impl Iterator<Item = OsString> {
    let options = ["-protocol_whitelist", "file", "-format_whitelist", CONTAINERS, "-i"].map(OsString::from);
    options.into_iter().chain([file_argument(path)])
}

/// The refusal of a file whose container a program refused to read; `None` for other problems.
pub fn container_refusal(problem: &str) -> Option<String> {
    problem.contains(NOT_WHITELISTED).then(|| {
        format!(
            "is not a supported video container; supported are {CONTAINERS_READ}. Playlists are refused because they name \
             other files (ffmpeg -i FILE -c copy NEW.mkv makes one file of one)"
        )
    })
}

/// A path as an argument of ffmpeg: never an option, never a protocol such as `concat:`.
pub fn file_argument(path: &Path) -> OsString {
    let mut argument = OsString::from("file:");
    argument.push(path);
    argument
}

/// The first line of `ffmpeg -version`.
pub fn version() -> Result<String, FfmpegError> {
    let banner = output("ffmpeg", &["-version".into()])?.written;
    Ok(String::from_utf8_lossy(&banner).lines().next().unwrap_or_default().to_owned())
}

/// A program's standard output, and the first of its complaints, which need not be failures.
#[derive(Debug)]
pub struct Output {
    pub written: Vec<u8>,
    pub complaints: String,
}

/// Runs a program to completion.
pub fn output(program: &str, arguments: &[OsString]) -> Result<Output, FfmpegError> {
    let mut running = Running::start(program, arguments)?;
    let mut written = Vec::new();
    if let Some(mut stdout) = running.take_stdout() {
        std::io::Read::read_to_end(&mut stdout, &mut written)
            .map_err(|source| FfmpegError::Start { program: program.to_owned(), source })?;
    }
    let complaints = running.finish()?;
    Ok(Output { written, complaints })
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
    _unfinished: Unfinished,
}

impl Running {
    pub fn start(program: &str, arguments: &[OsString]) -> Result<Self, FfmpegError> {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is for our program, which then ends this one.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let failed = |source: std::io::Error| match source.kind() {
            std::io::ErrorKind::NotFound => FfmpegError::Missing { program: program.to_owned() },
            _ => FfmpegError::Start { program: program.to_owned(), source },
        };
        let ((stdin, stdout, stderr, child), unfinished) = Unfinished::begin(|| {
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
            Ok::<_, FfmpegError>(((stdin, stdout, stderr, child), undo))
        })?;
        let complaints = Arc::new(Mutex::new(Vec::new()));
        let listen = |stderr| {
            let kept = Arc::clone(&complaints);
            let listen = move || keep_first_lines(BufReader::new(stderr), &kept);
            std::thread::Builder::new().name(program.to_owned()).spawn(listen).map_err(failed)
        };
        let listener = stderr.map(listen).transpose()?;
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
    pub fn finish(mut self) -> Result<String, FfmpegError> {
        drop(self.stdin.take());
        // It may be killed from elsewhere until it ends, so the lock is not held meanwhile.
        if let Some(thread) = self.listener.take() {
            // It panics only if one of our locks does; its data are available anyway.
            let _ = thread.join();
        }
        let status = locked(&self.child).wait();
        let complaints = self.complaints();
        let failed = |problem| Err(FfmpegError::Failed { program: self.program.clone(), problem });
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
        let error = Running::start("ffmpeg-that-is-not-there", &[]).unwrap_err().to_string();
        assert!(error.starts_with("the program `ffmpeg-that-is-not-there` is missing"), "{error}");
        assert!(error.contains("apt-get install ffmpeg") && !error.contains('\n'), "{error}");
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
    fn dropping_kills_and_reaps() {
        let running = Running::start("sh", &["-c".into(), "exec sleep 1000".into()]).unwrap();
        let id = locked(&running.child).id();
        drop(running);
        assert!(!Path::new(&format!("/proc/{id}")).exists());
    }
}
