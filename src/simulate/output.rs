//! The folder of a recording, which appears once it is complete, and what may be removed of an older one.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::SimulateError;
use crate::unfinished::{Undo, Unfinished};

/// Marks a recording as simulated.
const MARK: &str = "truth.toml";
const FILES: [&str; 9] = [
    "recording.toml",
    "camera.toml",
    MARK,
    "rgb.txt",
    "depth.txt",
    "exposure.txt",
    "groundtruth.txt",
    "environment.hdr",
    "board.glb",
];
/// Folders of numbered pictures.
const FOLDERS: [&str; 2] = ["rgb", "depth"];

/// An unfinished recording, in a hidden folder next to its final place.
pub struct Output {
    part: TempDir,
    place: PathBuf,
    name: String,
    force: bool,
    unfinished: Unfinished,
}

impl Output {
    /// Makes the hidden folder, after checking that the recording may appear at `out`.
    pub fn begin(out: &Path, force: bool) -> Result<Self, SimulateError> {
        // For a link, the folder that it leads to.
        let place = out.canonicalize().unwrap_or_else(|_| out.to_owned());
        let within = std::env::current_dir().and_then(fs::canonicalize).is_ok_and(|here| here.starts_with(&place));
        let Some(name) = place.file_name().filter(|_| !within) else {
            return Err(SimulateError::Within(out.to_owned()));
        };
        let name = name.to_string_lossy().into_owned();
        check(&place, out, force)?;
        let parent = place.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(writing(parent))?;
        let (part, unfinished) = Unfinished::begin(|| {
            let part = hidden(parent, &name, "part")?;
            let path = part.path().to_owned();
            let undo: Undo = Box::new(move || _ = fs::remove_dir_all(path));
            Ok::<_, io::Error>((part, undo))
        })
        .map_err(writing(out))?;
        Ok(Self { part, place, name, force, unfinished })
    }

    pub fn folder(&self) -> &Path {
        self.part.path()
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Moves the recording to its place. An older one is removed file by file, so that nothing else is removed with it.
    pub fn finish(self) -> Result<(), SimulateError> {
        let Self { part, place, name, force, unfinished } = self;
        unfinished.finish(|| {
            // Checked again: it may have changed while the frames were made.
            check(&place, &place, force)?;
            if !place.exists() {
                fs::rename(part.path(), &place).map_err(writing(&place))?;
                return Ok(());
            }
            let parent = place.parent().unwrap_or(Path::new("."));
            let around = hidden(parent, &name, "old").map_err(writing(parent))?.keep();
            let old = around.join(&name);
            let moved = fs::rename(&place, &old)
                .and_then(|()| fs::rename(part.path(), &place).inspect_err(|_| _ = fs::rename(&old, &place)));
            let removed = moved.map_err(writing(&place)).and_then(|()| remove(&old).map_err(writing(&old)));
            // Stays if anything is left in it.
            let _ = fs::remove_dir(&around);
            removed
        })
    }
}

fn hidden(parent: &Path, name: &str, what: &str) -> io::Result<TempDir> {
    let mut builder = tempfile::Builder::new();
    let prefix = format!(".{name}.{what}-");
    builder.prefix(&prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Like any folder: subject to the umask.
        builder.permissions(fs::Permissions::from_mode(0o777));
    }
    builder.tempdir_in(parent)
}

pub fn writing(path: &Path) -> impl FnOnce(io::Error) -> SimulateError {
    let path = path.to_owned();
    move |source| SimulateError::Write { path, source }
}

/// Checks that a recording may appear at a place; `shown` is the user's name for it.
fn check(place: &Path, shown: &Path, force: bool) -> Result<(), SimulateError> {
    if fs::symlink_metadata(place).is_err() {
        return Ok(());
    }
    let Ok(there) = entries(place) else { return Err(SimulateError::Exists(shown.to_owned())) };
    if there.is_empty() {
        return Ok(());
    }
    if !force {
        return Err(SimulateError::Exists(shown.to_owned()));
    }
    if let Some(foreign) = contents(place).map_err(writing(place))?.1.into_iter().next() {
        let foreign = foreign.strip_prefix(place).map(Path::to_owned).unwrap_or(foreign);
        return Err(SimulateError::Foreign { folder: shown.to_owned(), foreign });
    }
    if !place.join(MARK).is_file() {
        return Err(SimulateError::NotSimulated(shown.to_owned()));
    }
    Ok(())
}

fn entries(folder: &Path) -> io::Result<Vec<fs::DirEntry>> {
    let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    Ok(entries)
}

/// The entries of a folder with the name and kind of something written here, and the others.
fn contents(folder: &Path) -> io::Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let (mut ours, mut foreign) = (Vec::new(), Vec::new());
    for entry in entries(folder)? {
        let (name, kind) = (entry.file_name(), entry.file_type()?);
        if kind.is_dir() && FOLDERS.iter().any(|own| name == *own) {
            for entry in entries(&entry.path())? {
                let is_ours = entry.file_type()?.is_file() && is_numbered_picture(&entry.file_name());
                if is_ours { &mut ours } else { &mut foreign }.push(entry.path());
            }
        } else if kind.is_file() && FILES.iter().any(|own| name == *own) {
            ours.push(entry.path());
        } else {
            foreign.push(entry.path());
        }
    }
    Ok((ours, foreign))
}

fn is_numbered_picture(name: &std::ffi::OsStr) -> bool {
    let parts = name.to_str().and_then(|name| name.rsplit_once('.'));
    parts.is_some_and(|(number, kind)| {
        number.len() >= 5 && number.bytes().all(|b| b.is_ascii_digit()) && matches!(kind, "png" | "jpg")
    })
}

/// Removes a recording, but nothing that was added to it meanwhile.
fn remove(folder: &Path) -> io::Result<()> {
    contents(folder)?.0.iter().try_for_each(fs::remove_file)?;
    for own in FOLDERS.map(|own| folder.join(own)) {
        if own.exists() {
            fs::remove_dir(own)?;
        }
    }
    fs::remove_dir(folder)
}
