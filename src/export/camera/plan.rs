//! The export: files by name, checks before anything is written, and the writing.

use std::fmt::Write as _;
use std::io::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::format::CameraFormat;
use super::plate::Plate;
use super::readme::{self, ReadmeFacts};
use super::shot_camera::ShotCamera;
use super::texture::png;
use super::usd_scene::{self, TEXTURE_FOLDER, UsdEvidence, texture_file};
use super::{glb, st_map, usda};
use crate::cleanup::MadeFolder;
use crate::export::error::ExportError;
use crate::export::inputs::Inputs;
use crate::shot::{AnalysisState, Shot};
use crate::sink::atomic::write_atomically;
use crate::sink::{check_file, exr};
use crate::text::number;
use crate::tracking::matchmove::chan::{self, ChanRow};

/// Deviation of glTF's keyframes from whole frames that causes a warning.
const MAX_JITTER_FRAMES: f64 = 0.01;

const README: &str = "README.txt";
const FRAME_LIST: &str = "frames.csv";

/// Range, outputs and options of the export of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraExport {
    /// Frames of the recording, counted from 0. Not empty.
    pub range: Range<usize>,
    pub folder: PathBuf,
    pub formats: Vec<CameraFormat>,
    /// Number of the recording's first frame in the other programs.
    pub first_number: i64,
    /// Frame rate of the other program. Keyframes in seconds are then at constant intervals,
    /// instead of the frames' own times.
    pub fps: Option<f64>,
    /// Replaces existing files.
    pub force: bool,
}

/// An export with the contents of its files, except pictures.
#[derive(Debug)]
pub struct CameraExportPlan<'a> {
    export: &'a CameraExport,
    shot: &'a Shot,
    camera: ShotCamera,
    plates: Vec<(CameraFormat, Plate)>,
    /// The undistorted plate, if any format needs it.
    mapped: Option<Plate>,
    usd_evidence: UsdEvidence,
}

impl CameraExport {
    /// Collects poses and lenses, and chooses the plates.
    pub fn plan<'a>(&'a self, shot: &'a Shot) -> Result<CameraExportPlan<'a>, ExportError> {
        shot.check_files()?;
        let camera = ShotCamera::of(shot, self.range.clone(), self.first_number, self.fps)?;
        let (mut plates, mut mapped) = (Vec::new(), None);
        for format in &self.formats {
            let plate = match Plate::recorded(&camera.lenses, format.abilities()) {
                Some(recorded) => recorded,
                None => {
                    let plate = Plate::undistorted(&camera.lenses)
                        .map_err(|source| ExportError::refused(&shot.recording.path, source.to_string()))?;
                    mapped.insert(plate).clone()
                }
            };
            plates.push((*format, plate));
        }
        let usd_evidence = if self.formats.contains(&CameraFormat::Usda) {
            usd_scene::write(&shot.scene, camera.file_from_world)
        } else {
            UsdEvidence::default()
        };
        Ok(CameraExportPlan { export: self, shot, camera, plates, mapped, usd_evidence })
    }
}

