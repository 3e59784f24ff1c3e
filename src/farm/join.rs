//! Joins parts to the output of one run, without encoding anything again.

use std::io::{self, Write};
use std::path::Path;

use super::agreement::check_agreement;
use super::completeness::check_outputs;
use super::error::FarmError;
use super::join_options::JoinOptions;
use super::join_video::join_videos;
use super::joined_record::joined_record;
use super::part_record::{RecordedPart, file_sha256};
use crate::cleanup::MadeFolder;
use crate::export::resolved;
use crate::provenance::{record_path, remove_record};
use crate::sink::atomic::write_atomically;
use crate::sink::{self, OutPath, SinkError};

/// Summary of a join.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JoinSummary {
    pub parts: usize,
    pub frames: usize,
}

/// Joins parts, in order of their frames, and writes the record of the whole beside the output.
/// Fails, before anything is written, if the parts do not belong together, have holes or overlaps,
/// or differ from their records.
pub fn join(parts: &[RecordedPart], options: &JoinOptions) -> Result<JoinSummary, FarmError> {
    check_agreement(parts, options.frames.as_ref(), options.any_driver)?;
    let is_video = parts.iter().any(RecordedPart::is_video);
    check_out(parts, options, is_video)?;
    check_outputs(parts)?;
    let sha256 = if is_video {
        join_videos(parts, options)?;
        Some(file_sha256(&options.out)?)
    } else {
        join_folders(parts, options)?;
        None
    };
    let record = joined_record(parts, &options.out, &options.command, sha256.as_deref())?;
    let text = format!("{record:#}\n");
    write_atomically(&record_path(&options.out), options.force, |file| file.write_all(text.as_bytes()))?;
    Ok(JoinSummary { parts: parts.len(), frames: parts.iter().map(|part| part.range().len()).sum() })
}

/// Checks the output's path: its kind fits the parts, it is none of them, and nothing is in the
/// way.
fn check_out(parts: &[RecordedPart], options: &JoinOptions, is_video: bool) -> Result<(), FarmError> {
    let out = &options.out;
    if out.to_str().is_none() {
        return Err(FarmError::refused(
            out,
            "has a name that is not Unicode, which no record can hold; choose another",
        ));
    }
    let at = resolved(out);
    if let Some(part) = parts.iter().find(|part| at.starts_with(resolved(&part.path))) {
        return Err(FarmError::refused(out, format!("is the part {}, or lies in it", part.path.display())));
    }
    sink::check_file(&record_path(out), options.force)?;
    if !is_video {
        if options.soundtrack.is_some() {
            return Err(FarmError::refused(out, "is a folder of frames, which has no sound; leave the recording out"));
        }
        if !matches!(OutPath::parse(out), Ok(OutPath::Folder(_))) {
            return Err(FarmError::refused(out, "is no name of a folder; the parts are folders, so name a folder"));
        }
        if out.exists() && !out.is_dir() {
            return Err(FarmError::refused(out, "is a file; the parts are folders, so name a folder"));
        }
        let is_taken = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
        return if is_taken && !options.force { Err(SinkError::Exists { path: out.clone() }.into()) } else { Ok(()) };
    }
    let extension = |path: &Path| path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if let Some(part) = parts.iter().find(|part| extension(&part.path) != extension(out)) {
        let problem = format!("must end in .{}, as the part {}", extension(&part.path), part.path.display());
        return Err(FarmError::refused(out, problem));
    }
    Ok(sink::check_file(out, options.force)?)
}

/// Puts the frames of all parts into one folder.
fn join_folders(parts: &[RecordedPart], options: &JoinOptions) -> Result<(), FarmError> {
    let out = &options.out;
    let made = MadeFolder::make(out).map_err(|source| SinkError::Write { path: out.clone(), source })?;
    remove_record(out)?;
    for (path, picture) in parts.iter().flat_map(RecordedPart::frame_files) {
        let name = path.file_name().unwrap_or_default();
        place(&path, &out.join(name), picture.file_sha256.as_deref(), options.force)?;
    }
    made.keep();
    Ok(())
}

