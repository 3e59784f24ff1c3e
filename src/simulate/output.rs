//! Output folder of a recording. It appears once it is complete; files of an older recording are
//! removed only if this program wrote them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::SimulateError;
use super::manifest::Manifest;
use crate::cleanup::{MadeFolder, Undo, UndoGuard};

/// An unfinished recording, in a hidden folder next to its final place.
pub struct RecordingOutput {
    part: TempDir,
    place: PathBuf,
    name: String,
    force: bool,
    unfinished: UndoGuard,
    /// The parent folder.
    made: MadeFolder,
}

impl RecordingOutput {
    /// Creates the hidden folder, after checking that the recording may appear at `out`.
    pub fn begin(out: &Path, force: bool) -> Result<Self, SimulateError> {
        // The target of a symbolic link.
        let place = out.canonicalize().unwrap_or_else(|_| out.to_owned());
        let within = std::env::current_dir().and_then(fs::canonicalize).is_ok_and(|here| here.starts_with(&place));
        let Some(name) = place.file_name().filter(|_| !within) else {
            return Err(SimulateError::Within(out.to_owned()));
        };
        let name = name.to_string_lossy().into_owned();
        check(&place, out, force)?;
        let parent = place.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let made = MadeFolder::make(parent).map_err(writing(parent))?;
        let (part, unfinished) = UndoGuard::begin(|| {
            let part = hidden(parent, &name, "part")?;
            let path = part.path().to_owned();
            let undo: Undo = Box::new(move || _ = fs::remove_dir_all(path));
            Ok::<_, io::Error>((part, undo))
        })
        .map_err(writing(out))?;
        Ok(Self { part, place, name, force, unfinished, made })
    }

    pub fn folder(&self) -> &Path {
        self.part.path()
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// Replaces the hidden folder in an error by the final one, the only path known to the user.
    pub fn with_final_path(&self, error: SimulateError) -> SimulateError {
        match error {
            SimulateError::Write { path, source } => {
                let path = path.strip_prefix(self.folder()).map_or(path.clone(), |inner| self.place.join(inner));
                SimulateError::Write { path, source }
            }
            other => other,
        }
    }

    /// Moves the recording to its final path. An older one is removed file by file, so that nothing
    /// else is removed with it.
    pub fn finish(self) -> Result<(), SimulateError> {
        let Self { part, place, name, force, unfinished, made } = self;
        unfinished.finish(|| {
            // Checked again: the folder may have changed while the frames were rendered.
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
            // Fails if anything is left in it.
            let _ = fs::remove_dir(&around);
            removed
        })?;
        made.keep();
        Ok(())
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

/// Checks that a recording may appear at a path; `shown` is the user's name for it.
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
    let Some(written) = Manifest::of(place) else { return Err(SimulateError::NotSimulated(shown.to_owned())) };
    let Contents { foreign, changed, .. } = contents(place, &written).map_err(writing(place))?;
    let folder = shown.to_owned();
    match (foreign.into_iter().next(), changed.into_iter().next()) {
        (Some(foreign), _) => Err(SimulateError::Foreign { folder, foreign }),
        (None, Some(changed)) => Err(SimulateError::Changed { folder, changed }),
        (None, None) => Ok(()),
    }
}

fn entries(folder: &Path) -> io::Result<Vec<fs::DirEntry>> {
    let mut entries = fs::read_dir(folder)?.collect::<io::Result<Vec<_>>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    Ok(entries)
}

/// Contents of a folder, relative to it.
#[derive(Default)]
struct Contents {
    /// Unchanged since they were written.
    ours: Vec<PathBuf>,
    /// Manifest by this program, and modified since.
    changed: Vec<PathBuf>,
    foreign: Vec<PathBuf>,
}

fn contents(folder: &Path, written: &Manifest) -> io::Result<Contents> {
    let mut listed = Contents::default();
    let mut sort = |name: String, kind: fs::FileType| {
        let list = match &name {
            name if !kind.is_file() || !written.lists(name) => &mut listed.foreign,
            name if written.is_unchanged(folder, name) => &mut listed.ours,
            _ => &mut listed.changed,
        };
        list.push(PathBuf::from(name));
    };
    for entry in entries(folder)? {
        let (name, kind) = (entry.file_name().to_string_lossy().into_owned(), entry.file_type()?);
        if kind.is_dir() && written.lists_folder(&name) {
            for inner in entries(&entry.path())? {
                sort(format!("{name}/{}", inner.file_name().to_string_lossy()), inner.file_type()?);
            }
        } else {
            sort(name, kind);
        }
    }
    Ok(listed)
}

/// Removes a recording, except files that were added or modified since.
fn remove(folder: &Path) -> io::Result<()> {
    let written = Manifest::of(folder).unwrap_or_default();
    for file in contents(folder, &written)?.ours {
        fs::remove_file(folder.join(file))?;
    }
    for entry in entries(folder)? {
        if entry.file_type()?.is_dir() && written.lists_folder(&entry.file_name().to_string_lossy()) {
            fs::remove_dir(entry.path())?;
        }
    }
    fs::remove_dir(folder)
}