impl CameraExportPlan<'_> {
    /// File names of the ST maps of a lens: undistort, redistort. With several lenses there is one
    /// pair per frame.
    fn map_files(&self, number: i64) -> [String; 2] {
        ["undistort", "redistort"].map(|kind| {
            if self.camera.lenses.len() > 1 { format!("{kind}.{number:06}.exr") } else { format!("{kind}.exr") }
        })
    }

    /// The frames with an ST map: all of them if the lens varies, otherwise the first.
    fn mapped_frames(&self) -> impl Iterator<Item = (i64, usize)> {
        let count = match (&self.mapped, self.camera.lenses.len()) {
            (None, _) => 0,
            (Some(_), 1) => 1,
            _ => self.camera.frames.len(),
        };
        self.camera.frames.iter().take(count).map(|frame| (frame.number, frame.lens))
    }

    /// All files, relative to the folder.
    fn files(&self) -> Vec<String> {
        let cameras = self.plates.iter().map(|(format, _)| format.file_name().to_owned());
        let maps = self.mapped_frames().flat_map(|(number, _)| self.map_files(number));
        let textures =
            self.usd_evidence.textures.iter().map(|texture| format!("{TEXTURE_FOLDER}/{}", texture_file(*texture)));
        cameras.chain(maps).chain(textures).chain([FRAME_LIST, README].map(str::to_owned)).collect()
    }

    /// Rejects outputs that would overwrite inputs, and existing files without `force`.
    pub fn check(&self, inputs: &Inputs) -> Result<(), ExportError> {
        let folder = &self.export.folder;
        if folder.exists() && !folder.is_dir() {
            return Err(ExportError::refused(folder, "is a file; an export of a camera needs a folder for its files"));
        }
        inputs.check_folder(folder, self.files())?;
        self.files().iter().try_for_each(|name| Ok(check_file(&folder.join(name), self.export.force)?))
    }

    /// Warnings about the export itself.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(plate) = &self.mapped {
            let formats: Vec<&str> = self
                .plates
                .iter()
                .filter(|(_, plate)| !plate.is_recorded)
                .map(|(format, _)| format.file_name())
                .collect();
            notes.push(format!(
                "{}: the camera is that of an undistorted picture of {}x{} px; redistort.exr leads from it to the \
                 recorded one (README.txt)",
                formats.join(", "),
                plate.width_px,
                plate.height_px
            ));
        }
        if self.camera.lenses.iter().any(|lens| lens.intrinsics.readout_time_s > 0.0) {
            notes.push("each pose is that of the middle row: rolling shutter is not exported".to_owned());
        }
        let jitter_s = self.camera.jitter_s();
        if self.export.formats.contains(&CameraFormat::Gltf) && jitter_s * self.camera.fps > MAX_JITTER_FRAMES {
            notes.push(format!(
                "camera.glb: the frames' times deviate by up to {} ms from a constant rate, so that programs with whole \
                 frames (Blender) interpolate between poses; --fps places one at each frame of that rate, and camera.usda has one at each",
                crate::text::fixed(1e3 * jitter_s, 1)
            ));
        }
        if !self.camera.is_up_known {
            notes.push(format!(
                "the world's up is unknown: the mean of the cameras' own, {}, becomes y (README.txt)",
                self.camera.up.to_array().map(|value| crate::text::fixed(value, 4)).join(" ")
            ));
        }
        notes
    }

    /// Writes all files. Each is complete or absent.
    pub fn write(&self) -> Result<Vec<PathBuf>, ExportError> {
        let CameraExport { folder, force, .. } = self.export;
        let made = MadeFolder::make(folder).map_err(|source| ExportError::Folder { path: folder.clone(), source })?;
        let mut written = Vec::new();
        let mut save = |name: &str, bytes: &[u8]| -> Result<(), ExportError> {
            let path = folder.join(name);
            write_atomically(&path, *force, |file| file.write_all(bytes))?;
            written.push(path);
            Ok(())
        };
        let name = &self.shot.recording.name;
        let encoded = |path: &Path, png: Result<Vec<u8>, image::ImageError>| {
            png.map_err(|error| ExportError::refused(path, format!("a texture cannot be written as PNG: {error}")))
        };
        for texture in &self.usd_evidence.textures {
            let file = format!("{TEXTURE_FOLDER}/{}", texture_file(*texture));
            save(&file, &encoded(&folder.join(&file), png(&self.shot.scene.textures[*texture]))?)?;
        }
        for (format, plate) in &self.plates {
            let bytes = match format {
                CameraFormat::Chan => self.chan(plate).into_bytes(),
                CameraFormat::Usda => usda::write(&self.camera, plate, name, &self.usd_evidence.text).into_bytes(),
                CameraFormat::Gltf => encoded(folder, glb::write(&self.camera, plate, name, &self.shot.scene))?,
            };
            save(format.file_name(), &bytes)?;
        }
        save(FRAME_LIST, self.frame_list().as_bytes())?;
        save(README, self.readme().as_bytes())?;
        if let Some(plate) = &self.mapped {
            for (number, lens) in self.mapped_frames() {
                let (geometry, pinhole) = (&self.camera.lenses[lens], &plate.lenses[lens]);
                let maps = [st_map::undistort(geometry, plate, pinhole), st_map::redistort(geometry, plate, pinhole)];
                for (name, map) in self.map_files(number).iter().zip(&maps) {
                    let path = folder.join(name);
                    exr::write_st_map(&path, map, *force)?;
                    written.push(path);
                }
            }
        }
        made.keep();
        Ok(written)
    }

    fn chan(&self, plate: &Plate) -> String {
        let row = |(frame, placement): (&super::shot_camera::CameraFrame, &_)| ChanRow {
            frame: frame.number,
            placement: *placement,
            vertical_fov_rad: plate.vertical_fov_rad(frame.lens),
        };
        chan::write(&self.camera.posed().map(row).collect::<Vec<_>>())
    }

    /// A table of the frames: number, index in the recording, time, whether there is a pose, file,
    /// and the picture's index in a video.
    fn frame_list(&self) -> String {
        let mut text = "frame,recording_frame,time_s,has_pose,file,file_frame\n".to_owned();
        for frame in &self.camera.frames {
            let (file, in_file) = self.shot.recording.picture_file(frame.index).unwrap_or((Path::new(""), None));
            let file = file.display().to_string();
            let file =
                if file.contains([',', '"', '\n']) { format!("\"{}\"", file.replace('"', "\"\"")) } else { file };
            let _ = writeln!(
                text,
                "{},{},{},{},{file},{}",
                frame.number,
                frame.index,
                number(self.shot.recording.timestamps_s[frame.index]),
                u8::from(frame.placement.is_some()),
                in_file.map_or_else(String::new, |index| index.to_string()),
            );
        }
        text
    }

    fn readme(&self) -> String {
        let plates: Vec<_> = self.plates.iter().map(|(format, plate)| (*format, plate)).collect();
        let first = self.camera.frames.first().map_or(0, |frame| frame.number);
        let are_poses_refined =
            matches!(&self.shot.analysis, AnalysisState::Used(_, findings) if findings.registration.pose_lines > 0);
        readme::write(&ReadmeFacts {
            name: &self.shot.recording.name,
            camera: &self.camera,
            plates: &plates,
            mapped: self.mapped.as_ref(),
            map_files: &self.map_files(first),
            object_count: self.shot.scene.objects.iter().filter(|object| !object.parts.is_empty()).count(),
            are_poses_refined,
            has_even_times: self.export.fps.is_some(),
        })
    }
}