/// Puts a frame at its place: a second name of the same file where the file system has them,
/// otherwise a copy. A frame that is there already stays if it has the same content.
fn place(from: &Path, to: &Path, sha256: Option<&str>, force: bool) -> Result<(), FarmError> {
    match std::fs::hard_link(from, to) {
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            if sha256.is_some() && file_sha256(to).ok().as_deref() == sha256 {
                return Ok(());
            }
        }
        // On another file system, or on one without links.
        Err(_) => {}
    }
    let mut file = std::fs::File::open(from).map_err(|source| FarmError::reading(from, source))?;
    Ok(write_atomically(to, force, |out| io::copy(&mut file, out).map(drop))?)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::join_options::FrameTimes;
    use super::super::part_record::parts_at;
    use super::super::part_record::tests::{edit, folder_part};
    use super::*;

    pub(crate) fn options(out: &Path) -> JoinOptions {
        JoinOptions {
            out: out.to_owned(),
            frames: None,
            force: false,
            any_driver: false,
            soundtrack: None,
            times: FrameTimes::Steady,
            command: serde_json::json!({ "arguments": ["join"], "folder": "/" }),
        }
    }

    #[test]
    fn joined_folder_has_the_files_of_all_parts_and_a_record() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("parts");
        for range in [2..5, 5..6, 0..2] {
            folder_part(&folder, range);
        }
        let parts = parts_at(std::slice::from_ref(&folder)).unwrap();
        let out = temp.path().join("out");
        let whole = JoinOptions { frames: Some(0..6), ..options(&out) };
        assert_eq!(join(&parts, &whole).unwrap(), JoinSummary { parts: 3, frames: 6 });
        for frame in 0..6 {
            let text = std::fs::read_to_string(out.join(format!("frame_{frame:06}.png"))).unwrap();
            assert_eq!(text, format!("frame {frame}"));
        }
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 6);
        let joined = parts_at(std::slice::from_ref(&out)).unwrap();
        check_outputs(&joined).unwrap();
        // Existing output is kept; with --force an interrupted join is completed.
        let error = join(&parts, &whole).unwrap_err().to_string();
        assert!(error.contains("exists already, and is kept (--force replaces it)"), "{error}");
        std::fs::remove_file(out.join("frame_000003.png")).unwrap();
        std::fs::remove_file(out.join("frame_000004.png")).unwrap();
        std::fs::write(out.join("frame_000004.png"), "other").unwrap();
        join(&parts, &JoinOptions { force: true, ..whole }).unwrap();
        check_outputs(&parts_at(&[out]).unwrap()).unwrap();
        check_outputs(&parts).unwrap();
    }

    #[test]
    fn interrupted_join_with_force_leaves_no_earlier_record() {
        let temp = tempfile::tempdir().unwrap();
        let parts = parts_at(&[folder_part(&temp.path().join("parts"), 0..2)]).unwrap();
        let out = temp.path().join("out");
        join(&parts, &options(&out)).unwrap();
        // A folder in the place of a frame stops the second join.
        std::fs::remove_file(out.join("frame_000001.png")).unwrap();
        std::fs::create_dir(out.join("frame_000001.png")).unwrap();
        assert!(join(&parts, &JoinOptions { force: true, ..options(&out) }).is_err());
        assert!(!record_path(&out).exists());
    }

    #[cfg(unix)]
    #[test]
    fn output_whose_name_is_not_unicode_is_refused() {
        use std::os::unix::ffi::OsStrExt;
        let temp = tempfile::tempdir().unwrap();
        let parts = parts_at(&[folder_part(&temp.path().join("parts"), 0..2)]).unwrap();
        let out = temp.path().join(std::ffi::OsStr::from_bytes(b"out\xff"));
        let error = join(&parts, &options(&out)).unwrap_err().to_string();
        assert!(error.contains("is not Unicode") && !out.exists(), "{error}");
    }

    #[test]
    fn changed_part_or_unfit_output_is_refused_before_anything_is_written() {
        let temp = tempfile::tempdir().unwrap();
        let part = folder_part(temp.path(), 0..2);
        let parts = parts_at(std::slice::from_ref(&part)).unwrap();
        let out = temp.path().join("out");
        let refusal = |out: &Path| join(&parts, &options(out)).unwrap_err().to_string();
        let inside = part.join("joined");
        std::fs::create_dir(&inside).unwrap();
        assert!(refusal(&inside).contains("or lies in it"));
        // The folder does not exist yet, and is named by another path.
        let by_detour = temp.path().join("parts").join("..").join(part.file_name().unwrap()).join("new");
        std::fs::create_dir(temp.path().join("parts")).unwrap();
        assert!(refusal(&by_detour).contains("or lies in it"));
        std::fs::write(temp.path().join("file"), "").unwrap();
        assert!(refusal(&temp.path().join("file")).contains("is a file; the parts are folders"));
        std::fs::write(part.join("frame_000001.png"), "cut").unwrap();
        assert!(refusal(&out).contains("frame_000001.png: differs from the record of its part"));
        assert!(!out.exists() && !record_path(&out).exists());
        edit(&part, |value| value["pictures"] = serde_json::json!([]));
        assert!(parts_at(&[part]).unwrap_err().to_string().contains("not the frames 0..2 in order"));
    }
}
