//! The files of a recording.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::Recording;
use super::parts::Pictures;
use crate::source::{SourceError, still};

impl Recording {
    /// All files that the recording is read from, except the camera's profile.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let pictures = match &*self.pictures {
            Pictures::Stills(files) => files,
            Pictures::Video(video, _) => std::slice::from_ref(&video.file),
        };
        self.description_files.iter().chain(pictures).map(PathBuf::as_path).chain(self.depth_files())
    }

    /// True if the frames are those of a video.
    pub fn is_video(&self) -> bool {
        matches!(&*self.pictures, Pictures::Video(..))
    }

    /// The files of pictures, including a video's, and of depth.
    pub fn pictures(&self) -> impl Iterator<Item = &Path> {
        let video = match &*self.pictures {
            Pictures::Stills(_) => None,
            Pictures::Video(video, _) => Some(video.file.as_path()),
        };
        self.stills().chain(video).chain(self.depth_files())
    }

    /// The folders that contain its pictures, including depth, without duplicates.
    pub fn folders(&self) -> BTreeSet<&Path> {
        self.stills().chain(self.depth_files()).filter_map(Path::parent).collect()
    }

    /// The frames' pictures; empty for a video.
    pub fn stills(&self) -> impl Iterator<Item = &Path> {
        let files = match &*self.pictures {
            Pictures::Stills(files) => files.as_slice(),
            Pictures::Video(..) => &[],
        };
        files.iter().map(PathBuf::as_path)
    }

    /// The file with a frame's picture, and the picture's index in it if it is a video.
    pub fn picture_file(&self, frame: usize) -> Option<(&Path, Option<usize>)> {
        match &*self.pictures {
            Pictures::Stills(files) => Some((files.get(frame)?, None)),
            Pictures::Video(video, kept) => {
                let index = kept.as_ref().map_or(Some(frame), |kept| kept.get(frame).copied());
                Some((&video.file, Some(index?)))
            }
        }
    }

    fn depth_files(&self) -> impl Iterator<Item = &Path> {
        self.depth.iter().flat_map(|depth| depth.files())
    }

    /// The number of pictures, including depth, and an error for each truncated file. Pixels are
    /// not decoded; videos are not checked. [`Recording::undecoded_depth`] then warns about frames
    /// without depth.
    pub fn check_ends(&self) -> (usize, Vec<SourceError>) {
        let stills: BTreeSet<&Path> = self.stills().collect();
        let (of_depth, depth_problems) = self.depth.as_ref().map(|depth| depth.check_ends()).unwrap_or_default();
        let problems = stills.iter().filter_map(|file| still::check_end(file).err()).chain(depth_problems);
        (stills.len() + of_depth, problems.collect())
    }
}
