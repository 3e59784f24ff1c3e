//! A new recording's folder, which appears once it is complete.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::RecordingError;
use crate::cleanup::{MadeFolder, Undo, UndoGuard};
use crate::text::reason;

/// Reason why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("{}: exists already, and is kept; choose another folder, or replace a recording that this command made with --force", .0.display())]
    Exists(PathBuf),
    #[error("{}: contains {foreign}, which does not belong to such a recording; nothing was removed: choose another \
             folder", folder.display())]
    Foreign { folder: PathBuf, foreign: String },
    #[error("{}: cannot be created as a folder", .0.display())]
    NoFolder(PathBuf),
    #[error("{}: lies in the folder that would be replaced; choose another folder", .0.display())]
    Within(PathBuf),
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Write { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

fn writing(path: &Path) -> impl FnOnce(io::Error) -> RecordError {
    let path = path.to_owned();
    move |source| RecordError::Write { path, source }
}

/// The contents of a file of a new recording.
#[derive(Debug)]
pub enum FileContents<'a> {
    Text(String),
    /// A copy of another file.
    Copy(&'a Path),
}

/// A place for a recording.
#[derive(Debug)]
pub struct NewFolder<'a> {
    pub place: &'a Path,
    /// Replaces a folder that only contains files of such a recording.
    pub force: bool,
    /// True for the names of such a recording's files. The names in a subfolder have the form
    /// `folder/name`.
    pub is_own: fn(&str) -> bool,
}

impl NewFolder<'_> {
    /// Checks that the recording may be written: the place does not exist, is an empty folder, or
    /// with `force` a folder that only contains such a recording's files, none of them an input.
    pub fn check(&self, inputs: &[&Path]) -> Result<(), RecordError> {
        let place = self.place;
        let Ok(there) = fs::symlink_metadata(place) else { return Ok(()) };
        if !there.is_dir() {
            return Err(RecordError::Exists(place.to_owned()));
        }
        let own = place.canonicalize().map_err(writing(place))?;
        let is_within = |input: &&&Path| input.canonicalize().is_ok_and(|input| input.starts_with(&own));
        if let Some(input) = inputs.iter().find(is_within) {
            return Err(RecordError::Within(input.to_path_buf()));
        }
        let files = files_in(place, "")?;
        match files.iter().find(|(name, is_file)| !(*is_file && (self.is_own)(name))) {
            _ if files.is_empty() => Ok(()),
            _ if !self.force => Err(RecordError::Exists(place.to_owned())),
            Some((foreign, _)) => Err(RecordError::Foreign { folder: place.to_owned(), foreign: foreign.clone() }),
            None => Ok(()),
        }
    }

    /// Writes all files. [`Self::check`] is repeated before an existing folder is replaced.
    pub fn write(&self, files: &[(String, FileContents<'_>)]) -> Result<(), RecordError> {
        let place = self.place;
        let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let made = MadeFolder::make(parent).map_err(writing(parent))?;
        let prefix = format!(".{}.part-", name_of(place)?);
        let (part, unfinished) = UndoGuard::begin(|| {
            let mut builder = tempfile::Builder::new();
            builder.prefix(&prefix);
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                // Like any folder: subject to the umask.
                builder.permissions(fs::Permissions::from_mode(0o777));
            }
            let part = builder.tempdir_in(parent)?;
            let path = part.path().to_owned();
            let undo: Undo = Box::new(move || _ = fs::remove_dir_all(path));
            Ok::<_, io::Error>((part, undo))
        })
        .map_err(writing(place))?;
        for (name, contents) in files {
            let to = part.path().join(name);
            let folder = to.parent().unwrap_or(part.path());
            let written = fs::create_dir_all(folder).and_then(|()| match contents {
                FileContents::Text(text) => fs::write(&to, text),
                FileContents::Copy(from) => fs::copy(from, &to).map(drop),
            });
            written.map_err(writing(&place.join(name)))?;
        }
        unfinished.finish(|| {
            // Checked again: it may have changed meanwhile.
            self.check(&[])?;
            if place.exists() {
                fs::remove_dir_all(place).map_err(writing(place))?;
            }
            fs::rename(part.path(), place).map_err(writing(place))
        })?;
        made.keep();
        Ok(())
    }
}

/// The recording's name: that of its folder.
pub fn name_of(place: &Path) -> Result<String, RecordError> {
    let name = place.file_name().ok_or_else(|| RecordError::NoFolder(place.to_owned()))?;
    Ok(name.to_string_lossy().into_owned())
}

/// The entries of a folder and of the folders in it, except those: names relative to `place`, and
/// whether each is a regular file. In order of their names.
fn files_in(folder: &Path, before: &str) -> Result<Vec<(String, bool)>, RecordError> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(writing(folder))? {
        let entry = entry.map_err(writing(folder))?;
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        let kind = entry.file_type().map_err(writing(&entry.path()))?;
        // One level of folders: deeper ones are foreign.
        if kind.is_dir() && before.is_empty() {
            files.extend(files_in(&entry.path(), &format!("{name}/"))?);
        } else {
            files.push((name, kind.is_file()));
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_own(name: &str) -> bool {
        ["a.txt", "images/b.txt"].contains(&name)
    }

    fn text(name: &str) -> (String, FileContents<'static>) {
        (name.to_owned(), FileContents::Text(format!("{name}!")))
    }

    #[test]
    fn folder_is_replaced_only_with_force_and_only_if_all_files_are_own() {
        let above = tempfile::tempdir().unwrap();
        let place = above.path().join("new");
        let folder = |force| NewFolder { place: &place, force, is_own };
        folder(false).write(&[text("a.txt"), text("images/b.txt")]).unwrap();
        assert_eq!(fs::read_to_string(place.join("images/b.txt")).unwrap(), "images/b.txt!");
        assert!(matches!(folder(false).check(&[]), Err(RecordError::Exists(_))));
        folder(true).check(&[]).unwrap();
        let input = place.join("a.txt");
        assert!(matches!(folder(true).check(&[&input]), Err(RecordError::Within(_))));
        folder(true).write(&[text("a.txt")]).unwrap();
        assert!(!place.join("images").exists());
        // The user's own file stays, in a subfolder too.
        fs::create_dir(place.join("images")).unwrap();
        fs::write(place.join("images/notes.txt"), "mine").unwrap();
        let error = folder(true).write(&[text("a.txt")]).unwrap_err().to_string();
        assert!(error.contains("contains images/notes.txt"), "{error}");
        assert_eq!(fs::read_to_string(place.join("images/notes.txt")).unwrap(), "mine");
        assert_eq!(fs::read_dir(above.path()).unwrap().count(), 1, "no unfinished folder is left");
    }
}
